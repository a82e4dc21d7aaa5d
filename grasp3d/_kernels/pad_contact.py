"""First touch of a pad or round tip that moves along x, and the patch that it then touches.

Everything is in the frame of the gripper, with x multiplied by the side of the jaw (+1 finger 1,
-1 finger 2), so that both jaws move toward larger x. A *position* of a jaw is the x of its pad's
plane, or of the foremost point of its ball. Faces touch it whose outward normal has a negative x.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.clipping import (
    CORNERS,
    clip,
    clip_to_rectangle,
    crossings,
    disc_moments,
    projected_moments,
)
from grasp3d._kernels.compiling import kernel

ROUNDING = 1e-9
"""Distance, in object sizes, that counts as none: pads that only graze an edge do not touch it."""

EDGE_ON = 1e-9
"""Largest x of the unit normal of a face that counts as parallel to x, which is not touched."""

MIN_DEPTH = 1e-7
"""Smallest depth of a patch, in object sizes: rigid pads touch with the shape of the surface in the
limit of a small depth, so that also vertices and edges have a normal."""


class Jaw(NamedTuple):
    """Shape of a jaw, in object sizes."""

    half_width: float
    """Half of the pad along y; the radius of a round tip."""
    half_height: float
    """Half of the pad along z; the radius of a round tip."""
    radius: float
    """Radius of a round tip; 0: flat pad."""
    thickness: float
    """Of the finger behind a flat pad."""
    compliance: float
    """Depth to which the surface may press into the jaw."""


class Faces(NamedTuple):
    """Faces that a jaw might touch, in the first rows; see `closing.gather`."""

    numbers: npt.NDArray[np.int64]
    """Face of the mesh (F,)."""
    corners: npt.NDArray[np.float64]
    """Corners in the frame of the gripper (F, 3, 3)."""
    normals: npt.NDArray[np.float64]
    """Outward unit normals in that frame (F, 3)."""


class Patch(NamedTuple):
    """Sums over what a jaw touches; see `clear`."""

    moments: npt.NDArray[np.float64]
    """Area, and the integral of the position over it (4,)."""
    normal: npt.NDArray[np.float64]
    """Integral of the inward normals, in the mesh's frame (3,)."""
    bounds: npt.NDArray[np.float64]
    """Smallest y and z, largest y and z (4,)."""


class Scratch(NamedTuple):
    """Memory for one jaw."""

    polygon: npt.NDArray[np.float64]
    spare: npt.NDArray[np.float64]
    mean: npt.NDArray[np.float64]
    row: npt.NDArray[np.float64]


@kernel
def make_scratch():
    """Allocate the memory for one jaw."""
    return Scratch(np.empty((CORNERS, 6)), np.empty((CORNERS, 6)), np.empty(6), np.empty(6))


@kernel
def clear(patch):
    """Start a patch."""
    patch.moments[:] = 0.0
    patch.normal[:] = 0.0
    patch.bounds[:2] = math.inf
    patch.bounds[2:] = -math.inf


@kernel
def first_touch(faces, count, side, jaw, start, scratch):
    """Smallest position at which a jaw touches a face.

    Args:
        faces: The `Faces`.
        count: Number of them.
        side: +1 or -1.
        jaw: Shape of the jaw.
        start: Position from which it moves, to its mirror image.
        scratch: Memory; `row` is written: the point touched first, as a row of a polygon.

    Returns:
        (face, position): index among the faces, -1 none, -2: the jaw meets the surface at its start
        already.
    """
    found, first = -1, math.inf
    for i in range(count):
        corners, normal = faces.corners[i], faces.normals[i]
        if nearest(corners, side) >= first:
            continue
        if jaw.radius > 0.0:
            meets, position = _ball_position(corners, normal, side, jaw, start, scratch)
        else:
            meets, position = _pad_position(corners, side, jaw, start, scratch)
        if meets:
            return -2, first
        if side * normal[0] < -EDGE_ON and position < first and position <= ROUNDING - start:
            found, first = i, position
            scratch.row[:] = scratch.mean
    return found, first


@kernel
def nearest(corners, side):
    """Smallest x of a triangle; no jaw touches it at a smaller position."""
    return min(side * corners[0, 0], side * corners[1, 0], side * corners[2, 0])


@kernel
def _pad_position(corners, side, jaw, start, scratch):
    """(whether the pad overlaps a face at its start, position at which it touches it, inf: never).

    The point touched is written to `scratch.mean`.
    """
    polygon = scratch.polygon
    half_width, half_height = jaw.half_width - ROUNDING, jaw.half_height - ROUNDING
    count = clip_to_rectangle(corners, side, half_width, half_height, polygon, scratch.spare)
    if count < 3:
        return False, math.inf
    lowest, high = 0, -math.inf
    for i in range(count):
        high = max(high, polygon[i, 0])
        if polygon[i, 0] < polygon[lowest, 0]:
            lowest = i
    low = polygon[lowest, 0]
    scratch.mean[:] = polygon[lowest]
    if low < start - jaw.compliance - ROUNDING:
        return high > start - jaw.thickness + ROUNDING, math.inf
    return False, low


@kernel
def _ball_position(corners, normal, side, jaw, start, scratch):
    """The same for a ball."""
    radius = jaw.radius
    distance = _distance(corners, side, start - radius)
    if distance < radius - jaw.compliance - ROUNDING:
        return True, math.inf
    position = _touching_plane(corners, normal, side, radius, scratch.mean)
    if position == math.inf:
        for i in range(3):
            other, t = _touching_edge(corners, i, side, radius)
            if other < position:
                position = other
                _write_on_edge(corners, i, t, side, scratch.mean)
    # A face that the ball does not meet at its start is ahead of it or behind it as a whole.
    if position < start - jaw.compliance - ROUNDING:
        return False, math.inf
    return False, position


@kernel
def _write_on_edge(corners, i, t, side, row):
    """Write the point at fraction t of the edge from corner i to the next."""
    j = (i + 1) % 3
    for k in range(3):
        row[k] = (1.0 - t) * corners[i, k] + t * corners[j, k]
        row[3 + k] = 0.0
    row[0] *= side
    row[3 + i], row[3 + j] = 1.0 - t, t


@kernel
def _touching_plane(corners, normal, side, radius, row):
    """Position at which a ball touches the inside of a face, inf if it does not; writes the point.

    The ball touches a plane with the point of its surface that faces it.
    """
    if side * normal[0] > -EDGE_ON:
        return math.inf
    y, z = -radius * normal[1], -radius * normal[2]
    total, x = 0.0, 0.0
    for i in range(3):
        a, b = corners[(i + 1) % 3], corners[(i + 2) % 3]
        row[3 + i] = (a[1] - y) * (b[2] - z) - (a[2] - z) * (b[1] - y)
        total += row[3 + i]
    for i in range(3):
        row[3 + i] /= total
        if not row[3 + i] >= 0.0:
            return math.inf
        x += row[3 + i] * side * corners[i, 0]
    row[0], row[1], row[2] = x, y, z
    return x + radius * side * normal[0] + radius


@kernel
def _touching_edge(corners, i, side, radius):
    """(position at which a ball touches an edge, inf: never; fraction of the edge there).

    Along the edge the position is convex, so its smallest value is at the nearest end where it has
    none between them.
    """
    a, b = corners[i], corners[(i + 1) % 3]
    dx, dy, dz = side * (b[0] - a[0]), b[1] - a[1], b[2] - a[2]
    across = math.sqrt(dy * dy + dz * dz)
    if across <= 1e-12 * abs(dx):
        t, square = 0.0 if dx >= 0.0 else 1.0, radius**2 - a[1] ** 2 - a[2] ** 2
    else:
        nearest = -(a[1] * dy + a[2] * dz) / across**2
        miss = (a[1] * dz - a[2] * dy) / across
        clear_of = radius**2 - miss**2
        if clear_of <= 0.0:
            return math.inf, 0.0
        t = nearest - dx * math.sqrt(clear_of) / (across * math.hypot(across, dx))
        t = min(max(t, 0.0), 1.0)
        square = clear_of - (across * (t - nearest)) ** 2
    if square <= 0.0:
        return math.inf, 0.0
    return side * a[0] + t * dx - math.sqrt(square) + radius, t


@kernel
def _distance(corners, side, x):
    """Distance from a triangle to the point (x, 0, 0)."""
    least, inside = math.inf, True
    _, _, _, nx, ny, nz = _edges_and_normal(corners, side)
    for i in range(3):
        a, b = corners[i], corners[(i + 1) % 3]
        dx, dy, dz = side * (b[0] - a[0]), b[1] - a[1], b[2] - a[2]
        px, py, pz = x - side * a[0], -a[1], -a[2]
        inside &= (
            (dy * pz - dz * py) * nx + (dz * px - dx * pz) * ny + (dx * py - dy * px) * nz
        ) >= 0.0
        t = (px * dx + py * dy + pz * dz) / (dx * dx + dy * dy + dz * dz)
        t = min(max(t, 0.0), 1.0)
        square = (px - t * dx) ** 2 + (py - t * dy) ** 2 + (pz - t * dz) ** 2
        least = min(least, math.sqrt(square))
    if inside:
        height = (x - side * corners[0, 0]) * nx - corners[0, 1] * ny - corners[0, 2] * nz
        least = abs(height) / math.sqrt(nx * nx + ny * ny + nz * nz)
    return least


@kernel
def _edges_and_normal(corners, side):
    """First edge of a triangle, and its normal, not scaled."""
    ux, uy = side * (corners[1, 0] - corners[0, 0]), corners[1, 1] - corners[0, 1]
    uz = corners[1, 2] - corners[0, 2]
    vx, vy = side * (corners[2, 0] - corners[0, 0]), corners[2, 1] - corners[0, 1]
    vz = corners[2, 2] - corners[0, 2]
    return ux, uy, uz, uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx


@kernel
def add_patch(faces, count, side, jaw, start, first, surface, scratch, patch):
    """Add what a jaw touches: the faces up to its compliance beyond the first touch.

    The area of a flat pad is the one on the pad: each part of it presses along x, whatever the
    surface below it is like, so steep faces bear little. That of a ball is the surface's own.

    Args:
        faces: The `Faces`.
        count: Number of them.
        side: +1 or -1.
        jaw: Shape of the jaw.
        start: Position from which it moved.
        first: Position of the first touch.
        surface: `Surface`, for the normals.
        scratch: Memory.
        patch: Added to.
    """
    limit = first + max(jaw.compliance, MIN_DEPTH)
    for i in range(count):
        facing = side * faces.normals[i, 0] < -EDGE_ON
        if not facing or nearest(faces.corners[i], side) >= limit:
            continue
        if jaw.radius > 0.0:
            area = _in_ball(faces, i, side, jaw, limit, scratch, patch)
        else:
            area = _on_pad(faces, i, side, jaw, start, limit, scratch, patch)
        if area > 0.0:
            add_mean(scratch.mean, area, faces.numbers[i], surface, patch)


@kernel
def add_mean(mean, area, face, surface, patch):
    """Add an area with its mean as a row of a polygon."""
    patch.moments[0] += area
    for k in range(3):
        patch.moments[1 + k] += area * mean[k]
    x, y, z = 0.0, 0.0, 0.0
    for i in range(3):
        corner = surface.corners[face, i]
        x += mean[3 + i] * surface.normals[corner, 0]
        y += mean[3 + i] * surface.normals[corner, 1]
        z += mean[3 + i] * surface.normals[corner, 2]
    scale = area / max(math.sqrt(x * x + y * y + z * z), 1e-12)
    patch.normal[0] += scale * x
    patch.normal[1] += scale * y
    patch.normal[2] += scale * z


@kernel
def _on_pad(faces, i, side, jaw, start, limit, scratch, patch):
    """Area of a face on a flat pad up to a depth; writes `scratch.mean` and the bounds."""
    polygon, spare = scratch.polygon, scratch.spare
    half_width, half_height = jaw.half_width - ROUNDING, jaw.half_height - ROUNDING
    count = clip_to_rectangle(faces.corners[i], side, half_width, half_height, polygon, spare)
    for j in range(count):
        if polygon[j, 0] < start - jaw.compliance - ROUNDING:
            return 0.0  # behind the finger
    count = clip(polygon, count, 0, 1.0, limit, spare)
    area = projected_moments(spare, count, scratch.mean)
    if area > 0.0:
        for j in range(count):
            _extend(patch.bounds, spare[j, 1], spare[j, 2])
    return area


@kernel
def _extend(bounds, y, z):
    bounds[0], bounds[1] = min(bounds[0], y), min(bounds[1], z)
    bounds[2], bounds[3] = max(bounds[2], y), max(bounds[3], z)


@kernel
def _in_ball(faces, i, side, jaw, limit, scratch, patch):
    """Area of a face in a ball; writes `scratch.mean` and the bounds."""
    corners = faces.corners[i]
    ux, uy, uz, nx, ny, nz = _edges_and_normal(corners, side)
    length, width = math.sqrt(nx * nx + ny * ny + nz * nz), math.sqrt(ux * ux + uy * uy + uz * uz)
    nx, ny, nz = nx / length, ny / length, nz / length
    ux, uy, uz = ux / width, uy / width, uz / width
    vx, vy, vz = ny * uz - nz * uy, nz * ux - nx * uz, nx * uy - ny * ux
    centre = limit - jaw.radius
    height = (centre - side * corners[0, 0]) * nx - corners[0, 1] * ny - corners[0, 2] * nz
    square = jaw.radius**2 - height**2
    if square <= 0.0:
        return 0.0
    radius = math.sqrt(square)
    mx, my, mz = centre - height * nx, -height * ny, -height * nz  # middle of the disc
    flat, totals = scratch.polygon, scratch.spare[0]
    for j in range(3):
        px, py, pz = side * corners[j, 0] - mx, corners[j, 1] - my, corners[j, 2] - mz
        flat[j, 0], flat[j, 1] = px * ux + py * uy + pz * uz, px * vx + py * vy + pz * vz
    totals[:3] = 0.0
    for j in range(3):
        k = (j + 1) % 3
        disc_moments(flat[j, 0], flat[j, 1], flat[k, 0], flat[k, 1], radius, totals)
    area = totals[0]
    if area <= 1e-16 * radius * radius:
        return 0.0
    s, t = totals[1] / area, totals[2] / area
    mean = scratch.mean
    mean[0], mean[1], mean[2] = mx + s * ux + t * vx, my + s * uy + t * vy, mz + s * uz + t * vz
    for j in range(3):
        a, b = flat[(j + 1) % 3], flat[(j + 2) % 3]
        mean[3 + j] = ((a[0] - s) * (b[1] - t) - (a[1] - t) * (b[0] - s)) / length
    for j in range(3):
        k = (j + 1) % 3
        dx, dy = flat[k, 0] - flat[j, 0], flat[k, 1] - flat[j, 1]
        enters, leaves = crossings(flat[j, 0], flat[j, 1], dx, dy, radius)
        if enters < leaves:
            for f in (enters, leaves):
                p, q = flat[j, 0] + f * dx, flat[j, 1] + f * dy
                _extend(patch.bounds, my + p * uy + q * vy, mz + p * uz + q * vz)
    _extend_by_rim(flat, radius, (my, mz), (uy, uz), (vy, vz), patch.bounds)
    return area


@kernel
def _extend_by_rim(flat, radius, middle, u, v, bounds):
    """Extend bounds by the extreme points of a disc along y and z that lie in a triangle."""
    for axis in range(2):
        length = math.hypot(u[axis], v[axis])
        if length == 0.0:
            continue
        for sign in (-1.0, 1.0):
            p, q = sign * radius * u[axis] / length, sign * radius * v[axis] / length
            inside = True
            for j in range(3):
                a, b = flat[j], flat[(j + 1) % 3]
                inside &= (b[0] - a[0]) * (q - a[1]) - (b[1] - a[1]) * (p - a[0]) >= 0.0
            if inside:
                y, z = middle[0] + p * u[0] + q * v[0], middle[1] + p * u[1] + q * v[1]
                _extend(bounds, y, z)
