"""Colours of a surface: codes of its labels, or numbers and the colour table that they index.

Colours are not blended between vertices: a point of a face has the label of the nearest corner, or
the colour of the interpolated number.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from matplotlib import colormaps

from grasp3d.arrays import Bytes, Floats
from grasp3d.describe.explanations import UNSEARCHED
from grasp3d.pictures.subject import Subject
from grasp3d.pictures.view_settings import Paint
from grasp3d.settings import ANGLE_ROUNDING, GraspModel
from grasp3d.settings.grasp_model import EPSILON_MIN, epsilon_min_text
from grasp3d.stability.label import COLORS, GREY, Label, hex_color, label_angles
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.sweeps import quantiles
from grasp3d.system.names import short_number

PALETTE = np.array([*(COLORS[label] for label in sorted(Label)), GREY], dtype=np.uint8)
"""The last colour is for unknown values (no grasp, or not searched), and for excluded faces."""

HEX_PALETTE = [hex_color(color) for color in PALETTE]

STEPS = 256
"""Number of colours of a ramp."""

RAMP = np.array(colormaps["viridis"](np.linspace(0.0, 1.0, STEPS))[:, :3] * 255.0, dtype=np.uint8)
"""Colours of a ramp, from the lowest value to the highest, shape (STEPS, 3); no grey occurs."""

_SIDES = np.concatenate([np.linspace(0.0, 0.4, STEPS // 2), np.linspace(0.6, 1.0, STEPS // 2)])
BOTH_SIDES = np.array(colormaps["BrBG"](_SIDES)[:, :3] * 255.0, dtype=np.uint8)
"""Colours of values on both sides of 0, brown below and green above, shape (STEPS, 3).

They jump at 0, so that the border is sharp and no grey occurs.
"""

NEUTRAL = (0xE9, 0xE3, 0xD6)
"""Colour of an object without labels, unlike the greys of hands."""

PALE, PALE_FRACTION = (0xDD, 0xE0, 0xE4), 0.7
"""Colour that is mixed into the colours of an outdated surface, and its fraction."""

ROUNDING = 1e-9
"""Relative rounding error of values."""

MOST = 0.95
"""Fraction of the area with finite values up to which the ramps of forces and payloads extend: a
few vertices near the centre of mass, or far from it, would hide the others."""

EQUAL_GRASPS = "where several grasps have the same β*, ε is that of one of them, so it can jump"


@dataclass(frozen=True)
class Quantity:
    """Quantity that colours can show instead of the labels."""

    listed: str
    """Name in lists."""
    title: Callable[[Subject], str]
    """Function that returns the name in a legend."""
    values: Callable[[SurfaceLabels], Floats | None]
    """Function that returns the value at each vertex, shape (V,), in the unit; not finite: none."""
    most: Callable[[Subject, Floats], float]
    """Function that returns the value of the last colour."""
    unit: str = "°"
    grey: str = ""
    """Meaning of grey; empty: there is no grasp."""
    note: str = ""
    """Remark for the reader."""
    needs: str = ""
    """Attribute of the labels that must be computed for it: epsilon_range, or load_result."""
    problem: Callable[[Subject], str] | None = None
    """Function that says why a surface has no values, or ''; None: every surface has values."""

    def problem_of(self, subject: Subject) -> str:
        """Reason why a surface has no values; empty if it has."""
        return self.problem(subject) if self.problem else ""

    def missing(self, labels: SurfaceLabels) -> bool:
        """Whether it has not been computed yet."""
        return bool(self.needs) and labels.computed(self.needs) is None


@dataclass(frozen=True)
class Ramp:
    """Legend of a quantity."""

    text: str
    """Name of the quantity."""
    maximum: float
    """Value of the last colour."""
    unit: str
    grey: str = ""
    """Meaning of grey; empty: grey does not occur."""
    note: str = ""
    """Remark for the reader."""
    exceeded: bool = False
    """Whether larger values also have the last colour."""
    minimum: float = 0.0
    """Value of the first colour; lower values also have it."""

    @property
    def colors(self) -> Bytes:
        """The colours, shape (STEPS, 3)."""
        return BOTH_SIDES if self.minimum < 0.0 else RAMP

    @property
    def start(self) -> str:
        """Value of the first colour, as text."""
        least = f"≤ −{short_number(-self.minimum)}" if self.minimum < 0.0 else "0"
        return f"{least}{self.unit}"

    @property
    def end(self) -> str:
        """Value of the last colour, as text."""
        return f"{'≥ ' if self.exceeded else ''}{short_number(self.maximum)}{self.unit}"


def corner_codes(subject: Subject) -> Bytes:
    """Codes of the labels at the corners of a surface, shape (C,)."""
    return labels_at(subject)[subject.mesh.corner_normals.vertices]


def corner_values(subject: Subject, paint: Paint) -> Floats:
    """Values of a quantity at the corners of a surface, shape (C,); nan where unknown.

    Args:
        subject: The surface.
        paint: A key of `QUANTITIES`.
    """
    values = _values(subject, paint)[subject.mesh.corner_normals.vertices]
    return np.where(np.isfinite(values), values, math.nan)


def labels_at(subject: Subject) -> Bytes:
    """Label every vertex; `UNSEARCHED` where `relabel` would raise an error.

    Returns:
        Codes, shape (V,).
    """
    labels = subject.labels
    return label_codes(subject, labels.critical_angle, labels.critical_angle_best)


def label_codes(subject: Subject, worst: Floats, best: Floats) -> Bytes:
    """Label given critical angles of a subject, or bounds on them for uncertain locations.

    Beyond the searched cone the search may have missed a better grasp. There U is unknown, and M is
    unknown if the missed grasp could be S.

    Args:
        subject: The surface, with the cone that was searched.
        worst: Critical angles over the worst normals [rad], any shape.
        best: Critical angles over the best normals [rad], same shape.
    """
    model = subject.model
    codes = label_angles(worst, best, model)
    if not subject.covers(model):
        stable, searched = model.sure_angle, subject.cone + ANGLE_ROUNDING
        hidden = (codes == Label.M) & (worst > searched) & (stable > searched)
        codes[(codes == Label.U) | hidden] = UNSEARCHED
    return codes


def area_fractions(subject: Subject, codes: Bytes) -> Floats:
    """Area fraction of each code, shape (4,)."""
    fractions = np.bincount(codes, subject.weights, minlength=len(PALETTE))
    return np.asarray(fractions, dtype=np.float64)


def faded(colors: Bytes) -> Bytes:
    """Pale version of colours (n, 3), for an outdated surface."""
    mixed = (1.0 - PALE_FRACTION) * colors + PALE_FRACTION * np.array(PALE)
    return np.asarray(np.rint(mixed), dtype=np.uint8)


def ramp_of(subject: Subject, paint: Paint) -> Ramp | None:
    """Legend of the displayed quantity; None if labels are displayed."""
    if subject.poses is not None or paint == "label":
        return None
    shown, labels = QUANTITIES[paint], subject.labels
    title, unit = shown.title(subject), shown.unit
    if problem := shown.problem_of(subject):
        return Ramp(f"{shown.listed}: {problem.partition(';')[0]}", 1.0, unit, "not known")
    if shown.missing(labels):
        return Ramp(title, 1.0, unit, "not computed yet", shown.note)
    values, weighed = _values(subject, paint), subject.weights > 0.0
    finite = np.isfinite(values) & weighed
    most = shown.most(subject, values) or 1.0
    none = shown.grey or ("no grasp found" if labels.mode == "label" else "no grasp")
    meanings = [none] * bool((weighed & ~np.isfinite(labels.critical_angle)).any())
    if shown.grey:
        meanings = [none] * bool((weighed & ~finite).any())
    elif shown.needs == LOAD and np.isinf(values[weighed]).any():
        meanings.append("no force suffices")
    return Ramp(
        title, most, unit, ", ".join(meanings), shown.note,
        exceeded=bool((values[finite] > most * (1.0 + ROUNDING)).any()),
        minimum=-most if paint == "margin" else 0.0,
    )  # fmt: skip


def _values(subject: Subject, paint: Paint) -> Floats:
    """Values of a quantity at each vertex, shape (V,); nan where unknown."""
    labels, shown = subject.labels, QUANTITIES[paint]
    values = None if shown.missing(labels) else shown.values(labels)
    return np.full(labels.size, math.nan) if values is None else values


def _sharp(model: GraspModel) -> float:
    """Critical angle below which a grasp is S with a perfect sensor [rad]."""
    return model.sure_angle + model.sensor_resolution / 2.0


def _resolution_range(subject: Subject, _: Floats) -> float:
    # If no grasp can be S, the scale is that of exact friction and normals.
    sharp = _sharp(subject.model)
    return 2.0 * math.degrees(sharp if sharp > 0.0 else subject.model.friction_angle)


def _largest(_: Subject, values: Floats) -> float:
    return float(np.nanmax(values, initial=0.0))


def _most_of_area(subject: Subject, values: Floats) -> float:
    """Largest value of a quantity on most of the area."""
    vertices = np.flatnonzero(np.isfinite(values) & (subject.weights > 0.0))
    if not len(vertices):
        return 1.0
    [top] = quantiles(values[vertices], [MOST], subject.weights[vertices])
    return float(top) or float(values[vertices].max())


def _gripper_problem(subject: Subject) -> str:
    labels = subject.labels
    if labels.mode == "scan":
        return "with fixed fingers the gripper is not tested"
    if labels.scene is None:
        return "there is no gripper; open the object with one (--hand)"
    if labels.approach_margin is None or labels.model.fingers not in labels.scene.hand.fingers:
        return "it is of grasps of the gripper's own fingers only"
    return ""


def _load_problem(subject: Subject) -> str:
    if subject.labels.load_case is not None:
        return ""
    if subject.labels.mode == "scan":
        return "with fixed fingers no grip forces are computed"
    return "there is no load; open the object with one (--mass, --density or --grip-force)"


def _payload_problem(subject: Subject) -> str:
    case = subject.labels.load_case
    if case is None:
        return _load_problem(subject)
    if case.available is None:
        return (
            "the available force is not known; open the object with one (--grip-force, or a "
            "gripper that states its force)"
        )
    return "" if case.by_mass else "the task does not depend on the mass, so there is no payload"


def _force_title(subject: Subject) -> str:
    case = subject.labels.load_case
    return f"grip force of each contact for {case.to_hold.partition(' (')[0]}" if case else ""


def _payload_title(subject: Subject) -> str:
    case = subject.labels.load_case
    return f"payload of the contacts with {case.force_text} at the worst normals" if case else ""


EPSILON, LOAD = "epsilon_range", "load_result"
QUANTITIES: dict[Paint, Quantity] = {
    "critical_angle": Quantity(
        "β*, critical friction angle",
        lambda _: "β*: critical friction angle",
        lambda labels: np.degrees(labels.critical_angle),
        lambda subject, _: math.degrees(min(subject.cone, math.pi / 2.0)),
    ),
    "max_resolution": Quantity(
        "α*, coarsest resolution at which it is S",
        lambda _: "α*: coarsest resolution at which it is S",
        lambda labels: np.degrees(2.0 * (_sharp(labels.model) - labels.critical_angle)),
        _resolution_range,
    ),
    "epsilon": Quantity(
        "ε",
        lambda _: "ε of the grasp with the smallest β*",
        lambda labels: labels.epsilon,
        _largest,
        "", note=EQUAL_GRASPS, needs=EPSILON,
    ),
    "epsilon_min": Quantity(
        f"{EPSILON_MIN}, over all uncertainties",
        lambda subject: epsilon_min_text(subject.model),
        lambda labels: labels.epsilon_min,
        lambda subject, _: _largest(subject, subject.labels.epsilon),
        "", note=EQUAL_GRASPS, needs=EPSILON,
    ),
    "approach_margin": Quantity(
        "approach margin of the gripper",
        lambda _: "approach margin: half the free approach angles",
        lambda labels: None if labels.reach is None else np.degrees(labels.reach.approach_margin),
        _largest,
        grey="not reached", problem=_gripper_problem,
    ),
    "grip_force": Quantity(
        "grip force of each contact", _force_title, lambda labels: labels.grip_force,
        _most_of_area, " N", needs=LOAD, problem=_load_problem,
    ),
    "payload": Quantity(
        "payload of the contacts", _payload_title, lambda labels: labels.payload,
        _most_of_area, " kg", needs=LOAD, problem=_payload_problem,
    ),
    "margin": Quantity(
        "margin: how far it is S, or fails to be",
        lambda _: "margin: S above 0°",
        lambda labels: np.degrees(labels.margin),
        lambda subject, _: math.degrees(subject.model.friction_angle),
        note="green: by how much it is S; brown: by how much it fails to be S",
    ),
}  # fmt: skip
"""The quantities by name, as in `ViewSettings.paint`."""

PAINTS: dict[Paint, str] = {
    "label": "S, M, U of the contacts",
    **{name: one.listed for name, one in QUANTITIES.items()},
}
"""Names in lists of everything that colours can show."""
