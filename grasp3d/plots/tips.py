"""Receptive field of a flat and of a round fingertip (Wan & Howe 2018, Fig. 4)."""

import math
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from grasp3d.arrays import Floats
from grasp3d.contact.sensor import Sensor
from grasp3d.plots.cones import DARK, OBJECT, at_polar, draw_arrow
from grasp3d.plots.style import LINES, PAGE, bare, new_figure, styled

HEIGHT = 2.9
"""Of the figure [inch]."""
DEEP = 1.1
"""Depth to which fingertips are drawn, in radii of the round one."""
NORMAL = 0.62
"""Length of the drawn normals, in radii of the round tip."""
UP = math.pi / 2.0

_FIELD: dict[str, Any] = {
    "color": LINES[1]["color"], "linewidth": 4.0, "solid_capstyle": "butt", "zorder": 3,
}  # fmt: skip
_OUTLINE: dict[str, Any] = {"color": DARK, "linewidth": 0.9}


@styled
def tips_figure(sensor: Sensor) -> Figure:
    """Draw which contacts a flat and a round fingertip of one receptive field cannot distinguish.

    Wan & Howe 2018, Fig. 4: on a flat tip only the location is uncertain, on a round one the normal
    as well.

    Args:
        sensor: Receptive field and radius of the round tip [mm].
    """
    figure = new_figure(PAGE, HEIGHT)
    flat = Sensor(sensor.receptive_field, math.inf)
    for axes, tip in zip(figure.subplots(1, 2), (flat, sensor), strict=True):
        _draw_tip(axes, tip, sensor.fingertip_radius)
    figure.legend(handles=_handles(), loc="outside lower center", ncols=4)
    return figure


def field_ends(sensor: Sensor, scale: float) -> tuple[Floats, Floats]:
    """Ends of the receptive field, and the normals there, relative to its middle.

    Args:
        sensor: The fingertip; its outward normal in the middle is the y axis.
        scale: Length that the points are divided by.

    Returns:
        Points (2, 2), and unit normals (2, 2), pointing out of the tip.
    """
    sides = np.array([-1.0, 1.0])
    normals = np.stack([at_polar(1.0, UP - side * sensor.tilt) for side in sides])
    if sensor.flat:
        points = np.outer(sides, [sensor.receptive_field / 2.0, 0.0])
    else:
        points = sensor.fingertip_radius * (normals - [0.0, 1.0])
    return points / scale, normals


def _draw_tip(axes: Axes, tip: Sensor, radius: float) -> None:
    bare(axes)
    outline, field = (_flat if tip.flat else _round)(tip, radius)
    axes.fill(*outline.T, color=OBJECT, linewidth=0.0)
    axes.plot(*outline.T, **_OUTLINE)
    axes.plot(*field.T, **_FIELD)
    points, normals = field_ends(tip, radius)
    draw_arrow(axes, np.zeros(2), np.array([0.0, NORMAL]), "black")
    for point, normal, line in zip(points, normals, LINES[:1] * 2, strict=True):
        draw_arrow(axes, point, point + NORMAL * normal, line["color"])
    axes.plot([0.0], [0.0], "o", color="black", markersize=3.0, zorder=4)
    half, degrees = tip.location_uncertainty, math.degrees(tip.resolution)
    name = "flat tip" if tip.flat else f"round tip, radius {tip.fingertip_radius:g} mm"
    axes.set_title(f"{name}\nlocation ± {half:.3g} mm, normals " + rf"$\alpha$ = {degrees:.3g}°")
    axes.text(0.0, -0.7, f"receptive field\n{tip.receptive_field:.3g} mm",
              ha="center", va="center", fontsize=7.0)  # fmt: skip
    axes.set(xlim=(-1.3, 1.3), ylim=(-DEEP, 0.75))


def _flat(tip: Sensor, radius: float) -> tuple[Floats, Floats]:
    """Outline of a flat tip, and its receptive field, (k, 2) each, in radii."""
    outline = np.array([[-1.0, -DEEP], [-1.0, 0.0], [1.0, 0.0], [1.0, -DEEP]])
    return outline, field_ends(tip, radius)[0]


def _round(tip: Sensor, _: float) -> tuple[Floats, Floats]:
    """Outline of a round tip, and its receptive field, (k, 2) each, in radii."""
    turn = np.linspace(math.pi, 0.0, 65)
    arc = np.stack([np.cos(turn), np.sin(turn) - 1.0], axis=-1)
    outline = np.concatenate([[[-1.0, -DEEP]], arc, [[1.0, -DEEP]]])
    turn = np.linspace(UP - tip.tilt, UP + tip.tilt, 33)
    return outline, np.stack([np.cos(turn), np.sin(turn) - 1.0], axis=-1)


def _handles() -> list[Line2D]:
    perceived, extreme = (
        Line2D([], [], color=color, marker=r"$\rightarrow$", linestyle="none", markersize=9.0)
        for color in ("black", LINES[0]["color"])
    )
    perceived.set_label("perceived contact and normal")
    extreme.set_label("normals at the ends of the field")
    return [Line2D([], [], label="contacts not distinguished", **_FIELD), perceived, extreme]
