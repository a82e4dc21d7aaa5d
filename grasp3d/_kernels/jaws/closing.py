"""Parallel jaws that close on a surface, which may move.

Positions are in the mesh's normalised frame (centred, size 1); normals point into the object.
"""

import math
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.compiling import Floats2, Floats3, Floats4, Ints2, kernel, part
from grasp3d._kernels.jaws.jaws import (
    ANYWHERE,
    gather,
    make_faces,
    make_scratch,
    span_of,
    start_before,
    starts_inside,
    without_back,
)
from grasp3d._kernels.jaws.settling import CLEAR, LEAVES, make_settling, settle
from grasp3d._kernels.jaws.touching import (
    MIN_DEPTH,
    Patch,
    add_mean,
    add_patch,
    clear,
    extend,
    first_touch,
)
from grasp3d._kernels.surface.face_tree import STACK
from grasp3d._kernels.surface.vectors import copy_rows

NONE, TOUCHES, INSIDE, LEFT = 0, 1, 2, 3
"""Outcome for a jaw: it meets no surface, it touches the surface, it starts inside the object, or
the object slides out of the jaws."""


class ClosedOn(NamedTuple):
    """Results, with a row for each pose and a column for each jaw."""

    poses: Floats3
    """Rotation and translation from the gripper's frame once the jaws are closed (k, 3, 4)."""
    outcome: Ints2
    """NONE, TOUCHES, INSIDE or LEFT (k, 2)."""
    position: Floats2
    """Position along the gripper's x at first touch: of each pad or a ball's front point (k, 2)."""
    points: Floats3
    """Centroids of the patches (k, 2, 3)."""
    normals: Floats3
    """Mean inward unit normals (k, 2, 3)."""
    area: Floats2
    """Areas of the patches (k, 2)."""
    bounds: Floats3
    """Smallest y and z, largest y and z of the patches, in the gripper's frame (k, 2, 4)."""
    corners: Floats4
    """Points of the patches that are farthest in eight directions (k, 2, 8, 3)."""


@kernel("Surface, FaceTree, Floats3, Floats1, float, Jaw, int, int, ClosedOn")
def close_on(surface, tree, poses, opening, friction, jaw, first_pose, last_pose, found):
    """Close the jaws on a surface from each pose.

    Args:
        surface: `Surface`.
        tree: The surface's `FaceTree`.
        poses: Rotation and translation from the gripper's frame (k, 3, 4).
        opening: Distance of the jaws at the start (k,).
        friction: Coulomb coefficient for a free object; negative if the object is fixed.
        jaw: `Jaw`.
        first_pose: First pose to compute.
        last_pose: One past the last pose.
        found: Written, `ClosedOn`.
    """
    size = surface.faces.shape[0]
    faces = make_faces(size)
    patch = Patch(np.empty(4), np.empty(3), np.empty(8), np.empty((8, 3)))
    scratch = make_scratch()
    memory = make_settling(size if friction >= 0.0 else 0)
    nodes, front = np.empty(STACK, np.int64), without_back(jaw)
    for k in range(first_pose, last_pose):
        pose, distance = found.poses[k], opening[k]
        settled, span = False, ANYWHERE
        copy_rows(poses[k], pose)
        if friction >= 0.0:
            state, width = settle(surface, tree, pose, distance, friction, jaw, nodes, memory)
            if state == LEAVES:
                found.outcome[k] = LEFT
                continue
            settled = state != CLEAR
            if settled:
                start = start_before(distance, width, jaw)
                distance, margin = -2.0 * start, MIN_DEPTH + jaw.compliance + jaw.footprint
                span = span_of(memory.touches, start, margin + 2.0 * jaw.radius, jaw)
        used = front if settled else jaw
        count = gather(surface, tree, pose, jaw, 0.0, span, nodes, faces)
        _close(surface, count, pose, distance, settled, used, k, faces, scratch, patch, found)


@part
def _close(surface, count, pose, opening, settled, jaw, k, faces, scratch, patch, found):
    """Close the jaws on the gathered faces of a fixed surface; see `close_on`."""
    start = -0.5 * opening
    for finger in range(2):
        side = 1.0 - 2.0 * finger
        face, position = first_touch(faces, count, side, jaw, start, scratch)
        if face == -2 or (not settled and starts_inside(faces, count, side, start, jaw)):
            found.outcome[k, finger] = INSIDE
            continue
        if face == -1:
            found.outcome[k, finger] = NONE
            continue
        found.outcome[k, finger], found.position[k, finger] = TOUCHES, side * position
        clear(patch)
        limit = position + max(jaw.compliance, MIN_DEPTH)
        add_patch(faces, count, side, jaw, start, limit, surface, scratch, patch)
        touched = patch.moments[0]
        if touched == 0.0:  # the part touched is too small to have an area
            add_mean(scratch.row, 1.0, faces.numbers[face], surface, patch)
            extend(patch, scratch.row[0], scratch.row[1], scratch.row[2])
        _write(patch, touched, side, pose, k, finger, found)
        if settled and jaw.footprint > jaw.compliance:
            clear(patch)
            limit = position + jaw.footprint
            add_patch(faces, count, side, jaw, start, limit, surface, scratch, patch)
            _write_normal(patch, k, finger, found)


@part
def _write(patch, touched, side, pose, k, finger, found):
    """Write the mean of a patch as a contact."""
    moments = patch.moments
    _write_normal(patch, k, finger, found)
    x, y, z = moments[1] / moments[0], moments[2] / moments[0], moments[3] / moments[0]
    put(pose, side * x, y, z, found.points[k, finger])
    for c in range(patch.corners.shape[0]):
        x, y, z = patch.corners[c, 0], patch.corners[c, 1], patch.corners[c, 2]
        put(pose, side * x, y, z, found.corners[k, finger, c])
    found.area[k, finger] = touched
    for i in range(2):
        found.bounds[k, finger, i] = patch.corners[4 + 2 * i, 1 + i]
        found.bounds[k, finger, 2 + i] = patch.corners[2 * i, 1 + i]


@part
def put(pose, x, y, z, point):
    """Transform a point from the gripper's frame by a pose (3, 4) and write it."""
    for i in range(3):
        point[i] = pose[i, 0] * x + pose[i, 1] * y + pose[i, 2] * z + pose[i, 3]


@part
def _write_normal(patch, k, finger, found):
    """Write the mean normal of a patch."""
    length = 0.0
    for i in range(3):
        length += patch.normal[i] ** 2
    for i in range(3):
        found.normals[k, finger, i] = patch.normal[i] / math.sqrt(length)
