"""Initial closing directions of the search for antipodal grasps."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling.decorators import kernel
from grasp3d._kernels.surface.normal_angles import smallest_angle
from grasp3d._kernels.surface.ray_tracing import starting_rays

GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))
"""Turn between consecutive directions of a sunflower spiral [rad]."""


class Frames(NamedTuple):
    """Coordinate frames of the directions at each vertex."""

    centres: npt.NDArray[np.float64]
    """Centre of the vertex's set of normals (V, 3)."""
    tangents: npt.NDArray[np.float64]
    """A unit vector orthogonal to the centre (V, 3)."""
    radii: npt.NDArray[np.float64]
    """Largest angle from the centre to a normal [rad] (V,)."""


@kernel
def seed_rays(vertices, rays, batch, cone, sign, frames, sets, grasps):
    """Rays in initial closing directions about each vertex's normals.

    A sunflower spiral over the cap of half-angle `cone` about the normal, the first ray along it.
    At a crease the cap is about the centre of the set of normals and large enough for all of them,
    the corners of the set come next, and directions outside the union of the normals' cones are
    skipped. So are directions at a larger angle to the normals than the critical angles of all
    cached grasps: no second contact could make them better.

    Args:
        vertices: Vertices (n,).
        rays: Directions per vertex.
        batch: (first, last): range of the directions; last is excluded.
        cone: Half-angle of the search cone [rad].
        sign: +1 squeeze, -1 expand.
        frames: `Frames`.
        sets: `ContactNormals`.
        grasps: `BestPairs`.

    Returns:
        The `Rays`.
    """
    start, counts, normals = sets.start, sets.counts, sets.normals
    capacity = vertices.shape[0] * (batch[1] - batch[0])
    owner = np.empty(capacity, dtype=np.int32)
    closing = np.empty((capacity, 3))
    size = 0
    for v in vertices:
        # The critical angle is at least the angle between the direction and the vertex's normals.
        bound = min(cone, grasps.start_angles[v, -1])
        c, t = frames.centres[v], frames.tangents[v]
        bx, by, bz = (
            c[1] * t[2] - c[2] * t[1],
            c[2] * t[0] - c[0] * t[2],
            c[0] * t[1] - c[1] * t[0],
        )
        cap = 1.0 - math.cos(min(cone + frames.radii[v], math.pi))
        set_corners = 0 if counts[v] == 1 else min(counts[v], rays // 4)
        spiral_size = rays - set_corners
        for k in range(batch[0], batch[1]):
            if 0 < k <= set_corners:
                n = normals[start[v] + k - 1]
                x, y, z = n[0], n[1], n[2]
            else:
                step = 0 if k == 0 else k - set_corners
                # Equal steps of height cover equal areas of the cap.
                cosine = 1.0 - cap * step / spiral_size
                sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
                p, q = sine * math.cos(step * GOLDEN_ANGLE), sine * math.sin(step * GOLDEN_ANGLE)
                x = cosine * c[0] + p * t[0] + q * bx
                y = cosine * c[1] + p * t[1] + q * by
                z = cosine * c[2] + p * t[2] + q * bz
            if smallest_angle(normals, start[v], counts[v], x, y, z) > bound:
                continue
            owner[size] = v
            closing[size, 0], closing[size, 1], closing[size, 2] = x, y, z
            size += 1
    return starting_rays(owner, closing, np.full(size, sign, dtype=np.int8), size)
