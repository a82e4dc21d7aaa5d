"""The deepest point of a link's shape inside an object: climbs along the distance from its surface.

Inside a convex object depth is concave: a climb ends at the deepest point. Elsewhere climbs from
several points of the shape tell its ridges apart.
"""

import math

from grasp3d._kernels.compiling import merged, part
from grasp3d._kernels.hands.link_shapes import EVEN, HULL, nearest_in_shape, support
from grasp3d._kernels.hands.rigid_motions import moved, moved_back, turned_back
from grasp3d._kernels.hands.touched_surface import (
    is_inside,
    least_distance,
    nearest_triangle,
    nearest_weights,
    point_of,
)
from grasp3d._kernels.surface.vectors import combined, copy, difference, divided, dot, triple

ALONG, DEPTH, WEIGHT, ROW = 3, 6, 7, 8
"""Columns of a piece: after the point the unit vector along which depth grows, the depth, and a
weight; and their number."""

PIECES = 5
"""Points around a ridge from which depth is foreseen there, and one that is tried."""

FAR = 1e3
"""Longest step [m]: where depth grows evenly, one leads to the end."""

SHORT = 0.1
"""Longest step along a ridge [m]: the shares of its sides are found to so many digits only."""

DEEP = 0.002
"""Depth from which a climb along a ridge ends after a long step only [m]."""

CLIMBS, STARTS = 24, 6
"""Most steps of a climb, and most climbs in a shape."""

CLOSE, SMALL = 1e-3, 1e-5
"""Rise of depth at which a climb ends, as a share of the depth and in metres."""

BISECTIONS = 14
"""Halvings of the share of a piece."""


@part
def look(p, reach, row, surface, scratch):
    """Write a piece: a point of the object's frame with its depth, which is returned.

    Beyond the reach the depth is minus that.
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
    """Depth of a point as foreseen from a piece."""
    return row[DEPTH] + dot(triple(row, ALONG), difference(p, row))


@part
def _go(i, count, step, shapes, scratch):
    """Write the point of the shape nearest to a step from the first piece, along the mean."""
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
    """Write the point where the least of the foreseen depths is largest; returns its rise."""
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
    """Go from the first piece to where the shape is deepest nearby; that is the first piece then.

    A step ends where depth is foreseen to be largest, as it bends between the last two points.
    After two steps too far there is a ridge: what was found beyond it counts as well.
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
        while a < count:  # of a surface that bends inward
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
    """Depth of the deepest point of a shape in an object; that is written to `scratch.deepest`.

    Args:
        i: The shape.
        first: Point on its surface from which to begin, looked at already.
        lows: Lower bounds of the signed distances of such points.
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
        # Where depth bulges, every point foresees at least that of the deepest one.
        if depth > best or (depth > 0.0 and _foreseen(row, found) < (1.0 - 0.02) * best):
            climbs += 1
            depth = _climb(i, shapes, surface, scratch)
            if depth > best:
                best = depth
                for k in range(ROW):
                    found[k] = scratch.pieces[0, k]
    return best
