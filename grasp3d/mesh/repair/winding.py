"""Which way round the faces go: like their neighbours."""

import numpy as np
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from grasp3d.arrays import Bools, Ints
from grasp3d.mesh.measures import is_closed
from grasp3d.mesh.normals import paired_edges


def disagreeing(faces: Ints) -> tuple[Bools, int]:
    """Find the fewest faces to turn so that neighbours across an edge are wound alike.

    Each face stands twice in a graph, as it is and turned, and a link says which goes with which.
    The connected parts then come in pairs, one of which is the other turned.

    Args:
        faces: Welded faces (F, 3).

    Returns:
        The faces to turn (F,); how many lie on one-sided surfaces (Möbius strips), which cannot be
        wound alike and stay as they are.
    """
    count = len(faces)
    turn = np.zeros(count, dtype=bool)
    if is_closed(faces):
        return turn, 0
    one, two = paired_edges(faces)
    against = _start(faces, one) == _start(faces, two)
    if not against.any():
        return turn, 0
    first, second = one // 3, two // 3
    other = np.where(against, count, 0)
    ends = (
        np.concatenate([first, first + count]),
        np.concatenate([second + other, second + count - other]),
    )
    links = coo_array((np.ones(2 * len(one), dtype=np.int8), ends), shape=(2 * count,) * 2)
    _, part = connected_components(links, directed=False)
    as_is, turned = part[:count], part[count:]
    size = np.bincount(as_is, minlength=int(part.max()) + 1)
    fewer = size[turned] > size[as_is]
    tied = (size[turned] == size[as_is]) & (turned < as_is)
    one_sided = as_is == turned
    return (fewer | tied) & ~one_sided, int(one_sided.sum())


def _start(faces: Ints, half_edges: Ints) -> Ints:
    """Vertex that each half-edge, opposite its corner, begins at."""
    face, corner = np.divmod(half_edges, 3)
    return np.asarray(faces[face, (corner + 1) % 3])
