"""Areas, volumes, places and rounding of plain vertex and face arrays."""

import numpy as np

from grasp3d.arrays import Bools, Floats, Ints


def face_areas(vertices: Floats, faces: Ints) -> Floats:
    """Areas of the faces, shape (F,)."""
    a, b, c = vertices[faces[:, 0]], vertices[faces[:, 1]], vertices[faces[:, 2]]
    return np.asarray(0.5 * np.linalg.norm(np.cross(b - a, c - a), axis=1))


def signed_volumes(vertices: Floats, faces: Ints) -> Floats:
    """Volumes of the tetrahedra from the origin to each face, shape (F,)."""
    a, b, c = vertices[faces[:, 0]], vertices[faces[:, 1]], vertices[faces[:, 2]]
    return np.asarray(np.einsum("ij,ij->i", a, np.cross(b, c)) / 6.0)


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
