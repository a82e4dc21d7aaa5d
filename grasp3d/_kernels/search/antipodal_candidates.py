"""Evaluation of antipodal candidates, and the best grasps found so far at every vertex.

Two fingers are force-closed if the line between the contacts lies inside both friction cones
(Nguyen 1988), so the critical friction angle of a pair is the larger of the two angles between the
line and the normals. Each vertex keeps its best grasp, over the worst normals of the contacts, and
a small sorted cache of the best closing directions that clearly differ. A search by rays is refined
around all of these, as the best direction of a coarse sample need not lead to the best grasp.

The module also computes the angles between the line of two contacts and their normals.
"""

import math
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.compiling import Bytes1, Floats1, Floats2, Floats3, Ints1, kernel, merged
from grasp3d._kernels.surface.surface_contacts import (
    largest_angle,
    line_turn,
    point_on_face,
    smallest_angle,
    turn_at_vertex,
    turn_on_face,
    write_normals,
)
from grasp3d._kernels.surface.vectors import copy, difference, divided, dot, norm, scaled, triple

TIE = 1e-7
"""Angle [rad] by which a candidate must be better, so that rounding does not decide ties."""

SMALLEST_OPENING = 1e-6
"""Smallest opening, in object sizes, that 32-bit rays can resolve."""

FOUND, NO_PARTNER, OPENING = 0, 1, 2
"""Reason codes: a grasp was found; no second contact was; all openings were outside the limits."""


class PairLimits(NamedTuple):
    """Limits of the opening between which a pair of contacts is a grasp."""

    smallest: float
    """Smallest opening."""
    largest: float
    """Largest opening."""


class BestPairs(NamedTuple):
    """The best antipodal grasps so far, one row per vertex; updated in place.

    Either all are external (fingers squeeze) or all are internal (fingers expand).
    """

    worst: Floats1
    """Critical angle over the worst normals and locations [rad]."""
    best: Floats1
    """Critical angle of that grasp over the best normals at the perceived locations [rad]."""
    closing: Floats2
    """Closing direction (V, 3)."""
    partner: Floats2
    """Second contact (V, 3)."""
    partner_normal: Floats2
    """Inward unit normal at the second contact (V, 3)."""
    faces: Ints1
    """Face of the second contact, -1 for none (V,)."""
    weights: Floats2
    """Barycentric coordinates of the second contact (V, 3)."""
    reason: Bytes1
    """FOUND, NO_PARTNER or OPENING."""
    starts: Floats3
    """Cache of the best closing directions that clearly differ, sorted by angle (V, k, 3)."""
    start_angles: Floats2
    """Their critical angles over the worst normals [rad] (V, k)."""
    distinct_cosine: float
    """Cosine of the angle above which two closing directions count as different."""


def no_pairs(count: int, starts: int = 1, distinct_cosine: float = 1.0) -> BestPairs:
    """Initial state for a number of vertices: no grasps, empty caches of `starts` directions."""
    return BestPairs(
        worst=np.full(count, math.inf),
        best=np.full(count, math.inf),
        closing=np.zeros((count, 3)),
        partner=np.full((count, 3), math.nan),
        partner_normal=np.full((count, 3), math.nan),
        faces=np.full(count, -1, dtype=np.int64),
        weights=np.zeros((count, 3)),
        reason=np.full(count, NO_PARTNER, dtype=np.uint8),
        starts=np.zeros((count, starts, 3)),
        start_angles=np.full((count, starts), math.inf),
        distinct_cosine=distinct_cosine,
    )


@merged
def _keep_start(v, direction, angle, grasps):
    """Insert a closing direction into a vertex's sorted cache of clearly different directions."""
    directions, angles = grasps.starts[v], grasps.start_angles[v]
    row = angles.shape[0] - 1
    for k in range(angles.shape[0]):  # replace a similar direction, and only by a better one
        if angles[k] < math.inf and dot(direction, directions[k]) > grasps.distinct_cosine:
            row = k
            break
    if angle >= angles[row] - TIE:
        return
    # Insertion sort: worse entries move down; the last one, or the similar one, is dropped.
    while row > 0 and angle < angles[row - 1] - TIE:
        angles[row] = angles[row - 1]
        copy(directions[row - 1], directions[row])
        row -= 1
    angles[row] = angle
    copy(direction, directions[row])


@merged
def evaluate_pair(v, sign, partner, opening, face, weights, surface, sets, grasps, scratch):
    """Evaluate the grasp of a vertex and a point on a face; keep it if it is the best so far."""
    start, counts, normals = sets.start, sets.counts, sets.normals
    direction = scaled(sign / opening, difference(partner, surface.points[v]))
    x, y, z = direction
    low = largest_angle(normals, start[v], counts[v], x, y, z)
    turn = line_turn(opening, surface.turns)
    high = low + turn_at_vertex(v, surface.turns) + turn
    if high > grasps.start_angles[v, -1]:
        return  # worse than the whole cache
    if counts[v] != 1:
        low = smallest_angle(normals, start[v], counts[v], x, y, z)
    turn += turn_on_face(face, weights, surface.turns)
    count, vertex = write_normals(face, weights, surface, sets, scratch)
    # Angles at the second contact, against the reversed direction; a vertex has its own set.
    if vertex >= 0:
        first, count = start[vertex], counts[vertex]
        low = max(low, smallest_angle(normals, first, count, -x, -y, -z))
        high = max(high, largest_angle(normals, first, count, -x, -y, -z) + turn)
        copy(normals[first], scratch[0])
    else:
        low = max(low, smallest_angle(scratch, 0, count, -x, -y, -z))
        high = max(high, largest_angle(scratch, 0, count, -x, -y, -z) + turn)
    if high < grasps.start_angles[v, -1]:
        _keep_start(v, direction, high, grasps)
    if high < grasps.worst[v] - TIE:
        grasps.worst[v], grasps.best[v], grasps.reason[v] = high, low, FOUND
        grasps.faces[v] = face
        copy(direction, grasps.closing[v])
        copy(partner, grasps.partner[v])
        copy(scratch[0], grasps.partner_normal[v])
        copy(weights, grasps.weights[v])


@merged
def evaluate_on_face(v, sign, face, weights, surface, sets, grasps, scratch):
    """Evaluate the grasp of a vertex and a point on a face given by barycentric coordinates.

    `scratch` holds normals (2, 3). The contacts must not coincide.
    """
    weights = triple(weights, 0)
    partner = point_on_face(face, weights, surface)
    opening = norm(difference(partner, surface.points[v]))
    evaluate_pair(v, sign, partner, opening, face, weights, surface, sets, grasps, scratch)


@kernel("Floats1, FixedFloats2, FixedFloats2, ContactNormals, Floats1, Floats1, Int8s1")
def scan(fixed_point, fixed_normals, points, sets, worst, best, signs):
    """Compute the critical angles of the grasps that one fixed contact makes with every vertex.

    Following Wan & Howe 2018, Sec. III-B, both signs of the line are evaluated, for squeezing and
    for expanding.

    Args:
        fixed_point: The fixed contact (3,).
        fixed_normals: The set of its normals (k, 3).
        points: Positions of the vertices (V, 3).
        sets: `ContactNormals`.
        worst: Written, critical angle over the worst normals [rad], inf if the contacts coincide
            (V,).
        best: Written, critical angle over the best normals [rad] (V,).
        signs: Written, sign for the worst: +1 squeeze, -1 expand (V,).
    """
    start, counts, normals = sets.start, sets.counts, sets.normals
    count = fixed_normals.shape[0]
    for v in range(points.shape[0]):
        line = difference(points[v], fixed_point)
        length = norm(line)
        worst[v] = best[v] = math.inf
        signs[v] = 0
        if length < 1e-12 or (counts[v] == 0 and start[v + 1] == start[v]):
            continue
        # Closed form: the critical angle is the larger of the angles between line and normals.
        for sign in (1, -1):
            ex, ey, ez = divided(scaled(sign, line), length)
            high = max(
                largest_angle(fixed_normals, 0, count, ex, ey, ez),
                largest_angle(normals, start[v], counts[v], -ex, -ey, -ez),
            )
            low = max(
                smallest_angle(fixed_normals, 0, count, ex, ey, ez),
                smallest_angle(normals, start[v], counts[v], -ex, -ey, -ez),
            )
            if high < worst[v]:
                worst[v], signs[v] = high, sign
            best[v] = min(best[v], low)


@kernel("Floats3, Ints1, Ints1, Floats2, Floats2, Floats2")
def pair_angles(points, start, counts, normals, largest, smallest):
    """Compute angles between the normals of two contacts and the line from the first to the second.

    Args:
        points: Contacts (b, 2, 3).
        start: First row of each contact's normals (2 b,).
        counts: Number of each contact's normals; 0 stands for every direction (2 b,).
        normals: Inward unit normals (K, 3).
        largest: Written, largest angle between the first contact's normals and the line, and
            between the second's and the reversed line [rad]; inf if they coincide (b, 2).
        smallest: Written, the smallest such angles (b, 2).
    """
    for g in range(points.shape[0]):
        line = difference(points[g, 1], points[g, 0])
        opening = norm(line)
        if not opening > 0.0:
            largest[g], smallest[g] = math.inf, math.inf
            continue
        x, y, z = divided(line, opening)
        for i in range(2):
            first, count, side = start[2 * g + i], counts[2 * g + i], 1.0 - 2.0 * i
            largest[g, i] = largest_angle(normals, first, count, side * x, side * y, side * z)
            smallest[g, i] = smallest_angle(normals, first, count, side * x, side * y, side * z)
