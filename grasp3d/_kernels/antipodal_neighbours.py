"""Closing directions toward the opposing contacts of neighbouring vertices."""

import math

import numpy as np

from grasp3d._kernels.antipodal_candidates import FOUND
from grasp3d._kernels.compiling import kernel
from grasp3d._kernels.normal_angles import smallest_angle
from grasp3d._kernels.ray_tracing import starting_rays


@kernel
def neighbour_rays(vertices, cone, points, neighbours, sets, grasps):
    """Rays from each vertex toward the opposing contacts that its neighbours found.

    Args:
        vertices: Vertices (n,).
        cone: Half-angle of the search cone [rad].
        points: Positions of the vertices (V, 3).
        neighbours: (first, index): the vertices around each vertex.
        sets: `ContactNormals`.
        grasps: `BestPairs`.

    Returns:
        The `Rays`.
    """
    start, counts, normals = sets.start, sets.counts, sets.normals
    first, index = neighbours
    capacity = 0
    for v in vertices:
        capacity += first[v + 1] - first[v]
    owner = np.empty(capacity, dtype=np.int32)
    closing = np.empty((capacity, 3))
    signs = np.empty(capacity, dtype=np.int8)
    size = 0
    for v in vertices:
        bound = min(cone, grasps.worst[v])
        for k in range(first[v], first[v + 1]):
            other = index[k]
            # An opposing contact of a neighbour is nearly one of this vertex: good grasps spread
            # from vertex to vertex.
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
