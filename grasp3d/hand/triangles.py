"""Shapes of hands as triangles."""

from dataclasses import dataclass
from enum import IntEnum

import numpy as np

from grasp3d.arrays import ArrayLike, Bytes, Floats, Ints, locked


class Part(IntEnum):
    """Part of a gripper that a triangle belongs to."""

    PALM = 0
    FINGER = 1
    PAD = 2
    TIP = 3


COLORS: dict[Part, tuple[int, int, int]] = {
    Part.PALM: (0x6E, 0x77, 0x80),
    Part.FINGER: (0x9A, 0xA3, 0xAC),
    Part.PAD: (0x2B, 0x2F, 0x33),
    Part.TIP: (0x2B, 0x2F, 0x33),
}
"""Red, green, blue (0-255) of the parts: greys, since colours belong to the labels."""


@dataclass(frozen=True, eq=False)
class Triangles:
    """Triangles to be drawn; normals of closed parts point outward."""

    vertices: Floats
    """Positions in the frame and unit of the mesh, shape (V, 3)."""
    faces: Ints
    """Vertices of the triangles, shape (F, 3)."""
    parts: Bytes
    """Part of the gripper that each triangle belongs to, a `Part`, shape (F,); 0 elsewhere."""


def triangles_of(vertices: ArrayLike, faces: ArrayLike, parts: Bytes | None = None) -> Triangles:
    """Triangles with arrays that are locked; without parts all are of part 0."""
    numbers = np.zeros(len(np.asarray(faces)), np.uint8) if parts is None else parts
    return Triangles(locked(vertices, np.float64), locked(faces, np.int64), locked(numbers))
