"""What labelled files hold, as their formats store it, and which fields they must have."""

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import NoReturn

from grasp3d.arrays import short_repr
from grasp3d.errors import MeshError, OutputError
from grasp3d.reading.sources import Source
from grasp3d.settings import MAX_SEARCHED_FINGERS, GraspModel
from grasp3d.surface.fields import Array, Arrays, Field
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_fields import SURFACE, VERTICES
from grasp3d.system.names import printable

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

OPTIONAL = ("payload", "label_with_force", "free_angles", "color", "area")
"""Fields that follow from others, or depend on more than whether there is a load or a gripper."""


def needed_fields(
    model: GraspModel, *, complete: bool, gripper: bool, load: bool
) -> Iterator[Field]:
    """The fields that a file must have.

    Args:
        model: The model of its labels.
        complete: Whether its format has every field; otherwise it is a PLY.
        gripper: Whether a gripper must reach the grasps.
        load: Whether there is a load.
    """
    present = {
        "always": True,
        "errors": not model.is_uniform,
        "gripper": gripper,
        "joints": False,
        "load": load,
    }
    for field in (*VERTICES, *SURFACE):
        in_format = complete or bool(field.ply) or field.name == "faces"
        if in_format and present[field.when] and field.name not in OPTIONAL:
            yield field


def check_complete(path: str | Path, labels: SurfaceLabels, *, complete: bool) -> None:
    """Refuse to write labels that lack what a reader of the file would need.

    They were read from a PLY, which does not contain the opposing contacts.

    Args:
        path: The file that is written.
        labels: The labels.
        complete: As in `needed_fields`.

    Raises:
        OutputError: A field is not known.
    """
    if labels.grasps.known_contacts is not None:
        return
    needed = needed_fields(
        labels.model, complete=complete, gripper=labels.scene is not None,
        load=labels.load is not None,
    )  # fmt: skip
    for field in needed:
        if field not in SURFACE and field.values_of(labels) is None:
            why = (
                f"{field.name} is not known of labels that were read from a PLY and changed; "
                "label the mesh again, or write a GLB"
                if field.ply
                else f"the labels were read from a PLY, which has no {field.name}; write a PLY or "
                "GLB, or label the mesh again"
            )
            raise OutputError(f"{printable(str(path))}: {why}")
