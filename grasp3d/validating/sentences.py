"""A validation in sentences, as the command and its report print them."""

import math

from grasp3d.settings.model_text import model_line
from grasp3d.system.counts import counted, noun
from grasp3d.validating.intervals import wilson
from grasp3d.validating.qualities import mean_over_objects
from grasp3d.validating.success import Calibration, MarginThreshold
from grasp3d.validating.tried_grasps import COLUMN, ONE
from grasp3d.validating.validation import ValidatedFile, Validation

MIN_BINS = 2
"""Fewest bins that show whether success rises."""

MOST_FILES = 8
"""Most files whose gripper and mass are listed."""


def counts_of(result: Validation) -> str:
    """How many grasps on how many objects, and how many of them held.

    Args:
        result: The validation.
    """
    held, size = int(result.grasps.held.sum()), result.grasps.size
    outcome = f"an outcome ({result.outcome})" if result.outcome else "an outcome"
    objects = counted(result.objects, "objects")
    more = f"; {result.not_tried:,} without an outcome are left out" if result.not_tried else ""
    return (
        f"{counted(size, 'grasps')} with {outcome} on {objects}: {held:,} held "
        f"({percent(held / size)}){more}"
    )


def closing_of(result: Validation) -> str:
    """How grasps count whose jaws do not close.

    Args:
        result: The validation.
    """
    missing = ~result.grasps.closed
    if not missing.any():
        return "the jaws close on the mesh at every pose"
    return (
        f"at {counted(int(missing.sum()), 'poses')} the jaws do not close on the mesh: labelled U, "
        f"with the worst value of every score; {int((missing & result.grasps.held).sum()):,} of "
        "them held"
    )


def intervals_of(result: Validation) -> str:
    """What the intervals are over.

    Args:
        result: The validation.
    """
    resamples, seed = result.resamples, result.settings.seed
    if result.by_object:
        what = f"the {result.objects} objects, each with all of its grasps"
    else:
        what = "the grasps; they hold for this object, not for others"
    return f"intervals at 95 %: bootstrap, {resamples:,} resamples (seed {seed}) of {what}"


def objects_of(result: Validation) -> list[str]:
    """How well the first score predicts on each of several objects.

    Args:
        result: The validation.
    """
    title, name = result.qualities[0].score.title, result.qualities[0].score.name
    areas = {
        one.number: one.roc_auc[name]
        for one in result.by_objects
        if not math.isnan(one.roc_auc[name])
    }
    if not result.by_object or not areas:
        return []
    low, high = min(areas, key=areas.__getitem__), max(areas, key=areas.__getitem__)
    ends = (f"{areas[one]:.3f} ({result.object_names[one]})" for one in (low, high))
    mean = mean_over_objects(result.by_objects, name)
    both = f"{counted(len(areas), 'objects')} with both outcomes"
    return [f"ROC-AUC of the {title} by object: {' to '.join(ends)}, mean {mean:.3f} of {both}"]


def model_of(result: Validation) -> str:
    """Friction, resolution and errors that labels, margins and forces are of.

    Args:
        result: The validation.
    """
    return f"labels, margins and forces at {model_line(result.model)}"


def sources_of(result: Validation) -> list[str]:
    """Gripper, mass and centre of mass of the files, each sentence once.

    Args:
        result: The validation.
    """
    lines = list(dict.fromkeys(_source(file) for file in result.files))
    if len(lines) > MOST_FILES:
        return [*lines[:MOST_FILES], f"and {len(lines) - MOST_FILES} more; see the report"]
    return lines


def calibration_of(result: Validation) -> list[str]:
    """Whether success rises with the margin, and from which margin on grasps hold.

    Args:
        result: The validation.
    """
    fit, size = result.calibration, result.grasps.size
    return [
        _monotone(result),
        f"best threshold (largest sum of sensitivity and specificity): {_threshold(fit.youden)}",
        _reached(fit, size),
    ]


def percent(fraction: float, digits: int = 1) -> str:
    """A fraction in percent; nan: none.

    Args:
        fraction: From 0 to 1.
        digits: Digits after the point.
    """
    return "none" if math.isnan(fraction) else f"{100.0 * fraction:.{digits}f} %"


def degrees(angle: float) -> str:
    """An angle in degrees; nan and infinite: none.

    Args:
        angle: [rad]
    """
    return f"{math.degrees(angle) + 0.0:.1f}°" if math.isfinite(angle) else "none"


def _source(one: ValidatedFile) -> str:
    parts = [f"gripper {one.hand}, {one.hand_from}"]
    if one.mass is None:
        without = "forces are for 1 kg" if one.mass_from == ONE else "no grip force"
        parts.append(f"mass not known, so {without} (give it with --mass)")
    else:
        masses = " to ".join(dict.fromkeys(map(_mass, one.mass)))
        parts.append(f"mass {masses}, {_origin(one.mass_from)}")
    parts.append(f"centre of mass {_origin(one.center_from)}")
    return "; ".join(parts)


def _origin(origin: str) -> str:
    if origin.startswith(COLUMN):
        return f"by the {origin}"
    return {
        "given": "as given",
        "file": "as the file states",
        "volume": "of the volume, at uniform density",
        "surface": "not known, as the mesh is open: the middle of the surface",
    }.get(origin, origin)


def _mass(mass: float) -> str:
    return f"{mass:.3g} kg" if mass >= 1.0 else f"{1e3 * mass:.3g} g"


def _monotone(result: Validation) -> str:
    fit = result.calibration
    count = len(fit.bins)
    if math.isnan(fit.rank_correlation) or count < MIN_BINS:
        return "whether success rises with the margin is not known: all outcomes or margins agree"
    if fit.is_monotone and not fit.falls:
        text = f"success rises with the margin over all {count} bins"
    elif fit.is_monotone:
        text = (
            f"success rises with the margin over {count} bins, but for "
            f"{counted(fit.falls, 'falls')} within chance"
        )
    else:
        text = (
            f"success does not rise with the margin: it falls at {fit.falls} of {count - 1} "
            f"{noun(count - 1, 'steps')}, beyond chance at least once"
        )
    return f"{text}; rank correlation (Spearman) {fit.rank_correlation:.2f}"


def _threshold(one: MarginThreshold) -> str:
    if math.isnan(one.margin):
        return "none, as all outcomes are the same"
    if one.sensitivity + one.specificity <= 1.0:
        return "none, as no margin separates those that held from those that failed"
    return (
        f"margin {degrees(one.margin)}, which accepts {percent(one.sensitivity)} of those that "
        f"held and refuses {percent(one.specificity)} of those that failed"
    )


def _reached(one: Calibration, size: int) -> str:
    target, reached = percent(one.target, 0), one.reached
    if math.isnan(reached.margin):
        return f"from no margin on {target} of the grasps held"
    if math.isinf(reached.margin):
        return f"{target} of all grasps held or more, without a threshold"
    low, high = wilson(reached.held, reached.accepted)
    return (
        f"{target} of the accepted grasps held from a margin of {degrees(reached.margin)} on: "
        f"{reached.held:,} of {reached.accepted:,} (95 %: {100.0 * low:.0f} to {100.0 * high:.0f} "
        f"%), which are {percent(reached.accepted / size)} of all"
    )
