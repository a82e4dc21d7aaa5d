"""Render the effect of noise on labels, and its reduction by a fingertip's contact patch.

    python scripts/make_patch_picture.py -o docs/patches.png [MESH ...]

One row per surface: a ball and the meshes given. From left to right: the clean surface, the same
with every vertex moved along its normal at random, as in a scan, and this again with the normals
averaged over a patch. Needs OpenGL (EGL or a display).
"""

import argparse
import math
from pathlib import Path
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d import GraspModel, ObjectMesh, SurfaceLabels, label_surface, load_mesh
from grasp3d.mesh.primitives import sphere_mesh
from grasp3d.plots.painting import paint_labels
from grasp3d.plots.rendering import View
from grasp3d.plots.style import Drawing, label_patches, new_figure, styled
from grasp3d.stability.label import MEANING

LIBRARY = Path(__file__).parents[1] / "meshes"
SHOWN = [LIBRARY / "mug.glb"]
FINENESS = 1.0 / 100.0
"""Longest edge as a fraction of the object's size."""
NOISE = 0.15
"""Standard deviation of the noise as a fraction of the mean edge."""
PATCH = 4.0
"""Radius of the patch in mean edges."""
SEED = 1
PIXELS = (640, 640)
CELL = 2.1
"""Width of a picture [inch]."""


class Column(NamedTuple):
    """One picture of a row."""

    title: str
    labels: SurfaceLabels


def mean_edge(mesh: ObjectMesh) -> float:
    """Mean length of the edges, in the mesh's unit."""
    corners = mesh.vertices[mesh.faces]
    return float(np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).mean())


def scanned(mesh: ObjectMesh) -> npt.NDArray[np.float64]:
    """The vertices, each moved along its normal at random."""
    noise = np.random.default_rng(SEED).standard_normal(len(mesh.vertices))[mesh.canonical]
    return mesh.vertices + NOISE * mean_edge(mesh) * noise[:, None] * mesh.normals


def columns(mesh: ObjectMesh) -> list[Column]:
    """Label a surface clean, noisy, and noisy with a patch."""
    noisy, edge = scanned(mesh), mean_edge(mesh)
    plain, smoothed = (
        load_mesh((noisy, mesh.faces), max_edge=mesh.size, patch_radius=radius)
        for radius in (0.0, PATCH * edge)
    )
    percent = 100.0 / mesh.size
    titles = (
        "clean",
        f"noise of {NOISE * edge * percent:.2g} % of the size",
        f"and a patch of radius {PATCH * edge * percent:.2g} %",
    )
    return [
        Column(title, label_surface(surface, GraspModel()))
        for title, surface in zip(titles, (mesh, plain, smoothed), strict=True)
    ]


@styled
def figure(rows: list[list[Column]], view: View) -> Drawing:
    """Lay out the pictures with their area fractions and the legend."""
    drawing = new_figure(3.0 * CELL + 0.3, 1.2 * CELL * len(rows) + 0.4)
    grid = drawing.subplots(len(rows), 3, squeeze=False)
    for axes, row in zip(grid, rows, strict=True):
        for axis, column in zip(axes, row, strict=True):
            axis.imshow(paint_labels(column.labels, view=view, size=PIXELS))
            fractions = column.labels.fractions().items()
            axis.set_title(column.title)
            axis.set_xlabel("  ".join(f"{name} {100.0 * value:.1f} %" for name, value in fractions))
            axis.set(xticks=[], yticks=[])
            axis.grid(visible=False)
            axis.spines[:].set_visible(False)
    drawing.legend(handles=label_patches(MEANING["label"]), loc="outside lower center", ncols=3)
    return drawing


def main() -> None:
    """Render and write the picture, and print the figures behind it."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("meshes", nargs="*", type=Path, default=SHOWN)
    parser.add_argument("-o", "--output", type=Path, default=Path("patches.png"))
    parser.add_argument("--azimuth", type=float, default=75.0, help="degrees from the x-axis")
    options = parser.parse_args()
    surfaces = [sphere_mesh()]
    surfaces += [
        load_mesh(path, max_edge=load_mesh(path).size * FINENESS) for path in options.meshes
    ]
    rows = [columns(mesh) for mesh in surfaces]
    for row in rows:
        clean = row[0].labels
        areas = clean.mesh.vertex_areas
        for title, labels in row:
            same = float(areas[labels.label == clean.label].sum() / areas.sum())
            half, most = np.degrees(labels.angle_quantiles([0.5, 0.9]))
            parts = " ".join(f"{name} {value:.3f}" for name, value in labels.fractions().items())
            print(
                f"{title}: {parts}, as clean {same:.3f}, critical angle {half:.2f} (median) "
                f"{most:.2f} (90 %)"
            )
    view = View(azimuth=math.radians(options.azimuth))
    figure(rows, view).savefig(options.output, dpi=140)


if __name__ == "__main__":
    main()
