"""Grasps of a vertex with an opposing contact on a face: bounds, angles, and the best points.

Angles are compared by their cosines, where larger is better; this saves most of the time.
"""

import math
from typing import NamedTuple

from grasp3d._kernels.compiling import FixedFloats2, merged, part, scratch_kernel
from grasp3d._kernels.search.antipodal_candidates import PairLimits
from grasp3d._kernels.surface.face_tree import FaceTree
from grasp3d._kernels.surface.surface_contacts import (
    ContactNormals,
    Surface,
    line_turn,
    turn_at_vertex,
    turn_on_face,
)
from grasp3d._kernels.surface.vectors import (
    combined,
    copy,
    cross,
    difference,
    divided,
    dot,
    in_triangle,
    norm,
    scaled,
    squared_distance,
    triple,
    weighted_sum,
)

INSIDE = 2e-9
"""Least barycentric coordinate of a candidate, to stay off edges, where other normals count too."""

STEPS = (0.4, 0.25, 0.15, 0.1, 0.05)
"""Steps of barycentric coordinates by which a contact is moved on its face."""

NONE = -2.0
"""Value that stands for the cosine if there is no grasp."""


class PairDomain(NamedTuple):
    """Where opposing contacts of vertices are sought."""

    surface: Surface
    sets: ContactNormals
    centres: FixedFloats2
    """Centre of each vertex's set of normals (V, 3)."""
    tree: FaceTree
    limits: PairLimits


@merged
def own_cosine(own, line):
    """Cosine of the angle between a vector and the vertex's worst normal; inf if it has none."""
    least = math.inf
    for i in range(own.shape[0]):
        least = min(least, dot(own[i], line))
    return least / norm(line)


@merged
def _sine(cosine):
    return math.sqrt(max(1.0 - cosine * cosine, 0.0))


@merged
def _nearer(cosine, cosine_by, sine_by):
    """Cosine of an angle reduced by another one, but not below 0."""
    return 1.0 if cosine >= cosine_by else cosine * cosine_by + _sine(cosine) * sine_by


@merged
def upper_bound(node, v, own, domain, least):
    """Upper bound of the cosine of the critical angles of a vertex and a node's faces.

    The line to any point in the node's ball is within an angle `ball` of the line to its centre,
    and any normal within `spread` of the cone's axis. The two angles of a grasp add up to at least
    the angle between one normal and the reversed other one. A line of at most the length `reach` to
    a point beyond a plane is within an angle of the plane's normal.
    Once below `least`, the bound is not tightened further.
    """
    bound = _upper_bound_of_normals(node, v, own, domain, least)
    turns, ball = domain.surface.turns, domain.tree.bounds[node]
    if turns.error > 0.0 and bound > least:
        far = norm(difference(ball, domain.surface.points[v])) + ball[3]
        turn = line_turn(min(far, domain.limits.largest), turns)
        one, other = turn_at_vertex(v, turns), ball[10]
        bound = min(_farther(bound, min(one, other)), math.cos(max(one, other)))
        bound = _farther(bound, turn)
    return bound


@merged
def _farther(cosine, angle):
    """Cosine of an angle increased by another one, but not above pi."""
    return math.cos(min(math.acos(min(max(cosine, -1.0), 1.0)) + angle, math.pi))


@merged
def _upper_bound_of_normals(node, v, own, domain, least):
    """`upper_bound` from the angles between lines and normals."""
    bounds, point, limits = domain.tree.bounds[node], domain.surface.points[v], domain.limits
    radius, cos_spread, sin_spread = bounds[3], bounds[7], bounds[8]
    axis = triple(bounds, 4)
    turn = own_cosine(own, scaled(-1.0, axis))
    both = _nearer(turn, cos_spread, sin_spread)
    bound = math.sqrt(max(0.5 + 0.5 * both, 0.0))
    if bound <= least:
        return bound
    line = difference(bounds, point)
    square = dot(line, line)
    distance = math.sqrt(square)
    if distance - radius > limits.largest or distance + radius < limits.smallest:
        return NONE
    reach = min(distance + radius, limits.largest)
    beyond = (dot(axis, point) - bounds[9]) / reach
    if beyond > 1.0:
        return NONE
    if beyond > 0.0:
        bound = min(bound, _nearer(turn, beyond, _sine(beyond)))
    if distance > radius and bound > least:
        tangent = math.sqrt(square - radius * radius)
        cos_ball, sin_ball = tangent / distance, radius / distance
        if tangent > limits.largest:  # the lines tangent to the ball are too long
            cos_ball = (square + reach * reach - radius * radius) / (2.0 * distance * reach)
            sin_ball = _sine(cos_ball)
        bound = min(bound, _nearer(own_cosine(own, line), cos_ball, sin_ball))
        cosine = cos_ball * cos_spread - sin_ball * sin_spread
        sine = sin_ball * cos_spread + cos_ball * sin_spread
        if bound > least and sine > 0.0:  # otherwise both angles add up to more than pi
            bound = min(bound, _nearer(-dot(axis, line) / distance, cosine, sine))
    return bound


@merged
def read_face(face, v, surface, lines, normals):
    """Write the lines from a vertex to the corners of a face, and the corners' normals."""
    for k in range(3):
        corner = surface.points[surface.faces[face, k]]
        copy(difference(corner, surface.points[v]), lines[k])
        copy(surface.normals[surface.corners[face, k]], normals[k])


@merged
def longest_difference(rows):
    """Largest distance between two of three points."""
    square = 0.0
    for k in range(3):
        square = max(square, squared_distance(rows[k], rows[(k + 1) % 3]))
    return math.sqrt(square)


@merged
def cosine_at(weights, v, face, lines, normals, own, domain):
    """Cosine of the critical angle of a vertex and a point inside a face.

    NONE if the opening is outside the limits.
    """
    limits, turns = domain.limits, domain.surface.turns
    line = weighted_sum(weights, lines[0], lines[1], lines[2])
    normal = weighted_sum(weights, normals[0], normals[1], normals[2])
    opening, length = norm(line), norm(normal)
    if not limits.smallest <= opening <= limits.largest or length < 1e-12:
        return NONE
    other, first = -dot(normal, line) / (opening * length), own_cosine(own, line)
    if turns.error > 0.0:
        turn = line_turn(opening, turns)
        other = _farther(other, turn_on_face(face, weights, turns) + turn)
        first = _farther(first, turn_at_vertex(v, turns) + turn)
    return min(other, first)


@part
def move_on_face(weights, cosine, v, face, lines, normals, own, domain):
    """Move a contact on its face in ever smaller steps while the angle falls; return its cosine.

    Each step is the best of the six from one corner toward another, in any order of the corners.

    Args:
        weights: Barycentric coordinates of the contact (3,); written.
        cosine: Cosine of its critical angle.
        v: The vertex.
        face: The face.
        lines: Lines from the vertex to the corners (3, 3).
        normals: Normals at the corners (3, 3).
        own: Normals of the vertex (k, 3).
        domain: `PairDomain`.
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
            changed = cosine_at(triple(weights, 0), v, face, lines, normals, own, domain)
            weights[giving] += moved
            weights[taking] -= moved
            if changed > cosine:
                cosine, best_giving, best_taking, best_moved = changed, giving, taking, moved
        weights[best_giving] -= best_moved
        weights[best_taking] += best_moved
    return cosine


@merged
def write_nearest(r, u, w, outward, weights):
    """Write the point of a triangle that is nearest to another, in barycentric coordinates.

    `r` leads from one corner to that point, `u` and `w` to the other corners; `outward` is u x w.
    """
    square = dot(outward, outward)
    b1, b2 = in_triangle(r, u, w, outward)
    b1, b2 = max(b1 / square, 0.0), max(b2 / square, 0.0)
    b0 = max(1.0 - b1 - b2, 0.0)
    scale = (1.0 - 3.0 * INSIDE) / (b0 + b1 + b2)
    weights[0] = INSIDE + scale * b0
    weights[1] = INSIDE + scale * b1
    weights[2] = INSIDE + scale * b2


@scratch_kernel()
def aim(face, v, centres, surface, weights):
    """Write the point of a face whose line makes equal angles with both normals; False if no exit.

    The best line is along the bisector of the normals; if it misses the face, the nearest point in
    barycentric coordinates is used.
    """
    points, normals = surface.points, surface.normals
    vertices, rows = surface.faces[face], surface.corners[face]
    corner = points[vertices[0]]
    line = difference(corner, points[v])
    u, w = difference(points[vertices[1]], corner), difference(points[vertices[2]], corner)
    outward = cross(u, w)
    height = dot(line, outward)
    if height <= 0.0:  # the line enters the object there
        return False
    normal = weighted_sum((1.0, 1.0, 1.0), normals[rows[0]], normals[rows[1]], normals[rows[2]])
    bisector = difference(centres[v], divided(normal, max(norm(normal), 1e-12)))
    square, slope = dot(outward, outward), dot(bisector, outward)
    if slope <= 1e-9 * math.sqrt(square):  # the bisector is parallel to the face
        weights[0], weights[1], weights[2] = 1.0 / 3.0, 1.0 / 3.0, 1.0 / 3.0
        return True
    write_nearest(combined(height / slope, bisector, -1.0, line), u, w, outward, weights)
    return True
