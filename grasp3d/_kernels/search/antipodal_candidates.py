"""Evaluation of antipodal candidates, and the best grasps found so far at every vertex.

Two fingers are force-closed where the line between the contacts lies inside both friction cones
(Nguyen 1988), so the critical friction angle of a pair is the larger of the two angles between the
line and the normals. Each vertex keeps its best grasp and a small sorted cache of the best closing
directions that differ clearly; the search is refined around all of them, since the best direction
of a coarse sample need not lead to the best grasp.
"""

import math
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.array_types import Bytes1, Floats1, Floats2, Floats3, Int8s1, Int8s2, Ints2
from grasp3d._kernels.compiling import merged
from grasp3d._kernels.surface.surface_contacts import (
    largest_angle,
    point_on_face,
    smallest_angle,
    write_normals,
)
from grasp3d._kernels.surface.vectors import copy, difference, dot, norm, scaled, triple

TIE = 1e-7
"""Angle by which a candidate must be better, so that rounding errors do not decide ties [rad]."""

FOUND, NO_PARTNER, OPENING = 0, 1, 2
"""Reason codes: a grasp was found; no second contact was; all openings were outside the limits."""


class PairLimits(NamedTuple):
    """Which pairs of contacts are grasps."""

    smallest: float
    """Smallest opening."""
    largest: float
    """Largest opening."""


class BestPairs(NamedTuple):
    """The best antipodal grasps found so far, a row per vertex; written in place."""

    worst: Floats1
    """Critical angle over the worst normals [rad]."""
    best: Floats1
    """Smallest critical angle over the best normals, possibly of another grasp [rad]."""
    closing: Floats2
    """Closing direction of the grasp of `worst` (V, 3)."""
    closing_best: Floats2
    """Closing direction of the grasp of `best` (V, 3)."""
    partner: Floats2
    """Second contact of the grasp of `worst` (V, 3)."""
    partner_normal: Floats2
    """Inward unit normal at the second contact (V, 3)."""
    faces: Ints2
    """Face of the second contact, of the grasp of `worst` and of that of `best` (V, 2); -1 none."""
    weights: Floats3
    """Their barycentric coordinates (V, 2, 3)."""
    signs: Int8s1
    """+1 squeeze, -1 expand, of the grasp of `worst`."""
    signs_best: Int8s1
    """The same for the grasp of `best`."""
    reason: Bytes1
    """FOUND, NO_PARTNER or OPENING."""
    starts: Floats3
    """Cache of the best closing directions that differ clearly, sorted by angle (V, k, 3)."""
    start_angles: Floats2
    """Their critical angles over the worst normals [rad] (V, k)."""
    start_signs: Int8s2
    """+1 squeeze, -1 expand (V, k)."""
    distinct_cosine: float
    """Cosine of the angle from which two closing directions count as different."""


def no_pairs(count: int, starts: int, distinct_cosine: float) -> BestPairs:
    """Grasps of a number of vertices before any was found, with so many cached directions."""
    return BestPairs(
        worst=np.full(count, math.inf),
        best=np.full(count, math.inf),
        closing=np.zeros((count, 3)),
        closing_best=np.zeros((count, 3)),
        partner=np.full((count, 3), math.nan),
        partner_normal=np.full((count, 3), math.nan),
        faces=np.full((count, 2), -1, dtype=np.int64),
        weights=np.zeros((count, 2, 3)),
        signs=np.zeros(count, dtype=np.int8),
        signs_best=np.zeros(count, dtype=np.int8),
        reason=np.full(count, NO_PARTNER, dtype=np.uint8),
        starts=np.zeros((count, starts, 3)),
        start_angles=np.full((count, starts), math.inf),
        start_signs=np.zeros((count, starts), dtype=np.int8),
        distinct_cosine=distinct_cosine,
    )


@merged
def _keep_start(v, sign, direction, angle, grasps):
    """Insert a closing direction into a vertex's sorted cache of clearly different ones."""
    directions, angles, signs = grasps.starts[v], grasps.start_angles[v], grasps.start_signs[v]
    row = angles.shape[0] - 1
    for k in range(angles.shape[0]):  # replace a similar direction, and only by a better one
        similar = dot(direction, directions[k]) > grasps.distinct_cosine
        if angles[k] < math.inf and signs[k] == sign and similar:
            row = k
            break
    if angle >= angles[row] - TIE:
        return
    # Insertion sort: worse entries move down, the last one, or the similar one, is dropped.
    while row > 0 and angle < angles[row - 1] - TIE:
        angles[row], signs[row] = angles[row - 1], signs[row - 1]
        copy(directions[row - 1], directions[row])
        row -= 1
    angles[row], signs[row] = angle, sign
    copy(direction, directions[row])


@merged
def evaluate_pair(v, sign, partner, opening, face, weights, surface, sets, grasps, scratch):
    """Evaluate the grasp of a vertex and a point on a face; store it if it is the best so far."""
    start, counts, normals = sets.start, sets.counts, sets.normals
    direction = scaled(sign / opening, difference(partner, surface.points[v]))
    x, y, z = direction
    low = smallest_angle(normals, start[v], counts[v], x, y, z)
    if low > grasps.start_angles[v, -1]:
        return  # a lower bound of both angles, and worse than the whole cache
    high = low
    if counts[v] != 1:
        high = largest_angle(normals, start[v], counts[v], x, y, z)
    count, vertex = write_normals(face, weights, surface, sets, scratch)
    # The angles at the second contact, against the opposite direction; a vertex has its own set.
    if vertex >= 0:
        first, count = start[vertex], counts[vertex]
        low = max(low, smallest_angle(normals, first, count, -x, -y, -z))
        high = max(high, largest_angle(normals, first, count, -x, -y, -z))
        copy(normals[first], scratch[0])
    else:
        low = max(low, smallest_angle(scratch, 0, count, -x, -y, -z))
        high = max(high, largest_angle(scratch, 0, count, -x, -y, -z))
    # `high` decides the grasp of `worst` and the cache, `low` that of `best`: they may differ.
    if high < grasps.start_angles[v, -1]:
        _keep_start(v, sign, direction, high, grasps)
    if high < grasps.worst[v] - TIE:
        grasps.worst[v], grasps.reason[v] = high, FOUND
        grasps.signs[v], grasps.faces[v, 0] = sign, face
        copy(direction, grasps.closing[v])
        copy(partner, grasps.partner[v])
        copy(scratch[0], grasps.partner_normal[v])
        copy(weights, grasps.weights[v, 0])
    if low < grasps.best[v] - TIE:
        grasps.best[v], grasps.signs_best[v], grasps.faces[v, 1] = low, sign, face
        copy(direction, grasps.closing_best[v])
        copy(weights, grasps.weights[v, 1])


@merged
def evaluate_on_face(v, sign, face, weights, surface, sets, grasps, scratch):
    """Evaluate the grasp of a vertex and a point on a face, from its barycentric coordinates.

    `scratch` holds normals (2, 3). The contacts must not be at one point.
    """
    weights = triple(weights, 0)
    partner = point_on_face(face, weights, surface)
    opening = norm(difference(partner, surface.points[v]))
    evaluate_pair(v, sign, partner, opening, face, weights, surface, sets, grasps, scratch)
