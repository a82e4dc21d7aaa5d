"""Pictures of a surface's best grasps for a sheet: each as the viewer draws it, at one scale."""

from grasp3d.arrays import Bytes, Floats
from grasp3d.hand.gripper_pose import GripperPose
from grasp3d.plots.rendering import check_rendering, screenshot, view_axes
from grasp3d.plots.views import GraspViews
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.system.context import report_progress
from grasp3d.viewer.scene.framing import Frame, FreeArea, aim, frame_of, parallel_scale
from grasp3d.viewer.scene.marks import MarkedContacts
from grasp3d.viewer.scene.panes import Pane
from grasp3d.viewer.scene.pictures import averaged, off_screen
from grasp3d.viewer.subjects.subject import subject_of

PIXELS = (512, 512)

MOST_PICTURES = 40
"""Most pictures in one figure."""


def draw_grasps(labels: SurfaceLabels, grasps: GraspTable) -> list[Bytes]:
    """Render the labelled surface with each grasp, at most `MOST_PICTURES` of them.

    Where a gripper reaches a grasp it is drawn with its approach, and the table; else arrows and
    friction cones are. The table is level, and the camera where the fingertips are seen best. All
    pictures have the same scale.

    Args:
        labels: The labelled surface.
        grasps: Grasps on it.

    Returns:
        Red, green, blue from 0 to 255, shape (height, width, 3) each.

    Raises:
        OutputError: OpenGL is not available.
    """
    check_rendering()
    scene, contacts = grasps.scene, grasps.contacts.take(slice(MOST_PICTURES))
    points, normals = contacts.points, contacts.normals
    poses = [GripperPose.of(grasps.reach, row) for row in range(contacts.size)]
    hand, table = (None, None) if scene is None else (scene.hand, scene.table)
    views, area, pictures = GraspViews(labels.mesh, scene), FreeArea(*PIXELS), []
    with off_screen(*PIXELS) as (plotter, factor):
        pane = Pane(plotter.renderers[0])
        pane.renderer.viewport = (0.0, 0.0, 1.0, 1.0)
        plotter.renderers[1].SetDraw(0)
        pane.show(subject_of(labels), "label", labels.model)

        def framed(row: int) -> tuple[Floats, Frame]:
            """Draw a grasp; returns the axes of its view, and what the picture shows."""
            grasp = MarkedContacts(points[row], normals[row], labels.model, poses[row])
            pane.hold(grasp, hand, table)
            view = views.best(points[row], normals[row], poses[row])
            axes = view_axes(view, views.up)
            return axes, frame_of(pane.points, pane.beside, axes)

        camera, rows = pane.renderer.camera, range(contacts.size)
        scale = max(parallel_scale(framed(row)[1].reach, area) for row in rows)
        for row in rows:
            axes, frame = framed(row)
            aim(camera, labels.mesh.size + scale, axes, frame.middle)
            camera.parallel_scale = scale
            pictures.append(averaged(screenshot(plotter), factor))
            report_progress((row + 1) / len(rows))
    return pictures
