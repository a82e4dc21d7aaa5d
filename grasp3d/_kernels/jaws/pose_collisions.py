"""Whether grippers at given poses collide with a surface or with the table."""

import math

from grasp3d._kernels.compiling.decorators import kernel, merged, part, scratch_kernel
from grasp3d._kernels.jaws.blocked_angles import NONE, block_angles, turn_sizes
from grasp3d._kernels.jaws.gripper_parts import RADIUS, in_table, write_parts
from grasp3d._kernels.jaws.gripper_shape import (
    BOTTOM,
    HIGH,
    LOW,
    PALM,
    TOP,
)
from grasp3d._kernels.jaws.reaching import tips_open

INSIDE = 0.5
"""Winding number from which a point is inside the object."""


@part
def winding_number(px, py, pz, triangles):
    """Winding number of a surface about a point: 1 inside a solid, 0 outside.

    The sum of the faces' signed solid angles (Van Oosterom & Strackee 1983) over 4 pi.

    Args:
        px: The point.
        py: Its second coordinate.
        pz: Its third one.
        triangles: Corners of the faces, counter-clockwise from outside (F, 9).
    """
    total = 0.0
    for i in range(triangles.shape[0]):
        t = triangles[i]
        ax, ay, az = t[0] - px, t[1] - py, t[2] - pz
        bx, by, bz = t[3] - px, t[4] - py, t[5] - pz
        cx, cy, cz = t[6] - px, t[7] - py, t[8] - pz
        a = math.sqrt(ax * ax + ay * ay + az * az)
        b = math.sqrt(bx * bx + by * by + bz * bz)
        c = math.sqrt(cx * cx + cy * cy + cz * cz)
        volume = ax * (by * cz - bz * cy) + ay * (bz * cx - bx * cz) + az * (bx * cy - by * cx)
        ab = ax * bx + ay * by + az * bz
        bc = bx * cx + by * cy + bz * cz
        ca = cx * ax + cy * ay + cz * az
        total += math.atan2(volume, a * b * c + ab * c + bc * a + ca * b)
    return total / (2.0 * math.pi)


@scratch_kernel
def _inside(x, z, frame, triangles):
    """Whether a point of the gripper's plane y = 0 is inside the object."""
    winding = winding_number(
        frame[0, 0] + x * frame[1, 0] + z * frame[3, 0],
        frame[0, 1] + x * frame[1, 1] + z * frame[3, 1],
        frame[0, 2] + x * frame[1, 2] + z * frame[3, 2],
        triangles,
    )
    return winding > INSIDE


@merged
def _tips_inside(axis, frame, triangles):
    """Whether the centre of a round tip is inside the object."""
    return _inside(-axis, 0.0, frame, triangles) or _inside(axis, 0.0, frame, triangles)


@part
def _boxes_inside(frame, parts, triangles):
    """Whether a box is inside the object; as none meets a face, its centre decides."""
    for i in range(PALM + 1):
        x, z = 0.5 * (parts[i, LOW] + parts[i, HIGH]), 0.5 * (parts[i, BOTTOM] + parts[i, TOP])
        if _inside(x, z, frame, triangles):
            return True
    return False


@part
def _pose_collides(pose, opening, sign, swept, shape, limits, tree, workspace):
    """Whether a gripper at a pose collides; see `collide_poses`."""
    frame, parts = workspace.frame, workspace.parts
    for i in range(3):
        frame[0, i] = pose[i, 3]
        for k in range(3):
            frame[k + 1, i] = pose[i, k]
    top = 0.5 * shape.pad_height
    write_parts(opening, sign if swept else 0, top, math.inf if swept else 0.0, shape, parts)
    way = 0.0
    if swept:
        way = top + shape.tip_radius + RADIUS
        for i in range(3):
            way += frame[0, i] * frame[3, i]
    if limits.table_offset > -math.inf:
        nx, ny, nz = 0.0, 0.0, 0.0
        for i in range(3):
            nx += limits.table_normal[i] * frame[1, i]
            ny += limits.table_normal[i] * frame[2, i]
            nz += limits.table_normal[i] * frame[3, i]
        if in_table(frame[0], nx, ny, nz, top, max(way, 0.0), shape, limits, parts):
            return True
    turn_sizes(workspace)
    blocked, _ = block_angles(NONE, NONE, 0.0, tree, workspace)
    if blocked != NONE:
        return True
    axis = 0.5 * opening + shape.tip_radius
    if shape.tip_radius > 0.0:
        if not tips_open(axis, sign if swept else 0, shape, tree, workspace):
            return True
        if not swept and _tips_inside(axis, frame, tree.triangles):
            return True
    return not swept and _boxes_inside(frame, parts, tree.triangles)


@kernel
def collide_poses(poses, openings, signs, swept, shape, limits, tree, workspace, collides):
    """Test grippers at given poses, one after the other.

    Args:
        poses: From the gripper's frame to the surface's (b, 4, 4).
        openings: Distance between the inner faces of the fingers or of round tips (b,).
        signs: +1 external grasp, -1 internal, which says where the clearance is (b,).
        swept: Whether the approach and the opening are tested too, else the final pose only.
        shape: `GripperShape`.
        limits: `ApproachLimits`; only its table counts.
        tree: `BoxTree`.
        workspace: `ReachWorkspace` of one angle.
        collides: Written (b,).
    """
    for i in range(poses.shape[0]):
        collides[i] = _pose_collides(
            poses[i], openings[i], signs[i], swept, shape, limits, tree, workspace
        )
