"""Approach angles at which parts of a gripper meet a surface, and those that are free.

The closing axis x is fixed; the approach direction turns about it. Each part is a box, swept
backward along the approach direction if its bottom is -inf; round tips are cylinders that end in
balls. A face meets a box if its part between the box's two planes across x, seen along x, meets a
rotating rectangle. These tests take place in the plane and are exact up to rounding.

Up to 64 angles are the bits of a mask. The angle at which a similar grasp is free comes first and
often suffices. Points of the surface inside a box then block most other angles. Each angle left is
tested alone, by one traversal of the tree; a face that is met there blocks further angles.
"""

import math

import numpy as np

from grasp3d._kernels.compiling import merged, part
from grasp3d._kernels.jaws.gripper_parts import (
    AXIS,
    BOTTOM,
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
    widest_arc,
)
from grasp3d._kernels.surface.box_tree import HEIGHT, NORMAL, RADIUS, THICKNESS, leaf_rows
from grasp3d._kernels.surface.face_tree import GO_ON, NO_NODE, STOP, below, walk
from grasp3d._kernels.surface.vectors import copy, difference, dot, triple

POINTS = 256
"""Number of face corners, spread over the surface, that are tested at all angles at once."""

INSIDE = 1e-12
"""Depth inside a part beyond which such a point is inside despite rounding."""


@part
def _clip(source, count, axis, bound, sign, target):
    """Clip a polygon to sign * (coordinate - bound) <= 0; return its new number of corners."""
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
def _meets_box(polygon, count, c, s, half, bottom, top):
    """Whether a polygon, seen along x, meets a rectangle rotated by an angle."""
    least, largest = math.inf, -math.inf
    y0 = c * polygon[count - 1, 1] + s * polygon[count - 1, 2]
    z0 = c * polygon[count - 1, 2] - s * polygon[count - 1, 1]
    for i in range(count):
        y1 = c * polygon[i, 1] + s * polygon[i, 2]
        z1 = c * polygon[i, 2] - s * polygon[i, 1]
        if -half <= y1 <= half:
            least, largest = min(least, z1), max(largest, z1)
        # The extremes within the strip are at corners or where edges cross its borders.
        if (y0 < -half) != (y1 < -half):
            z = z0 + (-half - y0) / (y1 - y0) * (z1 - z0)
            least, largest = min(least, z), max(largest, z)
        if (y0 > half) != (y1 > half):
            z = z0 + (half - y0) / (y1 - y0) * (z1 - z0)
            least, largest = min(least, z), max(largest, z)
        if least <= top and largest >= bottom:
            return True
        y0, z0 = y1, z1
    return False


@merged
def _edge_distance(x, y, dx, dy, px):
    """Squared distance of (px, 0) from the edge that starts at (x, y) with the vector (dx, dy)."""
    square = dx * dx + dy * dy
    t = ((px - x) * dx - y * dy) / square if square > 0.0 else 0.0
    t = min(max(t, 0.0), 1.0)
    return (x + t * dx - px) ** 2 + (y + t * dy) ** 2


@part
def _meets_cylinder(corners, c, s, part):
    """Whether a face meets the cylinder behind a round tip at either position or between them."""
    radius, top = part[HALF_WIDTH], part[TOP]
    low, high = min(part[AXIS], part[OUTER_AXIS]), max(part[AXIS], part[OUTER_AXIS])
    least, positive, negative, count = math.inf, False, False, 0
    last_x, last_y, first_x, first_y = 0.0, 0.0, 0.0, 0.0
    # The corners of the face clipped to z <= top, with the first one repeated at the end.
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
    """Whether an interval along x meets that of a part."""
    return low <= part[HIGH] and high >= part[LOW] and part[LOW] <= part[HIGH]


@merged
def _interval(box, frame, x):
    """Bounds along x of the faces of a node whose box is centred at x."""
    one, two, three = frame[1, 0], frame[1, 1], frame[1, 2]
    size = abs(one) * box[3] + abs(two) * box[4] + abs(three) * box[5]
    # The slab across the mean normal is thin along x where that normal is nearly along x.
    nx, ny, nz = box[NORMAL], box[NORMAL + 1], box[NORMAL + 2]
    along = one * nx + two * ny + three * nz
    across = math.sqrt(
        (two * nz - three * ny) ** 2 + (three * nx - one * nz) ** 2 + (one * ny - two * nx) ** 2
    )
    middle = x + along * box[HEIGHT]
    half = abs(along) * box[THICKNESS] + across * box[RADIUS]
    return max(x - size, middle - half), min(x + size, middle + half)


@merged
def _turn_face(triangle, workspace):
    """Write a face as x, y and z at angle 0; return its bounds along x."""
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
def _blocked_by_face(triangle, possible, workspace):
    """Mask of the possible angles at which a face meets a part."""
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
    blocked = NONE
    for i in range(PARTS):
        part = parts[i]
        if not _overlaps(part, low, high) or reach < -part[TOP]:
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
            if possible & ~blocked & bit(k) == NONE:
                continue
            c, s = cosines[k], sines[k]
            along = c * z - s * y
            if abs(c * y + s * z) > half or along > top or along < bottom:
                continue
            if i < TIP_1:
                meets = _meets_box(polygon, count, c, s, part[HALF_WIDTH], part[BOTTOM], part[TOP])
            else:
                meets = _meets_cylinder(corners, c, s, part)
            if meets:
                blocked |= bit(k)
    return blocked


@part
def _blocked_by_points(blocked, everything, tree, workspace):
    """Add the angles at which sampled corners of faces are inside a box to a mask."""
    frame, parts = workspace.frame, workspace.parts
    cosines, sines = workspace.cosines, workspace.sines
    rows = tree.triangles.shape[0]
    step = max(rows // POINTS, 1)
    for number in range((rows - 1) // step + 1):
        if blocked == everything:
            break
        row = number * step
        point = difference(tree.triangles[row], frame[0])
        x, y, z = dot(point, frame[1]), dot(point, frame[2]), dot(point, frame[3])
        square = y * y + z * z
        for j in range(PALM + 1):
            half, top = parts[j, HALF_WIDTH] - INSIDE, parts[j, TOP] - INSIDE
            bottom = parts[j, BOTTOM] + INSIDE
            if not parts[j, LOW] + INSIDE < x < parts[j, HIGH] - INSIDE:
                continue
            if top < 0.0 and square < top * top:
                continue  # in front of the box at every angle
            for k in range(cosines.shape[0]):
                c, s = cosines[k], sines[k]
                across, along = abs(c * y + s * z), c * z - s * y
                inside = (across < half) & (along < top) & (along > bottom)
                blocked |= np.uint64(inside) << np.uint64(k)
    return blocked


@merged
def _may_meet(box, workspace):
    """Whether the faces of a node may meet a part at the angle of the axes."""
    axes, parts = workspace.axes, workspace.parts
    centre, sizes = difference(box, workspace.frame[0]), triple(box, 3)
    x, y, z = dot(centre, axes[0]), dot(centre, axes[1]), dot(centre, axes[2])
    low, high = _interval(box, workspace.frame, x)
    across = abs(y) - dot(sizes, axes[4])
    depth = dot(sizes, axes[5])
    first, last = z - depth, z + depth
    normal = dot(triple(box, NORMAL), axes[2])
    sloping = math.sqrt(max(1.0 - normal * normal, 0.0) + 1e-15) * box[RADIUS]
    first = max(first, z + normal * box[HEIGHT] - abs(normal) * box[THICKNESS] - sloping)
    for i in range(PARTS):
        beside = not _overlaps(parts[i], low, high) or across > parts[i, HALF_WIDTH]
        if not beside and first <= parts[i, TOP] and last >= parts[i, BOTTOM]:
            return True
    return False


@merged
def _visit(node, _position, _stale, state):
    """Visit a node of the tree; end the walk at a face that meets a part."""
    k, tree, workspace = state
    if not _may_meet(tree.boxes[node], workspace):
        return NO_NODE, NO_NODE, GO_ON
    first, last = leaf_rows(node, tree)
    for i in range(first, last):
        if _blocked_by_face(tree.triangles[i], bit(k), workspace) != NONE:
            workspace.last[0] = i
            return NO_NODE, NO_NODE, STOP
    later, sooner = below(node, tree.depth)
    return later, sooner, GO_ON


@part
def is_free_at(k, tree, workspace):
    """Whether no face meets a part at an angle; if one does, write its row to `workspace.last`."""
    frame, axes = workspace.frame, workspace.axes
    c, s = workspace.cosines[k], workspace.sines[k]
    copy(frame[1], axes[0])
    for i in range(3):
        axes[1, i] = c * frame[2, i] + s * frame[3, i]
        axes[2, i] = c * frame[3, i] - s * frame[2, i]
        for j in range(3):
            axes[3 + j, i] = abs(axes[j, i])
    return not walk(_visit, (k, tree, workspace), workspace.nodes)


@part
def free_angles(blocked, one, tree, workspace):
    """Mask of the angles at which no face meets a part.

    At angle t the approach direction is z cos t - y sin t, and y turns into y cos t + z sin t.

    Args:
        blocked: Mask of the angles that are not allowed.
        one: Whether a single free angle is enough.
        tree: `BoxTree`.
        workspace: `ReachWorkspace` with its frame and parts.
    """
    count, last, free = workspace.cosines.shape[0], workspace.last, NONE
    everything, compared = all_angles(count), False
    while blocked | free != everything:
        k = last[1]  # of a similar grasp
        if (blocked | free) & bit(k) != NONE:
            if not compared:
                blocked = _blocked_by_points(blocked, everything, tree, workspace)
                compared = True
                continue
            k, _ = widest_arc(everything & ~(blocked | free), count)
        if is_free_at(k, tree, workspace):
            free, last[1] = free | bit(k), k
            if one:
                break
        else:
            met = tree.triangles[last[0]]
            blocked |= bit(k) | _blocked_by_face(met, everything & ~blocked, workspace)
    return free
