"""Whether a gripper reaches a grasp: width, tips, approach limits, table, collisions."""

import math

from grasp3d._kernels.compiling.decorators import kernel, part
from grasp3d._kernels.jaws.blocked_angles import NONE, all_angles, block_angles, turn_sizes
from grasp3d._kernels.jaws.gripper_parts import (
    in_table_angles,
    margin_of,
    opening_fits,
    outside_limits,
    widest_arc,
    write_closing_axis,
    write_parts,
    write_reference,
)
from grasp3d._kernels.jaws.gripper_shape import (
    BLOCKED,
    DEPTH,
    DIRECTION,
    MARGIN,
    OPENING,
    PREGRASP,
    REACHED,
    TABLE,
    TIP,
    TOUCHING,
    WIDTH,
)
from grasp3d._kernels.surface.box_tree import ball_is_free
from grasp3d._kernels.surface.capsules import capsule_is_free

PREFERRED, SHALLOWEST = (0.0, -0.25), -0.4
"""Displacements of flat pads along z, in pad heights: the first that is free is chosen."""


@part
def tip_fits(point, normal, shape, tree, nodes):
    """Whether a round tip that touches at a contact touches nothing else, beyond its compliance.

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
    """Whether round tips touch nothing on their way between a grasp and their clearance.

    Args:
        axis: Distance of their centres from the origin, at the grasp.
        sign: +1 external grasp, -1 internal.
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
    """Write the pose at an angle, and the numbers behind it."""
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
def _blocked_at(offset, opening, sign, known, shape, limits, tree, workspace):
    """Mask of the angles that are blocked at one displacement along z, with those known to be."""
    top = 0.5 * shape.pad_height + offset
    write_parts(opening, sign, top, math.inf, shape, workspace.parts)
    blocked = known | in_table_angles(top, shape, limits, workspace)
    if blocked != all_angles(workspace.cosines.shape[0]):
        blocked, _ = block_angles(blocked, blocked, 0.0, tree, workspace)
    return blocked


@part
def _blocked_at_best(opening, sign, outside, shape, limits, tree, workspace):
    """Find the preferred displacement along z at which not all angles are blocked.

    Returns:
        (mask of the blocked angles, displacement): the last one tested where all are blocked.
    """
    everything = all_angles(workspace.cosines.shape[0])
    height = shape.pad_height
    top, back = 0.5 * height + PREFERRED[0] * height, (PREFERRED[0] - SHALLOWEST) * height
    write_parts(opening, sign, top, math.inf, shape, workspace.parts)
    blocked = outside | in_table_angles(top, shape, limits, workspace)
    shallow = outside | in_table_angles(top - back, shape, limits, workspace)
    if blocked != everything:
        blocked, shallow = block_angles(blocked, shallow, back, tree, workspace)
    if blocked != everything or height == 0.0:
        return blocked, PREFERRED[0] * height
    # What blocks shallow fingers blocks deeper ones too.
    offset = SHALLOWEST * height
    shallow = _blocked_at(offset, opening, sign, shallow, shape, limits, tree, workspace)
    if shallow == everything:
        return shallow, offset
    for i in range(1, len(PREFERRED)):
        blocked = _blocked_at(
            PREFERRED[i] * height, opening, sign, shallow, shape, limits, tree, workspace
        )
        if blocked != everything:
            return blocked, PREFERRED[i] * height
    return shallow, offset


@part
def _is_table_alone(blocked, outside, offset, explain, shape, limits, tree, workspace):
    """Whether only the table is in the way where all angles are blocked.

    Args:
        blocked: Mask of the blocked angles, all of them.
        outside: Mask of the angles that are not allowed.
        offset: The displacement along z that was tested last.
        explain: As in `reach_pair`.
        shape: `GripperShape`.
        limits: `ApproachLimits`.
        tree: `BoxTree`.
        workspace: `ReachWorkspace`, as the last test left it.
    """
    top = 0.5 * shape.pad_height + offset
    table = in_table_angles(top, shape, limits, workspace)
    if table & ~outside == NONE:
        return False
    if not explain:
        return outside | table == blocked
    # An angle that the first traversal found blocked is tested once more.
    known = outside | (blocked & ~table)
    without, _ = block_angles(known, known, 0.0, tree, workspace)
    return without != blocked


@part
def reach_pair(points, normals, sign, shape, limits, explain, tree, workspace, found):
    """Test one grasp of a parallel gripper at all approach angles.

    Args:
        points: Contacts in the normalised frame (2, 3).
        normals: Inward unit normals (2, 3).
        sign: +1 external grasp, -1 internal.
        shape: `GripperShape`.
        limits: `ApproachLimits`.
        explain: Whether TABLE and BLOCKED must be distinguished exactly, which takes a second
            traversal where nothing is free; else TABLE is where the table blocks every angle alone.
        tree: `BoxTree`.
        workspace: `ReachWorkspace`; its frame stays that of this grasp.
        found: Written where the grasp is reached: the pose row by row, then MARGIN, OPENING,
            PREGRASP, DEPTH (RESULTS,).

    Returns:
        (code, mask of the free angles at the displacement chosen).
    """
    frame, count = workspace.frame, workspace.cosines.shape[0]
    opening, distance = write_closing_axis(points, normals, sign, shape, frame)
    if not opening_fits(opening, sign, shape):
        return WIDTH, NONE
    if shape.tip_radius > 0.0:
        for i in range(2):
            if not tip_fits(points[i], normals[i], shape, tree, workspace.nodes):
                return TIP, NONE
        if not tips_open(0.5 * distance, sign, shape, tree, workspace):
            return TIP, NONE
    write_reference(normals, limits, frame)
    turn_sizes(workspace)
    outside = outside_limits(limits, workspace)
    everything = all_angles(count)
    if outside == everything:
        return DIRECTION, NONE
    blocked, offset = _blocked_at_best(opening, sign, outside, shape, limits, tree, workspace)
    if blocked == everything:
        table = _is_table_alone(blocked, outside, offset, explain, shape, limits, tree, workspace)
        return (TABLE if table else BLOCKED), NONE
    free = everything & ~blocked
    middle, length = widest_arc(free, count)
    margin = margin_of(length, count)
    top = 0.5 * shape.pad_height + offset
    _write_result(middle, offset, top, opening, sign, margin, shape, workspace, found)
    return REACHED, free


@kernel
def reach_pairs(
    points, normals, signs, shape, limits, explain, tree, workspace, codes, free, found
):
    """Test many grasps of a parallel gripper, one after the other.

    Args:
        points: Contacts in the normalised frame (b, 2, 3).
        normals: Inward unit normals (b, 2, 3).
        signs: +1 external grasp, -1 internal (b,).
        shape: `GripperShape`.
        limits: `ApproachLimits`.
        explain: As in `reach_pair`.
        tree: `BoxTree`.
        workspace: `ReachWorkspace` of this thread.
        codes: Written, REACHED or why not (b,).
        free: Written, mask of the free angles (b,).
        found: Written where reached (b, RESULTS).
    """
    for i in range(points.shape[0]):
        codes[i], free[i] = reach_pair(
            points[i], normals[i], signs[i], shape, limits, explain, tree, workspace, found[i]
        )


@kernel
def reach_tips(points, normals, shape, limits, tree, workspace, codes):
    """Test the round tips of grasps of any number of fingers: whether they fit, above the table.

    Args:
        points: Contacts in the normalised frame (b, n, 3).
        normals: Inward unit normals (b, n, 3).
        shape: `GripperShape`.
        limits: `ApproachLimits`.
        tree: `BoxTree`.
        workspace: `ReachWorkspace` of this thread.
        codes: Written, REACHED, TIP or TABLE (b,).
    """
    up, offset, radius = limits.table_normal, limits.table_offset, shape.tip_radius
    for i in range(points.shape[0]):
        codes[i] = REACHED
        for j in range(points.shape[1]):
            height = -radius
            for k in range(3):
                height += up[k] * (points[i, j, k] - radius * normals[i, j, k])
            if not tip_fits(points[i, j], normals[i, j], shape, tree, workspace.nodes):
                codes[i] = TIP
                break
            if height < offset - TOUCHING:
                codes[i] = TABLE
