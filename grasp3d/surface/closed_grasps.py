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
from grasp3d.settings import GraspModel, with_fingers
from grasp3d.stability.label import Label
from grasp3d.surface.holding import Holding
from grasp3d.surface.load_case import LoadCase
from grasp3d.surface.robustness import Robustness, robustness_of
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
    robustness: Robustness | None = None
    """How well the patches hold, k rows; None: k is 0."""

    __repr__ = short_repr

    def number(self, name: str) -> Floats:
        """A number of `robustness` of each grasp, nan: it is not known, shape (b,).

        Args:
            name: Of the attribute.
        """
        values = getattr(self.robustness, name, None)
        if values is None:
            return np.full(len(self.row), math.nan)
        return spread(np.asarray(values, dtype=np.float64), self.row, math.nan)

    def take(self, rows: Ints) -> "ClosedGrasps":
        """The chosen grasps, in that order.

        Args:
            rows: Their indices, shape (c,).
        """
        row = self.row[rows]
        has_row = row != NO_ROW
        known = row[has_row]
        some = self.jaws is not None and len(known) > 0
        return ClosedGrasps(
            label=locked(self.label[rows]),
            margin=locked(self.margin[rows]),
            row=rows_where(has_row),
            jaws=self.jaws.take(known) if some and self.jaws else None,
            robustness=self.robustness.take(known) if some and self.robustness else None,
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


def close_on(
    mesh: ObjectMesh, reach: Reach, scene: Scene, model: GraspModel, case: LoadCase | None
) -> ClosedGrasps:
    """Close the jaws on a free object at the poses of grasps, and label what they touch.

    Args:
        mesh: The object.
        reach: Poses of grasps (b,); those without one are not known.
        scene: The gripper, one of two fingers; poses may be wrong by its error.
        model: Friction and sensor resolution.
        case: What must be held; None: nothing is stated.
    """
    hand = scene.hand
    external = reach.pregrasp_opening >= reach.opening
    has_pose = external & np.isfinite(reach.poses).all(axis=(1, 2))
    rows, row = np.flatnonzero(has_pose), rows_where(has_pose)
    if not len(rows):
        unknown = np.full(len(row), UNKNOWN)
        return ClosedGrasps(unknown, np.full(len(row), math.nan), row, None)
    model, poses = with_fingers(model, hand.fingers[-1]), reach.poses[rows]
    with within(0.0, JAWS_CLOSED):
        jaws = hand.close(
            mesh,
            poses,
            object_motion="free",
            friction=model.nominal_friction,
        )
    robustness = robustness_of(mesh, poses, jaws, scene, model, case, object_motion="free")
    stated = robustness.stated
    margin = np.where(stated.closes, stated.margin, math.nan)
    report_progress(1.0)
    return ClosedGrasps(
        spread(stated.label.astype(np.int64), row, UNKNOWN), spread(margin, row, math.nan), row,
        jaws, robustness,
    )  # fmt: skip
