"""Figure of a surface's best grasps: one small picture each."""

import math
from dataclasses import dataclass

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grasp3d.arrays import Bytes, Floats
from grasp3d.grasps.closed_grasps import UNKNOWN
from grasp3d.hand.shapes import Triangles, gripper_triangles
from grasp3d.model_text import model_line
from grasp3d.plots.painting import paint_labels
from grasp3d.plots.style import PAGE, as_text, label_patches, new_figure, styled
from grasp3d.plots.views import views_of, views_of_gripper
from grasp3d.rendering import Finger, View, extent_of, span_of
from grasp3d.settings.lengths import METRES
from grasp3d.stability.label import MEANING, Label
from grasp3d.surface.contacts import SurfaceContacts
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.system.progress import Progress, ignore

COLUMNS = 4
HEIGHT, APPROACH = 1.9, 0.25
"""Height of a row of pictures with their titles, and of a line on the approach below [inch]."""
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
    labels: SurfaceLabels, grasps: GraspTable, *, progress: Progress | None = None
) -> list[Bytes]:
    """Render the labelled surface with the fingers of each grasp, at most `MOST_PICTURES` of them.

    Where a gripper reaches a grasp, it is drawn there instead of arrows. All pictures have the same
    scale, and arrows of the same length.

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
    views = _views(grasps, shown, extent_of(surface))
    scenes = [
        _scene(grasps, number, view, shown.points[number], shown.normals[number])
        for number, view in enumerate(views)
    ]
    span = max(scene.span(surface) for scene in scenes)
    pictures = []
    for number, scene in enumerate(scenes):
        picture = paint_labels(
            labels, view=scene.view, size=PIXELS, fingers=scene.fingers, span=span,
            beside=scene.hand,
        )  # fmt: skip
        pictures.append(picture)
        (progress or ignore)((number + 1) / len(views))
    return pictures


def _views(grasps: GraspTable, shown: SurfaceContacts, extent: float) -> list[View]:
    """The view of each grasp that is shown, (b, n)."""
    reach, scene, unit = grasps.reach, grasps.scene, grasps.mesh.unit
    if reach is None or scene is None or unit is None or np.isnan(reach.poses).any():
        return views_of(shown, extent)
    length = scene.hand.finger_length / METRES[unit]
    return views_of_gripper(shown, reach.poses[: shown.size], length)


@dataclass(frozen=True, eq=False)
class _Scene:
    """One grasp, and the view of it."""

    view: View
    fingers: list[Finger]
    """Contacts to be marked."""
    hand: Triangles | None

    def span(self, surface: Floats) -> float:
        """Height of a picture that all of it fills, with the points of the surface (V, 3)."""
        if self.hand is None:
            return span_of(surface, self.view, PIXELS, self.fingers)
        both = np.concatenate([surface, self.hand.vertices])
        return span_of(both, self.view, PIXELS)


def _scene(grasps: GraspTable, number: int, view: View, points: Floats, normals: Floats) -> _Scene:
    """What is drawn of one grasp: the gripper if it reaches it, else its contacts (n, 3)."""
    reach, scene, unit = grasps.reach, grasps.scene, grasps.mesh.unit
    if reach is None or scene is None or unit is None or np.isnan(reach.poses[number]).any():
        fingers = [Finger(*pair) for pair in zip(points, normals, strict=True)]
        return _Scene(view, fingers, None)
    pose, opening = reach.poses[number], float(reach.opening[number])
    shape = gripper_triangles(scene.hand, opening, pose=pose, unit=unit)
    return _Scene(view, [], shape)


@styled
def grasp_figure(labels: SurfaceLabels, grasps: GraspTable, pictures: list[Bytes]) -> Figure:
    """Lay out the pictures of grasps, numbered from the best.

    Args:
        labels: The labelled surface.
        grasps: The grasps, best first.
        pictures: Pictures of the first grasps, at least one.
    """
    columns = min(len(pictures), COLUMNS)
    rows = math.ceil(len(pictures) / columns)
    width = max(PAGE * columns / COLUMNS, LEAST_WIDTH)
    height = HEIGHT if grasps.reach is None else HEIGHT + APPROACH
    figure = new_figure(width, rows * height + MARGINS)
    model = labels.model
    figure.suptitle(
        f"{_short(labels.mesh.report.source)}\n"
        f"{model.fingers} fingers, {model_line(model, labels.mesh.unit)}",
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


def _show(axes: Axes, grasps: GraspTable, number: int, picture: Bytes) -> None:
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
    axes.set_xlabel(_approach(grasps, number))


def _approach(grasps: GraspTable, number: int) -> str:
    """The approach margin if a gripper reaches the grasp, and the label after closing if known."""
    margin = math.nan if grasps.reach is None else float(grasps.reach.approach_margin[number])
    if not math.isfinite(margin):
        return ""
    code = UNKNOWN if grasps.closed is None else int(grasps.closed.label[number])
    closed = "" if code == UNKNOWN else f", closed {Label(code).name}"
    return f"approach ±{math.degrees(margin):.0f}°{closed}"
