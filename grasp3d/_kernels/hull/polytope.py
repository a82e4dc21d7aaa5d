"""The polytope that the growing hull works on, and the horizon of a new vertex.

It is convex, with simplicial facets. A facet in d dimensions has d vertices (its corners) and d
neighbours. It shares a ridge with each neighbour: the face of d - 1 vertices that lacks one corner.

A new vertex sees the facets whose planes it lies above. The ridges between these and the facets
that stay are the horizon; each of them forms a new facet with the new vertex.

Two new facets are neighbours if their horizon ridges share a face of d - 2 vertices. These pairs
are found for 64 ridges at once: a word for each vertex has bits set for the ridges that contain it,
and the words of a face's vertices have one bit in common besides that of the ridge itself. Where
rounding makes a horizon that touches itself, they have several; then a walk about the face, through
the facets that the vertex sees, decides. Only such a horizon can make two facets with the same
vertices and several common ridges; from then on the corner opposite identifies a ridge.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic, overload

from grasp3d._kernels.compiling import (
    Floats1,
    Floats2,
    Ints1,
    UInt32s1,
    UInt32s2,
    UInt64s1,
    merged,
    part,
)
from grasp3d._kernels.hull.support_functions import task_reach

TOLERANCE = 1e-12
"""Height above a facet, relative to the largest wrench, below which a point counts as on it."""

UNKNOWN = np.uint32((1 << 32) - 1)
"""Entry for a new facet's neighbour that is not linked yet."""

SCRATCH_ROWS = 26
"""Number of rows of `Polytope.vectors`."""


NEW_FACET = np.uint32(1 << 31)
"""Flag in the neighbour entry of a removed facet: this new facet now lies across that ridge."""

WORD = 64
"""Number of ridges whose vertices are compared at once."""

NONE, ONE, ALL = np.uint64(0), np.uint64(1), np.uint64((1 << 64) - 1)
THREE = np.uint32(3)
SEVEN = np.uint32(7)


class Polytope(NamedTuple):
    """Arrays for a polytope of at most p vertices and f facets, reused for all grasps.

    Ridges are encoded as 8 * facet + corner, where `corner` is the position, 0 to 5, of the one
    corner that is not on the ridge. Rows of `planes` that are multiples of 4096 bytes apart would
    share a few cache lines, so capacities are 8 more than a multiple of 512 facets.
    """

    points: Floats2
    """Vertices (p, 6)."""
    vertex_forces: Floats2
    """Contact force of each vertex's wrench, in its contact's axes, padded with zeros (p, 6)."""
    owners: Ints1
    """Contact or row of each vertex (p,)."""
    identifiers: Ints1
    """Identifiers of the vertices (p,); see `support`."""
    planes: Floats2
    """Outward normal (6), distance from the origin and tolerance of each facet's plane, normalised
    in the metric of the wrenches; for a task also the distance relative to the task's reach, inf
    if it does not reach that way (9, f). Distances of removed facets are nan. Facets are columns,
    so the heights of one point above many facets are computed in contiguous, vectorised loops."""
    corners: UInt32s2
    """Vertices of each facet (f, 8)."""
    neighbours: UInt32s2
    """Facet across the ridge opposite each corner (f, 8)."""
    marks: UInt32s1
    """Visibility of each facet from the new vertex: 0 or 1, or the stamp of the last flood (f,)."""
    heights: Floats1
    """Height of the new vertex above each facet (f,)."""
    visible: UInt32s1
    """Facets that the new vertex lies above (f,)."""
    free: UInt32s1
    """Columns of removed facets that can be reused (f,)."""
    horizon: UInt32s1
    """Ridges between a visible and an invisible facet, encoded from the visible one (8 f,)."""
    added: UInt32s1
    """The facets added last, in the order of the horizon (f,)."""
    combined: Floats2
    """Normal, height and weight of the planes of facets that are being added (f, 8)."""
    squares: Floats1
    """Squared lengths of their normals in the metric (f,)."""
    factors: Floats1
    """Reciprocals of their lengths (f,)."""
    words: UInt64s1
    """Bits that mark which of 64 ridges contain each vertex (p,)."""
    following: UInt64s1
    """Scratch, the ridges that contain all corners of a facet from each corner on (8,)."""
    queue: UInt32s1
    """Facets that may be the nearest to the origin, unordered (2 f,)."""
    vectors: Floats2
    """Small vectors (SCRATCH_ROWS, 8): 0-15 scratch of the first simplex and of equilibria, 16 the
    plane with the smallest support so far, 17 the plane of the current facet."""


def make_polytope(facets: int) -> Polytope:
    """Allocate a polytope of at most `facets` facets, and a quarter as many vertices."""
    points = max(facets // 4, 32)
    return Polytope(
        points=np.zeros((points, 6)),
        vertex_forces=np.zeros((points, 6)),
        owners=np.zeros(points, dtype=np.int64),
        identifiers=np.zeros(points, dtype=np.int64),
        planes=np.zeros((9, facets)),
        corners=np.zeros((facets, 8), dtype=np.uint32),
        neighbours=np.zeros((facets, 8), dtype=np.uint32),
        marks=np.zeros(facets, dtype=np.uint32),
        heights=np.zeros(facets),
        visible=np.zeros(facets + 1, dtype=np.uint32),
        free=np.zeros(facets, dtype=np.uint32),
        horizon=np.zeros(8 * facets + 1, dtype=np.uint32),
        added=np.zeros(facets, dtype=np.uint32),
        combined=np.zeros((facets, 8)),
        squares=np.zeros(facets),
        factors=np.zeros(facets),
        words=np.zeros(points, dtype=np.uint64),
        following=np.zeros(8, dtype=np.uint64),
        queue=np.zeros(2 * facets + 1, dtype=np.uint32),
        vectors=np.zeros((SCRATCH_ROWS, 8)),
    )


@merged
def height_above(planes, f, point):
    """Height of a point above a facet's plane."""
    product = (planes[0, f] * point[0] + planes[1, f] * point[1]) + (
        planes[2, f] * point[2] + planes[3, f] * point[3]
    )
    return product + (planes[4, f] * point[4] + planes[5, f] * point[5]) - planes[6, f]


@merged
def square_in(metric, n0, n1, n2, n3, n4, n5):
    """Squared length of a normal in a metric."""
    return (
        (n0 * n0 * metric[0] + n1 * n1 * metric[1]) + (n2 * n2 * metric[2] + n3 * n3 * metric[3])
    ) + (n4 * n4 * metric[4] + n5 * n5 * metric[5])


@merged
def set_plane(planes, f, n0, n1, n2, n3, n4, n5, height, factor, task):
    """Write a plane, multiplied by a factor that gives its normal length 1."""
    n0, n1, n2 = n0 * factor, n1 * factor, n2 * factor
    n3, n4, n5 = n3 * factor, n4 * factor, n5 * factor
    planes[0, f], planes[1, f], planes[2, f] = n0, n1, n2
    planes[3, f], planes[4, f], planes[5, f] = n3, n4, n5
    planes[6, f] = height * factor
    planes[7, f] = TOLERANCE * (((abs(n0) + abs(n1)) + (abs(n2) + abs(n3))) + (abs(n4) + abs(n5)))
    if task is not None:
        reach = task_reach(task, (n0, n1, n2, n3, n4, n5))
        if reach > 0.0:
            planes[8, f] = planes[6, f] / reach
        else:  # the task has nothing beyond it, but the polytope must contain the origin
            planes[8, f] = math.inf if planes[6, f] >= -planes[7, f] else -math.inf


@merged
def set_normalised_plane(planes, f, n, height, metric, task):
    """Write a plane whose normal is scaled to length 1 in the metric."""
    factor = 1.0 / math.sqrt(square_in(metric, n[0], n[1], n[2], n[3], n[4], n[5]))
    set_plane(planes, f, n[0], n[1], n[2], n[3], n[4], n[5], height, factor, task)


@merged
def distance_of(planes, f, task):
    """Distance of a facet from the origin; for a task, relative to the task's reach beyond it."""
    if task is None:
        return planes[6, f]
    return planes[8, f]


def lowest_bit(word: Any) -> int:
    """Position of the lowest set bit of a non-zero word."""
    return (int(word) & -int(word)).bit_length() - 1


@intrinsic
def _count_trailing_zeros(typing_context, word):  # noqa: ARG001 - Numba passes them
    def generate(context, builder, signature, arguments):  # noqa: ARG001 - Numba passes them
        return builder.cttz(arguments[0], ir.Constant(ir.IntType(1), 0))

    return types.uint64(types.uint64), generate


@overload(lowest_bit, inline="always")
def _lowest_bit(word):  # noqa: ARG001 - Numba matches the names
    def implementation(word):
        return _count_trailing_zeros(word)

    return implementation


@merged
def find_visible(polytope, dim, used, point):
    """Find the facets visible from a point, and their horizon, by testing all facets."""
    planes, neighbours, marks = polytope.planes, polytope.neighbours, polytope.marks
    heights, visible, horizon = polytope.heights, polytope.visible, polytope.horizon
    count = ridges = NONE
    for f in range(used):
        heights[f] = height_above(planes, f, point)
    # Without branches the loops vectorise: rejected entries are overwritten.
    for f in range(used):
        visible[count] = f
        marks[f] = heights[f] > planes[7, f]
        count += np.uint64(marks[f])
    for i in range(count):
        v = visible[i]
        for k in range(dim):
            horizon[ridges] = 8 * v + k
            ridges += ONE - np.uint64(marks[neighbours[v, k]])
    return np.int64(count), np.int64(ridges)


@merged
def flood_visible(polytope, dim, first, stamp, point):
    """Find the facets visible from a point, and their horizon, by flooding from a visible facet.

    The visible facets of a convex polytope are connected. Marks below `stamp` belong to earlier
    floods; `stamp` means tested and not visible, `stamp` + 1 visible.
    """
    planes, neighbours, marks = polytope.planes, polytope.neighbours, polytope.marks
    heights, visible, horizon = polytope.heights, polytope.visible, polytope.horizon
    heights[first] = height_above(planes, first, point)
    marks[first], visible[0] = stamp + 1, first
    count, done, ridges = 1, 0, 0
    while done < count:
        v = visible[done]
        for k in range(dim):
            other = neighbours[v, k]
            if marks[other] < stamp:
                heights[other] = height_above(planes, other, point)
                marks[other] = stamp
                if heights[other] > planes[7, other]:
                    marks[other] = stamp + 1
                    visible[count] = other
                    count += 1
            if marks[other] == stamp:
                horizon[ridges] = 8 * v + k
                ridges += 1
        done += 1
    return count, ridges


@merged
def _position_of(polytope, dim, facet, other, corner):
    """Position in a facet of its ridge to another facet; `corner` lies opposite the ridge.

    Facets with the same vertices and several ridges in common are told apart by the corner.
    """
    corners, neighbours = polytope.corners, polytope.neighbours
    position = -1
    for c in range(dim):
        if neighbours[facet, c] == other and (position < 0 or corners[facet, c] == corner):
            position = c
    return position


@merged
def join(polytope, dim, ridge, new, vertex, pinched):
    """Join a horizon ridge and the new vertex, its last corner, to form a facet.

    `pinched` says whether facets may have several ridges in common.

    Returns:
        The facets on both sides of the ridge: (visible, invisible).
    """
    corners, neighbours = polytope.corners, polytope.neighbours
    v, k = ridge >> THREE, ridge & SEVEN
    other = neighbours[v, k]
    for c in range(dim):
        corners[new, c] = corners[v, c]
        neighbours[new, c] = UNKNOWN
    corners[new, k] = corners[v, dim - 1]
    corners[new, dim - 1] = vertex
    neighbours[new, dim - 1] = other
    if pinched:
        neighbours[other, _position_of(polytope, dim, other, v, corners[v, k])] = new
    else:
        for c in range(dim):
            before = neighbours[other, c]
            neighbours[other, c] = new if before == v else before
    neighbours[v, k] = NEW_FACET | new
    return v, other


@part
def turn_about_faces(polytope, dim, ridges):
    """Find the neighbours of the facets added last, by turning about the faces that they share.

    Around such a face only removed facets lie between one new facet and the other.
    """
    corners, neighbours, horizon = polytope.corners, polytope.neighbours, polytope.horizon
    for r in range(ridges):
        # Facet v was removed; its entry behind the ridge now names the new facet.
        v, k = horizon[r] >> THREE, horizon[r] & SEVEN
        new = neighbours[v, k] & ~NEW_FACET
        for b in range(dim):
            if b == k:
                continue
            # The face is v without its corners k and b: turn about it through removed facets.
            facet, leaving, staying = v, np.uint32(b), k
            while True:
                link = neighbours[facet, leaving]
                if link & NEW_FACET:
                    break
                # Leave the next facet through the ridge opposite the corner not yet passed.
                corner = corners[facet, staying]
                position = _position_of(polytope, dim, link, facet, corners[facet, leaving])
                facet, staying = link, np.uint32(position)
                for c in range(dim):
                    if corners[facet, c] == corner:
                        leaving = np.uint32(c)
            # The last corner of v now takes the position of the corner that the ridge lacks.
            slot = np.int64(k) if b == dim - 1 else b
            neighbours[new, slot] = link & ~NEW_FACET


@merged
def _mark_ridges(polytope, dim, first, last, vertices):
    """Set the bits of a range of new facets in the words of their vertices."""
    corners, added, words = polytope.corners, polytope.added, polytope.words
    for i in range(vertices):
        words[i] = NONE
    bit = ONE
    for r in range(first, last):
        new = added[r]
        for c in range(dim):
            words[corners[new, c]] |= bit
        bit <<= ONE


@merged
def _link_marked(polytope, dim, new, own, first):
    """Link a new facet to its neighbours among those marked; return the bits of ambiguous ones."""
    corners, neighbours, words = polytope.corners, polytope.neighbours, polytope.words
    added, after = polytope.added, polytope.following
    several = NONE
    after[dim - 1] = words[corners[new, dim - 1]] & ~own
    for c in range(dim - 2, 0, -1):
        after[c] = after[c + 1] & words[corners[new, c]]
    shared = ALL
    for c in range(dim - 1):
        common = shared & after[c + 1]
        shared &= words[corners[new, c]]
        if common != NONE:
            several |= common & (common - ONE)
            if neighbours[new, c] != UNKNOWN:
                several |= common
            neighbours[new, c] = added[first + np.uint64(lowest_bit(common))]
    return several


@merged
def link_new_facets(polytope, dim, ridges, vertices):
    """Find the neighbours of the facets added last; see the module's description.

    Args:
        polytope: `Polytope`.
        dim: Dimension of the polytope.
        ridges: Number of ridges of the horizon, and of new facets.
        vertices: Number of vertices, including that of the new facets.

    Returns:
        Whether the horizon touches itself.
    """
    added, several = polytope.added, NONE
    for first in range(0, ridges, WORD):
        last = min(first + WORD, ridges)
        _mark_ridges(polytope, dim, first, last, vertices)
        for r in range(ridges):
            own = ONE << np.uint64(r - first) if first <= r < last else NONE
            several |= _link_marked(polytope, dim, added[r], own, np.uint64(first))
    if several != NONE:
        turn_about_faces(polytope, dim, ridges)
        return True
    return False
