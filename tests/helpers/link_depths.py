"""Bounds on the depths of convex shapes and surfaces in each other: dense and slow."""

from collections.abc import Callable

import numpy as np
from scipy.spatial import ConvexHull

from grasp3d.arrays import Floats
from grasp3d.hand.link_tree import LinkShape

Depths = Callable[[Floats], Floats]
"""Depth of each point (n, 3) below a surface; negative outside, where it may be even smaller."""


def depth_in_shape(one: LinkShape) -> Depths:
    """Return the depth function of a shape, in its frame; it is exact inside."""
    size = np.array([*one.size, 0.0, 0.0][:3])

    def box(points: Floats) -> Floats:
        away = np.abs(points) - size
        return -np.linalg.norm(np.maximum(away, 0.0), axis=1) - np.minimum(away.max(axis=1), 0.0)

    def round_one(points: Floats) -> Floats:
        away = np.column_stack([np.hypot(*points.T[:2]), np.abs(points[:, 2])]) - size[:2]
        if one.kind == "cylinder":
            outside = np.linalg.norm(np.maximum(away, 0.0), axis=1)
            return -outside - np.minimum(away.max(axis=1), 0.0)
        half = size[1] if one.kind == "capsule" else 0.0
        beyond = np.maximum(np.abs(points[:, 2]) - half, 0.0)
        return size[0] - np.hypot(away[:, 0] + size[0], beyond)

    if one.kind == "mesh":
        planes = ConvexHull(one.vertices).equations
        return lambda points: -(points @ planes[:, :3].T + planes[:, 3]).max(axis=1)
    return box if one.kind == "box" else round_one


def depth_of_link(one: LinkShape, pose: Floats, depth: Depths, finest: float) -> Floats:
    """Bounds on the largest depth of a placed shape's points below a surface, (2,).

    Cells of the box around the shape are divided while they may contain a deeper point: depths
    differ by at most the distance between points.
    """
    own, points = depth_in_shape(one), one.triangles().reshape(-1, 3)
    low, high = points.min(axis=0), points.max(axis=0)
    half, middles = 0.5 * (high - low), 0.5 * (low + high)[None]
    best = float(depth(points @ pose[:3, :3].T + pose[:3, 3]).max())
    corners = np.array(np.meshgrid(*[[-0.5, 0.5]] * 3)).reshape(3, 8).T
    while True:
        around = float(np.linalg.norm(half))
        inner = own(middles)
        middles, inner = middles[inner > -around], inner[inner > -around]
        found = depth(middles @ pose[:3, :3].T + pose[:3, 3])
        best = max(best, float(found[inner >= 0.0].max(initial=-np.inf)))
        # A path that leads out of the cell or the shape ends there.
        most = found + around
        middles = middles[most > max(best, 0.0) + finest]
        if around <= finest or not len(middles):
            top = float(most.max(initial=best))
            return np.array([best, max(best, min(top, best + finest + around))])
        half = 0.5 * half
        middles = (middles[:, None] + 2.0 * half * corners).reshape(-1, 3)


def depth_of_surface(one: LinkShape, pose: Floats, triangles: Floats, finest: float) -> Floats:
    """Bounds on the largest depth of points of triangles (n, 3, 3) in a placed shape, (2,)."""
    own = depth_in_shape(one)
    parts = (triangles - pose[:3, 3]) @ pose[:3, :3]
    best, top = -np.inf, -np.inf
    while len(parts):
        middles = parts.mean(axis=1)
        around = np.linalg.norm(parts - middles[:, None], axis=2).max(axis=1)
        found = own(middles)
        best = max(best, float(found.max()))
        most = found + around
        parts, fine = parts[most > max(best, 0.0) + finest], around.max() <= finest
        if fine or not len(parts):
            top = max(top, float(most.max(initial=-np.inf)))
            break
        between = 0.5 * (parts + np.roll(parts, -1, axis=1))
        quarters = [np.stack([parts[:, i], between[:, i], between[:, i - 1]], 1) for i in range(3)]
        parts = np.concatenate([between, *quarters])
    return np.array([best, max(best, min(top, max(best, 0.0) + 2.0 * finest))])
