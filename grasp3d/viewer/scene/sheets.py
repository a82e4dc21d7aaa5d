"""Pictures of grasps for a sheet: each as the viewer draws it, at one scale."""

from collections.abc import Sequence

from grasp3d.arrays import Bytes, Floats
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.hand.scene import Scene
from grasp3d.rendering.grasp_views import grasp_view
from grasp3d.rendering.opengl import UPRIGHT, view_axes
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.system.context import report_progress
from grasp3d.viewer.scene.framing import Frame, FreeArea, frame_of, parallel_scale
from grasp3d.viewer.scene.stills import still_pane
from grasp3d.viewer.session.inspection import MarkedContacts
from grasp3d.viewer.session.pose_inspection import marked_pose, subject_of_mesh, subject_of_poses
from grasp3d.viewer.subjects.subject import Subject, subject_of

PIXELS = (512, 512)

MOST_PICTURES = 40
"""Most pictures in one figure."""


def draw_grasps(
    grasps: GraspTable | EvaluatedPoses, labels: SurfaceLabels | None = None
) -> list[Bytes]:
    """Render the object with each grasp, at most `MOST_PICTURES` of them.

    At poses the hand is drawn, with its approach, and the table; else arrows and friction cones
    are. The table is level, and the camera looks across the closing axis, from above. All pictures
    have the same scale.

    Args:
        grasps: The grasps.
        labels: The labelled surface that they are on; None: it has no labels.

    Returns:
        Red, green, blue from 0 to 255, shape (height, width, 3) each.

    Raises:
        OutputError: OpenGL is not available.
    """
    rows = range(min(grasps.size, MOST_PICTURES))
    if isinstance(grasps, EvaluatedPoses):
        marked = [marked_pose(grasps, row) for row in rows]
        subject = subject_of_poses(grasps)
    else:
        contacts = grasps.contacts
        marked = [
            MarkedContacts(contacts.points[row], contacts.normals[row], grasps.model)
            for row in rows
        ]
        subject = subject_of_mesh(grasps.mesh, grasps.model, grasps.scene)
    return _drawn(subject if labels is None else subject_of(labels), grasps.scene, marked)


def _drawn(subject: Subject, scene: Scene | None, grasps: Sequence[MarkedContacts]) -> list[Bytes]:
    """Pictures of grasps of a surface, shape (height, width, 3) each."""
    hand, table = (None, None) if scene is None else (scene.hand, scene.table)
    up, pictures = UPRIGHT if scene is None else scene.up, []
    with still_pane(PIXELS) as (pane, picture):
        pane.show(subject, "label", subject.labels.model)
        pane.cut(None)

        def framed(grasp: MarkedContacts) -> tuple[Floats, Frame]:
            """Draw a grasp; returns the axes of its view, and what the picture shows."""
            pane.hold(grasp, hand, table)
            axes = view_axes(grasp_view(grasp.points, up, grasp.held), up)
            return axes, frame_of(pane.points, pane.beside, axes)

        frames = [framed(grasp) for grasp in grasps]
        scale = max(parallel_scale(frame.reach, FreeArea(*PIXELS)) for _, frame in frames)
        for number, (grasp, (axes, frame)) in enumerate(zip(grasps, frames, strict=True)):
            pane.hold(grasp, hand, table)
            pictures.append(picture(axes, frame, scale))
            report_progress((number + 1) / len(grasps))
    return pictures
