"""A pose of a gripper, or of a hand with joints: what it holds, as it is listed and drawn."""

import math
from dataclasses import replace

import numpy as np

from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.hand.scene import Scene
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.settings import GraspModel
from grasp3d.stability.label import Label
from grasp3d.surface.fields import NONE, REASON, STATED_LABEL
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_grasps import Reason, SearchReport
from grasp3d.viewer.session.inspection import Inspection, MarkedContacts
from grasp3d.viewer.subjects.subject import Subject, subject_of

WHY = {
    Label.S: "Surely stable: it holds whatever its true normals are.",
    Label.M: "Ambiguous: some normals that the sensors cannot tell apart do not hold it.",
    Label.U: "Surely unstable: no normals that the sensors cannot tell apart hold it.",
}
"""Reasons of grasps that the hand can reach."""


def subject_of_poses(grasps: EvaluatedPoses) -> Subject:
    """The object of evaluated poses, of which the first one is shown; its surface has no labels.

    Args:
        grasps: The poses.
    """
    subject = subject_of_mesh(grasps.mesh, grasps.model, grasps.scene)
    return replace(subject, poses=grasps)


def subject_of_mesh(mesh: ObjectMesh, model: GraspModel, scene: Scene | None = None) -> Subject:
    """An object without labels.

    Args:
        mesh: The object.
        model: Friction and resolution.
        scene: Hand and table; None: there are none.
    """
    count = len(mesh.vertices)
    labels = SurfaceLabels.of_vertices(
        mesh,
        model,
        angles=(np.full(count, math.inf), np.full(count, math.inf)),
        partner_points=SurfacePoints(np.zeros((count, 1), np.int64), np.zeros((count, 1, 3))),
        grip=np.zeros(count, np.int8),
        reason=np.full(count, Reason.SAME_POINT),
        sampling=None,
        mode="scan",
        search=SearchReport(cone=0.0),
        scene=scene,
    )  # fmt: skip
    return subject_of(labels)


def marked_pose(grasps: EvaluatedPoses, row: int) -> MarkedContacts:
    """The contacts of a pose, with the hand that makes them.

    The links that touch, or the fingers of a gripper, have the colour of the letter.

    Args:
        grasps: Evaluated poses.
        row: Number of the pose.
    """
    return MarkedContacts(*grasps.contacts_of(row), grasps.model, grasps.held_at(row))


def inspect_pose(grasps: EvaluatedPoses, model: GraspModel) -> Inspection:
    """Inspect the first pose at another friction and sensor resolution.

    Args:
        grasps: Evaluated poses.
        model: Friction and resolution.
    """
    found = grasps.using(model=model)
    marked = marked_pose(found, 0)
    return Inspection(
        marked.points, marked.normals, model, marked.held, vertex=None,
        code=int(found.letter[0]),
        numbers=tuple(_numbers(found)),
        reason=reason_of(found, 0),
    )  # fmt: skip


def reason_of(grasps: EvaluatedPoses, row: int) -> str:
    """Why a pose is S, M or U, or what is wrong with it, in one sentence."""
    reason = str(grasps.reason[row])
    text = f"{reason[:1].upper()}{reason[1:]}." if reason else ""
    if text and not grasps.reachable[row]:
        return f"Not a grasp as it is: {reason}."
    return text or WHY[Label(int(grasps.letter[row]))]


def _numbers(grasps: EvaluatedPoses) -> list[tuple[str, str]]:
    """Names and values of the first pose; those that are not known are left out."""
    metres, numbers = grasps.mesh.unit is not None, [("pose", str(grasps.given.names[0]))]
    for field in grasps.fields:
        if (field.heading or field.kind == "U") and field not in {STATED_LABEL, REASON}:
            values = field.values_of(grasps)
            text = NONE if values is None else field.text(values[0], metres=metres)
            unit = field.title(metres=metres).partition("\n")[2]
            numbers += (
                [(field.heading or field.name, f"{text} {unit}".strip())]
                if text not in {NONE, ""}
                else []
            )
    return numbers
