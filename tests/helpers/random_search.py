"""Random antipodal poses of a gripper, found independently of the package's own search."""

import math

import numpy as np
import trimesh

from grasp3d import ObjectMesh
from grasp3d.hand.reach import collides
from grasp3d.hand.scene import Scene
from tests.helpers.closing_jaws import Floats

APPROACHES = 12


def random_poses_on(mesh: ObjectMesh, scene: Scene, *, pairs: int, seed: int) -> Floats:
    """Free poses at random pairs of opposed points, approached from all around [m]."""
    random = np.random.default_rng(seed)
    surface = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    points, face = trimesh.sample.sample_surface(surface, 4 * pairs, seed=seed)
    inward = -surface.face_normals[face]
    rays = inward + 0.3 * random.standard_normal(inward.shape)
    rays /= np.linalg.norm(rays, axis=1, keepdims=True)
    ends, number, hit = surface.ray.intersects_location(points + 1e-6 * rays, rays)
    least = math.cos(math.atan(0.5))
    opposed = (surface.face_normals[hit] * rays[number]).sum(axis=1) > least
    opposed &= (inward[number] * rays[number]).sum(axis=1) > least
    fits = np.linalg.norm(ends - points[number], axis=1) < scene.hand.max_opening
    chosen = np.flatnonzero(opposed & fits)
    chosen = chosen[random.permutation(len(chosen))[:pairs]]
    starts, ends = points[number[chosen]], ends[chosen]
    closing = (ends - starts) / np.linalg.norm(ends - starts, axis=1, keepdims=True)
    other = np.eye(3)[np.abs(closing).argmin(axis=1)]
    across = np.cross(closing, other)
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    found = []
    for angle in 2.0 * math.pi * np.arange(APPROACHES) / APPROACHES:
        approach = math.cos(angle) * across + math.sin(angle) * np.cross(closing, across)
        for depth in (-0.3, 0.0, 0.3):
            poses = np.tile(np.eye(4), (len(closing), 1, 1))
            poses[:, :3, 0], poses[:, :3, 2] = closing, approach
            poses[:, :3, 1] = np.cross(approach, closing)
            poses[:, :3, 3] = 0.5 * (starts + ends) + depth * scene.hand.pad_height * approach
            found.append(poses)
    every = np.concatenate(found)
    every = every[scene.allows(every)]
    stroke = scene.hand.max_opening
    return every[~collides(mesh, every, stroke, scene.hand, table=scene.table)]
