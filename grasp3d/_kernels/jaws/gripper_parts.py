"""What a grasp is tested against: the gripper's shape and parts, approach limits, and a table.

Lengths are in the surface's normalised frame (centred, size 1). The table and the limits of the
approach are in closed form.
"""

import math
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.compiling import Bytes1, Floats1, Floats2, Ints1, UInt64s1, merged, part
from grasp3d._kernels.surface.face_tree import STACK
from grasp3d._kernels.surface.vectors import dot

TOUCHING = 1e-9
"""Overlap that counts as touching, which is allowed."""

REACHED, WIDTH, TIP, DIRECTION, TABLE, BLOCKED = range(6)
"""Results of a test: reached, or the reason why not."""

FINGER_1, FINGER_2, PALM, TIP_1, TIP_2 = range(5)
PARTS = 5
"""Number of parts of a gripper, the rows of `ReachWorkspace.parts`."""

LOW, HIGH, HALF_WIDTH, BOTTOM, TOP, AXIS, OUTER_AXIS = range(7)
"""Columns of `ReachWorkspace.parts`; a part with HIGH below LOW is left out."""

NO_GRASP = 6
"""Result if there is no grasp to test."""

MARGIN, OPENING, PREGRASP, DEPTH, RESULTS = 16, 17, 18, 19, 20
"""Entries of a result after the 4x4 pose, which is stored row by row; and the total number."""


ONE, NONE = np.uint64(1), np.uint64(0)
"""Masks of approach angles: the first one, and none."""


class GripperShape(NamedTuple):
    """Lengths of a `ParallelGripper`, in object sizes."""

    min_opening: float
    max_opening: float
    finger_thickness: float
    finger_width: float
    finger_length: float
    pad_height: float
    """Size of a flat pad along z; 0 for round tips."""
    tip_radius: float
    """Radius of round tips; 0 for flat pads."""
    palm_thickness: float
    palm_width: float
    palm_length: float
    compliance: float
    clearance: float


class ApproachLimits(NamedTuple):
    """Further limits of the approach: allowed directions, and a table."""

    direction: Floats1
    """Preferred approach direction, zero for none (3,)."""
    least_cosine: float
    """Least cosine of the angle between that and an approach direction; below -1 for no limit."""
    table_normal: Floats1
    """Unit vector out of the table (3,)."""
    table_offset: float
    """Height of the table along that vector; -inf for no table."""


class ReachWorkspace(NamedTuple):
    """Scratch arrays of one thread, for n approach angles."""

    cosines: Floats1
    """Cosines of the approach angles (n,)."""
    sines: Floats1
    frame: Floats2
    """Origin midway between the contacts, x, and y and z at angle 0 (4, 3)."""
    parts: Floats2
    """Each part extends from LOW to HIGH along x, -HALF_WIDTH to HALF_WIDTH along y, and BOTTOM to
    TOP along z; for round tips, also x of their axis at the grasp and before it (PARTS, 7)."""
    clipped: Floats2
    """A face between the planes of a part, as x, y and z at angle 0 (8, 3)."""
    clipped_too: Floats2
    """A second such face (8, 3)."""
    corners: Floats2
    """A face as x, y and z at angle 0 (3, 3)."""
    axes: Floats2
    """The axes at one angle, and their absolute components (6, 3)."""
    last: Ints1
    """Row of the face met last, and the last free angle (2,)."""
    nodes: Ints1


class ReachResults(NamedTuple):
    """Results of tests, a row per grasp; written in place."""

    codes: Bytes1
    """REACHED, the reason why not, or NO_GRASP (n,)."""
    free: UInt64s1
    """Mask of the free angles (n,)."""
    found: Floats2
    """Pose and numbers if reached, else nan (n, RESULTS)."""


def no_results(count: int) -> ReachResults:
    """Initial results, before any test."""
    return ReachResults(
        codes=np.full(count, NO_GRASP, dtype=np.uint8),
        free=np.zeros(count, dtype=np.uint64),
        found=np.full((count, RESULTS), math.nan),
    )


def make_workspace(angles: int) -> ReachWorkspace:
    """Allocate the scratch arrays for a number of approach angles, at most 64."""
    turns = 2.0 * math.pi * np.arange(angles) / angles
    return ReachWorkspace(
        cosines=np.cos(turns),
        sines=np.sin(turns),
        frame=np.zeros((4, 3)),
        parts=np.zeros((PARTS, 7)),
        clipped=np.zeros((8, 3)),
        clipped_too=np.zeros((8, 3)),
        corners=np.zeros((3, 3)),
        axes=np.zeros((6, 3)),
        last=np.zeros(2, dtype=np.int64),
        nodes=np.zeros(STACK, dtype=np.int64),
    )


@merged
def all_angles(count):
    """Mask of the given number of angles, 1 to 64."""
    return ~NONE >> np.uint64(64 - count)


@merged
def bit(k):
    """Mask of a single angle."""
    return ONE << np.uint64(k)


RADIUS = 0.5
"""Radius of the ball about the origin of the normalised frame that contains the object."""

MIN_LENGTH = 1e-3
"""Length of a reference direction's part across x above which the direction is used."""


@part
def write_closing_axis(points, normals, sign, shape, frame):
    """Write the origin and x of a grasp's frame.

    Args:
        points: Contacts (2, 3).
        normals: Inward unit normals (2, 3).
        sign: +1 for an external grasp, -1 for an internal one.
        shape: `GripperShape`.
        frame: Rows 0 and 1 are written (4, 3).

    Returns:
        (opening, distance between the centres of round tips or the contacts). The opening is
        negative if the fingers would overlap.
    """
    radius = shape.tip_radius
    length, product = 0.0, 0.0
    for k in range(3):
        one, two = points[0, k] - radius * normals[0, k], points[1, k] - radius * normals[1, k]
        frame[0, k], frame[1, k] = 0.5 * (one + two), two - one
        length += frame[1, k] ** 2
        product += frame[1, k] * (points[1, k] - points[0, k])
    length = math.sqrt(length)
    if not (length > 1e-12 and product > 0.0):
        return -1.0, 0.0
    for k in range(3):
        frame[1, k] /= length
    if radius > 0.0:
        return length - 2.0 * radius, length
    return (length if sign > 0 else length - 2.0 * shape.finger_thickness), length


@merged
def opening_fits(opening, sign, shape):
    """Whether the openings at the grasp and before it are within the stroke."""
    before = opening + 2.0 * sign * shape.clearance
    low, high = min(opening, before), max(opening, before)
    return shape.min_opening - TOUCHING <= low and high <= shape.max_opening + TOUCHING


@part
def write_parts(opening, sign, top, behind, shape, parts):
    """Write the boxes of the fingers and the palm, and the cylinders of round tips.

    Boxes are smaller than the gripper by TOUCHING on each side.

    Args:
        opening: Distance between the inner faces of the fingers or of round tips.
        sign: +1 if the fingers come from outside, -1 from inside, 0 for no clearance.
        top: z of the fingers' ends.
        behind: Length of the sweep; inf if unlimited, 0 for the final position only.
        shape: `GripperShape`.
        parts: Written (PARTS, 7).
    """
    radius, thick = shape.tip_radius, shape.finger_thickness
    axis = 0.5 * opening + radius
    inner = axis - 0.5 * thick if radius > 0.0 else axis
    outer = inner + thick
    # The object may press into pads and round tips.
    if sign < 0:
        outer = min(outer, axis + (radius if radius > 0.0 else thick) - shape.compliance)
        inner -= shape.clearance
    else:
        inner = max(inner, axis - radius + shape.compliance)
        outer += shape.clearance if sign > 0 else 0.0
    outer_axis = axis + sign * shape.clearance
    for i in (FINGER_1, FINGER_2):
        low, high = (-outer, -inner) if i == FINGER_1 else (inner, outer)
        parts[i, LOW], parts[i, HIGH] = low + TOUCHING, high - TOUCHING
        parts[i, HALF_WIDTH] = 0.5 * shape.finger_width - TOUCHING
        parts[i, BOTTOM] = top - shape.finger_length - behind + TOUCHING
        parts[i, TOP] = top - TOUCHING
    parts[PALM, LOW] = TOUCHING - 0.5 * shape.palm_thickness
    parts[PALM, HIGH] = 0.5 * shape.palm_thickness - TOUCHING
    parts[PALM, HALF_WIDTH] = 0.5 * shape.palm_width - TOUCHING
    parts[PALM, TOP] = top - shape.finger_length - TOUCHING
    parts[PALM, BOTTOM] = parts[PALM, TOP] - shape.palm_length - behind + 2.0 * TOUCHING
    radius -= shape.compliance + TOUCHING
    within = min(parts[FINGER_2, HIGH] - axis, axis - parts[FINGER_2, LOW])
    needless = radius <= min(within, parts[FINGER_2, HALF_WIDTH])  # inside the finger's box
    for i in (TIP_1, TIP_2):
        side = -1.0 if i == TIP_1 else 1.0
        parts[i, AXIS], parts[i, OUTER_AXIS] = side * axis, side * outer_axis
        parts[i, LOW] = min(side * axis, side * outer_axis) - radius
        parts[i, HIGH] = max(side * axis, side * outer_axis) + radius
        parts[i, HALF_WIDTH], parts[i, TOP] = radius, top
        parts[i, BOTTOM] = -math.inf
        if radius <= 0.0 or needless or behind < math.inf:
            parts[i, LOW], parts[i, HIGH] = 1.0, -1.0


@part
def _write_across(direction, frame):
    """Write a direction's part across x as z; return whether it is long enough."""
    along = 0.0
    for k in range(3):
        along += direction[k] * frame[1, k]
    square = 0.0
    for k in range(3):
        frame[3, k] = direction[k] - along * frame[1, k]
        square += frame[3, k] ** 2
    length = math.sqrt(square)
    if not length > MIN_LENGTH:
        return False
    for k in range(3):
        frame[3, k] /= length
    return True


@part
def write_reference(normals, limits, frame):
    """Write y and z of a grasp's frame at angle 0, which turn with the object and its surroundings.

    z is the part across x of the first of these that is long enough: the preferred approach
    direction, the direction into the table, that from the grasp to the object's centre, the sum of
    the contact normals; and, for grasps as regular as a ball's, an axis of the mesh's frame.

    Args:
        normals: Contact normals (2, 3).
        limits: `ApproachLimits`.
        frame: Rows 2 and 3 are written (4, 3).
    """
    vector = frame[2]
    done = _write_across(limits.direction, frame)
    if not done and limits.table_offset > -math.inf:
        for k in range(3):
            vector[k] = -limits.table_normal[k]
        done = _write_across(vector, frame)
    if not done:
        for k in range(3):
            vector[k] = -frame[0, k]
        done = _write_across(vector, frame)
    if not done:
        for k in range(3):
            vector[k] = normals[0, k] + normals[1, k]
        done = _write_across(vector, frame)
    if not done:
        axis = 2
        for k in (1, 0):
            if abs(frame[1, k]) < abs(frame[1, axis]):
                axis = k
        for k in range(3):
            vector[k] = -1.0 if k == axis else 0.0
        _write_across(vector, frame)
    x, z = frame[1], frame[3]
    frame[2, 0] = z[1] * x[2] - z[2] * x[1]
    frame[2, 1] = z[2] * x[0] - z[0] * x[2]
    frame[2, 2] = z[0] * x[1] - z[1] * x[0]


@part
def outside_limits(limits, workspace):
    """Mask of the angles whose approach direction is not allowed."""
    frame = workspace.frame
    y, z = dot(limits.direction, frame[2]), dot(limits.direction, frame[3])
    mask = NONE
    if limits.least_cosine >= -1.0:
        for k in range(workspace.cosines.shape[0]):
            cosine = z * workspace.cosines[k] - y * workspace.sines[k]
            if cosine < limits.least_cosine - TOUCHING:
                mask |= bit(k)
    return mask


@part
def in_table(origin, nx, ny, nz, top, way, shape, limits, parts):
    """Whether a part enters the table.

    Args:
        origin: Origin of the gripper's frame (3,).
        nx: First component of the table's normal in the gripper's frame.
        ny: Second component.
        nz: Third component.
        top: z of the fingers' ends.
        way: Length of the straight approach that must be free.
        shape: `GripperShape`.
        limits: `ApproachLimits`.
        parts: As written by `write_parts`.
    """
    height = dot(origin, limits.table_normal) - limits.table_offset
    for i in range(PARTS):
        if shape.tip_radius > 0.0 and i >= TIP_1:
            x = min(nx * parts[i, AXIS], nx * parts[i, OUTER_AXIS])
            low = height + x + nz * top - max(nz * way, 0.0) - shape.tip_radius
        elif i < TIP_1:
            front = top if i < PALM else top - shape.finger_length
            length = shape.finger_length if i < PALM else shape.palm_length
            x = min(nx * parts[i, LOW], nx * parts[i, HIGH])
            y = abs(ny) * parts[i, HALF_WIDTH]
            low = height + x - y + min(nz * front, nz * (front - length - way))
        else:
            continue
        if low < -4.0 * TOUCHING:
            return True
    return False


@part
def in_table_angles(top, shape, limits, workspace):
    """Mask of the angles at which a part enters the table at the grasp or on the way in.

    Args:
        top: z of the fingers' ends.
        shape: `GripperShape`.
        limits: `ApproachLimits`.
        workspace: `ReachWorkspace` with its frame and parts.
    """
    mask = NONE
    if limits.table_offset == -math.inf:
        return mask
    frame = workspace.frame
    nx = dot(limits.table_normal, frame[1])
    y, z = dot(limits.table_normal, frame[2]), dot(limits.table_normal, frame[3])
    oy, oz = dot(frame[0], frame[2]), dot(frame[0], frame[3])
    for k in range(workspace.cosines.shape[0]):
        c, s = workspace.cosines[k], workspace.sines[k]
        # The way ends when the front of the gripper has left the ball about the object.
        way = max(top + shape.tip_radius + (c * oz - s * oy) + RADIUS, 0.0)
        if in_table(
            frame[0], nx, c * y + s * z, c * z - s * y, top, way, shape, limits, workspace.parts
        ):
            mask |= bit(k)
    return mask


@part
def widest_arc(free, count):
    """Find the widest run of free angles; among equally wide ones, the one nearest to angle 0.

    Args:
        free: Mask of the free angles, not empty.
        count: Number of angles.

    Returns:
        (middle, length); the middle of an even run is the angle nearer to angle 0.
    """
    start = -1
    for k in range(count):
        if free & bit(k) == NONE:
            start = k
            break
    if start < 0:
        return 0, count
    middle, longest, nearest, run = 0, 0, 2 * count, 0
    for i in range(1, count + 1):
        k = (start + i) % count
        if free & bit(k) != NONE:
            run += 1
            continue
        if run > 0:
            # Twice the middle, as that of an even run is between two angles.
            twice = (2 * (start + i - run) + run - 1) % (2 * count)
            away = min(twice, 2 * count - twice)
            if run > longest or (run == longest and away < nearest):
                longest, nearest = run, away
                # Halves are rounded toward angle 0.
                middle = (twice // 2 if twice < count else (twice + 1) // 2) % count
        run = 0
    return middle, longest


@merged
def margin_of(length, count):
    """Angle [rad] either way from the middle of a run within which every tested angle is free."""
    if length == count:
        return math.pi
    return np.float64((length - 1) // 2) * (2.0 * math.pi / count)
