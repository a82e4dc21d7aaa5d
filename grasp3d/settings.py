"""The settings: frozen dataclasses that Python, the command line and batch runs share.

Field docstrings are the command line's help. Angles are radians here; the command line
reads and prints the fields of type `Radians` in degrees.
"""

import math
from dataclasses import dataclass
from numbers import Integral
from typing import Annotated, Literal, get_args

from grasp3d.errors import SettingError

ANGLE = "angle"
Radians = Annotated[float, ANGLE]

Unit = Literal["m", "cm", "mm", "in"]
Grip = Literal["squeeze", "expand", "both"]
Actuation = Literal["total", "per_finger"]
Method = Literal["exact", "extremes"]
Tilts = Literal["exact", "effective_friction", "sampled_tilts"]
MIN_RAYS, MAX_RAYS = 8, 65_536
MIN_EDGES, MAX_EDGES = 3, 360
MIN_EXTREMES, MAX_EXTREMES = 3, 360
DEGREE = math.pi / 180.0


@dataclass(frozen=True)
class GraspModel:
    """Friction and touch: what decides whether a grasp is surely stable."""

    friction: float = 0.5
    """Coulomb coefficient of friction between fingertip and object, above 0."""

    sensor_resolution: Radians = 22.6 * DEGREE
    """Sensor resolution alpha: the angle between the two extreme normals that the fingertip
    cannot tell apart, from 0 to below 180 degrees."""

    method: Method = "exact"
    """How labels are made. exact: from the critical friction angle, which settles every normal
    within the resolution; extremes: from the wrench hulls at every combination of extreme normals,
    as in the paper, which is sampled and slower."""

    extreme_normals: int = 8
    """Method extremes: normals tried on the rim of each contact's cone of uncertainty, 3 to 360,
    besides the perceived one; more rings where the resolution exceeds four friction angles."""

    edges: int | None = None
    """Edges of polygonal friction cones for epsilon, and for the labels of method extremes, 3 to
    360; none: circular cones. Exact labels and critical angles always come from circular ones."""

    actuation: Actuation = "total"
    """What is at most 1 in epsilon. total: the sum of all fingers' forces; per_finger: each
    finger's force."""

    torsion_radius: float = 0.0
    """Soft fingers: largest torsional moment about the normal per normal force, in the mesh's unit;
    2/3 x friction x r for an evenly pressed disc of radius r. 0: hard fingers. It counts in epsilon
    only."""

    def __post_init__(self) -> None:
        if not (self.friction > 0.0 and math.isfinite(self.friction)):
            raise SettingError(f"friction must be a finite number above 0; got {self.friction:g}")
        if not 0.0 <= self.sensor_resolution < math.pi:
            degrees = math.degrees(self.sensor_resolution)
            raise SettingError(
                "sensor resolution must be at least 0 and below 180 degrees (pi radians); "
                f"got {degrees:g} degrees (in Python angles are radians)"
            )
        if self.method not in get_args(Method):
            known = ", ".join(get_args(Method))
            raise SettingError(f"no method is called {self.method!r}; known: {known}")
        if not (
            isinstance(self.extreme_normals, int)
            and MIN_EXTREMES <= self.extreme_normals <= MAX_EXTREMES
        ):
            raise SettingError(
                f"extreme normals must be from {MIN_EXTREMES} to {MAX_EXTREMES}; "
                f"got {self.extreme_normals}"
            )
        if self.edges is not None and not (
            isinstance(self.edges, int) and MIN_EDGES <= self.edges <= MAX_EDGES
        ):
            raise SettingError(
                f"edges must be from {MIN_EDGES} to {MAX_EDGES}, or none for circular cones; "
                f"got {self.edges}"
            )
        if self.actuation not in get_args(Actuation):
            known = ", ".join(get_args(Actuation))
            raise SettingError(f"no actuation is called {self.actuation!r}; known: {known}")
        if not (self.torsion_radius >= 0.0 and math.isfinite(self.torsion_radius)):
            raise SettingError(
                f"torsion radius must be a finite length of at least 0; got {self.torsion_radius:g}"
            )

    @property
    def friction_angle(self) -> float:
        """Half-angle beta of the friction cone [rad]."""
        return math.atan(self.friction)

    @property
    def tilt(self) -> float:
        """How far the true normal may lie from the perceived one, alpha / 2 [rad]."""
        return self.sensor_resolution / 2.0

    @property
    def tilts(self) -> Tilts:
        """How epsilon's minimum over all tilts is taken; see `tilting.epsilon_range`.

        Method extremes samples it, and the maximum, at the combinations that it tries.
        """
        if self.torsion_radius > 0.0 or self.method == "extremes":
            return "sampled_tilts"
        return "exact" if self.edges is None else "effective_friction"

    @property
    def epsilon_rank(self) -> int:
        """Dimensions of the wrenches in which epsilon of two fingers is taken.

        Hard fingers resist no torque about the line through them.
        """
        return 6 if self.torsion_radius > 0.0 else 5


@dataclass(frozen=True)
class Sampling:
    """How candidate grasps are searched."""

    rays: int = 64
    """Directions tried from every vertex before the search is refined, 8 to 65536."""

    grip: Grip = "squeeze"
    """squeeze: fingers outside, pushing toward each other; expand: fingers inside a ring or a
    mug, pushing apart; both: whichever is better."""

    min_opening: float = 0.0
    """Smallest distance between the two contacts, in the mesh's unit."""

    max_opening: float = math.inf
    """Largest distance between the two contacts (the gripper's stroke), in the mesh's unit."""

    search_angle: Radians | None = None
    """Half-angle of the cone of directions about the inward normal, up to 90 degrees; none: just
    what friction and resolution need. Wider: labels can be asked again for any friction and
    resolution with atan(friction) + alpha/2 up to this angle. Narrower: a limit to the search."""

    tolerance: Radians = 1e-3
    """The search around a vertex's best grasp stops at steps of this size."""

    def __post_init__(self) -> None:
        if not MIN_RAYS <= self.rays <= MAX_RAYS:
            raise SettingError(f"rays must be from {MIN_RAYS} to {MAX_RAYS}; got {self.rays}")
        if self.grip not in get_args(Grip):
            known = ", ".join(get_args(Grip))
            raise SettingError(f"no grip is called {self.grip!r}; known: {known}")
        if not 0.0 <= self.min_opening <= self.max_opening or self.max_opening == 0.0:
            raise SettingError(
                "openings must satisfy 0 <= min_opening <= max_opening, and max_opening above 0; "
                f"got {self.min_opening:g} and {self.max_opening:g}"
            )
        if self.search_angle is not None and not 0.0 < self.search_angle <= math.pi / 2.0:
            degrees = math.degrees(self.search_angle)
            raise SettingError(
                f"search angle must be above 0 and at most 90 degrees; got {degrees:g} degrees"
            )
        if not 0.0 < self.tolerance <= math.radians(5.0):
            degrees = math.degrees(self.tolerance)
            raise SettingError(
                f"tolerance must be above 0 and at most 5 degrees; got {degrees:g} degrees"
            )


@dataclass(frozen=True)
class MeshOptions:
    """How a mesh file is read and prepared."""

    unit: Unit | None = None
    """Unit of the file's numbers; none: as the file says, if it does. Nothing is scaled: openings
    and positions stay in this unit."""

    max_edge: float | None = None
    """Longer edges are divided, in the mesh's unit; none: 1/32 of the object's size."""

    crease_angle: Radians = 30.0 * DEGREE
    """Faces that meet at more than this angle keep their own normals: the edge is a crease."""

    def __post_init__(self) -> None:
        if self.unit is not None and self.unit not in get_args(Unit):
            known = ", ".join(get_args(Unit))
            raise SettingError(f"no unit is called {self.unit!r}; known: {known}")
        if self.max_edge is not None and not self.max_edge > 0.0:
            raise SettingError(f"max_edge must be above 0; got {self.max_edge:g}")
        if not 0.0 <= self.crease_angle <= math.pi:
            degrees = math.degrees(self.crease_angle)
            raise SettingError(f"crease angle must be from 0 to 180 degrees; got {degrees:g}")


def whole(name: str, value: object, least: int) -> int:
    """Take a whole number that is large enough.

    Args:
        name: What to call it in an error.
        value: The number.
        least: The smallest that will do.

    Raises:
        SettingError: It is none, or smaller.
    """
    if not isinstance(value, Integral) or int(value) < least:
        raise SettingError(f"{name} must be a whole number of at least {least}; got {value!r}")
    return int(value)


def search_cone(model: GraspModel, sampling: Sampling) -> float:
    """Half-angle of the cone in which candidate grasps are searched [rad].

    A partner seen at beta + alpha/2 or more from the normal makes no grasp better than U, so
    nothing outside needs a ray.
    """
    if sampling.search_angle is not None:
        return sampling.search_angle
    return min(model.friction_angle + model.tilt, math.pi / 2.0)
