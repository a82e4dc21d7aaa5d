"""Which faces bound something, without renumbering anything."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from grasp3d.arrays import Bools, Ints
from grasp3d.mesh.measures import edges_of
from grasp3d.mesh.normals import paired_edges
from grasp3d.mesh.repair.holes import SMALL, holes_of
from grasp3d.mesh.repair.winding import disagreeing

FEW = 0.01
"""Share of a body's edges that may be open while it still is one."""

PAIR = 2
"""Faces on an edge inside a surface."""


def is_face(faces: Ints) -> Bools:
    """Tell the faces with three different corners from points and lines, shape (F,)."""
    a, b, c = faces.T
    return np.asarray((a != b) & (b != c) & (c != a))


def is_first(faces: Ints) -> Bools:
    """Tell the faces that come for the first time, whatever corner they begin at, shape (F,).

    Faces with the same corners in the opposite turn are others: a sheet may have two sides.
    """
    first, _ = first_alike(from_least_corner(faces))
    kept = np.zeros(len(faces), dtype=bool)
    kept[first] = True
    return kept


def from_least_corner(faces: Ints) -> Ints:
    """Let each face begin at its least corner, shape (F, 3)."""
    shift = np.argmin(faces, axis=1)[:, None]
    return np.take_along_axis(faces, (np.arange(3)[None, :] + shift) % 3, axis=1)


def without_mirrored(faces: Ints) -> Bools:
    """Leave each face of a closed body once, when some come again with the opposite turn.

    A body that was put in the file twice, once inside out, has no volume. A sheet with two sides
    has none either, but one side of it is open: it stays. A few small holes do not open a body.

    Args:
        faces: Welded faces (F, 3), none twice with the same turn.

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
    """Number the pieces that hang together across edges with exactly two faces, shape (F,)."""
    one, two = paired_edges(faces)
    links = coo_array((np.ones(len(one), dtype=np.int8), (one // 3, two // 3)), (len(faces),) * 2)
    _, sheet = connected_components(links, directed=False)
    return np.asarray(sheet, dtype=np.int64)


def _is_body(faces: Ints, sheet: Ints) -> Bools:
    """Tell which sheets of a surface are closed but for small holes, whatever their winding."""
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
    """First of each kind of row, and the kind of each row."""
    kinds = np.lexsort(rows.T[::-1])
    new = np.ones(len(rows), dtype=bool)
    new[1:] = (rows[kinds[1:]] != rows[kinds[:-1]]).any(axis=1)
    same = np.empty(len(rows), dtype=np.int64)
    same[kinds] = np.cumsum(new) - 1
    return kinds[new], same
