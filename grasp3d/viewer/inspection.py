"""Inspection of a vertex, a given grasp or a pose: contacts, numbers, and label with reason."""

import math
from dataclasses import dataclass, replace

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.describe.explanations import (
    PAIR,
    Case,
    cause_at,
    explain,
    facts,
    load_sentence,
    position_text,
)
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.hand.gripper_pose import GripperPose
from grasp3d.pictures.colors import label_codes
from grasp3d.pictures.marks import MarkedContacts
from grasp3d.pictures.subject import Subject
from grasp3d.settings import GraspModel
from grasp3d.stability.label import Label
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.vertex_fields import Reason

WHY = {
    Label.S: "Surely stable: it holds whatever its true normals are.",
    Label.M: "Ambiguous: some normals that the sensors cannot tell apart do not hold it.",
    Label.U: "Surely unstable: no normals that the sensors cannot tell apart hold it.",
}
"""Reasons for the labels of poses that the hand can reach."""


@dataclass(frozen=True, eq=False, kw_only=True)
class Inspection(MarkedContacts):
    """A grasp as it is listed and drawn.

    An inspected vertex is the first contact, and the only one if it has no grasp.
    """

    vertex: int | None
    """Index of the vertex; None: a given grasp, or a pose."""
    code: int
    """Label, or `UNSEARCHED`."""
    numbers: tuple[tuple[str, str], ...]
    """Names, and values with units."""
    reason: str
    """One sentence on why the grasp is S, M or U."""


def inspect(subject: Subject, vertex: int) -> Inspection:
    """Inspect the best grasp of a vertex, or say why there is none.

    Args:
        subject: The surface.
        vertex: Index of the vertex.
    """
    return _inspection(subject, subject.labels.take(np.array([vertex])), vertex)


def inspect_given(subject: Subject, model: GraspModel) -> Inspection | None:
    """Inspect the given grasp, labelled like the grasps of a scan; None if there is none.

    Args:
        subject: The surface.
        model: Friction and resolution; the number of fingers is the subject's.
    """
    if subject.given is None:
        return None
    return _inspection(subject, subject.given.using(model=model), None)


def _inspection(subject: Subject, grasp: GraspTable, vertex: int | None) -> Inspection:
    """Inspect the grasp in the only row of a table."""
    labels, model = subject.labels, subject.model
    points, normals = grasp.contacts.points[0], grasp.contacts.normals[0]
    numbers, found = [] if vertex is None else [("vertex", f"{vertex}")], True
    if vertex is not None and labels.reason[vertex] != Reason.FOUND:
        found, points, normals = (
            False,
            labels.mesh.vertices[[vertex]],
            labels.mesh.normals[[vertex]],
        )
    numbers.append(("position", position_text(points[0], labels.mesh)))
    worst, best = grasp.critical_angle, grasp.critical_angle_best
    case = Case(
        model=model,
        mode="scan" if vertex is None else labels.mode,
        code=int(label_codes(subject, worst, best)[0]),
        worst=float(worst[0]),
        best=float(best[0]),
        cone=subject.cone,
        cause=None if vertex is None else cause_at(labels, vertex),
        off_line=_off_line(points, normals),
        hand=None if labels.scene is None else labels.scene.hand.name,
    )
    if found and (case.located or not case.smooth):
        creased = np.flatnonzero(grasp.contacts.on_crease[0])
        case = replace(case, creases=tuple(creased.tolist()))
    held = ""
    if math.isinf(case.best):
        numbers.append(("β*", "no grasp"))
    else:
        numbers += facts(grasp, 0).items()
        if case.off_line is not None:
            first, second = (math.degrees(angle) for angle in case.off_line)
            numbers.append(("normals off the line", f"{first:.1f}° and {second:.1f}°"))
        held = "" if grasp.load_result is None else load_sentence(grasp.load_result, 0)
    return Inspection(
        points, normals, model, GripperPose.of(grasp.reach, 0), vertex=vertex, code=case.code,
        numbers=tuple(numbers), reason=f"{explain(case)} {held}".rstrip(),
    )  # fmt: skip


def _off_line(points: Floats, normals: Floats) -> tuple[float, float] | None:
    """Angles of two normals to the line through two contacts [rad], for the better grip."""
    if len(points) != PAIR:
        return None
    line = points[1] - points[0]
    length = np.linalg.norm(line)
    if not (length > 0.0 and (normals != 0.0).any(axis=1).all()):
        return None
    directions = np.stack([line, -line]) / length
    cosines = np.clip(np.einsum("ij,ij->i", normals, directions), -1.0, 1.0)
    first, second = (float(angle) for angle in np.arccos(cosines))
    if max(first, second) <= max(math.pi - first, math.pi - second):
        return first, second
    return math.pi - first, math.pi - second


def inspect_pose(grasps: EvaluatedPoses, model: GraspModel) -> Inspection:
    """Inspect the first pose at another friction and sensor resolution.

    Args:
        grasps: Evaluated poses.
        model: Friction and resolution.
    """
    found = grasps.using(model=model)
    marked, name = MarkedContacts.of_pose(found, 0), str(found.given.names[0])
    return Inspection(
        marked.points, marked.normals, model, marked.held, vertex=None,
        code=int(found.letter[0]), numbers=(("pose", name), *facts(found, 0).items()),
        reason=reason_of(found, 0),
    )  # fmt: skip


def reason_of(grasps: EvaluatedPoses, row: int) -> str:
    """Say in one sentence why a pose is S, M or U, or what is wrong with it."""
    reason = str(grasps.reason[row])
    text = f"{reason[:1].upper()}{reason[1:]}." if reason else ""
    if text and not grasps.reachable[row]:
        return f"Not a grasp as it is: {reason}."
    return text or WHY[Label(int(grasps.letter[row]))]
