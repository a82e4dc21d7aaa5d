"""Figure of labels and scores held against outcomes: success by label, and ROC curves."""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from grasp3d.outcomes.ranking import roc_curve
from grasp3d.outcomes.validation import Validation
from grasp3d.pictures.figures import LABEL_COLORS, LINES, PAGE, new_figure, styled

SHOWN = ("quality", "margin", "payload", "epsilon", "contact_area")
"""Scores whose ROC curves are drawn, where they are known."""

LINE = "#222222"


@styled
def validation_figure(result: Validation) -> Figure:
    """Draw success within S, M and U with its intervals, and ROC curves if there are both outcomes.

    Args:
        result: The result.
    """
    figure = new_figure(PAGE, 2.8)
    left, right = figure.subplots(1, 2, width_ratios=(1.0, 1.6))
    shown = {label: rate for label, rate in result.rates.items() if rate.count}
    for place, (label, rate) in enumerate(shown.items()):
        spread = np.abs(np.array(rate.interval) - rate.rate)[:, None]
        left.errorbar([place], [rate.rate], spread, fmt="o", color=LABEL_COLORS[label],
                      markeredgecolor=LINE, markeredgewidth=0.5, ecolor=LINE, elinewidth=0.7,
                      capsize=2.0, markersize=6.0)  # fmt: skip
    dotted: dict[str, Any] = {"color": LINE, "linewidth": 0.7, "linestyle": ":"}
    left.axhline(result.held.mean(), label=f"all grasps {result.held.mean():.2f}", **dotted)
    left.set_xticks(range(len(shown)), [f"{of.name}\n{of.count:,}" for of in shown.values()])
    left.set(xlim=(-0.5, len(shown) - 0.5), ylim=(-0.02, 1.02), xlabel="label, number of grasps",
             ylabel="fraction that held")  # fmt: skip
    left.legend()
    curves = [one for one in result.qualities if one.score.name in SHOWN]
    for one, line in zip(curves, LINES, strict=False):
        if not np.isnan(one.roc_auc):
            values = result.ranked(one.score)
            title = f"{one.score.title} {one.roc_auc:.2f}"
            right.plot(*roc_curve(result.held, values), label=title, **line)
    right.plot([0.0, 1.0], [0.0, 1.0], label="chance 0.50", **dotted)
    right.set(xlim=(0.0, 1.0), ylim=(0.0, 1.01), aspect="equal",
              xlabel="accepted fraction of the failed grasps",
              ylabel="accepted fraction of the held grasps")  # fmt: skip
    right.legend(loc="center left", bbox_to_anchor=(1.02, 0.5), title="area under the curve")
    return figure
