"""Grasps of a vertex with an opposing contact on a face: bounds, angles, and the best points.

Angles are compared by their cosines, which saves most of the time: the larger cosine is better.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling.decorators import merged, part, scratch_kernel
from grasp3d._kernels.search.antipodal_candidates import PairLimits
from grasp3d._kernels.surface.face_tree import FaceTree
from grasp3d._kernels.surface.normal_sets import ContactNormals
from grasp3d._kernels.surface.surface_contacts import Surface
from grasp3d._kernels.surface.vectors import copy

INSIDE = 2e-9
"""Smallest barycentric coordinate of a candidate: off the edges, where other normals count too."""

STEPS = (0.4, 0.25, 0.15, 0.1, 0.05)
"""Steps of barycentric coordinates by which a contact is moved over its face."""

TOTAL = sum(STEPS)
"""Farthest that they move it."""

NONE = -2.0
"""In place of a cosine: no grasp."""


class PairDomain(NamedTuple):
    """Where opposing contacts of vertices are searched for."""

    surface: Surface
    sets: ContactNormals
    centres: npt.NDArray[np.float64]
    """Centre of each vertex's set of normals (V, 3)."""
    tree: FaceTree
    limits: PairLimits


class OwnNormals(NamedTuple):
    """The normals of a vertex, and which of them counts."""

    rows: npt.NDArray[np.float64]
    """As `read_own` writes them (k, 12)."""
    size: int
    """Their number."""
    worst: bool
    """Whether the worst one counts, or the best one."""


@merged
def write_side(own, i, after):
    """Write the side of a polygon from one of its normals to another, as in `read_own`."""
    for k in range(3):
        p, q = (k + 1) % 3, (k + 2) % 3
        own[i, 3 + k] = own[i, p] * own[after, q] - own[i, q] * own[after, p]
    length = max(math.sqrt(own[i, 3] ** 2 + own[i, 4] ** 2 + own[i, 5] ** 2), 1e-300)
    for k in range(3):
        own[i, 3 + k] /= length
    for k in range(3):
        p, q = (k + 1) % 3, (k + 2) % 3
        own[i, 6 + k] = own[i, 3 + p] * own[i, q] - own[i, 3 + q] * own[i, p]
        own[i, 9 + k] = own[after, p] * own[i, 3 + q] - own[after, q] * own[i, 3 + p]


@part
def read_own(v, sets, own):
    """Write the normals of a vertex and the sides of their polygon, a row each; returns the number.

    A row has a normal a, the axis w of the great circle to the next one, b, and w x a and b x w,
    from which a direction is between the two.
    """
    start, count = sets.start[v], sets.counts[v]
    for i in range(count):
        copy(sets.normals[start + i], own[i])
    for i in range(count):
        write_side(own, i, (i + 1) % count)
    return count


@merged
def _product(own, i, k, x, y, z):
    return own[i, k] * x + own[i, k + 1] * y + own[i, k + 2] * z


@part
def _cosine_to_nearest(own, count, x, y, z):
    """Length of a vector times the cosine of its smallest angle to a polygon of normals."""
    if count == 0:
        return math.sqrt(x * x + y * y + z * z)
    square, greatest, inside = x * x + y * y + z * z, -math.inf, True
    for i in range(1 if count == 2 else count):
        height = _product(own, i, 3, x, y, z)
        if count > 2 and height >= 0.0:  # inside a polygon all its sides are passed on the left
            continue
        inside = False
        if _product(own, i, 6, x, y, z) >= 0.0 and _product(own, i, 9, x, y, z) >= 0.0:
            greatest = max(greatest, math.sqrt(max(square - height * height, 0.0)))
        else:
            one, other = _product(own, i, 0, x, y, z), _product(own, (i + 1) % count, 0, x, y, z)
            greatest = max(greatest, one, other)
    return math.sqrt(square) if inside else greatest


@merged
def best_cosine(own, count, x, y, z):
    """Cosine of the angle between a direction and the vertex's best normal."""
    length = math.sqrt(x * x + y * y + z * z)
    if count == 1:
        return _product(own, 0, 0, x, y, z) / length
    return _cosine_to_nearest(own, count, x, y, z) / length


@merged
def own_cosine(own, x, y, z):
    """Cosine of the angle between a direction and the normal of `OwnNormals` that counts."""
    if not own.worst:
        return best_cosine(own.rows, own.size, x, y, z)
    least = math.inf
    for i in range(own.size):
        least = min(least, _product(own.rows, i, 0, x, y, z))
    return least / math.sqrt(x * x + y * y + z * z)


@merged
def _sine(cosine):
    return math.sqrt(max(1.0 - cosine * cosine, 0.0))


@merged
def _nearer(cosine, cosine_by, sine_by):
    """Cosine of an angle that is made smaller by another one, but not below 0."""
    return 1.0 if cosine >= cosine_by else cosine * cosine_by + _sine(cosine) * sine_by


@merged
def _turned(cosine, location, opening):
    """Cosine of an angle that the uncertain locations of contacts make larger, up to pi."""
    sine_turn = min(location / opening, 1.0)
    cosine_turn = math.sqrt((1.0 - sine_turn) * (1.0 + sine_turn))
    if cosine <= -cosine_turn:
        return -1.0
    return cosine * cosine_turn - _sine(cosine) * sine_turn


@merged
def upper_bound(node, v, own, domain, least):
    """Upper bound of the cosine of the costs of grasps of a vertex and a node's faces.

    The line to any point in the node's ball is within an angle `ball` of the line to its centre,
    and any normal within `spread` of the cone's axis. The two angles of a grasp also add up to at
    least the angle between one normal and the reversed other one. And a line that is not longer
    than `reach` to a point beyond a plane is within an angle of the plane's normal. The uncertain
    locations of contacts turn no line by less than one that is `reach` long.
    Below `least`, the bound is not made tighter.
    """
    bounds, points, limits = domain.tree.bounds, domain.surface.points, domain.limits
    radius, cos_spread, sin_spread = bounds[node, 3], bounds[node, 7], bounds[node, 8]
    ax, ay, az = bounds[node, 4], bounds[node, 5], bounds[node, 6]
    turn = own_cosine(own, -ax, -ay, -az)
    both = _nearer(turn, cos_spread, sin_spread)
    bound = math.sqrt(max(0.5 + 0.5 * both, 0.0))
    if bound <= least:
        return bound
    px, py, pz = points[v, 0], points[v, 1], points[v, 2]
    x, y, z = bounds[node, 0] - px, bounds[node, 1] - py, bounds[node, 2] - pz
    square = x * x + y * y + z * z
    distance = math.sqrt(square)
    if distance - radius > limits.largest or distance + radius < limits.smallest:
        return NONE
    reach = min(distance + radius, limits.largest)
    beyond = (ax * px + ay * py + az * pz - bounds[node, 9]) / reach
    if beyond > 1.0:
        return NONE
    if beyond > 0.0:
        bound = min(bound, _nearer(turn, beyond, _sine(beyond)))
    if distance > radius and bound > least:
        tangent = math.sqrt(square - radius * radius)
        cos_ball, sin_ball = tangent / distance, radius / distance
        if tangent > limits.largest:  # the lines that touch the ball are too long
            cos_ball = (square + reach * reach - radius * radius) / (2.0 * distance * reach)
            sin_ball = _sine(cos_ball)
        bound = min(bound, _nearer(own_cosine(own, x, y, z), cos_ball, sin_ball))
        cosine = cos_ball * cos_spread - sin_ball * sin_spread
        sine = sin_ball * cos_spread + cos_ball * sin_spread
        if bound > least and sine > 0.0:  # otherwise both angles add up to more than pi
            opposite = -(ax * x + ay * y + az * z) / distance
            bound = min(bound, _nearer(opposite, cosine, sine))
    if bound <= limits.cos_cone:
        return NONE
    if limits.location > 0.0:
        bound = _turned(bound, limits.location, reach)
    return bound


@merged
def read_face(face, v, surface, lines, normals):
    """Write the lines from a vertex to the corners of a face, and the corners' normals."""
    for k in range(3):
        vertex, row = surface.faces[face, k], surface.corners[face, k]
        for j in range(3):
            lines[k, j] = surface.points[vertex, j] - surface.points[v, j]
            normals[k, j] = surface.normals[row, j]


@merged
def longest_difference(rows):
    """Largest distance between any two of three points."""
    square = 0.0
    for k in range(3):
        other = (k + 1) % 3
        x, y, z = rows[k, 0] - rows[other, 0], rows[k, 1] - rows[other, 1], rows[k, 2]
        z -= rows[other, 2]
        square = max(square, x * x + y * y + z * z)
    return math.sqrt(square)


@merged
def cosine_at(w0, w1, w2, lines, normals, own, limits):
    """Cosine of the cost of the grasp of a vertex and a point inside a face.

    NONE outside the limits of openings, and of the critical angle.
    """
    dx = w0 * lines[0, 0] + w1 * lines[1, 0] + w2 * lines[2, 0]
    dy = w0 * lines[0, 1] + w1 * lines[1, 1] + w2 * lines[2, 1]
    dz = w0 * lines[0, 2] + w1 * lines[1, 2] + w2 * lines[2, 2]
    mx = w0 * normals[0, 0] + w1 * normals[1, 0] + w2 * normals[2, 0]
    my = w0 * normals[0, 1] + w1 * normals[1, 1] + w2 * normals[2, 1]
    mz = w0 * normals[0, 2] + w1 * normals[1, 2] + w2 * normals[2, 2]
    opening = math.sqrt(dx * dx + dy * dy + dz * dz)
    length = math.sqrt(mx * mx + my * my + mz * mz)
    if not limits.smallest <= opening <= limits.largest or length < 1e-12:
        return NONE
    opposite = -(mx * dx + my * dy + mz * dz) / (opening * length)
    cosine = min(opposite, own_cosine(own, dx, dy, dz))
    if cosine <= limits.cos_cone:
        return NONE
    if limits.location > 0.0:
        cosine = _turned(cosine, limits.location, opening)
    return cosine


@part
def turning_speed(weights, lines, normals, cos_spread, location):
    """Upper bound of the change of the cost per unit of barycentric coordinates [rad]."""
    square = 0.0
    for k in range(3):
        square += (
            weights[0] * lines[0, k] + weights[1] * lines[1, k] + weights[2] * lines[2, k]
        ) ** 2
    edge = longest_difference(lines)
    nearest = math.sqrt(square) - TOTAL * edge
    if nearest <= 0.0 or cos_spread <= 0.0:
        return math.inf
    speed = edge / nearest + longest_difference(normals) / cos_spread
    if location > 0.0:  # the derivative of the line's turn with respect to the opening
        if nearest <= location:
            return math.inf
        speed += edge * location / (nearest * math.sqrt(nearest**2 - location**2))
    return speed


@part
def move_on_face(weights, cosine, turning, limit, lines, normals, own, limits):
    """Move a contact over its face in ever smaller steps while the angle falls; returns its cosine.

    Each step is the best of the six from one corner toward another, whatever the corners' order.
    It ends where the remaining steps cannot reach the limit.

    Args:
        weights: Barycentric coordinates of the contact (3,); written.
        cosine: Cosine of its cost.
        turning: Upper bound of the change of the cost by a step of 1 [rad].
        limit: Cost to be improved [rad].
        lines: Lines from the vertex to the corners (3, 3).
        normals: Normals at the corners (3, 3).
        own: `OwnNormals`.
        limits: `PairLimits`.
    """
    remaining = TOTAL
    for step in STEPS:
        within = limit + remaining * turning
        if within < math.pi and cosine <= math.cos(within):
            return cosine
        remaining -= step
        best_giving, best_taking, best_moved = 0, 0, 0.0
        for k in range(6):
            giving, taking = k % 3, (k + 1 + k // 3) % 3
            moved = min(step, weights[giving] - INSIDE)
            if moved <= 0.0:
                continue
            weights[giving] -= moved
            weights[taking] += moved
            w0, w1, w2 = weights[0], weights[1], weights[2]
            changed = cosine_at(w0, w1, w2, lines, normals, own, limits)
            weights[giving] += moved
            weights[taking] -= moved
            if changed > cosine:
                cosine, best_giving, best_taking, best_moved = changed, giving, taking, moved
        weights[best_giving] -= best_moved
        weights[best_taking] += best_moved
    return cosine


@scratch_kernel
def aim(face, v, centres, surface, weights):
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
    lx, ly, lz = centres[v, 0] - mx / length, centres[v, 1] - my / length, centres[v, 2]
    lz -= mz / length
    square, slope = ox * ox + oy * oy + oz * oz, lx * ox + ly * oy + lz * oz
    if slope <= 1e-9 * math.sqrt(square):  # the bisector is parallel to the face
        weights[0], weights[1], weights[2] = 1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0
        return True
    t = height / slope
    qx, qy, qz = t * lx - rx, t * ly - ry, t * lz - rz
    b1 = (qy * wz - qz * wy) * ox + (qz * wx - qx * wz) * oy + (qx * wy - qy * wx) * oz
    b2 = (uy * qz - uz * qy) * ox + (uz * qx - ux * qz) * oy + (ux * qy - uy * qx) * oz
    b1, b2 = max(b1 / square, 0.0), max(b2 / square, 0.0)
    b0 = max(1.0 - b1 - b2, 0.0)
    scale = (1.0 - 3.0 * INSIDE) / (b0 + b1 + b2)
    weights[0] = INSIDE + scale * b0
    weights[1] = INSIDE + scale * b1
    weights[2] = INSIDE + scale * b2
    return True
