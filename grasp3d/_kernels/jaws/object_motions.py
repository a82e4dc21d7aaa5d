"""Motions of an object between the jaws of a gripper, in the gripper's frame and object sizes.

Those that change what the jaws touch are turns about y and z, about a point midway between the
contacts or about either contact, which then does not slip, and shifts along y and z: two variables
(u, v) at a time.
"""

import math

from grasp3d._kernels.compiling.decorators import kernel

TURN, ROLL_ON_1, ROLL_ON_2, SHIFT, MOTIONS = 0, 1, 2, 3, 4
"""Motions of the object: about the point midway between the contacts, about the contact of either
jaw, and along y and z; their number."""


@kernel
def jaw_size(jaw):
    """Half the diagonal of a jaw."""
    return 0.5 * math.hypot(jaw.bounds[2] - jaw.bounds[0], jaw.bounds[3] - jaw.bounds[1])


@kernel
def slip_of(kind, width, size):
    """How far the object slips on both jaws per unit of a motion."""
    return 2.0 * size if kind == SHIFT else width


@kernel
def set_pivot(kind, touches, pivot):
    """Write the point that stays where it is."""
    for k in range(3):
        if kind == ROLL_ON_1:
            pivot[k] = touches[0, k]
        elif kind == ROLL_ON_2:
            pivot[k] = touches[1, k]
        else:
            pivot[k] = 0.5 * (touches[0, k] + touches[1, k])


@kernel
def write_motion(kind, u, v, size, pivot, motion):
    """Write a motion of the object: a turn by (0, u, v), or a shift by (0, u, v) jaw sizes."""
    motion[:] = 0.0
    motion[0, 0] = motion[1, 1] = motion[2, 2] = 1.0
    if kind == SHIFT:
        motion[1, 3], motion[2, 3] = u * size, v * size
        return
    angle = math.hypot(u, v)
    if angle == 0.0:
        return
    y, z, cosine, sine = u / angle, v / angle, math.cos(angle), math.sin(angle)
    motion[0, 0], motion[0, 1], motion[0, 2] = cosine, -sine * z, sine * y
    motion[1, 0], motion[2, 0] = sine * z, -sine * y
    motion[1, 1], motion[2, 2] = cosine + (1.0 - cosine) * y * y, cosine + (1.0 - cosine) * z * z
    motion[1, 2] = motion[2, 1] = (1.0 - cosine) * y * z
    for i in range(3):
        motion[i, 3] = pivot[i]
        for j in range(3):
            motion[i, 3] -= motion[i, j] * pivot[j]


@kernel
def write_plane(kind, width, u, v, size, touches, pivot, plane):
    """Write the plane that agrees with the opening at a motion (u, v)."""
    plane[1] = plane[2] = 0.0
    for finger in range(2):
        side, row = 1.0 - 2.0 * finger, touches[finger]
        by_y, by_z = row[3], row[4]
        if kind == SHIFT:
            plane[1] -= size * by_y
            plane[2] -= size * by_z
            continue
        x, y, z = row[0] - pivot[0], row[1] - pivot[1], row[2] - pivot[2]
        plane[1] -= side * z - by_z * x
        plane[2] -= by_y * x - side * y
    plane[0] = width - u * plane[1] - v * plane[2]


@kernel
def apply_motion(motion, pose, total):
    """Move the object: its motion since faces were written, and the gripper's pose on it."""
    for j in range(4):
        a, b, c = total[0, j], total[1, j], total[2, j]
        for i in range(3):
            total[i, j] = motion[i, 0] * a + motion[i, 1] * b + motion[i, 2] * c
            if j == 3:
                total[i, j] += motion[i, 3]
    for i in range(3):
        a, b, c = pose[i, 0], pose[i, 1], pose[i, 2]
        for j in range(3):
            pose[i, j] = a * motion[j, 0] + b * motion[j, 1] + c * motion[j, 2]
        for j in range(3):
            pose[i, 3] -= pose[i, j] * motion[j, 3]
