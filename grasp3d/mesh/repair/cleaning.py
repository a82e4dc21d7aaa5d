"""Degenerate, repeated and mirrored faces, the sheets that faces form, and their winding."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from grasp3d.arrays import Bools, Ints
from grasp3d.mesh.measures import edges_of, is_closed, paired_edges
from grasp3d.mesh.repair.holes import SMALL, holes_of

FEW = 0.01
"""Largest fraction of open edges of a body."""

PAIR = 2
"""Faces on an edge inside a surface."""


def is_face(faces: Ints) -> Bools:
    """Mask of the faces with three different corners, shape (F,)."""
    a, b, c = faces.T
    return np.asarray((a != b) & (b != c) & (c != a))


def is_first(faces: Ints) -> Bools:
    """Mask of the first face of each set of equal ones, at any starting corner, shape (F,).

    Faces with the same corners in the opposite winding are not equal: a sheet may have two sides.
    """
    first, _ = first_alike(from_least_corner(faces))
    kept = np.zeros(len(faces), dtype=bool)
    kept[first] = True
    return kept


def from_least_corner(faces: Ints) -> Ints:
    """Rotate each face so that it begins at its smallest vertex index, shape (F, 3)."""
    shift = np.argmin(faces, axis=1)[:, None]
    return np.take_along_axis(faces, (np.arange(3)[None, :] + shift) % 3, axis=1)


def without_mirrored(faces: Ints) -> Bools:
    """Mask that keeps each face of a closed body once, if some are repeated with opposite winding.

    A body that is in the file twice, once inside out, has no volume. A sheet with two sides has
    none either, but one side of it is open: both are kept. A few small holes do not open a body.

    Args:
        faces: Welded faces (F, 3), none twice with the same winding.

    Returns:
        The faces to keep, shape (F,).
    """
    first, same = first_alike(np.sort(faces, axis=1))
    kept = np.ones(len(faces), dtype=bool)
    if len(first) == len(faces):
        return kept
    once = np.sort(first)
    sheet_of_face = np.zeros(len(faces), dtype=np.int64)
    sheet_of_face[once] = sheets_of(faces[once])
    body = _is_body(faces[once], sheet_of_face[once])
    kept[body[sheet_of_face[first[same]]]] = False
    kept[once] = True
    return kept


def sheets_of(faces: Ints) -> Ints:
    """Sheet of each face, shape (F,): components connected across edges with exactly two faces."""
    one, two = paired_edges(faces)
    links = coo_array((np.ones(len(one), dtype=np.int8), (one // 3, two // 3)), (len(faces),) * 2)
    _, sheet = connected_components(links, directed=False)
    return np.asarray(sheet, dtype=np.int64)


def _is_body(faces: Ints, sheet: Ints) -> Bools:
    """Mask of the sheets that are closed except for small holes, in any winding."""
    turn, _ = disagreeing(faces)
    size = int(faces.max()) + 1
    apart = np.where(turn[:, None], faces[:, ::-1], faces) + sheet[:, None] * size
    edges = edges_of(apart)
    sheet_of_edge = edges.ends[:, 0] // size
    alone = np.bincount(sheet_of_edge[edges.faces == 1], minlength=int(sheet.max()) + 1)
    body = alone <= FEW * np.bincount(sheet_of_edge)
    body[[hole[0] // size for hole in holes_of(apart) if len(hole) > SMALL]] = False
    return np.asarray(body)


def first_alike(rows: Ints) -> tuple[Ints, Ints]:
    """First of each set of equal rows, and the number of its set for each row."""
    kinds = np.lexsort(rows.T[::-1])
    new = np.ones(len(rows), dtype=bool)
    new[1:] = (rows[kinds[1:]] != rows[kinds[:-1]]).any(axis=1)
    same = np.empty(len(rows), dtype=np.int64)
    same[kinds] = np.cumsum(new) - 1
    return kinds[new], same


def disagreeing(faces: Ints) -> tuple[Bools, int]:
    """Find the fewest faces to flip so that neighbours across an edge are wound alike.

    A graph has two nodes per face, as given and flipped, and links the nodes of neighbours that are
    wound alike. Its components come in pairs, one of which is the other one flipped.

    Args:
        faces: Welded faces (F, 3).

    Returns:
        The faces to flip (F,); the number of faces on one-sided surfaces (Möbius strips), which
        cannot be wound alike and are not flipped.
    """
    count = len(faces)
    flip = np.zeros(count, dtype=bool)
    if is_closed(faces):
        return flip, 0
    one, two = paired_edges(faces)
    against = _start(faces, one) == _start(faces, two)
    if not against.any():
        return flip, 0
    first, second = one // 3, two // 3
    other = np.where(against, count, 0)
    ends = (
        np.concatenate([first, first + count]),
        np.concatenate([second + other, second + count - other]),
    )
    links = coo_array((np.ones(2 * len(one), dtype=np.int8), ends), shape=(2 * count,) * 2)
    _, part = connected_components(links, directed=False)
    as_is, flipped = part[:count], part[count:]
    size = np.bincount(as_is, minlength=int(part.max()) + 1)
    fewer = size[flipped] > size[as_is]
    tied = (size[flipped] == size[as_is]) & (flipped < as_is)
    one_sided = as_is == flipped
    return (fewer | tied) & ~one_sided, int(one_sided.sum())


def _start(faces: Ints, half_edges: Ints) -> Ints:
    """Start vertex of each half-edge, numbered by the corner opposite to it."""
    face, corner = np.divmod(half_edges, 3)
    return np.asarray(faces[face, (corner + 1) % 3])
