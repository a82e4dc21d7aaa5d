"""The first directions in which a vertex's partner is sought."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling import kernel
from grasp3d._kernels.normal_angles import smallest_angle
from grasp3d._kernels.ray_tracing import starting_rays

GOLDEN = math.pi * (3.0 - math.sqrt(5.0))


class Frames(NamedTuple):
    """Where the directions about each vertex are laid out."""

    centres: npt.NDArray[np.float64]
    """Middle of the vertex's normals (V, 3)."""
    tangents: npt.NDArray[np.float64]
    """A direction across it (V, 3)."""
    radii: npt.NDArray[np.float64]
    """Largest angle from the middle to a normal [rad] (V,)."""


@kernel
def seed_rays(places, rays, batch, cone, sign, frames, sets, grasps):
    """Lay out the first directions about each place's own normals.

    A sunflower spiral over the cap of half-angle `cone` about the normal, the first ray along it.
    At a crease the cap is about the middle of the normals and wide enough for all of them, the
    normals themselves come next, and what lies outside the union of their cones is left out. So is
    a direction that is farther from the normal than all the grasps that are kept need: no partner
    could make it better.

    Args:
        places: Vertices (n,).
        rays: Directions per vertex.
        batch: (first, last): which of them; last not included.
        cone: Half-angle of the search cone [rad].
        sign: +1 squeeze, -1 expand.
        frames: `Frames`.
        sets: `Sets`.
        grasps: `Grasps`.

    Returns:
        The `Rays`.
    """
    start, counts, normals = sets.start, sets.counts, sets.normals
    room = places.shape[0] * (batch[1] - batch[0])
    owner = np.empty(room, dtype=np.int32)
    closing = np.empty((room, 3))
    size = 0
    for v in places:
        bound = min(cone, grasps.start_angles[v, -1])
        c, t = frames.centres[v], frames.tangents[v]
        bx, by, bz = (
            c[1] * t[2] - c[2] * t[1],
            c[2] * t[0] - c[0] * t[2],
            c[0] * t[1] - c[1] * t[0],
        )
        cap = 1.0 - math.cos(min(cone + frames.radii[v], math.pi))
        direct = 0 if counts[v] == 1 else min(counts[v], rays // 4)
        spread = rays - direct
        for k in range(batch[0], batch[1]):
            if 0 < k <= direct:
                n = normals[start[v] + k - 1]
                x, y, z = n[0], n[1], n[2]
            else:
                step = 0 if k == 0 else k - direct
                cosine = 1.0 - cap * step / spread
                sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
                p, q = sine * math.cos(step * GOLDEN), sine * math.sin(step * GOLDEN)
                x = cosine * c[0] + p * t[0] + q * bx
                y = cosine * c[1] + p * t[1] + q * by
                z = cosine * c[2] + p * t[2] + q * bz
            if smallest_angle(normals, start[v], counts[v], x, y, z) > bound:
                continue
            owner[size] = v
            closing[size, 0], closing[size, 1], closing[size, 2] = x, y, z
            size += 1
    return starting_rays(owner, closing, np.full(size, sign, dtype=np.int8), size)
