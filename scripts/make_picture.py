"""Render labelled objects side by side: one row per mesh, one column per sensor resolution.

    python scripts/make_picture.py -o docs/labels.png [MESH ...]

The last column has no resolution of its own: it shows the coarsest one at which the best grasp of
each vertex is still surely stable. Needs OpenGL (EGL or a display).
"""

import argparse
import math
from pathlib import Path

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes

from grasp3d import GraspModel, SurfaceLabels, label_surface, load_mesh
from grasp3d.plots.painting import paint_labels
from grasp3d.plots.rendering import View, picture
from grasp3d.plots.style import Drawing, label_patches, new_figure, styled
from grasp3d.stability.label import MEANING

LIBRARY = Path(__file__).parents[1] / "meshes"
SHOWN = [LIBRARY / "mug.glb", LIBRARY / "spray.glb", LIBRARY / "banana.ply"]
FRICTION = 0.5
RESOLUTIONS = (10.0, 22.6, 40.0)
COARSEST = 2.0 * math.degrees(math.atan(FRICTION))
PIXELS = (640, 640)
CELL = 1.8
"""Width of a picture [inch]."""


def labelled(path: Path) -> SurfaceLabels:
    """Label a mesh finely enough for a picture, for every resolution that is shown."""
    mesh = load_mesh(path, max_edge=load_mesh(path).size / 120.0)
    widest = math.radians(max(RESOLUTIONS))
    return label_surface(mesh, GraspModel(friction=FRICTION, sensor_resolution=widest))


def add_row(axes: npt.NDArray[np.object_], labels: SurfaceLabels, view: View) -> None:
    """Fill one row of the figure."""
    for axis, angle in zip(axes, RESOLUTIONS, strict=False):
        shown = labels.relabel(sensor_resolution=math.radians(angle))
        axis.imshow(paint_labels(shown, view=view, size=PIXELS))
        fractions = shown.fractions().items()
        axis.set_xlabel("  ".join(f"{name} {100.0 * value:.0f} %" for name, value in fractions))
    relative = np.degrees(labels.max_resolution) / COARSEST
    colors = (255.0 * mpl.colormaps["viridis"](relative)[:, :3]).astype(np.uint8)
    mesh = labels.mesh
    axes[-1].imshow(picture(mesh.vertices, mesh.faces, colors, view=view, size=PIXELS))


def clear(axis: Axes) -> None:
    """Hide ticks, grid and frame."""
    axis.set(xticks=[], yticks=[])
    axis.grid(visible=False)
    axis.spines[:].set_visible(False)


@styled
def figure(paths: list[Path], view: View) -> Drawing:
    """Lay out the grid of pictures with its legend."""
    columns = len(RESOLUTIONS) + 1
    drawing = new_figure(CELL * columns + 0.5, 1.15 * CELL * len(paths) + 0.6)
    grid = drawing.subplots(len(paths), columns, squeeze=False)
    for axis in grid.flat:
        clear(axis)
    titles = [
        *(f"sensor resolution {angle:g}°" for angle in RESOLUTIONS),
        "coarsest resolution for S",
    ]
    for axis, title in zip(grid[0], titles, strict=True):
        axis.set_title(title)
    for row, path in zip(grid, paths, strict=True):
        add_row(row, labelled(path), view)
    scale = mpl.cm.ScalarMappable(mpl.colors.Normalize(0.0, COARSEST), "viridis")
    bar = drawing.colorbar(scale, ax=grid[:, -1], shrink=0.6, format="%g°", ticks=[0, 10, 22.6, 40])
    bar.ax.grid(visible=False)
    drawing.legend(handles=label_patches(MEANING["label"]), loc="outside lower center", ncols=3)
    return drawing


def main() -> None:
    """Render and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("meshes", nargs="*", type=Path, default=SHOWN)
    parser.add_argument("-o", "--output", type=Path, default=Path("labels.png"))
    parser.add_argument("--azimuth", type=float, default=75.0, help="degrees from the x-axis")
    options = parser.parse_args()
    view = View(azimuth=math.radians(options.azimuth))
    figure(options.meshes, view).savefig(options.output, dpi=140)


if __name__ == "__main__":
    main()
