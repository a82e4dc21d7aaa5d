"""Welding of vertices whose positions differ by rounding only."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from grasp3d.arrays import Bools, Floats, Ints, used_indices
from grasp3d.mesh.measures import Edges, edges_of, has_area, parts_of
from grasp3d.mesh.repair.cleaning import PAIR, first_alike, is_face
from grasp3d.mesh.work_bounds import close_pairs

WELDS = (1e-9, 1e-8, 1e-7, 1e-6)
"""Distances within which the borders of open surfaces are joined, as fractions of the size."""


def first_of_body(faces: Ints, first_vertex: Ints) -> Ints:
    """Join the vertices at one position, but not those of bodies that are separate in the file.

    Args:
        faces: Faces (F, 3) of the file.
        first_vertex: First vertex at the position of each vertex, shape (V,).

    Returns:
        First vertex at the position, and of the body, of each vertex, shape (V,). A body is a
        component that is closed by the file's own indices; all other faces count as one body.
    """
    faces = faces[is_face(faces)]
    part, edges = parts_of(faces), edges_of(faces)
    closed = np.ones(int(part.max(initial=-1)) + 1, dtype=bool)
    closed[part[(edges.faces[edges.of_corner] != PAIR).any(axis=1)]] = False
    body = np.zeros(len(first_vertex), dtype=np.int64)
    body[faces] = np.where(closed, np.arange(1, len(closed) + 1), 0)[part][:, None]
    _, first, inverse = np.unique(
        first_vertex * (len(closed) + 1) + body, return_index=True, return_inverse=True
    )
    return np.asarray(first[inverse], dtype=np.int64)


def first_of_linked(*canonical: Ints) -> Ints:
    """First vertex of those that several maps of canonical vertices connect, shape (V,)."""
    count = len(canonical[0])
    ends = np.tile(np.arange(count), len(canonical)), np.concatenate(canonical)
    return _first(coo_array((np.ones(len(ends[0]), dtype=np.int8), ends), shape=(count, count)))


def _first(links: coo_array) -> Ints:
    """First row of each row's connected component."""
    _, part = connected_components(links, directed=False)
    _, first, inverse = np.unique(part, return_index=True, return_inverse=True)
    return np.asarray(first[inverse], dtype=np.int64)


def clusters(
    points: Floats, distance: float, *, loose: Bools | None = None, reach: float = 0.0
) -> Ints:
    """First point of each point's cluster, shape (V,); clusters are connected by small steps.

    Args:
        points: Positions (V, 3).
        distance: Longest step.
        loose: Points (V,) to and from which steps may be longer.
        reach: Longest such step.
    """
    pairs = close_pairs(points, max(distance, reach))
    if loose is not None:
        length = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
        pairs = pairs[(length <= distance) | loose[pairs].any(axis=1)]
    return _first(
        coo_array((np.ones(len(pairs), dtype=np.int8), pairs.T), shape=(len(points),) * 2)
    )


def weld_nearby(points: Floats, faces: Ints, rounding: float) -> Ints:
    """Join vertices whose positions differ by rounding only, if that repairs some edges.

    Vertices within rounding of each other are joined if fewer edges then have other than two faces;
    then those on open edges, within the smallest of several distances that leaves the fewest such
    edges. A distance at which a face with an area would collapse is too large: the two sides of a
    thin plate must not be joined. A sound surface is not changed.

    Args:
        points: Positions (V, 3) of a surface of size about 1.
        faces: Faces (F, 3) over one vertex per position.
        rounding: Largest error of a coordinate.

    Returns:
        Canonical vertex of each vertex, shape (V,).
    """
    best = np.arange(len(points))
    edges = _edges_once(faces)
    fewest = int((edges.faces != PAIR).sum())
    close = 4.0 * rounding
    if fewest:
        joined = _joined(points, faces, used_indices(faces), close, rounding)
        if joined is not None:
            joined_edges = _edges_once(joined[faces])
            if (joined_edges.faces != PAIR).sum() < fewest:
                best, edges = joined, joined_edges
    start, border = best, used_indices(edges.ends[edges.faces == 1])
    fewest = int((edges.faces == 1).sum())
    for distance in (weld for weld in (close, *WELDS) if weld >= close):
        if fewest == 0:
            break
        joined = _joined(points, start[faces], border, distance, rounding)
        if joined is None:
            break
        count = int((_edges_once(joined[start[faces]]).faces == 1).sum())
        if count < fewest:
            best, fewest = joined[start], count
    return best


def _joined(
    points: Floats, faces: Ints, among: Ints, distance: float, rounding: float
) -> Ints | None:
    """Canonical vertex of each vertex; None if a face with an area would collapse."""
    joined = np.arange(len(points))
    joined[among] = among[clusters(points[among], distance)]
    lost = ~is_face(joined[faces])
    if lost.any() and has_area(points, faces[lost], rounding).any():
        return None
    return joined


def _edges_once(faces: Ints) -> Edges:
    """Edges of the distinct faces: a repeated one, in either winding, does not close a gap."""
    faces = faces[is_face(faces)]
    first, _ = first_alike(np.sort(faces, axis=1))
    return edges_of(faces[first])
