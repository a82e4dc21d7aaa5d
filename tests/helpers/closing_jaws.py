"""Grippers, poses and slow oracles for jaws that close on a surface."""

from typing import Any

import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from grasp3d.hand.parallel_gripper import ParallelGripper

Floats = NDArray[np.float64]


def pads(**changes: Any) -> ParallelGripper:
    """A gripper with flat pads of 20 x 10 mm and a stroke of 80 mm."""
    lengths = {
        "max_opening": 0.08, "pad_width": 0.02, "pad_height": 0.01, "finger_thickness": 0.01,
        "finger_width": 0.02, "finger_length": 0.05, "palm_thickness": 0.1, "palm_width": 0.05,
        "palm_length": 0.05,
    }  # fmt: skip
    return ParallelGripper(name="pads", **{**lengths, **changes})


def tips(**changes: Any) -> ParallelGripper:
    """The same gripper with round tips of 20 mm diameter."""
    return pads(**{"pad_width": 0.0, "pad_height": 0.0, "tip_radius": 0.01, **changes})


def pose(
    center: tuple[float, float, float] = (0.0, 0.0, 0.0), turn: Rotation | None = None
) -> Floats:
    """A pose with its TCP at a given point, with axes turned relative to the object's."""
    matrix = np.eye(4)
    matrix[:3, 3] = center
    if turn is not None:
        matrix[:3, :3] = turn.as_matrix()
    return matrix


def random_poses(count: int, spread: float, seed: int = 0) -> Floats:
    """Poses in all directions, with TCPs normally distributed about the origin."""
    rng = np.random.default_rng(seed)
    matrices = np.tile(np.eye(4), (count, 1, 1))
    matrices[:, :3, :3] = Rotation.random(count, random_state=rng).as_matrix()
    matrices[:, :3, 3] = rng.normal(0.0, spread, (count, 3))
    return matrices


def sliced_pad(
    solid: trimesh.Trimesh, matrix: Floats, hand: ParallelGripper, finger: int
) -> dict[str, Any] | None:
    """Contact of a flat pad, by cutting the mesh with planes; None if it touches nothing.

    trimesh cuts the surface, and its faces are taken as flat.
    """
    side = 1.0 - 2.0 * finger
    local = trimesh.Trimesh(
        (solid.vertices - matrix[:3, 3]) @ matrix[:3, :3], solid.faces, process=False
    )
    half = 0.5 * np.array([hand.pad_width, hand.pad_height])
    for axis, size in zip((1, 2), half, strict=True):
        for sign in (-1.0, 1.0):
            normal, origin = np.zeros(3), np.zeros(3)
            normal[axis], origin[axis] = -sign, sign * size
            local = local.slice_plane(origin, normal)
            if not len(local.faces):
                return None
    start = -0.5 * hand.max_opening - hand.compliance
    facing = (side * local.face_normals[:, 0] < -1e-9) & (local.area_faces > 0.0)
    x = side * local.triangles[:, :, 0]
    kept = facing & (x.min(axis=1) >= start) & (x.min(axis=1) <= 0.5 * hand.max_opening)
    if not kept.any():
        return None
    first = float(x[kept].min())
    local.update_faces(kept)
    local = local.slice_plane([side * (first + hand.compliance), 0, 0], [-side, 0, 0])
    areas = local.area_faces * np.abs(local.face_normals[:, 0])
    middle = (areas[:, None] * local.triangles_center).sum(axis=0) / areas.sum()
    inward = -(areas[:, None] * local.face_normals).sum(axis=0)
    corners = local.triangles[areas > 0.0].reshape(-1, 3)
    return {
        "position": side * first,
        "area": areas.sum(),
        "point": matrix[:3, :3] @ middle + matrix[:3, 3],
        "normal": matrix[:3, :3] @ inward / np.linalg.norm(inward),
        "extents": np.ptp(corners[:, 1:], axis=0),
    }


def sampled_ball(
    solid: trimesh.Trimesh, matrix: Floats, hand: ParallelGripper, finger: int
) -> dict[str, Any] | None:
    """Contact of a round tip, from small triangles; None if it touches nothing."""
    side, radius = 1.0 - 2.0 * finger, hand.tip_radius
    points = (solid.vertices - matrix[:3, 3]) @ matrix[:3, :3] * [side, 1.0, 1.0]
    triangles = points[solid.faces]
    facing = side * (solid.face_normals @ matrix[:3, 0]) < -1e-9
    square = radius**2 - (points[:, 1:] ** 2).sum(axis=1)
    position = np.full(len(points), np.inf)
    position[square > 0.0] = points[square > 0.0, 0] - np.sqrt(square[square > 0.0]) + radius
    used = np.zeros(len(points), dtype=bool)
    used[solid.faces[facing]] = True
    position[~used | (position < -0.5 * hand.max_opening - hand.compliance)] = np.inf
    first = position.min()
    if not first < 0.5 * hand.max_opening:
        return None
    centre = np.array([first + hand.compliance - radius, 0.0, 0.0])
    middles = triangles.mean(axis=1)
    inside = facing & (np.linalg.norm(middles - centre, axis=1) < radius)
    areas = np.where(inside, solid.area_faces, 0.0)
    if not inside.any():
        return {"position": side * first, "area": 0.0}
    mean = (areas[:, None] * middles).sum(axis=0) / areas.sum() * [side, 1.0, 1.0]
    inward = -(areas[:, None] * solid.face_normals).sum(axis=0)
    return {
        "position": side * first,
        "area": areas.sum(),
        "point": matrix[:3, :3] @ mean + matrix[:3, 3],
        "normal": inward / np.linalg.norm(inward),
    }
