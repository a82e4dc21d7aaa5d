"""Settings of the Python API, the command line and batch runs, as frozen dataclasses.

Field docstrings are the command line's help. Angles are radians here; the command line
reads and prints the fields of type `Radians` in degrees. Fields of type `Length` are numbers in the
mesh's unit or texts with a unit, such as '80mm'.
"""

import math
from collections.abc import Mapping
from dataclasses import dataclass, fields, replace
from numbers import Integral
from typing import Annotated, Any, Literal, NamedTuple, get_args

from grasp3d.errors import SettingError
from grasp3d.settings.lengths import (
    AnyLength,
    Length,
    LengthSettings,
    Measure,
    Position,
    Unit,
    comparable,
    describe_length,
)
from grasp3d.settings.uncertainty import (
    Friction,
    Interval,
    PerFinger,
    Uncertainty,
    check_location_error,
    check_normal_error,
    check_resolution,
    check_tilt,
    friction_interval,
)

ANGLE = "angle"
Radians = Annotated[float, ANGLE]

Grip = Literal["squeeze", "expand", "both"]
Actuation = Literal["total", "per_finger"]
Method = Literal["exact", "extremes"]
ContactModel = Literal["point", "soft", "patch"]
Tilts = Literal["exact", "effective_friction", "sampled_tilts", "bound"]
CandidatePoints = Literal["surface", "vertices"]
Certainty = Literal["exact", "safe"]
Repair = Literal["none", "safe", "full"]
PoseFormat = Literal[
    "json", "csv", "parquet", "isaac_grasp", "acronym", "graspgen", "graspnet", "moveit"
]
"""Formats of files of a gripper's poses."""
MAX_FINGERS = 32
MAX_SEARCHED_FINGERS = 5
"""Most fingers of a grasp that is searched for; given grasps have at most `MAX_FINGERS`."""
MIN_RAYS, MAX_RAYS = 8, 65_536
MIN_CANDIDATES, MAX_CANDIDATES = 8, 4096
SEED_LIMIT = 2**63
MIN_EDGES, MAX_EDGES = 3, 360
MIN_EXTREMES, MAX_EXTREMES = 3, 360
MIN_MEMORY = 0.5
DEGREE = math.pi / 180.0
ANGLE_ROUNDING = 1e-9
"""Angle by which a cone may exceed the cone that was searched and still count as covered [rad]."""


_NOTHING = Uncertainty()
"""What nothing further is known of."""


class FingerLimits(NamedTuple):
    """What is known about the contact of one finger."""

    least_friction_angle: float
    """Friction angle beta at the smallest friction [rad]."""
    largest_friction_angle: float
    """The same at the largest friction [rad]."""
    tilt: float
    """Largest angle between the true and the perceived normal [rad]."""
    location_error: float
    """Largest distance between the true and the perceived contact point, a length."""


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
        location_error: Largest distance between the true and the perceived contact point, a length.
            Two fingers: exact labels; more: safe ones, every S and U is correct.
        per_finger: What is known less well about each finger: 'finger 1; finger 2', separated by
            semicolons. Finger 1 is at the vertex (of given grasps: at the first contact). Each is
            NAME=VALUE, separated by commas, or empty: sensor_resolution and normal_error in
            degrees and location_error, a length, are added to those of all fingers, friction
            replaces theirs. 'location_error=1mm; normal_error=2, friction=0.3..0.4': the contact
            of finger 1 is known to a further 1 mm, the normal of finger 2 to a further 2 degrees,
            and its friction is from 0.3 to 0.4.
        contact: Poses of a gripper: what a contact is. point: a point, with the torsion radius that
            is given; soft: it has the torsion radius of the patch that its jaw touches there,
            evenly pressed, unless one is given; patch: it also resists rolling, as its pressure may
            be centred anywhere in the patch, which affects all labels.

    Example:
        >>> import math
        >>> import grasp3d
        >>> model = grasp3d.GraspModel(friction=0.5, sensor_resolution=math.radians(20.0))
        >>> print(f"S below {math.degrees(model.effective_friction_angle):.1f} degrees")
        S below 16.6 degrees
    """

    friction: Friction = Friction(0.5)
    sensor_resolution: Radians = 22.6 * DEGREE
    fingers: int = 2
    method: Method = "exact"
    extreme_normals: int = 8
    edges: int | None = None
    actuation: Actuation = "total"
    torsion_radius: Length[float] = Length(0.0)
    friction_error: float = 0.0
    normal_error: Radians = 0.0
    location_error: Length[float] = Length(0.0)
    per_finger: PerFinger = PerFinger()
    contact: ContactModel = "point"

    def __post_init__(self) -> None:
        super().__post_init__()
        self._set_friction(friction_interval(self.friction))
        self._check_uncertainty()
        if not (isinstance(self.fingers, int) and 1 <= self.fingers <= MAX_FINGERS):
            raise SettingError(
                f"fingers must be from 2 to {MAX_SEARCHED_FINGERS}; got {self.fingers}"
            )
        check_choice("method", self.method, Method)
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
        check_choice("actuation", self.actuation, Actuation)
        _check_length("torsion radius", self.torsion_radius)
        check_choice("contact", self.contact, ContactModel)
        if self.contact == "patch":
            self._check_patches()

    def _check_patches(self) -> None:
        """Refuse what is not known of contacts with patches."""
        for name, given in (
            ("method extremes", self.method == "extremes"),
            ("location_error", self.location_error != 0.0),
            ("per_finger", bool(self.per_finger)),
        ):
            if given:
                raise SettingError(
                    f"contact='patch' (--contact patch) is for the method exact and fingers that "
                    f"are known equally well, and does not take {name}; use contact='soft', or "
                    f"leave {name} out"
                )

    def _set_friction(self, interval: Interval) -> None:
        """Part an interval of friction into its middle and `friction_error`."""
        smallest, largest = interval
        middle = smallest
        if smallest < largest:
            # To 15 digits, so that 0.4..0.6 is 0.5 and 0.1 and not 0.1 and a rounding error.
            middle, half = (
                float(f"{0.5 * one:.15g}") for one in (smallest + largest, largest - smallest)
            )
            if self.friction_error not in {0.0, half}:
                raise SettingError(
                    f"friction is an interval, {middle - half:.6g} to {middle + half:.6g}, and "
                    f"friction_error is {self.friction_error:g}: give one of them (or "
                    "friction_error=0)"
                )
            object.__setattr__(self, "friction_error", half)
        object.__setattr__(self, "friction", middle)

    def _check_uncertainty(self) -> None:
        if not 0.0 <= self.friction_error < self.friction:
            raise SettingError(
                f"friction error must be at least 0 and below the friction, {self.friction:g}; "
                f"got {self.friction_error:g}"
            )
        check_resolution(self.sensor_resolution)
        check_normal_error(self.normal_error)
        check_location_error(self.location_error)
        for own in self.per_finger or (_NOTHING,):
            check_tilt(self._tilt_of(own))
        if self.method == "extremes" and (self.location_error != 0.0 or self.per_finger):
            raise SettingError(
                "method extremes tests normals only; location_error and per_finger need the method "
                "exact"
            )

    def with_uncertainty(self, *uncertainty: Uncertainty) -> "GraspModel":
        """The same model with the uncertainty of a sensor, of encoders or of a user.

        Args:
            uncertainty: One value for all fingers, which replaces the sensor resolution and the
                errors of this model, and its friction if it states one; or one for each finger:
                then they are all there is, except for friction that they do not state.

        Raises:
            SettingError: A value is outside its range.
        """
        one = uncertainty[0] if len(uncertainty) == 1 else Uncertainty()
        return replace(
            self,
            friction=self.friction if one.friction is None else one.friction,
            friction_error=self.friction_error if one.friction is None else 0.0,
            sensor_resolution=one.sensor_resolution,
            normal_error=one.normal_error,
            location_error=one.location_error,
            per_finger="" if len(uncertainty) == 1 else uncertainty,
        )

    @property
    def fingertips(self) -> tuple[FingerLimits, ...]:
        """What is known about the contact of each finger, the one at the vertex first.

        Raises:
            SettingError: A length has a unit (see `settings_in_unit`), or `per_finger` is for
                another number of fingers.
        """
        check_per_finger(self)
        if not self.per_finger:
            return (self._limits_of(_NOTHING),) * self.fingers
        return tuple(map(self._limits_of, self.per_finger))

    def _limits_of(self, own: Uncertainty) -> FingerLimits:
        of_all, further = self.location_error, own.location_error
        if isinstance(of_all, Measure) or isinstance(further, Measure):
            raise SettingError(
                "location errors have a unit: convert them with settings_in_unit(unit of the mesh, "
                "model)"
            )
        least, largest = self._friction_of(own)
        return FingerLimits(
            math.atan(least), math.atan(largest), self._tilt_of(own), of_all + further
        )

    def _friction_of(self, own: Uncertainty) -> tuple[float, float]:
        return own.friction or self.friction_interval

    def _tilt_of(self, own: Uncertainty) -> float:
        resolution = self.sensor_resolution + own.sensor_resolution
        return resolution / 2.0 + (self.normal_error + own.normal_error)

    @property
    def friction_interval(self) -> tuple[float, float]:
        """Smallest and largest friction of a finger without a friction of its own."""
        return self.friction - self.friction_error, self.friction + self.friction_error

    @property
    def friction_bounds(self) -> tuple[float | tuple[float, ...], float | tuple[float, ...]]:
        """Smallest and largest friction, each one for all fingers or one for each."""
        if not self.per_finger:
            return self.friction_interval
        pairs = [self._friction_of(own) for own in self.per_finger]
        return tuple(low for low, _ in pairs), tuple(high for _, high in pairs)

    @property
    def frictions(self) -> float | tuple[float, ...]:
        """Nominal friction, one for all fingers or one for each: the middle of its interval."""
        if not self.per_finger:
            return self.friction
        pairs = (self._friction_of(own) for own in self.per_finger)
        return tuple(0.5 * (low + high) for low, high in pairs)

    @property
    def tilt_of_fingers(self) -> float | tuple[float, ...]:
        """`tilt`, one for all fingers or one for each, with the values of `per_finger`."""
        if not self.per_finger:
            return self.tilt
        return tuple(map(self._tilt_of, self.per_finger))

    @property
    def friction_angle(self) -> float:
        """Half-angle beta of the friction cone at the nominal friction [rad]."""
        return math.atan(self.friction)

    @property
    def tilt(self) -> float:
        """How far the true normal may lie from the perceived one [rad]: alpha / 2 + normal error.

        That of all fingers, to which the values of `per_finger` are added.
        """
        return self.sensor_resolution / 2.0 + self.normal_error

    @property
    def effective_friction_angle(self) -> float:
        """Angle beta - alpha/2 [rad]: a grasp is S where its critical friction angle is smaller.

        Wan & Howe 2018, Sec. III-A: the friction that remains whatever the tilt, here at the
        smallest friction and with all errors of normals. Negative where tilts exceed friction.
        Where fingers differ it is that of the worst finger.
        """
        if self.per_finger:
            return min(
                math.atan(self._friction_of(own)[0]) - self._tilt_of(own) for own in self.per_finger
            )
        return math.atan(self.friction - self.friction_error) - self.tilt

    @property
    def widest_friction_angle(self) -> float:
        """Angle beta + alpha/2 [rad]: the friction angle that the best tilt is equivalent to.

        At the largest friction; where fingers differ, that of the best finger.
        """
        if self.per_finger:
            return max(
                math.atan(self._friction_of(own)[1]) + self._tilt_of(own) for own in self.per_finger
            )
        return math.atan(self.friction + self.friction_error) + self.tilt

    @property
    def certainty(self) -> Certainty:
        """How the labels of method exact are decided where contact locations are uncertain.

        'exact': an M is neither S nor U (two contacts; at creases a U may be an M). 'safe': every S
        and every U is correct, an M may be one of them.
        """
        return "exact" if self.fingers == 2 or self.is_uniform else "safe"

    @property
    def is_uniform(self) -> bool:
        """Whether all contacts are known equally well, and their locations exactly.

        Then labels are thresholds on the critical friction angle.
        """
        return self.location_error == 0.0 and not self.per_finger

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

        Method extremes samples it, and the maximum, at the combinations that it tests. Where
        contact locations are uncertain it is a lower bound.
        """
        if self.location_error != 0.0 or any(one.location_error != 0.0 for one in self.per_finger):
            return "bound"
        if self.soft or self.method == "extremes":
            return "sampled_tilts"
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
        return self.torsion_radius != 0.0 or self.contact != "point"


@dataclass(frozen=True)
class Sampling(LengthSettings):
    """How candidate grasps are searched for.

    A length is a number in the mesh's unit, or has a unit: '80mm', '0.08 m', '8cm', '3in'.

    Attributes:
        rays: Two fingers: directions tested from every vertex before the search is refined, 8 to
            65536. Fingers that squeeze need few: branch and bound searches the whole surface.
        grip: Two fingers. squeeze: they are outside, pushing toward each other; expand: inside a
            ring or a mug, pushing apart; both: whichever is better.
        min_opening: Two fingers: smallest distance between the contacts, a length.
        max_opening: Two fingers: largest distance between the contacts, a length: the gripper's
            stroke.
        candidates: Three fingers and more: candidate points for every other finger before the
            search is refined, spread evenly over the surface within reach of a vertex, 8 to 4096.
            If candidate points are vertices, all of them are tested where there are at most four
            times as many.
        min_separation: Three fingers and more: smallest distance between any two contacts, a
            length; none: 1/100 of the object's size, but at most 1/10 of max_spread.
        max_spread: Three fingers and more: largest distance between any two contacts, a length: the
            reach of the robot's hand.
        candidate_points: Three fingers and more: where the other fingers may be. surface: anywhere
            on it; vertices: at the mesh's vertices only.
        seed: Three fingers and more: random seed of the candidate points and of the search; the
            same seed gives the same labels.
        search_angle: Largest critical friction angle that is searched for, up to 90 degrees; for
            two fingers the half-angle of the cone of directions about the inward normal. none: just
            what friction and resolution need. Wider: the surface can be labelled again, without a
            new search, for any friction and resolution with atan(friction) + alpha/2 up to this
            angle. Narrower: a limit to the search.
        tolerance: Step size at which the search around a vertex's best grasp stops, where it is by
            rays or random steps.

    Example:
        A gripper that opens to 80 mm, and a search that is wide enough to label the surface again
        with a friction of up to 1 and a fine sensor:

        >>> import math
        >>> import grasp3d
        >>> sampling = grasp3d.Sampling(max_opening="80mm", search_angle=math.radians(50.0))
        >>> grasp3d.Sampling(rays=4)
        Traceback (most recent call last):
            ...
        grasp3d.errors.SettingError: rays must be from 8 to 65536; got 4
    """

    rays: int = 64
    grip: Grip = "squeeze"
    min_opening: Length[float] = Length(0.0)
    max_opening: Length[float] = Length(math.inf)
    candidates: int = 64
    min_separation: Length[float | None] = Length(None)
    max_spread: Length[float] = Length(math.inf)
    candidate_points: CandidatePoints = "surface"
    seed: int = 0
    search_angle: Radians | None = None
    tolerance: Radians = 1e-3

    def __post_init__(self) -> None:
        super().__post_init__()
        if not MIN_RAYS <= self.rays <= MAX_RAYS:
            raise SettingError(f"rays must be from {MIN_RAYS} to {MAX_RAYS}; got {self.rays}")
        check_choice("grip", self.grip, Grip)
        _check_limits("openings", "min_opening", "max_opening", self)
        if not MIN_CANDIDATES <= whole_number("candidates", self.candidates, 0) <= MAX_CANDIDATES:
            raise SettingError(
                f"candidates must be from {MIN_CANDIDATES} to {MAX_CANDIDATES}; "
                f"got {self.candidates}"
            )
        _check_limits("distances", "min_separation", "max_spread", self)
        check_choice("candidate points", self.candidate_points, CandidatePoints)
        if whole_number("seed", self.seed, 0) >= SEED_LIMIT:
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
class MeshOptions(LengthSettings):
    """How a mesh file is read and prepared.

    A length is a number in the mesh's unit, or has a unit: '3mm', '0.003 m', '0.3cm', '0.1in'.

    Attributes:
        unit: Unit of the mesh's coordinates, and of lengths without a unit; none: the unit that the
            file states, if any. Nothing is scaled: positions and openings stay in this unit.
        max_edge: Longest edge of the mesh, a length; longer edges are divided. none: 1/32 of the
            object's size.
        crease_angle: An edge whose faces meet at more than this angle is a crease (a sharp edge):
            the faces keep their own normals there. With a patch_radius edges are rounded instead.
        repair: How much of a damaged surface is repaired. none: only faces without area are
            removed; safe: also vertices are welded, faces oriented outward, pinholes closed,
            overlapping bodies united; full: also every hole is closed, and sealed cavities are
            filled.
        patch_radius: Radius of the fingertip's contact patch, a length: the contact
            normal at a surface point is the average over the surface within this distance along it,
            as a soft fingertip touches an area; at most half of the object's size. 0: the normal at
            the point alone.
        center_of_mass: Centre of mass of the object in the mesh's frame, three lengths with commas:
            10mm,0,-2.5mm. none: that of a uniform density, or, if the mesh is open, of its surface.
        max_memory: Memory that reading and labelling one mesh may take [GB]; files that need more
            are refused before they are processed.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> options = grasp3d.MeshOptions(unit="mm", max_edge=20.0)
        >>> cube = trimesh.creation.box([40.0, 40.0, 40.0])
        >>> grasp3d.load_mesh(cube, options).unit
        'mm'
        >>> len(grasp3d.load_mesh(cube, options, max_edge=10.0).vertices)
        194
    """

    unit: Unit | None = None
    max_edge: Length[float | None] = Length(None)
    crease_angle: Radians = 30.0 * DEGREE
    repair: Repair = "safe"
    patch_radius: Length[float] = Length(0.0)
    center_of_mass: Position = Position(None)
    max_memory: float = 2.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.unit is not None:
            check_choice("unit", self.unit, Unit)
        edge = comparable(self.max_edge)
        if self.max_edge is not None and not (edge and edge[0] > 0.0):
            raise SettingError(f"max_edge must be above 0; got {describe_length(self.max_edge)}")
        if not 0.0 <= self.crease_angle <= math.pi:
            degrees = math.degrees(self.crease_angle)
            raise SettingError(f"crease angle must be from 0 to 180 degrees; got {degrees:g}")
        check_choice("repair", self.repair, Repair)
        _check_length("patch radius", self.patch_radius)
        if not self.max_memory >= MIN_MEMORY:
            raise SettingError(
                f"max memory must be at least {MIN_MEMORY:g} GB; got {self.max_memory:g}"
            )

    @classmethod
    def of(cls, options: "MeshOptions | None", fields_: Mapping[str, Any]) -> "MeshOptions":
        """Options with some fields changed, as functions take them as keywords.

        Args:
            options: The options to change; None: the defaults.
            fields_: New values by name of the field.

        Raises:
            SettingError: No field has such a name, or a value is outside its range.
        """
        if not (options is None or isinstance(options, cls)):
            raise SettingError(f"options must be MeshOptions(...); got {options!r}")
        names = [field.name for field in fields(cls)]
        unknown = [name for name in fields_ if name not in names]
        if unknown:
            known = ", ".join(names)
            raise SettingError(f"no mesh option is called {unknown[0]!r}; known: {known}")
        return replace(options or cls(), **fields_)


def _check_length(name: str, length: AnyLength) -> None:
    """Refuse a length that is negative or not finite; in any unit."""
    if not all(0.0 <= one < math.inf for one in comparable(length) or ()):
        raise SettingError(
            f"{name} must be a finite length of at least 0; got {describe_length(length)}"
        )


def _check_limits(what: str, least: str, most: str, sampling: Sampling) -> None:
    """Refuse limits of a distance that no distance meets.

    A number and a length with a unit are compared later, when the mesh's unit is known.
    """
    given = getattr(sampling, least), getattr(sampling, most)
    low, high = comparable(*given) or (0.0, math.inf)
    if not (0.0 <= low <= high and low < math.inf and high > 0.0):
        low_text, high_text = map(describe_length, given)
        raise SettingError(
            f"{what} must satisfy 0 <= {least} <= {most}, and {most} above 0; got {low_text} and "
            f"{high_text}"
        )


def whole_number(name: str, value: object, minimum: int) -> int:
    """Convert a value to an integer after checking that it is a whole number.

    Args:
        name: Name of the setting, for the error message.
        value: The number.
        minimum: Smallest number that is accepted.

    Raises:
        SettingError: The value is no whole number, or is smaller.
    """
    if not isinstance(value, Integral) or isinstance(value, bool) or int(value) < minimum:
        raise SettingError(f"{name} must be a whole number of at least {minimum}; got {value!r}")
    return int(value)


def check_point_contacts(model: GraspModel) -> None:
    """Refuse a contact model that needs the patches which a gripper's jaws touch.

    Raises:
        SettingError: Contacts are not points.
    """
    if model.contact != "point":
        raise SettingError(
            f"contact={model.contact!r} (--contact {model.contact}) applies to poses of a gripper, "
            "whose jaws are closed on the object (grasp3d evaluate MESH POSES --hand ...); "
            "elsewhere contacts are points: give the torsion radius of soft fingers instead "
            "(torsion_radius, --torsion-radius)"
        )


def check_search_settings(model: GraspModel, sampling: Sampling) -> None:
    """Refuse settings of a search that have no effect for the number of fingers.

    Raises:
        SettingError: Too few or too many fingers, settings that apply to another number, or
            contacts that are not points.
    """
    check_point_contacts(model)
    if not 2 <= model.fingers <= MAX_SEARCHED_FINGERS:
        raise SettingError(f"fingers must be from 2 to {MAX_SEARCHED_FINGERS}; got {model.fingers}")
    check_per_finger(model)
    two_finger_settings = ("rays", "grip", "min_opening", "max_opening")
    multi_finger_settings = (
        "candidates", "min_separation", "max_spread", "candidate_points", "seed",
    )  # fmt: skip
    default = Sampling()
    for names, applicable, alternatives in (
        (two_finger_settings, model.fingers == 2, "min_separation, max_spread and candidates"),
        (multi_finger_settings, model.fingers > 2, "min_opening, max_opening and rays"),
    ):
        changed = [name for name in names if getattr(sampling, name) != getattr(default, name)]
        if changed and not applicable:
            raise SettingError(
                f"{changed[0]} does not apply to {model.fingers} fingers; use {alternatives}"
            )


def check_per_finger(model: GraspModel) -> None:
    """Refuse uncertainties of another number of fingers than a grasp has.

    Raises:
        SettingError: `per_finger` is for another number of fingers.
    """
    count = len(model.per_finger)
    if count not in {0, model.fingers}:
        raise SettingError(
            f"per_finger (--per-finger) is for {count} finger{'s' if count > 1 else ''}, but a "
            f"grasp has {model.fingers}: separate the fingers by semicolons, and leave a finger "
            "empty of which nothing further is known ('location_error=1mm;' for two fingers)"
        )


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
    chosen = replace(model, fingers=count)
    check_per_finger(chosen)
    return chosen


def search_cone(model: GraspModel, sampling: Sampling) -> float:
    """Largest critical friction angle that is searched for [rad].

    For two fingers it is the half-angle of the cone of directions in which opposing contacts are
    searched for: one in a direction beta + alpha/2 or more from the normal makes no grasp better
    than U, so no ray is needed there.
    """
    if sampling.search_angle is not None:
        return sampling.search_angle
    return min(model.widest_friction_angle, math.pi / 2.0)


def check_choice(what: str, value: object, choices: object) -> None:
    """Raise SettingError unless a value is one of the choices.

    Args:
        what: What the value names, for the error message: 'method'.
        value: The value.
        choices: A `Literal` of the choices.

    Raises:
        SettingError: The value is none of the choices.
    """
    known = get_args(choices)
    if value not in known:
        verb = "are" if what.endswith("s") else "is"
        raise SettingError(f"no {what} {verb} called {value!r}; known: {', '.join(known)}")
