"""Colours of a surface: a texture image, and the texture coordinates of the vertices.

Critical angles, not colours, are interpolated between the vertices of a face, so that the borders
between S, M and U are as sharp as the labels; a slider changes only the texture image.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from matplotlib import colormaps

from grasp3d.arrays import Bytes, Floats
from grasp3d.grasps.explanations import UNSEARCHED
from grasp3d.settings import GraspModel
from grasp3d.settings.model_text import epsilon_min_text
from grasp3d.stability.label import COLORS, GREY, Label
from grasp3d.stability.thresholds import label_angles
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.load_case import LoadCase
from grasp3d.system.counts import short_number
from grasp3d.viewer.subjects.subject import Subject
from grasp3d.viewer.view_settings import Paint

FORCE_PAINTS = frozenset({"grip_force", "payload"})
"""Colours that only a load gives."""

MOST = 0.95
"""Area fraction, of that with finite values, up to which the ramps of forces and payloads go: a few
vertices near the centre of mass, or far from it, would hide the others."""

PALETTE = np.array([*(COLORS[label] for label in sorted(Label)), GREY], dtype=np.uint8)
"""The last colour is that of unknown values: no grasp, or not searched; and of excluded faces."""

HEX_PALETTE = ["#{:02X}{:02X}{:02X}".format(*color) for color in PALETTE]

WIDE = 4096
"""Width of the texture image of a ramp [pixels], for −180 to 180 degrees or the largest epsilon."""

HALF = 0.5 + 1e-7
"""Texture coordinate of an angle exactly at a limit; above 0.5, so that rounding cannot put it
below the limit."""

ROUNDING = 1e-9
"""Tolerance of the comparison with the searched cone [rad]."""

EQUAL_GRASPS = "where several grasps have the same β*, ε is that of one of them, so it can jump"

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


@dataclass(frozen=True, eq=False)
class Ramp:
    """Legend of a continuous quantity."""

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


def texture_coordinates(
    subject: Subject, paint: Paint, model: GraspModel
) -> npt.NDArray[np.float32]:
    """Texture coordinates of each vertex, from 0 to 1, shape (V, 2).

    For labels they are relative to the two limits, which both lie exactly in the middle of the
    image and move with the sliders. For numbers they do not depend on the model, except for its
    location error.

    Args:
        subject: The surface.
        paint: The quantity that is shown.
        model: Friction and resolution.
    """
    worst, best = subject.labels.critical_angle, subject.labels.critical_angle_best
    if paint == "critical_angle":
        worst = subject.labels.critical_angle
    if paint == "label":
        return _label_coordinates(worst, best, model)
    values = np.clip(worst, -math.pi, math.pi) / (2.0 * math.pi) + 0.5
    finite = np.isfinite(worst)
    if paint in _SOURCES:
        numbers = _numbers(subject, paint)
        finite = np.isfinite(numbers)
        values = np.minimum(np.where(finite, numbers, 0.0) / _most(subject, paint), 1.0)
    return np.stack([values, np.where(finite, 0.25, 0.75)], axis=1).astype(np.float32)


def corner_coordinates(
    subject: Subject, paint: Paint, model: GraspModel
) -> npt.NDArray[np.float32]:
    """Texture coordinates of each normal of the mesh's corners, shape (C, 2).

    They are those of the vertices, but for the labels of a scan at creases: a crease has no area,
    while the angles of its wider range of normals would extend over the faces next to it.

    Args:
        subject: The surface.
        paint: The quantity that is shown.
        model: Friction and resolution.
    """
    coordinates = texture_coordinates(subject, paint, model)[subject.mesh.corner_normals.vertices]
    if paint == "label" and subject.labels.mode == "scan":
        rows, worst, best = subject.crease_angles
        coordinates[rows] = _label_coordinates(worst, best, model)
    return coordinates


def _label_coordinates(worst: Floats, best: Floats, model: GraspModel) -> npt.NDArray[np.float32]:
    both = [_about(worst, model.sure_angle), _about(best, model.unstable_from)]
    return np.stack(both, axis=1).astype(np.float32)


def _about(angles: Floats, limit: float) -> Floats:
    """Coordinate that is linear in an angle and HALF at a limit; no grasp counts as 180 degrees."""
    if math.isinf(limit):
        return np.where(np.isinf(angles), 0.75, 0.25)
    return HALF + (np.minimum(angles, math.pi) - limit) / (4.0 * math.pi)


def texture_image(subject: Subject, paint: Paint, model: GraspModel) -> Bytes:
    """Texture image, shape (h, w, 3), the lowest row first.

    Args:
        subject: The surface.
        paint: The quantity that is shown.
        model: Friction and resolution.
    """
    if subject.poses is not None:
        return np.full((2, 2, 3), NEUTRAL, dtype=np.uint8)
    ramp = ramp_of(subject, paint, model)
    if ramp is None:
        return _labels(subject, model)
    columns = (np.arange(WIDE) + 0.5) / WIDE
    angles = (2.0 * columns - 1.0) * math.pi
    values = columns
    if paint == "critical_angle":
        values = angles / math.radians(ramp.maximum)
    elif paint == "max_resolution":
        values = 2.0 * (_sharp(model) - angles) / math.radians(ramp.maximum)
    elif paint == "margin":
        values = 0.5 + (model.sure_angle - angles) / math.radians(2.0 * ramp.maximum)
    colors = ramp.colors[np.clip(values * STEPS, 0, STEPS - 1).astype(int)]
    return np.stack([colors, np.broadcast_to(PALETTE[UNSEARCHED], (WIDE, 3))])


def _sharp(model: GraspModel) -> float:
    """Critical angle below which a grasp is S with a sensor that resolves everything [rad]."""
    return model.sure_angle + model.sensor_resolution / 2.0


def faded(image: Bytes) -> Bytes:
    """Pale version of colours (h, w, 3), for a surface that is outdated."""
    mixed = (1.0 - PALE_FRACTION) * image + PALE_FRACTION * np.array(PALE)
    return np.asarray(np.rint(mixed), dtype=np.uint8)


def ramp_of(subject: Subject, paint: Paint, model: GraspModel) -> Ramp | None:
    """Legend of the quantity that is shown; None: labels."""
    if subject.poses is not None or paint == "label":
        return None
    return _surface_ramp(subject, paint, model)


def _surface_ramp(subject: Subject, paint: Paint, model: GraspModel) -> Ramp:
    none = "no grasp found" if subject.labels.mode == "label" else "no grasp"
    if not (np.isinf(subject.labels.critical_angle) & (subject.weights > 0.0)).any():
        none = ""
    if paint == "critical_angle":
        maximum = math.degrees(min(subject.cone, math.pi / 2.0))
        return Ramp("β*: critical friction angle", maximum, "°", none)
    if paint == "max_resolution":
        # Without friction to spare none is S; then the scale is that of exact friction and normals.
        most = _sharp(model) if _sharp(model) > 0.0 else model.friction_angle
        text = "α*: coarsest resolution at which it is S"
        return Ramp(text, 2.0 * math.degrees(most), "°", none)
    if paint == "margin":
        most = math.degrees(model.friction_angle)
        note = "green: by how much it is S; brown: by how much it fails to be S"
        return Ramp("margin: S above 0°", most, "°", none, note, minimum=-most)
    if paint == "approach_margin":
        return _approach_ramp(subject)
    if paint in FORCE_PAINTS:
        return _force_ramp(subject, paint, model, none)
    return _epsilon_ramp(subject, paint, model, none)


def _approach_ramp(subject: Subject) -> Ramp:
    labels = subject.labels
    if labels.approach_margin is None:
        return Ramp("approach margin: needs a gripper", 180.0, "°", "no gripper")
    if labels.scene is not None and labels.model.fingers not in labels.scene.hand.fingers:
        return Ramp("approach margin: for two fingers only", 180.0, "°", "no palm is tested")
    unreached = np.isnan(labels.approach_margin) & (subject.weights > 0.0)
    grey = "not reached" if unreached.any() else ""
    most = math.degrees(_most(subject, "approach_margin"))
    return Ramp("approach margin: half the free approach angles", most, "°", grey)


def _epsilon_ramp(subject: Subject, paint: Paint, model: GraspModel, none: str) -> Ramp:
    epsilons = subject.epsilons
    text = "ε of the grasp with the smallest β*"
    if paint == "epsilon_min":
        text = epsilon_min_text(model if epsilons is None else epsilons.model)
    if epsilons is None:
        return Ramp(f"{text}; being computed", 1.0, "", "not computed yet", EQUAL_GRASPS)
    text += _other_settings(epsilons.model, model)
    return Ramp(text, _most(subject, paint), "", none, EQUAL_GRASPS)


def _force_ramp(subject: Subject, paint: Paint, model: GraspModel, none: str) -> Ramp:
    load, unit = subject.labels.load_case, " N" if paint == "grip_force" else " kg"
    name = "grip force of each contact" if paint == "grip_force" else "payload of the contacts"
    if load is None:
        return Ramp(f"{name}: needs a load", 1.0, unit, "no load")
    if paint == "payload" and load.available is None:
        return Ramp(f"{name}: needs a force at hand", 1.0, unit, "no force")
    if paint == "payload" and not load.by_mass:
        return Ramp(f"{name}: the task does not depend on the mass", 1.0, unit, "no payload")
    text = f"{name} {_condition(paint, load)}"
    forces = subject.forces
    if forces is None:
        return Ramp(f"{text}; being computed", 1.0, unit, "not computed yet")
    text += _other_settings(forces.model, model)
    values, top = _numbers(subject, paint), _most(subject, paint)
    weighed = subject.weights > 0.0
    meanings = [none] * bool(none) + ["no force suffices"] * bool(np.isinf(values[weighed]).any())
    exceeded = bool((values[weighed & np.isfinite(values)] > top).any())
    return Ramp(text, top, unit, ", ".join(meanings), exceeded=exceeded)


def _condition(paint: Paint, load: LoadCase) -> str:
    if paint == "grip_force":
        return f"for {load.to_hold.partition(' (')[0]}"
    return f"with {load.at_hand} at the worst normals"


def _other_settings(computed: GraspModel, model: GraspModel) -> str:
    """For which model the numbers are that are shown, if not for the chosen one."""
    if same_settings(computed, model):
        return ""
    degrees = math.degrees(computed.sensor_resolution)
    return f", for μ {computed.friction:.3g}, α {degrees:.1f}°; being computed"


def same_settings(computed: GraspModel, model: GraspModel) -> bool:
    """Whether epsilon computed for one model is valid for another; fingers are ignored."""
    return replace(computed, fingers=model.fingers) == model


def _labels(subject: Subject, model: GraspModel) -> Bytes:
    """Colours below and above the limit of S (columns) and of U (rows), shape (2, 2, 3)."""
    covered = subject.covers(model)
    maybe_missed = model.sure_angle > subject.cone + ROUNDING
    between = UNSEARCHED if maybe_missed and not covered else Label.M
    beyond = Label.U if covered else UNSEARCHED
    return np.asarray(PALETTE[[[Label.S, between], [Label.S, beyond]]])


_SOURCES: dict[Paint, Callable[[Subject], SurfaceLabels | None]] = {
    "epsilon": lambda subject: subject.epsilons,
    "epsilon_min": lambda subject: subject.epsilons,
    "approach_margin": lambda subject: subject.labels,
    "grip_force": lambda subject: subject.forces,
    "payload": lambda subject: subject.forces,
}
"""Labels with an attribute of that name, which does not follow from critical angles."""


def _numbers(subject: Subject, paint: Paint) -> Floats:
    """Value of such a quantity at each vertex, shape (V,); nan where it is not known."""
    values = getattr(_SOURCES[paint](subject), paint, None)
    return np.full(len(subject.mesh.vertices), math.nan) if values is None else values


def _most(subject: Subject, paint: Paint) -> float:
    """Value of such a quantity that has the last colour; both epsilons have the same."""
    if paint == "approach_margin":
        return float(np.nanmax(_numbers(subject, paint), initial=0.0)) or math.pi
    if paint not in FORCE_PAINTS:
        return float(np.nanmax(_numbers(subject, "epsilon"), initial=0.0)) or 1.0
    values = _numbers(subject, paint)
    vertices = np.flatnonzero(np.isfinite(values) & (subject.weights > 0.0))
    if not len(vertices):
        return 1.0
    order = vertices[np.argsort(values[vertices])]
    areas = np.cumsum(subject.weights[order])
    top = float(values[order[np.searchsorted(areas, MOST * areas[-1])]])
    return top or float(values[vertices].max()) or 1.0
