"""Draw the limit surface of a soft finger: what a pad's friction resists at a given normal force.

    python scripts/make_limit_surface_picture.py -o docs/limit_surface.png

The surface is the ellipse of Howe & Cutkosky, as grip forces take it, with the linear hull inside
it that epsilon takes, and beside them that of an evenly pressed disc, integrated.
"""

import argparse
import math
from pathlib import Path

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Polygon

from grasp3d.plots.style import Drawing, new_figure, styled

ELLIPSE, HULL, DISC = "#0072B2", "#D55E00", "#111111"
MOMENT = 0.6
"""Torsional moment at which the friction circles are compared, as a fraction of the largest."""
GRID = 400
"""Steps of the integrals over a disc along its radius, and half of those around it."""
CENTERS = np.array([0.0, 0.1, 0.25, 0.5, 0.75, 1.0, 1.3, 1.8, 3.0, 8.0])
"""Distances of the centre of rotation from the disc's, in radii."""
OFFSET = 1.18
"""Height of a text above the middle."""

Numbers = npt.NDArray[np.float64]


def disc(centers: Numbers) -> tuple[Numbers, Numbers]:
    """Friction force and moment of an evenly pressed disc that begins to turn about points.

    Every part of the disc has its full friction, opposite to its velocity.

    Args:
        centers: Distances of the points from the disc's centre, in radii.

    Returns:
        Tangential force and moment, as fractions of their largest values.
    """
    radius, around = np.meshgrid(
        (np.arange(GRID) + 0.5) / GRID, (np.arange(2 * GRID) + 0.5) * math.pi / GRID
    )
    x, y = radius * np.cos(around), radius * np.sin(around)
    area = radius / radius.sum()
    forces, moments = [], []
    for center in centers:
        along = x - center  # component of the velocity across the line to the centre of rotation
        speed = np.hypot(along, y)
        forces.append(abs((area * along / speed).sum()))
        moments.append(abs((area * (x * along + y * y) / speed).sum()))
    return np.array(forces), np.array(moments) / (2.0 / 3.0)


def draw_section(axes: Axes) -> None:
    """Draw tangential force against torsional moment."""
    turn = np.linspace(0.0, 2.0 * math.pi, 200)
    axes.plot(np.cos(turn), np.sin(turn), color=ELLIPSE)
    axes.fill(np.cos(turn), np.sin(turn), color=ELLIPSE, alpha=0.08)
    axes.add_patch(Polygon([(1, 0), (0, 1), (-1, 0), (0, -1)], fill=False, edgecolor=HULL))
    force, moment = disc(CENTERS)
    for signs in ((1, 1), (1, -1), (-1, 1), (-1, -1)):
        axes.plot(signs[0] * force, signs[1] * moment, "o", color=DISC, markersize=2.5)
    axes.axhline(MOMENT, color="#888888", linewidth=0.8, linestyle=(0, (4, 2)))
    axes.set(title="section", xlabel="tangential force / μ$f_n$", ylabel="moment / e$f_n$")


def draw_circles(axes: Axes) -> None:
    """Draw the tangential forces that are left beside no moment, and beside a moment."""
    turn = np.linspace(0.0, 2.0 * math.pi, 200)
    circle = np.stack([np.cos(turn), np.sin(turn)])
    left = math.sqrt(1.0 - MOMENT**2)
    axes.plot(*circle, color="#888888", linewidth=0.9)
    axes.plot(*(left * circle), color=ELLIPSE, linestyle=(0, (4, 2)))
    axes.plot(*((1.0 - MOMENT) * circle), color=HULL, linestyle=(0, (4, 2)))
    for radius, text in ((1.0, "no moment"), (left, f"{left:.1f}"), (1.0 - MOMENT, "0.4")):
        axes.text(0.0, radius - 0.03, text, ha="center", va="top", fontsize=7)
    axes.set(
        title=f"forces beside {MOMENT:g} of the moment",
        xlabel="tangential force / μ$f_n$",
    )


def draw_solid(drawing: Figure, number: int) -> None:
    """Draw both surfaces in space."""
    axes = drawing.add_subplot(1, 3, number, projection="3d", computed_zorder=False)
    turn, height = np.meshgrid(np.linspace(0.0, 2.0 * math.pi, 49), np.linspace(-1.0, 1.0, 25))
    for color, radius, alpha in (
        (HULL, 1.0 - np.abs(height), 0.9),
        (ELLIPSE, np.sqrt(1.0 - height**2), 0.22),
    ):
        x, y = radius * np.cos(turn), radius * np.sin(turn)
        axes.plot_surface(x, y, height, color=color, alpha=alpha, linewidth=0, shade=True)
    circle = np.linspace(0.0, 2.0 * math.pi, 100)
    axes.plot(np.cos(circle), np.sin(circle), np.zeros(100), color="#333333", linewidth=0.8)
    axes.view_init(elev=18.0, azim=-60.0)
    axes.set_box_aspect((1, 1, 1), zoom=1.25)
    axes.set_axis_off()
    axes.set_title("limit surface at one normal force")
    axes.text(0, 0, OFFSET, "moment", ha="center", va="center", fontsize=8)
    axes.text2D(0.5, 0.06, "across: tangential force", ha="center", transform=axes.transAxes)


@styled
def figure() -> Drawing:
    """Lay out the solid, its section and the circles."""
    drawing = new_figure(7.16, 2.9)
    draw_solid(drawing, 1)
    for number, draw in ((2, draw_section), (3, draw_circles)):
        axes = drawing.add_subplot(1, 3, number)
        draw(axes)
        axes.set(xlim=(-1.15, 1.15), ylim=(-1.15, 1.15), aspect="equal", xticks=[-1, 0, 1],
                 yticks=[-1, 0, 1])  # fmt: skip
    handles = [
        Line2D([], [], color=ELLIPSE, label="ellipse: grip forces"),
        Line2D([], [], color=HULL, label="linear hull: epsilon"),
        Line2D([], [], color=DISC, marker="o", markersize=2.5, linestyle="none",
               label="evenly pressed disc, e = 2/3 μ r"),
    ]  # fmt: skip
    drawing.legend(handles=handles, loc="outside lower center", ncols=3)
    return drawing


def main() -> None:
    """Draw and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("limit_surface.png"))
    figure().savefig(parser.parse_args().output, dpi=140)


if __name__ == "__main__":
    main()
