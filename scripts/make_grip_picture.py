"""Render one object labelled for different grippers, and the coarsest sensor for each.

    python scripts/make_grip_picture.py -o docs/grips.png

Above the labels, below the coarsest resolution at which each vertex is still surely stable. Needs
OpenGL (EGL or a display).
"""

import argparse
import math
from pathlib import Path

import matplotlib as mpl
import numpy as np

from grasp3d import (
    GraspModel,
    MultifingerSampling,
    Sampling,
    SurfaceLabels,
    label_surface,
    load_mesh,
)
from grasp3d.plots.painting import paint_labels
from grasp3d.plots.rendering import View, picture
from grasp3d.plots.style import Drawing, label_patches, new_figure, styled
from grasp3d.stability.label import MEANING

OBJECT = Path(__file__).parents[1] / "meshes" / "bottle.off"
MODEL = GraspModel(friction=0.3, sensor_resolution=math.radians(20.0))
GRIPPERS: dict[str, tuple[int, Sampling]] = {
    "two fingers, up to 60 mm": (2, Sampling(max_opening=0.06)),
    "two fingers, up to 80 mm": (2, Sampling(max_opening=0.08)),
    "two fingers, any width": (2, Sampling()),
    "three fingers, up to 80 mm": (3, MultifingerSampling(max_spread=0.08)),
}
COARSEST = 2.0 * MODEL.friction_angle
FINENESS = 1.0 / 100.0
"""Longest edge as a fraction of the object's size."""
PIXELS = (520, 760)


def labelled(fingers: int, sampling: Sampling) -> SurfaceLabels:
    """Label the object for a gripper."""
    mesh = load_mesh(OBJECT, unit="m", max_edge=load_mesh(OBJECT).size * FINENESS)
    model = GraspModel(
        friction=MODEL.friction, sensor_resolution=MODEL.sensor_resolution, fingers=fingers
    )
    return label_surface(mesh, model, sampling=sampling)


@styled
def figure(view: View) -> Drawing:
    """Lay out a column for each gripper."""
    drawing = new_figure(1.75 * len(GRIPPERS) + 0.4, 5.4)
    grid = drawing.subplots(2, len(GRIPPERS))
    for axes, (title, (fingers, sampling)) in zip(grid.T, GRIPPERS.items(), strict=True):
        labels = labelled(fingers, sampling)
        mesh = labels.mesh
        relative = labels.max_resolution / COARSEST
        colors = (255.0 * mpl.colormaps["viridis"](relative)[:, :3]).astype(np.uint8)
        axes[0].imshow(paint_labels(labels, view=view, size=PIXELS))
        axes[1].imshow(picture(mesh.vertices, mesh.faces, colors, view=view, size=PIXELS))
        axes[0].set_title(title)
        parts = labels.fractions().items()
        axes[0].set_xlabel("  ".join(f"{name} {100.0 * part:.0f} %" for name, part in parts))
        for axis in axes:
            axis.set(xticks=[], yticks=[])
            axis.grid(visible=False)
            axis.spines[:].set_visible(False)
    scale = mpl.cm.ScalarMappable(mpl.colors.Normalize(0.0, math.degrees(COARSEST)), "viridis")
    bar = drawing.colorbar(scale, ax=grid[1], shrink=0.8, format="%g°", label="coarsest α for S")
    bar.ax.grid(visible=False)
    drawing.legend(handles=label_patches(MEANING["label"]), loc="outside lower center", ncols=3)
    return drawing


def main() -> None:
    """Render and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, default=Path("grips.png"))
    figure(View(elevation=math.radians(20.0))).savefig(parser.parse_args().output, dpi=110)


if __name__ == "__main__":
    main()
