"""Colours of a surface: the codes of its labels, or numbers and the table that they index.

Colours are not mixed between vertices: a point of a face has the label of the nearest corner, or
the colour of the interpolated number.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from matplotlib import colormaps

from grasp3d.arrays import Bytes, Floats
from grasp3d.describe.explanations import UNSEARCHED
from grasp3d.pictures.subject import Subject
from grasp3d.pictures.view_settings import Paint
from grasp3d.settings import GraspModel
from grasp3d.settings.model_text import EPSILON_MIN, epsilon_min_text
from grasp3d.stability.label import COLORS, GREY, Label
from grasp3d.stability.thresholds import label_angles
from grasp3d.system.counts import short_number

PALETTE = np.array([*(COLORS[label] for label in sorted(Label)), GREY], dtype=np.uint8)
"""The last colour is that of unknown values: no grasp, or not searched; and of excluded faces."""

HEX_PALETTE = ["#{:02X}{:02X}{:02X}".format(*color) for color in PALETTE]

STEPS = 256
"""Number of colours of a ramp."""

RAMP = np.array(colormaps["viridis"](np.linspace(0.0, 1.0, STEPS))[:, :3] * 255.0, dtype=np.uint8)
"""Colours of a ramp, from the lowest value to the highest, shape (STEPS, 3); none is grey."""

_SIDES = np.concatenate([np.linspace(0.0, 0.4, STEPS // 2), np.linspace(0.6, 1.0, STEPS // 2)])
BOTH_SIDES = np.array(colormaps["BrBG"](_SIDES)[:, :3] * 255.0, dtype=np.uint8)
"""Colours of values on both sides of 0, brown below and green above, shape (STEPS, 3).

They jump at 0, so that the border is sharp and none is grey.
"""

NEUTRAL = (0xE9, 0xE3, 0xD6)
"""Colour of an object whose surface is not labelled, unlike the greys of hands."""

PALE, PALE_FRACTION = (0xDD, 0xE0, 0xE4), 0.7
"""Colour and fraction that are mixed into the colours of an outdated surface."""

ROUNDING = 1e-9
"""Tolerance of the comparison with the searched cone [rad]."""

MOST = 0.95
"""Area fraction, of that with finite values, up to which the ramps of forces and payloads go: a few
vertices near the centre of mass, or far from it, would hide the others."""

EQUAL_GRASPS = "where several grasps have the same β*, ε is that of one of them, so it can jump"


@dataclass(frozen=True)
class Quantity:
    """What colours can show beside the labels."""

    listed: str
    """Its name, as it is listed."""
    title: Callable[[Subject, GraspModel], str]
    """Its name in a legend."""
    values: Callable[[Subject, GraspModel], Floats]
    """At each vertex, shape (V,), in the unit; not finite: there is none."""
    most: Callable[[Subject, GraspModel, Floats], float]
    """The value of the last colour."""
    unit: str = "°"
    grey: str = ""
    """Meaning of grey; empty: that there is no grasp."""
    note: str = ""
    """Remark for the reader."""
    source: str = ""
    """The field of the subject that must be computed for it: epsilons, or forces."""
    problem: Callable[[Subject], str] | None = None
    """Why a surface has none, empty: it has; None: every one has it."""

    def problem_of(self, subject: Subject) -> str:
        """Why a surface has none; empty: it has."""
        return self.problem(subject) if self.problem else ""


@dataclass(frozen=True)
class Ramp:
    """Legend of a quantity."""

    text: str
    """Its name."""
    maximum: float
    """Value of the last colour."""
    unit: str
    grey: str = ""
    """Meaning of grey; empty: grey does not occur."""
    note: str = ""
    """Remark for the reader."""
    exceeded: bool = False
    """Whether larger values have the last colour, too."""
    minimum: float = 0.0
    """Value of the first colour; lower values have it, too."""

    @property
    def colors(self) -> Bytes:
        """The colours, shape (STEPS, 3)."""
        return BOTH_SIDES if self.minimum < 0.0 else RAMP

    @property
    def start(self) -> str:
        """The value of the first colour as text."""
        least = f"≤ −{short_number(-self.minimum)}" if self.minimum < 0.0 else "0"
        return f"{least}{self.unit}"

    @property
    def end(self) -> str:
        """The value of the last colour as text."""
        return f"{'≥ ' if self.exceeded else ''}{short_number(self.maximum)}{self.unit}"


def corner_codes(subject: Subject, model: GraspModel) -> Bytes:
    """Codes of the labels at the corners of a surface, shape (C,).

    Args:
        subject: The surface.
        model: Friction and resolution.
    """
    labels, vertices = subject.labels, subject.mesh.corner_normals.vertices
    worst, best = labels.critical_angle[vertices], labels.critical_angle_best[vertices]
    if labels.mode == "scan":  # a crease has no area: each face beside it has its own normal's
        rows, of_worst, of_best = subject.crease_angles
        worst[rows], best[rows] = of_worst, of_best
    return label_codes(subject, worst, best, model)


def corner_values(subject: Subject, paint: Paint, model: GraspModel) -> Floats:
    """Values of a quantity at the corners of a surface, shape (C,); nan where it is not known.

    Args:
        subject: The surface.
        paint: One of `QUANTITIES`.
        model: Friction and resolution.
    """
    values = _values(subject, paint, model)[subject.mesh.corner_normals.vertices]
    return np.where(np.isfinite(values), values, math.nan)


def labels_at(subject: Subject, model: GraspModel) -> Bytes:
    """Label every vertex; `UNSEARCHED` where `relabel` would raise an error.

    Returns:
        Codes, shape (V,).
    """
    labels = subject.labels
    return label_codes(subject, labels.critical_angle, labels.critical_angle_best, model)


def label_codes(subject: Subject, worst: Floats, best: Floats, model: GraspModel) -> Bytes:
    """Label given critical angles of a subject, their bounds if contact locations are uncertain.

    Beyond the searched cone the search may have missed a better grasp: U is then unknown, and so
    is M if the missed grasp could be S.

    Args:
        subject: The surface, with the cone that was searched.
        worst: Critical angles over the worst normals [rad], any shape.
        best: Critical angles over the best normals [rad], same shape.
        model: Friction and resolution.
    """
    codes = label_angles(worst, best, model)
    if not subject.covers(model):
        stable, searched = model.sure_angle, subject.cone + ROUNDING
        hidden = (codes == Label.M) & (worst > searched) & (stable > searched)
        codes[(codes == Label.U) | hidden] = UNSEARCHED
    return codes


def area_fractions(subject: Subject, codes: Bytes) -> Floats:
    """Area fraction of each code, shape (4,)."""
    fractions = np.bincount(codes, subject.weights, minlength=len(PALETTE))
    return np.asarray(fractions, dtype=np.float64)


def faded(colors: Bytes) -> Bytes:
    """Pale version of colours (n, 3), for a surface that is outdated."""
    mixed = (1.0 - PALE_FRACTION) * colors + PALE_FRACTION * np.array(PALE)
    return np.asarray(np.rint(mixed), dtype=np.uint8)


def ramp_of(subject: Subject, paint: Paint, model: GraspModel) -> Ramp | None:
    """Legend of the quantity that is shown; None: labels."""
    if subject.poses is not None or paint == "label":
        return None
    shown = QUANTITIES[paint]
    title, unit = shown.title(subject, model), shown.unit
    if problem := shown.problem_of(subject):
        return Ramp(f"{shown.listed}: {problem.partition(';')[0]}", 1.0, unit, "not known")
    if shown.source:
        known = getattr(subject, shown.source)
        if known is None:
            text = f"{title}; being computed"
            return Ramp(text, 1.0, unit, "not computed yet", shown.note)
        if not same_settings(known.model, model):
            degrees = math.degrees(known.model.sensor_resolution)
            title += f", for μ {known.model.friction:.3g}, α {degrees:.1f}°; being computed"
    values, weighed = _values(subject, paint, model), subject.weights > 0.0
    finite = np.isfinite(values) & weighed
    most = shown.most(subject, model, values) or 1.0
    none = shown.grey or ("no grasp found" if subject.labels.mode == "label" else "no grasp")
    meanings = [none] * bool((weighed & ~np.isfinite(subject.labels.critical_angle)).any())
    if shown.grey:
        meanings = [none] * bool((weighed & ~finite).any())
    elif shown.source == "forces" and np.isinf(values[weighed]).any():
        meanings.append("no force suffices")
    return Ramp(
        title, most, unit, ", ".join(meanings), shown.note,
        exceeded=bool((values[finite] > most * (1.0 + ROUNDING)).any()),
        minimum=-most if paint == "margin" else 0.0,
    )  # fmt: skip


def _values(subject: Subject, paint: Paint, model: GraspModel) -> Floats:
    """Values of a quantity at each vertex, shape (V,); nan where it is not known."""
    return QUANTITIES[paint].values(subject, model)


def same_settings(computed: GraspModel, model: GraspModel) -> bool:
    """Whether epsilon computed for one model is valid for another; fingers are ignored."""
    return replace(computed, fingers=model.fingers) == model


def _sharp(model: GraspModel) -> float:
    """Critical angle below which a grasp is S with a sensor that resolves everything [rad]."""
    return model.sure_angle + model.sensor_resolution / 2.0


def _resolution_range(_: Subject, model: GraspModel, __: Floats) -> float:
    # Without friction to spare none is S; then the scale is that of exact friction and normals.
    most = _sharp(model) if _sharp(model) > 0.0 else model.friction_angle
    return 2.0 * math.degrees(most)


def _largest(_: Subject, __: GraspModel, values: Floats) -> float:
    return float(np.nanmax(values, initial=0.0))


def _most_of_area(subject: Subject, _: GraspModel, values: Floats) -> float:
    """Value up to which most of the area goes."""
    vertices = np.flatnonzero(np.isfinite(values) & (subject.weights > 0.0))
    if not len(vertices):
        return 1.0
    order = vertices[np.argsort(values[vertices])]
    areas = np.cumsum(subject.weights[order])
    top = float(values[order[np.searchsorted(areas, MOST * areas[-1])]])
    return top or float(values[vertices].max())


def _gripper_problem(subject: Subject) -> str:
    labels = subject.labels
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
            "the force at hand is not known; open the object with one (--grip-force, or a "
            "gripper that states its force)"
        )
    return "" if case.by_mass else "the task does not depend on the mass, so there is no payload"


def _force_title(subject: Subject, _: GraspModel) -> str:
    case = subject.labels.load_case
    return f"grip force of each contact for {case.to_hold.partition(' (')[0]}" if case else ""


def _payload_title(subject: Subject, _: GraspModel) -> str:
    case = subject.labels.load_case
    return f"payload of the contacts with {case.at_hand} at the worst normals" if case else ""


def _computed(source: str, name: str) -> Callable[[Subject, GraspModel], Floats]:
    """Values of such a name of what was computed of a subject."""
    return lambda subject, _: subject.numbers(source, name)


QUANTITIES: dict[Paint, Quantity] = {
    "critical_angle": Quantity(
        "β*, critical friction angle",
        lambda *_: "β*: critical friction angle",
        lambda subject, _: np.degrees(subject.labels.critical_angle),
        lambda subject, *_: math.degrees(min(subject.cone, math.pi / 2.0)),
    ),
    "max_resolution": Quantity(
        "α*, coarsest resolution at which it is S",
        lambda *_: "α*: coarsest resolution at which it is S",
        lambda subject, model: np.degrees(2.0 * (_sharp(model) - subject.labels.critical_angle)),
        _resolution_range,
    ),
    "epsilon": Quantity(
        "ε",
        lambda *_: "ε of the grasp with the smallest β*",
        _computed("epsilons", "epsilon"),
        _largest,
        "", note=EQUAL_GRASPS, source="epsilons",
    ),
    "epsilon_min": Quantity(
        f"{EPSILON_MIN}, over all uncertainties",
        lambda subject, _: epsilon_min_text((subject.epsilons or subject.labels).model),
        _computed("epsilons", "epsilon_min"),
        lambda subject, model, _: _largest(subject, model, subject.numbers("epsilons", "epsilon")),
        "", note=EQUAL_GRASPS, source="epsilons",
    ),
    "approach_margin": Quantity(
        "approach margin of the gripper",
        lambda *_: "approach margin: half the free approach angles",
        lambda subject, _: np.degrees(subject.numbers("labels", "approach_margin")),
        _largest,
        grey="not reached", problem=_gripper_problem,
    ),
    "grip_force": Quantity(
        "grip force of each contact", _force_title, _computed("forces", "grip_force"),
        _most_of_area, " N", source="forces", problem=_load_problem,
    ),
    "payload": Quantity(
        "payload of the contacts", _payload_title, _computed("forces", "payload"),
        _most_of_area, " kg", source="forces", problem=_payload_problem,
    ),
    "margin": Quantity(
        "margin: how far it is S, or fails to be",
        lambda *_: "margin: S above 0°",
        lambda subject, model: np.degrees(model.sure_angle - subject.labels.critical_angle),
        lambda _, model, __: math.degrees(model.friction_angle),
        note="green: by how much it is S; brown: by how much it fails to be S",
    ),
}  # fmt: skip
"""The quantities by name: `ViewSettings.paint`."""

PAINTS: dict[Paint, str] = {
    "label": "S, M, U of the contacts",
    **{name: one.listed for name, one in QUANTITIES.items()},
}
"""What colours can show, as it is listed."""
