"""A polytope of simplicial facets, laid out for the growing hull."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling import merged

TOLERANCE = 1e-12
"""Height above a facet that counts as none, in units of the wrenches' own size."""

VECTORS = 18
"""Rows of scratch."""


class Polytope(NamedTuple):
    """Room for a polytope; nothing in it outlives one grasp. p vertices, f facets."""

    points: npt.NDArray[np.float64]
    """Vertices (p, 6)."""
    mixes: npt.NDArray[np.float64]
    """Force that each vertex is made of, in its contact's axes (p, 4)."""
    owners: npt.NDArray[np.int64]
    """Contact or row of each vertex (p,)."""
    names: npt.NDArray[np.int64]
    """Names of the vertices (p,); see `support`."""
    planes: npt.NDArray[np.float64]
    """Outward normal (6), height over the origin and tolerance of each facet, all as long as if the
    coordinates were those of wrenches; height nan: the facet is gone (8, f). One row per number, so
    that many facets are tested at once."""
    corners: npt.NDArray[np.uint32]
    """Vertices of each facet (f, 8)."""
    across: npt.NDArray[np.uint32]
    """Neighbour opposite each corner: eight times its number, and the place there of the corner
    that looks back (f, 8)."""
    marks: npt.NDArray[np.int64]
    """Whether, or when, the new vertex was found to see the facet (f,)."""
    heights: npt.NDArray[np.float64]
    """Height of the new vertex above each facet (f,)."""
    seen: npt.NDArray[np.uint32]
    """Facets that the new vertex sees (f,)."""
    free: npt.NDArray[np.uint32]
    """Facets that can be used again (f,)."""
    horizon: npt.NDArray[np.uint32]
    """Ridges between what is seen and what is not: eight times the seen facet, and the place of
    its corner opposite (8 f,)."""
    near: npt.NDArray[np.uint32]
    """Facets that may be the nearest (2 f,)."""
    vectors: npt.NDArray[np.float64]
    """Small vectors (VECTORS, 8): 0-15 the first simplex and proofs, 16 the best direction, 17 the
    plane at hand."""


def make_polytope(facets: int) -> Polytope:
    """Allocate a polytope of so many facets; each new vertex makes several."""
    points = max(facets // 4, 32)
    return Polytope(
        points=np.zeros((points, 6)),
        mixes=np.zeros((points, 4)),
        owners=np.zeros(points, dtype=np.int64),
        names=np.zeros(points, dtype=np.int64),
        planes=np.zeros((8, facets)),
        corners=np.zeros((facets, 8), dtype=np.uint32),
        across=np.zeros((facets, 8), dtype=np.uint32),
        marks=np.zeros(facets, dtype=np.int64),
        heights=np.zeros(facets),
        seen=np.zeros(facets + 1, dtype=np.uint32),
        free=np.zeros(facets, dtype=np.uint32),
        horizon=np.zeros(8 * facets + 1, dtype=np.uint32),
        near=np.zeros(2 * facets + 1, dtype=np.uint32),
        vectors=np.zeros((VECTORS, 8)),
    )


@merged
def height_above(planes, f, x):
    """Height of a point above a facet's plane."""
    along = (planes[0, f] * x[0] + planes[1, f] * x[1]) + (
        planes[2, f] * x[2] + planes[3, f] * x[3]
    )
    return along + (planes[4, f] * x[4] + planes[5, f] * x[5]) - planes[6, f]


@merged
def set_plane(planes, f, n0, n1, n2, n3, n4, n5, height, metric):
    """Write a plane, scaled to length 1 in the metric; returns the square of what it was."""
    square = (
        (n0 * n0 * metric[0] + n1 * n1 * metric[1]) + (n2 * n2 * metric[2] + n3 * n3 * metric[3])
    ) + (n4 * n4 * metric[4] + n5 * n5 * metric[5])
    factor = 1.0 / math.sqrt(square)
    n0, n1, n2 = n0 * factor, n1 * factor, n2 * factor
    n3, n4, n5 = n3 * factor, n4 * factor, n5 * factor
    planes[0, f], planes[1, f], planes[2, f] = n0, n1, n2
    planes[3, f], planes[4, f], planes[5, f] = n3, n4, n5
    planes[6, f] = height * factor
    planes[7, f] = TOLERANCE * (((abs(n0) + abs(n1)) + (abs(n2) + abs(n3))) + (abs(n4) + abs(n5)))
    return square
