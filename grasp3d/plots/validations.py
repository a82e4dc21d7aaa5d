"""Figures of labels and scores held against outcomes: ROC curves, success by label and margin."""

import math
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grasp3d.arrays import Floats
from grasp3d.plots.figures import (
    LABEL_COLORS,
    LINES,
    PAGE,
    label_patches,
    new_figure,
    save_as,
    styled,
)
from grasp3d.stability.label import MEANING, Label
from grasp3d.validating.qualities import ScoreQuality
from grasp3d.validating.ranking import RankedOutcomes
from grasp3d.validating.success import Calibration, LabelSuccess
from grasp3d.validating.validation import Validation

SHOWN = ("margin", "epsilon", "grip_force", "normal_product", "contact_area")
"""Scores with a line style of their own in the ROC curves."""

OTHERS: dict[str, Any] = {"color": "#BBBBBB", "linewidth": 0.8}
"""Style of the curves of other scores."""

MOST_POINTS = 400
"""Most points of a curve."""

LINE = "#222222"

ROC, LABELS, CALIBRATION = FIGURES = ("roc.svg", "labels.svg", "calibration.svg")
"""Names of the figures' files."""


def save_figures(folder: Path, result: Validation) -> None:
    """Write all figures; that of ROC curves only if some grasps held and some failed.

    Args:
        folder: An existing folder.
        result: The result.

    Raises:
        OutputError: A file cannot be written.
    """
    if not result.grasps.one_sided:
        save_as(roc_figure(result), folder / ROC)
    save_as(label_figure(result), folder / LABELS)
    save_as(calibration_figure(result), folder / CALIBRATION)


@styled
def roc_figure(result: Validation) -> Figure:
    """Draw the ROC curves of the scores.

    Args:
        result: The result; some grasps held and some failed.
    """
    figure = new_figure(0.7 * PAGE, 2.8)
    axes = figure.subplots()
    for one in result.qualities:
        failed, held = _thinned(
            RankedOutcomes.of(result.grasps.held, result.grasps.ranked(one.score)).roc_curve()
        )
        axes.plot(failed, held, **_style(one))
    axes.plot([], [], label="other scores", **OTHERS)
    axes.plot([0.0, 1.0], [0.0, 1.0], color=LINE, linewidth=0.7, linestyle=":", label="chance 0.50")
    axes.set(xlim=(0.0, 1.0), ylim=(0.0, 1.01), aspect="equal")
    axes.set_xlabel("accepted fraction of the failed grasps")
    axes.set_ylabel("accepted fraction of the held grasps")
    axes.legend(loc="center left", bbox_to_anchor=(1.02, 0.5), title="area under the curve")
    return figure


def _style(one: ScoreQuality) -> dict[str, Any]:
    """Line and legend entry of a score's curve."""
    if one.score.name not in SHOWN:
        return {"zorder": 1.5, **OTHERS}
    line = LINES[SHOWN.index(one.score.name)]
    return {"label": f"{one.score.title} {one.roc_auc:.2f}", "zorder": 3, **line}


def _thinned(curve: tuple[Floats, Floats]) -> tuple[Floats, Floats]:
    """At most `MOST_POINTS` points of a curve, with its ends."""
    rows = np.unique(np.linspace(0, len(curve[0]) - 1, MOST_POINTS).astype(np.int64))
    return curve[0][rows], curve[1][rows]


@styled
def calibration_figure(result: Validation) -> Figure:
    """Draw success over the margin: bins with intervals, and isotonic regression.

    Args:
        result: The result.
    """
    figure = new_figure(PAGE, 2.9)
    axes, fit = figure.subplots(), result.calibration
    means = np.degrees([each.mean for each in fit.bins])
    fractions = np.array([each.fraction for each in fit.bins])
    ends = np.array([each.interval for each in fit.bins]).reshape(-1, 2).T
    spread = np.abs(ends - fractions)
    axes.errorbar(means, fractions, spread, fmt="o", color="#0072B2", markersize=4.0,
                  linewidth=1.0, capsize=2.0, label="bins, 95 %", zorder=4)  # fmt: skip
    axes.plot(np.degrees(fit.margins), fit.fitted, color=LINE, linewidth=0.9,
              label="isotonic regression", zorder=3)  # fmt: skip
    rate = float(result.grasps.held.mean())
    axes.axhline(rate, color=LINE, linewidth=0.7, linestyle=":", label=f"all grasps {rate:.2f}")
    low, high = _limits(fit)
    _shade(axes, result, low, high)
    if math.isfinite(fit.youden.margin):
        axes.axvline(math.degrees(fit.youden.margin), color="#7F3C8D", linewidth=1.0,
                     linestyle=(0, (5, 1.5)), label="best threshold")  # fmt: skip
    axes.set(xlim=(low, high), ylim=(-0.02, 1.02), xlabel="margin [°]", ylabel="fraction that held")
    axes.legend(loc="center left", bbox_to_anchor=(1.01, 0.5))
    return figure


def _limits(one: Calibration) -> tuple[float, float]:
    """Ends of the axis of margins [degrees]."""
    low, high = np.degrees([one.margins[0], one.margins[-1]])
    space = 0.04 * max(high - low, 1.0)
    return float(low - space), float(high + space)


def _shade(axes: Axes, result: Validation, low: float, high: float) -> None:
    """Colour the margins of S, M and U, which are thresholds where locations are certain."""
    model = result.model
    if model.location_error != 0.0:
        return
    unstable = math.degrees(model.sure_angle - model.unstable_from)
    edges = {Label.U: (low, unstable), Label.M: (unstable, 0.0), Label.S: (0.0, high)}
    for label, (start, end) in edges.items():
        start, end = max(start, low), min(end, high)  # noqa: PLW2901, cut to the axis
        if end > start:
            axes.axvspan(start, end, color=LABEL_COLORS[label], alpha=0.16, linewidth=0.0)
            axes.text(0.5 * (start + end), 1.01, label.name, ha="center", va="bottom",
                      transform=axes.get_xaxis_transform(), fontsize=8.0)  # fmt: skip


@styled
def label_figure(result: Validation) -> Figure:
    """Draw success within S, M and U over the sensor resolution, a panel for each friction.

    Args:
        result: The result.
    """
    frictions = sorted({one.friction for one in result.labels})
    figure = new_figure(PAGE, 2.5)
    grid = figure.subplots(1, len(frictions), squeeze=False, sharey=True)[0]
    for axes, friction in zip(grid, frictions, strict=True):
        cells = [one for one in result.labels if one.friction == friction]
        for shift, label in zip((0.15, 0.0, -0.15), Label, strict=True):
            _draw_label(axes, cells, label, shift)
        axes.set_title(rf"$\mu$ = {friction:g}")
        names = [f"{math.degrees(one.sensor_resolution):.4g}" for one in cells]
        axes.set_xticks(range(len(cells)), names)
        axes.set(xlim=(-0.5, len(cells) - 0.5), ylim=(-0.02, 1.02))
        axes.set_xlabel(r"sensor resolution $\alpha$ [°]")
        axes.axhline(float(result.grasps.held.mean()), color=LINE, linewidth=0.7, linestyle=":")
    grid[0].set_ylabel("fraction that held")
    figure.legend(handles=label_patches(MEANING["scan"]), loc="outside lower center", ncols=3)
    return figure


def _draw_label(axes: Axes, cells: list[LabelSuccess], label: Label, shift: float) -> None:
    """Draw the success of one label with intervals, where grasps have it."""
    filled = [number for number, one in enumerate(cells) if one.counts[label]]
    fractions = np.array([cells[number].fraction(label.name) for number in filled])
    ends = np.array([cells[number].interval(label.name) for number in filled]).reshape(-1, 2).T
    axes.errorbar(np.array(filled) + shift, fractions, np.abs(ends - fractions), fmt="o",
                  color=LABEL_COLORS[label], markeredgecolor=LINE, markeredgewidth=0.5,
                  ecolor=LINE, elinewidth=0.7, capsize=1.5, markersize=5.0)  # fmt: skip
