"""The grasp model: friction, sensor resolution, fingers, and what is uncertain of contacts."""

import math
from dataclasses import dataclass, replace
from typing import Annotated, Literal

from grasp3d.errors import SettingError
from grasp3d.settings.checks import DEGREE, Radians, check_choice, check_length, check_range
from grasp3d.settings.lengths import Length, LengthSettings
from grasp3d.settings.parsing import IN_PYTHON, Group, Main
from grasp3d.settings.uncertainty import (
    Friction,
    check_normal_error,
    check_resolution,
    check_tilt,
    friction_interval,
)

Actuation = Literal["total", "per_finger"]
Method = Literal["exact", "extremes"]
Tilts = Literal["exact", "effective_friction", "sampled_tilts", "bound"]
Certainty = Literal["exact", "safe"]
MAX_FINGERS = 32
MAX_SEARCHED_FINGERS = 5
"""Most fingers of a grasp that is searched for; given grasps have at most `MAX_FINGERS`."""
MIN_EDGES, MAX_EDGES = 3, 360
MIN_EXTREMES, MAX_EXTREMES = 3, 360


@dataclass(frozen=True)
class GraspModel(LengthSettings):
    """Friction, sensor resolution and fingers, from which a grasp's label follows.

    A length is a number in the mesh's unit, or has a unit: '5mm', '0.005 m', '0.5cm', '0.2in'.

    Attributes:
        friction: Coulomb coefficient of friction between fingertip and object, above 0; or the
            interval in which it lies, 0.4..0.6: S is decided by the smallest, U by the largest.
        sensor_resolution: Sensor resolution alpha: the angle between the two extreme normals that
            the fingertip cannot distinguish, from 0 to below 180 degrees.
        fingers: Number of fingers of a grasp, 2 to 5.
        method: How grasps are labelled. exact: by the critical friction angle, which covers every
            normal within the resolution; extremes: by the wrench hulls at every combination of
            extreme normals, as in the paper, which is sampled and slower.
        extreme_normals: Method extremes: normals tested on the rim of each contact's cone of
            uncertainty, 3 to 360, besides the perceived one; more rings where the resolution
            exceeds four friction angles.
        edges: Edges of polygonal friction cones for epsilon, and for the labels of method extremes,
            3 to 360; none: circular cones. Exact labels and critical angles always come from
            circular ones.
        actuation: Which force epsilon limits to 1. total: the sum of all fingers' forces;
            per_finger: each finger's force.
        torsion_radius: Soft fingers: largest torsional moment about the normal per normal force, a
            length; 2/3 x friction x r for an evenly pressed disc of radius r. 0: hard fingers. It
            affects epsilon, and under a load grip force, payload and the label with force, but no
            other labels.
        friction_error: Largest difference between the true friction and `friction`, to either side;
            smaller than `friction`. 0.1 at a friction of 0.5 is the interval 0.4..0.6.
        normal_error: Largest angle between true and perceived normals beyond half the sensor
            resolution, from 0 to below 90 degrees: that of joint encoders, for example.
        location_error: Largest distance between the true and the perceived contact point, a length:
            where a contact is, not how it is inclined.
            Two fingers: exact labels; more: safe ones, every S and U is correct.

    Example:
        >>> import math
        >>> import grasp3d
        >>> model = grasp3d.GraspModel(friction=0.5, sensor_resolution=math.radians(20.0))
        >>> print(f"S below {math.degrees(model.effective_friction_angle):.1f} degrees")
        S below 16.6 degrees
    """

    friction: Annotated[Friction, Main("friction, or an interval: 0.4..0.6")] = Friction(0.5)
    sensor_resolution: Annotated[Radians, Main("what the fingertip cannot resolve")] = 22.6 * DEGREE
    fingers: Annotated[int, Group("hand")] = 2
    method: Annotated[Method, Group("search")] = "exact"
    extreme_normals: Annotated[int, IN_PYTHON] = 8
    edges: Annotated[int | None, IN_PYTHON] = None
    actuation: Annotated[Actuation, IN_PYTHON] = "total"
    torsion_radius: Length[float] = Length(0.0)
    friction_error: float = 0.0
    normal_error: Radians = 0.0
    location_error: Length[float] = Length(0.0)

    def __post_init__(self) -> None:
        super().__post_init__()
        friction, error = self._parted_friction()
        object.__setattr__(self, "friction", friction)
        object.__setattr__(self, "friction_error", error)
        self._check_uncertainty()
        if not (isinstance(self.fingers, int) and 1 <= self.fingers <= MAX_FINGERS):
            raise SettingError(
                f"fingers must be from 2 to {MAX_SEARCHED_FINGERS}; got {self.fingers}"
            )
        check_choice("method", self.method, Method)
        check_range("extreme normals", self.extreme_normals, MIN_EXTREMES, MAX_EXTREMES)
        if self.edges is not None and not (
            isinstance(self.edges, int) and MIN_EDGES <= self.edges <= MAX_EDGES
        ):
            raise SettingError(
                f"edges must be from {MIN_EDGES} to {MAX_EDGES}, or none for circular cones; "
                f"got {self.edges}"
            )
        check_choice("actuation", self.actuation, Actuation)
        check_length("torsion radius", self.torsion_radius)

    def _parted_friction(self) -> tuple[float, float]:
        """Friction and `friction_error`: the middle of an interval and half its width."""
        smallest, largest = friction_interval(self.friction)
        if smallest == largest:
            return smallest, self.friction_error
        # To 15 digits, so that 0.4..0.6 is 0.5 and 0.1 and not 0.1 and a rounding error.
        middle, half = (
            float(f"{0.5 * one:.15g}") for one in (smallest + largest, largest - smallest)
        )
        if self.friction_error not in {0.0, half}:
            raise SettingError(
                f"friction is an interval, {middle - half:.6g} to {middle + half:.6g}, and "
                f"friction_error is {self.friction_error:g}: give one of them (or friction_error=0)"
            )
        return middle, half

    def _check_uncertainty(self) -> None:
        if not 0.0 <= self.friction_error < self.friction:
            raise SettingError(
                f"friction error must be at least 0 and below the friction, {self.friction:g}; "
                f"got {self.friction_error:g}"
            )
        check_resolution(self.sensor_resolution)
        check_normal_error(self.normal_error)
        check_length("location error", self.location_error)
        check_tilt(self.tilt)
        if self.method == "extremes" and self.location_error != 0.0:
            raise SettingError(
                "method extremes tests normals only; location_error needs the method exact"
            )

    @property
    def friction_interval(self) -> tuple[float, float]:
        """Smallest and largest friction."""
        return self.friction - self.friction_error, self.friction + self.friction_error

    @property
    def friction_angle(self) -> float:
        """Half-angle beta of the friction cone at the nominal friction [rad]."""
        return math.atan(self.friction)

    @property
    def tilt(self) -> float:
        """Largest angle between true and perceived normals [rad]: alpha / 2 + normal error."""
        return self.sensor_resolution / 2.0 + self.normal_error

    @property
    def effective_friction_angle(self) -> float:
        """Angle beta - alpha/2 [rad]: a grasp is S where its critical friction angle is smaller.

        Wan & Howe 2018, Sec. III-A: the friction that remains whatever the tilt, here at the
        smallest friction and with all errors of normals. Negative where tilts exceed friction.
        """
        return math.atan(self.friction_interval[0]) - self.tilt

    @property
    def widest_friction_angle(self) -> float:
        """Angle beta + alpha/2 [rad]: the friction angle that the best tilt is equivalent to.

        At the largest friction.
        """
        return math.atan(self.friction_interval[1]) + self.tilt

    @property
    def certainty(self) -> Certainty:
        """How the labels of method exact are decided where contact locations are uncertain.

        'exact': an M is neither S nor U (two contacts; at creases a U may be an M). 'safe': every S
        and every U is correct, an M may be one of them.
        """
        return "exact" if self.fingers == 2 or self.location_error == 0.0 else "safe"

    @property
    def is_uncertain(self) -> bool:
        """Whether anything but the sensor's normals is uncertain."""
        return any((self.friction_error, self.normal_error, self.location_error))

    @property
    def unstable_from(self) -> float:
        """Critical friction angle from which a grasp is U [rad]: beta + alpha/2.

        inf for three fingers and more where that reaches 90 degrees: such wide cones are not
        convex, and some tilts may be force-closed whatever the critical angle is.
        """
        widest = self.widest_friction_angle
        return math.inf if self.fingers > 2 and widest >= math.pi / 2.0 else widest

    @property
    def tilts(self) -> Tilts:
        """How epsilon's minimum over all tilts is computed; see `quality.epsilon_range`.

        Method extremes samples it, and the maximum, at the combinations that it tests. Of soft
        fingers, and where contact locations are uncertain, it is a lower bound.
        """
        if self.location_error != 0.0:
            return "bound"
        if self.method == "extremes":
            return "sampled_tilts"
        if self.soft:
            return "bound"
        return "exact" if self.edges is None else "effective_friction"

    @property
    def epsilon_rank(self) -> int:
        """Dimension of the wrench space in which epsilon is computed.

        Two hard fingers resist no torque about the line through them.
        """
        return 6 if self.soft or self.fingers > 2 else 5

    @property
    def soft(self) -> bool:
        """Whether the fingers are soft: they have a torsion radius, in any unit."""
        return self.torsion_radius != 0.0


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
