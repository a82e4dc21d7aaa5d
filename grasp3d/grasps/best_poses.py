"""The best poses of a parallel gripper on an object, as `evaluate_grasps` says of a fixed pool."""

import math
from dataclasses import dataclass, replace

import numpy as np

from grasp3d.arrays import Bools, Floats, Ints
from grasp3d.formats.frames import as_read_again
from grasp3d.formats.poses import GraspPoses
from grasp3d.grasps.candidate_poses import candidate_poses, is_free
from grasp3d.grasps.jaw_grasps import JawGrasps
from grasp3d.grasps.ranking import (
    distance_of_distinct,
    distinct_rows,
    matched_distance,
    most_distinct,
    ranked_rows,
)
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.hand.scene import Scene
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.region import allowed_contacts
from grasp3d.quality.loads import Load
from grasp3d.settings import GraspModel, with_fingers
from grasp3d.settings.pose_error import PoseError, poses_of
from grasp3d.stability.label import Label
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.system.context import unreported

MOST_TRIED = 50
"""Poses of the pool that are also evaluated where poses are wrong."""

TURNS = tuple(map(math.radians, (10.0, 5.0, 5.0)))
"""First turns about x, y and z of the gripper by which poses are refined [rad]."""

SHIFT = 0.25
"""First shifts along y and z, in widths and heights of the pads."""

EQUAL = 1e-3
"""Difference of scores up to which a pose is preferred that does not turn the object."""

ROUNDS = 2
"""Rounds of refinement; each that improves less than half of the poses halves the steps."""


@dataclass(frozen=True, eq=False)
class PoseSearch:
    """The search for poses of a gripper on one object."""

    mesh: ObjectMesh
    model: GraspModel
    scene: Scene
    load: Load | None
    openings: tuple[float, float] = (0.0, math.inf)
    """Smallest and largest distance of the closed jaws [m]."""

    @classmethod
    def of(cls, labels: SurfaceLabels) -> "PoseSearch":
        """The search for the gripper, the table and the load of a labelled surface."""
        assert labels.scene is not None
        model = with_fingers(labels.model, labels.scene.hand.fingers[-1])
        limits, sampling = (0.0, math.inf), labels.sampling
        if sampling is not None and labels.model.fingers == 2:
            limits = sampling.min_opening, sampling.max_opening
        return cls(labels.mesh, model, labels.scene, labels.load, limits)

    @property
    def jaws(self) -> ParallelGripper:
        """The gripper."""
        assert isinstance(self.scene.hand, ParallelGripper)
        return self.scene.hand

    def pool(self) -> JawGrasps:
        """All poses of the pool that are free and within the approach, as if they were exact.

        None outside the region of the mesh, or the limits of openings.
        """
        found = self.evaluated(candidate_poses(self.mesh, self.scene), PoseError())
        return found.take(np.flatnonzero(self._allowed(found)))

    def best(self, pool: JawGrasps, count: int, *, unstable: bool = False) -> JawGrasps:
        """The best distinct poses of a pool that may hold, each refined, best first.

        Args:
            pool: What `pool` returned.
            count: Their largest number.
            unstable: Whether poses that are U follow them.
        """
        least = Label.U if unstable else Label.M
        if self.scene.pose_error:
            pool = pool.take(self._distinct(pool, max(count, MOST_TRIED), least))
            pool = self.evaluated(pool.poses)
        chosen = self._refined(pool.take(self._distinct(pool, count, least)))
        chosen = self.evaluated(as_read_again(self._closed_upon(chosen)))
        return self.evaluated(chosen.poses[ranked_rows(chosen)])

    def _closed_upon(self, chosen: JawGrasps) -> Floats:
        """Poses (k, 4, 4) at which the closing jaws leave the object where it is, if as good."""
        poses, rest = chosen.poses.copy(), chosen.jaws.poses
        rows = np.flatnonzero(self._free(rest))
        found = self.evaluated(rest[rows])
        better = self._allowed(found) & (found.score >= chosen.score[rows] - EQUAL)
        better &= found.letter >= chosen.letter[rows]
        poses[rows[better]] = rest[rows[better]]
        return poses

    def _distinct(self, pool: JawGrasps, count: int, least: Label) -> Ints:
        """Rows of distinct poses with such a letter or a better one, best first.

        While fewer than `count` are S, an S that shuts out two distinct ones is exchanged for them.
        """
        limit = distance_of_distinct(self.mesh)
        order, points = ranked_rows(pool), pool.jaws.points
        rows = order[pool.letter[order] == Label.S]
        sure = most_distinct(points[rows], pool.score[rows], limit, count)
        sure = rows[sure]
        others = order[(pool.letter[order] >= least) & (pool.letter[order] < Label.S)]
        for row in sure.tolist():
            others = others[matched_distance(points[others], points[row]) >= limit]
        apart = distinct_rows(points[others], count - len(sure), limit)
        return np.append(sure, others[apart])

    def _free(self, poses: Floats) -> Bools:
        """Whether poses (k, 4, 4) have an allowed approach, and the open gripper is free there."""
        free = self.scene.allows(poses)
        free[free] = is_free(self.mesh, self.scene, poses[free])
        return free

    def evaluated(self, poses: Floats, error: PoseError | None = None) -> JawGrasps:
        """What `evaluate_grasps` says of poses (k, 4, 4).

        Args:
            poses: The poses, in metres.
            error: How wrong they may be; None: as the scene states.
        """
        stroke = self.jaws.max_opening
        given = GraspPoses(
            poses=poses, pregrasp_opening=np.full(len(poses), stroke), unit=self.mesh.unit,
            hand=self.jaws, object_file=self.mesh.report.source,
            object_scale=self.mesh.file_scale,
        )  # fmt: skip
        scene = self.scene if error is None else replace(self.scene, pose_error=error)
        with unreported():
            return JawGrasps.closed_at(self.mesh, given, self.model, scene, load=self.load)

    def _allowed(self, found: JawGrasps) -> Bools:
        """Whether the jaws close where contacts may be, within the limits of openings."""
        least, most = self.openings
        # The object yields to the pads, as in the test of the stroke.
        soft = 2.0 * self.jaws.compliance
        within = (found.opening >= least - soft) & (found.opening - soft <= most)
        return found.jaws.closed & within & allowed_contacts(self.mesh, found.jaws.points)

    def _refined(self, chosen: JawGrasps) -> JawGrasps:
        """Poses improved by small turns and shifts.

        One that comes upon another stays as it was.
        """
        limit, scale = distance_of_distinct(self.mesh), 1.0
        for _ in range(ROUNDS if chosen.size else 0):
            tried = chosen.poses[:, None] @ self._moves(scale)  # (k, m, 4, 4)
            flat = tried.reshape(-1, 4, 4)
            as_it_was = np.arange(0, len(flat), tried.shape[1])
            free = np.union1d(as_it_was, np.flatnonzero(self._free(flat)))
            found = self.evaluated(flat[free])
            scores = np.full(len(flat), -1.0)
            scores[free] = np.where(self._allowed(found), found.score, -1.0)
            best = as_it_was + scores.reshape(tried.shape[:2]).argmax(axis=1)
            rows, better = np.searchsorted(free, as_it_was), np.searchsorted(free, best)
            points, moved = chosen.jaws.points.copy(), 0
            for row in np.flatnonzero(scores[best] > chosen.score).tolist():
                own = found.jaws.points[better[row]]
                gaps = np.delete(matched_distance(points, own), row)
                if gaps.min(initial=math.inf) >= limit:
                    rows[row], points[row] = better[row], own
                    moved += 1
            chosen = found.take(rows)
            if 2 * moved <= chosen.size:
                scale *= 0.5
        return chosen

    def _moves(self, scale: float) -> Floats:
        """Small motions in the frame of the gripper, shape (m, 4, 4); the first one is none."""
        turns = np.kron(np.diag(TURNS), [[1.0], [-1.0]])
        sizes = np.array([0.0, self.jaws.pad_width, self.jaws.pad_height])
        shifts = np.kron(np.diag(SHIFT * sizes)[1:], [[1.0], [-1.0]])
        still = np.zeros_like
        turned = poses_of(still(turns), np.asarray(scale * turns))
        return np.concatenate([turned, poses_of(np.asarray(scale * shifts), still(shifts))[1:]])
