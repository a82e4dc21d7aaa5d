"""A free object that settles between the jaws of a gripper.

The jaws squeeze the object. It is in equilibrium if forces within the friction cones of its
contacts balance each other. By duality, that is so if every small motion opens the jaws when the
contacts do not slide along each other, but part at the friction angle from their common plane: a
slip by s on a face of slope t opens a jaw by s (tan t - tan(t - phi)) more than one without
friction, which is mu s if the face is flush with the jaw. Without friction the object is in
equilibrium where the opening is locally smallest.

Everything is in the gripper's frame, in object sizes. Motions that change what the jaws touch are
shifts along y and z, and turns about y and z: about a point midway between the contacts, or about
either contact, which then does not slip. Each kind has two variables (u, v). Of the motions that
pay, that is, close the jaws in spite of friction, the one that friction would prevent last happens
first. The opening is the maximum of smooth functions of (u, v), one for each feature that a jaw may
touch. It is minimised with planes that agree with it where it was computed (Kelley 1960), within a
square that shrinks where they promise too much.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling import kernel, part
from grasp3d._kernels.jaws.jaws import (
    ANYWHERE,
    EDGE_ON,
    Faces,
    Scratch,
    gather,
    is_between,
    keep_near,
    make_faces,
    make_scratch,
    move,
    move_face,
    put_first,
    span_of,
    start_before,
    starts_inside,
)
from grasp3d._kernels.jaws.touching import slopes, touch_face
from grasp3d._kernels.surface.vectors import copy_rows, cross, difference, dot, norm

PARALLEL = 1e-14
"""Determinant, relative to the squares of slopes, below which lines count as parallel."""

EQUALLY_LOW = 1e-13
"""Difference of heights due to rounding; among equally low points the first one counts."""


@part
def lowest_point(planes, number, reach, slope):
    """Minimise max over planes of (a + b u + c v) + slope * |(u, v)| for |u|, |v| <= reach.

    The smallest value is at a corner of the square, down a plane from the origin, on a side of the
    square or the line where two planes meet (where these cross, or where the cone balances the
    slope along them), where three planes meet, or at the origin.

    Args:
        planes: Values at the origin a, and slopes b and c (at least `number`, 3).
        number: Number of planes.
        reach: Half-width of the square, above 0.
        slope: Slope of the cone, at least 0.

    Returns:
        (smallest value, u, v).
    """
    best = _height(planes, number, slope, 0.0, 0.0), 0.0, 0.0
    for corner in (-reach, reach):
        best = _lower(planes, number, slope, corner, reach, reach, best)
        best = _lower(planes, number, slope, corner, -reach, reach, best)
    for i in range(number):
        b, c = planes[i, 1], planes[i, 2]
        most = max(abs(b), abs(c))
        if most > 0.0:
            best = _lower(planes, number, slope, -reach * b / most, -reach * c / most, reach, best)
        for edge in (-reach, reach):
            best = _lower(planes, number, slope, edge, _balanced(c, slope, reach), reach, best)
            best = _lower(planes, number, slope, _balanced(b, slope, reach), edge, reach, best)
        for j in range(i):
            best = _on_line(planes, number, slope, i, j, reach, best)
    return best


@part
def _height(planes, number, slope, u, v):
    """Value of the function that is minimised."""
    height = -math.inf
    for i in range(number):
        height = max(height, planes[i, 0] + planes[i, 1] * u + planes[i, 2] * v)
    return height + slope * math.hypot(u, v)


@part
def _lower(planes, number, slope, u, v, reach, best):
    """The lower of the best point and another one, if the other is in the square."""
    if not (abs(u) <= reach and abs(v) <= reach):
        return best
    height = _height(planes, number, slope, u, v)
    return (height, u, v) if height < best[0] - EQUALLY_LOW else best


@part
def _balanced(along, slope, distance):
    """Where the cone balances a slope along a line, measured from its point nearest to the origin.

    Return inf if nowhere.
    """
    if slope <= abs(along):
        return math.inf
    return -distance * along / math.sqrt(slope * slope - along * along)


@part
def _on_line(planes, number, slope, i, j, reach, best):
    """The best point so far, or a better one on the line where two planes meet."""
    a, b, c = difference(planes[i], planes[j])
    square = b * b + c * c
    if square == 0.0:
        return best
    for edge in (-reach, reach):
        if c != 0.0:
            best = _lower(planes, number, slope, edge, -(a + b * edge) / c, reach, best)
        if b != 0.0:
            best = _lower(planes, number, slope, -(a + c * edge) / b, edge, reach, best)
    # The point of the line nearest to the origin, and the slope of the planes along it.
    u, v, length = -a * b / square, -a * c / square, math.sqrt(square)
    along = (planes[i, 2] * b - planes[i, 1] * c) / length
    t = _balanced(along, slope, math.hypot(u, v))
    best = _lower(planes, number, slope, u - t * c / length, v + t * b / length, reach, best)
    for k in range(j):
        best = _at_corner(planes, number, slope, a, b, c, i, k, reach, best)
    return best


@part
def _at_corner(planes, number, slope, a, b, c, i, k, reach, best):
    """The best point so far, or a better one where a third plane meets the line a + b u + c v."""
    d, e, f = difference(planes[i], planes[k])
    determinant = b * f - c * e
    if abs(determinant) <= PARALLEL * (abs(b) + abs(c)) * (abs(e) + abs(f)):
        return best
    u, v = (c * d - a * f) / determinant, (a * e - b * d) / determinant
    return _lower(planes, number, slope, u, v, reach, best)


TURN, ROLL_ON_1, ROLL_ON_2, SHIFT, MOTIONS = 0, 1, 2, 3, 4
"""Kinds of motions of the object: turns about the point midway between the contacts or about the
contact of either jaw, and shifts along y and z; and their number."""


@part
def jaw_size(jaw):
    """Half the diagonal of a jaw."""
    return 0.5 * math.hypot(jaw.bounds[2] - jaw.bounds[0], jaw.bounds[3] - jaw.bounds[1])


FRICTIONLESS, JAMMED = 1e-9, 1e3
"""Least friction used in computations, and most that a jaw opens per unit of slip."""

AIMING = (0.4, 0.2, 0.1, 0.05, 0.025)
"""Turns [rad] of a direction in the search for the one in which friction prevents motion last."""


@part
def squared_sine(friction):
    """Squared sine of the friction angle."""
    mu = max(friction, FRICTIONLESS)
    return mu * mu / (1.0 + mu * mu)


@part
def _parting(row, dy, dz, sine_squared):
    """How much farther a jaw opens if its contact parts instead of slipping without friction.

    Args:
        row: What the jaw touches, as in `Settling`.
        dy: Slip of the object along y.
        dz: Slip along z.
        sine_squared: Squared sine of the friction angle.
    """
    along = row[3] * dy + row[4] * dz
    slip = dy * dy + dz * dz
    curvature = 1.0 / (1.0 + row[3] ** 2 + row[4] ** 2) - sine_squared
    square, most = slip + along * along, JAMMED * math.sqrt(slip)
    root = (sine_squared * along) ** 2 + curvature * sine_squared * square
    if root <= 0.0:
        return most
    below = sine_squared * along + math.sqrt(root)
    return min(sine_squared * square / below, most) if below > 0.0 else most


@part
def _parting_of(kind, u, v, size, touches, pivot, sine_squared):
    """How far both jaws open in this way, per unit of a motion in a direction (u, v)."""
    total = 0.0
    for finger in range(2):
        row = touches[finger]
        x = row[0] - pivot[0]
        dy, dz = (size * u, size * v) if kind == SHIFT else (x * v, -x * u)
        total += _parting(row, dy, dz, sine_squared)
    return total


@part
def resistance(kind, size, touches, pivot, plane, sine_squared):
    """Find how friction resists motions of one kind.

    Args:
        kind: Kind of motion.
        size: Half the diagonal of a jaw.
        touches: As in `Settling` (2, 7).
        pivot: Point about which the object turns (3,).
        plane: The opening there, as from `write_plane` (3,).
        sine_squared: Squared sine of the friction angle.

    Returns:
        (least opening of the jaws per unit of motion, over directions near the plane's descent;
        largest slope of the plane relative to that opening).
    """
    angle, least, best = math.atan2(-plane[2], -plane[1]), math.inf, 0.0
    for step in (0.0, *AIMING):
        middle = angle
        for side in (-1.0, 1.0):
            turned = middle + side * step
            u, v = math.cos(turned), math.sin(turned)
            parting = _parting_of(kind, u, v, size, touches, pivot, sine_squared)
            rate, least = -(plane[1] * u + plane[2] * v) / parting, min(least, parting)
            if rate > best:
                best, angle = rate, turned
    return least, best


@part
def set_pivot(kind, touches, pivot):
    """Write the point that a motion leaves in place."""
    for k in range(3):
        if kind == ROLL_ON_1:
            pivot[k] = touches[0, k]
        elif kind == ROLL_ON_2:
            pivot[k] = touches[1, k]
        else:
            pivot[k] = 0.5 * (touches[0, k] + touches[1, k])


@part
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


@part
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


@part
def apply_motion(motion, pose, total):
    """Move the object: update its motion since the faces were gathered, and the gripper's pose."""
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


class Touching(NamedTuple):
    """Arrays for two jaws."""

    corners: npt.NDArray[np.float64]
    """Corners of a face that has moved (3, 3)."""
    normal: npt.NDArray[np.float64]
    """Normal of that face (3,)."""
    rows: npt.NDArray[np.float64]
    """What each jaw touches, as rows of a polygon (2, 6)."""
    positions: npt.NDArray[np.float64]
    """Position of each jaw (2,)."""
    features: npt.NDArray[np.int64]
    """For each jaw, the index of the face it touches (-1 for none) and of its own face (2, 2)."""
    scratch: Scratch


@kernel()
def make_touching():
    """Allocate the arrays for two jaws."""
    return Touching(
        np.empty((3, 3)),
        np.empty(3),
        np.empty((2, 6)),
        np.empty(2),
        np.empty((2, 2), np.int64),
        make_scratch(),
    )


@part
def touch(faces, count, motion, jaw, start, memory, touches):
    """Close both jaws on an object that has moved.

    Args:
        faces: `Faces` before the motion.
        count: Number of faces.
        motion: Rotation and translation in the gripper's frame (3, 4).
        jaw: `Jaw`.
        start: Position from which both jaws move.
        memory: `Touching`, scratch.
        touches: Written, as in `Settling` (2, 7).

    Returns:
        (0, opening); (-1, inf) if a jaw touches nothing, (-2, inf) if it starts in the object.
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


@part
def _write_touches(faces, motion, jaw, memory, touches):
    """Write what both jaws touch; return values as for `touch`."""
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


RESTS, LEAVES, CLEAR = 0, 1, 2
"""Outcome for the object: it comes to rest, it slides out of the jaws, or it does not move because
the jaws start in it or do not both touch it."""

MOVED, PROVEN, LOST, SHORTER = 0, 1, 2, 3
"""Outcome of one minimisation: the object has moved; no such motion pays; the most promising motion
takes the object out of the jaws; the planes promise too much within this square."""

LARGEST_TURN, SMALLEST_TURN = math.radians(3.0), math.radians(0.05)
"""First and last half-width of the square of motions [rad]; shifts are in jaw sizes."""

SHRINKING = 0.3
"""Factor by which the half-width shrinks where no motion pays."""

GATHERED = 1.2
"""Largest motion for which faces are gathered at once, in largest turns."""

PLANES = 12
"""Most planes in one minimisation."""

TOLERANCE = 1e-8
"""Decrease of the opening, in object sizes, that counts as none."""

PINCHED = 1e-5
"""Opening, in object sizes, at which jaws that are not on both sides of a sheet pinch an edge."""

TIED = 1e-9
"""Relative difference of rates due to rounding: among the equal motions of a symmetric object the
same one always happens first."""

MOST_MOVES = 100
"""Number of motions after which the object is taken to slide out: its motions become ever smaller
if the jaws close on an edge or a corner."""


class Settling(NamedTuple):
    """Arrays for one pose."""

    near: Faces
    """Faces around the jaws, at the pose at which they were last gathered."""
    faces: Faces
    """Faces that matter for the next motion, at the pose reached so far."""
    touches: npt.NDArray[np.float64]
    """For each jaw: the point it touches, d position / dy and / dz as the object moves, its
    position, and the face it touches (2, 7)."""
    tried: npt.NDArray[np.float64]
    """The same after a trial motion (2, 7)."""
    best: npt.NDArray[np.float64]
    """The same after the best motion of one kind (2, 7)."""
    chosen: npt.NDArray[np.float64]
    """The same after the best motion of all kinds (2, 7)."""
    motion: npt.NDArray[np.float64]
    """Rotation and translation of the object in a trial motion (3, 4)."""
    best_motion: npt.NDArray[np.float64]
    """The best motion of one kind (3, 4)."""
    chosen_motion: npt.NDArray[np.float64]
    """The best motion of all kinds (3, 4)."""
    pivot: npt.NDArray[np.float64]
    """Point about which the object turns (3,)."""
    total: npt.NDArray[np.float64]
    """Motion of the object since the faces around the jaws were gathered (3, 4)."""
    planes: npt.NDArray[np.float64]
    """As in `lowest_point` (PLANES, 3)."""
    promises: npt.NDArray[np.float64]
    """Rate of each motion at its start, as in `_minimise` (MOTIONS,)."""
    proven: npt.NDArray[np.bool_]
    """Whether each motion is known not to pay (MOTIONS,)."""
    touching: Touching


@kernel()
def make_settling(size):
    """Allocate the arrays for a surface of `size` faces."""
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


@part
def settle(surface, tree, pose, opening, friction, jaw, nodes, memory):
    """Move an object between the jaws until it is in equilibrium.

    Args:
        surface: `Surface`.
        tree: The surface's `FaceTree`.
        pose: Rotation and translation from the gripper's frame to the object's (3, 4); replaced by
            those in equilibrium, with the jaws symmetric about the TCP.
        opening: Distance of the jaws at the start.
        friction: Coulomb coefficient between object and jaws.
        jaw: `Jaw`.
        nodes: Scratch, as in `gather`.
        memory: `Settling`.

    Returns:
        (RESTS, LEAVES or CLEAR, opening at which both jaws touch).
    """
    total, proven = memory.total, memory.proven
    write_motion(SHIFT, 0.0, 0.0, 0.0, memory.pivot, total)
    count = gather(surface, tree, pose, jaw, 0.0, ANYWHERE, nodes, memory.near)
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
        if left < margin:  # faces not gathered may have come near
            left = GATHERED * _farthest(math.sqrt(2.0) * LARGEST_TURN, size, start)
            span = span_of(memory.touches, start, left, jaw)
            near = gather(surface, tree, pose, jaw, left, span, nodes, memory.near)
            near = keep_near(memory.near, near, span, start, left, jaw)
            write_motion(SHIFT, 0.0, 0.0, size, memory.pivot, total)
        count = move(memory.near, near, total, jaw, margin, memory.faces)
        span = span_of(memory.touches, start, margin, jaw)
        count = keep_near(memory.faces, count, span, start, margin, jaw)
        put_first(memory.faces, count, memory.touches[:, 6])
        _write_promises(width, size, friction, memory)
        fastest, reached, length, lost, shorter = 0.0, width, 0.0, False, False
        for _ in range(MOTIONS):
            kind = _first_of_largest(memory.promises)
            # No motion's rate exceeds the one at its start.
            if memory.promises[kind] <= max(1.0, fastest):
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
                copy_rows(memory.best, memory.chosen)
                copy_rows(memory.best_motion, memory.chosen_motion)
        if fastest > 0.0:
            # The jaws follow the object, and the gripper is centred.
            left -= 2.0 * _farthest(length, size, start) + width - reached
            moves += 1
            apply_motion(memory.chosen_motion, pose, total)
            copy_rows(memory.chosen, memory.touches)
            proven[:] = False
            if width - reached > margin:  # a jaw may have passed a face that was not kept
                left = -1.0
                near = gather(surface, tree, pose, jaw, 0.0, ANYWHERE, nodes, memory.near)
                write_motion(SHIFT, 0.0, 0.0, size, memory.pivot, total)
                found, reached = touch(
                    memory.near, near, total, jaw, start, memory.touching, memory.touches
                )
                if found < 0:
                    return LEAVES, width
            width = reached
            if width < PINCHED and _parts(surface, memory.touches, friction):
                return LEAVES, width
        elif lost or shorter:
            reach *= SHRINKING
        else:
            break
    _centre(pose, total, memory.touches)
    leaves = moves == MOST_MOVES or reach <= SMALLEST_TURN
    return (LEAVES if leaves else RESTS), width


@part
def _parts(surface, touches, friction):
    """Whether the two touched faces are inclined by more than friction can hold together."""
    one = _normal_of(surface, np.int64(touches[0, 6]))
    two = _normal_of(surface, np.int64(touches[1, 6]))
    twice = 1.0 - 2.0 * squared_sine(friction)  # the cosine of twice the angle of friction
    return -dot(one, two) < twice * norm(one) * norm(two)


@part
def _normal_of(surface, face):
    """Unscaled normal of a face."""
    corner = surface.points[surface.faces[face, 0]]
    one = difference(surface.points[surface.faces[face, 1]], corner)
    return cross(one, difference(surface.points[surface.faces[face, 2]], corner))


@part
def _centre(pose, total, touches):
    """Shift the gripper along x so that its jaws are symmetric about the TCP."""
    middle = 0.5 * (touches[0, 5] + touches[1, 5])
    total[0, 3] -= middle
    for i in range(3):
        pose[i, 3] += middle * pose[i, 0]
    for finger in range(2):
        touches[finger, 0] -= middle
        touches[finger, 5] -= middle


@part
def _farthest(length, size, start):
    """Largest distance that a motion moves a point between the jaws.

    It is the angle times the distance from the pivot, which is between the jaws, too.
    """
    return length * math.hypot(2.0 * start, 2.0 * size)


@part
def _write_promises(width, size, friction, memory):
    """Write the rate of each motion at its start."""
    plane = memory.planes[0]
    for kind in range(MOTIONS):
        set_pivot(kind, memory.touches, memory.pivot)
        write_plane(kind, width, 0.0, 0.0, size, memory.touches, memory.pivot, plane)
        _, memory.promises[kind] = resistance(
            kind, size, memory.touches, memory.pivot, plane, squared_sine(friction)
        )


@part
def _first_of_largest(promises):
    """Index of the first among the largest numbers."""
    largest = 0.0
    for kind in range(MOTIONS):
        largest = max(largest, promises[kind])
    for kind in range(MOTIONS):
        if promises[kind] >= (1.0 - TIED) * largest:
            return kind
    return 0


@part
def _minimise(kind, width, opening, friction, reach, count, jaw, memory):
    """Try motions of one kind, and write the best one.

    Returns (outcome, opening, rate, length of the motion). The rate is the closing of the jaws
    relative to that which friction just prevents.
    """
    planes, size = memory.planes, jaw_size(jaw)
    set_pivot(kind, memory.touches, memory.pivot)
    write_plane(kind, width, 0.0, 0.0, size, memory.touches, memory.pivot, planes[0])
    sine_squared, tolerance = squared_sine(friction), TOLERANCE * min(1.0, width / PINCHED)
    slope, _ = resistance(kind, size, memory.touches, memory.pivot, planes[0], sine_squared)
    start = start_before(opening, width, jaw)
    found, number, rate, length = width, 1, 0.0, 0.0
    while number < PLANES:
        lowest = min(width, found + slope * length)
        promise, u, v = lowest_point(planes, number, reach, slope)
        if length == 0.0 and (u != 0.0 or v != 0.0):  # friction depends on the direction
            slope = _parting_of(kind, u, v, size, memory.touches, memory.pivot, sine_squared)
            slope /= math.hypot(u, v)
            promise, u, v = lowest_point(planes, number, reach, slope)
        if promise >= lowest - tolerance:
            return (MOVED if found < width else PROVEN), found, rate, length
        write_motion(kind, u, v, size, memory.pivot, memory.motion)
        code, tried = touch(
            memory.faces, count, memory.motion, jaw, start, memory.touching, memory.tried
        )
        if code < 0:
            outcome = LOST if code == -1 else SHORTER
            return (MOVED if found < width else outcome), found, rate, length
        plane = planes[number]
        write_plane(kind, tried, u, v, size, memory.tried, memory.pivot, plane)
        number += 1
        if tried + slope * math.hypot(u, v) < lowest - tolerance and tried < width:
            length, found = math.hypot(u, v), tried
            rate = (width - tried) / (slope * length)
            # Friction at the end of the motion decides whether it continues.
            slope = _parting_of(kind, u, v, size, memory.tried, memory.pivot, sine_squared)
            slope /= length
            copy_rows(memory.tried, memory.best)
            copy_rows(memory.motion, memory.best_motion)
    return (MOVED if found < width else SHORTER), found, rate, length
