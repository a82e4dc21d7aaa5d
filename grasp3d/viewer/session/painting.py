"""What a surface is painted with: a small picture, and where in it each vertex lies.

Critical angles, not colours, are interpolated between the vertices of a face, so that the borders
of S, M and U are as sharp as the labels are; and a slider changes the picture alone.
"""

import math
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt
from matplotlib import colormaps

from grasp3d.arrays import Bytes, Floats
from grasp3d.settings import GraspModel
from grasp3d.stability.label import COLORS, Label
from grasp3d.stability.thresholds import label_angles, unstable_from
from grasp3d.viewer.subjects.subject import Subject
from grasp3d.viewer.view_settings import Paint

UNSEARCHED = 3
"""Code of vertices of which nothing can be told, as the search did not go far enough."""

GREY = (0x9A, 0xA0, 0xA6)
"""Of what is not known: no grasp, or not searched."""

PALETTE = np.array([*(COLORS[label] for label in sorted(Label)), GREY], dtype=np.uint8)

WIDE = 2048
"""Pixels across of a ramp's picture, for 180 degrees or the largest epsilon."""

HALF = 0.5 + 1e-7
"""Where in the picture of labels an angle lies that is just at a limit; rounding must not take it
below."""

ROUNDING = 1e-9
"""Angle by which a grasp may exceed the cone that was searched [rad]."""

ALIKE = "of grasps that are alike in β* any may be taken, so ε can change from place to place"

STEPS = 256

RAMP = np.array(colormaps["viridis"](np.linspace(0.0, 1.0, STEPS))[:, :3] * 255.0, dtype=np.uint8)
"""Colours of a ramp, from the lowest value to the highest, shape (STEPS, 3); none is grey."""

PALE, WASHED = (0xDD, 0xE0, 0xE4), 0.7
"""What is mixed into colours that do not belong to what is chosen, and how much of it."""


@dataclass(frozen=True, eq=False)
class Ramp:
    """What the colours of a number mean."""

    words: str
    """What it is, with its unit."""
    most: float
    """Value of the last colour; the first is 0."""
    unit: str
    grey: str = ""
    """What grey means; nothing: it does not occur."""
    note: str = ""
    """What else a reader should know."""


def labels_at(subject: Subject, model: GraspModel) -> Bytes:
    """Label every vertex; what lies beyond the search is `UNSEARCHED`, where relabel refuses.

    Returns:
        Codes, shape (V,).
    """
    return codes_of(subject, subject.critical_angle, subject.critical_angle_best, model)


def codes_of(subject: Subject, worst: Floats, best: Floats, model: GraspModel) -> Bytes:
    """Label some angles of a subject, as `labels_at` does all of them.

    Beyond the cone that was searched a better grasp may have been passed over: what would be U is
    not told, nor M where an S could be among those.

    Args:
        subject: How far its search went.
        worst: Critical angles over the worst normals [rad], any shape.
        best: Over the best, same shape.
        model: Friction and resolution.
    """
    codes = label_angles(worst, best, model)
    if not subject.covers(model):
        stable, searched = model.friction_angle - model.tilt, subject.cone + ROUNDING
        hidden = (codes == Label.M) & (worst > searched) & (stable > searched)
        codes[(codes == Label.U) | hidden] = UNSEARCHED
    return codes


def shares_of(subject: Subject, codes: Bytes) -> Floats:
    """Share of the area of each code, shape (4,)."""
    shares = np.bincount(codes, subject.weights, minlength=len(PALETTE))
    return np.asarray(shares, dtype=np.float64)


def places(subject: Subject, paint: Paint, model: GraspModel) -> npt.NDArray[np.float32]:
    """Where in the picture each vertex lies, from 0 to 1, shape (V, 2).

    Painted by labels that is about the two limits, which a slider moves: both are in the middle of
    the picture, exactly. Painted by numbers no slider changes it.

    Args:
        subject: The surface.
        paint: What it is painted by.
        model: Friction and resolution.
    """
    worst, best = subject.critical_angle, subject.critical_angle_best
    if paint == "label":
        friction, tilt = model.friction_angle, model.tilt
        limit = float(unstable_from(friction, tilt, model.fingers))
        both = [_about(worst, friction - tilt), _about(best, limit)]
        return np.stack(both, axis=1).astype(np.float32)
    values = np.minimum(worst, math.pi) / math.pi
    known = np.isfinite(worst)
    if paint in {"epsilon", "epsilon_min"}:
        shown = _epsilon(subject, paint)
        known = np.isfinite(shown)
        values = np.minimum(np.nan_to_num(shown) / _most_epsilon(subject), 1.0)
    return np.stack([values, np.where(known, 0.25, 0.75)], axis=1).astype(np.float32)


def _about(angles: Floats, limit: float) -> Floats:
    """From 0 to 1, linear in an angle and the half at a limit; no grasp stands for 180 degrees."""
    if math.isinf(limit):
        return np.where(np.isinf(angles), 0.75, 0.25)
    return HALF + (np.minimum(angles, math.pi) - limit) / (4.0 * math.pi)


def picture(subject: Subject, paint: Paint, model: GraspModel) -> Bytes:
    """What the surface is painted with, shape (h, w, 3), the lowest row first.

    Args:
        subject: The surface.
        paint: What it is painted by.
        model: Friction and resolution.
    """
    ramp = ramp_of(subject, paint, model)
    if ramp is None:
        return _labels(subject, model)
    columns = (np.arange(WIDE) + 0.5) / WIDE
    if paint == "critical_angle":
        shares = columns * math.pi / math.radians(ramp.most)
    elif paint == "max_resolution":
        coarsest = 2.0 * (model.friction_angle - columns * math.pi)
        shares = coarsest / math.radians(ramp.most)
    else:
        shares = columns
    steps = np.clip(shares * STEPS, 0, STEPS - 1).astype(int)
    return np.stack([RAMP[steps], np.broadcast_to(PALETTE[UNSEARCHED], (WIDE, 3))])


def washed_out(image: Bytes) -> Bytes:
    """Colours (h, w, 3) that say that they are no longer true."""
    mixed = (1.0 - WASHED) * image + WASHED * np.array(PALE)
    return np.asarray(np.rint(mixed), dtype=np.uint8)


def ramp_of(subject: Subject, paint: Paint, model: GraspModel) -> Ramp | None:
    """What the colours mean; None: they are labels."""
    none = "no grasp found" if subject.mode == "label" else "no grasp"
    if not (np.isinf(subject.critical_angle) & (subject.weights > 0.0)).any():
        none = ""
    if paint == "critical_angle":
        most = math.degrees(min(subject.cone, math.pi / 2.0))
        return Ramp("β*: critical friction angle", most, "°", none)
    if paint == "max_resolution":
        most = 2.0 * math.degrees(model.friction_angle)
        return Ramp("α*: coarsest sensor that keeps it S", most, "°", none)
    if paint in {"epsilon", "epsilon_min"}:
        return _ramp_of_epsilon(subject, paint, model, none)
    return None


def _ramp_of_epsilon(subject: Subject, paint: Paint, model: GraspModel, none: str) -> Ramp:
    words = "ε of the grasp with the smallest β*"
    if paint == "epsilon_min":
        words = "smallest ε over the tilts"
    known, then = subject.epsilons, "measuring" if subject.measurable else "as in the file"
    if known is None:
        return Ramp(f"{words}; {then}", 1.0, "", "not measured yet", ALIKE)
    if not is_of(known.model, model):
        friction, degrees = known.model.friction, math.degrees(known.model.sensor_resolution)
        words = f"{words}, of μ {friction:.3g}, α {degrees:.1f}°; {then}"
    return Ramp(words, _most_epsilon(subject), "", none, ALIKE)


def is_of(known: GraspModel, model: GraspModel) -> bool:
    """Whether epsilon that was measured for one model answers another; fingers do not count."""
    return replace(known, fingers=model.fingers) == model


def _labels(subject: Subject, model: GraspModel) -> Bytes:
    """Colours below and from the two limits on: of S across, of U upward, shape (2, 2, 3)."""
    covered = subject.covers(model)
    passed_over = model.friction_angle - model.tilt > subject.cone + ROUNDING
    between = UNSEARCHED if passed_over and not covered else Label.M
    beyond = Label.U if covered else UNSEARCHED
    return np.asarray(PALETTE[[[Label.S, between], [Label.S, beyond]]])


def _epsilon(subject: Subject, paint: Paint) -> Floats:
    if subject.epsilons is None:
        return np.full(len(subject.vertices), math.nan)
    return subject.epsilons.nominal if paint == "epsilon" else subject.epsilons.minimum


def _most_epsilon(subject: Subject) -> float:
    """Largest epsilon of the surface, for both ramps."""
    values = _epsilon(subject, "epsilon")
    return float(np.nanmax(values, initial=0.0)) or 1.0
