"""Grasps of ideal points as the jaws of a gripper make them, closed at their poses."""

import math
from dataclasses import dataclass

import numpy as np

from grasp3d.arrays import Bools, Bytes, Floats, Ints, locked, short_repr
from grasp3d.hand.closed_jaws import ClosedJaws
from grasp3d.hand.reach import Reach
from grasp3d.hand.scene import Scene
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.region import allowed_contacts
from grasp3d.quality.critical_angle import critical_friction_angle
from grasp3d.settings import GraspModel, with_fingers
from grasp3d.stability.label import Label
from grasp3d.stability.thresholds import label_angles, margins
from grasp3d.surface.contacts import JawContacts
from grasp3d.surface.grasp_numbers import hull_labels, located_angles_of
from grasp3d.surface.holding import Holding
from grasp3d.surface.rows import NO_ROW, rows_where, spread
from grasp3d.system.context import report_progress, within

JAWS_CLOSED = 0.7
"""Fraction of the work after which the jaws are closed."""

UNKNOWN = -1
"""Code of a label that is not known."""


@dataclass(frozen=True, eq=False)
class ClosedGrasps:
    """What becomes of grasps of ideal points when the jaws close at their poses, a row for each.

    The jaws touch patches where a label has points, and a free object gives way; see
    `evaluate_grasps`. It is not known for internal grasps, whose fingers push outward.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> box = trimesh.creation.box([0.08, 0.05, 0.03])
        >>> mesh = grasp3d.load_mesh(box, unit="m", max_edge=0.02)
        >>> gripper = grasp3d.ParallelGripper.preset("franka")
        >>> grasps = grasp3d.best_grasps(grasp3d.label_surface(mesh, hand=gripper), 2)
        >>> grasps.closed.label.tolist(), grasps.closed.margin.round(2).tolist()
        ([2, 2], [0.27, 0.27])
        >>> grasps.closed.jaws.opening.round(3).tolist()
        [0.05, 0.05]
    """

    label: Ints
    """`Label` codes at the contacts of the closed jaws, shape (b,); -1: not known."""
    margin: Floats
    """Margin there [rad], as in `GraspTable.margin`, shape (b,); nan: not known, or the jaws do not
    close on the object."""
    row: Ints
    """Row of each grasp in `jaws`, -1: it is not known, shape (b,)."""
    jaws: ClosedJaws | None
    """What the jaws touch, k rows; None: k is 0."""

    __repr__ = short_repr

    def take(self, rows: Ints) -> "ClosedGrasps":
        """The chosen grasps, in that order.

        Args:
            rows: Their indices, shape (c,).
        """
        row = self.row[rows]
        has_row = row != NO_ROW
        return ClosedGrasps(
            label=locked(self.label[rows]),
            margin=locked(self.margin[rows]),
            row=rows_where(has_row),
            jaws=None if self.jaws is None or not has_row.any() else self.jaws.take(row[has_row]),
        )

    def with_forces(self, holding: Holding, forces: Holding) -> Holding:
        """Forces and payloads where the jaws touch; where they do not close, none suffices.

        Args:
            holding: Those of the grasps of ideal points (b,), which stay where it is not known what
                the jaws touch.
            forces: Those at the contacts of all grasps whose jaws close.
        """
        assert self.jaws is not None
        row = spread(rows_where(self.jaws.closed), self.row, NO_ROW)
        after, known = forces.spread(row), self.row != NO_ROW
        lost = known & (row == NO_ROW)
        return holding.replaced(known, after).replaced(lost, Holding.failed(holding.case, len(row)))

    def allowed(self, mesh: ObjectMesh) -> Bools:
        """Whether the closed jaws touch the object where contacts may be, or it is not known, (b,).

        Args:
            mesh: The object.
        """
        if self.jaws is None:
            return np.ones(len(self.row), dtype=bool)
        return spread(allowed_contacts(mesh, self.jaws.points), self.row, missing=True)

    def note(self, labels: Bytes) -> str:
        """A sentence if the closed jaws confirm none of the labels S and M; else empty.

        A label is confirmed by the same or a better label.

        Args:
            labels: `Label` codes of the grasps of ideal points, shape (b,).
        """
        tried = (self.label != UNKNOWN) & (labels != Label.U)
        if not tried.any() or (self.label >= labels)[tried].any():
            return ""
        counts = np.bincount(self.label[tried], minlength=len(Label))
        become = " and ".join(
            f"{counts[label]} {label.name}" for label in sorted(Label) if counts[label]
        )
        return (
            f"no label is confirmed when the jaws close ({become}): they touch patches instead of "
            "points, or the object slides out; other fingertips may hold it better"
        )


def close_on(mesh: ObjectMesh, reach: Reach, scene: Scene, model: GraspModel) -> ClosedGrasps:
    """Close the jaws on a free object at the poses of grasps, and label what they touch.

    Args:
        mesh: The object.
        reach: Poses of grasps (b,); those without one are not known.
        scene: The gripper, one of two fingers.
        model: Friction and sensor resolution.
    """
    hand = scene.hand
    external = reach.pregrasp_opening >= reach.opening
    has_pose = external & np.isfinite(reach.poses).all(axis=(1, 2))
    rows, row = np.flatnonzero(has_pose), rows_where(has_pose)
    if not len(rows):
        unknown = np.full(len(row), UNKNOWN)
        return ClosedGrasps(unknown, np.full(len(row), math.nan), row, None)
    model = with_fingers(model, hand.fingers[-1])
    with within(0.0, JAWS_CLOSED):
        jaws = hand.close(
            mesh,
            reach.poses[rows],
            posture=reach.posture[rows],
            object_motion="free",
            friction=float(np.min(model.frictions)),
        )
    labels, margin = np.full(len(rows), int(Label.U)), np.full(len(rows), math.nan)
    contacts = JawContacts.of(mesh, jaws)
    if contacts.size:
        angles = critical_friction_angle(contacts.contacts(model))
        located = located_angles_of(contacts, (angles, angles), model)
        exact = model.method == "exact"
        labels[jaws.closed] = (
            label_angles(*located, model) if exact else hull_labels(contacts, model)
        )
        margin[jaws.closed] = margins(located[0], model)
    report_progress(1.0)
    return ClosedGrasps(spread(labels, row, UNKNOWN), spread(margin, row, math.nan), row, jaws)
