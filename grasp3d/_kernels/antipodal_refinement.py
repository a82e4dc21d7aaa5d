"""Rings of directions about the grasps that were found, to improve them."""

import math

import numpy as np

from grasp3d._kernels.compiling import kernel
from grasp3d._kernels.normal_angles import smallest_angle
from grasp3d._kernels.ray_tracing import starting_rays

PROPOSALS = 13
"""Most rays per vertex that a round of refinement proposes: two rings and a bisector."""


@kernel
def _ring(size, v, sign, around, radius, turn, tangent, bound, sets, owner, closing, signs):
    """Add six directions at `radius` about one, within `bound` of the normals; returns the size."""
    start, counts, normals = sets.start, sets.counts, sets.normals
    dot = np.dot(around, tangent)
    e1 = tangent - dot * around
    length = math.sqrt(np.dot(e1, e1))
    if length < 1e-6:  # the tangent itself is the direction: any other will do
        e1 = np.zeros(3)
        e1[np.argmin(np.abs(around))] = 1.0
        e1 -= np.dot(e1, around) * around
        length = math.sqrt(np.dot(e1, e1))
    e1 /= length
    e2 = np.cross(around, e1)
    for k in range(6):
        azimuth = (k + turn) * math.pi / 3.0
        p, q = math.sin(radius) * math.cos(azimuth), math.sin(radius) * math.sin(azimuth)
        d = math.cos(radius) * around + p * e1 + q * e2
        if smallest_angle(normals, start[v], counts[v], d[0], d[1], d[2]) <= bound:
            owner[size], signs[size] = v, sign
            closing[size] = d
            size += 1
    return size


@kernel
def refining_rays(places, radii, turn, cone, frames, sets, grasps):
    """Directions near each place's best grasp: a ring, and the bisector of the two normals.

    The bisector of n1 and -n2 is the optimum wherever the partner's surface is locally flat.

    Args:
        places: Vertices that have a candidate (n,).
        radii: Angle of the ring about the grasp of each vertex [rad] (V,).
        turn: Rotation of the ring in sixths of a turn.
        cone: Half-angle of the search cone [rad].
        frames: `Frames`.
        sets: `Sets`.
        grasps: `Grasps`.

    Returns:
        The `Rays`.
    """
    start, counts, normals = sets.start, sets.counts, sets.normals
    room = places.shape[0] * PROPOSALS
    owner = np.empty(room, dtype=np.int32)
    closing = np.empty((room, 3))
    signs = np.empty(room, dtype=np.int8)
    size = 0
    for v in places:
        sign, around, tangent = grasps.signs[v], grasps.closing[v], frames.tangents[v]
        radius, bound = radii[v], min(cone, grasps.worst[v])
        middle = frames.centres[v] - grasps.partner_normal[v]
        length = math.sqrt(np.dot(middle, middle))
        if length > 1e-9:
            x, y, z = middle[0] / length, middle[1] / length, middle[2] / length
            if smallest_angle(normals, start[v], counts[v], x, y, z) <= bound:
                owner[size], signs[size] = v, sign
                closing[size, 0], closing[size, 1], closing[size, 2] = x, y, z
                size += 1
        size = _ring(
            size, v, sign, around, radius, turn, tangent, bound, sets, owner, closing, signs
        )
        other = grasps.closing_best[v]
        if counts[v] != 1 and np.dot(around, other) < math.cos(0.5 * radius):
            sign = grasps.signs_best[v]
            size = _ring(
                size, v, sign, other, radius, turn, tangent, bound, sets, owner, closing, signs
            )
    return starting_rays(owner, closing, signs, size)


@kernel
def exploring_rays(places, radius, turn, cone, frames, sets, grasps):
    """Rings about the starts of each place that are not its best grasp.

    Args:
        places: Vertices (n,).
        radius: Angle of the rings [rad].
        turn: Rotation of the rings in sixths of a turn.
        cone: Half-angle of the search cone [rad].
        frames: `Frames`.
        sets: `Sets`.
        grasps: `Grasps`.

    Returns:
        The `Rays`.
    """
    room = places.shape[0] * 6 * (grasps.starts.shape[1] - 1)
    owner = np.empty(room, dtype=np.int32)
    closing = np.empty((room, 3))
    signs = np.empty(room, dtype=np.int8)
    size = 0
    for v in places:
        bound = min(cone, grasps.start_angles[v, -1])
        for k in range(1, grasps.starts.shape[1]):
            if grasps.start_angles[v, k] < math.inf:
                around, sign = grasps.starts[v, k].copy(), grasps.start_signs[v, k]
                tangent = frames.tangents[v]
                size = _ring(
                    size, v, sign, around, radius, turn, tangent, bound, sets, owner, closing, signs
                )
    return starting_rays(owner, closing, signs, size)
