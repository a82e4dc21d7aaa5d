"""Refinement of antipodal grasps: rings of closing directions about those found so far."""

import math

import numpy as np

from grasp3d._kernels.antipodal_candidates import line_turn
from grasp3d._kernels.compiling import kernel
from grasp3d._kernels.normal_angles import smallest_angle
from grasp3d._kernels.ray_tracing import starting_rays

RAYS_PER_ROUND = 13
"""Most rays per vertex of a round of refinement: two rings and a bisector."""

LONGER = 1.25
"""Factor by which openings may grow in a round: with uncertain locations wider grasps cost less."""


@kernel
def _ring(size, v, sign, axis, radius, turn, tangent, bound, sets, owner, closing, signs):
    """Append six directions at an angle of `radius` about `axis`; returns the new number of rays.

    Only those within `bound` of the normals, as others cannot have a smaller critical angle.
    """
    start, counts, normals = sets.start, sets.counts, sets.normals
    dot = np.dot(axis, tangent)
    # The tangents turn with the object, so the same directions are tried in any orientation.
    e1 = tangent - dot * axis
    length = math.sqrt(np.dot(e1, e1))
    if length < 1e-6:  # the axis is parallel to the tangent: any other vector will do
        e1 = np.zeros(3)
        e1[np.argmin(np.abs(axis))] = 1.0
        e1 -= np.dot(e1, axis) * axis
        length = math.sqrt(np.dot(e1, e1))
    e1 /= length
    e2 = np.cross(axis, e1)
    for k in range(6):
        azimuth = (k + turn) * math.pi / 3.0
        p, q = math.sin(radius) * math.cos(azimuth), math.sin(radius) * math.sin(azimuth)
        d = math.cos(radius) * axis + p * e1 + q * e2
        if smallest_angle(normals, start[v], counts[v], d[0], d[1], d[2]) <= bound:
            owner[size], signs[size] = v, sign
            closing[size] = d
            size += 1
    return size


@kernel
def _largest_angle(v, points, grasps):
    """Largest angle to a normal at which a grasp near the best one may cost less [rad]."""
    cost = grasps.worst[v]
    if grasps.location == 0.0 or cost == math.inf:
        return cost
    square = 0.0
    for k in range(3):
        square += (grasps.partner[v, k] - points[v, k]) ** 2
    return cost - line_turn(grasps.location, LONGER * math.sqrt(square))


@kernel
def refining_rays(vertices, radii, turn, cone, points, frames, sets, grasps):
    """Rays near each vertex's best grasp: a ring, and the bisector of the two normals.

    The bisector of n1 and -n2 has equal angles to both normals: it is the optimum wherever the
    surface at the second contact is flat.

    Args:
        vertices: Vertices with a grasp (n,).
        radii: Angle of the ring about the grasp of each vertex [rad] (V,).
        turn: Rotation of the ring in sixths of a turn.
        cone: Half-angle of the search cone [rad].
        points: Positions of the vertices (V, 3).
        frames: `Frames`.
        sets: `ContactNormals`.
        grasps: `BestPairs`.

    Returns:
        The `Rays`.
    """
    start, counts, normals = sets.start, sets.counts, sets.normals
    capacity = vertices.shape[0] * RAYS_PER_ROUND
    owner = np.empty(capacity, dtype=np.int32)
    closing = np.empty((capacity, 3))
    signs = np.empty(capacity, dtype=np.int8)
    size = 0
    for v in vertices:
        sign, axis, tangent = grasps.signs[v], grasps.closing[v], frames.tangents[v]
        radius, bound = radii[v], min(cone, _largest_angle(v, points, grasps))
        middle = frames.centres[v] - grasps.partner_normal[v]
        length = math.sqrt(np.dot(middle, middle))
        if length > 1e-9:
            x, y, z = middle[0] / length, middle[1] / length, middle[2] / length
            if smallest_angle(normals, start[v], counts[v], x, y, z) <= bound:
                owner[size], signs[size] = v, sign
                closing[size, 0], closing[size, 1], closing[size, 2] = x, y, z
                size += 1
        size = _ring(size, v, sign, axis, radius, turn, tangent, bound, sets, owner, closing, signs)
        # On creases the best grasp over the best normals may be another one, with its own ring.
        other = grasps.closing_best[v]
        if counts[v] != 1 and np.dot(axis, other) < math.cos(0.5 * radius):
            sign = grasps.signs_best[v]
            size = _ring(
                size, v, sign, other, radius, turn, tangent, bound, sets, owner, closing, signs
            )
    return starting_rays(owner, closing, signs, size)


@kernel
def exploring_rays(vertices, radius, turn, cone, frames, sets, grasps):
    """Rays in rings about the cached closing directions of each vertex except the best one.

    Args:
        vertices: Vertices (n,).
        radius: Angle of the rings [rad].
        turn: Rotation of the rings in sixths of a turn.
        cone: Half-angle of the search cone [rad].
        frames: `Frames`.
        sets: `ContactNormals`.
        grasps: `BestPairs`.

    Returns:
        The `Rays`.
    """
    capacity = vertices.shape[0] * 6 * (grasps.starts.shape[1] - 1)
    owner = np.empty(capacity, dtype=np.int32)
    closing = np.empty((capacity, 3))
    signs = np.empty(capacity, dtype=np.int8)
    size = 0
    for v in vertices:
        bound = min(cone, grasps.start_angles[v, -1])
        for k in range(1, grasps.starts.shape[1]):
            if grasps.start_angles[v, k] < math.inf:
                axis, sign = grasps.starts[v, k].copy(), grasps.start_signs[v, k]
                tangent = frames.tangents[v]
                size = _ring(
                    size, v, sign, axis, radius, turn, tangent, bound, sets, owner, closing, signs
                )
    return starting_rays(owner, closing, signs, size)
