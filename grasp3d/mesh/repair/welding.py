"""Joining vertices that are one place but for their rounding."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components
from scipy.spatial import cKDTree

from grasp3d.arrays import Bools, Floats, Ints
from grasp3d.mesh.measures import Edges, edges_of, has_area, parts_of
from grasp3d.mesh.repair.cleaning import PAIR, first_alike, is_face

WELDS = (1e-9, 1e-8, 1e-7, 1e-6)
"""Distances within which the borders of open surfaces are joined, as shares of the size."""


def first_of_body(faces: Ints, place: Ints) -> Ints:
    """Join the vertices at one position, but not those of bodies that the file tells apart.

    Args:
        faces: Faces (F, 3) as the file has them.
        place: For every vertex the first one at its position, shape (V,).

    Returns:
        For every vertex the first one at its position and of its body, shape (V,). A body is a part
        that is closed by the file's own indices; all the rest counts as one more.
    """
    faces = faces[is_face(faces)]
    part, edges = parts_of(faces), edges_of(faces)
    closed = np.ones(int(part.max(initial=-1)) + 1, dtype=bool)
    closed[part[(edges.faces[edges.of_corner] != PAIR).any(axis=1)]] = False
    body = np.zeros(len(place), dtype=np.int64)
    body[faces] = np.where(closed, np.arange(1, len(closed) + 1), 0)[part][:, None]
    _, first, inverse = np.unique(
        place * (len(closed) + 1) + body, return_index=True, return_inverse=True
    )
    return np.asarray(first[inverse], dtype=np.int64)


def first_of_linked(*canonical: Ints) -> Ints:
    """For every vertex the first of all that stand for each other, shape (V,)."""
    count = len(canonical[0])
    ends = np.tile(np.arange(count), len(canonical)), np.concatenate(canonical)
    return _first(coo_array((np.ones(len(ends[0]), dtype=np.int8), ends), shape=(count, count)))


def _first(links: coo_array) -> Ints:
    """First row of the connected part that each row belongs to."""
    _, part = connected_components(links, directed=False)
    _, first, inverse = np.unique(part, return_index=True, return_inverse=True)
    return np.asarray(first[inverse], dtype=np.int64)


def clusters(
    points: Floats, distance: float, *, loose: Bools | None = None, reach: float = 0.0
) -> Ints:
    """For each point the first one that it hangs together with by small steps, shape (V,).

    Args:
        points: Positions (V, 3).
        distance: Longest step.
        loose: Points (V,) to and from which steps may be longer.
        reach: Longest such step.
    """
    pairs = cKDTree(points).query_pairs(max(distance, reach), output_type="ndarray")
    if loose is not None:
        length = np.linalg.norm(points[pairs[:, 0]] - points[pairs[:, 1]], axis=1)
        pairs = pairs[(length <= distance) | loose[pairs].any(axis=1)]
    return _first(
        coo_array((np.ones(len(pairs), dtype=np.int8), pairs.T), shape=(len(points),) * 2)
    )


def weld_nearby(points: Floats, faces: Ints, rounding: float) -> Ints:
    """Join vertices that are one place but for rounding, if that mends some edges.

    Vertices within rounding of each other are joined where that leaves fewer edges that have not
    just two faces; then those on open edges, within the smallest of several distances that leaves
    the fewest such edges. A distance at which a face with an area would collapse is too large: the
    wall of a thin plate must not close on itself. Nothing happens to a surface that is sound.

    Args:
        points: Positions (V, 3) of a surface of size about 1.
        faces: Faces (F, 3) over vertices that are already one at each position.
        rounding: How far a coordinate may be off.

    Returns:
        For every vertex the one that stands for it, shape (V,).
    """
    best = np.arange(len(points))
    edges = _edges_once(faces)
    fewest = int((edges.faces != PAIR).sum())
    close = 4.0 * rounding
    if fewest:
        joined = _joined(points, faces, np.unique(faces), close, rounding)
        if joined is not None:
            joint = _edges_once(joined[faces])
            if (joint.faces != PAIR).sum() < fewest:
                best, edges = joined, joint
    start, border = best, np.unique(edges.ends[edges.faces == 1])
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
    """For every vertex the one to stand for it; None if a face with an area would collapse."""
    joined = np.arange(len(points))
    joined[among] = among[clusters(points[among], distance)]
    lost = ~is_face(joined[faces])
    if lost.any() and has_area(points, faces[lost], rounding).any():
        return None
    return joined


def _edges_once(faces: Ints) -> Edges:
    """Edges of the faces that are none twice: one that comes again, either way, closes nothing."""
    faces = faces[is_face(faces)]
    first, _ = first_alike(np.sort(faces, axis=1))
    return edges_of(faces[first])
