"""Division of polygons into triangles."""

import mapbox_earcut
import numpy as np

from grasp3d.arrays import Floats, Ints
from grasp3d.reading.sources import Source, check_finite

MOST_CORNERS = 1000
"""Largest number of corners of a face; round lids have a few hundred."""

FOLDED = 1e-6
"""Area that a triangle may have on the wrong side of its face, as a fraction of the face's."""


def as_triangles(source: Source, vertices: Floats, corners: Ints, counts: Ints) -> Ints:
    """Divide polygons into triangles, shape (F, 3).

    They share the first corner of their polygon, unless one would then lie outside it, or on
    another one: then its ears are cut.

    Args:
        source: The file.
        vertices: Positions, shape (V, 3).
        corners: Vertex numbers of the corners of one polygon after the other, shape (k,).
        counts: How many are those of each polygon, shape (n,).

    Raises:
        MeshError: A polygon has too few or too many corners, or such as do not exist.
    """
    bad = np.flatnonzero((counts < 3) | (counts > MOST_CORNERS))
    if len(bad):
        raise source.error(
            f"face {bad[0]} has {counts[bad[0]]:,} corners; 3 to {MOST_CORNERS:,} are allowed"
        )
    check_finite(vertices, source.where)
    outside = np.flatnonzero((corners < 0) | (corners >= len(vertices)))
    if len(outside):
        face = np.searchsorted(np.cumsum(counts), outside[0], side="right")
        raise source.damaged(
            f"face {face} uses vertex {corners[outside[0]]}, but there are {len(vertices):,} "
            "vertices"
        )
    starts, polygons = np.cumsum(counts) - counts, np.repeat(np.arange(len(counts)), counts - 2)
    first = starts[polygons]
    step = np.arange(len(first)) - (first - 2 * polygons)
    fans: Ints = corners[np.stack([first, first + step + 1, first + step + 2], axis=1)]
    if (counts == 3).all():
        return fans
    with np.errstate(over="ignore", invalid="ignore"):  # of coordinates that are refused later
        one, two, three = np.moveaxis(vertices[fans], 1, 0)
        normals = np.cross(two - one, three - one)
        of_polygons = np.add.reduceat(normals, starts - 2 * np.arange(len(counts)))
        areas = (normals * of_polygons[polygons]).sum(axis=1)
        is_folded = areas < -FOLDED * (of_polygons**2).sum(axis=1)[polygons]
    folded = np.unique(polygons[is_folded])
    is_left = ~np.isin(polygons, folded)
    parts, numbers = [fans[is_left]], [polygons[is_left]]
    for polygon in folded:
        own = corners[starts[polygon] : starts[polygon] + counts[polygon]]
        ears = own[_ears(vertices[own], of_polygons[polygon])]
        if len(ears) < len(own) - 2:  # it crosses itself
            ears = fans[polygons == polygon]
        parts.append(ears)
        numbers.append(np.full(len(ears), polygon))
    return np.concatenate(parts)[np.argsort(np.concatenate(numbers), kind="stable")]


def _ears(points: Floats, normal: Floats) -> Ints:
    """Triangles (k, 3) of a polygon, in numbers of its corners, cut on the plane of its normal."""
    normal = normal / np.linalg.norm(normal)
    side = np.cross(normal, np.eye(3)[np.abs(normal).argmin()])
    side /= np.linalg.norm(side)
    flat = (points - points[0]) @ np.stack([side, np.cross(normal, side)], axis=1)
    ends = np.array([len(points)], dtype=np.uint32)
    return mapbox_earcut.triangulate_float64(flat, ends).reshape(-1, 3).astype(np.int64)
