"""Three contacts: their forces can balance only in the plane through them.

The moment about the line through two of the contacts leaves nothing across the plane for the third.
So three hard contacts that are not on one line close exactly when friction reaches into the plane
at each of them and the planar cones close in it (Ponce & Faverjon 1995): six wrenches of three
numbers, instead of a hull in six dimensions.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling import inlined, merged, scratch_kernel

ON_LINE = 1e-6
"""Height of a triangle over its longest side, as a share of it, below which it is a line."""

ROUNDING = 1e-13
"""Volume of three wrenches of size 1 that counts as none."""


class Plane(NamedTuple):
    """The plane through three contacts; scratch."""

    frame: npt.NDArray[np.float64]
    """Two directions in it and its normal (3, 3)."""
    places: npt.NDArray[np.float64]
    """The contacts about their middle, the longest side being 1 (3, 2)."""
    pushes: npt.NDArray[np.float64]
    """The parts of their normals in the plane (3, 2)."""
    edges: npt.NDArray[np.float64]
    """Wrenches (force, moment) along the two edges of each cone (6, 3)."""
    apart: npt.NDArray[np.float64]
    """Direction in which no wrench lies, where the cones do not close (3,)."""
    arcs: npt.NDArray[np.float64]
    """First and last direction of each contact's forces, over several normals [rad] (3, 2)."""


class Fans(NamedTuple):
    """Several normals of each of three contacts, laid in their plane; scratch."""

    azimuths: npt.NDArray[np.float64]
    """Directions of their parts in the plane, those of a contact without a jump [rad] (3, k)."""
    lengths: npt.NDArray[np.float64]
    """Lengths of these parts (3, k)."""
    counts: npt.NDArray[np.int64]
    """How many normals each contact has (3,)."""


def make_plane() -> Plane:
    """Allocate a plane."""
    return Plane(
        frame=np.zeros((3, 3)),
        places=np.zeros((3, 2)),
        pushes=np.zeros((3, 2)),
        edges=np.zeros((6, 3)),
        apart=np.zeros(3),
        arcs=np.zeros((3, 2)),
    )


def make_fans(normals: int) -> Fans:
    """Allocate room for so many normals at each contact."""
    return Fans(np.zeros((3, normals)), np.zeros((3, normals)), np.zeros(3, dtype=np.int64))


@scratch_kernel
def lay_plane(points, plane):
    """Lay the plane through three points (3, 3); returns whether they make one."""
    frame, places = plane.frame, plane.places
    p, q, r = points[0], points[1], points[2]
    ax, ay, az = q[0] - p[0], q[1] - p[1], q[2] - p[2]
    bx, by, bz = r[0] - p[0], r[1] - p[1], r[2] - p[2]
    cx, cy, cz = bx - ax, by - ay, bz - az
    one, two = ax * ax + ay * ay + az * az, bx * bx + by * by + bz * bz
    three = cx * cx + cy * cy + cz * cz
    longest = max(one, two, three)
    mx, my, mz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    area = math.sqrt(mx * mx + my * my + mz * mz)
    if not area > ON_LINE * longest or not min(one, two, three) > 0.0:
        return False
    mx, my, mz = mx / area, my / area, mz / area
    length = math.sqrt(one)
    ex, ey, ez = ax / length, ay / length, az / length
    frame[0, 0], frame[0, 1], frame[0, 2] = ex, ey, ez
    frame[1, 0], frame[1, 1], frame[1, 2] = my * ez - mz * ey, mz * ex - mx * ez, mx * ey - my * ex
    frame[2, 0], frame[2, 1], frame[2, 2] = mx, my, mz
    scale = 1.0 / math.sqrt(longest)
    for k in range(2):
        a = (frame[k, 0] * ax + frame[k, 1] * ay + frame[k, 2] * az) * scale
        b = (frame[k, 0] * bx + frame[k, 1] * by + frame[k, 2] * bz) * scale
        middle = (a + b) / 3.0
        places[0, k], places[1, k], places[2, k] = -middle, a - middle, b - middle
    return True


@merged
def lay_push(normal, i, plane):
    """Lay a contact's normal into the plane; returns the sine of its angle to the plane."""
    frame = plane.frame
    for k in range(2):
        plane.pushes[i, k] = (
            frame[k, 0] * normal[0] + frame[k, 1] * normal[1] + frame[k, 2] * normal[2]
        )
    return abs(frame[2, 0] * normal[0] + frame[2, 1] * normal[1] + frame[2, 2] * normal[2])


@merged
def lay_cone(i, cosine, plane):
    """Lay the edges of a contact's cone in the plane; returns whether it reaches into it."""
    a, b = plane.pushes[i, 0], plane.pushes[i, 1]
    length = math.sqrt(a * a + b * b)
    if not length > cosine:
        return False
    c = cosine / length
    s = math.sqrt((1.0 - c) * (1.0 + c))
    a, b = a / length, b / length
    x, y, edges = plane.places[i, 0], plane.places[i, 1], plane.edges
    fx, fy = a * c - b * s, b * c + a * s
    edges[2 * i, 0], edges[2 * i, 1], edges[2 * i, 2] = fx, fy, x * fy - y * fx
    fx, fy = a * c + b * s, b * c - a * s
    edges[2 * i + 1, 0], edges[2 * i + 1, 1], edges[2 * i + 1, 2] = fx, fy, x * fy - y * fx
    return True


@scratch_kernel
def cones_close(plane):
    """Whether the six edges reach every planar wrench.

    If they do not, they all lie on one side of a plane through two of them, which `apart` keeps.
    """
    edges, apart = plane.edges, plane.apart
    for a in range(1, 6):
        for b in range(a):
            ux = edges[a, 1] * edges[b, 2] - edges[a, 2] * edges[b, 1]
            uy = edges[a, 2] * edges[b, 0] - edges[a, 0] * edges[b, 2]
            uz = edges[a, 0] * edges[b, 1] - edges[a, 1] * edges[b, 0]
            before = after = False
            for c in range(6):
                if c not in (a, b):
                    side = ux * edges[c, 0] + uy * edges[c, 1] + uz * edges[c, 2]
                    before = before or side < -ROUNDING
                    after = after or side > ROUNDING
                    if before and after:
                        break
            if before != after:
                sign = 1.0 if before else -1.0
                apart[0], apart[1], apart[2] = sign * ux, sign * uy, sign * uz
                return False
    return True


@merged
def _least_angle(plane):
    """Sine of the friction angle that direction `apart` proves not to be enough."""
    u, least = plane.apart, 1.0
    for i in range(3):
        gx, gy = u[0] - u[2] * plane.places[i, 1], u[1] + u[2] * plane.places[i, 0]
        work = math.sqrt(gx * gx + gy * gy)
        if work > 0.0:
            least = min(least, -(gx * plane.pushes[i, 0] + gy * plane.pushes[i, 1]) / work)
    return least


@scratch_kernel
def critical_of_pushes(plane, low, high, tolerance):
    """Critical friction angle of three contacts whose normals are laid in their plane.

    Args:
        plane: `Plane`, with places and pushes.
        low: An angle that is not enough [rad]: the largest between a normal and the plane.
        high: An angle that is enough, at most pi / 2 [rad]; returned where nothing less is.
        tolerance: Width of the bracket [rad] whose upper end is returned.
    """
    while high - low > tolerance:
        middle = 0.5 * (low + high)
        cosine = math.cos(middle)
        if lay_cone(0, cosine, plane) and lay_cone(1, cosine, plane) and lay_cone(2, cosine, plane):
            if cones_close(plane):
                high = middle
                continue
            low = max(low, min(math.asin(min(max(_least_angle(plane), -1.0), 1.0)), high))
        low = max(low, middle)
    return high


@merged
def lay_in_fan(normal, i, k, plane, fans):
    """Lay a contact's normal number k into the plane."""
    frame = plane.frame
    a = frame[0, 0] * normal[0] + frame[0, 1] * normal[1] + frame[0, 2] * normal[2]
    b = frame[1, 0] * normal[0] + frame[1, 1] * normal[1] + frame[1, 2] * normal[2]
    azimuth = math.atan2(b, a)
    if k > 0:
        turn = azimuth - fans.azimuths[i, 0]
        azimuth -= 2.0 * math.pi * round(turn / (2.0 * math.pi))
    fans.azimuths[i, k], fans.lengths[i, k] = azimuth, math.sqrt(a * a + b * b)


@inlined
def _lay_arc(i, cosine, helping, plane, fans):
    """Lay out what a contact's forces can be, whichever of its normals it has, or with any of them.

    In the plane what one normal leaves out joins on to what the next one leaves out, so that the
    first and the last direction tell of all of them.

    Returns:
        Whether there are any.
    """
    first, last, some = -math.inf, math.inf, False
    if helping:
        first, last = math.inf, -math.inf
    for k in range(fans.counts[i]):
        length, azimuth = fans.lengths[i, k], fans.azimuths[i, k]
        if length > cosine:
            half, some = math.acos(cosine / length), True
            if helping:
                first, last = min(first, azimuth - half), max(last, azimuth + half)
            else:
                first, last = max(first, azimuth - half), min(last, azimuth + half)
        elif not helping:
            return False
    plane.arcs[i, 0], plane.arcs[i, 1] = first, last
    return some


@inlined
def _lay_edge(row, i, azimuth, plane):
    c, s = math.cos(azimuth), math.sin(azimuth)
    plane.edges[row, 0], plane.edges[row, 1] = c, s
    plane.edges[row, 2] = plane.places[i, 0] * s - plane.places[i, 1] * c


@scratch_kernel
def fans_close(angle, helping, plane, fans):
    """Whether three contacts close at a friction angle with all their normals, or with some.

    Where the forces that all normals of a contact allow are none, its outermost directions must do
    one by one; where those that some allow are more than half of the plane, each half is tried.

    Args:
        angle: Half-angle of the cones [rad].
        helping: With some combination of the normals; otherwise with all of them.
        plane: `Plane`, laid.
        fans: `Fans`, laid.
    """
    cosine = math.cos(angle)
    for i in range(3):
        if not _lay_arc(i, cosine, helping, plane, fans):
            return False
        width = plane.arcs[i, 1] - plane.arcs[i, 0]
        if helping and width >= 2.0 * math.pi:
            return True  # nothing is left out: not to be told apart
        if not helping and width <= -math.pi:
            return False
    for code in range(8):
        possible = True
        for i in range(3):
            first, last = plane.arcs[i, 0], plane.arcs[i, 1]
            parted = last - first >= math.pi if helping else last < first
            second = code >> i & 1 == 1
            possible = possible and (parted or not second)
            if parted and helping:
                middle = 0.5 * (first + last)
                first, last = (middle, last) if second else (first, middle)
            elif parted:
                first = last = last if second else first
            _lay_edge(2 * i, i, last, plane)
            _lay_edge(2 * i + 1, i, first, plane)
        if possible and cones_close(plane) == helping:
            return helping
    return not helping


@scratch_kernel
def critical_of_fans(low, high, tolerance, helping, plane, fans):
    """Critical friction angle of three contacts over their worst, or their best, normals.

    Args:
        low: An angle that is not enough [rad].
        high: An angle that is enough [rad].
        tolerance: Width of the bracket [rad] whose upper end is returned.
        helping: As for `fans_close`.
        plane: `Plane`, laid.
        fans: `Fans`, laid.
    """
    while high - low > tolerance:
        middle = 0.5 * (low + high)
        if fans_close(middle, helping, plane, fans):
            high = middle
        else:
            low = middle
    return high


@scratch_kernel
def critical_of_sets(points, first, counts, normals, tolerance, plane, fans, worst, best):
    """Critical friction angles of many grasps of three contacts with several normals each.

    Args:
        points: Contacts (b, 3, 3).
        first: First row of each contact's normals (b, 3).
        counts: How many those are, one at least (b, 3).
        normals: Inward unit normals (k, 3).
        tolerance: Width of the brackets [rad].
        plane: Scratch.
        fans: Scratch with room for the most normals of a contact.
        worst: Written, upper end of the bracket over all combinations of normals [rad], pi / 2
            where no friction closes all; nan where the contacts are on one line (b,).
        best: Written, lower end of the bracket of the smallest over the combinations [rad] (b,).
    """
    right = 0.5 * math.pi
    for g in range(points.shape[0]):
        worst[g] = best[g] = math.nan
        if not lay_plane(points[g], plane):
            continue
        for i in range(3):
            fans.counts[i] = counts[g, i]
            for k in range(counts[g, i]):
                lay_in_fan(normals[first[g, i] + k], i, k, plane, fans)
        worst[g] = critical_of_fans(0.0, right, tolerance, False, plane, fans)  # noqa: FBT003
        best[g] = critical_of_fans(0.0, right, tolerance, True, plane, fans)  # noqa: FBT003
        if best[g] < right:
            best[g] = max(0.0, best[g] - tolerance)


@scratch_kernel
def critical_of_three(points, normals, tolerance, plane, angles):
    """Critical friction angles of many grasps of three contacts.

    Args:
        points: Contacts (b, 3, 3).
        normals: Inward unit normals (b, 3, 3).
        tolerance: Width of the bracket [rad] whose upper end is written.
        plane: Scratch.
        angles: Written, critical angles [rad], pi / 2 where no friction closes the grasp; nan
            where the contacts are on one line and have no plane (b,).
    """
    for g in range(points.shape[0]):
        if not lay_plane(points[g], plane):
            angles[g] = math.nan
            continue
        sine = 0.0
        for i in range(3):
            sine = max(sine, lay_push(normals[g, i], i, plane))
        low = math.asin(min(sine, 1.0))
        angles[g] = critical_of_pushes(plane, low, 0.5 * math.pi, tolerance)
