"""What both jaws of a gripper touch first of an object that has moved a little.

Most faces are far from what the jaws touch, which the x of their corners shows: only the others are
moved as a whole.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling.decorators import kernel
from grasp3d._kernels.jaws.first_touch import slopes, touch_face
from grasp3d._kernels.jaws.jaw_faces import is_between, move_face
from grasp3d._kernels.jaws.jaws import EDGE_ON, Scratch, make_scratch


class Touching(NamedTuple):
    """Memory for two jaws."""

    corners: npt.NDArray[np.float64]
    """Corners of a face that has moved (3, 3)."""
    normal: npt.NDArray[np.float64]
    """Its normal (3,)."""
    rows: npt.NDArray[np.float64]
    """What each jaw touches, as rows of a polygon (2, 6)."""
    positions: npt.NDArray[np.float64]
    """Position of each jaw (2,)."""
    features: npt.NDArray[np.int64]
    """Of each jaw: index of the face it touches, -1 none, and of its own face (2, 2)."""
    scratch: Scratch


@kernel
def make_touching():
    """Allocate the memory for two jaws."""
    return Touching(
        np.empty((3, 3)),
        np.empty(3),
        np.empty((2, 6)),
        np.empty(2),
        np.empty((2, 2), np.int64),
        make_scratch(),
    )


@kernel
def touch(faces, count, motion, jaw, start, memory, touches):
    """Close both jaws on an object that has moved.

    Args:
        faces: `Faces` before the motion.
        count: Number of them.
        motion: Rotation and translation in the gripper's frame (3, 4).
        jaw: `Jaw`.
        start: Position from which both jaws move.
        memory: `Touching`.
        touches: Written, as in `Settling` (2, 7).

    Returns:
        (0, opening), (-1, inf): a jaw touches nothing, (-2, inf): it starts in the object.
    """
    corners, normal, positions = memory.corners, memory.normal, memory.positions
    positions[:], memory.features[:] = math.inf, -1
    for f in range(count):
        move_face(faces.corners[f], faces.normals[f], motion, 0, 1, corners, normal)
        complete = False
        for finger in range(2):
            side = 1.0 - 2.0 * finger
            low = min(side * corners[0, 0], side * corners[1, 0], side * corners[2, 0])
            ahead = low >= start and side * normal[0] >= -EDGE_ON
            if low >= positions[finger] or ahead:
                continue
            if not complete:
                move_face(faces.corners[f], faces.normals[f], motion, 1, 3, corners, normal)
                complete = True
                if not is_between(corners, jaw, 0.0):
                    break
            first, row = positions[finger], memory.rows[finger]
            meets, position, part = touch_face(
                corners, normal, side, jaw, start, first, memory.scratch, row
            )
            if meets:
                return -2, math.inf
            if position < first:
                positions[finger] = position
                memory.features[finger, 0], memory.features[finger, 1] = f, part
    return _write_touches(faces, motion, jaw, memory, touches)


@kernel
def _write_touches(faces, motion, jaw, memory, touches):
    """Write what was found; returns as `touch`."""
    corners, normal, width = memory.corners, memory.normal, 0.0
    for finger in range(2):
        f, part = memory.features[finger]
        if f < 0:
            return -1, math.inf
        side, position = 1.0 - 2.0 * finger, memory.positions[finger]
        row, at = touches[finger], memory.rows[finger]
        move_face(faces.corners[f], faces.normals[f], motion, 0, 3, corners, normal)
        row[0], row[1], row[2], row[5] = side * at[0], at[1], at[2], side * position
        row[3], row[4] = slopes(corners, normal, part, side, jaw, position, at)
        row[6] = faces.numbers[f]
        width -= position
    return 0, width
