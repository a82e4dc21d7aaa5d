"""Consistent winding of neighbouring faces."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from grasp3d.arrays import Bools, Ints
from grasp3d.mesh.measures import is_closed, paired_edges


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
