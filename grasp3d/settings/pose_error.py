"""How wrong the pose of a hand may be: the poses that are tried besides the stated one."""

import math
from dataclasses import dataclass
from functools import cache
from typing import TYPE_CHECKING, Any, NamedTuple

from grasp3d.errors import SettingError
from grasp3d.settings.checks import DEGREE, Radians, check_length, check_range, parse_angle
from grasp3d.settings.lengths import (
    METRES,
    Length,
    LengthSettings,
    Unit,
    length_in_unit,
    parse_length,
)
from grasp3d.settings.parsing import ParsedField, TextValue

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np

    from grasp3d.arrays import Floats

TYPICAL = 5e-3, 3.0 * DEGREE
"""Position [m] and angle [rad] of the error whose ends the offsets numbered 0 have."""

RATIO = 1.11
"""Each offset is by this factor larger than the one before."""

SMALLEST, LARGEST = -30, 45
"""Numbers of the smallest and of the largest offset: of 0.2 mm and 0.13 degrees, and of 0.5 m."""

KINDS = ((1, 1), (1, 0), (0, 1), (1, 1), (1, 0), (1, 1), (1, 0), (0, 1))
"""Whether the offsets, one after the other, have a shift and a turn."""

LARGEST_ANGLE = math.pi / 2.0
"""Largest turn [rad]."""

PLASTIC = 1.1673039782614187
"""The positive root of x^5 = x + 1."""

ROUNDED_UP = 1.0 + 1e-9
"""Factor by which an offset may exceed the error through rounding."""


class PoseOffsets(NamedTuple):
    """Poses that an error allows, in the frame of the stated one."""

    poses: "Floats"
    """The stated one, the identity, first, shape (k, 4, 4)."""
    weights: "Floats"
    """Probabilities of the poses if errors are normally distributed, shape (k,): those of them that
    have as many kinds of error as are stated."""
    position: float
    """Radius of the ball in which the origin lies, in the unit of the poses."""


@dataclass(frozen=True)
class PoseError(LengthSettings, TextValue):
    """How far the true pose of a hand may be from the stated one, as robots reach it.

    The origin of its frame (the TCP) lies in a ball around the stated one, and its axes are turned
    by at most an angle, about any axis. Where a normal distribution is meant, its standard
    deviation is half of each.

    As text: a length, an angle in degrees or with a unit, or both: '5mm,3deg'.

    Attributes:
        position: Radius of the ball, a length.
        angle: Largest turn [rad].

    Example:
        >>> from grasp3d.settings.pose_error import PoseError
        >>> error = PoseError.of("5mm,3deg")
        >>> error.position, round(error.angle, 4), str(error)
        ('5 mm', 0.0524, '5 mm,3 deg')
        >>> error.offsets("m").poses.shape
        (32, 4, 4)
    """

    position: Length[float] = Length(0.0)
    angle: Radians = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_length("position of a pose error", self.position)
        check_range("angle of a pose error", self.angle, 0.0, LARGEST_ANGLE, degrees=True)

    @classmethod
    def of(cls, value: "PoseError | str | Sequence[Any]") -> "PoseError":
        """The error that a text states, or a pair of a position and an angle [rad].

        Raises:
            SettingError: It is no such text, or a value is outside its range.
        """
        if isinstance(value, PoseError):
            return value
        if not isinstance(value, str):
            return cls(*value)
        first, *others = (part.strip() for part in value.split(","))
        try:
            position, angle = parse_length("position", first), "0"
        except SettingError:
            position, angle = 0.0, first
        if others and angle == "0":
            angle = others.pop(0)
        try:
            turn = parse_angle("angle", angle)
        except SettingError:
            turn = math.nan
        # A lone number may be meant as either.
        unclear = len(value.split(",")) == 1 and isinstance(position, float) and position != 0.0
        if others or math.isnan(turn) or unclear:
            raise SettingError(
                "a pose error must be a length with its unit ('5mm'), an angle ('3deg'), or both "
                f"('5mm,3deg'); got "
                f"{value!r}"
            )
        return cls(position, turn)

    def __str__(self) -> str:
        """The text, which `of` reads."""
        degrees = f"{math.degrees(self.angle):.15g}"
        same = math.radians(float(degrees)) == self.angle
        angle = f"{degrees} deg" if same else f"{self.angle!r} rad"
        return f"{self.position},{angle}" if self.position else angle

    def __bool__(self) -> bool:
        """Whether any pose but the stated one is possible."""
        return bool(self.position or self.angle)

    def offsets(self, unit: Unit) -> "PoseOffsets":
        """Poses that are tried, in the frame of the stated one, which is the first of k.

        They are those of one list, the same for all errors, that are within the error: so a larger
        error tries all that a smaller one tries, and more. Their sizes grow from one to the next by
        11 %, their directions are spread evenly, and some have only a shift, or only a turn.

        Args:
            unit: Unit of translations, and of a position without one.
        """
        import numpy as np

        metres = METRES[unit]
        position = length_in_unit("position", self.position, unit)
        shifts, turns = _listed()
        far, angles = np.linalg.norm(shifts, axis=1) / metres, np.linalg.norm(turns, axis=1)
        within = (far <= position * ROUNDED_UP) & (angles <= self.angle * ROUNDED_UP)
        errors = ((far, position), (angles, self.angle))
        sizes = np.array([own[within] / error for own, error in errors if error])
        # The list is spread evenly over the logarithm of the size, of both errors together.
        likely = np.prod(sizes**3 * np.exp(-2.0 * sizes**2), axis=0) ** (1.0 / max(len(sizes), 1))
        weights = np.append(0.0, np.broadcast_to(likely, within.sum()))
        if not weights.any():
            weights[0] = 1.0
        poses = poses_of(shifts[within] / metres, turns[within])
        return PoseOffsets(poses, weights / weights.sum(), position)

    def draw(self, count: int, unit: Unit, random: "np.random.Generator") -> "Floats":
        """Normally distributed errors, as poses in the frame of the stated one, (count, 4, 4).

        Standard deviations along and about each axis are such that two of them are the error: the
        root mean squares of shift and turn are sqrt(3) / 2 of it.

        Args:
            count: How many.
            unit: As in `offsets`.
            random: Random numbers.
        """
        position = length_in_unit("position", self.position, unit)
        shifts, turns = random.standard_normal((2, count, 3)) / 2.0
        return poses_of(position * shifts, self.angle * turns)[1:]


class PoseErrorField(ParsedField[PoseError, "PoseError | str | Sequence[Any]"]):
    """A field of settings that holds a pose error, or takes its text."""

    def parse(self, _name: str, value: Any) -> PoseError:
        """See `ParsedField.parse`."""
        return PoseError.of(value)


def poses_of(shifts: "Floats", turns: "Floats") -> "Floats":
    """The identity, and poses of shifts (k, 3) and rotation vectors [rad] (k, 3), (k + 1, 4, 4)."""
    import numpy as np
    from scipy.spatial.transform import Rotation

    poses = np.tile(np.eye(4), (len(shifts) + 1, 1, 1))
    if len(shifts):
        poses[1:, :3, :3] = Rotation.from_rotvec(turns).as_matrix()
        poses[1:, :3, 3] = shifts
    return poses


@cache
def _listed() -> "tuple[Floats, Floats]":
    """Shifts [m] and rotation vectors [rad] of all offsets, shape (k, 3) each."""
    import numpy as np

    from grasp3d.arrays import locked

    numbers = np.arange(SMALLEST, LARGEST + 1)
    sizes = RATIO**numbers
    kinds = np.array([KINDS[number % len(KINDS)] for number in numbers])
    # Coordinates of a sequence that fills the cube of four dimensions evenly: powers of the
    # inverse of the root of x^5 = x + 1 (Roberts 2018).
    spread = np.outer(numbers, PLASTIC ** -np.arange(1.0, 5.0)) % 1.0
    shifts, turns = (_directions(spread[:, pair : pair + 2]) for pair in (0, 2))
    position, angle = TYPICAL
    return (
        locked(shifts * (sizes * position * kinds[:, 0])[:, None]),
        locked(turns * (sizes * angle * kinds[:, 1])[:, None]),
    )


def _directions(square: "Floats") -> "Floats":
    """Unit vectors (k, 3) of points in the unit square (k, 2), by area."""
    import numpy as np

    height, around = 2.0 * square[:, 0] - 1.0, 2.0 * math.pi * square[:, 1]
    level = np.sqrt(1.0 - height**2)
    return np.stack([level * np.cos(around), level * np.sin(around), height], axis=1)
