"""Whether a gripper reaches a grasp or a pose: width, tips, approach, table, collisions."""

import math

from grasp3d._kernels.compiling import kernel, merged, part, scratch_kernel
from grasp3d._kernels.jaws.blocked_angles import free_angles, is_free_at
from grasp3d._kernels.jaws.gripper_parts import (
    BLOCKED,
    BOTTOM,
    DEPTH,
    DIRECTION,
    HIGH,
    LOW,
    MARGIN,
    NONE,
    OPENING,
    PALM,
    PARTS,
    PREGRASP,
    RADIUS,
    REACHED,
    TABLE,
    TIP,
    TOP,
    TOUCHING,
    WIDTH,
    all_angles,
    in_table,
    in_table_angles,
    margin_of,
    opening_fits,
    outside_limits,
    widest_arc,
    write_closing_axis,
    write_parts,
    write_reference,
)
from grasp3d._kernels.surface.box_tree import ball_is_free, capsule_is_free

PREFERRED = (0.0, -0.25, -0.4)
"""Displacements of flat pads along z, in pad heights; the first free one is chosen."""

ONE = True
"""One free angle is enough."""


@part
def tip_fits(point, normal, shape, tree, nodes):
    """Whether a round tip at a contact touches nothing else beyond its compliance.

    Args:
        point: The contact (3,).
        normal: Its inward unit normal (3,).
        shape: `GripperShape`.
        tree: `BoxTree`.
        nodes: Scratch (STACK,).
    """
    radius = shape.tip_radius
    return ball_is_free(
        point[0] - radius * normal[0],
        point[1] - radius * normal[1],
        point[2] - radius * normal[2],
        radius - shape.compliance - TOUCHING,
        tree,
        nodes,
    )


@part
def tips_open(axis, sign, shape, tree, workspace):
    """Whether round tips touch nothing while they move from a grasp by their clearance.

    Args:
        axis: Distance of their centres from the origin at the grasp.
        sign: +1 for an external grasp, -1 for an internal one.
        shape: `GripperShape`.
        tree: `BoxTree`.
        workspace: `ReachWorkspace` with the origin and x of its frame.
    """
    frame, way = workspace.frame, workspace.corners
    radius = shape.tip_radius - shape.compliance - TOUCHING
    for side in (-1.0, 1.0):
        for k in range(3):
            way[0, k] = frame[0, k] + side * axis * frame[1, k]
            way[1, k] = way[0, k] + side * sign * shape.clearance * frame[1, k]
        if not capsule_is_free(way[0], way[1], radius, tree, workspace.nodes):
            return False
    return True


@part
def _write_result(k, offset, top, opening, sign, margin, shape, workspace, found):
    """Write the pose at an angle and the numbers that follow it."""
    frame = workspace.frame
    c, s = workspace.cosines[k], workspace.sines[k]
    for i in range(3):
        z = c * frame[3, i] - s * frame[2, i]
        found[4 * i] = frame[1, i]
        found[4 * i + 1] = c * frame[2, i] + s * frame[3, i]
        found[4 * i + 2] = z
        found[4 * i + 3] = frame[0, i] + offset * z
        found[12 + i] = 0.0
    found[15] = 1.0
    found[MARGIN], found[OPENING] = margin, opening
    found[PREGRASP] = opening + 2.0 * sign * shape.clearance
    found[DEPTH] = top + shape.tip_radius


@part
def _free_at(displacement, one, opening, sign, outside, shape, limits, tree, workspace):
    """Find the free angles with the parts displaced along z by a number of pad heights.

    Returns:
        (mask of free angles, mask of angles at which a part enters the table).
    """
    top = 0.5 * shape.pad_height + displacement * shape.pad_height
    write_parts(opening, sign, top, math.inf, shape, workspace.parts)
    table = in_table_angles(top, shape, limits, workspace)
    return free_angles(outside | table, one, tree, workspace), table


@part
def _begin(points, normals, sign, shape, limits, tree, workspace):
    """Write the frame of a grasp, and test all that does not depend on the approach angle.

    Returns:
        (REACHED or the reason why not, opening, mask of the angles that are not allowed).
    """
    opening, distance = write_closing_axis(points, normals, sign, shape, workspace.frame)
    if not opening_fits(opening, sign, shape):
        return WIDTH, opening, NONE
    if shape.tip_radius > 0.0:
        for i in range(2):
            if not tip_fits(points[i], normals[i], shape, tree, workspace.nodes):
                return TIP, opening, NONE
        if not tips_open(0.5 * distance, sign, shape, tree, workspace):
            return TIP, opening, NONE
    write_reference(normals, limits, workspace.frame)
    outside = outside_limits(limits, workspace)
    everything = all_angles(workspace.cosines.shape[0])
    return (DIRECTION if outside == everything else REACHED), opening, outside


@part
def can_reach(points, normals, sign, shape, limits, tree, workspace):
    """Whether `reach_pair` would reach a grasp, tested faster.

    What blocks shallow fingers also blocks deeper ones, so only the shallowest are tested.
    """
    code, opening, outside = _begin(points, normals, sign, shape, limits, tree, workspace)
    if code != REACHED:
        return False
    free, _ = _free_at(PREFERRED[-1], ONE, opening, sign, outside, shape, limits, tree, workspace)
    return free != NONE


@part
def reach_pair(points, normals, sign, shape, limits, tree, workspace, found):
    """Test one grasp of a parallel gripper at all approach angles.

    Args:
        points: Contacts in the normalised frame (2, 3).
        normals: Inward unit normals (2, 3).
        sign: +1 for an external grasp, -1 for an internal one.
        shape: `GripperShape`.
        limits: `ApproachLimits`.
        tree: `BoxTree`.
        workspace: `ReachWorkspace`; its frame is left as that of this grasp.
        found: Written if the grasp is reached: the pose row by row, then MARGIN, OPENING,
            PREGRASP, DEPTH (RESULTS,).

    Returns:
        (code, mask of the free angles at the chosen displacement).
    """
    code, opening, outside = _begin(points, normals, sign, shape, limits, tree, workspace)
    if code != REACHED:
        return code, NONE
    rest = opening, sign, outside, shape, limits, tree, workspace
    free, table = _free_at(PREFERRED[-1], ONE, *rest)
    if free == NONE:
        alone = table & ~outside != NONE and free_angles(outside, ONE, tree, workspace) != NONE
        return (TABLE if alone else BLOCKED), NONE
    offset = 0.0
    for displacement in PREFERRED:
        offset = displacement * shape.pad_height
        free, _ = _free_at(displacement, not ONE, *rest)
        if free != NONE:
            break
    count = workspace.cosines.shape[0]
    middle, length = widest_arc(free, count)
    margin, top = margin_of(length, count), 0.5 * shape.pad_height + offset
    _write_result(middle, offset, top, opening, sign, margin, shape, workspace, found)
    return REACHED, free


@kernel(
    "Floats3, Floats3, Int8s1, GripperShape, ApproachLimits, BoxTree, ReachWorkspace, "
    "Bytes1, UInt64s1, Floats2"
)
def reach_pairs(points, normals, signs, shape, limits, tree, workspace, codes, free, found):
    """Test grasps of a parallel gripper one by one.

    Args:
        points: Contacts in the normalised frame (b, 2, 3).
        normals: Inward unit normals (b, 2, 3).
        signs: +1 for an external grasp, -1 for an internal one (b,).
        shape: `GripperShape`.
        limits: `ApproachLimits`.
        tree: `BoxTree`.
        workspace: `ReachWorkspace` of this thread.
        codes: Written, REACHED or the reason why not (b,).
        free: Written, mask of the free angles (b,).
        found: Written if reached (b, RESULTS).
    """
    for i in range(points.shape[0]):
        codes[i], free[i] = reach_pair(
            points[i], normals[i], signs[i], shape, limits, tree, workspace, found[i]
        )


INSIDE = 0.5
"""Winding number above which a point is inside the object."""


@part
def winding_number(px, py, pz, triangles):
    """Winding number of a surface about a point: 1 inside a solid, 0 outside.

    It is the sum of the faces' signed solid angles (Van Oosterom & Strackee 1983) over 4 pi.

    Args:
        px: First coordinate of the point.
        py: Second coordinate.
        pz: Third coordinate.
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


@scratch_kernel()
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
    """Whether a box is inside the object; since no box meets a face, its centre decides."""
    for i in range(PALM + 1):
        x, z = 0.5 * (parts[i, LOW] + parts[i, HIGH]), 0.5 * (parts[i, BOTTOM] + parts[i, TOP])
        if _inside(x, z, frame, triangles):
            return True
    return False


@part
def _pose_collides(pose, opening, sign, swept, only, shape, limits, tree, workspace):
    """Whether a gripper at a pose collides; see `collide_poses`."""
    frame, parts = workspace.frame, workspace.parts
    for i in range(3):
        frame[0, i] = pose[i, 3]
        for k in range(3):
            frame[k + 1, i] = pose[i, k]
    top = 0.5 * shape.pad_height
    write_parts(opening, sign if swept else 0, top, math.inf if swept else 0.0, shape, parts)
    for i in range(PARTS):
        if only >= 0 and i != only:
            parts[i, LOW], parts[i, HIGH] = 1.0, -1.0
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
    if not is_free_at(0, tree, workspace):
        return True
    axis = 0.5 * opening + shape.tip_radius
    if only >= 0:
        return False
    if shape.tip_radius > 0.0:
        if not tips_open(axis, sign if swept else 0, shape, tree, workspace):
            return True
        if not swept and _tips_inside(axis, frame, tree.triangles):
            return True
    return not swept and _boxes_inside(frame, parts, tree.triangles)


@kernel(
    "Floats3, Floats1, Int8s1, bool, int, GripperShape, ApproachLimits, BoxTree, ReachWorkspace, "
    "Bools1"
)
def collide_poses(poses, openings, signs, swept, only, shape, limits, tree, workspace, collides):
    """Test for collisions of grippers at given poses, one by one.

    Args:
        poses: Transforms from the gripper's frame to the surface's (b, 4, 4).
        openings: Distance between the inner faces of the fingers or of round tips (b,).
        signs: +1 for an external grasp, -1 for an internal one, for the clearance (b,).
        swept: Whether to test the approach and the opening too, not just the final pose.
        only: FINGER_1, FINGER_2 or PALM to test just that part, without the table; -1 for all.
        shape: `GripperShape`.
        limits: `ApproachLimits`; only its table counts.
        tree: `BoxTree`.
        workspace: `ReachWorkspace` of one angle.
        collides: Written (b,).
    """
    for i in range(poses.shape[0]):
        collides[i] = _pose_collides(
            poses[i], openings[i], signs[i], swept, only, shape, limits, tree, workspace
        )
