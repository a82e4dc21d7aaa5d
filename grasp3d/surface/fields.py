"""Fields: values of each vertex or of each grasp, declared once for all files and tables.

Those of grasps are here, also those that vertices have too.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import KW_ONLY, dataclass, replace
from enum import IntEnum
from operator import attrgetter
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d.hand.closed_jaws import Closing, Touch
from grasp3d.stability.label import Label

Array = npt.NDArray[Any]
Arrays = dict[str, Array]
When = Literal["always", "errors", "gripper", "joints", "load", "pose error"]

RADIANS, LENGTH, AREA, NEWTONS, KILOGRAMS = "rad", "mesh unit", "mesh unit²", "N", "kg"
XYZ = ("x", "y", "z")
LETTERS = tuple(label.name for label in sorted(Label))


class Allowed(NamedTuple):
    """The values that a field may have."""

    low: float = -math.inf
    high: float = math.inf
    """Bounds of the finite values."""
    infinite: float | None = None
    """An infinite value that it may have."""
    unknown: bool = False
    """Whether it may be nan."""


FINITE, KNOWN_OR_NAN = Allowed(), Allowed(unknown=True)
POSITIVE_OR_NAN = Allowed(0.0, unknown=True)
ANGLE, ANGLE_OR_NAN = Allowed(0.0, math.pi), Allowed(0.0, math.pi, unknown=True)
ANGLE_OR_INF = Allowed(0.0, math.pi, math.inf)
NORMAL, NORMAL_OR_NAN = Allowed(-1.0, 1.0), Allowed(-1.0, 1.0, unknown=True)


@dataclass(frozen=True)
class Field:
    """What files and tables hold of each vertex, or of each grasp, under one name."""

    name: str
    """Name of the array, and of the attribute in Python unless `of` is another one."""
    meaning: str
    """In the words of the page on file formats."""
    unit: str = ""
    shape: tuple[int | str, ...] = ()
    """Of the values of one vertex or grasp; 'n': number of fingers, 'n-1': of the other fingers,
    'p': of further joints."""
    allowed: Allowed = FINITE
    _: KW_ONLY
    of: Callable[[Any], Any] | None = None
    """Takes its values from labels or grasps, None where they have none; None: the attribute."""
    kind: str = "f8"
    """NumPy type of the values, as NPZ, VTP and Parquet hold them."""
    when: When = "always"
    """What it takes for the field to be there: nothing; a location error or fingers that differ; a
    gripper; a hand with further joints; a load; an error of poses."""
    columns: tuple[str, ...] = ()
    """Names of its parts where a file or table has numbers alone; empty: with the axes as ends."""
    each: str = ""
    """Name of the values of one finger, with {} for its number; empty: it is not by finger."""
    ply: str = ""
    """Type at the vertices of a PLY, of 32 bits if it follows from others; empty: not there."""
    array: bool = True
    """Whether NPZ, VTP, `to_trimesh` and `to_polydata` have it."""
    table: bool = True
    """Whether Parquet and `to_table` have it."""
    texts: tuple[str, ...] = ()
    """Texts of the codes 0, 1, ..., which tables have in their place; empty: it has no codes."""
    outward: bool = False
    """Whether these are normals, which point into the object in Python, and outward in files."""

    def values_of(self, holder: object) -> Array | None:
        """The values as files hold them, a row for each vertex or grasp; None: there are none."""
        attribute = (self.of or attrgetter(self.name))(holder)
        if attribute is None:
            return None
        values = np.asarray(attribute)
        return -values if self.outward else values

    def texts_of(self, values: Array) -> Array:
        """Texts in place of codes, if it has any."""
        return np.array(self.texts)[values] if self.texts else values

    def shape_for(self, fingers: int) -> tuple[int, ...]:
        """Shape of the values of one vertex or grasp; -1: any number of joints."""
        sizes = {"n": fingers, "n-1": fingers - 1, "p": -1}
        return tuple(sizes[size] if isinstance(size, str) else size for size in self.shape)

    def column_names(self, fingers: int) -> list[str]:
        """Names of its columns of numbers, those of one finger after those of another."""
        parts = self.columns
        if not parts:
            head = self.each or self.name
            parts = tuple(f"{head}_{axis}" for axis in XYZ) if self.shape[-1:] == (3,) else (head,)
        numbers = range(2, fingers + 1) if self.each else range(1)
        return [part.format(finger) for finger in numbers for part in parts]

    def point_names(self, fingers: int) -> list[str]:
        """Names of its arrays of at most vectors, as VTK has them."""
        each = [self.each.format(finger) for finger in range(2, fingers + 1)]
        return each if self.each else [self.name]

    def as_columns(self, values: Array) -> Arrays:
        """Split values into columns of numbers, by name."""
        flat = values.reshape(len(values), math.prod(values.shape[1:]))
        return dict(zip(self.column_names(self._fingers(values)), flat.T, strict=True))

    def as_points(self, values: Array) -> Arrays:
        """Split values by finger, by name."""
        parts = values.swapaxes(0, 1) if self.each else [values]
        return dict(zip(self.point_names(self._fingers(values)), parts, strict=True))

    def from_columns(self, columns: Mapping[str, Array], fingers: int) -> Array:
        """Put columns of numbers together again; raises KeyError."""
        values = np.stack([columns[name] for name in self.column_names(fingers)], axis=1)
        return values.reshape(len(values), *self.shape_for(fingers))

    def from_points(self, points: Mapping[str, Array], fingers: int) -> Array:
        """Put the arrays of the fingers together again; raises KeyError."""
        parts = [points[name] for name in self.point_names(fingers)]
        if self.each:
            return np.stack(parts, axis=1)
        return parts[0].reshape(len(parts[0]), *self.shape_for(fingers))

    def _fingers(self, values: Array) -> int:
        return values.shape[1] + 1 if self.each else 0


def columns_of(fields: Iterable[Field], holder: object) -> Arrays:
    """Columns of a table, shape (rows,), with texts in place of codes."""
    return {field.name: field.texts_of(values) for field, values in present(fields, holder)}


def present(fields: Iterable[Field], holder: object) -> Iterator[tuple[Field, Array]]:
    """The fields that labels or grasps have, with their values as files hold them."""
    for field in fields:
        values = field.values_of(holder)
        if values is not None:
            yield field, values


FLOAT, DOUBLE = "f4", "f8"
"""Types of numbers in a PLY: those that follow from others, and those that are read again."""


def of_part(part: str, name: str) -> Callable[[Any], Array | None]:
    """The values of an attribute that labels or grasps may lack; None where they do."""

    def values(holder: Any) -> Array | None:
        owner = getattr(holder, part)
        return None if owner is None else getattr(owner, name)

    return values


def names_of(codes: type[IntEnum]) -> tuple[str, ...]:
    """Texts of codes 0, 1, ..."""
    return tuple(code.name.lower() for code in sorted(codes))


def _payload(holder: Any) -> Array | None:
    holding = holder.holding
    return holding.payload if holding is not None and holding.has_payload else None


LABEL = Field("label", "the label S, M or U", kind="u1", ply="u1", texts=LETTERS)
CRITICAL_ANGLE = Field(
    "critical_angle", "critical friction angle of the grasp, over the worst normals of its "
    "contacts; decides S; `inf`: no grasp", RADIANS, (), ANGLE_OR_INF, ply=DOUBLE,
)  # fmt: skip
CRITICAL_ANGLE_BEST = replace(
    CRITICAL_ANGLE, name="critical_angle_best", meaning="the same over the best normals; decides "
    "U; different on creases, and where contact locations are uncertain: there that of the best "
    "aligned grasp",
)  # fmt: skip
MAX_RESOLUTION = Field(
    "max_resolution", "sensor resolution below which the grasp is S, at the friction and the other "
    "errors of the settings; `0`: none", RADIANS, (), ANGLE, ply=FLOAT,
)  # fmt: skip
MARGIN = Field(
    "margin", r"angle by which the grasp is S: $\beta - \alpha/2 - \beta^*$, less what all other "
    "uncertainties take; S where it is above 0; `-inf`: no grasp", RADIANS, (),
    Allowed(infinite=-math.inf), ply=FLOAT,
)  # fmt: skip
EPSILON = Field(
    "epsilon", r"$\varepsilon$ at the nominal normals, a lower bound; `nan`: no grasp", "", (),
    POSITIVE_OR_NAN, ply=DOUBLE,
)  # fmt: skip
DECIDED = (LABEL, CRITICAL_ANGLE, CRITICAL_ANGLE_BEST, MAX_RESOLUTION, MARGIN)
EPSILONS = (
    EPSILON,
    replace(EPSILON, name="epsilon_min", meaning=r"smallest $\varepsilon$ over all tilts of the "
            "normals; how it is computed is a [setting](formats.md#settings)"),
    replace(EPSILON, name="epsilon_max", meaning="bound on the largest"),
)  # fmt: skip
OPENING = Field(
    "opening", "largest distance between any two contacts of the grasp", LENGTH, (),
    POSITIVE_OR_NAN, ply=FLOAT,
)  # fmt: skip
APPROACH_MARGIN = Field(
    "approach_margin", "by how much the approach may turn about the closing axis either way",
    RADIANS, (), ANGLE_OR_NAN, of=of_part("reach", "approach_margin"), when="gripper", ply=DOUBLE,
)  # fmt: skip
DEPTH = Field(
    "depth", "how far the fingertips reach beyond the contacts along the approach", LENGTH, (),
    KNOWN_OR_NAN, of=of_part("reach", "depth"), when="gripper", ply=DOUBLE,
)  # fmt: skip
GRIP_FORCE = Field(
    "grip_force", "force of each finger, along its contact's normal, that holds the load at the "
    "nominal normals; for 1 kg where no mass is given; `inf`: no force does, `nan`: no grasp",
    NEWTONS, (), Allowed(0.0, infinite=math.inf, unknown=True),
    of=of_part("holding", "grip_force"), when="load", ply=DOUBLE,
)  # fmt: skip
FORCES = (
    GRIP_FORCE,
    replace(GRIP_FORCE, name="grip_force_least", of=of_part("holding", "grip_force_least"),
            meaning="the same at the best normals that the sensor cannot distinguish; how it is "
            "known is a [setting](formats.md#settings)"),
    replace(GRIP_FORCE, name="grip_force_largest", of=of_part("holding", "grip_force_largest"),
            meaning="the same at the worst of these normals"),
    replace(GRIP_FORCE, name="payload", of=_payload, unit=KILOGRAMS, meaning="mass that the force "
            "at hand holds at the worst normals; `nan`: no grasp. Absent where no force is at "
            "hand, or the task does not depend on the mass"),
    replace(LABEL, name="label_with_force", of=of_part("holding", "label"), when="load",
            meaning="the label with the force at hand: S: the load is held at all these normals, "
            "U: at none, or there is no grasp, M: the sensor cannot decide. Absent where the mass "
            "or the force is not known"),
)  # fmt: skip
"""What a load adds to grasps."""

CLOSED = (
    Field("closed_label", "`label` at what the jaws touch when they close on the object, which is "
          "free: that of `grasp3d evaluate`. Empty: not known, as for internal grasps", kind="i8",
          of=of_part("closed", "label"), when="gripper", texts=(*LETTERS, "")),
    replace(MARGIN, name="closed_margin", meaning="`margin` there; empty also where the jaws do "
            "not close", of=of_part("closed", "margin"), when="gripper",
            allowed=Allowed(infinite=-math.inf, unknown=True)),
    Field("robust_score", "how well the touched patches hold, mean over the poses tried: that of "
          "[given poses](pose_formats.md#further-columns)", "", (),
          Allowed(-1.0, 1.0, unknown=True),
          of=lambda grasps: grasps.closed and grasps.closed.number("robust_score"),
          when="gripper"),
    Field("label_tried", "the worst label of the poses tried; empty: not known", kind="i8",
          of=lambda grasps: grasps.closed and _tried(grasps), when="gripper",
          texts=(*LETTERS, "")),
)  # fmt: skip
"""What the closed jaws of a gripper make of grasps that were found."""


def _tried(grasps: Any) -> Array:
    """Codes of the worst labels of the poses tried, -1: not known."""
    codes = grasps.closed.number("label_tried")
    return np.where(np.isnan(codes), -1.0, codes).astype(np.int64)


GRASPS = (
    Field("grasp", "number, from 1", of=lambda one: range(1, one.size + 1), kind="i8"),
    *DECIDED,
    *EPSILONS,
    Field("rank", "dimension of the span of the wrenches", kind="i8"),
    OPENING,
    replace(OPENING, name="separation", meaning="smallest distance between any two contacts"),
    *CLOSED,
    *FORCES,
)
"""Grasps in tables."""

CONTACTS = (
    Field("point", "contact point on the surface", LENGTH, ("n", 3), columns=XYZ,
          of=attrgetter("contacts.points")),
    Field("normal", "outward normal there", "", ("n", 3), columns=("nx", "ny", "nz"), outward=True,
          of=attrgetter("contacts.normals")),
    Field("distance", "distance from the surface before the contact was moved there", LENGTH,
          ("n",)),
    Field("on_crease", "whether the contact is on a crease or at a corner", "", ("n",), kind="?",
          of=attrgetter("contacts.on_crease")),
)  # fmt: skip
"""The contacts of grasps in tables."""

FOUND_POSES = (
    *DECIDED,
    *EPSILONS,
    APPROACH_MARGIN,
    DEPTH,
    replace(CONTACTS[0], name="contacts"),
    replace(CONTACTS[1], name="normals", meaning="normal into the object there", outward=False),
    *CLOSED,
    *FORCES,
)
"""Poses of grasps that were found."""


def _robust(name: str, part: str = "") -> Callable[[Any], Array | None]:
    """Numbers of closed jaws; those of tried poses only where a pose error is stated."""

    def values(holder: Any) -> Array | None:
        robustness = holder.robustness
        if robustness is None or (part == "tried" and robustness.tried == 1):
            return None
        known: Array | None = getattr(robustness, name)
        return known

    return values


ROBUST = (
    Field("pad_margin", "distance of the contacts from the border of flat pads, the smaller one of "
          "the jaws; below 0: beside them", "m", (), KNOWN_OR_NAN, of=_robust("pad_margin"),
          when="gripper"),
    Field("pad_edge", "distance of the touched patches from that border; `0`: it cuts one off",
          "m", (), POSITIVE_OR_NAN, of=_robust("pad_edge"), when="gripper"),
    Field("pressure", "force at hand over the smaller patch", "Pa", (), POSITIVE_OR_NAN,
          of=_robust("pressure"), when="load"),
    Field("patch_payload", "mass that the touched patches hold at the worst normals, with the "
          "force at hand or, where none is known, with 1 N of each finger", KILOGRAMS, (),
          Allowed(0.0, infinite=math.inf, unknown=True), of=_robust("patch_payload"),
          when="gripper"),
    Field("robust_score", "mean over the poses tried, from -1 to 1: $r/(1+r)$ with $r$ the "
          "`patch_payload` over the mass, where that is at least 1; else, below 0, the angle of "
          "friction that lacks to hold it, over π; -1 where the jaws do not close. Without mass or "
          "force $r$ is the weight held per newton of each finger. Less what contacts near the "
          "border of flat pads may lose", "", (), Allowed(-1.0, 1.0),
          of=_robust("robust_score")),
    Field("success_probability", "probability to hold the load for normally distributed errors, "
          "of which two standard deviations are stated", "", (), Allowed(0.0, 1.0),
          of=_robust("success_probability"), when="gripper"),
    Field("label_tried", "the worst `label` of the poses tried; S also requires that the patches "
          "hold the load, where mass and force are known, and stay on the pads", kind="u1",
          of=_robust("label_tried"), when="gripper", texts=LETTERS),
    *(
        Field(name, meaning, unit, (), allowed, of=_robust(name, "tried"), when="pose error")
        for name, meaning, unit, allowed in (
            ("closing_share", "share of the poses tried at which the jaws close", "",
             Allowed(0.0, 1.0)),
            ("margin_worst", "smallest `margin` of them; `-inf`: at one the jaws do not close",
             RADIANS, Allowed(infinite=-math.inf)),
            ("margin_mean", "mean of those at which they close", RADIANS,
             Allowed(infinite=-math.inf, unknown=True)),
            ("epsilon_worst", "smallest epsilon of the poses tried", "", POSITIVE_OR_NAN),
            ("epsilon_mean", "mean epsilon", "", POSITIVE_OR_NAN),
            ("score_worst", "smallest score of the poses tried", "", Allowed(-1.0, 1.0)),
        )
    ),
)  # fmt: skip
"""Numbers of what closed jaws touch, and of poses that are a little wrong."""


def _jaw(name: str, number: int) -> Callable[[Any], Array]:
    """What is at one of the jaws."""
    return lambda poses: np.asarray(getattr(poses.jaws, name)[:, number])


def given_poses(fingers: int = 2) -> tuple[Field, ...]:
    """Given poses that were evaluated, of a hand with so many fingers."""
    numbers = range(fingers)
    return (
        Field("closing", "`closed`; `nothing`: the jaws close on nothing; `one_side`: only one jaw "
              "touches; `starts_inside`: a finger starts in the object; `slips_out`: the object "
              "slides out of the closing jaws", of=attrgetter("state"), kind="u1",
              texts=names_of(Closing)),
        *(field for field in DECIDED if field is not CRITICAL_ANGLE_BEST),
        *EPSILONS,
        Field("collides", "whether the gripper collides with object or table, at the grasp, before "
              "closing, or on its approach", kind="?"),
        Field("reachable", "closed, without collision, within the stroke and the allowed "
              "directions", kind="?"),
        *(Field(f"area{number + 1}", f"area of the patch that jaw {number + 1} touches", AREA,
                of=_jaw("area", number)) for number in numbers),
        *(Field(f"touch{number + 1}", f"what jaw {number + 1} touches: `face`, `edge` (a strip), "
                "`point`, `pad_rim` (a small patch or a strip at the rim of the pad), `nothing`",
                of=_jaw("touch", number), kind="u1", texts=names_of(Touch)) for number in numbers),
        Field("apart", "whether the patches do not overlap, seen along the closing axis, as where "
              "the jaws touch at different heights", of=attrgetter("jaws.apart"), kind="?"),
        Field("turn", "angle by which a free object has turned between the jaws", RADIANS,
              of=attrgetter("jaws.turn")),
        Field("shift", "how far object or fingers gave way along the closing axis before the jaws "
              "closed, as they would have started in the object", LENGTH,
              of=attrgetter("jaws.shift")),
        *ROBUST,
        *FORCES,
    )  # fmt: skip


HELD = Allowed(0.0, infinite=math.inf, unknown=True)
ANGLE_HAND = Allowed(-math.pi, math.pi, unknown=True)

HAND_GRASPS = (
    LABEL,
    replace(LABEL, name="label_fingertips",
            meaning="the same of the fingertips with sensors alone"),
    replace(CRITICAL_ANGLE, meaning="critical friction angle of all contacts, as if each normal "
            "were known; `nan`: no grasp", allowed=ANGLE_HAND),
    replace(MAX_RESOLUTION, meaning="sensor resolution, the same of all sensors, below which the "
            "grasp is S; `0`: none"),
    replace(MARGIN, meaning="angle by which the grasp is S, at the contacts that are not blind; S "
            "where it is above 0; `-inf`: too much is blind, `nan`: no grasp",
            allowed=Allowed(infinite=-math.inf, unknown=True)),
    EPSILON,
    *(
        Field(name, meaning, kind="i8")
        for name, meaning in (
            ("rank", "dimension of the span of the wrenches, the rank of $G$; 0: none"),
            ("internal", r"dimension of the internal forces, $\mathrm{null}(G)$"),
            ("structural", "and of those that no motor sets, whose joint torques are all 0"),
            ("redundant", r"dimension of the motions without contacts, $\mathrm{null}(J)$"),
        )
    ),
    Field("links", "links that touch, separated by spaces", kind="U"),
    Field("gap", "largest gap between the surface and a link that touches; `0`: all of them are "
          "inside, `nan`: none touches",
          LENGTH, (), POSITIVE_OR_NAN),
    Field("penetration", "how deep the deepest link is inside the object; `0`: none is", LENGTH,
          (), Allowed(0.0)),
    Field("overlap", "depth of the deepest collision of two links with each other", LENGTH, (),
          Allowed(0.0)),
    Field("below_table", "how far the hand reaches below the table; `nan`: there is none", LENGTH,
          (), POSITIVE_OR_NAN),
    *(
        Field(name, meaning, unit, of=attrgetter(f"contacts.{name}"))
        for name, meaning, unit in (
            ("change", "largest change of a joint by the contact rule", RADIANS),
            ("shift", "by how much a free object moved", LENGTH),
            ("turn", "angle by which it turned", RADIANS),
        )
    ),
    *(
        Field(name, meaning, unit, (), allowed, of=of_part("motor_holding", name), when="load")
        for name, meaning, unit, allowed in (
            ("payload", ("mass that the motors hold at the nominal normals, with all links that "
             "touch; of given wrenches the factor; `inf`: any, `nan`: no grasp"), KILOGRAMS, HELD),
            ("payload_sure", "the same at the worst normals, with the links that feel theirs",
             KILOGRAMS, HELD),
            ("payload_possible", "at most that at the best normals that may be true", KILOGRAMS,
             HELD),
            ("load_fraction", "the mass over `payload_sure`; `nan`: it is not known", "", HELD),
            ("more_torque", ("by how much `payload_sure` grows at most with a tenth more of all "
             "torques"), KILOGRAMS, HELD),
            ("more_friction", "and about by how much with a tenth more of friction", KILOGRAMS,
             HELD),
        )
    ),
    replace(EPSILON, name="epsilon_hand", unit=NEWTONS, of=of_part("motor_holding", "epsilon"),
            when="load", meaning=r"$\varepsilon$ of what the motors press, at the nominal normals: "
            "radius of the ball of wrenches that they resist, torques divided by the torque scale"),
    replace(CRITICAL_ANGLE, name="critical_angle_hand", when="load", meaning="`critical_angle` of "
            "what the motors press, a bound from above; `nan`: no grasp", allowed=ANGLE_HAND),
    Field("limit", "what limits `payload_sure`: a joint, or friction", kind="U",
          of=of_part("motor_holding", "limit"), when="load"),
    replace(LABEL, name="label_with_force", when="load", meaning="the label with the load: S is "
            "what the motors surely hold, U what they surely do not. Absent where no mass is "
            "known"),
    Field("reachable", "whether the hand can be there: no joint beyond its limits, no link inside "
          "the object, another link or the table by more than the contact distance", kind="?"),
    Field("reason", "what is wrong with the grasp, in one sentence; empty: nothing", kind="U"),
)  # fmt: skip
"""Given poses of a hand with joints, with what its links touch."""
