"""The horizon of a new vertex of a growing hull, and the neighbours of the facets that stand on it.

A new vertex sees the facets whose planes it lies above. The ridges between them and the facets that
stay are the horizon; each of them with the new vertex makes a new facet.

Two new facets are neighbours where their horizon ridges share a face of dim - 2 vertices. They are
found for 64 ridges at once: the bits of a word for each vertex are set for the ridges that contain
it, and the words of the vertices of a face have one bit in common beside that of the ridge itself.
Where rounding makes a horizon that touches itself there are several: then the walk about the face,
through the facets that the vertex sees, decides. Only such a horizon can make two facets with the
same vertices and several common ridges; from then on the corner opposite identifies a ridge.
"""

from typing import Any

import numpy as np
from llvmlite import ir
from numba.core import types
from numba.extending import intrinsic, overload

from grasp3d._kernels.compiling.decorators import merged, part
from grasp3d._kernels.hull.polytope import UNKNOWN, height_above


def lowest_bit(word: Any) -> int:
    """Position of the lowest bit of a word, not 0, that is set."""
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


NEW_FACET = np.uint32(1 << 31)
"""Flag in the neighbour entry of a removed facet: behind that ridge now lies this new facet."""

WORD = 64
"""Ridges whose vertices are compared at once."""

NONE, ONE, ALL = np.uint64(0), np.uint64(1), np.uint64((1 << 64) - 1)
THREE = np.uint32(3)
SEVEN = np.uint32(7)


@merged
def find_visible(polytope, dim, used, point):
    """Find the facets visible from a point, and their horizon, by testing all facets."""
    planes, neighbours, marks = polytope.planes, polytope.neighbours, polytope.marks
    heights, visible, horizon = polytope.heights, polytope.visible, polytope.horizon
    count = ridges = NONE
    for f in range(used):
        heights[f] = height_above(planes, f, point)
    # Without branches, so that the loops vectorise: rejected entries are overwritten.
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

    The visible facets of a convex polytope are connected. Marks below `stamp` are those of earlier
    floods, `stamp` itself means tested and not visible, `stamp` + 1 visible.
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
    """Position in a facet of the ridge to another one, which is opposite a corner there.

    Where facets have the same vertices and several ridges in common, each is opposite one corner.
    """
    corners, neighbours = polytope.corners, polytope.neighbours
    position = -1
    for c in range(dim):
        if neighbours[facet, c] == other and (position < 0 or corners[facet, c] == corner):
            position = c
    return position


@merged
def join(polytope, dim, ridge, new, vertex, pinched):
    """Join a ridge of the horizon and the new vertex, its last corner, to a facet.

    `pinched`: whether facets may have several ridges in common.

    Returns:
        The facets on both sides of the ridge: (visible, behind it).
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

    Around a face lie only removed facets from the one new facet to the other.
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
                # In the next facet leave through the ridge opposite the corner not yet passed.
                corner = corners[facet, staying]
                position = _position_of(polytope, dim, link, facet, corners[facet, leaving])
                facet, staying = link, np.uint32(position)
                for c in range(dim):
                    if corners[facet, c] == corner:
                        leaving = np.uint32(c)
            # The last corner of v is now where the one was that the ridge lacks.
            slot = np.int64(k) if b == dim - 1 else b
            neighbours[new, slot] = link & ~NEW_FACET


@merged
def _mark_ridges(polytope, dim, first, last, vertices):
    """Set the bits of some new facets in the words of their vertices."""
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
    """Link a new facet to its neighbours among those marked; returns the bits of ambiguous ones."""
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
    """Find the neighbours of the facets added last; see the module.

    Args:
        polytope: `Polytope`.
        dim: Its dimension.
        ridges: Number of the ridges of the horizon, and of new facets.
        vertices: Number of vertices, with that of the new facets.

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
