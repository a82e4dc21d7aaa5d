"""Which vertices and faces make up the surface, without renumbering anything."""

from dataclasses import dataclass

import numpy as np

from grasp3d.arrays import Floats, Ints, first_at_place


@dataclass(frozen=True, eq=False)
class CleanFaces:
    """The faces that bound something, over vertices that stand for all at their place."""

    faces: Ints
    """Shape (F, 3); of the vertices at one position only the first is used."""
    canonical: Ints
    """For every vertex the one that stands for its position, shape (V,)."""
    collapsed: int
    """Faces dropped because two corners lie at one place."""
    repeated: int
    """Faces dropped because the same corners in the same turn came before."""


def clean_faces(vertices: Floats, faces: Ints) -> CleanFaces:
    """Weld vertices at one position and drop the faces that are nothing or come twice.

    Args:
        vertices: Positions (V, 3).
        faces: Vertices of each face (F, 3).
    """
    canonical = first_at_place(vertices)
    welded = canonical[faces]
    distinct = (
        (welded[:, 0] != welded[:, 1])
        & (welded[:, 1] != welded[:, 2])
        & (welded[:, 2] != welded[:, 0])
    )
    kept = welded[distinct]
    turned = _smallest_first(kept)
    _, first = np.unique(turned, axis=0, return_index=True)
    first.sort()
    return CleanFaces(
        faces=kept[first],
        canonical=canonical,
        collapsed=int(len(faces) - len(kept)),
        repeated=int(len(kept) - len(first)),
    )


def _smallest_first(faces: Ints) -> Ints:
    """Turn each face so that its smallest index comes first; the winding stays."""
    shift = np.argmin(faces, axis=1)[:, None]
    columns = (np.arange(3)[None, :] + shift) % 3
    return np.take_along_axis(faces, columns, axis=1)
