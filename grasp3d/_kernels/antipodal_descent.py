"""Branch and bound for opposing contacts: no direction is left out because no ray went there.

Rays sample the directions in which a vertex sees the surface. A good opposing contact on a thin
feature or near the edge of a flat face is seen under a small solid angle, between the rays. Here a
tree over the faces bounds from below the critical angle of every grasp of a vertex with its second
contact on the faces of a node; nodes that cannot improve the vertex's grasp are left out.

It is for fingers that squeeze: every point where a line leaves the object may be an opposing
contact, whatever lies between, so that a pair of points is a grasp without tracing a ray.
"""

import math

import numpy as np

from grasp3d._kernels.antipodal_candidates import evaluate_pair
from grasp3d._kernels.compiling import inlined, kernel
from grasp3d._kernels.normal_angles import smallest_angle

INSIDE = 1e-6
"""Smallest barycentric coordinate of a candidate: off the edges, where other normals count too."""

STEPS = (0.4, 0.25, 0.15, 0.1, 0.05)
"""Steps of barycentric coordinates by which a contact is moved over its face."""

MOST_FACES = 2000
"""Faces on which a contact is computed, per vertex, before the best one so far is taken: a bound on
the time where very many are equally good, as at the limit of openings on a ball."""

STACK = 128
"""Nodes that wait at most: fewer than two for each level of the tree."""


@inlined
def _acos(cosine):
    return math.acos(min(1.0, max(-1.0, cosine)))


@inlined
def _own_angle(v, x, y, z, worst, sets):
    """Angle between a direction of any length and the vertex's worst normal, or its best one."""
    start, count, normals = sets.start[v], sets.counts[v], sets.normals
    if not worst:
        return smallest_angle(normals, start, count, x, y, z)
    least = math.inf
    for row in range(start, start + count):
        least = min(least, normals[row, 0] * x + normals[row, 1] * y + normals[row, 2] * z)
    return _acos(least / math.sqrt(x * x + y * y + z * z))


@inlined
def _lower_bound(node, v, worst, tree, surface, sets, limits, limit):
    """Lower bound of the critical angle of grasps of a vertex with a contact on a node's faces.

    The line to any point in the node's ball is within an angle `ball` of the line to its centre,
    and any normal within `spread` of the cone's axis. The two angles of a grasp also add up to at
    least the angle between one normal and the reversed other one.
    """
    bounds, points = tree.bounds, surface.points
    radius, spread = bounds[node, 3], bounds[node, 7]
    ax, ay, az = bounds[node, 4], bounds[node, 5], bounds[node, 6]
    bound = 0.5 * (_own_angle(v, -ax, -ay, -az, worst, sets) - spread)
    if bound >= limit:
        return bound
    x, y, z = bounds[node, 0] - points[v, 0], bounds[node, 1] - points[v, 1], bounds[node, 2]
    z -= points[v, 2]
    distance = math.sqrt(x * x + y * y + z * z)
    if distance - radius > limits[1] or distance + radius < limits[0]:
        return math.inf
    if distance > radius:
        ball = math.asin(radius / distance)
        bound = max(bound, _own_angle(v, x, y, z, worst, sets) - ball)
        if bound < limit:
            opposite = _acos(-(ax * x + ay * y + az * z) / distance)
            bound = max(bound, opposite - ball - spread)
    return bound


@kernel
def _variation(node, v, tree, surface):
    """Upper bound of the differences of the critical angle on the face of a leaf."""
    bounds, points = tree.bounds, surface.points
    square = 0.0
    for k in range(3):
        square += (bounds[node, k] - points[v, k]) ** 2
    ratio = bounds[node, 3] / max(math.sqrt(square), 1e-300)
    # Both the line to the contact and its normal turn by up to the diameter of their cones.
    return 2.0 * (bounds[node, 7] + (math.asin(ratio) if ratio < 1.0 else math.pi))


@inlined
def _angle_at(face, weights, v, worst, surface, sets, limits):
    """Critical angle of a vertex and a point inside a face; inf outside the limits of openings."""
    points, normals = surface.points, surface.normals
    dx, dy, dz = -points[v, 0], -points[v, 1], -points[v, 2]
    mx, my, mz = 0.0, 0.0, 0.0
    for k in range(3):
        weight, vertex, row = weights[k], surface.faces[face, k], surface.corners[face, k]
        dx, mx = dx + weight * points[vertex, 0], mx + weight * normals[row, 0]
        dy, my = dy + weight * points[vertex, 1], my + weight * normals[row, 1]
        dz, mz = dz + weight * points[vertex, 2], mz + weight * normals[row, 2]
    opening = math.sqrt(dx * dx + dy * dy + dz * dz)
    length = math.sqrt(mx * mx + my * my + mz * mz)
    if not limits[0] <= opening <= limits[1] or length < 1e-12:
        return math.inf
    opposite = _acos(-(mx * dx + my * dy + mz * dz) / (opening * length))
    return max(opposite, _own_angle(v, dx, dy, dz, worst, sets))


@kernel
def _move_on_face(face, weights, angle, v, worst, surface, sets, limits):
    """Move a contact over its face in ever smaller steps while the angle falls; returns it.

    Each step is the best of the six from one corner toward another, whatever the corners' order.
    """
    for step in STEPS:
        best_giving, best_taking, best_moved = 0, 0, 0.0
        for k in range(6):
            giving, taking = k % 3, (k + 1 + k // 3) % 3
            moved = min(step, weights[giving] - INSIDE)
            if moved <= 0.0:
                continue
            weights[giving] -= moved
            weights[taking] += moved
            changed = _angle_at(face, weights, v, worst, surface, sets, limits)
            weights[giving] += moved
            weights[taking] -= moved
            if changed < angle:
                angle, best_giving, best_taking, best_moved = changed, giving, taking, moved
        weights[best_giving] -= best_moved
        weights[best_taking] += best_moved
    return angle


@kernel
def _aim(face, v, normal, surface, weights):
    """Write the point of a face from which both normals are equally far; False: no exit there.

    The best line is along the bisector of the normals; where it misses the face, the nearest point
    in barycentric coordinates is taken.
    """
    points, normals, corners = surface.points, surface.normals, surface.corners
    f0, f1, f2 = surface.faces[face, 0], surface.faces[face, 1], surface.faces[face, 2]
    ax, ay, az = points[f0, 0], points[f0, 1], points[f0, 2]
    rx, ry, rz = ax - points[v, 0], ay - points[v, 1], az - points[v, 2]
    ux, uy, uz = points[f1, 0] - ax, points[f1, 1] - ay, points[f1, 2] - az
    wx, wy, wz = points[f2, 0] - ax, points[f2, 1] - ay, points[f2, 2] - az
    ox, oy, oz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
    height = rx * ox + ry * oy + rz * oz
    if height <= 0.0:  # the line enters the object there
        return False
    mx, my, mz = 0.0, 0.0, 0.0
    for k in range(3):
        row = corners[face, k]
        mx, my, mz = mx + normals[row, 0], my + normals[row, 1], mz + normals[row, 2]
    length = max(math.sqrt(mx * mx + my * my + mz * mz), 1e-12)
    lx, ly, lz = normal[0] - mx / length, normal[1] - my / length, normal[2] - mz / length
    square, slope = ox * ox + oy * oy + oz * oz, lx * ox + ly * oy + lz * oz
    if slope <= 1e-9 * math.sqrt(square):  # the bisector is parallel to the face
        weights[:] = 1.0 / 3.0
        return True
    t = height / slope
    qx, qy, qz = t * lx - rx, t * ly - ry, t * lz - rz
    b1 = (qy * wz - qz * wy) * ox + (qz * wx - qx * wz) * oy + (qx * wy - qy * wx) * oz
    b2 = (uy * qz - uz * qy) * ox + (uz * qx - ux * qz) * oy + (ux * qy - uy * qx) * oz
    b1, b2 = max(b1 / square, INSIDE), max(b2 / square, INSIDE)
    b0 = max(1.0 - b1 - b2, INSIDE)
    total = b0 + b1 + b2
    weights[0], weights[1], weights[2] = b0 / total, b1 / total, b2 / total
    return True


@inlined
def _evaluate(v, face, weights, surface, sets, grasps, found):
    """Evaluate the grasp of a vertex and a point inside a face, as rays do."""
    corners, points = surface.faces[face], surface.points
    partner, own = np.zeros(3), points[v]
    for k in range(3):
        for j in range(3):
            partner[j] += weights[k] * points[corners[k], j]
    x, y, z = partner[0] - own[0], partner[1] - own[1], partner[2] - own[2]
    opening = math.sqrt(x * x + y * y + z * z)
    evaluate_pair(
        v,
        1,
        (partner[0], partner[1], partner[2]),
        opening,
        face,
        (weights[0], weights[1], weights[2]),
        surface,
        sets,
        grasps,
        found,
    )


@kernel
def descend(vertices, worst, gain, cone, tree, centres, surface, sets, limits, grasps):
    """Search the whole surface for a clearly better opposing contact of each vertex.

    Args:
        vertices: Vertices (n,).
        worst: Whether the angle over the worst normals of the vertex is minimised, or that over its
            best normals.
        gain: Least decrease of the critical angle that is searched for [rad].
        cone: Half-angle of the search cone [rad].
        tree: `FaceTree`.
        centres: Centre of each vertex's set of normals (V, 3).
        surface: `Surface`.
        sets: `ContactNormals`.
        limits: (smallest, largest) opening.
        grasps: `BestPairs`; written.
    """
    size, depth = tree.order.shape[0], tree.depth
    first_leaf = (1 << depth) - 1
    nodes, lows = np.empty(STACK, dtype=np.int64), np.empty(STACK)
    weights, best_weights, found = np.empty(3), np.empty(3), np.empty((2, 3))
    for v in vertices:
        if worst and sets.counts[v] == 0:
            continue  # among all directions the worst normal has no grasp
        limit = min(cone, grasps.worst[v] if worst else grasps.best[v]) - gain
        best_face, face_count = -1, 0
        nodes[0], lows[0], top = 0, 0.0, 1
        while top > 0:
            top -= 1
            node = nodes[top]
            if lows[top] >= limit:
                continue
            if node < first_leaf:
                one, two = 2 * node + 1, 2 * node + 2
                low = _lower_bound(one, v, worst, tree, surface, sets, limits, limit)
                high = _lower_bound(two, v, worst, tree, surface, sets, limits, limit)
                if high < low:
                    one, two, low, high = two, one, high, low
                # The more promising half is searched first: it lowers the limit for the other.
                nodes[top], lows[top] = two, high
                nodes[top + 1], lows[top + 1] = one, low
                top += 2
                continue
            leaf = node - first_leaf
            for i in range(size * leaf >> depth, size * (leaf + 1) >> depth):
                face = tree.order[i]
                face_count += 1
                if not _aim(face, v, centres[v], surface, weights):
                    continue
                angle = _angle_at(face, weights, v, worst, surface, sets, limits)
                if angle - _variation(node, v, tree, surface) < limit:
                    angle = _move_on_face(face, weights, angle, v, worst, surface, sets, limits)
                if angle < limit:
                    limit, best_face = angle, face
                    best_weights[:] = weights
                if face_count == MOST_FACES:
                    top = 0
        if best_face >= 0:
            _evaluate(v, best_face, best_weights, surface, sets, grasps, found)
