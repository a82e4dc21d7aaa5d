"""Poses of a hand's links, and how points of links move with its joints.

Also apply rigid motions (3, 4) from one frame to another to points and vectors, and back.
"""

import math
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.compiling import (
    FixedFloats1,
    FixedFloats2,
    FixedFloats3,
    FixedInts1,
    kernel,
    merged,
    part,
)
from grasp3d._kernels.surface.vectors import dot


@merged
def turned(matrix, v):
    """Transform a vector from the first frame to the second."""
    return dot(matrix[0], v), dot(matrix[1], v), dot(matrix[2], v)


@merged
def moved(matrix, p):
    """Transform a point from the first frame to the second."""
    x, y, z = dot(matrix[0], p), dot(matrix[1], p), dot(matrix[2], p)
    return x + matrix[0, 3], y + matrix[1, 3], z + matrix[2, 3]


@merged
def turned_back(matrix, v):
    """Transform a vector from the second frame to the first."""
    x = matrix[0, 0] * v[0] + matrix[1, 0] * v[1] + matrix[2, 0] * v[2]
    y = matrix[0, 1] * v[0] + matrix[1, 1] * v[1] + matrix[2, 1] * v[2]
    z = matrix[0, 2] * v[0] + matrix[1, 2] * v[1] + matrix[2, 2] * v[2]
    return x, y, z


@merged
def moved_back(matrix, p):
    """Transform a point from the second frame to the first."""
    return turned_back(matrix, (p[0] - matrix[0, 3], p[1] - matrix[1, 3], p[2] - matrix[2, 3]))


@part
def compose(link, pose, product):
    """Write the product of two rigid motions (3, 4)."""
    for i in range(3):
        for j in range(4):
            product[i, j] = link[i, 3] if j == 3 else 0.0
            for k in range(3):
                product[i, j] += link[i, k] * pose[k, j]


FIXED, SLIDES, TURNS = range(3)
"""Kinds of joints."""


class Chain(NamedTuple):
    """Links of a hand, parents first, each with the joint that moves it; the first has no joint."""

    parents: FixedInts1
    """Link that carries the joint, -1 for none (L,)."""
    kinds: FixedInts1
    """FIXED, SLIDES or TURNS (L,)."""
    origins: FixedFloats3
    """Pose in the parent's frame at the joint's value 0 (L, 4, 4)."""
    axes: FixedFloats2
    """Unit vectors in the moved link's frame (L, 3)."""
    positions: FixedFloats2
    """A point of each axis in the moved link's frame (L, 3)."""
    columns: FixedInts1
    """Index, in a posture, of the joint that sets the value, -1 for none (L,)."""
    factors: FixedFloats1
    """Factor of that joint's value (L,)."""
    offsets: FixedFloats1
    """Value when that joint's value is 0 (L,)."""


@part
def _write_motion(kind, axis, position, value, motion):
    """Write the motion (3, 4) of a joint in the frame of its link."""
    x, y, z = axis
    c, s = (math.cos(value), math.sin(value)) if kind == TURNS else (1.0, 0.0)
    v = 1.0 - c
    motion[0, 0], motion[0, 1], motion[0, 2] = c + x * x * v, x * y * v - z * s, x * z * v + y * s
    motion[1, 0], motion[1, 1], motion[1, 2] = y * x * v + z * s, c + y * y * v, y * z * v - x * s
    motion[2, 0], motion[2, 1], motion[2, 2] = z * x * v - y * s, z * y * v + x * s, c + z * z * v
    for i in range(3):
        motion[i, 3] = value * axis[i] if kind == SLIDES else position[i]
        if kind == TURNS:
            for j in range(3):
                motion[i, 3] -= motion[i, j] * position[j]


@part
def _write_product(one, two, product):
    """Write the product (4, 4) of two poses, reading only three rows of each."""
    for i in range(3):
        for j in range(4):
            total = one[i, 3] if j == 3 else 0.0
            for k in range(3):
                total += one[i, k] * two[k, j]
            product[i, j] = total


@part
def place_links(base, posture, chain, motion, moved, poses):
    """Write the poses (L, 4, 4) of all links; only three rows of each are read and written.

    Args:
        base: Pose of the first link (4, 4).
        posture: Values of the joints (p,).
        chain: `Chain`.
        motion: Scratch (3, 4).
        moved: Scratch (3, 4).
        poses: Written.
    """
    for link in range(chain.parents.shape[0]):
        pose, parent = poses[link], chain.parents[link]
        if parent < 0:
            for i in range(3):
                for j in range(4):
                    pose[i, j] = base[i, j]
            continue
        value = chain.offsets[link]
        if chain.columns[link] >= 0:
            value += chain.factors[link] * posture[chain.columns[link]]
        if chain.kinds[link] == FIXED:
            _write_product(poses[parent], chain.origins[link], pose)
            continue
        axis, position = chain.axes[link], chain.positions[link]
        _write_motion(chain.kinds[link], axis, position, value, motion)
        _write_product(chain.origins[link], motion, moved)
        _write_product(poses[parent], moved, pose)


@kernel("Floats2, Chain")
def link_poses(postures, chain):
    """Poses of all links in the frame of the first (k, L, 4, 4), at postures (k, p)."""
    count, links = postures.shape[0], chain.parents.shape[0]
    poses = np.zeros((count, links, 4, 4))
    poses[:, :, 3, 3] = 1.0
    base, motion, moved = np.eye(4), np.empty((3, 4)), np.empty((3, 4))
    for row in range(count):
        place_links(base, postures[row], chain, motion, moved, poses[row])
    return poses


@kernel("Floats4, Ints1, Ints1, Floats2, int, Chain")
def jacobians(poses, rows, links, points, width, chain):
    """Velocities of points on links per unit joint velocity, in the frame of the first link.

    Args:
        poses: As `link_poses` returns them (k, L, 4, 4).
        rows: Posture of each point (c,).
        links: Link of each point (c,).
        points: Positions in the frame of the first link (c, 3).
        width: Number p of values in a posture.
        chain: `Chain`.

    Returns:
        Jacobians (c, 3, p).
    """
    found = np.zeros((rows.shape[0], 3, width))
    axis, arm = np.empty(3), np.empty(3)
    for contact in range(rows.shape[0]):
        link = links[contact]
        while chain.parents[link] >= 0:
            column, factor = chain.columns[link], chain.factors[link]
            pose = poses[rows[contact], link]
            for i in range(3):
                axis[i], arm[i] = 0.0, points[contact, i] - pose[i, 3]
                for j in range(3):
                    axis[i] += pose[i, j] * chain.axes[link, j]
                    arm[i] -= pose[i, j] * chain.positions[link, j]
            if column >= 0:
                for i in range(3):
                    j, k = (i + 1) % 3, (i + 2) % 3
                    turning = axis[j] * arm[k] - axis[k] * arm[j]
                    speed = axis[i] if chain.kinds[link] == SLIDES else turning
                    found[contact, i, column] += factor * speed
            link = chain.parents[link]
    return found
