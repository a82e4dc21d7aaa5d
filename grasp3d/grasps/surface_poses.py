"""Poses of grasps on a surface that a gripper reaches."""

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.errors import SettingError
from grasp3d.export.fields import columns_of
from grasp3d.export.grasp_fields import FOUND_POSES
from grasp3d.grasps.poses import GraspPoses
from grasp3d.surface.grasp_table import GraspTable


def poses_of(grasps: GraspTable) -> GraspPoses:
    """Poses of a gripper for grasps that it reaches, with all that is known of each.

    Args:
        grasps: Grasps with a hand that has poses for them, such as `best_grasps` returns.

    Returns:
        The poses in their order, in the unit of the mesh: openings, and as columns label, critical
        angle, alpha*, margin, epsilon, approach margin, depth, contacts and normals into the
        object, label and margin at what the closed jaws touch, with a load also grip forces and
        payload. The score is 1 - beta*/beta, from 1 where
        no friction is needed to 0 where no sensor makes the grasp S.

    Raises:
        SettingError: The grasps have no poses: there is no gripper, or one does not reach them.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.grasps import poses_of
        >>> box = trimesh.creation.box([0.08, 0.05, 0.03])
        >>> mesh = grasp3d.load_mesh(box, unit="m", max_edge=0.02)
        >>> hand = grasp3d.ParallelGripper.preset("franka")
        >>> labels = grasp3d.label_surface(mesh, hand=hand)
        >>> poses = poses_of(grasp3d.best_grasps(labels, 3))
        >>> poses.poses.shape, poses.unit, sorted(poses.columns)[:3]
        ((3, 4, 4), 'm', ['approach_margin', 'closed_label', 'closed_margin'])
    """
    reach, scene = grasps.reach, grasps.scene
    if reach is None or scene is None:
        raise SettingError(
            "the grasps have no poses: label the surface with a gripper (--hand, in Python "
            "hand=...)"
        )
    if not np.isfinite(reach.poses).all():
        raise SettingError(
            "grasps of three fingers and more, and those that are not reached, have no poses"
        )
    return GraspPoses(
        poses=reach.poses,
        opening=reach.opening,
        pregrasp_opening=reach.pregrasp_opening,
        posture=reach.posture,
        scores=_scores(grasps),
        unit=grasps.mesh.unit,
        hand=scene.hand,
        columns=columns_of(FOUND_POSES, grasps),
        object_file=grasps.mesh.report.source,
    )


def _scores(grasps: GraspTable) -> Floats:
    """Scores from 0 to 1, larger is better (k,)."""
    return np.clip(1.0 - grasps.critical_angle / grasps.model.friction_angle, 0.0, 1.0)
