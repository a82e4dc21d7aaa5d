"""The settings: frozen dataclasses that Python, the command line and batch runs share.

Field docstrings are the command line's help. Angles are radians here; the command line
reads and prints the fields of type `Radians` in degrees.
"""

import math
from dataclasses import dataclass, replace
from numbers import Integral
from typing import Annotated, Literal, TypedDict, get_args

from grasp3d.errors import SettingError

ANGLE = "angle"
Radians = Annotated[float, ANGLE]

Unit = Literal["m", "cm", "mm", "in"]
Grip = Literal["squeeze", "expand", "both"]
Actuation = Literal["total", "per_finger"]
Method = Literal["exact", "extremes"]
Tilts = Literal["exact", "effective_friction", "sampled_tilts"]
CandidatePoints = Literal["surface", "vertices"]
Repair = Literal["none", "safe", "full"]
MAX_FINGERS = 32
MOST_SEARCHED = 5
"""Fingers of the largest grasps that are searched for; given ones may have more."""
MIN_RAYS, MAX_RAYS = 8, 65_536
MIN_CANDIDATES, MAX_CANDIDATES = 8, 4096
LAST_SEED = 2**63
MIN_EDGES, MAX_EDGES = 3, 360
MIN_EXTREMES, MAX_EXTREMES = 3, 360
MIN_MEMORY = 0.5
DEGREE = math.pi / 180.0


@dataclass(frozen=True)
class GraspModel:
    """Friction and touch: what decides whether a grasp is surely stable."""

    friction: float = 0.5
    """Coulomb coefficient of friction between fingertip and object, above 0."""

    sensor_resolution: Radians = 22.6 * DEGREE
    """Sensor resolution alpha: the angle between the two extreme normals that the fingertip
    cannot tell apart, from 0 to below 180 degrees."""

    fingers: int = 2
    """Fingers of a grasp, 2 to 5."""

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
        if not (isinstance(self.fingers, int) and 1 <= self.fingers <= MAX_FINGERS):
            raise SettingError(f"fingers must be from 2 to {MOST_SEARCHED}; got {self.fingers}")
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
        """Dimensions of the wrenches in which epsilon is taken.

        Two hard fingers resist no torque about the line through them.
        """
        return 6 if self.torsion_radius > 0.0 or self.fingers > 2 else 5


@dataclass(frozen=True)
class Sampling:
    """How candidate grasps are searched."""

    rays: int = 64
    """Two fingers: directions tried from every vertex before the search is refined, 8 to 65536."""

    grip: Grip = "squeeze"
    """Two fingers. squeeze: they are outside, pushing toward each other; expand: inside a ring or a
    mug, pushing apart; both: whichever is better."""

    min_opening: float = 0.0
    """Two fingers: smallest distance between the contacts, in the mesh's unit."""

    max_opening: float = math.inf
    """Two fingers: largest distance between the contacts (the gripper's stroke), in the mesh's
    unit."""

    candidates: int = 64
    """Three fingers and more: places, well spread over the surface within reach of a vertex, that
    every other finger is tried at before the search is refined, 8 to 4096. Of vertices all are
    tried where there are no more than four times as many."""

    min_separation: float | None = None
    """Three fingers and more: smallest distance between any two contacts, in the mesh's unit; none:
    1/100 of the object's size, but at most 1/10 of max_spread."""

    max_spread: float = math.inf
    """Three fingers and more: largest distance between any two contacts (the hand's reach), in the
    mesh's unit."""

    candidate_points: CandidatePoints = "surface"
    """Three fingers and more: where the other fingers are put. surface: anywhere; vertices: at the
    mesh's vertices only."""

    seed: int = 0
    """Three fingers and more: seed of the spread of candidates and of the search; the same seed
    gives the same labels."""

    search_angle: Radians | None = None
    """Largest critical friction angle that counts, up to 90 degrees; for two fingers the half-angle
    of the cone of directions about the inward normal. none: just what friction and resolution need.
    Wider: labels can be asked again for any friction and resolution with atan(friction) + alpha/2
    up to this angle. Narrower: a limit to the search."""

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
        if not MIN_CANDIDATES <= whole("candidates", self.candidates, 0) <= MAX_CANDIDATES:
            raise SettingError(
                f"candidates must be from {MIN_CANDIDATES} to {MAX_CANDIDATES}; "
                f"got {self.candidates}"
            )
        least = self.min_separation or 0.0
        if not (0.0 <= least <= self.max_spread and math.isfinite(least)) or not self.max_spread:
            raise SettingError(
                "distances must satisfy 0 <= min_separation <= max_spread, and max_spread above 0; "
                f"got {least:g} and {self.max_spread:g}"
            )
        if self.candidate_points not in get_args(CandidatePoints):
            known = ", ".join(get_args(CandidatePoints))
            raise SettingError(
                f"no candidate points are called {self.candidate_points!r}; known: {known}"
            )
        if whole("seed", self.seed, 0) >= LAST_SEED:
            raise SettingError(f"seed must be below 2^63; got {self.seed}")
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
    """Faces that meet at more than this angle keep their own normals: the edge is a crease. With a
    patch_radius edges are rounded instead."""

    repair: Repair = "safe"
    """How much of a damaged surface is mended. none: nothing but what has no area is left out;
    safe: also vertices are welded, faces turned the right way out, pinholes closed, overlapping
    bodies united; full: also every hole is closed, and sealed cavities are filled."""

    patch_radius: float = 0.0
    """Radius of the fingertip's patch, in the mesh's unit: the contact normal at a place is the
    average over the surface within this distance along it, as a soft fingertip touches an area; at
    most half of the object's size. 0: the normal of the place alone."""

    max_memory: float = 2.0
    """Memory that reading and labelling one mesh may take [GB]; files that need more are refused
    before the work."""

    def __post_init__(self) -> None:
        if self.unit is not None and self.unit not in get_args(Unit):
            known = ", ".join(get_args(Unit))
            raise SettingError(f"no unit is called {self.unit!r}; known: {known}")
        if self.max_edge is not None and not self.max_edge > 0.0:
            raise SettingError(f"max_edge must be above 0; got {self.max_edge:g}")
        if not 0.0 <= self.crease_angle <= math.pi:
            degrees = math.degrees(self.crease_angle)
            raise SettingError(f"crease angle must be from 0 to 180 degrees; got {degrees:g}")
        if self.repair not in get_args(Repair):
            known = ", ".join(get_args(Repair))
            raise SettingError(f"no repair is called {self.repair!r}; known: {known}")
        if not (self.patch_radius >= 0.0 and math.isfinite(self.patch_radius)):
            raise SettingError(
                f"patch radius must be a finite length of at least 0; got {self.patch_radius:g}"
            )
        if not self.max_memory >= MIN_MEMORY:
            raise SettingError(
                f"max memory must be at least {MIN_MEMORY:g} GB; got {self.max_memory:g}"
            )


class MeshKeywords(TypedDict, total=False):
    """The fields of `MeshOptions` as keywords."""

    unit: Unit | None
    max_edge: float | None
    crease_angle: float
    repair: Repair
    patch_radius: float
    max_memory: float


def whole(name: str, value: object, least: int) -> int:
    """Take a whole number that is large enough.

    Args:
        name: What to call it in an error.
        value: The number.
        least: The smallest that will do.

    Raises:
        SettingError: It is none, or smaller.
    """
    if not isinstance(value, Integral) or isinstance(value, bool) or int(value) < least:
        raise SettingError(f"{name} must be a whole number of at least {least}; got {value!r}")
    return int(value)


def check_searched(model: GraspModel, sampling: Sampling) -> None:
    """Refuse settings of a search that it would not listen to.

    Raises:
        SettingError: Too few or too many fingers, or settings that belong to another number.
    """
    if not 2 <= model.fingers <= MOST_SEARCHED:
        raise SettingError(f"fingers must be from 2 to {MOST_SEARCHED}; got {model.fingers}")
    of_two = ("rays", "grip", "min_opening", "max_opening")
    of_more = ("candidates", "min_separation", "max_spread", "candidate_points", "seed")
    usual = Sampling()
    for names, heard, cure in (
        (of_two, model.fingers == 2, "min_separation, max_spread and candidates"),
        (of_more, model.fingers > 2, "min_opening, max_opening and rays"),
    ):
        given = [name for name in names if getattr(sampling, name) != getattr(usual, name)]
        if given and not heard:
            raise SettingError(
                f"{given[0]} says nothing about {model.fingers} fingers; these have {cure}"
            )


def with_fingers(model: GraspModel, count: int) -> GraspModel:
    """The model of given grasps, whose fingers are counted.

    Raises:
        SettingError: The model asks for another number, that is not the usual one.
    """
    if model.fingers not in {GraspModel().fingers, count}:
        raise SettingError(
            f"the grasps have {count} fingers, the model (--fingers) {model.fingers}; leave it out"
        )
    return replace(model, fingers=count)


def search_cone(model: GraspModel, sampling: Sampling) -> float:
    """Largest critical friction angle that is searched for [rad].

    For two fingers it is the half-angle of the cone of directions in which partners are sought: a
    partner seen at beta + alpha/2 or more from the normal makes no grasp better than U, so
    nothing outside needs a ray.
    """
    if sampling.search_angle is not None:
        return sampling.search_angle
    return min(model.friction_angle + model.tilt, math.pi / 2.0)


def check_choice(what: str, value: object, choices: object) -> None:
    """Refuse a value that is none of the choices.

    Args:
        what: What the value names, for the error: 'method'.
        value: The value.
        choices: A `Literal` of the choices.

    Raises:
        SettingError: It is none of them.
    """
    known = get_args(choices)
    if value not in known:
        raise SettingError(f"no {what} is called {value!r}; known: {', '.join(known)}")
