"""A pose of a gripper, or of a hand with joints: what it holds, as it is listed and drawn."""

import math
from dataclasses import replace

import numpy as np

from grasp3d.grasps.evaluated_poses import EvaluatedPoses, GivenGrasps
from grasp3d.grasps.evaluation import using
from grasp3d.grasps.hand_grasps import EvaluatedHandGrasps
from grasp3d.grasps.hand_load_result import load_text
from grasp3d.hand.gripper_pose import GripperPose
from grasp3d.hand.scene import Scene
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.settings import GraspModel
from grasp3d.settings.units import small_length
from grasp3d.stability.label import COLORS, Label
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_grasps import Reason, SearchReport
from grasp3d.system.counts import short_number
from grasp3d.viewer.session.inspection import UNKNOWN, Inspection, MarkedContacts, signed_angle
from grasp3d.viewer.session.painting import ROUNDING
from grasp3d.viewer.subjects.subject import Subject, subject_of

WHY = {
    Label.S: "Surely stable: it holds whatever its true normals are.",
    Label.M: "Ambiguous: some normals that the sensors cannot tell apart do not hold it.",
    Label.U: "Surely unstable: no normals that the sensors cannot tell apart hold it.",
}
"""Reasons of grasps that the hand can reach."""


def subject_of_poses(grasps: GivenGrasps) -> Subject:
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


def marked_pose(grasps: GivenGrasps, row: int) -> MarkedContacts:
    """The contacts of a pose, with the hand that makes them.

    The links that touch, or the fingers of a gripper, have the colour of the letter.

    Args:
        grasps: Evaluated poses.
        row: Number of the pose.
    """
    if isinstance(grasps, EvaluatedHandGrasps):
        return MarkedContacts(*grasps.contacts_of(row), grasps.model, _hand_at(grasps, row))
    assert isinstance(grasps, EvaluatedPoses)
    jaws, given, touching = grasps.jaws, grasps.given, np.array([], dtype=np.int64)
    opening = grasps.hand.max_opening
    if jaws.closed[row]:
        opening, touching = float(jaws.opening[row]), np.arange(2)
    held = GripperPose(
        jaws.poses[row] if jaws.closed[row] else given.poses[row],
        opening,
        float(given.pregrasp_opening[row]),
        float(grasps.approach_margin[row]),
        math.nan,
        colors={0: COLORS[Label(int(grasps.label[row]))]},
    )
    return MarkedContacts(
        jaws.points[row, touching], jaws.normals[row, touching], grasps.model, held
    )


def _hand_at(grasps: EvaluatedHandGrasps, row: int) -> GripperPose:
    contacts, color = grasps.contacts, COLORS[Label(int(grasps.letter[row]))]
    return GripperPose(
        contacts.poses[row], 0.0, math.nan, math.nan, math.nan,
        posture=contacts.posture[row],
        toward=grasps.hand.approach,
        colors=dict.fromkeys(np.flatnonzero(grasps.touching[row]).tolist(), color),
    )  # fmt: skip


def inspect_pose(grasps: GivenGrasps, model: GraspModel) -> Inspection:
    """Inspect the first pose at another friction and sensor resolution.

    Args:
        grasps: Evaluated poses.
        model: Friction and resolution.
    """
    if isinstance(grasps, EvaluatedHandGrasps):
        found: EvaluatedPoses | EvaluatedHandGrasps = grasps.using(model)
    else:
        assert isinstance(grasps, EvaluatedPoses)
        same = grasps.model == replace(model, fingers=grasps.model.fingers)
        model = grasps.model if same else replace(model, fingers=grasps.model.fingers)
        again = grasps if same else using(grasps, model=model, load=grasps.load)
        assert isinstance(again, EvaluatedPoses)
        found = again
    marked = marked_pose(found, 0)
    listed = _numbers(found) if isinstance(found, EvaluatedHandGrasps) else _gripper_numbers(found)
    return Inspection(
        marked.points, marked.normals, model, marked.held, vertex=None,
        code=int(found.letter[0]),
        numbers=tuple(listed),
        reason=reason_of(found, 0),
    )  # fmt: skip


def reason_of(grasps: GivenGrasps, row: int) -> str:
    """Why a pose is S, M or U, or what is wrong with it, in one sentence."""
    reason = str(grasps.reason[row])
    text = f"{reason[:1].upper()}{reason[1:]}." if reason else ""
    if text and not grasps.reachable[row]:
        return f"Not a grasp as it is: {reason}."
    return text or WHY[Label(int(grasps.letter[row]))]


def _gripper_numbers(grasps: EvaluatedPoses) -> list[tuple[str, str]]:
    """Names and values of the first pose of a gripper; those that are not known are left out."""
    numbers = [("pose", str(grasps.given.names[0]))]
    numbers.append(("score", f"{grasps.score[0]:.2f}"))
    if not grasps.jaws.closed[0]:
        return numbers
    numbers += _angles(grasps)
    numbers.append(("ε", f"{grasps.epsilon[0]:.3g}"))
    if grasps.load is not None:
        force, payload = float(grasps.grip_force[0]), float(grasps.payload[0])
        text = f"{short_number(force)} N" if math.isfinite(force) else "no force suffices"
        numbers.append(("needs", text))
        numbers += [("holds", f"{short_number(payload)} kg")] if math.isfinite(payload) else []
    numbers.append(("opening", grasps.mesh.length_text(grasps.opening[0])))
    if math.isfinite(turn := float(grasps.approach_margin[0])):
        numbers.append(("approach may turn", f"±{math.degrees(turn):.1f}°"))
    return numbers


def _angles(grasps: GivenGrasps) -> list[tuple[str, str]]:
    """Critical angle, coarsest resolution and margin of the first pose, as far as known."""
    return [
        (name, signed_angle(float(value), always=name == "margin"))
        for name, value in (
            ("β*", grasps.critical_angle[0]),
            ("α*", grasps.max_resolution[0]),
            ("margin", grasps.margin[0]),
        )
        if math.isfinite(value)
    ]


def _numbers(grasps: EvaluatedHandGrasps) -> list[tuple[str, str]]:
    """Names and values of the first pose; those that are not known are left out."""
    contacts = grasps.contacts
    links = grasps.links[0].split()
    numbers = [
        ("pose", str(grasps.given.names[0])),
        ("contacts", contacts.rule),
        ("links", ", ".join(links) or "none"),
        *_angles(grasps),
        ("ε", f"{grasps.epsilon[0]:.3g}" if math.isfinite(grasps.epsilon[0]) else UNKNOWN),
        ("rank", str(grasps.rank[0])),
        *_held(grasps),
    ]
    lengths = (
        ("gap", grasps.gap[0]),
        ("inside the object", grasps.penetration[0]),
        ("links overlap", grasps.overlap[0]),
        ("below the table", grasps.below_table[0]),
    )
    least = ROUNDING * grasps.mesh.size
    numbers += [
        (name, small_length(value, metres=True, digits=2))
        for name, value in lengths
        if value > least
    ]
    return numbers


def _held(grasps: EvaluatedHandGrasps) -> list[tuple[str, str]]:
    """What the motors hold at the first pose; nothing where no load is stated, or no grasp is."""
    load_result = grasps.hand_load_result
    if load_result is None or math.isnan(load_result.payload[0]):
        return []
    load = load_text(load_result.load_fraction[0]) if load_result.load.decided else ""
    return [
        ("holds", f"{short_number(load_result.payload[0])}{load_result.unit}"),
        ("holds surely", f"{short_number(load_result.payload_min[0])}{load_result.unit}"),
        ("limited by", str(load_result.limit[0]) or UNKNOWN),
        *([(load_result.load.to_hold, f"load {load}")] if load else []),
    ]
