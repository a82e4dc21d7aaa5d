"""Drawings of what a fingertip cannot distinguish: contacts, normals and their friction cones."""

import math
from itertools import product
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Arc, Circle, FancyArrowPatch, Patch, Wedge

from grasp3d.arrays import Bools, Floats
from grasp3d.contact.sensor import Sensor
from grasp3d.errors import SettingError
from grasp3d.pictures.figures import COLUMN, LABEL_COLORS, LINES, PAGE, bare, new_figure, styled
from grasp3d.planar import Circle as CircleOutline
from grasp3d.planar import turn_between
from grasp3d.settings import GraspModel
from grasp3d.stability.label import Label

OBJECT, DARK = "#F1F1F1", "#333333"
UP = math.pi / 2.0

TIP = 0.42
"""Radius of the drawn fingertip; the cones have length 1."""
OPACITY = 0.22
"""Opacity of the drawn cones."""
SIDES = LINES[:2]
"""Line styles of the two extreme cones, or of the cones of two fingers."""

TOLERATED = 1.0 / 3.0
"""Fraction of the tilt that the drawn grasp tolerates at both contacts: less than 1 is ambiguous.
"""

_PERCEIVED: dict[str, Any] = {"color": DARK, "linewidth": 0.8, "linestyle": (0, (3, 2))}

_ARROW: dict[str, Any] = {"marker": r"$\rightarrow$", "linestyle": "none", "markersize": 9.0}

_RESULTS = {
    (True, True): "line in both cones:\nstable",
    (True, False): "line outside cone 2:\nnot stable",
    (False, True): "line outside cone 1:\nnot stable",
    (False, False): "line outside both cones:\nnot stable",
}


TIPS_HEIGHT = 2.9
"""Of the figure [inch]."""
DEEP = 1.1
"""Depth to which fingertips are drawn, in radii of the round one."""
NORMAL = 0.62
"""Length of the drawn normals, in radii of the round tip."""
_FIELD: dict[str, Any] = {
    "color": LINES[1]["color"], "linewidth": 4.0, "solid_capstyle": "butt", "zorder": 3,
}  # fmt: skip
_OUTLINE: dict[str, Any] = {"color": DARK, "linewidth": 0.9}


@styled
def cone_figure(model: GraspModel) -> Figure:
    """Draw one contact: perceived and extreme normals, and the intersection of the extreme cones.

    Wan & Howe 2018, Fig. 5: the effective cone has the half-angle beta - alpha / 2.

    Args:
        model: Friction and sensor resolution.

    Raises:
        SettingError: The extreme cones do not intersect, or do not fit above the surface.
    """
    check_drawable(model)
    beta, tilt = model.friction_angle, model.tilt
    figure = new_figure(COLUMN, 2.75)
    axes = figure.add_subplot()
    bare(axes)
    _contact(axes)
    for sign, line in zip((1.0, -1.0), SIDES, strict=True):
        draw_cone(axes, np.zeros(2), UP + sign * tilt, beta, **line)
    draw_cone(axes, np.zeros(2), UP, beta - tilt, LABEL_COLORS[Label.S], "-", opacity=0.8)
    _name_normals(axes, tilt)
    _name_angles(axes, beta, tilt)
    axes.set(xlim=(-1.4, 1.4), ylim=(-0.62, 1.9))
    figure.legend(
        handles=_handles(), loc="outside lower center", ncols=3, columnspacing=1.0,
        handlelength=1.8, fontsize=7.0,
    )  # fmt: skip
    return figure


def check_drawable(model: GraspModel) -> None:
    """Check that the extreme cones intersect in a cone, and that all lie above the surface.

    Raises:
        SettingError: They do not.
    """
    beta, tilt = model.friction_angle, model.tilt
    if not 0.0 < tilt < beta or beta + tilt >= UP:
        raise SettingError(
            "drawings of cones need alpha/2 above 0 and below atan(friction), and their sum below "
            f"90 degrees; got alpha/2 = {math.degrees(tilt):.4g} degrees and atan(friction) = "
            f"{math.degrees(beta):.4g} degrees"
        )


def draw_cone(
    axes: Axes,
    tip: Floats,
    axis: float,
    half_angle: float,
    color: str,
    linestyle: Any,
    *,
    length: float = 1.0,
    opacity: float = OPACITY,
) -> None:
    """Draw a cone as a wedge.

    Args:
        axes: Axes to draw on.
        tip: Contact point, shape (2,).
        axis: Polar angle of the cone's axis [rad].
        half_angle: Half-angle of the cone [rad].
        color: Color of the wedge and its outline.
        linestyle: Line style of the outline.
        length: Length of the sides.
        opacity: Opacity of the wedge.
    """
    low, high = math.degrees(axis - half_angle), math.degrees(axis + half_angle)
    inside, rim = (Wedge((tip[0], tip[1]), length, low, high) for _ in range(2))
    inside.set(facecolor=color, alpha=opacity, linewidth=0.0)
    rim.set(fill=False, edgecolor=color, linestyle=linestyle, linewidth=0.9)
    axes.add_patch(inside)
    axes.add_patch(rim)


def draw_arrow(axes: Axes, start: Floats, end: Floats, color: str) -> None:
    """Draw an arrow from one point (2,) to another."""
    ends = (float(start[0]), float(start[1])), (float(end[0]), float(end[1]))
    shape = FancyArrowPatch(*ends, arrowstyle="-|>", mutation_scale=7.0, shrinkA=0.0, shrinkB=0.0)
    shape.set(color=color, linewidth=1.1, zorder=3)
    axes.add_patch(shape)


def at_polar(radius: float, angle: float) -> Floats:
    """Point at a distance from the origin and a polar angle [rad], shape (2,)."""
    return radius * np.array([math.cos(angle), math.sin(angle)])


def _contact(axes: Axes) -> None:
    """Draw the perceived surface, the object above it, and the fingertip that touches it."""
    axes.axhspan(0.0, 1.9, color=OBJECT, linewidth=0.0, zorder=0)
    axes.axhline(0.0, color=DARK, linewidth=1.0, zorder=1)
    turn = np.linspace(0.0, math.pi, 49)
    x, y = np.cos(turn), np.sin(turn) - 1.0
    outline = TIP * np.array([[1.0, *x, -1.0], [-2.0, *y, -2.0]])
    axes.plot(*outline, color=DARK, linewidth=0.9)
    axes.text(0.0, -0.36, "fingertip", ha="center", va="center", fontsize=7.0)
    axes.text(-1.34, 1.84, "object", va="top", color=DARK, fontsize=7.0)
    axes.text(-1.34, -0.06, "perceived\nsurface", va="top", color=DARK, fontsize=7.0)


def _name_normals(axes: Axes, tilt: float) -> None:
    for angle, color, name, side in (
        (UP, "black", "perceived\nnormal", "center"),
        (UP + tilt, SIDES[0]["color"], "extreme\nnormal", "right"),
        (UP - tilt, SIDES[1]["color"], "extreme\nnormal", "left"),
    ):
        draw_arrow(axes, np.zeros(2), at_polar(1.5, angle), color)
        x, y = at_polar(1.54, angle)
        axes.text(x, y, name, color=color, ha=side, va="bottom", fontsize=7.0)


def _name_angles(axes: Axes, beta: float, tilt: float) -> None:
    for low, high in ((UP - tilt, UP), (UP, UP + tilt)):
        _angle(axes, 1.1, low, high)
        _write_angle(axes, at_polar(1.26, 0.5 * (low + high)), r"$\alpha/2$", tilt)
    _angle(axes, 0.8, UP - tilt - beta, UP - tilt)
    _write_angle(axes, at_polar(0.64, UP - beta), r"$\beta$", beta)
    _angle(axes, 0.5, UP, UP + beta - tilt)
    axes.annotate(
        rf"$\beta-\alpha/2$ = {math.degrees(beta - tilt):.3g}°",
        xy=tuple(at_polar(0.5, UP + 0.75 * (beta - tilt))),
        xytext=(-1.34, 0.16),
        fontsize=6.5,
        arrowprops={
            "arrowstyle": "->",
            "color": DARK,
            "linewidth": 0.6,
            "shrinkB": 0.0,
            "mutation_scale": 6.0,
        },
    )


def _angle(axes: Axes, radius: float, low: float, high: float) -> None:
    ends = math.degrees(low), math.degrees(high)
    shape = Arc((0.0, 0.0), 2.0 * radius, 2.0 * radius, theta1=ends[0], theta2=ends[1])
    shape.set(color=DARK, linewidth=0.7, zorder=4)
    axes.add_patch(shape)


def _write_angle(axes: Axes, position: Floats, name: str, angle: float) -> None:
    x, y = position
    text = f"{name}\n{math.degrees(angle):.3g}°"
    axes.text(x, y, text, ha="center", va="center", fontsize=6.5, linespacing=1.0, zorder=5)


def _handles() -> list[Patch]:
    effective = Patch(facecolor=LABEL_COLORS[Label.S], alpha=0.8, label="effective cone")
    extreme = [Patch(edgecolor=line["color"], linestyle=line["linestyle"]) for line in SIDES]
    for patch in extreme:
        patch.set(facecolor=to_rgba(patch.get_edgecolor(), OPACITY), label="extreme cone")
    return [effective, *extreme]


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
    off = model.friction_angle - TOLERATED * model.tilt  # between line and perceived normals
    contacts = CircleOutline().contacts_at([off, math.pi - off])
    figure = new_figure(COLUMN, 4.3)
    for axes, signs in zip(figure.subplots(2, 2).flat, product((1, -1), repeat=2), strict=True):
        _combination(axes, contacts.points, contacts.first, np.array(signs), model)
    figure.legend(handles=_combination_handles(), loc="outside lower center", ncols=2)
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
    return np.asarray(turn_between(normals, toward) < friction_angle)


def _combination_handles() -> list[Line2D]:
    return [
        Line2D([], [], label="perceived normal", **_PERCEIVED),
        Line2D([], [], color=DARK, label="extreme normal", **_ARROW),
        Line2D([], [], color=LABEL_COLORS[Label.S], linewidth=1.8, label="line in both cones"),
        Line2D([], [], color=LABEL_COLORS[Label.U], linewidth=1.8, label="line outside a cone"),
    ]


@styled
def tips_figure(sensor: Sensor) -> Figure:
    """Draw which contacts a flat and a round fingertip of one receptive field cannot distinguish.

    Wan & Howe 2018, Fig. 4: on a flat tip only the location is uncertain, on a round one the normal
    as well.

    Args:
        sensor: Receptive field and radius of the round tip [mm].
    """
    figure = new_figure(PAGE, TIPS_HEIGHT)
    flat = Sensor(sensor.receptive_field, math.inf)
    for axes, tip in zip(figure.subplots(1, 2), (flat, sensor), strict=True):
        _draw_tip(axes, tip, sensor.fingertip_radius)
    figure.legend(handles=_tip_handles(), loc="outside lower center", ncols=4)
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
    outline, field = (_flat_tip if tip.flat else _round_tip)(tip, radius)
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


def _flat_tip(tip: Sensor, radius: float) -> tuple[Floats, Floats]:
    """Outline of a flat tip, and its receptive field, (k, 2) each, in radii."""
    outline = np.array([[-1.0, -DEEP], [-1.0, 0.0], [1.0, 0.0], [1.0, -DEEP]])
    return outline, field_ends(tip, radius)[0]


def _round_tip(tip: Sensor, _: float) -> tuple[Floats, Floats]:
    """Outline of a round tip, and its receptive field, (k, 2) each, in radii."""
    turn = np.linspace(math.pi, 0.0, 65)
    arc = np.stack([np.cos(turn), np.sin(turn) - 1.0], axis=-1)
    outline = np.concatenate([[[-1.0, -DEEP]], arc, [[1.0, -DEEP]]])
    turn = np.linspace(UP - tip.tilt, UP + tip.tilt, 33)
    return outline, np.stack([np.cos(turn), np.sin(turn) - 1.0], axis=-1)


def _tip_handles() -> list[Line2D]:
    return [
        Line2D([], [], label="contacts not distinguished", **_FIELD),
        Line2D([], [], color="black", label="perceived contact and normal", **_ARROW),
        Line2D([], [], **LINES[0] | _ARROW, label="normals at the ends of the field"),
    ]
