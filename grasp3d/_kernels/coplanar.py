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

from grasp3d._kernels.compiling import merged, scratch_kernel

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


def make_plane() -> Plane:
    """Allocate a plane."""
    return Plane(
        frame=np.zeros((3, 3)),
        places=np.zeros((3, 2)),
        pushes=np.zeros((3, 2)),
        edges=np.zeros((6, 3)),
        apart=np.zeros(3),
    )


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
