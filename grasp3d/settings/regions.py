"""The part of a surface where contacts may be, in settings: a box, or a painted mask."""

from dataclasses import dataclass
from pathlib import Path
from typing import Any, TypeAlias

from grasp3d.errors import SettingError
from grasp3d.settings.parsing import ParsedField
from grasp3d.settings.units import Lengths, LengthSettings, describe_length

FORMS = "box:X0,Y0,Z0,X1,Y1,Z1, or a PLY painted at its vertices (mask.ply, or mask.ply:PROPERTY)"
"""How a part is written, for messages."""


@dataclass(frozen=True)
class Box(LengthSettings):
    """A box along the axes of the mesh's frame."""

    corners: Lengths = Lengths(6)
    """Its lowest corner, and its highest one: six lengths."""

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.corners is None:
            raise SettingError("a box needs its lowest and its highest corner: six lengths")
        for axis, low, high in zip("xyz", self.corners[:3], self.corners[3:], strict=True):
            if not low <= high:
                raise SettingError(
                    f"a box goes from its lowest corner to its highest one; along {axis} it is "
                    f"from {describe_length(low)} to {describe_length(high)}"
                )

    def __str__(self) -> str:
        return "box:" + ",".join(map(str, self.corners or ()))


@dataclass(frozen=True)
class Mask:
    """A PLY of the object, or of part of it, whose painted vertices are the part."""

    path: Path
    painted: str = ""
    """Scalar property of its vertices, above 0.5 where they are painted; empty: their colour, which
    is then not white, grey or black."""

    def __str__(self) -> str:
        return f"{self.path}:{self.painted}" if self.painted else str(self.path)


Part: TypeAlias = Box | Mask


class Region(ParsedField[Part | None, Part | str | None]):
    """A field of settings that holds a part of a surface, or none, which is all of it.

    It takes a text: `box:` and the lowest and the highest corner, lengths as those of `Length`, or
    the name of a PLY with painted vertices.
    """

    def __init__(self) -> None:
        super().__init__(None)

    def parse(self, name: str, value: Any) -> Part | None:
        """See `ParsedField.parse`."""
        if value is None or isinstance(value, Part):
            return value
        text = str(value).strip()
        if text.startswith("box:") and text.count(",") == 5:
            return Box(text.removeprefix("box:"))
        if text.lower().endswith(".ply"):
            return Mask(Path(text))
        file, _, painted = text.rpartition(":")
        if file.lower().endswith(".ply") and painted:
            return Mask(Path(file), painted)
        raise SettingError(f"{name} must be {FORMS}; got {text!r}")
