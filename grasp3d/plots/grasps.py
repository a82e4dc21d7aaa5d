"""The best grasps of a surface: small pictures beside one another."""

import math

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grasp3d.arrays import Bytes
from grasp3d.grasps.surface_grasps import SurfaceGrasps
from grasp3d.plots.painting import painted
from grasp3d.plots.style import PAGE, as_text, label_patches, new_figure, styled
from grasp3d.plots.views import views_of
from grasp3d.rendering import Finger, extent_of
from grasp3d.stability.label import MEANING, Label
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.system.progress import Progress, ignore

COLUMNS = 4
HEIGHT = 1.9
"""Of a row of pictures with what is said above them [inch]."""
AROUND = 0.9
"""Of the headline and the legend [inch]."""
LEAST_WIDTH = 4.6
"""Of the figure, which the legend needs [inch]."""

LONGEST = 48
"""Characters of a name in the headline."""

PIXELS = (512, 512)

MOST_PICTURES = 40
"""Pictures in one figure."""


def draw_grasps(
    labels: SurfaceLabels, grasps: SurfaceGrasps, *, progress: Progress | None = None
) -> list[Bytes]:
    """Draw the painted surface with the fingers of each grasp, at most `MOST_PICTURES` of them.

    Args:
        labels: The labelled surface.
        grasps: Grasps on it.
        progress: Called with the share of the work done, from 0 to 1.

    Returns:
        Red, green, blue from 0 to 255, shape (height, width, 3) each.

    Raises:
        OutputError: There is no OpenGL here.
    """
    shown = grasps.contacts.take(slice(MOST_PICTURES))
    views = views_of(shown, extent_of(labels.mesh.vertices))
    pictures = []
    for number, view in enumerate(views):
        marks = zip(shown.points[number], shown.normals[number], strict=True)
        fingers = [Finger(place, push) for place, push in marks]
        pictures.append(painted(labels, view=view, size=PIXELS, fingers=fingers))
        (progress or ignore)((number + 1) / len(views))
    return pictures


@styled
def grasp_figure(labels: SurfaceLabels, grasps: SurfaceGrasps, pictures: list[Bytes]) -> Figure:
    """Lay out the pictures of grasps, numbered from the best on.

    Args:
        labels: The labelled surface.
        grasps: The grasps, best first.
        pictures: Of the first of them, at least one.
    """
    columns = min(len(pictures), COLUMNS)
    rows = math.ceil(len(pictures) / columns)
    width = max(PAGE * columns / COLUMNS, LEAST_WIDTH)
    figure = new_figure(width, rows * HEIGHT + AROUND)
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
    """A file's name as words, its end where it is too long for the headline."""
    told = as_text(name)
    shown = told if len(told) <= LONGEST else f"…{told[1 - LONGEST :]}"
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
