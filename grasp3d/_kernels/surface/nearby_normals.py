"""How far a surface turns near a contact, that is, what a location error does to normals.

The true contact may be near the place where it is felt and have another normal. The turn of a
contact is the largest angle between a normal nearby and the set of normals that the contact may
have, over the points connected with the contact within the location error. It is small where the
surface is flat, and large at edges, rims and small radii.
"""

import math
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.compiling import FixedInts1, kernel, merged, part
from grasp3d._kernels.surface.box_tree import distance_to_edge
from grasp3d._kernels.surface.polygons import REGION_CORNERS, cut
from grasp3d._kernels.surface.surface_contacts import ANY_NORMAL, smallest_angle
from grasp3d._kernels.surface.vectors import (
    combined,
    cross,
    difference,
    divided,
    dot,
    norm,
    triple,
    weighted_sum,
)

MOST_CUTS = 24
"""Most planes that cut a face down to its part within the location error."""

BEYOND = 1.0 + 1e-3
"""Distance, in location errors, up to which points count: slightly above 1 to save planes."""

TOLERANCE = 1e-3
"""Angle [rad] by which a face may seem to turn more than others before its bound is tightened."""


class FacesAround(NamedTuple):
    """The faces around each vertex of a surface."""

    start: FixedInts1
    """First face of each vertex in `faces` (V + 1,)."""
    faces: FixedInts1
    """Faces around each vertex (3 F,)."""


@merged
def _turn_to(set_, normal):
    """Smallest angle between a vector and a set of normals, given as (rows, first one, number)."""
    normals, first, count = set_
    return smallest_angle(normals, first, count, normal[0], normal[1], normal[2])


@merged
def _bound(most, straight, single):
    """Bound of the angles to a set of normals between points where they are at most `most`.

    Directions within an acute angle of one normal form a convex cone. The distance from the cone of
    several normals is convex in the interpolated normal, whose length is at least `straight`.
    """
    if straight >= 1.0:
        return most
    if most >= 0.5 * math.pi:
        return min(most + 2.0 * math.acos(straight), math.pi)
    return most if single else math.asin(min(math.sin(most) / max(straight, 1e-12), 1.0))


@part
def _turn_of_face(face, point, radius, set_, surface, tight, known, polygon):
    """Raise (tight, known) to the largest angle between a set and a face's normals in a ball.

    If that angle exceeds `known`, either both become the angle, or `known` alone becomes a bound of
    it that is within `TOLERANCE` of `tight`, the largest exact angle of a face so far.

    Planes that touch the ball cut off the face's corner with the largest angle, until that corner
    is in the ball.
    """
    rows = surface.corners[face]
    n = triple(surface.normals[rows[0]], 0)
    n1, n2 = triple(surface.normals[rows[1]], 0), triple(surface.normals[rows[2]], 0)
    mean, single = weighted_sum((1.0, 1.0, 1.0), n, n1, n2), set_[2] == 1
    mean = divided(mean, max(norm(mean), 1e-12))
    straight = max(min(dot(n, mean), dot(n1, mean), dot(n2, mean)), 0.0)
    if straight > 1.0 - 1e-12:
        straight = 1.0
    most = max(_turn_to(set_, n), _turn_to(set_, n1), _turn_to(set_, n2))
    if _bound(most, straight, single) <= known:
        return tight, known
    vertices = surface.faces[face]
    corner = triple(surface.points[vertices[0]], 0)
    u = difference(surface.points[vertices[1]], corner)
    w = difference(surface.points[vertices[2]], corner)
    p, q = difference(n1, n), difference(n2, n)
    across = cross(u, w)
    area = norm(across)
    across = divided(across, max(area, 1e-300))
    height = dot(difference(point, corner), across)
    square = radius * radius - height * height
    if area == 0.0 or square < 0.0:
        return tight, known
    centre = combined(1.0, point, -height, across)  # of the disc in which the ball cuts the plane
    own_radius, size = math.sqrt(square), 3
    for i in range(size):
        polygon[i, 0], polygon[i, 1] = 1.0 * (i == 1), 1.0 * (i == 2)
    for number in range(MOST_CUTS):
        most, row = -1.0, 0
        for i in range(size):
            angle = _turn_to(set_, weighted_sum((1.0, polygon[i, 0], polygon[i, 1]), n, p, q))
            if angle > most:
                most, row = angle, i
        most = _bound(most, straight, single)
        if most <= known:
            return tight, known
        place = weighted_sum((1.0, polygon[row, 0], polygon[row, 1]), corner, u, w)
        beyond = difference(place, centre)
        distance = norm(beyond)
        if distance <= own_radius * BEYOND:
            break
        if number > 0 and most <= tight + TOLERANCE:
            return tight, most
        constant = dot(difference(corner, centre), beyond) - distance * own_radius
        size, _ = cut(polygon, size, dot(u, beyond), dot(w, beyond), constant)
        if size == 0:
            return tight, known
    return max(tight, most), most


@kernel(
    "Floats2, Ints1, Ints1, Ints1, FixedFloats2, float, float, Surface, ContactNormals, "
    "FacesAround, Floats1"
)
def largest_turns(
    points, faces, start, counts, normals, radius, enough, surface, sets, around, turns
):
    """Find the largest angle by which the surface turns within a distance of each contact.

    Args:
        points: Contacts on the surface (m, 3).
        faces: A face on which each contact lies (m,).
        start: First row of each contact's normals (m,).
        counts: Number of each contact's normals, corners of a convex set; 0: every direction (m,).
        normals: Inward unit normals (K, 3).
        radius: The distance.
        enough: Angle [rad] above which it need not be the largest.
        surface: `Surface`.
        sets: `ContactNormals`.
        around: `FacesAround`.
        turns: Written, angles [rad]; pi if any normal may be nearby; never too small for the points
            nearer than `radius` (m,).
    """
    seen = np.full(surface.faces.shape[0], -1, dtype=np.int64)
    waiting = np.empty(surface.faces.shape[0], dtype=np.int64)
    polygon = np.empty((2 * REGION_CORNERS, 3))
    for i in range(points.shape[0]):
        turns[i] = 0.0
        if faces[i] < 0 or counts[i] == 0:
            continue
        point, set_ = triple(points[i], 0), (normals, start[i], counts[i])
        seen[faces[i]], waiting[0], count, number, tight = i, faces[i], 1, 0, 0.0
        while number < count and turns[i] < enough:
            face = waiting[number]
            number += 1
            tight, turns[i] = _turn_of_face(
                face, point, radius, set_, surface, tight, turns[i], polygon
            )
            for k in range(3):
                a, b = surface.faces[face, (k + 1) % 3], surface.faces[face, (k + 2) % 3]
                line = difference(point, surface.points[a])
                edge = difference(surface.points[b], surface.points[a])
                if distance_to_edge(line, edge) > radius * radius:
                    continue
                at_tip = sets.counts[a] == 0 and norm(line) <= radius
                if at_tip or surface.twins[face, k, 0] == ANY_NORMAL:
                    turns[i] = math.pi
                for j in range(around.start[a], around.start[a + 1]):
                    other = around.faces[j]
                    row = surface.faces[other]
                    if seen[other] != i and b in (row[0], row[1], row[2]):
                        seen[other], waiting[count] = i, other
                        count += 1
