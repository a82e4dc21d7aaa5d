"""One grasp under the four combinations of its extreme normals (Wan & Howe 2018, Fig. 6)."""

import math
from itertools import product
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from grasp3d.arrays import Bools, Floats
from grasp3d.planar import Circle as CircleOutline
from grasp3d.plots.cones import (
    DARK,
    OBJECT,
    SIDES,
    at_polar,
    check_drawable,
    draw_arrow,
    draw_cone,
)
from grasp3d.plots.style import COLUMN, LABEL_COLORS, bare, new_figure, styled
from grasp3d.settings import GraspModel
from grasp3d.stability.label import Label

TOLERATED = 1.0 / 3.0
"""Fraction of the tilt that the drawn grasp tolerates at both contacts: less than 1 is ambiguous.
"""

_PERCEIVED: dict[str, Any] = {"color": DARK, "linewidth": 0.8, "linestyle": (0, (3, 2))}

_RESULTS = {
    (True, True): "line in both cones:\nstable",
    (True, False): "line outside cone 2:\nnot stable",
    (False, True): "line outside cone 1:\nnot stable",
    (False, False): "line outside both cones:\nnot stable",
}


@styled
def combinations_figure(model: GraspModel) -> Figure:
    """Draw one grasp of a circle under the four combinations of extreme normals.

    Wan & Howe 2018, Fig. 6: in some combinations the line between the contacts is inside both
    cones, in others it is not, so the sensor cannot decide whether the grasp is stable.

    Args:
        model: Friction and sensor resolution.

    Raises:
        SettingError: As in `cone_figure`.
    """
    check_drawable(model)
    circle = CircleOutline()
    off = model.friction_angle - TOLERATED * model.tilt  # between line and perceived normals
    contacts = circle.contacts_at([off * circle.radius, (math.pi - off) * circle.radius])
    figure = new_figure(COLUMN, 4.3)
    for axes, signs in zip(figure.subplots(2, 2).flat, product((1, -1), repeat=2), strict=True):
        _combination(axes, contacts.points, contacts.first, np.array(signs), model)
    figure.legend(handles=_handles(), loc="outside lower center", ncols=2)
    return figure


def _combination(
    axes: Axes, points: Floats, normals: Floats, signs: Floats, model: GraspModel
) -> None:
    """Draw one panel: both tilted cones, and the line between the contacts."""
    bare(axes)
    axes.add_patch(Circle((0.0, 0.0), 1.0, facecolor=OBJECT, edgecolor=DARK, linewidth=0.9))
    perceived = np.arctan2(normals[:, 1], normals[:, 0])
    tilted = perceived + signs * model.tilt
    inside = cones_with_line(points, tilted, model.friction_angle)
    for number, (point, normal, angle, line) in enumerate(
        zip(points, perceived, tilted, SIDES, strict=True), start=1
    ):
        draw_cone(axes, point, angle, model.friction_angle, length=0.8, **line)
        axes.plot(*np.transpose([point, point + at_polar(0.75, normal)]), **_PERCEIVED)
        draw_arrow(axes, point, point + at_polar(0.95, angle), line["color"])
        finger = point - at_polar(0.17, normal)
        axes.add_patch(Circle(tuple(finger), 0.14, facecolor=DARK, edgecolor="none", zorder=5))
        name = axes.text(finger[0], finger[1], str(number), color="white", fontsize=6.5, zorder=6)
        name.set(ha="center", va="center_baseline")
    color = LABEL_COLORS[Label.S if inside.all() else Label.U]
    axes.plot(*points.T, color=color, linewidth=1.8, zorder=4)
    axes.set_title(_RESULTS[bool(inside[0]), bool(inside[1])], fontsize=7.5)
    axes.set(xlim=(-1.12, 1.16), ylim=(-1.16, 1.16))


def cones_with_line(points: Floats, normals: Floats, friction_angle: float) -> Bools:
    """Mask of the two cones that have the line between their contacts strictly inside, shape (2,).

    Args:
        points: The contacts, shape (2, 2).
        normals: Polar angles of the cones' axes [rad], shape (2,).
        friction_angle: Their half-angle [rad].
    """
    apart = points[1] - points[0]
    toward = math.atan2(apart[1], apart[0]) + np.array([0.0, math.pi])
    off = np.abs(np.remainder(normals - toward + math.pi, 2.0 * math.pi) - math.pi)
    return np.asarray(off < friction_angle)


def _handles() -> list[Line2D]:
    arrow = Line2D([], [], color=DARK, marker=r"$\rightarrow$", linestyle="none", markersize=9.0)
    arrow.set_label("extreme normal")
    return [
        Line2D([], [], label="perceived normal", **_PERCEIVED),
        arrow,
        Line2D([], [], color=LABEL_COLORS[Label.S], linewidth=1.8, label="line in both cones"),
        Line2D([], [], color=LABEL_COLORS[Label.U], linewidth=1.8, label="line outside a cone"),
    ]
