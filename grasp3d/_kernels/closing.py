"""Jaws of a parallel gripper that close on a surface which does not move.

Positions are in the mesh's normalised frame (centred, size 1); normals point into the object.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling import kernel
from grasp3d._kernels.pad_contact import (
    Faces,
    Patch,
    add_mean,
    add_patch,
    clear,
    first_touch,
    make_scratch,
)

NONE, TOUCHES, INSIDE = 0, 1, 2
"""What becomes of a jaw: it meets no surface, it touches it, or it starts in the object."""

STACK = 128
"""Nodes that wait to be visited: more than twice the depth of any tree."""


class ClosedOn(NamedTuple):
    """Results, a row for each pose and a column for each jaw."""

    outcome: npt.NDArray[np.int64]
    """NONE, TOUCHES or INSIDE (k, 2)."""
    position: npt.NDArray[np.float64]
    """Along x of the gripper, of each pad or foremost point of a ball at its first touch (k, 2)."""
    points: npt.NDArray[np.float64]
    """Centroids of the patches (k, 2, 3)."""
    normals: npt.NDArray[np.float64]
    """Mean inward unit normals (k, 2, 3)."""
    area: npt.NDArray[np.float64]
    """Of the patches (k, 2)."""
    extents: npt.NDArray[np.float64]
    """Sizes of the patches along y and z of the gripper (k, 2, 2)."""


@kernel
def close_on(surface, tree, poses, opening, jaw, first_pose, last_pose, found):
    """Close the jaws on a surface from each pose.

    Args:
        surface: `Surface`.
        tree: Its `FaceTree`.
        poses: Rotation and translation from the gripper's frame (k, 3, 4).
        opening: Distance of the jaws at the start (k,).
        jaw: `Jaw`.
        first_pose: First pose to compute.
        last_pose: The one after the last.
        found: Written, `ClosedOn`.
    """
    size = surface.faces.shape[0]
    faces = Faces(np.empty(size, np.int64), np.empty((size, 3, 3)), np.empty((size, 3)))
    patch = Patch(np.empty(4), np.empty(3), np.empty(4))
    scratch = make_scratch()
    stack = np.empty((STACK, 2), np.int64)
    for k in range(first_pose, last_pose):
        count = gather(surface, tree, poses[k], jaw, stack, faces)
        start = -0.5 * opening[k]
        for finger in range(2):
            side = 1.0 - 2.0 * finger
            face, position = first_touch(faces, count, side, jaw, start, scratch)
            behind = start - (jaw.radius if jaw.radius > 0.0 else jaw.compliance)
            if face == -2 or inside(faces, count, side * behind):
                found.outcome[k, finger] = INSIDE
                continue
            if face == -1:
                found.outcome[k, finger] = NONE
                continue
            found.outcome[k, finger], found.position[k, finger] = TOUCHES, side * position
            clear(patch)
            add_patch(faces, count, side, jaw, start, position, surface, scratch, patch)
            touched = patch.moments[0]
            if touched == 0.0:  # a part too small to have an area
                add_mean(scratch.row, 1.0, faces.numbers[face], surface, patch)
            _write(patch, touched, side, poses[k], k, finger, found)


@kernel
def _write(patch, touched, side, pose, k, finger, found):
    """Write the mean of a patch as a contact."""
    moments, length = patch.moments, 0.0
    for i in range(3):
        length += patch.normal[i] ** 2
    for i in range(3):
        point = pose[i, 3]
        for j in range(3):
            middle = moments[1 + j] / moments[0]
            point += pose[i, j] * (side * middle if j == 0 else middle)
        found.points[k, finger, i] = point
        found.normals[k, finger, i] = patch.normal[i] / math.sqrt(length)
    found.area[k, finger] = touched
    for i in range(2):
        extent = patch.bounds[2 + i] - patch.bounds[i] if touched > 0.0 else 0.0
        found.extents[k, finger, i] = extent


@kernel
def gather(surface, tree, pose, jaw, stack, faces):
    """Write the faces within the height and width of the jaws, at any x.

    Args:
        surface: `Surface`.
        tree: Its `FaceTree`.
        pose: Rotation and translation from the gripper's frame (3, 4).
        jaw: `Jaw`.
        stack: Memory.
        faces: Written.

    Returns:
        Number of faces.
    """
    size, count, waiting = surface.faces.shape[0], 0, 1
    stack[0, 0], stack[0, 1] = 0, 0
    while waiting:
        waiting -= 1
        level, j = stack[waiting, 0], stack[waiting, 1]
        if not _near(tree.bounds[(1 << level) - 1 + j], pose, jaw):
            continue
        if level < tree.depth:
            for child in range(2):
                stack[waiting, 0], stack[waiting, 1] = level + 1, 2 * j + child
                waiting += 1
            continue
        for i in range(size * j >> level, size * (j + 1) >> level):
            if _write_face(surface, tree.order[i], pose, jaw, count, faces):
                count += 1
    return count


@kernel
def _near(bounds, pose, jaw):
    """Whether a ball reaches into the height and width of the jaws."""
    y, z = 0.0, 0.0
    for i in range(3):
        offset = bounds[i] - pose[i, 3]
        y += pose[i, 1] * offset
        z += pose[i, 2] * offset
    return abs(y) <= jaw.half_width + bounds[3] and abs(z) <= jaw.half_height + bounds[3]


@kernel
def _write_face(surface, face, pose, jaw, row, faces):
    """Write a face in the gripper's frame; returns whether it is within the jaws' bounds."""
    corners, normal = faces.corners[row], faces.normals[row]
    for c in range(3):
        vertex = surface.faces[face, c]
        for k in range(3):
            corners[c, k] = 0.0
            for i in range(3):
                corners[c, k] += pose[i, k] * (surface.points[vertex, i] - pose[i, 3])
    for k in range(1, 3):
        half = jaw.half_width if k == 1 else jaw.half_height
        low = min(corners[0, k], corners[1, k], corners[2, k])
        high = max(corners[0, k], corners[1, k], corners[2, k])
        if low > half or high < -half:
            return False
    a, b, c = corners[0], corners[1], corners[2]
    normal[0] = (b[1] - a[1]) * (c[2] - a[2]) - (b[2] - a[2]) * (c[1] - a[1])
    normal[1] = (b[2] - a[2]) * (c[0] - a[0]) - (b[0] - a[0]) * (c[2] - a[2])
    normal[2] = (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0])
    length = math.sqrt(normal[0] ** 2 + normal[1] ** 2 + normal[2] ** 2)
    for k in range(3):
        normal[k] /= length
    faces.numbers[row] = face
    return True


@kernel
def inside(faces, count, start):
    """Whether the point (start, 0, 0) is in the object.

    Rays along x and against it must both leave the object more often than they enter it, so that
    nothing is inside an open surface that only one of them meets.

    Args:
        faces: `Faces` that contain all those on the axis.
        count: Number of them.
        start: Position on the axis.
    """
    return _leaving(faces, count, 1.0, start) > 0 and _leaving(faces, count, -1.0, -start) > 0


@kernel
def _leaving(faces, count, side, start):
    """How many more faces a ray from `start` leaves the object by than it enters.

    Each edge counts for one of its faces only, so that a ray through an edge or a vertex crosses
    the surface once.
    """
    total = 0
    for i in range(count):
        corners, meets = faces.corners[i], False
        for c in range(3):
            meets ^= _crosses(corners[c], corners[(c + 1) % 3])
        if not meets:
            continue
        normal, x = faces.normals[i], 0.0
        for k in range(3):
            x += normal[k] * corners[0, k]
        if normal[0] != 0.0 and side * x / normal[0] > start:
            total += 1 if side * normal[0] > 0.0 else -1
    return total


@kernel
def _crosses(a, b):
    """Whether an edge crosses the half-line y = 0, z > 0, seen along x."""
    if (a[1] > 0.0) == (b[1] > 0.0):
        return False
    if a[1] > 0.0:  # both faces compute with the same order of the edge's ends
        a, b = b, a
    return a[2] - a[1] * (b[2] - a[2]) / (b[1] - a[1]) > 0.0
