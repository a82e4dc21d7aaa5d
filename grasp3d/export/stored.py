"""What a labelled file holds, as its format stores it."""

from dataclasses import dataclass
from typing import NoReturn

import numpy as np

from grasp3d.arrays import short_repr
from grasp3d.errors import MeshError
from grasp3d.export.fields import Array, Arrays, Field
from grasp3d.export.vertex_fields import SURFACE, VERTICES
from grasp3d.reading.sources import Source
from grasp3d.settings import MAX_SEARCHED_FINGERS

ADVICE = "label the mesh again, or export it without its labels"


@dataclass(frozen=True, eq=False)
class Stored:
    """The arrays and settings of a labelled file, not checked yet."""

    source: Source
    settings: dict[str, str]
    """Texts by name."""
    values: Arrays
    """By name of the field, as files hold them: normals point outward."""
    complete: bool
    """Whether the format has every field."""

    __repr__ = short_repr

    def field(self, name: str) -> Array:
        """Values of a field; raises MeshError if the file has none."""
        if name not in self.values:
            raise damaged(self.source, f"it has no {name}")
        return self.values[name]

    def reject(self, what: str) -> NoReturn:
        """Refuse the file.

        Args:
            what: What is wrong with it.
        """
        raise damaged(self.source, what)


def damaged(source: Source, what: str) -> MeshError:
    """The error for a labelled file that cannot be read."""
    return MeshError(f"{source.where}: has labels, but {what}; {ADVICE}")


def fingers_of(settings: dict[str, str]) -> int:
    """Number of fingers in the settings of a file. Raises ValueError."""
    fingers = int(settings.get("fingers", ""))
    if not 2 <= fingers <= MAX_SEARCHED_FINGERS:
        raise ValueError(f"grasps of {fingers} fingers are not searched for")
    return fingers


FIELDS: dict[str, Field] = {field.name: field for field in (*VERTICES, *SURFACE)}
"""All fields of labelled files by name."""


def codes_of(field: Field, texts: Array) -> Array:
    """Codes of texts. Raises ValueError."""
    known, positions = np.unique(texts.astype(str), return_inverse=True)
    unknown = set(known.tolist()) - set(field.texts)
    if unknown:
        raise ValueError(f"its {field.name} is {unknown.pop()[:20]!r} somewhere")
    codes = np.array([field.texts.index(text) for text in known.tolist()], dtype=field.kind)
    return codes[positions] if len(codes) else np.empty(0, dtype=field.kind)
