"""A free object that settles between the jaws of a gripper.

The jaws squeeze the object with a force N. It moves as long as that releases more energy than
friction takes: a motion by which the opening w changes by -dw releases N dw, and an object that
slips by s1 on one jaw and s2 on the other takes mu N (s1 + s2). It is at rest where no small motion
makes the opening, with mu times the slips added, smaller: with mu = 0 where the opening is locally
smallest, in general where friction can hold the squeezed object.

Everything is in the frame of the gripper, in object sizes. The motions are those of
`object_motions`. Of those that pay, the one that friction would be the last to prevent happens
first. The opening is the maximum of smooth functions of them, one
for each feature that a jaw may touch. It is minimised with planes that agree with it where it was
computed (Kelley 1960), within a square that shrinks where they promise too much.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling.decorators import kernel
from grasp3d._kernels.jaws.jaw_faces import gather, keep_near, move, put_first
from grasp3d._kernels.jaws.jaw_interior import starts_inside
from grasp3d._kernels.jaws.jaw_touch import Touching, make_touching, touch
from grasp3d._kernels.jaws.jaws import Faces, make_faces, start_before
from grasp3d._kernels.jaws.lowest_point import lowest_point
from grasp3d._kernels.jaws.object_motions import (
    MOTIONS,
    SHIFT,
    apply_motion,
    jaw_size,
    set_pivot,
    slip_of,
    write_motion,
    write_plane,
)

RESTS, LEAVES, CLEAR = 0, 1, 2
"""What becomes of the object: it comes to rest, it slides out of the jaws, or it does not move, as
they start in it or do not both touch it."""

MOVED, PROVEN, LOST, SHORTER = 0, 1, 2, 3
"""What becomes of one minimisation: the object has moved; no such motion pays; beyond the motion
that promises most the object is out of the jaws; the planes promise too much within this square."""

LARGEST_TURN, SMALLEST_TURN = math.radians(3.0), math.radians(0.05)
"""Half-width of the square of motions at first, and at rest [rad]; shifts are in jaw sizes."""

SHRINKING = 0.3
"""Factor of the half-width where no motion pays."""

GATHERED = 1.2
"""Largest motions for which faces around the jaws are looked for at once."""

PLANES = 6
"""Most planes of one minimisation."""

TOLERANCE = 3e-6
"""Decrease of the opening, in object sizes, that counts as none."""

TIED = 1e-9
"""Relative difference of rates that rounding makes: of a symmetric object's motions the same one
happens first whatever it is."""

MOST_MOVES = 100
"""Motions after which the object is taken to slide out: it moves on by ever smaller ones where the
jaws close on an edge or a corner of it."""


class Settling(NamedTuple):
    """Memory for one pose."""

    near: Faces
    """Faces around the jaws, at the pose at which they were last looked for."""
    faces: Faces
    """Those that matter next, at the pose reached so far."""
    touches: npt.NDArray[np.float64]
    """Of each jaw: the point it touches, d position / dy and / dz as the object moves, its
    position, and the face it touches (2, 7)."""
    tried: npt.NDArray[np.float64]
    """The same after a motion that is tried (2, 7)."""
    best: npt.NDArray[np.float64]
    """The same after the best motion of one kind (2, 7)."""
    chosen: npt.NDArray[np.float64]
    """The same after the best motion of all kinds (2, 7)."""
    motion: npt.NDArray[np.float64]
    """Rotation and translation of the object (3, 4)."""
    best_motion: npt.NDArray[np.float64]
    """The best one of a kind (3, 4)."""
    chosen_motion: npt.NDArray[np.float64]
    """The best one of all kinds (3, 4)."""
    pivot: npt.NDArray[np.float64]
    """Point about which it turns (3,)."""
    total: npt.NDArray[np.float64]
    """Motion of the object since the faces around the jaws were looked for (3, 4)."""
    planes: npt.NDArray[np.float64]
    """As in `lowest_point` (PLANES, 3)."""
    promises: npt.NDArray[np.float64]
    """Rate of each motion at its start, as in `_minimise` (MOTIONS,)."""
    proven: npt.NDArray[np.bool_]
    """Whether each motion does not pay (MOTIONS,)."""
    touching: Touching


@kernel
def make_settling(size):
    """Allocate the memory for a surface of `size` faces."""
    return Settling(
        make_faces(size),
        make_faces(size + 1),
        np.empty((2, 7)),
        np.empty((2, 7)),
        np.empty((2, 7)),
        np.empty((2, 7)),
        np.empty((3, 4)),
        np.empty((3, 4)),
        np.empty((3, 4)),
        np.empty(3),
        np.empty((3, 4)),
        np.empty((PLANES, 3)),
        np.empty(MOTIONS),
        np.empty(MOTIONS, np.bool_),
        make_touching(),
    )


@kernel
def settle(surface, tree, pose, opening, friction, jaw, stack, memory):
    """Move an object between the jaws until it is at rest.

    Args:
        surface: `Surface`.
        tree: Its `FaceTree`.
        pose: Rotation and translation from the gripper's frame to the object's (3, 4); replaced by
            the one at rest, with the jaws symmetric about the TCP.
        opening: Distance of the jaws at the start.
        friction: Coulomb coefficient between object and jaws.
        jaw: `Jaw`.
        stack: Memory, as in `gather`.
        memory: `Settling`.

    Returns:
        (RESTS, LEAVES or CLEAR, opening at which both jaws touch).
    """
    total, proven = memory.total, memory.proven
    write_motion(SHIFT, 0.0, 0.0, 0.0, memory.pivot, total)
    count = gather(surface, tree, pose, jaw, 0.0, stack, memory.near)
    found, width = touch(
        memory.near, count, total, jaw, -0.5 * opening, memory.touching, memory.touches
    )
    for finger in range(2):
        if starts_inside(memory.near, count, 1.0 - 2.0 * finger, -0.5 * opening, jaw):
            found = -2
    if found < 0:
        return CLEAR, width
    size, reach, moves, lost = jaw_size(jaw), LARGEST_TURN, 0, False
    proven[:] = False
    left, near = -1.0, 0
    while reach > SMALLEST_TURN and moves < MOST_MOVES:
        _centre(pose, total, memory.touches)
        start = start_before(opening, width, jaw)
        margin = _farthest(math.sqrt(2.0) * reach, size, start)
        if left < margin:  # faces that have not been written may have come near
            left = GATHERED * _farthest(math.sqrt(2.0) * LARGEST_TURN, size, start)
            near = gather(surface, tree, pose, jaw, left, stack, memory.near)
            near = keep_near(memory.near, near, memory.touches, start, left, jaw)
            write_motion(SHIFT, 0.0, 0.0, size, memory.pivot, total)
        count = move(memory.near, near, total, jaw, margin, memory.faces)
        count = keep_near(memory.faces, count, memory.touches, start, margin, jaw)
        put_first(memory.faces, count, memory.touches[:, 6])
        _write_promises(width, size, memory)
        fastest, reached, length, lost, shorter = 0.0, width, 0.0, False, False
        for _ in range(MOTIONS):
            kind = _first_of_largest(memory.promises)
            # No motion pays more than it promises at its start.
            if memory.promises[kind] <= max(friction, fastest):
                break
            memory.promises[kind] = 0.0
            if proven[kind]:
                continue
            outcome, lowest, rate, moved = _minimise(
                kind, width, opening, friction, reach, count, jaw, memory
            )
            lost |= outcome == LOST
            shorter |= outcome == SHORTER
            proven[kind] = outcome == PROVEN
            if outcome == MOVED and rate > (1.0 + TIED) * fastest:
                fastest, reached, length = rate, lowest, moved
                memory.chosen[:] = memory.best
                memory.chosen_motion[:] = memory.best_motion
        if fastest > 0.0:
            # The jaws follow the object, and the gripper is centred.
            left -= 2.0 * _farthest(length, size, start) + width - reached
            width, moves = reached, moves + 1
            apply_motion(memory.chosen_motion, pose, total)
            memory.touches[:] = memory.chosen
            proven[:] = False
        elif lost or shorter:
            reach *= SHRINKING
        else:
            break
    _centre(pose, total, memory.touches)
    leaves = moves == MOST_MOVES or (lost and reach <= SMALLEST_TURN)
    return (LEAVES if leaves else RESTS), width


@kernel
def _centre(pose, total, touches):
    """Shift the gripper along x so that its jaws are symmetric about the TCP."""
    middle = 0.5 * (touches[0, 5] + touches[1, 5])
    total[0, 3] -= middle
    for i in range(3):
        pose[i, 3] += middle * pose[i, 0]
    for finger in range(2):
        touches[finger, 0] -= middle
        touches[finger, 5] -= middle


@kernel
def _farthest(length, size, start):
    """Largest distance by which a motion moves a point between the jaws.

    That is the angle times its distance from the pivot, which is between the jaws, too.
    """
    return length * math.hypot(2.0 * start, 2.0 * size)


@kernel
def _write_promises(width, size, memory):
    """Write the rate of each motion at its start."""
    plane = memory.planes[0]
    for kind in range(MOTIONS):
        set_pivot(kind, memory.touches, memory.pivot)
        write_plane(kind, width, 0.0, 0.0, size, memory.touches, memory.pivot, plane)
        slip = slip_of(kind, width, size)
        memory.promises[kind] = math.hypot(plane[1], plane[2]) / max(slip, TOLERANCE)


@kernel
def _first_of_largest(promises):
    """Index of the first of the largest numbers."""
    least = (1.0 - TIED) * promises.max()
    for kind in range(MOTIONS):
        if promises[kind] >= least:
            return kind
    return 0


@kernel
def _minimise(kind, width, opening, friction, reach, count, jaw, memory):
    """Try motions of one kind, and write the best one.

    Returns (outcome, opening, rate, length of the motion). The rate is that of closing per slip:
    the friction that would prevent the motion.
    """
    planes, size = memory.planes, jaw_size(jaw)
    slip = slip_of(kind, width, size)
    set_pivot(kind, memory.touches, memory.pivot)
    write_plane(kind, width, 0.0, 0.0, size, memory.touches, memory.pivot, planes[0])
    start = start_before(opening, width, jaw)
    lowest, found, number, rate, length = width, width, 1, 0.0, 0.0
    while number < PLANES:
        promise, u, v = lowest_point(planes, number, reach, friction * slip)
        if promise >= lowest - TOLERANCE:
            return (MOVED if found < width else PROVEN), found, rate, length
        write_motion(kind, u, v, size, memory.pivot, memory.motion)
        code, tried = touch(
            memory.faces, count, memory.motion, jaw, start, memory.touching, memory.tried
        )
        if code < 0:
            outcome = LOST if code == -1 else SHORTER
            return (MOVED if found < width else outcome), found, rate, length
        write_plane(kind, tried, u, v, size, memory.tried, memory.pivot, planes[number])
        number += 1
        if tried + friction * slip * math.hypot(u, v) < lowest - TOLERANCE and tried < width:
            length = math.hypot(u, v)
            lowest, found = tried + friction * slip * length, tried
            rate = (width - tried) / max(slip * length, TOLERANCE)
            memory.best[:] = memory.tried
            memory.best_motion[:] = memory.motion
    return (MOVED if found < width else SHORTER), found, rate, length
