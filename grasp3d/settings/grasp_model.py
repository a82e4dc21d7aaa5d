"""The grasp model: friction, sensor resolution, fingers, and what is uncertain of contacts."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, Literal, TypeAlias

from grasp3d.errors import SettingError
from grasp3d.settings.checks import check_choice, check_length, check_range
from grasp3d.settings.friction import Friction, friction_interval
from grasp3d.settings.units import DEGREE, Length, LengthSettings, Radians

Method = Literal["exact", "extremes"]
Tilts = Literal["exact", "sampled_tilts", "bound"]
MAX_FINGERS = 32
MAX_SEARCHED_FINGERS = 5
"""Most fingers of a grasp that is searched for; given grasps have at most `MAX_FINGERS`."""


@dataclass(frozen=True)
class GraspModel(LengthSettings):
    """Friction, sensor resolution and fingers, from which a grasp's label follows.

    A length is in metres, or has a unit: '5mm', '0.5cm', '0.2in'; see `Length`.

    Attributes:
        friction: Coulomb friction of fingertip and object: its coefficient, above 0, or the
            interval in which it lies, 0.4..0.6: S is decided by the smallest, U by the largest.
        sensor_resolution: Resolution alpha of the fingertips' sensors: the angle between the two
            extreme normals that the fingertip cannot distinguish, from 0 to below 180 degrees.
            Further errors of the normals, such as those of joint encoders, count twice:
            alpha + 2 x error.
        fingers: Number of fingers of a grasp, 2 to 5.
        method: How grasps are labelled. exact: by the critical friction angle, which covers every
            normal within the resolution; extremes: by the wrench hulls at every combination of
            extreme normals, as in the paper, which is sampled and slower.
        torsion_radius: Soft fingers: largest torsional moment about the normal per normal force, a
            length; 2/3 x friction x r for an evenly pressed disc of radius r. 0: hard fingers. It
            affects epsilon, and under a load grip force, payload and the label with force, but no
            other labels.
        location_error: Largest distance between the true and the perceived contact point, a length:
            it is anywhere on the same surface within it, with the normal there. Labels are safe:
            every S and U is correct.

    Example:
        >>> import math
        >>> import grasp3d
        >>> model = grasp3d.GraspModel(friction=0.5, sensor_resolution=math.radians(20.0))
        >>> print(f"S below {math.degrees(model.sure_angle):.1f} degrees")
        S below 16.6 degrees
    """

    friction: Friction = Friction(0.5)
    sensor_resolution: Radians = 22.6 * DEGREE
    fingers: int = 2
    method: Method = "exact"
    torsion_radius: Length[float] = Length(0.0)
    location_error: Length[float] = Length(0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        resolution = self.sensor_resolution
        check_range("sensor resolution", resolution, 0.0, math.pi, ends="[)", degrees=True)
        check_length("location error", self.location_error)
        check_range("fingers", self.fingers, 1, MAX_FINGERS)
        check_choice("method", self.method, Method)
        if self.method == "extremes" and self.location_error != 0.0:
            raise SettingError(
                "method extremes tests normals only; location_error needs the method exact"
            )
        check_length("torsion radius", self.torsion_radius)

    @property
    def friction_interval(self) -> tuple[float, float]:
        """Smallest and largest friction."""
        return friction_interval(self.friction)

    @property
    def nominal_friction(self) -> float:
        """Friction, the middle of its interval where it is one."""
        smallest, largest = self.friction_interval
        # To 15 digits, so that the middle of 0.4..0.6 is 0.5.
        return smallest if smallest == largest else float(f"{0.5 * (smallest + largest):.15g}")

    @property
    def friction_angle(self) -> float:
        """Half-angle beta of the friction cone at the nominal friction [rad]."""
        return math.atan(self.nominal_friction)

    @property
    def tilt(self) -> float:
        """Largest angle between true and perceived normals [rad]: alpha / 2."""
        return self.sensor_resolution / 2.0

    @property
    def sure_angle(self) -> float:
        """Angle beta - alpha/2 [rad]: a grasp is S where its critical friction angle is smaller.

        Wan & Howe 2018, Sec. III-A: the friction that remains whatever the tilt, here at the
        smallest friction. Negative where tilts exceed friction.
        """
        return math.atan(self.friction_interval[0]) - self.tilt

    @property
    def possible_angle(self) -> float:
        """Angle beta + alpha/2 [rad]: the friction angle that the best tilt is equivalent to.

        At the largest friction.
        """
        return math.atan(self.friction_interval[1]) + self.tilt

    @property
    def unstable_from(self) -> float:
        """Critical friction angle from which a grasp is U [rad]: beta + alpha/2.

        inf for three fingers and more where that reaches 90 degrees: such wide cones are not
        convex, and some tilts may be force-closed whatever the critical angle is.
        """
        widest = self.possible_angle
        return math.inf if self.fingers > 2 and widest >= math.pi / 2.0 else widest

    @property
    def tilts(self) -> Tilts:
        """How epsilon's minimum over all tilts is computed; see `quality.epsilon_range`.

        Method extremes samples it, and the maximum, at the combinations that it tests. Of soft
        fingers it is a lower bound, in the model of points at which they press.
        """
        if self.method == "extremes":
            return "sampled_tilts"
        return "bound" if self.soft else "exact"

    @property
    def epsilon_rank(self) -> int:
        """Dimension of the wrench space in which epsilon is computed.

        Two hard fingers resist no torque about the line through them.
        """
        return 6 if self.soft or self.fingers > 2 else 5

    @property
    def soft(self) -> bool:
        """Whether the fingers are soft: they have a torsion radius."""
        return self.torsion_radius != 0.0


GivenModel: TypeAlias = GraspModel | Mapping[str, Any] | None
"""A model as functions take it: also a dict of its fields."""


def with_fingers(model: GraspModel, count: int) -> GraspModel:
    """The model for given grasps, whose number of fingers is known.

    Raises:
        SettingError: The model has another number of fingers, which is not the default either.
    """
    if model.fingers not in {GraspModel().fingers, count}:
        raise SettingError(
            f"the grasps have {count} fingers, but the model (--fingers) has {model.fingers}; "
            "fingers need not be set for given grasps"
        )
    return replace(model, fingers=count)
