"""Grasps of ideal points as the jaws of a gripper make them, closed at their poses."""

import math
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Bytes, Floats, Ints, locked, short_repr
from grasp3d.grasps.evaluated_poses import CLOSED_LABEL, CLOSED_MARGIN, EvaluatedPoses
from grasp3d.grasps.pose_evaluation import evaluate_poses
from grasp3d.grasps.poses import GraspPoses
from grasp3d.hand.reach import Reach
from grasp3d.hand.scene import Scene
from grasp3d.loads import Load
from grasp3d.mesh import ObjectMesh
from grasp3d.settings import GraspModel
from grasp3d.stability.label import Label

UNKNOWN = -1
"""Code of a label that is not known."""


@dataclass(frozen=True, eq=False)
class ClosedGrasps:
    """What becomes of grasps of ideal points when the jaws close at their poses, a row for each.

    The jaws touch patches where a label has points, and a free object gives way; see
    `evaluate_poses`. It is not known for internal grasps, whose fingers push outward.

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

    size: int
    """Number of grasps, b."""
    rows: Ints
    """Those of which it is known, shape (k,)."""
    evaluated: EvaluatedPoses | None
    """What the jaws touch there, the labels and everything else, k rows; None: k is 0."""

    __repr__ = short_repr

    @cached_property
    def label(self) -> Ints:
        """`Label` codes at the contacts of the closed jaws, shape (b,); -1: not known."""
        codes = np.full(self.size, UNKNOWN, dtype=np.int64)
        if self.evaluated is not None:
            codes[self.rows] = self.evaluated.label
        return locked(codes)

    @cached_property
    def margin(self) -> Floats:
        """Margin there [rad], shape (b,); nan: not known, or the jaws do not close on the object.

        As in `LabelledGrasps.margin`.
        """
        margins = np.full(self.size, math.nan)
        if self.evaluated is not None:
            margins[self.rows] = self.evaluated.margin
        return locked(margins)

    def take(self, rows: Ints) -> "ClosedGrasps":
        """The chosen grasps, in that order.

        Args:
            rows: Their indices, shape (c,).
        """
        position = np.full(self.size, UNKNOWN, dtype=np.int64)
        position[self.rows] = np.arange(len(self.rows))
        known = np.flatnonzero(position[rows] != UNKNOWN)
        found = None
        if self.evaluated is not None and len(known):
            found = self.evaluated.take(position[rows[known]])
        return replace(self, size=len(rows), rows=locked(known), evaluated=found)

    def columns(self) -> dict[str, npt.NDArray[np.generic]]:
        """Label, empty where it is not known, and margin, as columns of a file, shape (b,)."""
        names = np.array([*(label.name for label in sorted(Label)), ""])  # UNKNOWN is the last
        return {CLOSED_LABEL: names[self.label], CLOSED_MARGIN: self.margin}

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


def close_on_grasps(
    mesh: ObjectMesh,
    reach: Reach,
    scene: Scene,
    model: GraspModel,
    *,
    load: Load | None = None,
    threads: int | None = None,
) -> ClosedGrasps:
    """Close the jaws on a free object at the poses of grasps, and evaluate what they touch.

    Args:
        mesh: The object.
        reach: How the gripper reaches the grasps; those without a pose are not known.
        scene: The gripper, the table and the allowed approach.
        model: Friction and sensor resolution, for two fingers.
        load: What each grasp must hold; None: nothing.
        threads: Threads to use; None: one per processor. The result does not depend on it.
    """
    external = reach.pregrasp_opening >= reach.opening
    rows = locked(np.flatnonzero(external & np.isfinite(reach.poses).all(axis=(1, 2))))
    if not len(rows):
        return ClosedGrasps(len(reach.state), rows, None)
    poses = GraspPoses(
        poses=reach.poses[rows],
        opening=reach.opening[rows],
        pregrasp_opening=reach.pregrasp_opening[rows],
        unit=mesh.unit,
    )
    found = evaluate_poses(mesh, poses, model, load=load, threads=threads, scene=scene)
    return ClosedGrasps(len(reach.state), rows, found)
