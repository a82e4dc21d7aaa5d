"""Closing directions toward the opposing contacts of neighbouring vertices."""

import math

import numpy as np

from grasp3d._kernels.compiling.decorators import kernel
from grasp3d._kernels.search.antipodal_candidates import FOUND
from grasp3d._kernels.surface.ray_tracing import append_ray, starting_rays


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
            x = grasps.partner[other, 0] - points[v, 0]
            y = grasps.partner[other, 1] - points[v, 1]
            z = grasps.partner[other, 2] - points[v, 2]
            length = math.sqrt(x * x + y * y + z * z)
            if length < 1e-6:
                continue
            toward = sign * x / length, sign * y / length, sign * z / length
            size = append_ray(size, v, sign, toward, bound, sets, owner, closing, signs)
    return starting_rays(owner, closing, signs, size)
