"""A validation in sentences, as the command and its report print them."""

import math

from grasp3d.settings.model_text import model_line
from grasp3d.system.counts import counted, noun
from grasp3d.validating.intervals import wilson
from grasp3d.validating.success import Calibration, MarginThreshold
from grasp3d.validating.validation import ValidatedFile, Validation

MIN_BINS = 2
"""Fewest bins that show whether success rises."""

MOST_FILES = 8
"""Most files whose gripper and mass are listed."""


def counts_of(found: Validation) -> str:
    """How many grasps on how many objects, and how many of them held.

    Args:
        found: The result.
    """
    held, size = int(found.grasps.held.sum()), found.grasps.size
    left = f"; {found.not_tried:,} without an outcome are left out" if found.not_tried else ""
    return (
        f"{counted(size, 'grasps')} with an outcome on {counted(found.objects, 'objects')}: "
        f"{held:,} held ({percent(held / size)}){left}"
    )


def closing_of(found: Validation) -> str:
    """How grasps count whose jaws do not close.

    Args:
        found: The result.
    """
    missing = ~found.grasps.closed
    if not missing.any():
        return "the jaws close on the mesh at every pose"
    return (
        f"at {counted(int(missing.sum()), 'poses')} the jaws do not close on the mesh: labelled U, "
        f"with the worst value of every score; {int((missing & found.grasps.held).sum()):,} of "
        "them held"
    )


def intervals_of(found: Validation) -> str:
    """What the intervals are over.

    Args:
        found: The result.
    """
    resamples, seed = found.resamples, found.settings.seed
    if found.by_object:
        what = f"the {found.objects} objects, each with all of its grasps"
    else:
        what = "the grasps; they hold for this object, not for others"
    return f"intervals at 95 %: bootstrap, {resamples:,} resamples (seed {seed}) of {what}"


def model_of(found: Validation) -> str:
    """Friction, resolution and errors that labels, margins and forces are of.

    Args:
        found: The result.
    """
    return f"labels, margins and forces at {model_line(found.model)}"


def sources_of(found: Validation) -> list[str]:
    """Gripper, mass and centre of mass of the files, each sentence once.

    Args:
        found: The result.
    """
    lines = list(dict.fromkeys(_source(one) for one in found.files))
    if len(lines) > MOST_FILES:
        return [*lines[:MOST_FILES], f"and {len(lines) - MOST_FILES} more; see the report"]
    return lines


def calibration_of(found: Validation) -> list[str]:
    """Whether success rises with the margin, and from which margin on grasps hold.

    Args:
        found: The result.
    """
    one, size = found.calibration, found.grasps.size
    return [
        _monotone(found),
        f"best threshold (largest sum of sensitivity and specificity): {_threshold(one.youden)}",
        _reached(one, size),
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
        parts.append("mass not known, so no grip force (give it with --mass)")
    else:
        parts.append(f"mass {_mass(one.mass)}, {_origin(one.mass_from)}")
    parts.append(f"centre of mass {_origin(one.center_from)}")
    return "; ".join(parts)


def _origin(origin: str) -> str:
    return {
        "given": "as given",
        "file": "as the file states",
        "volume": "of the volume, at uniform density",
        "densities": "of the densities",
        "surface": "not known, as the mesh is open: the middle of the surface",
    }.get(origin, origin)


def _mass(mass: float) -> str:
    return f"{mass:.3g} kg" if mass >= 1.0 else f"{1e3 * mass:.3g} g"


def _monotone(found: Validation) -> str:
    one = found.calibration
    count = len(one.bins)
    if math.isnan(one.rank_correlation) or count < MIN_BINS:
        return "whether success rises with the margin is not known: all outcomes or margins agree"
    if one.is_monotone and not one.falls:
        text = f"success rises with the margin over all {count} bins"
    elif one.is_monotone:
        text = (
            f"success rises with the margin over {count} bins, but for "
            f"{counted(one.falls, 'falls')} within chance"
        )
    else:
        text = (
            f"success does not rise with the margin: it falls at {one.falls} of {count - 1} "
            f"{noun(count - 1, 'steps')}, beyond chance at least once"
        )
    return f"{text}; rank correlation (Spearman) {one.rank_correlation:.2f}"


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
