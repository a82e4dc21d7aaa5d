"""Budgets of margins as stacked bars: what each uncertainty takes of the friction angle."""

import math
from collections.abc import Mapping
from typing import Any

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grasp3d.contact.budget import CRITICAL, MARGIN, PARTS, MarginBudget
from grasp3d.errors import SettingError
from grasp3d.plots.figures import LABEL_COLORS, PAGE, as_text, new_figure, styled
from grasp3d.stability.label import Label

COLORS = {
    CRITICAL: "#BBBBBB",
    PARTS["friction"]: "#0072B2",
    PARTS["resolution"]: "#CC79A7",
    PARTS["normals"]: "#7F3C8D",
    PARTS["location"]: "#E69F00",
    PARTS["encoders"]: "#56B4E9",
    MARGIN: LABEL_COLORS[Label.S],
}
"""Colours of the parts, distinguishable for colour-blind readers; a margin has that of S."""

NEGATIVE = "margin below 0"
BAR = 0.7
"""Height of a bar, as a fraction of its row."""
_EXCESS: dict[str, Any] = {
    "facecolor": "none", "edgecolor": "black", "hatch": "////", "linewidth": 0.0,
}  # fmt: skip

ROW, REST = 0.32, 0.9
"""Height of a bar, and of the rest of the figure [inch]."""
IN_LINE, LINE = 6, 0.18
"""Most entries in a line of the legend, and the height of a further line [inch]."""


@styled
def budget_figure(budgets: Mapping[str, MarginBudget]) -> Figure:
    """A stacked bar for each budget of one grasp; a line marks the friction angle.

    Beside each bar is its margin. Where the parts exceed the friction angle, the bar passes the
    line: it is hatched from there on, as long as the margin is below 0.

    Args:
        budgets: Budgets of one grasp each, such as means, by their names.

    Raises:
        SettingError: There is no budget, or a budget is of several grasps.

    Example:
        >>> import grasp3d
        >>> from grasp3d.contact import MarginBudget
        >>> from grasp3d.plots.budgets import budget_figure
        >>> sensor = grasp3d.Sensor(receptive_field=4.0, fingertip_radius=10.0)
        >>> budget = MarginBudget.of(0.0, friction=(0.4, 0.6), sensor=sensor, opening=50.0)
        >>> budget_figure({"pinch": budget}).savefig("budget.svg")
    """
    if not budgets or any(budget.friction_angle.size != 1 for budget in budgets.values()):
        raise SettingError("a figure of budgets needs budgets of one grasp each, such as means")
    figure = new_figure(PAGE, REST + ROW * len(budgets))
    axes = figure.add_subplot()
    bars: dict[str, Any] = {}
    for row, budget in enumerate(budgets.values()):
        for name, bar in _draw_bar(axes, row, budget).items():
            bars.setdefault(name, bar)
    axes.set_yticks(range(len(budgets)), [as_text(name) for name in budgets])
    axes.invert_yaxis()
    axes.grid(axis="y", visible=False)
    axes.set_xlabel("friction angle and its parts [degrees]; line: friction angle; number: margin")
    ordered = [name for name in (*COLORS, NEGATIVE) if name in bars]
    lines = math.ceil(len(ordered) / IN_LINE)
    figure.set_figheight(figure.get_figheight() + LINE * (lines - 1))
    figure.legend(
        [bars[name] for name in ordered],
        ordered,
        loc="outside upper center",
        ncols=math.ceil(len(ordered) / lines),
    )
    return figure


def _draw_bar(axes: Axes, row: int, budget: MarginBudget) -> dict[str, Any]:
    """Draw the parts of one budget, its friction angle and its margin; returns bars by name."""
    bars: dict[str, Any] = {}
    end, limit = 0.0, math.degrees(budget.friction_angle.item())
    for name, value in budget.stack.items():
        angle = math.degrees(value.item())
        if angle > 0.0:
            bars[name] = axes.barh(row, angle, BAR, end, color=COLORS[name], label=name)
            end += angle
    axes.plot([limit, limit], [row - 0.45, row + 0.45], color="black", linewidth=1.2)
    margin = math.degrees(budget.margin.item())
    if margin < 0.0:
        bars[NEGATIVE] = axes.barh(row, -margin, BAR, limit, **_EXCESS)
    text = f"{margin:+.1f}°".replace("-", "\N{MINUS SIGN}")
    axes.annotate(
        text, (max(end, limit), row), (4.0, 0.0), textcoords="offset points",
        va="center", fontsize="small",
    )  # fmt: skip
    return bars
