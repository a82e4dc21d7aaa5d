"""Draw the paper's circle and square, labelled by where the second finger is.

    python scripts/make_planar_picture.py -o docs/planar.png

One finger is fixed (the arrow); the outline has the colour of the label of the grasp with the other
finger there. The numbers are fractions of the perimeter in closed form.
"""

import argparse
import math
from itertools import pairwise
from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from grasp3d import GraspModel, Label
from grasp3d.planar import Circle, Outline, scan, square
from grasp3d.plots.style import LABEL_COLORS, Drawing, bare, label_patches, new_figure, styled

FRICTION = 0.5
RESOLUTIONS = (0.0, 10.0, 22.6, 40.0, 60.0)
POINTS = 1440
OUTLINES = (Circle(), square())


def draw(axes: Axes, outline: Outline, degrees: float) -> None:
    """Draw an outline in the colours of its labels."""
    model = GraspModel(friction=FRICTION, sensor_resolution=math.radians(degrees))
    found = scan(outline, model, points=POINTS)
    bare(axes)
    axes.fill(*found.points.T, color="#F1F1F1")
    ends = np.concatenate([found.points, found.points[:1]])
    first = np.flatnonzero(np.diff(found.label, prepend=255))
    for start, end in pairwise([*first.tolist(), len(found.label)]):
        color = LABEL_COLORS[Label(found.label[start])]
        axes.plot(*ends[start : end + 1].T, color=color, linewidth=4.0, solid_capstyle="butt")
    point = found.points[0]
    inward = np.array([0.0, 0.45])
    axes.annotate(
        "", point + inward, point - inward, arrowprops={"arrowstyle": "-|>", "color": "#333333"}
    )
    fractions = outline.fractions(friction=FRICTION, sensor_resolution=model.sensor_resolution)
    text = "\n".join(f"{name} {100.0 * part:.0f} %" for name, part in fractions.items())
    axes.text(0.0, 0.15, text, ha="center", va="center")
    axes.set(xlim=(-1.2, 1.2), ylim=(-1.5, 1.15))


@styled
def figure() -> Drawing:
    """Lay out the outlines in rows, the resolutions in columns."""
    drawing = new_figure(1.45 * len(RESOLUTIONS), 1.62 * len(OUTLINES) + 0.4)
    grid = drawing.subplots(len(OUTLINES), len(RESOLUTIONS))
    for row, outline in zip(grid, OUTLINES, strict=True):
        for axes, degrees in zip(row, RESOLUTIONS, strict=True):
            draw(axes, outline, degrees)
    for axes, degrees in zip(grid[0], RESOLUTIONS, strict=True):
        axes.set_title(f"α = {degrees:g}°")
    drawing.legend(handles=label_patches(), loc="outside lower center", ncols=3)
    return drawing


def main() -> None:
    """Draw and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("planar.png"))
    figure().savefig(parser.parse_args().output, dpi=140, bbox_inches="tight", pad_inches=0.05)


if __name__ == "__main__":
    main()
