"""Poses and postures of hands with joints that touch an object."""

import numpy as np
from scipy.spatial.transform import Rotation

from grasp3d import ObjectMesh
from grasp3d.formats.poses import GraspPoses
from grasp3d.hand.articulated_hand import ArticulatedHand
from grasp3d.hand.link_contacts import CONTACT_DISTANCE, HandScene


def touching(hand: ArticulatedHand, mesh: ObjectMesh, count: int) -> GraspPoses:
    """Random grasps in which at least two links touch and no link is deep; wrists are straight."""
    rng = np.random.default_rng(0)
    scene = HandScene(mesh, hand, CONTACT_DISTANCE)
    low, high = np.clip(hand.limits_of_joints, -1.5, 1.5).T
    straight = ["WRJ" in name for name in hand.joint_names]
    tips = [hand.link_names.index(name) for name in hand.fingertips]
    poses, postures = np.zeros((0, 4, 4)), np.zeros((0, len(low)))
    while len(poses) < count:
        posture = rng.uniform(0.8 * low + 0.2 * high, 0.3 * low + 0.7 * high, (200, len(low)))
        posture[:, straight] = 0.0
        links = hand.link_poses(posture)[..., :3, 3]
        middle = 0.5 * (links[:, tips].mean(axis=1) + links[:, hand.link_names.index(hand.palm)])
        middle += rng.normal(0.0, 0.02, (200, 3))
        tried = np.tile(np.eye(4), (200, 1, 1))
        tried[:, :3, :3] = Rotation.random(200, rng=rng).as_matrix()
        tried[:, :3, 3] = mesh.center - np.einsum("kij,kj->ki", tried[:, :3, :3], middle)
        frames = scene.frames(tried, hand.postures(posture))
        gaps = scene.link_gaps(scene.touch(frames, contacts=False, search=CONTACT_DISTANCE))
        fits = (gaps <= CONTACT_DISTANCE).sum(axis=1) >= 2
        fits &= gaps.min(axis=1) >= -0.015
        poses = np.concatenate([poses, tried[fits]])
        postures = np.concatenate([postures, posture[fits]])
    return GraspPoses(
        poses=poses[:count],
        posture=postures[:count],
        joint_names=hand.joint_names,
        unit="m",
        hand=hand,
    )
