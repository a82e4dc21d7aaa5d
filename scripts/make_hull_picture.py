"""Draw how the growing hull finds epsilon, step by step.

    python scripts/make_hull_picture.py -o docs/hull.png

The wrench space is that of three planar contacts, of which only the two force components are
drawn, so that facets are edges. The steps are those of the kernel: it is stopped each time when it
has reached a number of vertices.
"""

import argparse
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Circle

from grasp3d._kernels.hull.growing_hull import AROUND_ORIGIN, grow
from grasp3d._kernels.hull.polytope import Polytope, make_polytope
from grasp3d._kernels.hull.support_functions import NO_TORSION, ROWS, WrenchSpace
from grasp3d.plots.style import Drawing, new_figure, styled

DIRECTIONS = np.radians([80.0, 205.0, 310.0])
"""Inward normals of the contacts, as polar angles."""
FRICTION_ANGLE = math.radians(20.0)
FORCES = 25
"""Forces by which the arc of a cone is drawn."""
SIMPLEX = 3
"""Vertices of the first polytope, a triangle."""
PLANE = (0, 0)
"""As long as the wrenches have components: two."""
GOAL = (0.0, 0.0, math.inf, 0.0)

SPACE, HULL, NEAR, POINT = "#D9DEE3", "#0072B2", "#D55E00", "#111111"


class Step(NamedTuple):
    """The polytope before its nearest facet is replaced."""

    facets: npt.NDArray[np.float64]
    """Ends of the edges, shape (f, 2, 2)."""
    nearest: int
    normal: npt.NDArray[np.float64]
    """Outward unit normal of the nearest facet, shape (2,)."""
    distance: float
    height: float
    """Support of the wrench space in the direction of the normal."""
    point: npt.NDArray[np.float64]
    """Wrench that attains it, shape (2,)."""


def cones() -> npt.NDArray[np.float64]:
    """Unit forces of the three contacts, shape (3 * FORCES, 2)."""
    turn = DIRECTIONS[:, None] + np.linspace(-FRICTION_ANGLE, FRICTION_ANGLE, FORCES)
    return np.stack([np.cos(turn), np.sin(turn)], axis=-1).reshape(-1, 2)


def grown(wrenches: npt.NDArray[np.float64], vertices: int) -> tuple[Polytope, float, float]:
    """The kernel's polytope of at most so many vertices, and the bounds of epsilon."""
    whole = make_polytope(256)
    polytope = whole._replace(points=whole.points[:vertices])
    axes = np.zeros((1, 6, len(wrenches)))
    axes[0, :2] = wrenches.T
    space = WrenchSpace(
        kind=ROWS, spherical=True, torsion=NO_TORSION, axes=axes, cones=np.ones((1, 2)),
        rim=np.zeros((0, 2)),
    )  # fmt: skip
    metric = np.array([1.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    _, lower, upper, _, _ = grow(space, PLANE, metric, None, AROUND_ORIGIN, GOAL, polytope)
    return polytope, lower, upper


def step(wrenches: npt.NDArray[np.float64], polytope: Polytope) -> Step:
    """Read the facets of a polytope, and find the support at the nearest."""
    planes, corners = polytope.planes, polytope.corners
    present = np.flatnonzero((planes[:2] != 0.0).any(axis=0) & ~np.isnan(planes[6]))
    facets = polytope.points[corners[present, :2]][..., :2]
    nearest = int(planes[6, present].argmin())
    normal = planes[:2, present[nearest]]
    heights = wrenches @ normal
    return Step(
        facets, nearest, normal, float(planes[6, present[nearest]]), float(heights.max()),
        wrenches[heights.argmax()],
    )  # fmt: skip


def draw(axes: Axes, wrenches: npt.NDArray[np.float64], shown: Step, upper: float) -> None:
    """Draw one step, with the bounds of epsilon known after it."""
    axes.fill(*wrenches.T, color=SPACE, zorder=0)
    for facet in shown.facets:
        axes.plot(*facet.T, color=HULL, linewidth=1.4)
    axes.plot(*shown.facets[shown.nearest].T, color=NEAR, linewidth=2.6)
    axes.add_patch(Circle((0.0, 0.0), shown.distance, fill=False, color=NEAR, linewidth=0.8))
    axes.plot(0.0, 0.0, "+", color=POINT, markersize=6)
    along = np.array([-shown.normal[1], shown.normal[0]])
    line = shown.height * shown.normal + np.outer([-0.6, 0.6], along)
    axes.plot(*line.T, color=POINT, linewidth=0.9, linestyle=(0, (4, 2)))
    found = shown.height - shown.distance < 1e-9
    if not found:
        axes.plot(*shown.point, "o", color=POINT, markersize=4.5)
    lower = f"{shown.distance:.3f}"
    axes.set_title(f"ε = {lower}" if found else f"{lower} ≤ ε ≤ {upper:.3f}")
    axes.set(xlim=(-1.2, 1.1), ylim=(-1.1, 1.15), xticks=[], yticks=[], aspect="equal")
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)


@styled
def figure() -> Drawing:
    """Lay out the steps until the nearest facet is one of the wrench space."""
    wrenches, steps = cones(), []
    for vertices in range(SIMPLEX, len(wrenches)):
        steps.append(step(wrenches, grown(wrenches, vertices)[0]))
        if steps[-1].height - steps[-1].distance < 1e-9:
            break
    _, lower, _ = grown(wrenches, len(wrenches))
    assert math.isclose(lower, steps[-1].distance)
    drawing = new_figure(1.75 * len(steps), 2.1)
    bounds = np.minimum.accumulate([shown.height for shown in steps])
    for axes, shown, upper in zip(
        drawing.subplots(1, len(steps)), steps, bounds.tolist(), strict=True
    ):
        draw(axes, wrenches, shown, upper)
    handles = [
        Line2D([], [], color=SPACE, linewidth=6, label="grasp wrench space"),
        Line2D([], [], color=HULL, label="polytope inside it"),
        Line2D([], [], color=NEAR, linewidth=2.6, label="nearest facet"),
        Line2D([], [], color=POINT, linewidth=0.9, linestyle=(0, (4, 2)),
               label="support in its direction"),
        Line2D([], [], color=POINT, marker="o", markersize=4.5, linestyle="none",
               label="new vertex"),
    ]  # fmt: skip
    drawing.legend(handles=handles, loc="outside lower center", ncols=len(handles))
    return drawing


def main() -> None:
    """Draw and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("hull.png"))
    figure().savefig(parser.parse_args().output, dpi=140, bbox_inches="tight", pad_inches=0.05)


if __name__ == "__main__":
    main()
