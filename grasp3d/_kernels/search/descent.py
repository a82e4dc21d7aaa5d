"""Branch and bound for opposing contacts: no direction is missed for lack of a ray.

Rays sample the directions in which a vertex sees the surface. A good opposing contact on a thin
feature or near the edge of a flat face takes up a small solid angle, between the rays. Here a tree
over the faces bounds from below the critical angle of every grasp of a vertex with its second
contact on the faces of a node. Nodes that cannot improve the vertex's grasp are left out.

The method is for fingers that squeeze: every point where a line leaves the object may be an
opposing contact, whatever lies between, so no ray has to be traced.

Vertices come in the order of the tree, so that the best face of one is nearly the best of the next.
With the limit that this face gives, most of the search only proves that nothing is better. A node
is left out if no line to its ball is within the limit of the vertex's normal, or of the node's
reversed normals; unlike angles, these cones cost only a square root each.

The best contact on a face is found with cutting planes over its barycentric coordinates.

The contacts of a face at which both angles are at most a limit form a nearly convex region. A
polygon that contains it is cut at a point inside: along the cone of half-angle `limit` about the
vertex's normal, and along the tangent of the region in which the other angle is below the limit. If
the point is better than the limit, its angle becomes the new limit. An empty polygon proves that
the face has nothing better, for most faces after one point. Otherwise the next point is that of
Newton's method, or the polygon's centroid.

The line to a point of the face, and the normal there before it is scaled to unit length, are linear
in two of the point's barycentric coordinates.
"""

import math

import numpy as np

from grasp3d._kernels.compiling import kernel, merged, part
from grasp3d._kernels.search.antipodal_candidates import SMALLEST_OPENING, evaluate_on_face
from grasp3d._kernels.search.face_contacts import (
    INSIDE,
    aim,
    cosine_at,
    longest_difference,
    move_on_face,
    read_face,
    upper_bound,
)
from grasp3d._kernels.surface.face_tree import (
    CHANGED,
    GO_ON,
    NO_NODE,
    STACK,
    STOP,
    below,
    faces_of_leaf,
    walk,
)
from grasp3d._kernels.surface.polygons import REGION_CORNERS, centroid, cut, stays_inside
from grasp3d._kernels.surface.surface_contacts import line_turn, turn_at_vertex
from grasp3d._kernels.surface.vectors import (
    combined,
    copy,
    difference,
    divided,
    dot,
    norm,
    scaled,
    triple,
    weighted_sum,
)


@part
def worst_normal(own, line, worst):
    """Write the vertex's normal that is farthest from a unit vector; return their cosine.

    Args:
        own: Normals of the vertex (k, 3).
        line: The vector, three numbers.
        worst: Written (3,), unless there are no normals.
    """
    count = own.shape[0]
    if count == 0:
        return 1.0
    least, row = 2.0, 0
    for i in range(count):
        cosine = dot(own[i], line)
        if cosine < least:
            least, row = cosine, i
    copy(own[row], worst)
    return least


@merged
def own_derivatives(cosine, normal, unit, opening, u, w):
    """Cosine to the vertex's normal, with its two first and three second derivatives.

    Args:
        cosine: The cosine.
        normal: The normal (3,).
        unit: Unit vector along the line, three numbers.
        opening: Length of the line.
        u: Derivative of the line with respect to the first coordinate.
        w: Derivative of the line with respect to the second one.
    """
    along_u, along_w = dot(unit, u), dot(unit, w)
    a = (dot(normal, u) - cosine * along_u) / opening
    b = (dot(normal, w) - cosine * along_w) / opening
    uu, uw, ww = (
        dot(u, u) - along_u * along_u, dot(u, w) - along_u * along_w, dot(w, w) - along_w * along_w
    )  # fmt: skip
    return (
        cosine,
        a,
        b,
        -(2.0 * a * along_u + cosine * uu / opening) / opening,
        -(a * along_w + b * along_u + cosine * uw / opening) / opening,
        -(2.0 * b * along_w + cosine * ww / opening) / opening,
    )


@merged
def other_derivatives(cosine, line, normal, opening, length, u, w, p, q):
    """Cosine between the reversed line and the face's normal, with its derivatives.

    Args:
        cosine: The cosine.
        line: The line, three numbers.
        normal: The normal, not scaled to unit length.
        opening: Length of the line.
        length: Length of the normal.
        u: Derivative of the line with respect to the first coordinate.
        w: Derivative of the line with respect to the second one.
        p: Derivative of the normal with respect to the first coordinate.
        q: Derivative of the normal with respect to the second one.
    """
    du, dw = dot(line, u) / opening, dot(line, w) / opening
    mp, mq = dot(normal, p) / length, dot(normal, q) / length
    # The cosine is -(line . normal) / r, where r is the product of both lengths.
    r = opening * length
    rx, ry = du * length + opening * mp, dw * length + opening * mq
    lines, normals = length / opening, opening / length
    rxx = (dot(u, u) - du * du) * lines + 2.0 * du * mp + (dot(p, p) - mp * mp) * normals
    rxy = (dot(u, w) - du * dw) * lines + du * mq + dw * mp + (dot(p, q) - mp * mq) * normals
    ryy = (dot(w, w) - dw * dw) * lines + 2.0 * dw * mq + (dot(q, q) - mq * mq) * normals
    a = -(dot(p, line) + dot(normal, u) + cosine * rx) / r
    b = -(dot(q, line) + dot(normal, w) + cosine * ry) / r
    return (
        cosine,
        a,
        b,
        -(2.0 * dot(p, u) + 2.0 * a * rx + cosine * rxx) / r,
        -(dot(p, w) + dot(q, u) + a * ry + b * rx + cosine * rxy) / r,
        -(2.0 * dot(q, w) + 2.0 * b * ry + cosine * ryy) / r,
    )


@merged
def step_to_equal(a, b):
    """Newton's step to the maximum of the smaller of two functions; (0, 0) if there is none.

    Where both are equal at the maximum, they are weighted so that the gradients cancel.

    Args:
        a: Value, two first and three second derivatives of one function.
        b: The same of the other function.
    """
    nx, ny = a[1] - b[1], a[2] - b[2]
    square = nx * nx + ny * ny
    part = -(b[1] * nx + b[2] * ny) / square if square > 0.0 else 0.5
    if square > 0.0 and 0.0 < part < 1.0:
        rest = 1.0 - part
        hxx, hxy = part * a[3] + rest * b[3], part * a[4] + rest * b[4]
        hyy = part * a[5] + rest * b[5]
        along, tx, ty = (b[0] - a[0]) / square, -ny, nx
        curvature = tx * (hxx * tx + hxy * ty) + ty * (hxy * tx + hyy * ty)
        if curvature >= 0.0:
            return 0.0, 0.0
        mixed = tx * (hxx * nx + hxy * ny) + ty * (hxy * nx + hyy * ny)
        across = -(tx * b[1] + ty * b[2] + along * mixed) / curvature
        return along * nx + across * tx, along * ny + across * ty
    one = a if part >= 1.0 else b
    determinant = one[3] * one[5] - one[4] * one[4]
    if one[3] >= 0.0 or determinant <= 0.0:
        return 0.0, 0.0
    return (
        (one[4] * one[2] - one[5] * one[1]) / determinant,
        (one[4] * one[1] - one[3] * one[2]) / determinant,
    )


RESOLVED = 1e-7
"""Decrease of an angle [rad] below which the search ends."""

MOST_POINTS = 60
"""Most points of a face at which the angles are computed."""

LOOSE = 1.5
"""Factor on the decreases that linear bounds allow, as angles are not linear."""

BENT = 0.15
"""Difference of two corners' normals above which a face is divided, as the contacts within a limit
need not form a convex region there."""

MOST_PARTS = 8
"""Most parts of each edge of a divided face."""

ANYWHERE, BEYOND = False, True
"""Whether only contacts beyond a plane tangent to the ball of the smallest opening count."""

MOST_TANGENTS = 12
"""Most planes tangent to the ball of the smallest opening that are tried from each start."""

ROUNDING = 1e-12
"""Amount by which contacts in such a plane may fall short of the smallest opening."""


@merged
def _farthest(polygon, size, x, y):
    """Squared distance from a point to the farthest corner of a polygon."""
    square = 0.0
    for i in range(size):
        square = max(square, (polygon[i, 0] - x) ** 2 + (polygon[i, 1] - y) ** 2)
    return square


@part
def best_on_face(weights, cosine, lines, normals, own, limits, polygon, nearest):
    """Find the contact on a face with the smallest critical angle, if it is below a limit.

    Args:
        weights: Barycentric coordinates from which the search starts (3,), replaced by those of
            the best contact if one is found.
        cosine: Cosine of the limit, not below 0.
        lines: Lines from the vertex to the corners (3, 3).
        normals: Normals at the corners (3, 3).
        own: Normals of the vertex (k, 3).
        limits: `PairLimits`.
        polygon: Scratch (2 * REGION_CORNERS, 3).
        nearest: Scratch (3,).

    Returns:
        Cosine of the smallest critical angle found, or `cosine` if none is below the limit.
    """
    smallest, limit, others = limits.smallest, cosine, (lines, normals, own)
    cosine = _best_in_region(
        weights, cosine, *others, 0.0, limits.largest, ANYWHERE, polygon, nearest
    )
    if smallest <= SMALLEST_OPENING or not cosine > limit:
        return cosine
    if norm(weighted_sum(weights, lines[0], lines[1], lines[2])) >= smallest:
        return cosine
    # The best contact is too near, and the allowed ones form no convex region. Each part beyond a
    # tangent plane is searched, then the part beyond the plane at the best contact found. Every
    # part that the ball of the smallest opening leaves contains a corner of the face.
    found, cosine = triple(weights, 0), 0.0
    for start in range(4):
        if start > 0:
            for k in range(3):
                weights[k] = 1.0 - 2.0 * INSIDE if k == start - 1 else INSIDE
        own_cosine = 0.0
        for _ in range(MOST_TANGENTS):
            better = _best_in_region(
                weights, own_cosine, *others, smallest, limits.largest, BEYOND, polygon, nearest
            )
            gain, own_cosine = better - own_cosine, better  # at the end, the cosine of `weights`
            if not gain > RESOLVED:
                break
        if own_cosine > cosine:
            cosine, found = own_cosine, triple(weights, 0)
    copy(found, weights)
    return max(cosine, limit)


@part
def _best_in_region(
    weights, cosine, lines, normals, own, smallest, largest, beyond, polygon, nearest
):  # fmt: skip
    """Like `best_on_face`, if contacts within the limits of openings form a convex region.

    With `beyond`, only contacts beyond the plane count that is tangent to the ball of the smallest
    opening in the direction of the starting point.
    """
    start, n = triple(lines[0], 0), triple(normals[0], 0)
    u, w = difference(lines[1], start), difference(lines[2], start)
    p, q = difference(normals[1], n), difference(normals[2], n)
    bend = math.sqrt(max(dot(p, p), dot(q, q)) * max(dot(u, u), dot(w, w)))
    for i in range(3):
        polygon[i, 0] = 1.0 - 2.0 * INSIDE if i == 1 else INSIDE
        polygon[i, 1] = 1.0 - 2.0 * INSIDE if i == 2 else INSIDE
    size = weights.shape[0]  # 3 corners
    x, y, previous = weights[1], weights[2], 1.0
    sine = math.sqrt(max(1.0 - cosine * cosine, 0.0))
    for number in range(MOST_POINTS):
        line = weighted_sum((1.0, x, y), start, u, w)
        normal = weighted_sum((1.0, x, y), n, p, q)
        opening, length = norm(line), norm(normal)
        if opening < 1e-6 or length < 1e-12:
            return cosine
        product = dot(normal, line)
        other = -product / (opening * length)
        unit = divided(line, opening)
        first, own_normal = worst_normal(own, unit, nearest), triple(nearest, 0)
        along_u, along_w = dot(unit, u), dot(unit, w)
        ahead = along_u * x + along_w * y
        if beyond and number == 0:
            constant = smallest - opening + ahead
            size, _ = cut(polygon, size, -along_u, -along_w, constant)
        if opening > largest:
            size, _ = cut(polygon, size, along_u, along_w, opening - largest - ahead)
        elif opening >= smallest - ROUNDING and min(first, other) > cosine:
            cosine = min(first, other)
            sine = math.sqrt(max(1.0 - cosine * cosine, 0.0))
            weights[0], weights[1], weights[2] = 1.0 - x - y, x, y
            if sine < RESOLVED:
                return cosine
        reach = 1.0
        # Taken from the vector across the normal: a small sine from the cosine would be rounding.
        across = combined(1.0, unit, -first, own_normal)
        first_sine = norm(across)
        if size > 2 and first < 1.0 and first_sine > 1e-9:
            # The plane through the vertex tangent to the cone about the normal below the point.
            h = combined(cosine / first_sine, across, -sine, own_normal)
            size, least = cut(polygon, size, dot(h, u), dot(h, w), dot(h, start))
            turn = max(min(-LOOSE * least / opening, sine), -1.0)
            reach = cosine * math.sqrt(1.0 - turn * turn) + sine * turn
        if size > 2:
            # The region is where cosine |line| |normal| + line . normal is not positive.
            a = cosine * (along_u * length + opening * dot(normal, p) / length)
            a += dot(p, line) + dot(normal, u)
            b = cosine * (along_w * length + opening * dot(normal, q) / length)
            b += dot(q, line) + dot(normal, w)
            value = cosine * opening * length + product
            slack = bend * (1.0 - cosine + sine) * _farthest(polygon, size, x, y)
            value = max(value - slack, 0.0) if other <= cosine else value - slack
            size, least = cut(polygon, size, a, b, value - a * x - b * y)
            reach = min(reach, cosine - LOOSE * least / (opening * length))
        if size < 3 or sine <= RESOLVED or reach <= cosine + RESOLVED * sine:
            return cosine
        gain, sx, sy = reach - cosine, 0.0, 0.0
        if gain < 0.5 * previous and opening <= largest:
            two = other_derivatives(other, line, normal, opening, length, u, w, p, q)
            one = two
            if first < 1.0:
                one = own_derivatives(first, own_normal, unit, opening, u, w)
            sx, sy = step_to_equal(one, two)
        previous = gain
        if (sx != 0.0 or sy != 0.0) and stays_inside(polygon, size, x + sx, y + sy):
            x, y = x + sx, y + sy
        else:
            x, y = centroid(polygon, size)
    return cosine


@merged
def _mix(rows, weights, mixed):
    """Write combinations of three rows, one for each row of weights (3, 3)."""
    for i in range(3):
        copy(weighted_sum(weights[i], rows[0], rows[1], rows[2]), mixed[i])


@part
def best_on_bent_face(weights, cosine, lines, normals, own, limits, parts, polygon, nearest, part):
    """Apply `best_on_face` to each part of a face whose edges are divided.

    Args:
        weights: Written if a contact is found (3,).
        cosine: As in `best_on_face`.
        lines: As in `best_on_face`.
        normals: As in `best_on_face`.
        own: As in `best_on_face`.
        limits: As in `best_on_face`.
        parts: Number of parts of each edge.
        polygon: Scratch.
        nearest: Scratch.
        part: Scratch: lines, normals and weights of a part's corners (3, 3) each; weights (3,).

    Returns:
        Cosine of the smallest critical angle found, or `cosine`.
    """
    part_lines, part_normals, corners, inside = part
    size = (1.0 - 3.0 * INSIDE) / parts
    for row in range(parts):
        for column in range(2 * (parts - row) - 1):
            i, up = column // 2, column % 2
            for c in range(3):
                # Corners (i, row), (i + 1, row), (i, row + 1), or the other half of the square.
                x = i + (c == 1) if up == 0 else i + (c != 2)
                y = row + (c == 2) if up == 0 else row + (c != 0)
                corners[c, 1], corners[c, 2] = INSIDE + size * x, INSIDE + size * y
                corners[c, 0] = 1.0 - corners[c, 1] - corners[c, 2]
            _mix(lines, corners, part_lines)
            _mix(normals, corners, part_normals)
            inside[0], inside[1], inside[2] = 1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0
            better = best_on_face(
                inside, cosine, part_lines, part_normals, own, limits, polygon, nearest
            )
            if better > cosine:
                cosine = better
                for k in range(3):
                    weights[k] = 0.0
                    for c in range(3):
                        weights[k] += inside[c] * corners[c, k]
    return cosine


MOST_FACES = 2000
"""Most faces per vertex on which a contact is computed before the best one so far is taken. This
bounds the time where very many are equally good, as at the limit of openings on a ball."""


@merged
def _outside(axis, cosine, sine, line):
    """Signed distance of a point from a cone about a unit vector, negative inside."""
    along = dot(axis, line)
    return cosine * math.sqrt(max(dot(line, line) - along * along, 0.0)) - sine * along


@merged
def rank(node, v, own, domain, cosine, sine):
    """Rank a node: not negative if none of its contacts is within a limit; smaller if more likely.

    Args:
        node: The node.
        v: The vertex.
        own: Normals of the vertex (k, 3).
        domain: `PairDomain`.
        cosine: Cosine of the limit of the critical angle, at least 0.
        sine: Sine of that limit.
    """
    bounds, limits = domain.tree.bounds[node], domain.limits
    radius, cos_spread, sin_spread = bounds[3], bounds[7], bounds[8]
    if own.shape[0] != 1 or domain.surface.turns.error > 0.0:
        return cosine - upper_bound(node, v, own, domain, cosine)
    normal, axis = triple(own[0], 0), scaled(-1.0, triple(bounds, 4))
    wide_cosine = cosine * cos_spread - sine * sin_spread
    wide_sine = sine * cos_spread + cosine * sin_spread
    if cos_spread > 0.0:  # otherwise any normal is possible
        # Both angles together are at least the angle between one normal and the other, reversed.
        least = wide_cosine * cosine - wide_sine * sine
        if wide_sine * cosine + wide_cosine * sine > 0.0 and dot(axis, normal) < least:
            return 0.0
    line = difference(bounds, domain.surface.points[v])
    result = _outside(normal, cosine, sine, line) - radius
    if result < 0.0 and cos_spread > 0.0 and wide_sine > 0.0:
        result = max(result, _outside(axis, wide_cosine, wide_sine, line) - radius)
    limited = limits.largest < math.inf or limits.smallest > SMALLEST_OPENING
    if result < 0.0 and limited and upper_bound(node, v, own, domain, cosine) <= cosine:
        return 0.0
    return result


@part
def best_of_face(face, v, cosine, own, domain, scratch):
    """Find the best contact of a vertex on a face; see `best_on_face`.

    With location errors, it is the better of the best contact for exact locations and of the points
    of a lattice, moved on the face.

    Args:
        face: The face.
        v: The vertex.
        cosine: Cosine of the limit, at least 0.
        own: Normals of the vertex (k, 3).
        domain: `PairDomain`.
        scratch: As returned by `make_scratch`; the contact's weights are in the first array.

    Returns:
        Cosine of the smallest critical angle, or `cosine`.
    """
    weights, lines, normals, polygon, nearest, part = scratch
    limits, turns, exact = domain.limits, domain.surface.turns, cosine
    if not aim(face, v, domain.centres, domain.surface, weights):
        return cosine
    read_face(face, v, domain.surface, lines, normals)
    if turns.error > 0.0:  # the remaining limit for exact locations
        far = max(norm(lines[0]), norm(lines[1]), norm(lines[2]))
        one, other = turn_at_vertex(v, turns), turns.least[face]
        angle = math.acos(min(max(cosine, -1.0), 1.0)) - line_turn(far, turns)
        if angle <= max(one, other):
            return cosine
        exact = math.cos(angle - min(one, other))
    bend = longest_difference(normals)
    if bend <= BENT:
        better = best_on_face(weights, exact, lines, normals, own, limits, polygon, nearest)
    else:
        parts = int(min(bend / BENT + 1.0, MOST_PARTS))
        better = best_on_bent_face(
            weights, exact, lines, normals, own, limits, parts, polygon, nearest, part
        )
    if not turns.error > 0.0:
        return better
    return _best_of_lattice(face, v, cosine, own, domain, scratch) if better > exact else cosine


@part
def _best_of_lattice(face, v, limit, own, domain, scratch):
    """Find the `best_of_face` with location errors, from its best contact for exact locations."""
    weights, lines, normals, _, nearest, _ = scratch
    parts = domain.surface.turns.levels[face]
    cosine = cosine_at(triple(weights, 0), v, face, lines, normals, own, domain)
    copy(weights, nearest)
    for j in range(parts + 1):
        for i in range(parts + 1 - j):
            y = INSIDE + (1.0 - 3.0 * INSIDE) * i / parts
            z = INSIDE + (1.0 - 3.0 * INSIDE) * j / parts
            place = 1.0 - y - z, y, z
            other = cosine_at(place, v, face, lines, normals, own, domain)
            if other > cosine:
                cosine = other
                copy(place, nearest)
    copy(nearest, weights)
    cosine = move_on_face(weights, cosine, v, face, lines, normals, own, domain)
    return max(cosine, limit)


@kernel()
def make_scratch():
    """Allocate the scratch arrays of `best_of_face`."""
    return (
        np.empty(3),
        np.empty((3, 3)),
        np.empty((3, 3)),
        np.empty((2 * REGION_CORNERS, 3)),
        np.empty(3),
        (np.empty((3, 3)), np.empty((3, 3)), np.empty((3, 3)), np.empty(3)),
    )


@merged
def _visit(node, _position, stale, state):
    """Visit a node of the tree; better contacts lower the limit."""
    v, own, domain, skipped, limit, best_face, scratch, best = state
    tree, cosine, sine = domain.tree, limit[0], limit[1]
    # Unless stale, the node was ranked after the last contact was found.
    if stale and rank(node, v, own, domain, cosine, sine) >= 0.0:
        return NO_NODE, NO_NODE, GO_ON
    later, sooner = below(node, tree.depth)
    if later != NO_NODE:
        one = rank(later, v, own, domain, cosine, sine)
        other = rank(sooner, v, own, domain, cosine, sine)
        # The more likely half is searched first: it lowers the limit for the other.
        if not other < one:
            later, sooner, one, other = sooner, later, other, one
        return later if one < 0.0 else NO_NODE, sooner if other < 0.0 else NO_NODE, GO_ON
    event = GO_ON
    first, last = faces_of_leaf(node, tree.depth, tree.order.shape[0])
    for i in range(first, last):
        face = tree.order[i]
        if face == skipped:
            continue
        best_face[1] += 1
        better = best_of_face(face, v, limit[0], own, domain, scratch)
        if better > limit[0]:
            best_face[0], angle, event = face, math.acos(min(better, 1.0)) - RESOLVED, CHANGED
            copy(scratch[0], best)
            if angle <= 0.0:
                return NO_NODE, NO_NODE, STOP
            limit[0], limit[1] = math.cos(angle), math.sin(angle)
        if best_face[1] == MOST_FACES:
            return NO_NODE, NO_NODE, STOP
    return NO_NODE, NO_NODE, event


@part
def _keep(v, face, weights, surface, sets, grasps, at_contact):
    """Evaluate a contact; if it is close to an edge or corner of its face, first evaluate that.

    Where the surface is smooth, both are the same up to rounding.
    """
    inside = weights[0], weights[1], weights[2]
    beside = min(inside) < 2.0 * INSIDE
    if beside:
        for k in range(3):
            if weights[k] < 2.0 * INSIDE:
                weights[k] = 0.0
        total = weights[0] + weights[1] + weights[2]
        for k in range(3):
            weights[k] /= total
    for _ in range(2 if beside else 1):
        evaluate_on_face(v, 1, face, weights, surface, sets, grasps, at_contact)
        weights[0], weights[1], weights[2] = inside


@kernel("Ints1, float, PairDomain, BestPairs")
def descend(vertices, cone, domain, grasps):
    """Find the opposing contact of each vertex with the smallest critical angle.

    The angle is the one over the vertex's worst normals and the worst locations. The order of the
    vertices changes the result by less than `RESOLVED`; by more where over `MOST_FACES` faces are
    about equally good, and with location errors, which are known only at points.

    Args:
        vertices: Vertices, with neighbours following each other (n,).
        cone: Largest angle to search for, at most pi / 2 [rad].
        domain: `PairDomain`.
        grasps: `BestPairs`; written.

    Returns:
        Number of faces on which a contact was computed.
    """
    surface, sets = domain.surface, domain.sets
    scratch, nodes = make_scratch(), np.empty(STACK, dtype=np.int64)
    best, at_contact = np.empty(3), np.empty((2, 3))
    limit, best_face = np.empty(2), np.zeros(2, dtype=np.int64)
    last, tried = domain.tree.order[0], 0  # any face serves for the first vertex
    for v in vertices:
        angle = min(cone, grasps.worst[v]) - RESOLVED
        if angle <= 0.0:
            continue
        own = sets.normals[sets.start[v] : sets.start[v] + sets.counts[v]]
        cosine = math.cos(angle)
        better = best_of_face(last, v, cosine, own, domain, scratch)
        tried += 1
        if better > cosine:
            _keep(v, last, scratch[0], surface, sets, grasps, at_contact)
            angle = math.acos(min(better, 1.0)) - RESOLVED
            if angle <= 0.0:
                continue
            cosine = math.cos(angle)
        limit[0], limit[1] = cosine, math.sqrt(max(1.0 - cosine * cosine, 0.0))
        best_face[0], best_face[1] = -1, 0
        walk(_visit, (v, own, domain, last, limit, best_face, scratch, best), nodes)
        tried += best_face[1]
        if best_face[0] >= 0:
            last = best_face[0]
            _keep(v, last, best, surface, sets, grasps, at_contact)
    return tried
