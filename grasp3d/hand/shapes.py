"""Grippers, their free approaches and tables as triangles, for pictures."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from enum import IntEnum

import numpy as np
import trimesh

from grasp3d.arrays import ArrayLike, Bytes, Floats, Ints, locked
from grasp3d.errors import SettingError
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.hand.table import Table
from grasp3d.mesh import ObjectMesh
from grasp3d.settings.lengths import METRES, Unit

PAD_DEPTH = 0.25
"""Depth of the pads that are drawn, as a fraction of the finger's thickness."""

ARC_STEP = math.radians(3.0)
"""Largest angle between neighbouring points of an arc [rad]."""

TABLE_SIZE, TABLE_DEPTH, TABLE_GAP = 1.3, 0.01, 5e-4
"""Radius of a table beside that of the object on it; its thickness, and the gap that keeps faces of
the object from lying in it, as fractions of the object's size."""

TABLE_SIDES = 72


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

ARC_COLOR = (0x00, 0x72, 0xB2)
TABLE_COLOR = (0xC9, 0xC4, 0xBA)


@dataclass(frozen=True, eq=False)
class Triangles:
    """Triangles to be drawn; normals of closed parts point outward."""

    vertices: Floats
    """Positions in the frame and unit of the mesh, shape (V, 3)."""
    faces: Ints
    """Vertices of the triangles, shape (F, 3)."""
    parts: Bytes
    """Part of the gripper that each triangle belongs to, a `Part`, shape (F,); 0 elsewhere."""


def gripper_triangles(
    gripper: ParallelGripper,
    opening: float,
    *,
    pose: ArrayLike | None = None,
    unit: Unit = "m",
) -> Triangles:
    """Palm, fingers, and pads or round tips of a gripper at a pose.

    They have the lengths of the description, except that pads, which are coloured differently,
    take the front quarter of the fingers' thickness.

    Args:
        gripper: The gripper.
        opening: Distance between the pads, or between the nearest points of round tips [unit].
        pose: Matrix that takes coordinates of the gripper's frame to the mesh's, shape (4, 4), with
            translations in `unit`; None: they are the same.
        unit: Unit of the mesh.

    Raises:
        SettingError: The opening is no length, or the pose no matrix.

    Example:
        >>> from grasp3d.hand.presets import preset
        >>> from grasp3d.hand.shapes import gripper_triangles
        >>> shape = gripper_triangles(preset("franka"), 40.0, unit="mm")
        >>> shape.vertices.max(axis=0).round(1).tolist()
        [104.0, 31.6, 8.8]
    """
    if not (math.isfinite(opening) and opening >= 0.0):
        raise SettingError(f"opening must be a finite length of at least 0; got {opening:g}")
    metres = opening * METRES[unit]
    parts = [(Part.PALM, _palm(gripper))]
    for side in (-1.0, 1.0):
        parts += _finger(gripper, metres, side)
    meshes = [mesh for _, mesh in parts]
    starts = np.cumsum([0, *(len(mesh.vertices) for mesh in meshes)])
    faces = [mesh.faces + start for mesh, start in zip(meshes, starts, strict=False)]
    ids = [np.full(len(mesh.faces), part, np.uint8) for part, mesh in parts]
    vertices = np.concatenate([mesh.vertices for mesh in meshes]) / METRES[unit]
    return _triangles(moved(vertices, pose), np.concatenate(faces), np.concatenate(ids))


def approach_triangles(
    pose: ArrayLike, arcs: Sequence[tuple[float, float]], *, radius: float, inner: float = 0.8
) -> Triangles:
    """The free approach angles of a grasp as a fan about its closing axis.

    The fan is on the side that the gripper comes from: at an angle phi the gripper stands in the
    direction (0, sin phi, -cos phi) of the TCP, in the frame of the pose.

    Args:
        pose: Matrix of the grasp whose approach is the angle 0, shape (4, 4).
        arcs: Intervals of approach angles (low, high) about the pose's x-axis [rad]; the approach
            margin h of a pose in the middle of its arc is the interval (-h, h).
        radius: Outer radius of the fan [mesh unit].
        inner: Its inner radius, as a fraction of the outer one.

    Returns:
        Flat triangles, which have two sides.

    Example:
        >>> import numpy as np
        >>> from grasp3d.hand.shapes import approach_triangles
        >>> fan = approach_triangles(np.eye(4), [(-0.5, 0.5)], radius=2.0)
        >>> bool(fan.vertices[:, 0].any()), bool(np.all(fan.vertices[:, 2] < 0.0))
        (False, True)
    """
    if not (math.isfinite(radius) and radius > 0.0 and 0.0 <= inner < 1.0):
        raise SettingError("an approach arc needs a radius above 0, and inner from 0 to below 1")
    points: list[Floats] = []
    faces: list[Ints] = []
    for low, high in arcs:
        steps = max(1, math.ceil((high - low) / ARC_STEP))
        angles = np.linspace(low, high, steps + 1)
        rim = np.stack([0.0 * angles, np.sin(angles), -np.cos(angles)], axis=1)
        start = 2 * np.arange(steps) + sum(map(len, points))
        points.append((radius * np.stack([inner * rim, rim], axis=1)).reshape(-1, 3))
        faces.append(np.stack([start, start + 1, start + 3, start, start + 3, start + 2], axis=1))
    vertices = moved(np.concatenate([np.zeros((0, 3)), *points]), pose)
    triangles = np.concatenate([np.zeros((0, 6), np.int64), *faces]).reshape(-1, 3)
    return _triangles(vertices, triangles)


def table_triangles(table: Table, mesh: ObjectMesh) -> Triangles:
    """A round plate below an object, somewhat larger than it.

    Args:
        table: The table.
        mesh: The object that stands on it.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.hand.shapes import table_triangles
        >>> from grasp3d.hand.table import Table
        >>> box = grasp3d.load_mesh(trimesh.creation.box([0.08, 0.05, 0.03]), unit="m")
        >>> plate = table_triangles(Table.below(box), box)
        >>> round(float(plate.vertices[:, 2].max()), 3)
        -0.015
    """
    return plate_triangles(table, mesh.vertices[mesh.on_surface], mesh.size)


def plate_triangles(table: Table, points: Floats, size: float) -> Triangles:
    """The same plate below the points of an object, shape (n, 3), of a size."""
    heights = points @ table.normal
    flat = points - np.multiply.outer(heights, table.normal)
    centre = 0.5 * (flat.min(axis=0) + flat.max(axis=0))
    centre = centre - (centre @ table.normal) * table.normal
    radius = TABLE_SIZE * float(np.linalg.norm(flat - centre, axis=1).max())
    depth, gap = TABLE_DEPTH * size, TABLE_GAP * size
    plate = trimesh.creation.cylinder(radius, depth, sections=TABLE_SIDES)
    turn = trimesh.geometry.align_vectors([0.0, 0.0, 1.0], table.normal)[:3, :3]
    middle = centre + (table.offset - gap - 0.5 * depth) * table.normal
    return _triangles(plate.vertices @ turn.T + middle, plate.faces)


def moved(points: Floats, pose: ArrayLike | None) -> Floats:
    """Points (n, 3) moved by a rigid transformation (4, 4); None: not moved.

    Raises:
        SettingError: It is no matrix of that kind.
    """
    if pose is None:
        return points
    matrix = np.asarray(pose, dtype=np.float64)
    last = [0.0, 0.0, 0.0, 1.0]
    if matrix.shape != (4, 4) or not np.isfinite(matrix).all() or matrix[3].tolist() != last:
        raise SettingError(
            "a pose must be a matrix of 4 x 4 finite numbers whose last row is 0 0 0 1; "
            f"got shape {matrix.shape}"
        )
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])


def _palm(gripper: ParallelGripper) -> trimesh.Trimesh:
    front = gripper.end - gripper.finger_length
    x, y = 0.5 * gripper.palm_thickness, 0.5 * gripper.palm_width
    return _box((-x, -y, front - gripper.palm_length), (x, y, front))


def _finger(
    gripper: ParallelGripper, opening: float, side: float
) -> list[tuple[Part, trimesh.Trimesh]]:
    """Parts of the finger on one side of the closing axis, -1 or 1; lengths in metres."""
    half = 0.5 * gripper.finger_width
    low, high = gripper.end - gripper.finger_length, gripper.end
    inner = 0.5 * opening
    if gripper.round_tips:
        centre = inner + gripper.tip_radius
        ball = trimesh.creation.icosphere(subdivisions=3, radius=gripper.tip_radius)
        ball.apply_translation([side * centre, 0.0, 0.0])
        near, far = (centre + sign * 0.5 * gripper.finger_thickness for sign in (-1.0, 1.0))
        return [(Part.FINGER, _beside(side, near, far, half, low, high)), (Part.TIP, ball)]
    behind, outer = (inner + part * gripper.finger_thickness for part in (PAD_DEPTH, 1.0))
    y, z = 0.5 * gripper.pad_width, 0.5 * gripper.pad_height
    return [
        (Part.FINGER, _beside(side, behind, outer, half, low, high)),
        (Part.PAD, _beside(side, inner, behind, y, -z, z)),
    ]


def _beside(
    side: float, near: float, far: float, half: float, low: float, high: float
) -> trimesh.Trimesh:
    """A box from near to far of x = 0, on one side of it."""
    ends = sorted((side * near, side * far))
    return _box((ends[0], -half, low), (ends[1], half, high))


def _box(low: tuple[float, float, float], high: tuple[float, float, float]) -> trimesh.Trimesh:
    box: trimesh.Trimesh = trimesh.creation.box(bounds=[low, high])
    return box


def _triangles(vertices: ArrayLike, faces: ArrayLike, parts: Bytes | None = None) -> Triangles:
    numbers = np.zeros(len(np.asarray(faces)), np.uint8) if parts is None else parts
    return Triangles(locked(vertices, np.float64), locked(faces, np.int64), locked(numbers))
