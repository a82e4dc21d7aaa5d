"""Shapes of hands as triangles, and that of a parallel gripper."""

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import TYPE_CHECKING

import numpy as np

from grasp3d.arrays import ArrayLike, Bytes, Floats, Ints, locked
from grasp3d.errors import SettingError
from grasp3d.hand.jaws import Jaws

if TYPE_CHECKING:
    import trimesh


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
    """Positions in the frame of the mesh, shape (V, 3)."""
    faces: Ints
    """Vertices of the triangles, shape (F, 3)."""
    parts: Bytes
    """Part of the gripper that each triangle belongs to, a `Part`, shape (F,); 0 elsewhere."""
    links: Ints
    """Number of its link of a hand with joints, shape (F,); 0 elsewhere."""


def triangles_of(
    vertices: ArrayLike, faces: ArrayLike, parts: Bytes | None = None, links: Ints | None = None
) -> Triangles:
    """Triangles with arrays that are locked; without parts or links all are of number 0."""
    none = np.zeros(len(np.asarray(faces)), np.uint8)
    numbers = none if parts is None else parts
    return Triangles(
        locked(vertices, np.float64), locked(faces, np.int64), locked(numbers),
        locked(none if links is None else links, np.int64),
    )  # fmt: skip


PAD_DEPTH = 0.25
"""Depth of the pads that are drawn, as a fraction of the finger's thickness."""


def jaw_triangles(jaws: Jaws, opening: float) -> Triangles:
    """Palm, fingers, and pads or round tips of a gripper in its own frame [m].

    They have the lengths of the description, except that pads, which are coloured differently,
    take the front quarter of the fingers' thickness.

    Args:
        jaws: The gripper.
        opening: Distance between the pads, or between the nearest points of round tips [m].

    Raises:
        SettingError: The opening is no length.
    """
    if not (math.isfinite(opening) and opening >= 0.0):
        raise SettingError(f"opening must be a finite length of at least 0; got {opening:g}")
    parts = [(Part.PALM, _palm(jaws))]
    for side in (-1.0, 1.0):
        parts += _finger(jaws, opening, side)
    meshes = [mesh for _, mesh in parts]
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    ids = [np.full(len(mesh.faces), part, np.uint8) for part, mesh in parts]
    vertices = np.concatenate([mesh.vertices for mesh in meshes])
    return triangles_of(vertices, np.concatenate(faces), np.concatenate(ids))


def _palm(jaws: Jaws) -> "trimesh.Trimesh":
    front = jaws.end - jaws.finger_length
    x, y = 0.5 * jaws.palm_thickness, 0.5 * jaws.palm_width
    return _box((-x, -y, front - jaws.palm_length), (x, y, front))


def _finger(jaws: Jaws, opening: float, side: float) -> "list[tuple[Part, trimesh.Trimesh]]":
    """Parts of the finger on one side of the closing axis, -1 or 1; lengths in metres."""
    half = 0.5 * jaws.finger_width
    low, high = jaws.end - jaws.finger_length, jaws.end
    inner = 0.5 * opening
    if jaws.round_tips:
        centre = inner + jaws.tip_radius
        from trimesh import creation

        ball = creation.icosphere(subdivisions=3, radius=jaws.tip_radius)
        ball.apply_translation([side * centre, 0.0, 0.0])
        near, far = (centre + sign * 0.5 * jaws.finger_thickness for sign in (-1.0, 1.0))
        return [(Part.FINGER, _beside(side, near, far, half, low, high)), (Part.TIP, ball)]
    behind, outer = (inner + part * jaws.finger_thickness for part in (PAD_DEPTH, 1.0))
    y, z = 0.5 * jaws.pad_width, 0.5 * jaws.pad_height
    return [
        (Part.FINGER, _beside(side, behind, outer, half, low, high)),
        (Part.PAD, _beside(side, inner, behind, y, -z, z)),
    ]


def _beside(
    side: float, near: float, far: float, half: float, low: float, high: float
) -> "trimesh.Trimesh":
    """A box from near to far of x = 0, on one side of it."""
    ends = sorted((side * near, side * far))
    return _box((ends[0], -half, low), (ends[1], half, high))


def _box(low: tuple[float, float, float], high: tuple[float, float, float]) -> "trimesh.Trimesh":
    from trimesh import creation  # it brings much that readers of poses do not need

    box: trimesh.Trimesh = creation.box(bounds=[low, high])
    return box
