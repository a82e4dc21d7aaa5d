"""The polytope that the growing hull works on: a convex polytope with simplicial facets.

A facet in d dimensions has d vertices (its corners) and d neighbours; it shares a ridge, the face
of d - 1 vertices without one corner, with each neighbour.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling.decorators import merged
from grasp3d._kernels.forces.tasks import task_reach

TOLERANCE = 1e-12
"""Height above a facet below which a point counts as on it, relative to the largest wrench."""

UNKNOWN = np.uint32((1 << 32) - 1)
"""Neighbour of a new facet that was not linked yet."""

SCRATCH_ROWS = 20
"""Rows of `Polytope.vectors`."""


class Polytope(NamedTuple):
    """Arrays for a polytope of at most p vertices and f facets; reused from grasp to grasp.

    Ridges are encoded as 8 * facet + corner, where `corner` is the position, 0 to 5, of the one
    corner that is not on the ridge. Rows of `planes` that are multiples of 4096 bytes apart would
    share the few lines of a cache: capacities are 8 more than a multiple of 512 facets.
    """

    points: npt.NDArray[np.float64]
    """Vertices (p, 6)."""
    vertex_forces: npt.NDArray[np.float64]
    """Contact force of each vertex's wrench, in its contact's axes (p, 6)."""
    owners: npt.NDArray[np.int64]
    """Contact or row of each vertex (p,)."""
    identifiers: npt.NDArray[np.int64]
    """Identifiers of the vertices (p,); see `support`."""
    planes: npt.NDArray[np.float64]
    """Outward normal (6), distance from the origin and tolerance of each facet's plane, normalised
    in the metric of the wrenches; for a task also the distance relative to the task's reach, inf
    where it does not reach that way (9, f); distances nan: the facet was removed. Facets are
    columns, so that the heights of one point above many facets are computed in contiguous,
    vectorised loops."""
    corners: npt.NDArray[np.uint32]
    """Vertices of each facet (f, 8)."""
    neighbours: npt.NDArray[np.uint32]
    """Facet across the ridge opposite each corner (f, 8)."""
    marks: npt.NDArray[np.uint32]
    """Visibility of each facet from the new vertex: 0 or 1, or the stamp of the last flood (f,)."""
    heights: npt.NDArray[np.float64]
    """Height of the new vertex above each facet (f,)."""
    visible: npt.NDArray[np.uint32]
    """Facets that the new vertex lies above (f,)."""
    free: npt.NDArray[np.uint32]
    """Columns of removed facets that can be reused (f,)."""
    horizon: npt.NDArray[np.uint32]
    """Ridges between a visible and an invisible facet, in the visible one's encoding (8 f,)."""
    added: npt.NDArray[np.uint32]
    """The facets added last, in the order of the horizon (f,)."""
    combined: npt.NDArray[np.float64]
    """Normal, height and weight of the planes of the facets being added (f, 8)."""
    squares: npt.NDArray[np.float64]
    """Squared lengths of their normals in the metric (f,)."""
    factors: npt.NDArray[np.float64]
    """One over their lengths (f,)."""
    words: npt.NDArray[np.uint64]
    """Which of 64 ridges contain each vertex (p,)."""
    following: npt.NDArray[np.uint64]
    """Scratch: the ridges that contain all corners of a facet from each on (8,)."""
    queue: npt.NDArray[np.uint32]
    """Facets that may be the nearest to the origin, unordered (2 f,)."""
    vectors: npt.NDArray[np.float64]
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
    """Write a plane, all its numbers times a factor which gives the normal length 1."""
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
        else:  # beyond it is nothing of the task; but the polytope must contain the origin
            planes[8, f] = math.inf if planes[6, f] >= -planes[7, f] else -math.inf


@merged
def set_normalised_plane(planes, f, n, height, metric, task):
    """Write a plane, its normal scaled to length 1 in the metric."""
    factor = 1.0 / math.sqrt(square_in(metric, n[0], n[1], n[2], n[3], n[4], n[5]))
    set_plane(planes, f, n[0], n[1], n[2], n[3], n[4], n[5], height, factor, task)


@merged
def distance_of(planes, f, task):
    """Distance of a facet from the origin, for a task relative to the task's reach beyond it."""
    if task is None:
        return planes[6, f]
    return planes[8, f]
