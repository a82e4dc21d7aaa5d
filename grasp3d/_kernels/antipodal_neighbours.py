"""Directions to the partners that the neighbouring vertices found."""

import math

import numpy as np

from grasp3d._kernels.antipodal_candidates import FOUND
from grasp3d._kernels.compiling import kernel
from grasp3d._kernels.normal_angles import smallest_angle
from grasp3d._kernels.ray_tracing import starting_rays


@kernel
def shared_rays(places, cone, points, neighbours, sets, grasps):
    """Directions from each place to the partners that its neighbours found.

    Args:
        places: Vertices (n,).
        cone: Half-angle of the search cone [rad].
        points: Positions of the vertices (V, 3).
        neighbours: (first, index): the vertices around each vertex.
        sets: `Sets`.
        grasps: `Grasps`.

    Returns:
        The `Rays`.
    """
    start, counts, normals = sets.start, sets.counts, sets.normals
    first, index = neighbours
    room = 0
    for v in places:
        room += first[v + 1] - first[v]
    owner = np.empty(room, dtype=np.int32)
    closing = np.empty((room, 3))
    signs = np.empty(room, dtype=np.int8)
    size = 0
    for v in places:
        bound = min(cone, grasps.worst[v])
        for k in range(first[v], first[v + 1]):
            other = index[k]
            if grasps.reason[other] != FOUND:
                continue
            sign = grasps.signs[other]
            d = sign * (grasps.partner[other] - points[v])
            length = math.sqrt(np.dot(d, d))
            if length < 1e-6:
                continue
            d /= length
            if smallest_angle(normals, start[v], counts[v], d[0], d[1], d[2]) <= bound:
                owner[size], signs[size] = v, sign
                closing[size] = d
                size += 1
    return starting_rays(owner, closing, signs, size)
