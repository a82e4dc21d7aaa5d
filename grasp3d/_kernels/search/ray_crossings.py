"""Crossings of rays with the surface: each exit is a candidate for the second contact."""

import math

import numpy as np

from grasp3d._kernels.compiling.decorators import kernel
from grasp3d._kernels.search.antipodal_candidates import NO_PARTNER, OPENING, evaluate_pair
from grasp3d._kernels.surface.ray_tracing import STEP

SMALLEST_OPENING = 1e-6
"""Smallest opening, in object sizes, that 32-bit rays can resolve."""


@kernel
def evaluate_crossings(count, hit, far, rays, surface, sets, limits, grasps):
    """Evaluate the grasps at the faces that the rays hit, and keep the rays that continue.

    The face is intersected again in 64 bits and the point clipped to it, so that every candidate is
    a point on the surface, whatever the rounding of the 32-bit tracer. An exit is recognised by the
    sign of the product of direction and face normal, never by counting crossings, which rounding
    can falsify.

    Args:
        count: Rays in flight; the first ones of `rays`.
        hit: Face that each ray hit, -1 none (count,).
        far: Distance from the ray's current origin to the hit, 32-bit (count,).
        rays: `Rays`; compacted in place.
        surface: `Surface`.
        sets: `ContactNormals`.
        limits: `PairLimits`.
        grasps: `BestPairs`; written.

    Returns:
        Rays still in flight.
    """
    points, faces = surface.points, surface.faces
    owner, closing, signs, along, step, last = rays
    found = np.empty((2, 3))
    remaining = 0
    for i in range(count):
        face = np.int64(hit[i])  # types as in other calls, for which Numba would compile again
        if face < 0:
            continue
        v, sign = np.int64(owner[i]), np.int64(signs[i])
        ox, oy, oz = points[v, 0], points[v, 1], points[v, 2]
        dx, dy, dz = sign * closing[i, 0], sign * closing[i, 1], sign * closing[i, 2]
        f0, f1, f2 = faces[face, 0], faces[face, 1], faces[face, 2]
        ax, ay, az = points[f0, 0], points[f0, 1], points[f0, 2]
        ux, uy, uz = points[f1, 0] - ax, points[f1, 1] - ay, points[f1, 2] - az
        wx, wy, wz = points[f2, 0] - ax, points[f2, 1] - ay, points[f2, 2] - az
        nx, ny, nz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
        square = nx * nx + ny * ny + nz * nz
        slope = dx * nx + dy * ny + dz * nz
        # The 32-bit distance is replaced by the exact one where the two agree.
        coarse = along[i] + far[i]
        t = coarse
        if abs(slope) > 1e-7 * math.sqrt(square):  # else the ray is nearly parallel to the face
            exact = ((ax - ox) * nx + (ay - oy) * ny + (az - oz) * nz) / slope
            if abs(exact - coarse) < 1e-3:
                t = exact
        if face == last[i] or t <= STEP:  # the face just left, or one at the vertex itself
            # Rounding put the origin before the face again: advance, ever farther.
            step[i] *= 2.0
            along[i] = max(along[i], coarse) + step[i]
        else:
            along[i] = max(along[i], t) + STEP
            step[i], last[i] = STEP, face
            # A finger pushes into the object, so the second contact is an exit of the closing line.
            if sign * slope > 0.0:
                rx, ry, rz = ox + t * dx - ax, oy + t * dy - ay, oz + t * dz - az
                b1 = (ry * wz - rz * wy) * nx + (rz * wx - rx * wz) * ny + (rx * wy - ry * wx) * nz
                b2 = (uy * rz - uz * ry) * nx + (uz * rx - ux * rz) * ny + (ux * ry - uy * rx) * nz
                # Barycentric coordinates, clipped to the face.
                b1, b2 = max(b1 / square, 0.0), max(b2 / square, 0.0)
                b0 = max(1.0 - b1 - b2, 0.0)
                total = b0 + b1 + b2
                b0, b1, b2 = b0 / total, b1 / total, b2 / total
                qx, qy, qz = b1 * ux + b2 * wx, b1 * uy + b2 * wy, b1 * uz + b2 * wz
                partner = (ax + qx, ay + qy, az + qz)
                opening = math.sqrt(
                    (partner[0] - ox) ** 2 + (partner[1] - oy) ** 2 + (partner[2] - oz) ** 2
                )
                if limits[0] <= opening <= limits[1]:
                    evaluate_pair(
                        v, sign, partner, opening, face, (b0, b1, b2), surface, sets, grasps, found
                    )
                elif opening >= SMALLEST_OPENING and grasps.reason[v] == NO_PARTNER:
                    grasps.reason[v] = OPENING
            # An expanding finger cannot reach what lies behind the first surface.
            if sign < 0 or along[i] > limits[1]:
                continue
        owner[remaining], signs[remaining] = owner[i], signs[i]
        for k in range(3):
            closing[remaining, k] = closing[i, k]
        along[remaining], step[remaining], last[remaining] = along[i], step[i], last[i]
        remaining += 1
    return remaining
