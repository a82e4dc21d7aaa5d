"""Grasps of ideal points as the jaws of a gripper make them, closed at their poses."""

import math
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Bytes, Floats, Ints, short_repr
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.grasps.pose_evaluation import evaluate_poses
from grasp3d.grasps.poses import GraspPoses
from grasp3d.stability.label import Label
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.spread_grasps import NO_ROW, rows_where, spread
from grasp3d.system.progress import Progress

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
        >>> grasps.closed.evaluated.opening.round(3).tolist()
        [0.05, 0.05]
    """

    evaluated: EvaluatedPoses | None
    """What the jaws touch, the labels and everything else, k rows; None: k is 0."""
    row: Ints
    """Row of each grasp there, -1: it is not known, shape (b,)."""

    __repr__ = short_repr

    @cached_property
    def label(self) -> Ints:
        """`Label` codes at the contacts of the closed jaws, shape (b,); -1: not known."""
        return self._spread("label", UNKNOWN)

    @cached_property
    def margin(self) -> Floats:
        """Margin there [rad], shape (b,); nan: not known, or the jaws do not close on the object.

        As in `GraspTable.margin`.
        """
        return self._spread("margin", math.nan)

    def take(self, rows: Ints) -> "ClosedGrasps":
        """The chosen grasps, in that order.

        Args:
            rows: Their indices, shape (c,).
        """
        row = self.row[rows]
        known = row != NO_ROW
        if self.evaluated is None or not known.any():
            return ClosedGrasps(None, rows_where(np.zeros(len(row), np.bool_)))
        return ClosedGrasps(self.evaluated.take(row[known]), rows_where(known))

    def _spread(self, name: str, missing: float) -> npt.NDArray[Any]:
        """Results of the poses at the grasps, shape (b,)."""
        if self.evaluated is None:
            return np.full(len(self.row), missing)
        return spread(getattr(self.evaluated, name).astype(type(missing)), self.row, missing)

    def note(self, labels: Bytes) -> str:
        """A sentence if the closed jaws confirm none of the labels S and M; else empty.

        A label is confirmed by the same or a better one.

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


def close_on(grasps: GraspTable, *, progress: Progress | None = None) -> ClosedGrasps:
    """Close the jaws on a free object at the poses of grasps, and evaluate what they touch.

    Args:
        grasps: Grasps of two fingers with a gripper; those without a pose are not known.
        progress: Called with the fraction of the work done, from 0 to 1.
    """
    mesh, reach, scene = grasps.mesh, grasps.reach, grasps.scene
    assert reach is not None
    assert scene is not None
    external = reach.pregrasp_opening >= reach.opening
    known = external & np.isfinite(reach.poses).all(axis=(1, 2))
    rows, row = np.flatnonzero(known), rows_where(known)
    if not len(rows):
        return ClosedGrasps(None, row)
    poses = GraspPoses(
        poses=reach.poses[rows],
        opening=reach.opening[rows],
        pregrasp_opening=reach.pregrasp_opening[rows],
        posture=reach.posture[rows],
        unit=mesh.unit,
    )
    found = evaluate_poses(
        mesh, poses, grasps.model, scene, load=grasps.load, threads=grasps.threads,
        progress=progress,
    )  # fmt: skip
    return ClosedGrasps(found, row)
