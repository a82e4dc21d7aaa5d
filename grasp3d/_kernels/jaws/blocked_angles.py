"""Approach angles at which parts of a gripper meet a surface.

The closing axis x is fixed; the approach direction turns about it. Each part is a box, swept
backward along the approach direction where its bottom is -inf, and round tips are cylinders that
end in balls. A face meets a box if what of it lies between the box's two planes across x, seen
along x, meets a rectangle that turns: tests in the plane, exact up to rounding. One traversal of
the tree serves all angles, up to 64, as the bits of a mask.
"""

import math

import numpy as np

from grasp3d._kernels.compiling import merged, part
from grasp3d._kernels.jaws.gripper_parts import (
    AXIS,
    BOTTOM,
    FINGER_2,
    HALF_WIDTH,
    HIGH,
    LOW,
    NONE,
    OUTER_AXIS,
    PALM,
    PARTS,
    TIP_1,
    TOP,
    all_angles,
    bit,
)
from grasp3d._kernels.surface.box_tree import HEIGHT, NORMAL, RADIUS, THICKNESS, leaf_rows
from grasp3d._kernels.surface.face_tree import GO_ON, NO_NODE, STOP, below, walk
from grasp3d._kernels.surface.vectors import copy

MEETS_FRONT, MEETS_BOTH = 1, 2
"""Whether a face meets a part only as far in front as it is, or also farther back."""


@part
def _clip(source, count, axis, bound, sign, target):
    """Clip a polygon to sign * (coordinate - bound) <= 0; returns its new number of corners."""
    kept = 0
    for i in range(count):
        j = i + 1 if i + 1 < count else 0
        one, two = sign * (source[i, axis] - bound), sign * (source[j, axis] - bound)
        if one <= 0.0:
            copy(source[i], target[kept])
            kept += 1
        if (one < 0.0 < two) or (two < 0.0 < one):
            t = one / (one - two)
            for k in range(3):
                target[kept, k] = source[i, k] + t * (source[j, k] - source[i, k])
            target[kept, axis] = bound
            kept += 1
    return kept


@part
def _meets_box(polygon, count, c, s, half, bottom, top, back):
    """Whether a polygon, seen along x, meets the rectangle turned by an angle.

    Returns:
        MEETS_BOTH: also where the rectangle ends farther `back`; MEETS_FRONT: else; or 0.
    """
    least, largest = math.inf, -math.inf
    y0 = c * polygon[count - 1, 1] + s * polygon[count - 1, 2]
    z0 = c * polygon[count - 1, 2] - s * polygon[count - 1, 1]
    for i in range(count):
        y1 = c * polygon[i, 1] + s * polygon[i, 2]
        z1 = c * polygon[i, 2] - s * polygon[i, 1]
        if -half <= y1 <= half:
            least, largest = min(least, z1), max(largest, z1)
        # The extremes within the strip are at corners, or where edges cross its borders.
        if (y0 < -half) != (y1 < -half):
            z = z0 + (-half - y0) / (y1 - y0) * (z1 - z0)
            least, largest = min(least, z), max(largest, z)
        if (y0 > half) != (y1 > half):
            z = z0 + (half - y0) / (y1 - y0) * (z1 - z0)
            least, largest = min(least, z), max(largest, z)
        if least <= top - back and largest >= bottom:
            return MEETS_BOTH
        y0, z0 = y1, z1
    return MEETS_FRONT if least <= top and largest >= bottom else 0


@merged
def _edge_distance(x, y, dx, dy, px):
    """Squared distance of (px, 0) from the edge of a start (x, y) and a vector (dx, dy)."""
    square = dx * dx + dy * dy
    t = ((px - x) * dx - y * dy) / square if square > 0.0 else 0.0
    t = min(max(t, 0.0), 1.0)
    return (x + t * dx - px) ** 2 + (y + t * dy) ** 2


@part
def _meets_cylinder(corners, c, s, part):
    """Whether a face meets the cylinder behind a round tip, also between its two positions."""
    radius, top = part[HALF_WIDTH], part[TOP]
    low, high = min(part[AXIS], part[OUTER_AXIS]), max(part[AXIS], part[OUTER_AXIS])
    least, positive, negative, count = math.inf, False, False, 0
    last_x, last_y, first_x, first_y = 0.0, 0.0, 0.0, 0.0
    # The corners of the face clipped to z <= top, and at the end the first one again.
    for i in range(7):
        if i == 6:
            if count == 0:
                return False
            x, y = first_x, first_y
        else:
            j = i // 2
            n = j + 1 if j < 2 else 0
            x, y = corners[j, 0], c * corners[j, 1] + s * corners[j, 2]
            one = c * corners[j, 2] - s * corners[j, 1] - top
            if i % 2 == 0:
                if one > 0.0:
                    continue
            else:
                two = c * corners[n, 2] - s * corners[n, 1] - top
                if not ((one < 0.0 < two) or (two < 0.0 < one)):
                    continue
                t = one / (one - two)
                x += t * (corners[n, 0] - x)
                y += t * (c * corners[n, 1] + s * corners[n, 2] - y)
        if count == 0:
            first_x, first_y = x, y
        else:
            dx, dy = x - last_x, y - last_y
            least = min(least, _edge_distance(last_x, last_y, dx, dy, low))
            least = min(least, _edge_distance(last_x, last_y, dx, dy, high))
            side = dx * (0.0 - last_y) - dy * (low - last_x)
            positive, negative = positive or side > 0.0, negative or side < 0.0
            if (last_y < 0.0) != (y < 0.0) and low <= last_x - last_y / dy * dx <= high:
                return True
        across = max(low - x, x - high, 0.0)
        least = min(least, across * across + y * y)
        last_x, last_y = x, y
        count += 1
    inside = positive != negative
    return inside or least < radius * radius


@merged
def _overlaps(part, low, high):
    """Whether an interval along x meets the part's."""
    return low <= part[HIGH] and high >= part[LOW] and part[LOW] <= part[HIGH]


@merged
def _interval(box, frame, x):
    """Bounds along x of the faces of a node, whose box has its centre at x."""
    one, two, three = frame[1, 0], frame[1, 1], frame[1, 2]
    size = abs(one) * box[3] + abs(two) * box[4] + abs(three) * box[5]
    # The slab across the mean normal: thin where the normal is nearly along x.
    nx, ny, nz = box[NORMAL], box[NORMAL + 1], box[NORMAL + 2]
    along = one * nx + two * ny + three * nz
    across = math.sqrt(
        (two * nz - three * ny) ** 2 + (three * nx - one * nz) ** 2 + (one * ny - two * nx) ** 2
    )
    middle = x + along * box[HEIGHT]
    half = abs(along) * box[THICKNESS] + across * box[RADIUS]
    return max(x - size, middle - half), min(x + size, middle + half)


@part
def _possible_angles(box, back, palm, workspace):
    """Angles at which the faces of a node may meet the palm, or another part.

    Returns:
        (mask of these, mask of the angles at which they are within a part, also farther `back`).
    """
    frame, parts = workspace.frame, workspace.parts
    px, py, pz = box[0] - frame[0, 0], box[1] - frame[0, 1], box[2] - frame[0, 2]
    hx, hy, hz = box[3], box[4], box[5]
    low, high = _interval(box, frame, frame[1, 0] * px + frame[1, 1] * py + frame[1, 2] * pz)
    half, bottom, top = -math.inf, math.inf, -math.inf
    inner_half, inner_bottom, inner_top = -math.inf, math.inf, -math.inf
    for i in range(PARTS):
        if (i == PALM) == palm and _overlaps(parts[i], low, high):
            half = max(half, parts[i, HALF_WIDTH])
            bottom, top = min(bottom, parts[i, BOTTOM]), max(top, parts[i, TOP])
            if i < TIP_1 and low >= parts[i, LOW] and high <= parts[i, HIGH]:
                inner_half, inner_bottom = parts[i, HALF_WIDTH], parts[i, BOTTOM]
                inner_top = parts[i, TOP] - back
    mask, within = NONE, NONE
    if half < 0.0:
        return mask, within
    y = frame[2, 0] * px + frame[2, 1] * py + frame[2, 2] * pz
    z = frame[3, 0] * px + frame[3, 1] * py + frame[3, 2] * pz
    if math.sqrt(y * y + z * z) + box[RADIUS] < -top:
        return mask, within  # in front of the palm at every angle
    cosines, sines = workspace.cosines, workspace.sines
    ys, zs = workspace.y_sizes, workspace.z_sizes
    nx, ny, nz = box[NORMAL], box[NORMAL + 1], box[NORMAL + 2]
    normal_y = frame[2, 0] * nx + frame[2, 1] * ny + frame[2, 2] * nz
    normal_z = frame[3, 0] * nx + frame[3, 1] * ny + frame[3, 2] * nz
    height, thickness, radius = box[HEIGHT], box[THICKNESS], box[RADIUS]
    for k in range(cosines.shape[0]):
        c, s = cosines[k], sines[k]
        across, along = abs(c * y + s * z), c * z - s * y
        width = ys[0, k] * hx + ys[1, k] * hy + ys[2, k] * hz
        depth = zs[0, k] * hx + zs[1, k] * hy + zs[2, k] * hz
        first, last = along - depth, along + depth
        # The slab across the mean normal, which is thin where that is nearly along z.
        normal = c * normal_z - s * normal_y
        sloping = math.sqrt(max(1.0 - normal * normal, 0.0) + 1e-15) * radius
        first = max(first, along + normal * height - abs(normal) * thickness - sloping)
        some = (across - width <= half) & (first <= top) & (last >= bottom)
        whole = (across + width <= inner_half) & (last <= inner_top) & (first >= inner_bottom)
        mask |= np.uint64(some) << np.uint64(k)
        within |= np.uint64(whole) << np.uint64(k)
    return mask, within


@merged
def _turn_face(triangle, workspace):
    """Write a face as x, y and z at angle 0; returns its bounds along x."""
    frame, corners = workspace.frame, workspace.corners
    low, high = math.inf, -math.inf
    for i in range(3):
        px = triangle[3 * i] - frame[0, 0]
        py = triangle[3 * i + 1] - frame[0, 1]
        pz = triangle[3 * i + 2] - frame[0, 2]
        for k in range(3):
            corners[i, k] = frame[k + 1, 0] * px + frame[k + 1, 1] * py + frame[k + 1, 2] * pz
        low, high = min(low, corners[i, 0]), max(high, corners[i, 0])
    return low, high


@part
def _blocked_by_face(triangle, possible, back, palm, workspace):
    """Those of the possible angles at which a face meets the palm, or another part.

    Returns:
        (mask of these, mask of those at which it also meets the part farther `back`).
    """
    parts, corners = workspace.parts, workspace.corners
    cosines, sines = workspace.cosines, workspace.sines
    low, high = _turn_face(triangle, workspace)
    # A disc around the face, seen along x.
    y = (corners[0, 1] + corners[1, 1] + corners[2, 1]) / 3.0
    z = (corners[0, 2] + corners[1, 2] + corners[2, 2]) / 3.0
    square = 0.0
    for i in range(3):
        square = max(square, (corners[i, 1] - y) ** 2 + (corners[i, 2] - z) ** 2)
    radius = math.sqrt(square) + 1e-12
    reach = math.sqrt(y * y + z * z) + radius
    blocked, farther = NONE, NONE
    for i in range(PARTS):
        part = parts[i]
        if (i == PALM) != palm or not _overlaps(part, low, high) or reach < -part[TOP]:
            continue
        polygon, count = corners, 3
        if i < TIP_1:
            if low < part[LOW]:
                count = _clip(polygon, count, 0, part[LOW], -1.0, workspace.clipped)
                polygon = workspace.clipped
            if high > part[HIGH]:
                count = _clip(polygon, count, 0, part[HIGH], 1.0, workspace.clipped_too)
                polygon = workspace.clipped_too
            if count == 0:
                continue
        half, bottom, top = part[HALF_WIDTH] + radius, part[BOTTOM] - radius, part[TOP] + radius
        for k in range(cosines.shape[0]):
            if possible & ~farther & bit(k) == NONE:
                continue
            c, s = cosines[k], sines[k]
            along = c * z - s * y
            if abs(c * y + s * z) > half or along > top or along < bottom:
                continue
            if i < TIP_1:
                meets = _meets_box(
                    polygon, count, c, s, part[HALF_WIDTH], part[BOTTOM], part[TOP], back
                )
            else:
                meets = MEETS_BOTH if _meets_cylinder(corners, c, s, part) else 0
            if meets != 0:
                blocked |= bit(k)
            if meets == MEETS_BOTH:
                farther |= bit(k)
    return blocked, farther


@part
def turn_sizes(workspace):
    """Write the absolute components of y and z at each angle, once the frame is known."""
    frame, cosines, sines = workspace.frame, workspace.cosines, workspace.sines
    for i in range(3):
        for k in range(cosines.shape[0]):
            c, s = cosines[k], sines[k]
            workspace.y_sizes[i, k] = abs(c * frame[2, i] + s * frame[3, i])
            workspace.z_sizes[i, k] = abs(c * frame[3, i] - s * frame[2, i])


@merged
def _rank(box, palm, workspace):
    """Number that is lower for nodes that are searched earlier: these usually block more angles.

    For the palm it decreases with the distance from x, for other parts it is the squared distance
    from the nearer one of the contact planes' middles.
    """
    frame, parts = workspace.frame, workspace.parts
    x, square = 0.0, 0.0
    for k in range(3):
        d = box[k] - frame[0, k]
        x += frame[1, k] * d
        square += d * d
    if palm:
        return abs(math.sqrt(square - x * x) + parts[PALM, TOP] - parts[PALM, HALF_WIDTH])
    inner = min(abs(parts[FINGER_2, LOW]), abs(parts[FINGER_2, HIGH]))
    return square - x * x + (abs(x) - inner) ** 2


@part
def block_angles(blocked, farther, back, tree, workspace):
    """Add the angles at which a part meets the surface to a mask.

    At angle t the approach direction is z cos t - y sin t, and y turns into y cos t + z sin t.

    Args:
        blocked: Mask of angles that need not be tested.
        farther: The same for a gripper that is farther back.
        back: How far; 0 unless the approach is swept, and for round tips.
        tree: `BoxTree`.
        workspace: `ReachWorkspace` with its frame, sizes and parts.

    Returns:
        (mask of all angles that are blocked, mask of those found to be blocked farther back too):
        the second one may lack angles of the first one.
    """
    blocked, farther = _block_by(True, blocked, farther, back, tree, workspace)  # noqa: FBT003
    return _block_by(False, blocked, farther, back, tree, workspace)  # noqa: FBT003


@part
def _block_by(palm, blocked, farther, back, tree, workspace):
    """`block_angles` by the palm, or by the other parts."""
    masks, found = workspace.masks, workspace.blocked
    found[0], found[1] = blocked, farther
    # What blocked an angle of the grasp before blocks it at a similar grasp too.
    masks[0] = all_angles(workspace.cosines.shape[0])
    recent = workspace.recent[1 if palm else 0]
    for k in range(workspace.cosines.shape[0]):
        if recent[k] >= 0 and found[0] & bit(k) == NONE:
            met, back_too, _ = _block_at(
                recent[k], masks[0] & ~found[0], back, palm, tree, workspace
            )
            found[0] |= met
            found[1] |= back_too
    walk(_visit, (palm, back, tree, workspace), workspace.nodes)
    return found[0], found[1]


@merged
def _visit(node, position, _stale, state):
    """Visit a node of the tree; the walk ends where all angles are blocked."""
    palm, back, tree, workspace = state
    masks, found = workspace.masks, workspace.blocked
    possible = masks[position] & ~found[0]
    if possible == NONE:
        return NO_NODE, NO_NODE, GO_ON
    met, back_too, possible = _block_at(node, possible, back, palm, tree, workspace)
    if met != NONE:
        found[0] |= met
        found[1] |= back_too
        for k in range(workspace.cosines.shape[0]):
            if met & bit(k) != NONE:
                workspace.recent[1 if palm else 0, k] = node
    if found[0] == all_angles(workspace.cosines.shape[0]):
        return NO_NODE, NO_NODE, STOP
    later, sooner = below(node, tree.depth)
    if later == NO_NODE or possible == NONE:
        return NO_NODE, NO_NODE, GO_ON
    masks[position] = masks[position + 1] = possible
    if _rank(tree.boxes[later], palm, workspace) < _rank(tree.boxes[sooner], palm, workspace):
        later, sooner = sooner, later
    return later, sooner, GO_ON


@part
def _block_at(node, possible, back, palm, tree, workspace):
    """Test the possible angles at a node.

    Returns:
        (mask of those that it blocks, mask of those that it blocks farther back too, mask of those
        at which nodes below it may block).
    """
    may_meet, within = _possible_angles(tree.boxes[node], back, palm, workspace)
    blocked = within & possible
    farther = blocked
    possible &= may_meet & ~within
    if possible != NONE:
        first, last = leaf_rows(node, tree)
        for i in range(first, last):
            met, back_too = _blocked_by_face(
                tree.triangles[i], possible & ~blocked, back, palm, workspace
            )
            blocked, farther = blocked | met, farther | back_too
    return blocked, farther, possible
