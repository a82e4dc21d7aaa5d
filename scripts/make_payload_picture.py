"""Render what a gripper can carry where: payload on a hammer, a mug and a wrench.

    python scripts/make_payload_picture.py -o docs/payload.png [MESH ...]

The colour of a vertex is the largest mass that its best grasp holds in any orientation, with the
force at hand, whatever the true normals are; the cross is the centre of mass. Needs OpenGL (EGL or
a display).
"""

import argparse
import math
from pathlib import Path
from typing import NamedTuple

import matplotlib as mpl
import numpy as np
import numpy.typing as npt
from matplotlib.axes import Axes
from matplotlib.colors import LogNorm, Normalize

from grasp3d import GraspModel, ParallelGripper, SurfaceLabels, label_surface, load_mesh
from grasp3d.plots.rendering import View, picture, span_of
from grasp3d.plots.style import Drawing, new_figure, styled
from grasp3d.quality.loads import Load

LIBRARY = Path(__file__).parents[1] / "meshes"
SHOWN = [LIBRARY / "hammer.ply", LIBRARY / "mug.glb", LIBRARY / "wrench.glb"]
GRIPPER = ParallelGripper.preset("robotiq_2f85")
FORCE = 40.0
"""Force at hand of each finger [N]."""
MODEL = GraspModel(friction=0.5, sensor_resolution=math.radians(22.6))
LOWEST = 0.1
"""Payload of the first colour [kg]; less has it, too."""
GREY = (0x9A, 0xA0, 0xA6)
"""Colour of vertices without a grasp that the gripper reaches."""
SHAPES = {"hammer": (400, 640), "wrench": (860, 640)}
"""Width and height of the pictures of objects that are not compact [pixels]."""
COMPACT = (640, 640)
VIEWS = {"hammer": (100.0, 10.0), "mug": (-70.0, 30.0), "wrench": (-80.0, 60.0)}
"""Azimuth and elevation of the camera for each object [degrees]."""
INCH = 300.0
"""Pixels of the pictures in an inch of the figure."""
MARK = 9.0
"""Size of the cross [points]."""


class Shown(NamedTuple):
    """One object of the figure."""

    labels: SurfaceLabels
    view: View
    payload: npt.NDArray[np.float64]
    """[kg], shape (V,); nan: no grasp."""
    size: tuple[int, int]
    """Width and height of its picture [pixels]."""


def loaded(path: Path) -> Shown:
    """Label a mesh for the gripper, and compute what each grasp can carry."""
    mesh = load_mesh(path, unit="m")
    labels = label_surface(mesh, MODEL, hand=GRIPPER, load=Load(grip_force=FORCE))
    assert labels.holding is not None
    angles = VIEWS.get(path.stem, (75.0, 35.0))
    size = SHAPES.get(path.stem, COMPACT)
    return Shown(labels, View(*map(math.radians, angles)), labels.holding.payload, size)


def colors_of(payload: npt.NDArray[np.float64], scale: Normalize) -> npt.NDArray[np.uint8]:
    """Colours of the vertices, (V, 3)."""
    known = np.isfinite(payload)
    values = np.asarray(scale(np.where(known, np.maximum(payload, LOWEST), LOWEST)))
    ramp = (255.0 * mpl.colormaps["viridis"](values)[:, :3]).astype(np.uint8)
    return np.where(known[:, None], ramp, np.array(GREY, dtype=np.uint8))


def draw(axes: Axes, shown: Shown, scale: Normalize) -> None:
    """Render an object, and mark its centre of mass."""
    mesh, view, size = shown.labels.mesh, shown.view, shown.size
    colors = colors_of(shown.payload, scale)
    axes.imshow(picture(mesh.vertices, mesh.faces, colors, view=view, size=size))
    used = mesh.vertices[np.unique(mesh.faces)]
    pixel = size[1] / span_of(used, view, size)
    across = used @ view.axes.T  # to the right, up and toward the camera
    middle = 0.5 * (across.min(axis=0) + across.max(axis=0))
    right, up, _ = pixel * (view.axes @ mesh.center_mass - middle)
    for color, width in (("white", 3.0), ("black", 1.2)):
        axes.plot(
            0.5 * size[0] + right, 0.5 * size[1] - up, "+", color=color, markersize=MARK,
            markeredgewidth=width,
        )  # fmt: skip
    known = shown.payload[np.isfinite(shown.payload)]
    most, middle_one = known.max(), np.median(known)
    axes.set(
        xticks=[], yticks=[], title=Path(mesh.report.source).stem,
        xlabel=f"best {most:.1f} kg,\nmedian {middle_one:.2f} kg",
    )  # fmt: skip
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)


@styled
def figure(objects: list[Shown]) -> Drawing:
    """Lay out the objects beside each other, with one scale for all."""
    most = max(float(np.nanmax(shown.payload)) for shown in objects)
    scale = LogNorm(LOWEST, most)
    widths = [shown.size[0] for shown in objects]
    drawing = new_figure(sum(widths) / INCH + 0.7, 2.6)
    grid = drawing.subplots(1, len(objects), squeeze=False, width_ratios=widths)[0]
    for axes, shown in zip(grid, objects, strict=True):
        draw(axes, shown, scale)
    bar = drawing.colorbar(
        mpl.cm.ScalarMappable(scale, "viridis"), ax=list(grid), shrink=0.8, format="%g kg",
        ticks=[tick for tick in (0.1, 0.2, 0.5, 1.0, 2.0, 5.0) if tick <= most], extend="min",
    )  # fmt: skip
    bar.ax.minorticks_off()
    bar.ax.grid(visible=False)
    bar.ax.set_title("payload", fontsize=8)
    return drawing


def main() -> None:
    """Render and write the picture."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("meshes", nargs="*", type=Path, default=SHOWN)
    parser.add_argument("-o", "--output", type=Path, default=Path("payload.png"))
    options = parser.parse_args()
    figure([loaded(path) for path in options.meshes]).savefig(options.output, dpi=150)


if __name__ == "__main__":
    main()
