"""Regions of a surface in settings: boxes, spheres, painted masks and vertices."""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from grasp3d.errors import SettingError
from grasp3d.settings.lengths import Lengths, Measure, comparable, describe_length
from grasp3d.settings.parsing import ParsedField, Settings, TextValue

FORMS = (
    "box:X0,Y0,Z0,X1,Y1,Z1, sphere:X,Y,Z,RADIUS, or a PLY painted at its vertices (mask.ply, or "
    "mask.ply:PROPERTY)"
)
"""How parts are written, for messages."""


@dataclass(frozen=True)
class Box(Settings, TextValue):
    """A box along the axes of the mesh's frame."""

    corners: Lengths = Lengths(())
    """Its lowest corner, and its highest one: six lengths."""

    def __post_init__(self) -> None:
        super().__post_init__()
        for axis, low, high in zip("xyz", self.corners[:3], self.corners[3:], strict=True):
            ends = comparable(low, high)
            if ends and not (ends[0] <= ends[1] and all(map(math.isfinite, ends))):
                raise SettingError(
                    f"a box goes from its lowest corner to its highest one; along {axis} it is "
                    f"from {describe_length(low)} to {describe_length(high)}"
                )

    def __str__(self) -> str:
        return "box:" + ",".join(map(str, self.corners))


@dataclass(frozen=True)
class Sphere(Settings, TextValue):
    """A ball in the mesh's frame."""

    numbers: Lengths = Lengths(())
    """Its centre and its radius: four lengths."""

    def __post_init__(self) -> None:
        super().__post_init__()
        lengths = [one.number if isinstance(one, Measure) else one for one in self.numbers]
        if not all(map(math.isfinite, lengths)) or lengths[3] <= 0.0:
            raise SettingError(f"a sphere needs a centre, and a radius above 0; got {self}")

    def __str__(self) -> str:
        return "sphere:" + ",".join(map(str, self.numbers))


@dataclass(frozen=True)
class Mask(TextValue):
    """A PLY of the object, or of part of it, whose painted vertices are the part."""

    path: Path
    painted: str = ""
    """Scalar property of its vertices, above 0.5 where they are painted; empty: their colour, which
    is then not white, grey or black, or else the only such property."""

    def __str__(self) -> str:
        return f"{self.path}:{self.painted}" if self.painted else str(self.path)


@dataclass(frozen=True)
class Vertices(TextValue):
    """Vertices of a prepared mesh; files state how many there are."""

    count: int
    numbers: tuple[int, ...] = ()
    """Numbers of the vertices, in ascending order; none where a file stated them."""
    of: int | None = None
    """Number of vertices of the mesh, of a mask of all of them."""

    def __str__(self) -> str:
        return f"vertices:{self.count}"


Part: TypeAlias = Box | Sphere | Mask | Vertices


class Parts(tuple[Part, ...], TextValue):
    """Parts of a surface that together are a region; empty: none is stated."""

    __slots__ = ()

    def __str__(self) -> str:
        return "; ".join(map(str, self))


class Region(ParsedField[tuple[Part, ...], Any]):
    """A field of settings that holds a region of a surface: the union of parts.

    It takes texts, in one text separated by semicolons: `box:` and the lowest and the highest
    corner, `sphere:` and the centre and the radius, lengths in the mesh's unit or with their own;
    or the name of a PLY with painted vertices. Or numbers of vertices, or a mask of all of them.
    """

    def __init__(self) -> None:
        super().__init__(Parts())

    def parse(self, name: str, value: Any) -> Parts:
        """See `ParsedField.parse`."""
        if isinstance(value, Parts | None):
            return value or Parts()
        if isinstance(value, str):
            texts = map(str.strip, value.split(";"))
            return Parts(_part(name, text) for text in texts if text)
        if isinstance(value, Part):
            return Parts((value,))
        if isinstance(value, list | tuple) and all(
            isinstance(one, str | tuple | Part) for one in value
        ):
            return Parts(part for one in value for part in self.parse(name, one))
        import numpy as np  # not for the help of the command line

        numbers = np.asarray(value)
        if numbers.dtype.kind not in "biu" or numbers.ndim != 1:
            raise SettingError(f"{name} must be {FORMS}; got {value!r}")
        return Parts((_vertices(name, numbers),))


def _vertices(name: str, values: Any) -> Vertices:
    """The vertices of a mask of all of them, or of their numbers."""
    if values.dtype.kind == "b":
        numbers = tuple(values.nonzero()[0].tolist())
        return Vertices(len(numbers), numbers, len(values))
    numbers = tuple(sorted(set(values.tolist())))
    if len(numbers) < len(values) or (numbers and numbers[0] < 0):
        raise SettingError(
            f"{name} must be numbers of vertices, each once, or a mask of booleans; of "
            f"{len(values)} numbers {len(numbers)} differ, the smallest is {numbers[0]}"
        )
    return Vertices(len(numbers), numbers)


def _part(name: str, text: str) -> Part:
    """The part of a region that a text describes."""
    kind, _, rest = text.partition(":")
    lengths = tuple(one.strip() for one in rest.split(","))
    if (kind, len(lengths)) == ("box", 6):
        return Box(lengths)
    if (kind, len(lengths)) == ("sphere", 4):
        return Sphere(lengths)
    if kind == "vertices" and rest.isdecimal():
        return Vertices(int(rest))
    if text.lower().endswith(".ply"):
        return Mask(Path(text))
    file, _, painted = text.rpartition(":")
    if file.lower().endswith(".ply") and painted:
        return Mask(Path(file), painted)
    raise SettingError(f"{name} must be {FORMS}; got {text!r}")
