"""Hands, their free approaches and tables as triangles, for pictures."""

import math
from collections.abc import Sequence

import numpy as np
import trimesh

from grasp3d.arrays import ArrayLike, Floats, Ints
from grasp3d.errors import SettingError
from grasp3d.hand.hand import Hand
from grasp3d.hand.pose_checks import checked_poses
from grasp3d.hand.table import Table
from grasp3d.hand.triangles import Triangles, triangles_of
from grasp3d.mesh import ObjectMesh

ARC_STEP = math.radians(3.0)
"""Largest angle between neighbouring points of an arc [rad]."""

TABLE_SIZE, TABLE_DEPTH, TABLE_GAP = 1.3, 0.01, 5e-4
"""Radius of a table beside that of the object on it; its thickness, and the gap that keeps faces of
the object from lying in it, as fractions of the object's size."""

TABLE_SIDES = 72

ARC_COLOR = (0x00, 0x72, 0xB2)
TABLE_COLOR = (0xC9, 0xC4, 0xBA)


def hand_triangles(
    hand: Hand,
    opening: float,
    *,
    posture: ArrayLike = (),
    pose: ArrayLike | None = None,
) -> Triangles:
    """The shape of a hand at a pose.

    Args:
        hand: The hand.
        opening: Its opening, as in `Reach.opening` [m].
        posture: Values of its further joints, of a hand with joints.
        pose: Matrix that takes coordinates of the hand's frame to the mesh's, shape (4, 4); None:
            they are the same.

    Raises:
        SettingError: The opening is no length, or the pose no matrix.

    Example:
        >>> from grasp3d.hand.parallel_gripper import preset
        >>> from grasp3d.hand.shapes import hand_triangles
        >>> shape = hand_triangles(preset("franka"), 0.04)
        >>> shape.vertices.max(axis=0).round(4).tolist()
        [0.104, 0.0316, 0.0088]
    """
    shape = hand.shape(opening, posture)
    vertices = moved(shape.vertices, pose)
    return triangles_of(vertices, shape.faces, shape.parts, shape.links)


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
        radius: Outer radius of the fan.
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
    return triangles_of(vertices, triangles)


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


def moved(points: Floats, pose: ArrayLike | None) -> Floats:
    """Points (n, 3) moved by a rigid transformation (4, 4); None: not moved.

    Raises:
        ContactError: It is none.
    """
    if pose is None:
        return points
    (matrix,) = checked_poses(pose)
    return np.asarray(points @ matrix[:3, :3].T + matrix[:3, 3])
