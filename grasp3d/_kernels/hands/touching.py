"""Gaps between the links of a hand and an object, and one contact per link.

The deepest point of a link's shape in an object is found by climbing along the distance from the
object's surface. In a convex object depth is concave, so a climb ends at the deepest point. In
others, climbs start from several points of the shape to reach different ridges of the depth.
"""

import math
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.compiling import Floats1, Floats2, Floats3, Ints1, kernel, merged, part
from grasp3d._kernels.hands.kinematics import compose, moved, moved_back, turned, turned_back
from grasp3d._kernels.hands.link_shapes import (
    COARSE,
    EVEN,
    HULL,
    NEAR,
    LinkShapes,
    ShapeScratch,
    box_distance,
    core_distance,
    make_shape_scratch,
    nearest_in_shape,
    point_depth,
    radius_of,
    shape_distance,
    support,
)
from grasp3d._kernels.hands.touched_surface import (
    faces_away,
    inward_at,
    is_inside,
    least_distance,
    nearest_triangle,
    nearest_weights,
    point_of,
    side_of,
)
from grasp3d._kernels.surface.box_tree import RADIUS, leaf_rows
from grasp3d._kernels.surface.face_tree import STACK, below
from grasp3d._kernels.surface.vectors import (
    combined,
    copy,
    difference,
    divided,
    dot,
    norm,
    squared_distance,
    triple,
)

ALONG, DEPTH, WEIGHT, ROW = 3, 6, 7, 8
"""Columns of a piece after its point: unit vector along which depth grows, depth, and weight; and
the number of columns."""

PIECES = 5
"""Points around a ridge that predict the depth there, and one that is tried."""

FAR = 1e3
"""Longest step [m]: where depth grows evenly, one step reaches the end."""

SHORT = 0.1
"""Longest step along a ridge [m], as the weights of its sides have limited precision."""

DEEP = 0.002
"""Depth [m] from which a climb along a ridge may end only after a long step."""

CLIMBS, STARTS = 24, 6
"""Most steps in a climb, and most climbs in a shape."""

CLOSE, SMALL = 1e-3, 1e-5
"""Rise of depth at which a climb ends, relative to the depth and in metres."""

BISECTIONS = 14
"""Most bisections of the weight of a piece."""


@part
def look(p, reach, row, surface, scratch):
    """Write a piece, a point in the object's frame with its depth, and return the depth.

    Where the surface is farther away than `reach`, the depth is -reach.
    """
    slot, square = nearest_triangle(p, reach * reach, surface, scratch.nodes, scratch.bounds)
    copy(p, row)
    row[DEPTH] = -reach
    if slot >= 0:
        triangle = surface.tree.triangles[slot]
        weights = nearest_weights(p, triangle)
        row[DEPTH] = math.sqrt(square)
        if not is_inside(p, slot, weights, surface):
            row[DEPTH] = -row[DEPTH]
        x, y, z = triple(surface.outward[slot], 0)
        if abs(row[DEPTH]) < EVEN:
            copy((-x, -y, -z), row[ALONG:])
        else:
            copy(divided(difference(p, point_of(weights, triangle)), row[DEPTH]), row[ALONG:])
    return row[DEPTH]


@merged
def _foreseen(row, p):
    """Depth of a point as a piece predicts it."""
    return row[DEPTH] + dot(triple(row, ALONG), difference(p, row))


@part
def _go(i, count, step, shapes, scratch):
    """Write the shape's point nearest to a step from the first piece along the weighted mean."""
    pieces = scratch.pieces
    target = triple(pieces[0], 0)
    for a in range(count):
        target = combined(1.0, target, step * pieces[a, WEIGHT], triple(pieces[a], ALONG))
    if count == 1 and step == FAR and shapes.kinds[i] == HULL:
        x, y, z = turned_back(scratch.pose, triple(pieces[0], ALONG))
        box, at = shapes.boxes[i], scratch.shape.at
        p = support(HULL, shapes.sizes[i], box, shapes.hull, at, 1.0, x, y, z)
        copy(moved(scratch.pose, p), scratch.trial)
        return
    p = nearest_in_shape(
        moved_back(scratch.pose, target), shapes.kinds[i], shapes.sizes[i], shapes.boxes[i],
        shapes.hull, scratch.shape,
    )  # fmt: skip
    copy(moved(scratch.pose, p), scratch.trial)


@part
def _foresee(i, count, step, shapes, scratch):
    """Write the point where the least predicted depth is largest; return the rise of depth."""
    pieces = scratch.pieces
    step = min(step, SHORT) if count > 1 else step
    enough = 0.2 * (SMALL + CLOSE * abs(pieces[0, DEPTH]))
    for a in range(count):
        pieces[a, WEIGHT] = 1.0 if a == 0 else 0.0
    _go(i, count, step, shapes, scratch)
    least = _foreseen(pieces[0], scratch.trial)
    for _ in range(2 * count - 2):
        low, high, most = 0, 0, -math.inf
        least = math.inf
        for a in range(count):
            depth = _foreseen(pieces[a], scratch.trial)
            if depth < least:
                low, least = a, depth
            if pieces[a, WEIGHT] > 0.0 and depth > most:
                high, most = a, depth
        if most - least <= enough:
            break
        both, begin, end = pieces[low, WEIGHT] + pieces[high, WEIGHT], 0.0, pieces[high, WEIGHT]
        for _ in range(BISECTIONS):
            share = 0.5 * (begin + end)
            pieces[high, WEIGHT], pieces[low, WEIGHT] = share, both - share
            _go(i, count, step, shapes, scratch)
            least = _foreseen(pieces[low], scratch.trial)
            most = _foreseen(pieces[high], scratch.trial)
            if abs(most - least) <= enough:
                break
            if least < most:
                end = share
            else:
                begin = share
        least = min(least, most)
    return least - pieces[0, DEPTH]


@part
def _climb(i, shapes, surface, scratch):
    """Climb from the first piece to the deepest point nearby, which becomes the first piece.

    A step ends where depth is predicted to be largest, given its curvature between the last two
    points. Two steps too far in a row indicate a ridge: the piece beyond it is then kept, too.
    """
    pieces, count, step, missed = scratch.pieces, 1, FAR, 0
    for _ in range(CLIMBS):
        rise = _foresee(i, count, step, shapes, scratch)
        if rise <= SMALL + CLOSE * abs(pieces[0, DEPTH]):
            if count == 1 or step >= SHORT or pieces[0, DEPTH] < DEEP:
                break
            step = SHORT  # short steps rise little
            continue
        new, old = pieces[count], pieces[0]
        p = triple(scratch.trial, 0)
        look(p, least_distance(p, surface)[1], new, surface, scratch)
        way = difference(new, old)
        square = dot(way, way)
        bend = dot(way, difference(triple(old, ALONG), triple(new, ALONG)))
        if new[DEPTH] > old[DEPTH]:
            for k in range(ROW):
                new[k], old[k] = old[k], new[k]
            step, missed = (square / bend if bend * FAR > square else FAR), 0
        else:
            step, missed = min(0.5 * step, square / max(bend, square / FAR)), missed + 1
        if missed > 1 or count > 1:
            count += 1
        a = 1
        while a < count:  # drop pieces where the surface is concave
            if _foreseen(pieces[a], pieces[0]) < pieces[0, DEPTH] - SMALL or (
                count == PIECES and pieces[a, WEIGHT] == 0.0
            ):
                count -= 1
                for k in range(ROW):
                    pieces[a, k] = pieces[count, k]
            else:
                a += 1
        if count == PIECES:
            count -= 1
    return pieces[0, DEPTH]


@part
def deepest(i, first, lows, shapes, surface, scratch):
    """Depth of the deepest point of a shape in an object; writes the point to `scratch.deepest`.

    Args:
        i: The shape.
        first: Sample from which to begin, already in the first piece.
        lows: Lower bounds of the signed distances of the shape's samples.
        shapes: `LinkShapes`.
        surface: `TouchedSurface`.
        scratch: `TouchScratch`.
    """
    found, best, climbs = scratch.deepest, _climb(i, shapes, surface, scratch), 1
    for k in range(ROW):
        found[k] = scratch.pieces[0, k]
    start = shapes.first_sample[i]
    for j in range(start, shapes.first_sample[i + 1]):
        if j == first or lows[j - start] > -best or climbs == STARTS:
            continue
        p, row = moved(scratch.pose, shapes.samples[j]), scratch.pieces[0]
        depth = look(p, least_distance(p, surface)[1], row, surface, scratch)
        # Where depth is concave, every point predicts at least the depth of the deepest one.
        if depth > best or (depth > 0.0 and _foreseen(row, found) < (1.0 - 0.02) * best):
            climbs += 1
            depth = _climb(i, shapes, surface, scratch)
            if depth > best:
                best = depth
                for k in range(ROW):
                    found[k] = scratch.pieces[0, k]
    return best


ANY_SIDE, ONE_SIDE = -2.0, math.cos(math.radians(40.0))
"""Cosine of the angle up to which normals count as on the same side."""

CANCELS = 0.5
"""Length of the mean of unit normals below which they belong to opposite sides."""

CREASE = math.cos(math.radians(20.0))
"""Cosine of an edge's angle beyond which the points nearest to it belong to both sides."""

FACING = 0.4
"""Least cosine between the outward normal of a link and the inward normal of what it touches. This
excludes the far side of a wall and what lies beside a link."""

EQUAL = 1e-9
"""Difference of gaps [m] that does not matter."""

DEEPER = 1.01
"""Factor by which the surface must be deeper in a link than the link in the object to give the
gap."""

FAN, SIDES = 16, 4
"""Most faces examined around a vertex, and most sides to which a point belongs."""

GAP, NORMAL, POINT, COLUMNS = 0, 1, 4, 7
"""Columns of `TouchScratch.near`: signed distance, inward normal and nearest point of the surface;
and the number of columns."""


class Touches(NamedTuple):
    """What `touch` writes, in the object's frame [m]; k poses, m shapes, L links."""

    gaps: Floats2
    """Signed distance of each shape; negative for a depth, inf if beyond the search (k, m)."""
    points: Floats3
    """The point of the surface at that distance (k, m, 3)."""
    contacts: Floats3
    """Contact of each link: point on the surface, inward unit normal, signed distance of the link's
    shapes from the point; nan if the link does not touch (k, L, 7). With L = 0 no contacts are
    found."""


class TouchScratch(NamedTuple):
    """Arrays of one thread."""

    shape: ShapeScratch
    nodes: Ints1
    bounds: Floats1
    pose: Floats2
    """Transform from the frame of a shape to that of the object (3, 4)."""
    triangle: Floats1
    """A triangle in the shape's frame (9,)."""
    point: Floats1
    """The surface's nearest point so far (3,)."""
    direction: Floats1
    pieces: Floats2
    """Points of a shape with their depths (PIECES, ROW)."""
    deepest: Floats1
    """The deepest point found (ROW,)."""
    trial: Floats1
    """The point that is tried next (3,)."""
    start: Floats1
    """Search direction for the next triangle, in the shape's frame (3,)."""
    lows: Floats1
    """Lower bounds of the signed distances of the points of a link (s,)."""
    near: Floats2
    """Points of a link that are near the surface (n, COLUMNS)."""


def make_touch_scratch(shapes: LinkShapes) -> TouchScratch:
    """Allocate the arrays of one thread."""
    samples = np.diff(shapes.first_sample)
    most = int(np.bincount(shapes.links, samples).max(initial=0))
    one, two, three, four = np.zeros((4, 3))
    return TouchScratch(
        make_shape_scratch(), np.zeros(STACK, np.int64), np.zeros(STACK), np.zeros((3, 4)),
        np.zeros(9), one, two, np.zeros((PIECES, ROW)), np.zeros(ROW), four, three, np.zeros(most),
        np.zeros((4 * most + 4, COLUMNS)),
    )  # fmt: skip


@merged
def _node_bound(node, kind, size, box, planes, flat, surface, scratch):
    """Lower bound of the signed distance of a shape from the triangles of a node."""
    row, n = surface.boxes[node], scratch.direction
    middle = moved_back(scratch.pose, row)
    bound = (
        box_distance(middle, box) if kind == HULL else point_depth(middle, kind, size, box, planes)
    )
    # Distance beyond the plane through the shape's point nearest so far.
    tall = abs(n[0]) * row[3] + abs(n[1]) * row[4] + abs(n[2]) * row[5]
    return max(bound - row[RADIUS], flat - dot(n, row) - tall)


@part
def _flat(kind, size, box, hull, along, scratch):
    """Write a direction (in the shape's frame) in the object's; return the shape's least height."""
    length = norm(along)
    x, y, z = divided(along, length) if length > 0.0 else (0.0, 0.0, 1.0)
    p = support(kind, size, box, hull, scratch.shape.at, 1.0, -x, -y, -z)
    n = turned(scratch.pose, (x, y, z))
    copy(n, scratch.direction)
    return dot(n, moved(scratch.pose, p)) - radius_of(kind, size)


@part
def _surface_distance(i, limit, shapes, surface, scratch):
    """Signed distance of a shape from the triangles, inf beyond the limit; writes its point.

    -inf if a box, a cylinder or a hull overlaps a solid's surface although the limit is positive.
    """
    kind, size, box = shapes.kinds[i], shapes.sizes[i], shapes.boxes[i]
    planes = shapes.planes[shapes.first_plane[i] : shapes.first_plane[i + 1]]
    pose, shape, triangle = scratch.pose, scratch.shape, scratch.triangle
    start = scratch.start
    nodes, bounds, tree = scratch.nodes, scratch.bounds, surface.tree
    best, found = limit, False
    flat = _flat(kind, size, box, shapes.hull, start, scratch)
    nodes[0], bounds[0], top = 0, -math.inf, 1
    while top > 0:
        top -= 1
        if bounds[top] >= best - EQUAL:
            continue
        node = nodes[top]
        first, last = leaf_rows(node, tree)
        for j in range(first, last):
            highest, n = -math.inf, scratch.direction
            for c in range(3):
                highest = max(highest, dot(n, triple(tree.triangles[j], 3 * c)))
            if flat - highest >= best - EQUAL:
                continue
            for c in range(3):
                p = moved_back(pose, triple(tree.triangles[j], 3 * c))
                triangle[3 * c], triangle[3 * c + 1], triangle[3 * c + 2] = p
            copy(start, shape.guess)
            gap = shape_distance(
                kind, size, box, shapes.hull, planes, triangle, best - EQUAL, shape
            )
            if gap <= 0.0 and limit > NEAR and surface.closed and radius_of(kind, size) == 0.0:
                return -math.inf
            if gap < best:
                best, found = gap, True
                copy(shape.guess, start)
                copy(moved(pose, shape.on_face), scratch.point)
                flat = _flat(kind, size, box, shapes.hull, start, scratch)
        one, other = below(node, tree.depth)
        if one < 0:
            continue
        near = _node_bound(one, kind, size, box, planes, flat, surface, scratch)
        far = _node_bound(other, kind, size, box, planes, flat, surface, scratch)
        if near > far:
            one, other, near, far = other, one, far, near
        if far < best:
            nodes[top], bounds[top] = other, far
            top += 1
        if near < best:
            nodes[top], bounds[top] = one, near
            top += 1
    return best if found else math.inf


@part
def shape_gap(i, start, search, shapes, surface, scratch):
    """Signed distance of a shape at its pose from the object; writes the surface point of it.

    Unless the shape is far away, also write bounds of its samples' distances to `lows`.
    """
    kind, box = shapes.kinds[i], shapes.boxes[i]
    if shapes.first_sample[i] == shapes.first_sample[i + 1]:
        return math.inf  # the shape lies inside other shapes of its link
    scratch.shape.at[0] = shapes.hull.at[i]
    middle = moved(scratch.pose, box)
    if least_distance(middle, surface)[0] - box[6] >= search:
        return math.inf
    lows, nearest, limit, low = scratch.lows, -1, search, -math.inf
    for j in range(shapes.first_sample[i], shapes.first_sample[i + 1]):
        if nearest >= 0:  # bounded by that of the previous sample and the distance from it
            low -= math.sqrt(squared_distance(shapes.samples[j], shapes.samples[j - 1]))
            lows[j - start] = low
            if low > 0.5 * search:
                continue
        low, most = least_distance(moved(scratch.pose, shapes.samples[j]), surface)
        lows[j - start] = low
        limit = min(limit, most)
        if nearest < 0 or low < lows[nearest - start]:
            nearest = j
    rounded, depth, gap = radius_of(kind, shapes.sizes[i]) > 0.0, -math.inf, math.inf
    copy(turned_back(scratch.pose, difference(middle, surface.box)), scratch.start)
    if nearest >= 0:
        p = moved(scratch.pose, shapes.samples[nearest])
        reach = least_distance(p, surface)[1] if lows[nearest - start] < 0.0 else limit
        depth = look(p, reach, scratch.pieces[0], surface, scratch)
        limit = min(limit, abs(depth))
        _begin_against(scratch.pieces[0], scratch)
    inside, least = depth > 0.0 and not rounded, math.inf
    if not inside:
        least = _surface_distance(i, limit + 2.0 * EQUAL, shapes, surface, scratch)
    # A ball or capsule is never deeper than the surface is in it, unless its core is inside.
    if (
        surface.closed
        and nearest >= 0
        and (least < 0.0 or depth > 0.0)
        and (
            not rounded
            or least < EQUAL - shapes.sizes[i, 0]
            or _core_inside(i, shapes, surface, scratch)
        )
    ):
        own = lows[shapes.first_sample[i] - start :]
        gap = -deepest(i, nearest, own, shapes, surface, scratch)
        if not rounded:
            _begin_against(scratch.deepest, scratch)
            limit = min(DEEPER * gap, NEAR)
            least = _surface_distance(i, limit, shapes, surface, scratch)
    if least < DEEPER * gap or gap == math.inf:
        return least
    row = scratch.deepest
    copy(combined(1.0, row, -row[DEPTH], triple(row, ALONG)), scratch.point)
    return gap


@merged
def _begin_against(row, scratch):
    """Set the first search direction: away from the surface at a piece."""
    x, y, z = turned_back(scratch.pose, triple(row, ALONG))
    copy((-x, -y, -z), scratch.start)


@part
def _core_inside(i, shapes, surface, scratch):
    """Whether an end or the middle of the core of a capsule or a ball may be inside."""
    least, half = math.inf, shapes.sizes[i, 1]
    for j in range(-1, 2):
        least = min(least, least_distance(moved(scratch.pose, (0.0, 0.0, j * half)), surface)[0])
    return least < 0.0


@part
def _add_near(outward, slot, weights, gap, count, surface, scratch):
    """Add a point near the surface, once for each side it belongs to.

    Returns:
        The new number of points.
    """
    near, first, side = scratch.near, count, side_of(weights)
    position = point_of(weights, surface.tree.triangles[slot])
    current, n = slot, inward_at(slot, weights, surface)
    for step in range(FAN):
        known = False
        for i in range(first, count):
            known = known or dot(n, triple(near[i], NORMAL)) > CREASE
        if not known and dot(outward, n) >= FACING and count < first + SIDES:
            row = near[count]
            row[GAP] = gap
            for k in range(3):
                row[NORMAL + k], row[POINT + k] = n[k], position[k]
            count += 1
        if side == 0 or (side < 4 and step == 1):
            break
        if side < 4:  # across the edge; both of its ends have similar normals
            edge, vertex = side - 1, surface.corners[slot, side % 3]
        else:  # around the vertex
            vertex = surface.corners[slot, side - 4]
            edge = (_corner(current, vertex, surface) + 1) % 3
        current = surface.across[current, edge]
        if current < 0 or current == slot:
            break
        n = triple(surface.inward[current], 3 * _corner(current, vertex, surface))
    return count


@merged
def _corner(triangle, vertex, surface):
    """Index of the corner of a triangle at a vertex."""
    corners = surface.corners[triangle]
    return 0 if corners[0] == vertex else (1 if corners[1] == vertex else 2)


@part
def _near_points(i, start, distance, count, shapes, surface, scratch):
    """Add the samples of a shape that are near the surface; return the new number of points."""
    for j in range(shapes.first_sample[i], shapes.first_sample[i + 1]):
        if scratch.lows[j - start] > distance:
            continue
        p = moved(scratch.pose, shapes.samples[j])
        outward = turned(scratch.pose, triple(shapes.samples[j], 3))
        if faces_away(p, outward, surface):
            continue
        most = min(least_distance(p, surface)[1], distance)
        slot, square = nearest_triangle(p, most * most, surface, scratch.nodes, scratch.bounds)
        if slot < 0:
            continue
        weights = nearest_weights(p, surface.tree.triangles[slot])
        gap = math.sqrt(square)
        if is_inside(p, slot, weights, surface):
            gap = -gap
        count = _add_near(outward, slot, weights, gap, count, surface, scratch)
    return count


@part
def _gap_at(p, first, last, frame, shapes, scratch):
    """Signed distance of a link's shapes from a point."""
    least = math.inf
    for i in range(first, last):
        compose(frame, shapes.poses[i], scratch.pose)
        q = moved_back(scratch.pose, p)
        kind, size, box = shapes.kinds[i], shapes.sizes[i], shapes.boxes[i]
        if box_distance(q, box) >= least:
            continue
        first_plane = shapes.first_plane[i]
        planes = shapes.planes[first_plane : min(first_plane + COARSE, shapes.first_plane[i + 1])]
        gap = point_depth(q, kind, size, box, planes)
        if kind == HULL and gap > 0.0:
            for c in range(3):
                copy(q, scratch.triangle[3 * c :])
            scratch.shape.at[0] = shapes.hull.at[i]
            gap = core_distance(
                kind, size, box, shapes.hull, 1.0, scratch.triangle, math.inf, scratch.shape
            )
        least = min(least, gap)
    return least


@part
def _write_contact(count, first, last, frame, shapes, surface, row, scratch):
    """Write a link's contact: the mean of its points near the surface, projected onto the surface.

    Where their normals cancel, as on both sides of a thin edge, only the nearest side counts.

    Args:
        count: Number of points near the surface; if 0, the point already in the row is used.
        first: The link's first shape.
        last: One past the link's last shape.
        frame: Transform from the frame of the link to that of the object.
        shapes: `LinkShapes`.
        surface: `TouchedSurface`.
        row: The contact, as in `Touches`.
        scratch: `TouchScratch`.
    """
    near, nearest, length = scratch.near, 0, 0.0
    for i in range(1, count):
        nearest = i if near[i, GAP] < near[nearest, GAP] else nearest
    side = triple(near[nearest], NORMAL)
    for least in (ANY_SIDE, ONE_SIDE):
        if length >= CANCELS * count:  # always true without points
            break
        members, length = 0, 0.0
        for k in range(6):
            row[k] = 0.0
        for i in range(count):
            if dot(side, triple(near[i], NORMAL)) >= least:
                members += 1
                for k in range(3):
                    row[k] += near[i, POINT + k]
                    row[3 + k] += near[i, NORMAL + k]
        for k in range(3):
            row[k] /= members
        length = norm(triple(row, 3))
    slot, _ = nearest_triangle(triple(row, 0), math.inf, surface, scratch.nodes, scratch.bounds)
    weights = nearest_weights(triple(row, 0), surface.tree.triangles[slot])
    copy(point_of(weights, surface.tree.triangles[slot]), row)
    mean = divided(triple(row, 3), length) if count > 0 else inward_at(slot, weights, surface)
    copy(mean, row[3:])
    row[6] = _gap_at(triple(row, 0), first, last, frame, shapes, scratch)


@kernel("Floats4, float, float, int, int, LinkShapes, TouchedSurface, Touches, TouchScratch")
def touch(frames, distance, search, begin, end, shapes, surface, touches, scratch):
    """Find the gaps between links and an object, and their contacts.

    Args:
        frames: Transforms from the frames of the links to that of the object [m] (k, L, 3, 4).
        distance: Contact distance [m].
        search: Largest gap to find [m], at least the contact distance.
        begin: First pose.
        end: One past the last pose.
        shapes: `LinkShapes`.
        surface: `TouchedSurface`.
        touches: `Touches`, written.
        scratch: `TouchScratch`.
    """
    for pose in range(begin, end):
        first = 0
        while first < shapes.kinds.shape[0]:
            link, last = shapes.links[first], first
            while last < shapes.kinds.shape[0] and shapes.links[last] == link:
                last += 1
            frame, nearest = frames[pose, link], first
            gaps, start = touches.gaps[pose], shapes.first_sample[first]
            for i in range(first, last):
                compose(frame, shapes.poses[i], scratch.pose)
                gaps[i] = shape_gap(i, start, search, shapes, surface, scratch)
                copy(scratch.point, touches.points[pose, i])
                nearest = i if gaps[i] < gaps[nearest] else nearest
            if touches.contacts.shape[1] > 0 and gaps[nearest] <= distance:
                contact, count = touches.contacts[pose, link], 0
                for i in range(first, last):
                    if gaps[i] <= distance:
                        compose(frame, shapes.poses[i], scratch.pose)
                        count = _near_points(i, start, distance, count, shapes, surface, scratch)
                # Without points the link is deep inside, or only surfaces that face away are near.
                copy(touches.points[pose, nearest], contact)
                _write_contact(count, first, last, frame, shapes, surface, contact, scratch)
            first = last
