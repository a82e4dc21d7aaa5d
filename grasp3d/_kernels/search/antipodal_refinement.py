"""Refinement of antipodal grasps: rings of closing directions about those found so far."""

import math

import numpy as np

from grasp3d._kernels.compiling.decorators import kernel, part
from grasp3d._kernels.search.antipodal_candidates import line_turn
from grasp3d._kernels.surface.ray_tracing import append_ray, starting_rays
from grasp3d._kernels.surface.vectors import cross, dot

RAYS_PER_ROUND = 13
"""Most rays per vertex of a round of refinement: two rings and a bisector."""

LONGER = 1.25
"""Factor by which openings may grow in a round: with uncertain locations wider grasps cost less."""


@part
def _across(axis, vector):
    """The part of a vector orthogonal to a unit vector, and its length."""
    along = dot(axis, vector)
    x, y, z = vector[0] - along * axis[0], vector[1] - along * axis[1], vector[2] - along * axis[2]
    return (x, y, z), math.sqrt(x * x + y * y + z * z)


@part
def _ring(size, v, sign, axis, radius, turn, tangent, bound, sets, owner, closing, signs):
    """Append six directions at an angle of `radius` about `axis`; returns the new number of rays.

    Only those within `bound` of the normals, as others cannot have a smaller critical angle.
    """
    # The tangents turn with the object, so the same directions are tried in any orientation.
    e1, length = _across(axis, (tangent[0], tangent[1], tangent[2]))
    if length < 1e-6:  # the axis is parallel to the tangent: any other vector will do
        x, y, z = abs(axis[0]), abs(axis[1]), abs(axis[2])
        if x <= min(y, z):
            e1, length = _across(axis, (1.0, 0.0, 0.0))
        elif y <= z:
            e1, length = _across(axis, (0.0, 1.0, 0.0))
        else:
            e1, length = _across(axis, (0.0, 0.0, 1.0))
    e1 = e1[0] / length, e1[1] / length, e1[2] / length
    e2 = cross(axis, e1)
    along, aside = math.cos(radius), math.sin(radius)
    for k in range(6):
        azimuth = (k + turn) * math.pi / 3.0
        p, q = aside * math.cos(azimuth), aside * math.sin(azimuth)
        direction = (
            along * axis[0] + p * e1[0] + q * e2[0],
            along * axis[1] + p * e1[1] + q * e2[1],
            along * axis[2] + p * e1[2] + q * e2[2],
        )
        size = append_ray(size, v, sign, direction, bound, sets, owner, closing, signs)
    return size


@part
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
    capacity = vertices.shape[0] * RAYS_PER_ROUND
    owner = np.empty(capacity, dtype=np.int32)
    closing = np.empty((capacity, 3))
    signs = np.empty(capacity, dtype=np.int8)
    size = 0
    for v in vertices:
        sign, axis, tangent = grasps.signs[v], grasps.closing[v], frames.tangents[v]
        radius, bound = radii[v], min(cone, _largest_angle(v, points, grasps))
        one, two = frames.centres[v], grasps.partner_normal[v]
        x, y, z = one[0] - two[0], one[1] - two[1], one[2] - two[2]
        length = math.sqrt(x * x + y * y + z * z)
        if length > 1e-9:
            middle = x / length, y / length, z / length
            size = append_ray(size, v, sign, middle, bound, sets, owner, closing, signs)
        size = _ring(size, v, sign, axis, radius, turn, tangent, bound, sets, owner, closing, signs)
        # On creases the best grasp over the best normals may be another one, with its own ring.
        other = grasps.closing_best[v]
        if sets.counts[v] != 1 and dot(axis, other) < math.cos(0.5 * radius):
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
                axis, sign = grasps.starts[v, k], grasps.start_signs[v, k]
                tangent = frames.tangents[v]
                size = _ring(
                    size, v, sign, axis, radius, turn, tangent, bound, sets, owner, closing, signs
                )
    return starting_rays(owner, closing, signs, size)
