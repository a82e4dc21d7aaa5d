"""Fields: values of each vertex or of each grasp, declared once for all files and tables.

This module declares those of grasps, also those that vertices share. Their meanings are in
docs/_ext/field_meanings.toml; the tables of the documentation are made from both.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import KW_ONLY, dataclass, replace
from enum import IntEnum
from functools import partial
from operator import attrgetter
from typing import Any, Literal, NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d.hand.closing import Closing
from grasp3d.stability.label import Label
from grasp3d.system.names import short_number

Array = npt.NDArray[Any]
Arrays = dict[str, Array]
When = Literal["always", "gripper", "load", "pose error"]

RADIANS, LENGTH, AREA, NEWTONS, KILOGRAMS = "rad", "m", "m²", "N", "kg"
XYZ = ("x", "y", "z")
LETTERS = tuple(label.name for label in sorted(Label))

NONE = "–"
"""Text for a value that is not finite: there is no grasp, or nothing is known."""


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
HELD = Allowed(0.0, infinite=math.inf, unknown=True)


@dataclass(frozen=True)
class Field:
    """A value of each vertex or each grasp that files and tables hold under one name."""

    name: str
    """Name of the array, and of the attribute in Python unless `of` takes another one."""
    unit: str = ""
    shape: tuple[int | str, ...] = ()
    """Shape for one vertex or grasp; 'n': number of fingers, 'n-1': number of other fingers."""
    allowed: Allowed = FINITE
    _: KW_ONLY
    of: Callable[[Any], Any] | None = None
    """Takes the values, or None, from labels or grasps; None: the attribute `name` has them."""
    kind: str = "f8"
    """NumPy type of the values, as NPZ, VTP and Parquet hold them."""
    when: When = "always"
    """When the field exists: always, or only with a gripper, a load, or an error of poses."""
    columns: tuple[str, ...] = ()
    """Names of its columns of plain numbers; empty: the name, with the axes as suffixes."""
    each: str = ""
    """Name of the values of one finger, with {} for its number; empty: not by finger."""
    ply: str = ""
    """Type at the vertices of a PLY, of 32 bits if it follows from others; empty: not in a PLY."""
    array: bool = True
    """Whether NPZ, VTP, `to_trimesh` and `to_polydata` have it."""
    table: bool = True
    """Whether Parquet and `to_table` have it."""
    texts: tuple[str, ...] = ()
    """Texts that tables have in place of the codes 0, 1, ...; empty: it has no codes."""
    outward: bool = False
    """Whether these are normals, which point into the object in Python, and outward in files."""
    heading: str = ""
    """Heading of its column in tables for people; empty: it has no column there."""
    listed: str = ""
    """Name in the list of one grasp's numbers; empty: its heading, if it has one."""
    meaning: str = ""
    """Meaning in the legend of such a table; empty: the heading is clear."""

    @property
    def worst(self) -> float:
        """Value that stands for no grasp: infinite for a force or an angle, else 0."""
        return math.inf if self.allowed.infinite == math.inf and self.unit != KILOGRAMS else 0.0

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

    def title(self, *, metres: bool) -> str:
        """Its heading, with its unit on a second line.

        Args:
            metres: Whether lengths are in metres, and so shown in millimetres.
        """
        unit = {RADIANS: "", LENGTH: "mm" if metres else ""}.get(self.unit, self.unit)
        return f"{self.heading}\n{unit}" if unit else self.heading

    def text(self, value: Any, *, metres: bool) -> str:
        """Format a value for people: without unit, angles in degrees, `NONE` if it is not finite.

        Args:
            value: Value of one row, as files hold it.
            metres: As in `title`.
        """
        if self.texts:
            return self.texts[int(value)]
        if self.kind == "U":
            return str(value)
        if not math.isfinite(value):
            return NONE
        if self.unit == RADIANS:
            return f"{math.degrees(value) + 0.0:.1f}°"  # never -0
        if self.unit == LENGTH:
            return short_number((1e3 if metres else 1.0) * value)
        return short_number(value) if self.unit else f"{value + 0.0:.3f}"

    def shape_for(self, fingers: int) -> tuple[int, ...]:
        """Shape of the values of one vertex or grasp."""
        sizes = {"n": fingers, "n-1": fingers - 1}
        return tuple(sizes[size] if isinstance(size, str) else size for size in self.shape)

    def column_names(self, fingers: int) -> list[str]:
        """Names of its columns of numbers, finger by finger."""
        parts = self.columns
        if not parts:
            head = self.each or self.name
            parts = tuple(f"{head}_{axis}" for axis in XYZ) if self.shape[-1:] == (3,) else (head,)
        numbers = range(2, fingers + 1) if self.each else range(1)
        return [part.format(finger) for finger in numbers for part in parts]

    def point_names(self, fingers: int) -> list[str]:
        """Names of its arrays in VTK, which has vectors at most."""
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
        """Join columns of numbers to values again. Raises KeyError."""
        values = np.stack([columns[name] for name in self.column_names(fingers)], axis=1)
        return values.reshape(len(values), *self.shape_for(fingers))

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
"""Types of numbers in a PLY: of those that follow from others, and of those that are read back."""


def of_part(part: str, name: str) -> Callable[[Any], Array | None]:
    """Make a function that takes values from a part of labels or grasps; None if it is missing."""

    def values(holder: Any) -> Array | None:
        owner = getattr(holder, part)
        return None if owner is None else getattr(owner, name)

    return values


def names_of(codes: type[IntEnum]) -> tuple[str, ...]:
    """Texts of codes 0, 1, ..."""
    return tuple(code.name.lower() for code in sorted(codes))


def _payload(holder: Any) -> Array | None:
    load_result = holder.load_result
    return load_result.payload if load_result is not None and load_result.has_payload else None


LABEL = Field("label", kind="u1", ply="u1", texts=LETTERS, heading="label")
CRITICAL_ANGLE = Field(
    "critical_angle", RADIANS, (), ANGLE_OR_INF, ply=DOUBLE, heading="β*",
    meaning="critical friction angle",
)  # fmt: skip
CRITICAL_ANGLE_BEST = replace(
    CRITICAL_ANGLE, name="critical_angle_best", heading="", listed="β* of the best normals"
)
MAX_RESOLUTION = Field(
    "max_resolution", RADIANS, (), ANGLE, ply=FLOAT, heading="α*",
    meaning="coarsest resolution at which the grasp is S",
)  # fmt: skip
MARGIN = Field("margin", RADIANS, (), Allowed(infinite=-math.inf), ply=FLOAT, listed="margin")
EPSILON = Field("epsilon", "", (), POSITIVE_OR_NAN, ply=DOUBLE, heading="ε")
ANGLES = (CRITICAL_ANGLE, CRITICAL_ANGLE_BEST, MAX_RESOLUTION, MARGIN)
DECIDED = (LABEL, *ANGLES)
EPSILONS = (
    EPSILON,
    replace(EPSILON, name="epsilon_min", heading="ε_min", meaning="ε at the worst normals"),
    replace(EPSILON, name="epsilon_max", heading="", listed="ε_max"),
)
OPENING = Field("opening", LENGTH, (), POSITIVE_OR_NAN, ply=FLOAT, heading="opening")
APPROACH_MARGIN = Field(
    "approach_margin", RADIANS, (), ANGLE_OR_NAN, of=of_part("reach", "approach_margin"),
    when="gripper", ply=DOUBLE, listed="approach margin",
)  # fmt: skip
DEPTH = Field(
    "depth", LENGTH, (), KNOWN_OR_NAN, of=of_part("reach", "depth"), when="gripper", ply=DOUBLE,
    listed="inserted depth",
)  # fmt: skip
_of_load = partial(of_part, "load_result")
GRIP_FORCE = Field(
    "grip_force", NEWTONS, (), HELD, of=_of_load("grip_force"), when="load", ply=DOUBLE,
    listed="force at the nominal normals",
)  # fmt: skip
FORCE = "grip force that holds the load at the worst normals"
PAYLOAD = "mass that the available force holds there"
LOAD_NUMBERS = (
    GRIP_FORCE,
    replace(GRIP_FORCE, name="grip_force_least", of=_of_load("grip_force_least"), listed=""),
    replace(
        GRIP_FORCE,
        name="grip_force_largest",
        of=_of_load("grip_force_largest"),
        heading="force",
        meaning=FORCE,
        listed="force at the worst normals",
    ),
    replace(
        GRIP_FORCE,
        name="payload",
        of=_payload,
        listed="",
        unit=KILOGRAMS,
        heading="payload",
        meaning=PAYLOAD,
    ),
)
FORCES = (*LOAD_NUMBERS, replace(LABEL, name="label_with_force", of=_of_load("label"), when="load"))
"""Fields that a load adds to grasps."""

SCORE = Field(
    "score", "", (), Allowed(0.0, 1.0), heading="score", meaning="U below 1/3, S above 2/3"
)
"""The one number by which grasps are sorted."""

STATED_LABEL = replace(LABEL, of=attrgetter("letter"))
"""The label that takes everything stated into account."""

GRASPS = (
    Field("grasp", of=lambda one: range(1, one.size + 1), kind="i8"),
    STATED_LABEL,
    SCORE,
    *ANGLES,
    *EPSILONS,
    Field("rank", kind="i8"),
    OPENING,
    replace(OPENING, name="separation", heading=""),
    *LOAD_NUMBERS,
)
"""Fields of grasps in tables."""

OF_ONE = (*GRASPS, APPROACH_MARGIN, DEPTH)
"""Fields that are listed for one grasp."""

CONTACTS = (
    Field("point", LENGTH, ("n", 3), columns=XYZ, of=attrgetter("contacts.points")),
    Field("normal", "", ("n", 3), columns=("nx", "ny", "nz"), outward=True,
          of=attrgetter("contacts.normals")),
    Field("distance", LENGTH, ("n",)),
    Field("on_crease", "", ("n",), kind="?", of=attrgetter("contacts.on_crease")),
)  # fmt: skip
"""Fields of the contacts of grasps in tables."""


def _closing_share(holder: Any) -> Array | None:
    """Fraction of the tried poses at which jaws close; None: no pose error is stated."""
    return np.asarray(holder.robustness.closing_share) if holder.robustness.tried > 1 else None


CLOSING_SHARE = Field(
    "closing_share", "", (), Allowed(0.0, 1.0), of=_closing_share, when="pose error"
)
"""Fraction of slightly wrong poses at which jaws close."""


def _jaw(name: str, number: int) -> Callable[[Any], Array]:
    """Make a function that takes values at one of the jaws."""
    return lambda poses: np.asarray(getattr(poses.jaws, name)[:, number])


def under_load(name: str) -> Callable[[Any], Array | None]:
    """Make a function that takes a number of poses; None if there is no load."""
    return lambda poses: None if poses.load is None else np.asarray(getattr(poses, name))


REASON = Field("reason", kind="U", heading="reason")
CLOSING = Field("closing", of=attrgetter("state"), kind="u1", texts=names_of(Closing))


def given_poses(fingers: int = 2) -> tuple[Field, ...]:
    """Fields of evaluated poses of a hand with some number of fingers."""
    numbers = range(fingers)
    return (
        CLOSING,
        STATED_LABEL,
        SCORE,
        *(field for field in ANGLES if field is not CRITICAL_ANGLE_BEST),
        *EPSILONS,
        replace(APPROACH_MARGIN, of=None, when="always", ply=""),
        Field("grip_force", NEWTONS, (), HELD, of=under_load("grip_force"), when="load",
              heading="force", meaning=FORCE),
        Field("payload", KILOGRAMS, (), HELD, of=under_load("payload"), when="load",
              heading="payload", meaning=PAYLOAD),
        Field("collides", kind="?"),
        Field("reachable", kind="?"),
        REASON,
        *(Field(f"area{number + 1}", AREA, of=_jaw("area", number)) for number in numbers),
        Field("turn", RADIANS, of=attrgetter("jaws.turn")),
        Field("shift", LENGTH, of=attrgetter("jaws.shift")),
        CLOSING_SHARE,
    )  # fmt: skip


HAND_GRASPS = (
    CLOSING,
    STATED_LABEL,
    SCORE,
    replace(CRITICAL_ANGLE, allowed=Allowed(0.0, math.pi, math.inf, unknown=True)),
    MAX_RESOLUTION,
    replace(MARGIN, allowed=Allowed(infinite=-math.inf, unknown=True)),
    EPSILON,
    Field("rank", kind="i8"),
    Field("links", kind="U", listed="links"),
    Field("gap", LENGTH, (), POSITIVE_OR_NAN, heading="gap",
          meaning="largest one of a link that touches"),
    Field("penetration", LENGTH, (), Allowed(0.0), heading="depth",
          meaning="deepest penetration of a link"),
    Field("overlap", LENGTH, (), Allowed(0.0)),
    Field("below_table", LENGTH, (), POSITIVE_OR_NAN),
    *(
        Field(name, unit, (), HELD, of=of_part("motors", name), when="load",
              heading=heading, meaning=meaning)
        for name, unit, heading, meaning in (
            ("payload", KILOGRAMS, "payload", "what the motors hold at the worst normals"),
            ("load_fraction", "", "load", "the mass divided by that"),
        )
    ),
    Field("limit", kind="U", of=of_part("motors", "limit"), when="load",
          heading="limit", meaning="what limits what is surely held"),
    Field("reachable", kind="?"),
    REASON,
)  # fmt: skip
"""Fields of evaluated poses of a hand with joints, with what its links touch."""
