"""Grippers with round numbers, and contacts to try them on."""

from dataclasses import replace

import numpy as np
from scipy.spatial.transform import Rotation

from grasp3d import ObjectMesh
from grasp3d.hand.parallel_gripper import ParallelGripper

HAND = ParallelGripper(
    name="hand",
    max_opening=0.08,
    finger_thickness=0.02,
    finger_width=0.02,
    finger_length=0.045,
    pad_width=0.018,
    pad_height=0.018,
    palm_thickness=0.12,
    palm_width=0.06,
    palm_length=0.06,
)
"""A gripper about as large as a Franka hand."""

TIPS = ParallelGripper(
    name="tips",
    max_opening=0.08,
    finger_thickness=0.01,
    finger_width=0.01,
    finger_length=0.06,
    tip_radius=0.008,
    palm_thickness=0.1,
    palm_width=0.04,
    palm_length=0.05,
    compliance=0.0005,
)
"""A gripper with round tips that are larger than the fingers."""

SLIM = replace(HAND, name="slim", finger_thickness=0.004, finger_width=0.008, pad_width=0.008)

GRIPPERS = (HAND, TIPS, SLIM)


def random_poses(mesh: ObjectMesh, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Poses about an object, in its unit, and openings of up to 80 mm in metres."""
    rng = np.random.default_rng(seed)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.random(count, rng=rng).as_matrix()
    poses[:, :3, 3] = mesh.center + rng.normal(size=(count, 3)) * 0.35 * mesh.size
    return poses, rng.uniform(0.0, 0.08, count)


def normalized_poses(mesh: ObjectMesh, poses: np.ndarray) -> np.ndarray:
    """Return the same poses in the normalised frame."""
    moved = poses.copy()
    moved[:, :3, 3] = (moved[:, :3, 3] - mesh.center) / mesh.size
    return moved


def opposed(mesh: ObjectMesh, count: int, seed: int) -> tuple[np.ndarray, np.ndarray]:
    """Contacts and inward normals on lines along random face normals through the object.

    The second contact is where the line leaves the object; its normal is opposite to the first.
    """
    body = mesh.to_trimesh()
    rng = np.random.default_rng(seed)
    faces = rng.integers(0, len(body.faces), count)
    start, inward = body.triangles_center[faces], -body.face_normals[faces]
    hits, rays, _ = body.ray.intersects_location(start + 1e-4 * mesh.size * inward, inward)
    along = ((hits - start[rays]) * inward[rays]).sum(axis=1)
    order = np.lexsort((along, rays))
    rays, along = rays[order], along[order]
    chosen, first = np.unique(rays, return_index=True)
    points = np.stack([start[chosen], start[chosen] + along[first, None] * inward[chosen]], axis=1)
    return points, np.stack([inward[chosen], -inward[chosen]], axis=1)
