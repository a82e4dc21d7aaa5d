"""Render labelled objects side by side: one row per mesh, one column per sensor resolution.

    python scripts/make_picture.py -o docs/labels.png [MESH ...]

The last column needs no resolution: it shows the coarsest one at which the best grasp of each place
is still surely stable. Needs OpenGL (EGL or a display).
"""

import argparse
import math
import os
from pathlib import Path

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
import pyvista
from matplotlib import pyplot as plt
from matplotlib.patches import Patch

from grasp3d import COLORS, GraspModel, Label, SurfaceLabels, label_surface, load_mesh

LIBRARY = Path(__file__).parents[1] / "meshes"
SHOWN = [LIBRARY / "mug.glb", LIBRARY / "spray.glb", LIBRARY / "banana.ply"]
FRICTION = 0.5
RESOLUTIONS = (10.0, 22.6, 40.0)
COARSEST = 2.0 * math.degrees(math.atan(FRICTION))
MEANING = {Label.S: "surely stable", Label.M: "sensor cannot tell", Label.U: "no grasp found"}

Image = npt.NDArray[np.uint8]


def labelled(path: Path) -> SurfaceLabels:
    """Label a mesh finely enough for a picture, for every resolution that is shown."""
    mesh = load_mesh(path, max_edge=load_mesh(path).size / 120.0)
    widest = math.radians(max(RESOLUTIONS))
    return label_surface(mesh, GraspModel(friction=FRICTION, sensor_resolution=widest))


def rendered(labels: SurfaceLabels, colors: Image, azimuth: float, pixels: int) -> Image:
    """Picture of a surface with one colour per vertex, seen from above and the side."""
    surface = pyvista.PolyData.from_regular_faces(labels.mesh.vertices, labels.mesh.faces)
    surface.point_data["rgb"] = colors
    plotter = pyvista.Plotter(
        off_screen=True, window_size=(pixels, pixels), lighting="three lights"
    )
    plotter.set_background("white")
    plotter.add_mesh(
        surface, scalars="rgb", rgb=True, split_sharp_edges=True, ambient=0.35, diffuse=0.75
    )
    plotter.view_isometric()
    plotter.camera.azimuth = azimuth
    plotter.reset_camera()
    plotter.camera.zoom(1.02)
    picture: Image = plotter.screenshot(return_img=True)
    plotter.close()
    return picture


def add_row(axes: npt.NDArray[np.object_], labels: SurfaceLabels, azimuth: float) -> None:
    """Fill one row of the figure."""
    table = np.array([COLORS[label] for label in sorted(COLORS)], dtype=np.uint8)
    for axis, angle in zip(axes, RESOLUTIONS, strict=False):
        shown = labels.relabel(sensor_resolution=math.radians(angle))
        axis.imshow(rendered(labels, table[shown.label], azimuth, 420))
        shares = shown.fractions().items()
        axis.set_xlabel("  ".join(f"{name} {100.0 * share:.0f} %" for name, share in shares))
    share = np.degrees(labels.max_resolution) / COARSEST
    colors = (255.0 * mpl.colormaps["viridis"](share)[:, :3]).astype(np.uint8)
    axes[-1].imshow(rendered(labels, colors, azimuth, 420))


def figure(paths: list[Path], azimuth: float) -> plt.Figure:
    """Lay out the grid of pictures with its legend."""
    columns = len(RESOLUTIONS) + 1
    made, grid = plt.subplots(
        len(paths), columns, figsize=(2.6 * columns, 2.75 * len(paths) + 0.5), squeeze=False,
        layout="constrained",
    )  # fmt: skip
    for axis in grid.flat:
        axis.set_xticks([])
        axis.set_yticks([])
        axis.spines[:].set_visible(False)
    titles = [
        *(f"sensor resolution {angle:g}°" for angle in RESOLUTIONS),
        "coarsest that still works",
    ]
    for axis, title in zip(grid[0], titles, strict=True):
        axis.set_title(title, fontsize=11)
    for row, path in zip(grid, paths, strict=True):
        add_row(row, labelled(path), azimuth)
    scale = mpl.cm.ScalarMappable(mpl.colors.Normalize(0.0, COARSEST), "viridis")
    made.colorbar(scale, ax=grid[:, -1], shrink=0.6, format="%g°", ticks=[0, 10, 22.6, 40])
    patches = [
        Patch(color=np.array(COLORS[label]) / 255.0, label=f"{label.name}  {meaning}")
        for label, meaning in MEANING.items()
    ]
    made.legend(handles=patches, loc="outside lower center", ncols=3, frameon=False, fontsize=11)
    return made


def main() -> None:
    """Render and write the picture."""
    if not os.environ.get("DISPLAY"):
        os.environ.setdefault("VTK_DEFAULT_OPENGL_WINDOW", "vtkEGLRenderWindow")
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("meshes", nargs="*", type=Path, default=SHOWN)
    parser.add_argument("-o", "--output", type=Path, default=Path("labels.png"))
    parser.add_argument("--azimuth", type=float, default=30.0, help="degrees")
    options = parser.parse_args()
    figure(options.meshes, options.azimuth).savefig(options.output, dpi=95)


if __name__ == "__main__":
    main()
