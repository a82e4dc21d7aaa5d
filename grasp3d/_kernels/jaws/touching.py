"""What a pad or round tip that moves along x touches: the first point, and a patch.

Everything is in the gripper's frame, with x multiplied by the side of the jaw (+1 finger 1,
-1 finger 2), so that both jaws move toward larger x. The *position* of a jaw is the x of its pad's
plane or of its ball's foremost point. It touches faces whose outward normal has a negative x.
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling import part
from grasp3d._kernels.jaws.jaws import EDGE_ON, ROUNDING, edge_and_normal, nearest, nearest_to
from grasp3d._kernels.surface.polygons import (
    clip,
    clip_to_polygon,
    crossings,
    disc_moments,
    projected_moments,
)
from grasp3d._kernels.surface.vectors import copy6


@part
def ball_position(corners, normal, side, jaw, start, scratch):
    """(whether a ball overlaps a face at the start, position at which it touches it or inf).

    The touched point is written to `scratch.mean`.
    """
    radius = jaw.radius
    if jaw.thickness > 0.0:
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
    # A face that the ball does not meet at the start is completely ahead of it or behind it.
    if position < start - jaw.compliance - ROUNDING:
        return False, math.inf
    return False, position


@part
def _write_on_edge(corners, i, t, side, row):
    """Write the point at fraction t of the edge from corner i to the next."""
    j = (i + 1) % 3
    for k in range(3):
        row[k] = (1.0 - t) * corners[i, k] + t * corners[j, k]
        row[3 + k] = 0.0
    row[0] *= side
    row[3 + i], row[3 + j] = 1.0 - t, t


@part
def _touching_plane(corners, normal, side, radius, row):
    """Position at which a ball touches a face's interior, inf if never; writes the point.

    A ball touches a plane at the point of its surface nearest to the plane.
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


@part
def _touching_edge(corners, i, side, radius):
    """(position at which a ball touches an edge, inf if never; fraction of the edge there).

    The position is convex along the edge: without a minimum between the ends, its smallest value is
    at the nearest end.
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


@part
def _distance(corners, side, x):
    """Distance from a triangle to the point (x, 0, 0)."""
    least, inside = math.inf, True
    _, _, _, nx, ny, nz = edge_and_normal(corners, side)
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


ON_SIDE = 1e-9
"""Barycentric coordinate, or sine of an angle, below which features count as the same."""

ALONG = 1e-5
"""Sine of the angle below which a side of the jaw and an edge count as parallel."""

TIED = 1e-10
"""Difference of positions, in object sizes, due to rounding, which must not decide what is touched
of a face that lies flat on a pad."""


@part
def first_touch(faces, count, side, jaw, start, scratch):
    """Find the smallest position at which a jaw touches a face.

    Args:
        faces: `Faces`.
        count: Number of faces.
        side: +1 or -1.
        jaw: Shape of the jaw.
        start: Position from which the jaw moves to its mirror image.
        scratch: Scratch; `row` is written: the point touched first, as a row of a polygon.

    Returns:
        (face, position): index among the faces; -1 if none, -2 if the jaw meets the surface
        already at its start.
    """
    found, first = -1, math.inf
    for i in range(count):
        corners, normal = faces.corners[i], faces.normals[i]
        low, facing = nearest(corners, side), side * normal[0] < -EDGE_ON
        if low >= first or (low >= start and not facing):
            continue
        meets, position, _ = touch_face(
            corners, normal, side, jaw, start, first, scratch, scratch.row
        )
        if meets:
            return -2, first
        if position < first:
            found, first = i, position
    return found, first


@part
def touch_face(corners, normal, side, jaw, start, first, scratch, row):
    """Find the position at which a jaw touches one face.

    Args:
        corners: Corners of the face (3, 3).
        normal: Its outward unit normal.
        side: +1 or -1.
        jaw: Shape of the jaw.
        start: Position from which the jaw moves to its mirror image.
        first: Position at which the jaw touches another face, which takes precedence if both are
            touched together, up to rounding.
        scratch: Scratch.
        row: Written if this face is touched before the other: the point, as a row of a polygon.

    Returns:
        (whether the jaw meets the face at its start; position, inf if not before the other; index
        among the jaw's own faces).
    """
    found, part, facing = math.inf, 0, side * normal[0] < -EDGE_ON
    for j in range(jaw.planes.shape[0]):
        if nearest_to(corners, side, jaw.planes[j]) >= first - TIED:
            continue
        if jaw.radius > 0.0:
            meets, position = ball_position(corners, normal, side, jaw, start, scratch)
        else:
            meets, position = _pad_position(corners, side, jaw, j, start, scratch)
        if meets:
            return True, math.inf, j
        if facing and position < first - TIED and position <= ROUNDING - start:
            found, first, part = position, position, j
            copy6(scratch.mean, row)
    return False, found, part


@part
def slopes(corners, normal, part, side, jaw, position, row):
    """Rates at which the position of a jaw changes as the touched object moves along y and z.

    Vertices of the object slide on a face of the jaw, corners of the jaw on a face of the object,
    and edges on sides; round tips roll.

    Args:
        corners: Corners of the face touched (3, 3).
        normal: Outward unit normal of the face.
        part: Face of the jaw that touches it.
        side: +1 or -1.
        jaw: Shape of the jaw.
        position: Position of the jaw.
        row: The touched point, as a row of a polygon.

    Returns:
        (d position / dy, d position / dz); along x it is `side`.
    """
    if jaw.radius > 0.0:
        x = position - jaw.radius - row[0]
        return -row[1] / x, -row[2] / x
    near, plane, edges = 0, jaw.planes[part], jaw.edges[part]
    crossed, gap = 0, math.inf
    for e in range(edges.shape[0]):
        distance = edges[e, 2] - edges[e, 0] * row[1] - edges[e, 1] * row[2]
        if distance < gap:
            crossed, gap = e, distance
    at_vertex = False
    for k in range(3):
        at_vertex |= row[3 + k] > 1.0 - ON_SIDE
        if row[3 + k] < row[3 + near]:
            near = k
    if at_vertex and gap > ON_SIDE:
        return -plane[1], -plane[2]
    if not at_vertex and row[3 + near] <= ON_SIDE:
        ty, tz = -edges[crossed, 1], edges[crossed, 0]
        tx = plane[1] * ty + plane[2] * tz
        a, b = corners[(near + 1) % 3], corners[(near + 2) % 3]
        ux, uy, uz = side * (b[0] - a[0]), b[1] - a[1], b[2] - a[2]
        x = uy * tz - uz * ty
        if abs(x) > ALONG * (abs(uy) + abs(uz)):
            return (uz * tx - ux * tz) / x, (ux * ty - uy * tx) / x
    # A corner of the jaw, or its side where the object's edge or vertex is about to leave the jaw.
    return side * normal[1] / normal[0], side * normal[2] / normal[0]


@part
def _pad_position(corners, side, jaw, part, start, scratch):
    """(whether the pad overlaps a face at the start, position at which it touches it or inf).

    The touched point is written to `scratch.mean`.
    """
    polygon, plane, edges = scratch.polygon, jaw.planes[part], jaw.edges[part]
    count = clip_to_polygon(corners, side, plane, edges, polygon, scratch.spare)
    if count < 3:
        return False, math.inf
    lowest, high = 0, -math.inf
    for i in range(count):
        high = max(high, polygon[i, 0])
        if polygon[i, 0] < polygon[lowest, 0] - TIED:
            lowest = i
    low, mean = polygon[lowest, 0], scratch.mean
    for k in range(6):
        mean[k] = polygon[lowest, k]
    mean[0] += plane[0] + plane[1] * mean[1] + plane[2] * mean[2]
    if low < start - jaw.compliance - ROUNDING:
        return high > start - jaw.thickness + ROUNDING, math.inf
    return False, low


MIN_DEPTH = 1e-7
"""Smallest depth of a patch, in object sizes. Rigid pads touch the shape that the surface has at
a vanishing depth; so vertices and edges have a normal, too."""


class Patch(NamedTuple):
    """Sums over what a jaw touches; see `clear`."""

    moments: npt.NDArray[np.float64]
    """Area, and the integral of position over it (4,)."""
    normal: npt.NDArray[np.float64]
    """Integral of the inward normals, in the mesh's frame (3,)."""
    reach: npt.NDArray[np.float64]
    """Reach of the patch in the `DIRECTIONS` (8,)."""
    corners: npt.NDArray[np.float64]
    """Points of the patch farthest in these directions (8, 3)."""


DIRECTIONS = np.array([
    (1.0, 0.0), (1.0, 1.0), (0.0, 1.0), (-1.0, 1.0),
    (-1.0, 0.0), (-1.0, -1.0), (0.0, -1.0), (1.0, -1.0),
])  # fmt: skip
"""Directions along y and z in which the outline of a patch is sampled (8, 2)."""

SIDE = 1e-7
"""Weight of the coordinate across a direction."""


@part
def clear(patch):
    """Start a patch."""
    patch.moments[:] = 0.0
    patch.normal[:] = 0.0
    patch.reach[:] = -math.inf


@part
def add_patch(faces, count, side, jaw, start, limit, surface, scratch, patch):
    """Add what a jaw touches up to a limit to a patch.

    For a flat pad, the area is measured on the pad: each part of it presses along x, regardless of
    the surface below, so steep faces bear little. For a ball, it is the surface's own area.

    Args:
        faces: `Faces`.
        count: Number of faces.
        side: +1 or -1.
        jaw: Shape of the jaw.
        start: Position from which the jaw moved.
        limit: Position of the jaw when it has pressed into the surface.
        surface: `Surface`, for the normals.
        scratch: Scratch.
        patch: Patch to add to.
    """
    for i in range(count):
        facing = side * faces.normals[i, 0] < -EDGE_ON
        if not facing or nearest(faces.corners[i], side) >= limit:
            continue
        for j in range(jaw.planes.shape[0]):
            if jaw.radius > 0.0:
                area = _in_ball(faces, i, side, jaw, limit, scratch, patch)
            else:
                area = _on_pad(faces, i, side, jaw, j, start, limit, scratch, patch)
            if area > 0.0:
                add_mean(scratch.mean, area, faces.numbers[i], surface, patch)


@part
def add_mean(mean, area, face, surface, patch):
    """Add an area, with its mean as a row of a polygon, to a patch."""
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


@part
def _on_pad(faces, i, side, jaw, part, start, limit, scratch, patch):
    """Area of a face up to a depth in a pad's face; writes `scratch.mean`, extends the outline."""
    polygon, spare, mean = scratch.polygon, scratch.spare, scratch.mean
    plane = jaw.planes[part]
    count = clip_to_polygon(faces.corners[i], side, plane, jaw.edges[part], polygon, spare)
    for j in range(count):
        if polygon[j, 0] < start - jaw.compliance - ROUNDING:
            return 0.0  # behind the finger
    count = clip(polygon, count, (1.0, 0.0, 0.0, limit), spare)
    area = projected_moments(spare, count, mean)
    if area > 0.0:
        mean[0] += plane[0] + plane[1] * mean[1] + plane[2] * mean[2]
        for j in range(count):
            x, y, z = spare[j, 0], spare[j, 1], spare[j, 2]
            extend(patch, x + plane[0] + plane[1] * y + plane[2] * z, y, z)
    return area


@part
def extend(patch, x, y, z):
    """Add a point to the outline of a patch."""
    for k in range(DIRECTIONS.shape[0]):
        across, along = DIRECTIONS[k, 0], DIRECTIONS[k, 1]
        # Of a side across the direction the same end is kept, in whatever order its points come.
        far = across * y + along * z + SIDE * (across * z - along * y)
        if far > patch.reach[k]:
            patch.reach[k] = far
            patch.corners[k, 0], patch.corners[k, 1], patch.corners[k, 2] = x, y, z


@part
def _in_ball(faces, i, side, jaw, limit, scratch, patch):
    """Area of a face in a ball; writes `scratch.mean` and extends the outline."""
    corners = faces.corners[i]
    ux, uy, uz, nx, ny, nz = edge_and_normal(corners, side)
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
                x, y, z = mx + p * ux + q * vx, my + p * uy + q * vy, mz + p * uz + q * vz
                extend(patch, x, y, z)
    _extend_by_rim(flat, radius, (mx, my, mz), (ux, uy, uz), (vx, vy, vz), patch)
    return area


@part
def _extend_by_rim(flat, radius, middle, u, v, patch):
    """Add a disc's extreme points in the `DIRECTIONS` to a patch, if they lie in a triangle."""
    for k in range(DIRECTIONS.shape[0]):
        along = DIRECTIONS[k, 0] * u[1] + DIRECTIONS[k, 1] * u[2]
        across = DIRECTIONS[k, 0] * v[1] + DIRECTIONS[k, 1] * v[2]
        length = math.hypot(along, across)
        if length == 0.0:
            continue
        p, q = radius * along / length, radius * across / length
        inside = True
        for j in range(3):
            a, b = flat[j], flat[(j + 1) % 3]
            inside &= (b[0] - a[0]) * (q - a[1]) - (b[1] - a[1]) * (p - a[0]) >= 0.0
        if inside:
            x, y = middle[0] + p * u[0] + q * v[0], middle[1] + p * u[1] + q * v[1]
            extend(patch, x, y, middle[2] + p * u[2] + q * v[2])
