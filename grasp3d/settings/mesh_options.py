"""Options to read and prepare a mesh, and the part of its surface where contacts may be.

This part is a box or a painted mask.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal, TypeAlias

from grasp3d.errors import SettingError
from grasp3d.settings.checks import check_choice, check_range
from grasp3d.settings.parsing import IN_PYTHON, ParsedField
from grasp3d.settings.units import (
    DEGREE,
    Length,
    Lengths,
    LengthSettings,
    Radians,
    Unit,
    describe_length,
)

FORMS = "box:X0,Y0,Z0,X1,Y1,Z1, or a PLY painted at its vertices (mask.ply, or mask.ply:PROPERTY)"
"""Accepted texts for a part, for messages."""


@dataclass(frozen=True)
class Box(LengthSettings):
    """A box aligned with the axes of the mesh's frame."""

    corners: Lengths = Lengths(6)
    """The lowest and the highest corner: six lengths."""

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
    """A PLY of the object, or of part of it, with the part painted on its vertices."""

    path: Path
    painted: str = ""
    """Scalar property of the vertices, above 0.5 where they are painted; empty: their colour, which
    is then not white, grey or black."""

    def __str__(self) -> str:
        return f"{self.path}:{self.painted}" if self.painted else str(self.path)


Part: TypeAlias = Box | Mask


class Region(ParsedField[Part | None, Part | str | None]):
    """A field of settings that holds a part of a surface, or None for the whole surface.

    It takes a text: `box:` with the lowest and the highest corner, lengths as for `Length`, or the
    name of a PLY with painted vertices.
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


Repair = Literal["none", "safe", "full"]
GivenUnit = Literal["m", "cm", "mm", "in", "guess"]
MIN_MEMORY = 0.5


@dataclass(frozen=True)
class MeshOptions(LengthSettings):
    """Options to read and prepare a mesh file.

    A length is in metres, or has a unit: '3mm', '0.3cm', '0.1in'; see `Length`.

    Attributes:
        scale: Factor by which the coordinates of the file are multiplied before all else, above 0.
        unit: Unit of the file's coordinates, which are converted to metres. none: the unit that the
            file states, if any; guess: if the file states none, the unit in which the object has a
            usual size, which a warning names. If no unit is known, lengths are in the mesh's own
            unit, and grippers, densities and lengths with a unit are refused.
        max_edge: Longest edge of the mesh, a length; longer edges are divided. none: 1/32 of the
            object's size.
        crease_angle: An edge whose faces meet at more than this angle is a crease (a sharp edge),
            where the faces keep their own normals.
        repair: How much of a damaged surface is repaired. none: vertices at equal positions are
            joined, and faces without area left out; safe: also vertices a rounding error apart are
            joined, faces oriented outward, pinholes closed, overlapping bodies united; full: also
            every hole is closed, and sealed cavities are filled.
        center_of_mass: Centre of mass of the object in the mesh's frame, three lengths with commas:
            10mm,0,-2.5mm. none: that of a uniform density, or, if the mesh is open, of its surface.
        region: Part of the surface where contacts may be: box:X0,Y0,Z0,X1,Y1,Z1 (its lowest and its
            highest corner), or a PLY of the object whose vertices are painted there, mask.ply or
            mask.ply:PROPERTY. none: anywhere.
        max_memory: Memory that labelling one mesh may take [GB]; meshes that need more are refused
            before they are labelled.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> options = grasp3d.MeshOptions(unit="mm", max_edge="20mm")
        >>> cube = trimesh.creation.box([40.0, 40.0, 40.0])
        >>> grasp3d.load_mesh(cube, options).file_unit
        'mm'
        >>> len(grasp3d.load_mesh(cube, options, max_edge="10mm").vertices)
        194
    """

    scale: Annotated[float, IN_PYTHON] = 1.0
    unit: GivenUnit | None = None
    max_edge: Length[float | None] = Length(None)
    crease_angle: Radians = 30.0 * DEGREE
    repair: Repair = "safe"
    center_of_mass: Lengths = Lengths(3)
    region: Region = Region()
    max_memory: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.unit is not None:
            check_choice("unit", self.unit, GivenUnit)
        check_range("scale", self.scale, 0.0, ends="()")
        if self.max_edge is not None:
            check_range("max_edge", self.max_edge, 0.0, ends="(]")
        check_range("crease angle", self.crease_angle, 0.0, math.pi, degrees=True)
        check_choice("repair", self.repair, Repair)
        check_range("max memory", self.max_memory, MIN_MEMORY, unit="GB")

    @property
    def stated_unit(self) -> Unit | None:
        """The stated unit; None: there is none, or it is to be guessed."""
        return None if self.unit == "guess" else self.unit

    @classmethod
    def of(
        cls, options: "MeshOptions | Mapping[str, Any] | None", fields_: Mapping[str, Any]
    ) -> "MeshOptions":
        """Return options with some fields changed, which functions take as keywords.

        Args:
            options: The options to change, or a dict of their fields; None: the defaults.
            fields_: New values by field name.

        Raises:
            SettingError: There is no such field, or a value is outside its range.
        """
        own = cls.given("options", options) or cls()
        return cls.given("mesh options", {**vars(own), **fields_}) or own
