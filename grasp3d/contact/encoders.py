"""Encoders in the joints of a finger: how far its contact and its normal may be off.

An encoder of N counts per revolution reports the nearest count, so the angle of its joint is known
to half a count, pi / N. Wan & Howe 2018 (Sec. III-A) name encoders as an uncertainty and work none
out; here is the bound for a chain of joints.

A turn of one joint by an angle e moves the contact by at most r e, where r is the distance of the
contact from the joint's axis, and turns the fingertip by e. Put the errors in one after the other,
from the base to the tip: each joint then still has its own distance from the contact, which depends
only on the joints after it. So the contact moves by at most the sum of all r e, and the normal
turns by at most the sum of all e: not only for small errors.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal, get_args

from grasp3d.errors import SettingError
from grasp3d.settings.uncertainty import Uncertainty

JointKind = Literal["revolute", "prismatic"]
"""Kind of the joints of a finger; the jaws of a parallel gripper are prismatic."""

MOST_COUNTS = 2**40
"""Counts per revolution beyond any encoder, where a search for the required counts ends."""


@dataclass(frozen=True)
class JointEncoders:
    """Encoders of the joints of one finger.

    Example:
        A finger with two joints, 60 mm and 30 mm from the contact, and encoders of 12 bits:

        >>> import math
        >>> from grasp3d.contact import JointEncoders
        >>> encoders = JointEncoders(counts=4096, lengths=(60.0, 30.0))
        >>> print(f"{math.degrees(encoders.normal_error):.3f} degrees")
        0.088 degrees
        >>> print(f"{encoders.location_error:.3f} mm")
        0.069 mm
    """

    counts: tuple[float, ...] | float
    """Counts per revolution of every encoder, or of each joint; above 0, inf: exact. After
    quadrature decoding: four times the number of lines of an incremental encoder."""
    lengths: tuple[float, ...]
    """Revolute: distance of each joint's axis from the contact. Prismatic: travel of the jaw per
    revolution of its encoder. At least 0, in any unit."""
    kind: JointKind = "revolute"

    def __post_init__(self) -> None:
        if self.kind not in get_args(JointKind):
            raise SettingError(
                f"the kind of joints must be one of {', '.join(get_args(JointKind))}; got "
                f"{self.kind!r}"
            )
        object.__setattr__(self, "lengths", _numbers(self.lengths))
        if isinstance(self.counts, Sequence):
            object.__setattr__(self, "counts", _numbers(self.counts))
        given = self.counts if isinstance(self.counts, tuple) else (self.counts,)
        if not all(count > 0.0 for count in given):
            raise SettingError(f"encoder counts must be above 0; got {self.counts}")
        if isinstance(self.counts, tuple) and len(given) != len(self.lengths):
            raise SettingError(
                f"encoder counts must be one for all joints or one for each; got {len(given)}, but "
                f"joints: {len(self.lengths)}"
            )
        if not all(0.0 <= length < math.inf for length in self.lengths):
            raise SettingError(
                f"lengths of joints must be finite and at least 0; got {self.lengths}"
            )

    @classmethod
    def exact(cls) -> "JointEncoders":
        """Encoders without any error."""
        return cls(math.inf, ())

    @property
    def joints(self) -> int:
        """Number of joints."""
        return len(self.lengths)

    @property
    def angle_errors(self) -> tuple[float, ...]:
        """Largest error of each joint's encoder [rad]: half a count, pi / counts."""
        given = self.counts if isinstance(self.counts, tuple) else (self.counts,) * self.joints
        return tuple(math.pi / count for count in given)

    @property
    def normal_error(self) -> float:
        """Largest angle by which the fingertip, and so the normal, turns [rad].

        The sum of the joints' errors, attained where all axes are parallel and across the normal;
        0 for prismatic joints.
        """
        return sum(self.angle_errors) if self.kind == "revolute" else 0.0

    @property
    def location_error(self) -> float:
        """Largest distance between the true and the perceived contact across the closing axis.

        Revolute joints: in any direction, the sum of length times error. 0 for prismatic joints.
        """
        return self._travel if self.kind == "revolute" else 0.0

    @property
    def closing_error(self) -> float:
        """Largest distance between true and perceived contact along the closing axis.

        Of prismatic joints, which move the contact along the closing axis: that turns no normals. 0
        for revolute joints, whose `location_error` holds in every direction.
        """
        return self._travel / (2.0 * math.pi) if self.kind == "prismatic" else 0.0

    @property
    def _travel(self) -> float:
        pairs = zip(self.lengths, self.angle_errors, strict=True)
        return sum(length * error for length, error in pairs)

    @property
    def contact_error(self) -> float:
        """Largest distance between the true and the perceived contact, in any direction.

        `location_error` or `closing_error`. An error along the closing axis turns no line by
        itself, but it makes the opening shorter, on which other location errors then act: so it is
        one of them.
        """
        return max(self.location_error, self.closing_error)

    @property
    def uncertainty(self) -> Uncertainty:
        """What these encoders make uncertain about a contact; the unit is that of the lengths.

        Raises:
            SettingError: The normal error is 90 degrees or more.
        """
        return Uncertainty(normal_error=self.normal_error, location_error=self.contact_error)


def _numbers(values: object) -> tuple[float, ...]:
    try:
        return tuple(float(value) for value in values)  # type: ignore[attr-defined]
    except (TypeError, ValueError) as error:
        raise SettingError(f"encoders take numbers, one for each joint; got {values!r}") from error
