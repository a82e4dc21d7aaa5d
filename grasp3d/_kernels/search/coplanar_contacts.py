"""Force closure of three contacts, tested in the plane through them.

By the moment balance about the line through two contacts, the third one can exert no force across
the plane. So three hard contacts that are not collinear are force-closed exactly when each friction
cone intersects the plane in a planar cone and these three are force-closed in the plane (Ponce &
Faverjon 1995). A planar cone has two edges (Nguyen 1988), so six wrenches of three numbers replace
a hull in six dimensions.
"""

import math
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.compiling import Floats1, Floats2, merged, part, scratch_kernel
from grasp3d._kernels.surface.vectors import copy, cross, difference, divided, dot, norm, scaled

COLLINEAR = 1e-6
"""Sine of the angle between a triangle's shortest and longest sides below which its corners count
as collinear."""

SHORT = 1e-5
"""Length of a side, relative to the longest, below which its direction needs care."""

ROUNDING = 1e-13
"""Determinant of three wrenches of size 1 below which they count as coplanar."""


class Plane(NamedTuple):
    """Three contacts projected onto the plane through them; scratch arrays."""

    frame: Floats2
    """Two unit vectors in the plane and its normal (3, 3)."""
    positions: Floats2
    """Contacts relative to their centroid, scaled to a longest side of 1 (3, 2)."""
    normals: Floats2
    """Normals of the contacts projected onto the plane (3, 2)."""
    radii: Floats1
    """Angle by which each friction cone is narrowed, the largest deviation of its normal from the
    true one [rad] (3,)."""
    edges: Floats2
    """Wrenches (force, moment) of the two edges of each planar cone (6, 3)."""
    separating: Floats1
    """Separating direction if the cones are not force-closed (3,)."""


def make_plane() -> Plane:
    """Allocate the arrays of a plane."""
    return Plane(
        frame=np.zeros((3, 3)),
        positions=np.zeros((3, 2)),
        normals=np.zeros((3, 2)),
        radii=np.zeros(3),
        edges=np.zeros((6, 3)),
        separating=np.zeros(3),
    )


@part
def set_contact_plane(points, plane):
    """Write the plane through three points (3, 3); return False if they are collinear."""
    frame, positions = plane.frame, plane.positions
    a, b = difference(points[1], points[0]), difference(points[2], points[0])
    c = difference(points[2], points[1])
    one, two, three = dot(a, a), dot(b, b), dot(c, c)
    # The length of the normal to the plane is twice the area of the triangle.
    longest, normal = max(one, two, three), cross(a, b)
    is_last_short = three < SHORT * SHORT * longest
    if is_last_short:  # the difference of two long sides would lose its direction
        normal = cross(a, c)
    area = norm(normal)
    # Differences of nearby points are exact: even the shortest side has a direction, and only a
    # flat angle makes the plane uncertain.
    shortest = min(one, two, three)
    if not area > COLLINEAR * math.sqrt(shortest * longest) or not shortest > 0.0:
        return False
    normal, along = divided(normal, area), divided(a, math.sqrt(one))
    copy(along, frame[0])
    copy(cross(normal, along), frame[1])
    copy(normal, frame[2])
    scale = 1.0 / math.sqrt(longest)
    for k in range(2):
        first = dot(frame[k], a) * scale
        second = dot(frame[k], b) * scale
        if is_last_short:
            second = first + dot(frame[k], c) * scale
        middle = (first + second) / 3.0
        positions[0, k], positions[1, k], positions[2, k] = -middle, first - middle, second - middle
    return True


@merged
def set_normal(normal, radius, i, plane):
    """Project a contact's normal onto the plane; return the sine of its elevation."""
    plane.radii[i] = radius
    for k in range(2):
        plane.normals[i, k] = dot(plane.frame[k], normal)
    return abs(dot(plane.frame[2], normal))


@merged
def _set_edge(row, i, x, y, plane):
    """Write the wrench of a unit force of contact i along (x, y)."""
    plane.edges[row, 0], plane.edges[row, 1] = x, y
    plane.edges[row, 2] = plane.positions[i, 0] * y - plane.positions[i, 1] * x


@merged
def _set_cone(i, cosine, plane):
    """Write the edges of a contact's planar cone; return whether the cone intersects the plane.

    A friction cone of half-angle beta about a normal whose projection has length l meets the plane
    in a cone of half-angle acos(cos(beta) / l) about the projection.
    """
    a, b = plane.normals[i, 0], plane.normals[i, 1]
    length = math.sqrt(a * a + b * b)
    if not length > cosine:
        return False
    c = cosine / length
    s = math.sqrt((1.0 - c) * (1.0 + c))
    a, b = a / length, b / length
    _set_edge(2 * i, i, a * c - b * s, b * c + a * s, plane)
    _set_edge(2 * i + 1, i, a * c + b * s, b * c - a * s, plane)
    return True


@part
def cones_force_closed(plane):
    """Whether the six edges' wrenches positively span all planar wrenches.

    If they do not, all lie on one side of a plane through the origin and two of them, whose normal
    is written to `separating`.
    """
    edges = plane.edges
    # A separating plane can be turned about the origin until two of the wrenches lie in it.
    for a in range(1, 6):
        for b in range(a):
            # u is orthogonal to both wrenches; the other four determine the side.
            u = cross(edges[a], edges[b])
            any_below = any_above = False
            for c in range(6):
                if c not in (a, b):
                    side = dot(u, edges[c])
                    any_below = any_below or side < -ROUNDING
                    any_above = any_above or side > ROUNDING
                    if any_below and any_above:
                        break
            if any_below != any_above:
                copy(u if any_below else scaled(-1.0, u), plane.separating)
                return False
    return True


@merged
def set_cones(angle, plane):
    """Write the edges of all cones at a friction angle; return whether all intersect the plane."""
    cosine = math.cos(angle)
    for i in range(3):
        radius = plane.radii[i]
        own = math.cos(angle - radius) if radius > 0.0 else cosine
        if angle < radius or not _set_cone(i, own, plane):
            return False
    return True


@merged
def arc_sine(sine):
    """Arcsine [rad] of a value that rounding errors may have moved out of range."""
    return math.asin(min(max(sine, -1.0), 1.0))


@merged
def _proven_angle(plane):
    """Lower bound of the critical angle [rad], proven by the direction `separating`."""
    u, least, angle = plane.separating, 1.0, math.pi
    for i in range(3):
        gx, gy = u[0] - u[2] * plane.positions[i, 1], u[1] + u[2] * plane.positions[i, 0]
        work = math.sqrt(gx * gx + gy * gy)
        if work > 0.0:
            sine = -(gx * plane.normals[i, 0] + gy * plane.normals[i, 1]) / work
            if plane.radii[i] > 0.0:
                angle = min(angle, arc_sine(sine) + plane.radii[i])
            else:
                least = min(least, sine)
    return min(angle, arc_sine(least))


@part
def critical_of_normals(plane, low, high, tolerance):
    """Find the critical friction angle of three contacts with one normal each, in their plane.

    Args:
        plane: `Plane` of the contacts.
        low: Lower bound [rad]: the largest sum of a normal's elevation over the plane and its
            radius.
        high: Upper bound, at most pi / 2 [rad]; returned if nothing lower is force-closed.
        tolerance: Width [rad] of the bracket whose upper end is returned.
    """
    while high - low > tolerance:
        middle = 0.5 * (low + high)
        if set_cones(middle, plane):
            if cones_force_closed(plane):
                high = middle
                continue
            # The separating direction proves a lower bound, often above the middle.
            low = max(low, min(_proven_angle(plane), high))
        low = max(low, middle)
    return high


@scratch_kernel("Floats3, FixedFloats3, float, Plane, Floats1")
def critical_of_three(points, normals, tolerance, plane, angles):
    """Compute the critical friction angles of many grasps of three contacts.

    Args:
        points: Contacts (b, 3, 3).
        normals: Inward unit normals (b, 3, 3).
        tolerance: Width [rad] of the bracket whose upper end is written.
        plane: Scratch arrays.
        angles: Written, critical angles [rad], pi / 2 if no friction suffices, nan if the contacts
            are collinear (b,).
    """
    for g in range(points.shape[0]):
        if not set_contact_plane(points[g], plane):
            angles[g] = math.nan
            continue
        sine = 0.0
        for i in range(3):
            sine = max(sine, set_normal(normals[g, i], 0.0, i, plane))
        low = math.asin(min(sine, 1.0))
        angles[g] = critical_of_normals(plane, low, 0.5 * math.pi, tolerance)
