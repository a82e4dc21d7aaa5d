"""Pose error of a hand: how wrong its pose may be, and which further poses are tried."""

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from grasp3d.errors import SettingError
from grasp3d.settings.checks import check_range
from grasp3d.settings.parsing import ParsedField
from grasp3d.settings.units import (
    ANGLE_UNITS,
    Length,
    LengthSettings,
    Metres,
    Radians,
    parse_angle,
    parse_length,
)

if TYPE_CHECKING:
    from collections.abc import Sequence

    import numpy as np

    from grasp3d.arrays import Floats

TOWARD = (0.0, 0.5, -(0.75**0.5))
"""Direction of one of the shifts that are tried, in the frame of a hand: along the pads, back and
to the side. The other shift is opposite."""

ABOUT = (3.0**-0.5,) * 3
"""Axis of one of the turns that are tried."""

LARGEST_SHIFT = 0.2
"""Largest plausible shift [m]; robots err by millimetres."""

LARGEST_ANGLE = math.pi / 2.0
"""Largest turn [rad]."""


@dataclass(frozen=True)
class PoseError(LengthSettings):
    """Largest difference between the true and the stated pose of a hand.

    The true origin of the hand's frame (the TCP) lies in a ball around the stated one, and the axes
    are turned by at most an angle, about any axis. For a normal distribution, the standard
    deviations are half of both.

    As a text, it is a length, an angle in degrees or with a unit, or both: '5mm,3deg'.

    Attributes:
        position: Radius of the ball, a length.
        angle: Largest turn [rad].

    Example:
        >>> from grasp3d.settings.pose_error import PoseError
        >>> error = PoseError.of("5mm,3deg")
        >>> error.position, round(error.angle, 4), str(error)
        (0.005, 0.0524, '5 mm,3 deg')
        >>> error.offsets().shape
        (3, 4, 4)
    """

    position: Length[float] = Length(0.0)
    angle: Radians = 0.0

    def __post_init__(self) -> None:
        super().__post_init__()
        check_range("position of a pose error", self.position, 0.0, LARGEST_SHIFT, unit="m")
        check_range("angle of a pose error", self.angle, 0.0, LARGEST_ANGLE, degrees=True)

    @classmethod
    def of(cls, value: "PoseError | str | Sequence[Any]") -> "PoseError":
        """Return the error of a text, or of a pair of a position and an angle [rad].

        Raises:
            SettingError: The text is invalid, or a value is outside its range.
        """
        if isinstance(value, PoseError):
            return value
        if not isinstance(value, str):
            return cls(*value)
        length, both, angle = value.strip().partition(",")
        if not both and length.lower().endswith(ANGLE_UNITS):
            length, both, angle = "0", ",", length
        try:
            position = parse_length("position", length)
            turn = parse_angle("angle", angle if both else "0")
            # A lone number may mean either.
            unclear = not both and position and not isinstance(position, Metres)
        except SettingError:
            unclear = True
        if unclear:
            raise SettingError(
                "a pose error must be a length with its unit ('5mm'), an angle ('3deg'), or both "
                f"('5mm,3deg'); got {value!r}"
            )
        return cls(position, turn)

    def __str__(self) -> str:
        """Return the text, which `of` reads."""
        degrees = f"{math.degrees(self.angle):.15g}"
        same = math.radians(float(degrees)) == self.angle
        angle = f"{degrees} deg" if same else f"{self.angle!r} rad"
        return f"{self.position},{angle}" if self.position else angle

    def __bool__(self) -> bool:
        """Return whether any pose other than the stated one is possible."""
        return bool(self.position or self.angle)

    def offsets(self) -> "Floats":
        """Poses to try, in the frame of the stated pose, which is the first one, (k, 4, 4).

        The others are two opposite extremes, shifted along the pads and turned. There are no more
        of them, as each takes as long as the stated pose.
        """
        import numpy as np

        signs = np.array([[1.0], [-1.0]]) if self else np.zeros((0, 1))
        shifts = signs * self.position * np.array(TOWARD)
        turns = signs * self.angle * np.array(ABOUT)
        return poses_of(shifts, turns)

    def draw(self, count: int, random: "np.random.Generator") -> "Floats":
        """Draw normally distributed errors, as poses in the stated pose's frame, (count, 4, 4).

        Two standard deviations along and about each axis are the error. So the root mean squares of
        shift and turn are sqrt(3) / 2 of it.

        Args:
            count: Number of errors.
            random: Generator of random numbers.
        """
        shifts, turns = random.standard_normal((2, count, 3)) / 2.0
        return poses_of(self.position * shifts, self.angle * turns)[1:]


class PoseErrorField(ParsedField[PoseError, "PoseError | str | Sequence[Any]"]):
    """A field of settings that holds a pose error, and also takes its text."""

    def parse(self, _name: str, value: Any) -> PoseError:
        """See `ParsedField.parse`."""
        return PoseError.of(value)


def poses_of(shifts: "Floats", turns: "Floats") -> "Floats":
    """Identity, then poses from shifts (k, 3) and rotation vectors [rad] (k, 3), (k + 1, 4, 4)."""
    import numpy as np
    from scipy.spatial.transform import Rotation

    poses = np.tile(np.eye(4), (len(shifts) + 1, 1, 1))
    if len(shifts):
        poses[1:, :3, :3] = Rotation.from_rotvec(turns).as_matrix()
        poses[1:, :3, 3] = shifts
    return poses
