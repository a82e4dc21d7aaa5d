"""Pictures of a surface's best grasps for a sheet: each as the viewer draws it, at one scale."""

from collections.abc import Sequence

from grasp3d.arrays import Bytes, Floats
from grasp3d.grasps.hand_grasps import EvaluatedHandGrasps
from grasp3d.hand.gripper_pose import GripperPose
from grasp3d.hand.scene import Scene
from grasp3d.rendering.grasp_views import grasp_view
from grasp3d.rendering.opengl import UPRIGHT, view_axes
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.system.context import report_progress
from grasp3d.viewer.scene.framing import Frame, FreeArea, frame_of, parallel_scale
from grasp3d.viewer.scene.stills import still_pane
from grasp3d.viewer.session.hand_inspection import held_by, subject_of_hand
from grasp3d.viewer.session.inspection import MarkedContacts
from grasp3d.viewer.subjects.subject import Subject, subject_of

PIXELS = (512, 512)

MOST_PICTURES = 40
"""Most pictures in one figure."""


def draw_grasps(labels: SurfaceLabels, grasps: GraspTable) -> list[Bytes]:
    """Render the labelled surface with each grasp, at most `MOST_PICTURES` of them.

    Where a gripper reaches a grasp it is drawn with its approach, and the table; else arrows and
    friction cones are. The table is level, and the camera looks across the closing axis, from
    above. All pictures have the same scale.

    Args:
        labels: The labelled surface.
        grasps: Grasps on it.

    Returns:
        Red, green, blue from 0 to 255, shape (height, width, 3) each.

    Raises:
        OutputError: OpenGL is not available.
    """
    contacts = grasps.contacts.take(slice(MOST_PICTURES))
    marked = [
        MarkedContacts(points, normals, labels.model, GripperPose.of(grasps.reach, row))
        for row, (points, normals) in enumerate(zip(contacts.points, contacts.normals, strict=True))
    ]
    return _drawn(subject_of(labels), grasps.scene, marked)


def draw_hand_grasps(grasps: EvaluatedHandGrasps) -> list[Bytes]:
    """Render the object with the hand at each grasp, as `draw_grasps` does.

    Links that touch have the colours of the margins of their contacts.

    Args:
        grasps: Evaluated poses of a hand with joints.

    Returns:
        Red, green, blue from 0 to 255, shape (height, width, 3) each.

    Raises:
        OutputError: OpenGL is not available.
    """
    rows = range(min(grasps.size, MOST_PICTURES))
    marked = [
        MarkedContacts(*grasps.contacts_of(row), grasps.model, held_by(grasps, row)) for row in rows
    ]
    return _drawn(subject_of_hand(grasps), grasps.scene, marked)


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
