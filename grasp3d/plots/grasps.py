"""Figure of a surface's best grasps: one small picture each."""

import math

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grasp3d.arrays import Bytes
from grasp3d.grasps.surface_grasps import SurfaceGrasps
from grasp3d.plots.painting import paint_labels
from grasp3d.plots.style import PAGE, as_text, label_patches, new_figure, styled
from grasp3d.plots.views import views_of
from grasp3d.rendering import Finger, extent_of, span_of
from grasp3d.stability.label import MEANING, Label
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.system.progress import Progress, ignore

COLUMNS = 4
HEIGHT = 1.9
"""Height of a row of pictures with their titles [inch]."""
MARGINS = 0.9
"""Height of the headline and the legend [inch]."""
LEAST_WIDTH = 4.6
"""Least width of the figure, which the legend needs [inch]."""

LONGEST = 48
"""Characters of a name in the headline."""

PIXELS = (512, 512)

MOST_PICTURES = 40
"""Most pictures in one figure."""


def draw_grasps(
    labels: SurfaceLabels, grasps: SurfaceGrasps, *, progress: Progress | None = None
) -> list[Bytes]:
    """Render the labelled surface with the fingers of each grasp, at most `MOST_PICTURES` of them.

    All pictures have the same scale, and arrows of the same length.

    Args:
        labels: The labelled surface.
        grasps: Grasps on it.
        progress: Called with the fraction of the work done, from 0 to 1.

    Returns:
        Red, green, blue from 0 to 255, shape (height, width, 3) each.

    Raises:
        OutputError: OpenGL is not available.
    """
    shown = grasps.contacts.take(slice(MOST_PICTURES))
    surface = labels.mesh.vertices[labels.mesh.on_surface]
    views = views_of(shown, extent_of(surface))
    marked = [
        [Finger(point, normal) for point, normal in zip(points, normals, strict=True)]
        for points, normals in zip(shown.points, shown.normals, strict=True)
    ]
    of_all = list(zip(views, marked, strict=True))
    span = max(span_of(surface, view, PIXELS, fingers) for view, fingers in of_all)
    pictures = []
    for number, (view, fingers) in enumerate(of_all):
        pictures.append(paint_labels(labels, view=view, size=PIXELS, fingers=fingers, span=span))
        (progress or ignore)((number + 1) / len(views))
    return pictures


@styled
def grasp_figure(labels: SurfaceLabels, grasps: SurfaceGrasps, pictures: list[Bytes]) -> Figure:
    """Lay out the pictures of grasps, numbered from the best.

    Args:
        labels: The labelled surface.
        grasps: The grasps, best first.
        pictures: Pictures of the first grasps, at least one.
    """
    columns = min(len(pictures), COLUMNS)
    rows = math.ceil(len(pictures) / columns)
    width = max(PAGE * columns / COLUMNS, LEAST_WIDTH)
    figure = new_figure(width, rows * HEIGHT + MARGINS)
    model = labels.model
    figure.suptitle(
        f"{_short(labels.mesh.report.source)}\n"
        f"{model.fingers} fingers, friction {model.friction:g}, "
        rf"$\alpha$ = {math.degrees(model.sensor_resolution):.4g}°",
        fontsize=8.5,
    )
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in grid[len(pictures) :]:
        axes.set_axis_off()
    for number, (axes, picture) in enumerate(zip(grid, pictures, strict=False)):
        _show(axes, grasps, number, picture)
    figure.legend(
        handles=label_patches(MEANING[labels.mode]), loc="outside lower center", ncols=len(Label)
    )
    return figure


def _short(name: str) -> str:
    """A file's name as text; its end if it is too long for the headline."""
    text = as_text(name)
    shown = text if len(text) <= LONGEST else f"…{text[1 - LONGEST :]}"
    return shown.replace("$", r"\$")


def _show(axes: Axes, grasps: SurfaceGrasps, number: int, picture: Bytes) -> None:
    axes.imshow(picture)
    axes.set(xticks=[], yticks=[])
    axes.grid(visible=False)
    axes.spines[:].set_visible(False)
    angle = math.degrees(grasps.critical_angle[number])
    label = Label(int(grasps.label[number])).name
    axes.set_title(
        rf"$\bf{{{number + 1}}}$  {label}   $\beta^*$ {angle:.1f}°"
        rf"   $\varepsilon$ {grasps.epsilon[number]:.3f}"
    )
