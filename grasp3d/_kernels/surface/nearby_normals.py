"""How far a surface turns near a contact: what a location error does to normals.

A contact that is felt at one place may be at another one nearby, where the normal is another: its
turn is the largest angle, over the places that are connected with the contact within the location
error, between the normal there and the set of normals that the contact may have. It is small where
the surface is flat, and what edges, rims and small radii cost.
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
"""Most planes that cut a face to its part within the location error."""

BEYOND = 1.0 + 1e-3
"""Distance up to which places count, in location errors: the planes need not be more."""

TOLERANCE = 1e-3
"""Angle by which a face may seem to turn more than others before that is made tight [rad]."""


class FacesAround(NamedTuple):
    """The faces around each vertex of a surface."""

    start: FixedInts1
    """First of each vertex in `faces` (V + 1,)."""
    faces: FixedInts1
    """(3 F,)"""


@merged
def _turn_to(set_, normal):
    """Smallest angle between a vector and a set of normals: rows, first of them, and number."""
    normals, first, count = set_
    return smallest_angle(normals, first, count, normal[0], normal[1], normal[2])


@merged
def _bound(most, straight, single):
    """Bound of the angles to a set of normals between places where they are at most `most`.

    Directions within an acute angle of one normal form a convex cone. The distance from the cone of
    several is convex in the interpolated normal, whose length is at least `straight`.
    """
    if straight >= 1.0:
        return most
    if most >= 0.5 * math.pi:
        return min(most + 2.0 * math.acos(straight), math.pi)
    return most if single else math.asin(min(math.sin(most) / max(straight, 1e-12), 1.0))


@part
def _turn_of_face(face, point, radius, set_, surface, tight, known, polygon):
    """Largest angle between a set and the normals of a face's part in a ball, if above `known`.

    It is tight: returned as both angles, or a bound of it, which is within `TOLERANCE` of a tight
    one of another face.

    Planes that touch the ball cut the face at the corner with the largest angle, until that is in
    the ball.
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
    centre = combined(1.0, point, -height, across)  # of the disc that the ball cuts out
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
    """Largest angle by which the surface turns within a distance of each of many contacts.

    Args:
        points: Contacts on the surface (m, 3).
        faces: A face that each lies on (m,).
        start: First row of each contact's normals (m,).
        counts: Number of its normals, as corners of a convex set; 0: every direction (m,).
        normals: Inward unit normals (K, 3).
        radius: The distance.
        enough: Angle from which on it need not be the largest [rad].
        surface: `Surface`.
        sets: `ContactNormals`.
        around: `FacesAround`.
        turns: Written, angles [rad] (m,); pi where any normal may be nearby, and never less than
            over the places that are nearer than `radius`.
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
