"""The patch of a surface that a jaw touches; frames and positions as in `first_touch`."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling.decorators import kernel
from grasp3d._kernels.jaws.jaws import EDGE_ON, ROUNDING, edge_and_normal, nearest
from grasp3d._kernels.surface.clipping import (
    clip,
    clip_to_polygon,
    crossings,
    disc_moments,
    projected_moments,
)

MIN_DEPTH = 1e-7
"""Smallest depth of a patch, in object sizes: rigid pads touch with the shape of the surface in the
limit of a small depth, so that also vertices and edges have a normal."""


class Patch(NamedTuple):
    """Sums over what a jaw touches; see `clear`."""

    moments: npt.NDArray[np.float64]
    """Area, and the integral of the position over it (4,)."""
    normal: npt.NDArray[np.float64]
    """Integral of the inward normals, in the mesh's frame (3,)."""
    bounds: npt.NDArray[np.float64]
    """Smallest y and z, largest y and z (4,)."""


@kernel
def clear(patch):
    """Start a patch."""
    patch.moments[:] = 0.0
    patch.normal[:] = 0.0
    patch.bounds[:2] = math.inf
    patch.bounds[2:] = -math.inf


@kernel
def add_patch(faces, count, side, jaw, start, limit, surface, scratch, patch):
    """Add what a jaw touches: the faces up to a limit.

    The area of a flat pad is the one on the pad: each part of it presses along x, whatever the
    surface below it is like, so steep faces bear little. That of a ball is the surface's own.

    Args:
        faces: The `Faces`.
        count: Number of them.
        side: +1 or -1.
        jaw: Shape of the jaw.
        start: Position from which it moved.
        limit: Position of the jaw when it has pressed into the surface.
        surface: `Surface`, for the normals.
        scratch: Memory.
        patch: Added to.
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
def _on_pad(faces, i, side, jaw, part, start, limit, scratch, patch):
    """Area of a face on a face of the pad up to a depth; writes `scratch.mean` and the bounds."""
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
