"""Which vertices and faces make up the surface, without renumbering anything."""

from dataclasses import dataclass

import numpy as np

from grasp3d.arrays import Bools, Floats, Ints


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


def first_at_place(vertices: Floats) -> Ints:
    """For each vertex the first one with exactly its position, shape (V,)."""
    rows = np.ascontiguousarray(vertices + 0.0)  # -0.0 and 0.0 are one place
    keys = rows.view(np.dtype((np.void, rows.dtype.itemsize * 3))).ravel()
    _, first, inverse = np.unique(keys, return_index=True, return_inverse=True)
    return np.asarray(first[inverse], dtype=np.int64)


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


def rounding_of(vertices: Floats) -> float:
    """How far rounding may have moved a coordinate; more for files that hold 32 bits only."""
    single = np.array_equal(vertices, vertices.astype(np.float32))
    step = np.finfo(np.float32 if single else np.float64).eps
    return float(step * np.abs(vertices).max(initial=0.0))


def has_area(vertices: Floats, faces: Ints, rounding: float) -> Bools:
    """Tell the faces with an area from the needles and caps without one, shape (F,).

    A face counts as flat when its height is lost in the rounding of its coordinates: its normal
    would be anyone's guess.

    Args:
        vertices: Positions (V, 3).
        faces: Faces (F, 3).
        rounding: How far a coordinate may be off, in the same unit.
    """
    corners = vertices[faces]  # (F, 3 corners, 3)
    sides = np.roll(corners, -1, axis=1) - corners
    longest = np.linalg.norm(sides, axis=2).max(axis=1)
    doubled = np.linalg.norm(np.cross(sides[:, 0], sides[:, 1]), axis=1)
    height = np.divide(doubled, longest, out=np.zeros_like(doubled), where=longest > 0.0)
    return np.asarray(height > 4.0 * rounding)
