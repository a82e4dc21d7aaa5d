"""Pictures of a surface in the colours of its labels or in given ones, with contacts or a hand."""

from collections.abc import Callable, Iterator
from contextlib import contextmanager

import numpy as np

from grasp3d.arrays import Bytes, Floats
from grasp3d.hand.hand import Hand
from grasp3d.mesh import ObjectMesh
from grasp3d.rendering.opengl import View, check_rendering, screenshot
from grasp3d.settings import GraspModel
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.viewer.scene.framing import Frame, FreeArea, aim, frame_of, parallel_scale
from grasp3d.viewer.scene.marks import NO_POINTS
from grasp3d.viewer.scene.panes import Pane
from grasp3d.viewer.scene.pictures import averaged, off_screen
from grasp3d.viewer.session.inspection import MarkedContacts
from grasp3d.viewer.session.pose_inspection import subject_of_mesh
from grasp3d.viewer.subjects.subject import subject_of


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
        view: Direction of the camera; None: from above and the side.
        size: Width and height [pixels].
        fixed: Contact points of fixed fingers to mark, shape (n, 3).

    Returns:
        Red, green, blue from 0 to 255, shape (height, width, 3).

    Raises:
        OutputError: OpenGL is not available.
    """
    with still_pane(size) as (pane, picture):
        pane.show(subject_of(labels), "label", labels.model)
        pane.cut(None)
        pane.hold(None, None, None, fixed)
        axes = (view or View()).axes
        return picture(axes, frame_of(pane.points, pane.beside, axes), None)


def draw_colors(
    mesh: ObjectMesh,
    colors: Bytes,
    *,
    view: View | None = None,
    size: tuple[int, int] = (640, 640),
    grasp: MarkedContacts | None = None,
    hand: Hand | None = None,
) -> Bytes:
    """Render a surface in colours of its vertices on white, filling the picture.

    Fully lit parts have exactly the given colours.

    Args:
        mesh: The surface.
        colors: Red, green, blue from 0 to 255, shape (V, 3) or (3,) for all.
        view: Direction of the camera; None: from above and the side.
        size: Width and height [pixels].
        grasp: Contacts to mark, with the pose of the hand; None: none.
        hand: The hand, which is translucent; None: arrows are drawn.

    Returns:
        Red, green, blue from 0 to 255, shape (height, width, 3).

    Raises:
        OutputError: OpenGL is not available.
    """
    with still_pane(size) as (pane, picture):
        pane.show_colors(subject_of_mesh(mesh, GraspModel()), np.asarray(colors, dtype=np.uint8))
        pane.cut(None)
        pane.hold(grasp, hand, None)
        axes = (view or View()).axes
        return picture(axes, frame_of(pane.points, pane.beside, axes), None)


@contextmanager
def still_pane(
    size: tuple[int, int],
) -> Iterator[tuple[Pane, Callable[[Floats, Frame, float | None], Bytes]]]:
    """A pane that fills a picture, and what renders it.

    That takes the axes of a view, what the picture shows, and its scale; None: that which fills it.

    Args:
        size: Width and height [pixels].

    Raises:
        OutputError: OpenGL is not available.
    """
    check_rendering()
    with off_screen(*size) as (plotter, factor):
        pane = Pane(plotter.renderers[0])

        def picture(axes: Floats, frame: Frame, scale: float | None) -> Bytes:
            camera = pane.renderer.camera
            scale = parallel_scale(frame.reach, FreeArea(*size)) if scale is None else scale
            aim(camera, pane.size + scale, axes, frame.middle)
            camera.parallel_scale = scale
            return averaged(screenshot(plotter), factor)

        yield pane, picture
