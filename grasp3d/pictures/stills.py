"""Pictures of coloured surfaces and of grasps without texts, and a figure of several grasps."""

import math
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from textwrap import wrap

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from grasp3d.arrays import Bytes, Floats
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.hand.hand import Hand
from grasp3d.mesh import ObjectMesh
from grasp3d.pictures.camera import (
    UPRIGHT,
    Frame,
    FreeArea,
    View,
    aim,
    broad_view,
    frame_of,
    grasp_view,
    parallel_scale,
    view_axes,
)
from grasp3d.pictures.figures import PAGE, label_patches, new_figure, show_picture, styled
from grasp3d.pictures.marks import NO_POINTS, MarkedContacts
from grasp3d.pictures.opengl import averaged, check_rendering, off_screen, screenshot
from grasp3d.pictures.pane import Pane
from grasp3d.pictures.subject import subject_of, subject_of_mesh, subject_of_poses
from grasp3d.settings.grasp_model import model_line
from grasp3d.stability.label import MEANING, Label, Mode
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.system.context import report_progress
from grasp3d.system.names import as_unicode, printable, short_number

PIXELS = (512, 512)
"""Size of the pictures of grasps [pixels]."""

MOST_PICTURES = 40
"""Largest number of pictures of grasps."""


def draw_labels(
    labels: SurfaceLabels,
    *,
    view: View | None = None,
    size: tuple[int, int] = (640, 640),
    fixed: Floats = NO_POINTS,
) -> Bytes:
    """Render a surface in the colours of its labels on white, filling the picture.

    Args:
        labels: The surface with its labels.
        view: Direction of the camera, about the table's normal if there is a table; None: from
            above, and from the side of the longest level axis.
        size: Width and height [pixels].
        fixed: Contact points of fixed fingers to mark, shape (n, 3).

    Returns:
        Red, green, blue from 0 to 255, shape (height, width, 3).

    Raises:
        OutputError: OpenGL is not available.
    """
    up = UPRIGHT if labels.scene is None else labels.scene.up
    with _still(size) as (pane, picture):
        pane.show(subject_of(labels), "label")
        pane.cut(None)
        pane.hold(None, None, None, fixed)
        view = view or broad_view(pane.points, up)
        return _filling(pane, picture, view_axes(view, up))


def draw_colors(
    mesh: ObjectMesh,
    colors: Bytes,
    *,
    view: View | None = None,
    size: tuple[int, int] = (640, 640),
    grasp: MarkedContacts | None = None,
    hand: Hand | None = None,
) -> Bytes:
    """Render a surface in the colours of its vertices on white, filling the picture.

    Fully lit parts have exactly the given colours.

    Args:
        mesh: The surface.
        colors: Red, green, blue from 0 to 255, shape (V, 3) or (3,) for all.
        view: Direction of the camera; None: from above and from the side.
        size: Width and height [pixels].
        grasp: Contacts to mark, with the pose of the hand; None: none.
        hand: The hand, drawn translucent; None: arrows are drawn.

    Returns:
        Red, green, blue from 0 to 255, shape (height, width, 3).

    Raises:
        OutputError: OpenGL is not available.
    """
    with _still(size) as (pane, picture):
        pane.show_colors(mesh, np.asarray(colors, dtype=np.uint8))
        pane.cut(None)
        pane.hold(grasp, hand, None)
        return _filling(pane, picture, (view or View()).axes)


def draw_grasps(
    grasps: GraspTable | EvaluatedPoses, labels: SurfaceLabels | None = None
) -> list[Bytes]:
    """Render the object with each grasp, at most `MOST_PICTURES` of them.

    For poses the hand is drawn, with its approach, and the table; otherwise arrows and friction
    cones. The table is level, and the camera looks across the closing axis from above. All pictures
    have the same scale.

    Args:
        grasps: The grasps.
        labels: The labelled surface of the grasps; None: it is drawn without labels.

    Returns:
        Red, green, blue from 0 to 255, shape (height, width, 3) each.

    Raises:
        OutputError: OpenGL is not available.
    """
    rows, scene = range(min(grasps.size, MOST_PICTURES)), grasps.scene
    if isinstance(grasps, EvaluatedPoses):
        marked = [MarkedContacts.of_pose(grasps, row) for row in rows]
        subject = subject_of_poses(grasps)
    else:
        points, normals, model = grasps.contacts.points, grasps.contacts.normals, grasps.model
        marked = [MarkedContacts(points[row], normals[row], model) for row in rows]
        subject = subject_of_mesh(grasps.mesh, model, scene)
    subject = subject if labels is None else subject_of(labels)
    hand, table = (None, None) if scene is None else (scene.hand, scene.table)
    up, pictures = UPRIGHT if scene is None else scene.up, []
    with _still(PIXELS) as (pane, picture):
        pane.show(subject, "label")
        pane.cut(None)
        views = []
        for grasp in marked:
            pane.hold(grasp, hand, table)
            axes = view_axes(grasp_view(grasp.points, up, grasp.held), up)
            views.append((axes, frame_of(pane.points, pane.beside, axes)))
        scale = max(parallel_scale(frame.reach, FreeArea(*PIXELS)) for _, frame in views)
        for number, (grasp, (axes, frame)) in enumerate(zip(marked, views, strict=True)):
            pane.hold(grasp, hand, table)
            pictures.append(picture(axes, frame, scale))
            report_progress((number + 1) / len(marked))
    return pictures


Render = Callable[[Floats, Frame, float], Bytes]
"""Function that renders a frame from the axes of a view, at a scale."""


def _filling(pane: Pane, picture: Render, axes: Floats) -> Bytes:
    frame = frame_of(pane.points, pane.beside, axes)
    return picture(axes, frame, 0.0)


@contextmanager
def _still(size: tuple[int, int]) -> Iterator[tuple[Pane, Render]]:
    """Open a pane that fills a picture; yield it and its renderer, which fits the frame at scale 0.

    Args:
        size: Width and height [pixels].

    Raises:
        OutputError: OpenGL is not available.
    """
    check_rendering()
    with off_screen(*size) as (plotter, factor):
        pane = Pane(plotter.renderers[0])

        def picture(axes: Floats, frame: Frame, scale: float) -> Bytes:
            camera = pane.renderer.camera
            scale = scale or parallel_scale(frame.reach, FreeArea(*size))
            aim(camera, pane.mesh.size + scale, axes, frame.middle)
            camera.parallel_scale = scale
            return averaged(screenshot(plotter), factor)

        yield pane, picture


COLUMNS = 4
HEIGHT, LINE = 1.9, 0.2
"""Height of a row of pictures with their titles, and of a line of text below them [inch]."""
MARGINS = 1.1
"""Total height of the headline and the legend [inch]."""
LEAST_WIDTH = 4.6
"""Smallest width of the figure, set by the legend [inch]."""

REASON = 28
"""Number of characters in a line of a reason."""

LONGEST = 48
"""Largest number of characters of a name in the headline."""


@styled
def grasp_figure(
    grasps: GraspTable | EvaluatedPoses, pictures: list[Bytes], mode: Mode = "scan"
) -> Figure:
    """Arrange the pictures of grasps in a figure, with the legend of their colours.

    Args:
        grasps: The grasps.
        pictures: Pictures of the first grasps, at least one.
        mode: Mode of the surface's labels; 'scan' for grasps without such labels.
    """
    model = grasps.model
    fingers = f"{model.fingers} fingers" if grasps.scene is None else grasps.scene.hand.name
    settings = f"{printable(fingers)}, {model_line(model, metres=grasps.mesh.unit is not None)}"
    texts = [_lines(grasps, row) for row in range(len(pictures))]
    below = max(map(len, texts))
    figure, grid = _sheet(grasps.mesh.report.source, settings, len(pictures), below)
    for row, (axes, picture) in enumerate(zip(grid, pictures, strict=True)):
        label = Label(int(grasps.letter[row]))
        title = rf"$\bf{{{row + 1}}}$  {label.name}   {grasps.score[row]:.3f}"
        show_picture(axes, picture, title, "\n".join(texts[row]))
    figure.legend(
        handles=label_patches(MEANING[mode]), loc="outside lower center", ncols=len(Label)
    )
    return figure


def _lines(grasps: GraspTable | EvaluatedPoses, row: int) -> list[str]:
    """Return the lines of text below the picture of a grasp."""
    angle, lines = float(grasps.critical_angle[row]), []
    if math.isfinite(angle):
        beta = rf"$\beta^*$ {math.degrees(angle):.1f}°"
        lines = [rf"{beta}   $\varepsilon$ {grasps.epsilon[row]:.3f}"]
    if isinstance(grasps, EvaluatedPoses):
        load = []
        if grasps.grip_force is not None and math.isfinite(grasps.grip_force[row]):
            load.append(f"needs {short_number(grasps.grip_force[row])} N")
        if grasps.payload is not None and math.isfinite(grasps.payload[row]):
            load.append(f"holds {short_number(grasps.payload[row])} kg")
        lines = [", ".join(load)] if load and grasps.load is not None else lines
        turn = grasps.held_at(row).approach_margin
        lines += [f"approach ±{math.degrees(turn):.0f}°"] if math.isfinite(turn) else []
        lines += wrap(str(grasps.reason[row]).replace("$", r"\$"), REASON)[:2]
    return lines


def _sheet(source: str, settings: str, count: int, below: int) -> tuple[Figure, list[Axes]]:
    """Return a figure for `count` pictures, with lines of text below each."""
    columns = min(count, COLUMNS)
    rows = math.ceil(count / columns)
    width = max(PAGE * columns / COLUMNS, LEAST_WIDTH)
    figure = new_figure(width, rows * (HEIGHT + below * LINE) + MARGINS)
    figure.set_layout_engine("constrained", h_pad=0.08)
    figure.suptitle(f"{_short(source)}\n{settings}", fontsize=8.5, parse_math=False)
    grid = figure.subplots(rows, columns, squeeze=False).ravel()
    for axes in grid[count:]:
        axes.set_axis_off()
    return figure, list(grid[:count])


def _short(name: str) -> str:
    """Return a file's name as text, or only its end if it is too long for the headline."""
    text = as_unicode(name)
    return text if len(text) <= LONGEST else f"…{text[1 - LONGEST :]}"
