"""Figures 4 to 11 of Wan & Howe 2018, or parts of them.

Fig. 4 to 6 show what a fingertip cannot distinguish, and the friction cones. Fig. 7 to 11 show
epsilon along outlines, the fractions S, M and U, and ceilings of the accuracy.
"""

import math
from collections.abc import Sequence
from itertools import product
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Arc, Circle, Wedge

from grasp3d.arrays import ArrayLike, Bools, Bytes, Floats
from grasp3d.contact.sensor import Sensor
from grasp3d.pictures.figures import (
    COLUMN,
    LABEL_COLORS,
    LINES,
    PAGE,
    RESOLUTION,
    bare,
    draw_arrow,
    draw_ceiling,
    label_patches,
    new_figure,
    show_picture,
    stack_fractions,
    styled,
)
from grasp3d.planar import Circle as CircleOutline
from grasp3d.planar import PlanarScan, turn_between
from grasp3d.settings import GraspModel
from grasp3d.stability.label import Label
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.sweeps import Sweep

OBJECT, DARK, FIELD_END = "#F1F1F1", "#333333", LINES[0]["color"]
UP = math.pi / 2.0

TIP = 0.42
"""Radius of the drawn fingertip; the cones have length 1."""

TOLERATED = 1.0 / 3.0
"""Fraction of the tilt that the drawn grasp tolerates at both contacts; below 1 it is ambiguous.
"""

DEEP = 1.1
"""Depth to which fingertips are drawn, in radii of the round one."""
NORMAL = 0.62
"""Length of the drawn normals, in radii of the round tip."""

_PERCEIVED: dict[str, Any] = {"color": DARK, "linewidth": 0.8, "linestyle": (0, (3, 2))}
_ARROW: dict[str, Any] = {"marker": r"$\rightarrow$", "linestyle": "none", "markersize": 9.0}


@styled
def tips_figure(sensor: Sensor) -> Figure:
    """Draw the contacts that a flat and a round fingertip with equal fields cannot distinguish.

    Wan & Howe 2018, Fig. 4: on a flat tip only the location is uncertain, on a round one also the
    normal.

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
        model: Friction and sensor resolution; alpha / 2 below beta, their sum below 90 degrees.
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

    Wan & Howe 2018, Fig. 6: only in some combinations is the line between the contacts inside both
    cones, so the sensor cannot decide whether the grasp is stable.

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
    """Mask of the two cones that contain the line between their contacts, strictly, shape (2,).

    Args:
        points: The contacts, shape (2, 2).
        normals: Polar angles of the cones' axes [rad], shape (2,).
        friction_angle: Half-angle of the cones [rad].
    """
    apart = points[1] - points[0]
    toward = math.atan2(apart[1], apart[0]) + np.array([0.0, math.pi])
    return np.asarray(turn_between(normals, toward) < friction_angle)


def at_polar(radius: float, angle: float) -> Floats:
    """Point at a distance from the origin and at a polar angle [rad], shape (2,)."""
    return radius * np.array([math.cos(angle), math.sin(angle)])


def _draw_cone(
    axes: Axes, tip: Floats, axis: float, half_angle: float, color: str, linestyle: Any,
    *, length: float = 1.0, opacity: float = 0.22, label: str = "",
) -> None:  # fmt: skip
    """Draw a cone at a contact point (2,) as a wedge about a polar angle."""
    low, high = math.degrees(axis - half_angle), math.degrees(axis + half_angle)
    axes.add_patch(
        Wedge(
            (tip[0], tip[1]), length, low, high, facecolor=to_rgba(color, opacity),
            edgecolor=color, linestyle=linestyle, linewidth=0.9, label=label,
        )
    )  # fmt: skip


def _degrees(angle: float) -> str:
    return f"{math.degrees(angle):.3g}°"


_NOMINAL: dict[str, Any] = {"color": "black", "linewidth": 1.6}
_EFFECTIVE: dict[str, Any] = {"color": "#B0B0B0", "linewidth": 4.0}
_CLOSED_FORM: dict[str, Any] = {"color": "black", "linestyle": (0, (3, 2)), "linewidth": 1.0}


@styled
def curves_figure(scans: Sequence[PlanarScan]) -> Figure:
    """Draw a column for each scan: curves of epsilon, and below them bars of S, M and U.

    Args:
        scans: Scans of one outline at several resolutions; at least one.
    """
    figure = new_figure(PAGE, 3.5)
    grid = figure.subplots(
        2, len(scans), squeeze=False, sharex=True, sharey="row", height_ratios=(9.0, 1.0)
    )
    for (curves, bars), scan in zip(grid.T, scans, strict=True):
        _draw_epsilon(curves, scan)
        _draw_labels(bars, scan)
        model, cornered = scan.model, scan.at_corner.any()
        bars.set_xlabel(
            "perimeter from finger 1 to finger 2 [half sides]"
            if cornered
            else r"angle $\theta$ from finger 1 to finger 2 [°]"
        )
        title = (
            rf"{scan.outline.name}, $\mu$ = {model.nominal_friction:g}, "
            rf"$\alpha$ = {math.degrees(model.sensor_resolution):.4g}°"
        )
        if cornered:  # Sec. III-B: exterior angle + alpha
            span = 2.0 * scan.contacts.half_range.max() + model.sensor_resolution
            title += f"\nnormals at corners span {math.degrees(span):.4g}°"
        curves.set_title(title)
    grid[0, 0].set_ylabel(r"grasp quality $\epsilon$")
    handles = [one for axes in grid[:, 0] for one in axes.get_legend_handles_labels()[0]]
    figure.legend(handles=[*handles, *label_patches()], loc="outside lower center", ncols=3)
    return figure


def _draw_epsilon(axes: Axes, scan: PlanarScan) -> None:
    """Draw epsilon at the perceived normals, at the extreme ones, and at the effective friction.

    Curves are interrupted at corners, where the values are dots.
    """
    x, end = abscissas(scan)
    corners = scan.at_corner
    extremes = (
        (values, {**line, "label": f"extreme normals, tilts {signs}"})
        for values, line, signs in zip(
            scan.epsilon_extremes, LINES, ("+ +", "+ −", "− +", "− −"), strict=False
        )
    )
    for values, line in (
        (
            scan.epsilon_effective,
            {**_EFFECTIVE, "label": r"perceived normals, friction $\mu_\mathrm{eff}$"},
        ),
        *extremes,
        (scan.epsilon, {**_NOMINAL, "label": "perceived normals"}),
    ):
        axes.plot([*x, end], [*np.where(corners, math.nan, values), values[0]], **line)
        axes.plot(x[corners], values[corners], "o", color=line["color"], markersize=3.0)
    for corner in x[corners]:
        axes.axvline(corner, color="#555555", linewidth=0.9, linestyle=":", zorder=1)
    axes.set(xlim=(0.0, end), ylim=(0.0, None), xticks=np.linspace(0.0, end, 9))


def _draw_labels(axes: Axes, scan: PlanarScan) -> None:
    """Draw the labels along the perimeter as bars, and those of corners as squares."""
    (x, end), corners = abscissas(scan), scan.at_corner
    place, label = x[~corners], scan.label[~corners]
    first = np.flatnonzero(np.diff(label)) + 1
    bounds = np.concatenate([[0.0], 0.5 * (place[first - 1] + place[first]), [end]])
    bars = np.stack([bounds[:-1], np.diff(bounds)], axis=1).tolist()
    axes.broken_barh(bars, (0.0, 1.0), facecolors=_colors(label[np.append(0, first)]))
    if corners.any():
        axes.scatter(
            x[corners], np.full(corners.sum(), 0.5), 25.0, _colors(scan.label[corners]), marker="s",
            edgecolors="black", linewidths=0.7, clip_on=False, label="label of a corner",
        )  # fmt: skip
    axes.set(ylim=(0.0, 1.0), yticks=[])
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)


def _colors(labels: Bytes) -> list[str]:
    return [LABEL_COLORS[Label(label)] for label in labels]


def abscissas(scan: PlanarScan) -> tuple[Floats, float]:
    """Angles of the points of a circle [degrees], or positions on a square (k,); and their end."""
    if scan.at_corner.any():
        return scan.position, scan.outline.perimeter
    return np.degrees(scan.angle), 360.0


@styled
def fractions_figure(
    sweep: Sweep,
    label: str = "fraction of the perimeter",
    *,
    scans: Sequence[SurfaceLabels] = (),
    pictures: Sequence[Bytes] = (),
    closed_form: Sweep | None = None,
) -> Figure:
    """Draw fractions over the resolution (Wan & Howe 2018, Fig. 8 and 10), beside surfaces.

    Args:
        sweep: Fractions at one friction.
        label: Name of the fractions.
        scans: Labels of a surface at the resolution of each picture.
        pictures: Pictures of these surfaces, shape (h, w, 3) each; empty for only the fractions.
        closed_form: The same fractions in closed form, drawn over the others as lines.
    """
    count = len(pictures)
    figure = new_figure(PAGE if count else COLUMN, 2.75)
    grid = figure.subplots(1, count + 1, width_ratios=[1.0] * count + [1.12], squeeze=False)[0]
    axes, handles = grid[-1], list[Any](label_patches())
    stack_fractions(axes, sweep)
    axes.set(xlabel=RESOLUTION, ylabel=f"{label} [%]")
    axes.set_title(rf"{sweep.name}, $\mu$ = {sweep.friction[0]:g}")
    if closed_form is not None:
        bounds = np.stack([closed_form.stable[0], 1.0 - closed_form.unstable[0]], axis=1)
        degrees = np.degrees(closed_form.sensor_resolution)
        handles += axes.plot(degrees, 100.0 * bounds, label="closed form", **_CLOSED_FORM)[:1]
    for place, scan, picture in zip(grid, scans, pictures, strict=False):
        angle = math.degrees(scan.model.sensor_resolution)
        below = "   ".join(
            f"{name} {100.0 * part:.1f} %" for name, part in scan.fractions().items()
        )
        show_picture(place, picture, rf"$\alpha$ = {angle:.4g}°", below)
    if count:
        angles = [math.degrees(scan.model.sensor_resolution) for scan in scans]
        shown: dict[str, Any] = {"markersize": 4.0, "clip_on": False, "label": "shown"}
        handles += axes.plot(angles, [100.0] * count, "vk", **shown)
    columns = len(handles) if count else 2
    figure.legend(handles=handles, loc="outside lower center", ncols=columns)
    return figure


@styled
def ceiling_figure(sweeps: Sequence[Sweep]) -> Figure:
    """Draw the best accuracy of a learned predictor, S + U + M / 2 (Wan & Howe 2018, Fig. 11).

    Args:
        sweeps: Fractions of each object at one friction, the same for all.
    """
    figure = new_figure(COLUMN, 2.6)
    axes = figure.add_subplot()
    draw_ceiling(axes, sweeps)
    axes.set(xlabel=RESOLUTION, ylabel="best possible accuracy [%]")
    axes.set_title(rf"$\mu$ = {sweeps[0].friction[0]:g}")
    figure.legend(loc="outside lower center", ncols=len(sweeps))
    return figure
