"""Triangles of hands, of their free approach angles and of tables, for pictures."""

import math
from dataclasses import dataclass
from enum import IntEnum
from typing import Any

import numpy as np
import trimesh

from grasp3d.arrays import ArrayLike, Bytes, Floats, Ints, locked
from grasp3d.hand.jaws import Jaws
from grasp3d.hand.table import Table
from grasp3d.mesh import ObjectMesh

ARC_STEP = math.radians(3.0)
"""Largest angle between neighbouring points of an arc [rad]."""

TABLE_SIZE, TABLE_DEPTH, TABLE_GAP = 1.3, 0.01, 5e-4
"""Radius of a table relative to that of the object on it; its thickness, and the gap that keeps
faces of the object from lying in it, as fractions of the object's size."""

TABLE_SIDES = 72

ARC_COLOR = (0x00, 0x72, 0xB2)
TABLE_COLOR = (0xC9, 0xC4, 0xBA)


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
    """For a hand with joints, the link of each triangle, shape (F,); 0 elsewhere."""


def triangles_of(
    vertices: ArrayLike, faces: ArrayLike, parts: Bytes | None = None, links: Ints | None = None
) -> Triangles:
    """Make `Triangles` with locked arrays; without parts or links these are 0."""
    none = np.zeros(len(np.asarray(faces)), np.uint8)
    return Triangles(
        locked(vertices, np.float64), locked(faces, np.int64),
        locked(none if parts is None else parts),
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
    """
    inner, thick, end = 0.5 * opening, jaws.finger_thickness, jaws.end
    front, half = end - jaws.finger_length, 0.5 * jaws.finger_width
    x, y, z = 0.5 * jaws.palm_thickness, 0.5 * jaws.pad_width, 0.5 * jaws.pad_height
    meshes = [(Part.PALM, _box((-x, x), 0.5 * jaws.palm_width, (front - jaws.palm_length, front)))]
    for side in (-1.0, 1.0):
        if jaws.round_tips:
            centre = inner + jaws.tip_radius
            ends = side * (centre - 0.5 * thick), side * (centre + 0.5 * thick)
            tip = trimesh.creation.icosphere(subdivisions=3, radius=jaws.tip_radius)
            tip.apply_translation([side * centre, 0.0, 0.0])
            meshes += [(Part.FINGER, _box(ends, half, (front, end))), (Part.TIP, tip)]
        else:
            behind, outer = inner + PAD_DEPTH * thick, inner + thick
            finger = _box((side * behind, side * outer), half, (front, end))
            pad = _box((side * inner, side * behind), y, (-z, z))
            meshes += [(Part.FINGER, finger), (Part.PAD, pad)]
    whole: Any = trimesh.util.concatenate([mesh for _, mesh in meshes])
    counts = [len(mesh.faces) for _, mesh in meshes]
    parts = np.repeat(np.array([part for part, _ in meshes], np.uint8), counts)
    return triangles_of(whole.vertices, whole.faces, parts)


def _box(ends: tuple[float, float], half: float, heights: tuple[float, float]) -> Any:
    """A box between two x in any order, about y = 0, and between two z."""
    return trimesh.creation.box(bounds=np.transpose([sorted(ends), (-half, half), heights]))


def approach_triangles(
    pose: Floats, margin: float, *, radius: float, inner: float = 0.8
) -> Triangles:
    """The free approach angles of a grasp as a fan about its closing axis.

    The fan is on the side that the gripper comes from: at an angle phi the gripper stands in the
    direction (0, sin phi, -cos phi) of the TCP, in the frame of the pose.

    Args:
        pose: Matrix of the grasp whose approach is the angle 0, shape (4, 4).
        margin: Half-width of the free angles about the pose's x-axis [rad].
        radius: Outer radius of the fan.
        inner: Its inner radius, as a fraction of the outer one.

    Returns:
        Flat triangles, which have two sides.

    Example:
        >>> import numpy as np
        >>> from grasp3d.hand.triangles import approach_triangles
        >>> fan = approach_triangles(np.eye(4), 0.5, radius=2.0)
        >>> bool(fan.vertices[:, 0].any()), bool(np.all(fan.vertices[:, 2] < 0.0))
        (False, True)
    """
    steps = max(1, math.ceil(2.0 * margin / ARC_STEP))
    angles = np.linspace(-margin, margin, steps + 1)
    rim = np.stack([0.0 * angles, np.sin(angles), -np.cos(angles)], axis=1)
    points = (radius * np.stack([inner * rim, rim], axis=1)).reshape(-1, 3)
    start = 2 * np.arange(steps)
    faces = np.stack([start, start + 1, start + 3, start, start + 3, start + 2], axis=1)
    return triangles_of(trimesh.transform_points(points, pose), faces.reshape(-1, 3))


def table_triangles(table: Table, mesh: ObjectMesh) -> Triangles:
    """A round plate below an object, somewhat larger than it.

    Args:
        table: The table.
        mesh: The object that stands on it.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.hand.triangles import table_triangles
        >>> from grasp3d.hand.table import Table
        >>> box = grasp3d.load_mesh(trimesh.creation.box([0.08, 0.05, 0.03]), unit="m")
        >>> plate = table_triangles(Table.below(box), box)
        >>> round(float(plate.vertices[:, 2].max()), 3)
        -0.015
    """
    points = mesh.vertices[mesh.on_surface]
    heights = points @ table.normal
    flat = points - np.multiply.outer(heights, table.normal)
    centre = 0.5 * (flat.min(axis=0) + flat.max(axis=0))
    centre = centre - (centre @ table.normal) * table.normal
    radius = TABLE_SIZE * float(np.linalg.norm(flat - centre, axis=1).max())
    depth, gap = TABLE_DEPTH * mesh.size, TABLE_GAP * mesh.size
    plate = trimesh.creation.cylinder(radius, depth, sections=TABLE_SIDES)
    turn = trimesh.geometry.align_vectors([0.0, 0.0, 1.0], table.normal)[:3, :3]
    middle = centre + (table.offset - gap - 0.5 * depth) * table.normal
    return triangles_of(plate.vertices @ turn.T + middle, plate.faces)
