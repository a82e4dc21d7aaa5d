"""Fig. 4 to 6 of Wan & Howe 2018: what a fingertip cannot distinguish, and the friction cones."""

import math
from itertools import product
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Arc, Circle, Wedge

from grasp3d.arrays import ArrayLike, Bools, Floats
from grasp3d.contact.sensor import Sensor
from grasp3d.pictures.figures import (
    COLUMN,
    LABEL_COLORS,
    LINES,
    PAGE,
    bare,
    draw_arrow,
    new_figure,
    styled,
)
from grasp3d.planar import Circle as CircleOutline
from grasp3d.planar import turn_between
from grasp3d.settings import GraspModel
from grasp3d.stability.label import Label

OBJECT, DARK, FIELD_END = "#F1F1F1", "#333333", LINES[0]["color"]
UP = math.pi / 2.0

TIP = 0.42
"""Radius of the drawn fingertip; the cones have length 1."""

TOLERATED = 1.0 / 3.0
"""Fraction of the tilt that the drawn grasp tolerates at both contacts: less than 1 is ambiguous.
"""

DEEP = 1.1
"""Depth to which fingertips are drawn, in radii of the round one."""
NORMAL = 0.62
"""Length of the drawn normals, in radii of the round tip."""

_PERCEIVED: dict[str, Any] = {"color": DARK, "linewidth": 0.8, "linestyle": (0, (3, 2))}
_ARROW: dict[str, Any] = {"marker": r"$\rightarrow$", "linestyle": "none", "markersize": 9.0}


@styled
def tips_figure(sensor: Sensor) -> Figure:
    """Draw which contacts a flat and a round fingertip of one receptive field cannot distinguish.

    Wan & Howe 2018, Fig. 4: on a flat tip only the location is uncertain, on a round one the normal
    as well.

    Args:
        sensor: Receptive field and radius of the round tip [mm].
    """
    figure, size = new_figure(PAGE, 2.9), sensor.receptive_field / sensor.fingertip_radius
    round_name = f"round tip, radius {sensor.fingertip_radius:g} mm"
    tips = {"flat tip": Sensor(size, math.inf), round_name: Sensor(size, 1.0)}  # in radii
    handles: list[Any] = []
    for axes, (name, tip) in zip(figure.subplots(1, 2), tips.items(), strict=True):
        bare(axes)
        edge, _ = tip_at(tip, np.linspace(-1.0, 1.0, 65) * (1.0 if tip.flat else UP))
        outline = np.array([[-1.0, -DEEP], *edge, [1.0, -DEEP]])
        axes.fill(*outline.T, facecolor=OBJECT, edgecolor=DARK, linewidth=0.9)
        field, _ = tip_at(tip, np.linspace(-0.5 * size, 0.5 * size, 33))
        handles = axes.plot(*field.T, color=LINES[1]["color"], linewidth=4.0)
        points, normals = tip_at(tip, [-0.5 * size, 0.0, 0.5 * size])
        for point, end, color in zip(
            points, points + NORMAL * normals, (FIELD_END, "black", FIELD_END), strict=True
        ):
            draw_arrow(axes, point, end, color)
        axes.set_title(
            f"{name}\nlocation ± {sensor.location_uncertainty:.3g} mm, normals "
            rf"$\alpha$ = {_degrees(tip.resolution)}"
        )
        axes.text(0.0, -0.7, f"receptive field\n{sensor.receptive_field:.3g} mm", ha="center")
    handles += [Line2D([], [], color=color, **_ARROW) for color in ("black", FIELD_END)]
    names = ("contacts not distinguished", "perceived normal", "normals at the ends of the field")
    figure.legend(handles, names, loc="outside lower center", ncols=3)
    return figure


def tip_at(tip: Sensor, arcs: ArrayLike) -> tuple[Floats, Floats]:
    """Points of a fingertip, relative to its middle, and the outward unit normals there.

    Args:
        tip: The fingertip; its normal in the middle is the y axis.
        arcs: Arc lengths from the middle, shape (k,).

    Returns:
        Points (k, 2), and normals (k, 2).
    """
    arc = np.asarray(arcs, dtype=np.float64)
    turn = arc / tip.fingertip_radius
    normals = np.stack([np.sin(turn), np.cos(turn)], axis=-1)
    if tip.flat:
        return np.stack([arc, np.zeros_like(arc)], axis=-1), normals
    return tip.fingertip_radius * (normals - [0.0, 1.0]), normals


@styled
def cone_figure(model: GraspModel) -> Figure:
    """Draw one contact: perceived and extreme normals, and the intersection of the extreme cones.

    Wan & Howe 2018, Fig. 5: the effective cone has the half-angle beta - alpha / 2.

    Args:
        model: Friction and sensor resolution, alpha / 2 below beta, both together below 90 degrees.
    """
    beta, tilt = model.friction_angle, model.tilt
    figure = new_figure(COLUMN, 3.1)
    axes = figure.add_subplot()
    bare(axes)
    axes.axhspan(0.0, 2.25, color=OBJECT, linewidth=0.0, zorder=0)
    axes.axhline(0.0, color=DARK, linewidth=1.0, zorder=1)
    axes.add_patch(Circle((0.0, -TIP), TIP, fill=False, edgecolor=DARK, linewidth=0.9))
    axes.text(0.0, -TIP, "fingertip", fontsize=7.0, ha="center", va="center")
    axes.text(-1.34, 2.1, "object", fontsize=7.0, va="center")
    axes.text(-1.34, -0.06, "perceived\nsurface", fontsize=7.0, va="top")
    origin = np.zeros(2)
    for line, turn in zip(LINES, (tilt, -tilt), strict=False):
        _draw_cone(axes, origin, UP + turn, beta, label="extreme cone", **line)
        draw_arrow(axes, origin, at_polar(1.65, UP + turn), line["color"], "extreme\nnormal")
    draw_arrow(axes, origin, at_polar(2.0, UP), "black", "perceived\nnormal")
    half = rf"effective cone, $\beta-\alpha/2$ = {_degrees(beta - tilt)}"
    _draw_cone(axes, origin, UP, beta - tilt, LABEL_COLORS[Label.S], "-", label=half, opacity=0.8)
    for name, radius, place, low, high in (
        (r"$\alpha/2$", 1.1, 1.26, UP - tilt, UP),
        (r"$\alpha/2$", 1.1, 1.26, UP, UP + tilt),
        (r"$\beta$", 0.8, 0.62, UP - tilt - beta, UP - tilt),
    ):
        ends = {"theta1": math.degrees(low), "theta2": math.degrees(high)}
        axes.add_patch(Arc((0.0, 0.0), 2.0 * radius, 2.0 * radius, color=DARK, zorder=4, **ends))
        x, y = at_polar(place, 0.5 * (low + high))
        axes.text(x, y, f"{name}\n{_degrees(high - low)}", fontsize=6.5, ha="center", va="center")
    axes.set(xlim=(-1.4, 1.4), ylim=(-0.9, 2.25))
    figure.legend(loc="outside lower center", ncols=2, fontsize=7.0)
    return figure


@styled
def combinations_figure(model: GraspModel) -> Figure:
    """Draw one grasp of a circle under the four combinations of extreme normals.

    Wan & Howe 2018, Fig. 6: in some combinations the line between the contacts is inside both
    cones, in others it is not, so the sensor cannot decide whether the grasp is stable.

    Args:
        model: As in `cone_figure`.
    """
    off = model.friction_angle - TOLERATED * model.tilt  # between line and perceived normals
    contacts = CircleOutline().contacts_at([off, math.pi - off])
    points, perceived = contacts.points, contacts.middle
    figure = new_figure(COLUMN, 4.3)
    for axes, signs in zip(figure.subplots(2, 2).flat, product((1, -1), repeat=2), strict=True):
        bare(axes)
        axes.add_patch(Circle((0.0, 0.0), 1.0, facecolor=OBJECT, edgecolor=DARK, linewidth=0.9))
        tilted = perceived + np.array(signs) * model.tilt
        for number, (point, normal, angle, line) in enumerate(
            zip(points, perceived, tilted, LINES, strict=False), start=1
        ):
            _draw_cone(axes, point, angle, model.friction_angle, length=0.8, **line)
            axes.plot(*np.transpose([point, point + at_polar(0.75, normal)]), **_PERCEIVED)
            draw_arrow(axes, point, point + at_polar(0.95, angle), line["color"])
            x, y = point - at_polar(0.17, normal)
            axes.text(x, y, str(number), color="white", fontsize=6.5, ha="center", va="center",
                      bbox={"boxstyle": "circle", "facecolor": DARK})  # fmt: skip
        inside = cones_with_line(points, tilted, model.friction_angle)
        color = LABEL_COLORS[Label.S if inside.all() else Label.U]
        axes.plot(*points.T, color=color, linewidth=1.8, zorder=4)
        outside = " and ".join(str(number + 1) for number in np.flatnonzero(~inside))
        where = f"outside cone {outside}:\nnot " if outside else "in both cones:\n"
        axes.set_title(f"line {where}stable", fontsize=7.5)
    figure.legend(
        [Line2D([], [], **_PERCEIVED), Line2D([], [], color=DARK, **_ARROW)],
        ["perceived normal", "extreme normal"],
        loc="outside lower center",
        ncols=2,
    )
    return figure


def cones_with_line(points: Floats, normals: Floats, friction_angle: float) -> Bools:
    """Mask of the two cones that have the line between their contacts strictly inside, shape (2,).

    Args:
        points: The contacts, shape (2, 2).
        normals: Polar angles of the cones' axes [rad], shape (2,).
        friction_angle: Their half-angle [rad].
    """
    apart = points[1] - points[0]
    toward = math.atan2(apart[1], apart[0]) + np.array([0.0, math.pi])
    return np.asarray(turn_between(normals, toward) < friction_angle)


def at_polar(radius: float, angle: float) -> Floats:
    """Point at a distance from the origin and a polar angle [rad], shape (2,)."""
    return radius * np.array([math.cos(angle), math.sin(angle)])


def _draw_cone(
    axes: Axes, tip: Floats, axis: float, half_angle: float, color: str, linestyle: Any,
    *, length: float = 1.0, opacity: float = 0.22, label: str = "",
) -> None:  # fmt: skip
    """Draw a cone at a contact point (2,), about a polar angle, as a wedge."""
    low, high = math.degrees(axis - half_angle), math.degrees(axis + half_angle)
    axes.add_patch(
        Wedge(
            (tip[0], tip[1]), length, low, high, facecolor=to_rgba(color, opacity),
            edgecolor=color, linestyle=linestyle, linewidth=0.9, label=label,
        )
    )  # fmt: skip


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):.3g}°"
