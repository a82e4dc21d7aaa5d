"""Rays from the vertices of a surface: their closing directions, and their crossings with it.

Directions of the search for antipodal grasps are spread over a cone at first, point toward the
opposing contacts of neighbouring vertices, and surround the best directions found so far in rings.
Each exit of a ray is a candidate for the second contact.

Positions are in the mesh's normalised frame (centred, size 1); angles in radians; normals point
into the object. A *closing direction* is the one in which finger 1 pushes: toward finger 2 when
squeezing (sign +1), away from it when expanding (sign -1).
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling.decorators import kernel, part
from grasp3d._kernels.search.antipodal_candidates import (
    FOUND,
    NO_PARTNER,
    OPENING,
    evaluate_pair,
    line_turn,
)
from grasp3d._kernels.surface.normal_sets import smallest_angle
from grasp3d._kernels.surface.vectors import copy, cross, dot

STEP = 3e-7
"""Distance behind a crossing at which the ray continues: a few 32-bit rounding errors."""


class Rays(NamedTuple):
    """Rays from vertices; those that continue are moved to the front."""

    owner: npt.NDArray[np.int32]
    """Vertex from which each ray starts (r,)."""
    closing: npt.NDArray[np.float64]
    """Closing direction (r, 3)."""
    signs: npt.NDArray[np.int8]
    """+1: the ray runs along the closing direction, -1: against it (r,)."""
    along: npt.NDArray[np.float64]
    """Distance of the ray's current origin from the vertex (r,)."""
    step: npt.NDArray[np.float64]
    """Distance by which the origin advances when the ray hits the same face again (r,)."""
    last: npt.NDArray[np.int32]
    """Face crossed last, -1 none (r,)."""


@kernel
def starting_rays(owner, closing, signs, size):
    """The first `size` rays, starting at their vertices."""
    return Rays(
        owner[:size],
        closing[:size],
        signs[:size],
        np.full(size, STEP),
        np.full(size, STEP),
        np.full(size, -1, dtype=np.int32),
    )


@kernel
def make_rays(capacity):
    """Allocate owner, closing direction and sign of so many rays."""
    return (
        np.empty(capacity, dtype=np.int32),
        np.empty((capacity, 3)),
        np.empty(capacity, dtype=np.int8),
    )


@part
def append_ray(size, v, sign, direction, bound, sets, rays):
    """Write a ray where its angle to the vertex's normals is within a bound.

    Returns:
        The new number of rays.
    """
    x, y, z = direction
    if smallest_angle(sets.normals, sets.start[v], sets.counts[v], x, y, z) > bound:
        return size
    owner, closing, signs = rays
    owner[size], signs[size] = v, sign
    closing[size, 0], closing[size, 1], closing[size, 2] = x, y, z
    return size + 1


@kernel
def write_rays(count, rays, points, origins, directions):
    """Write the first `count` rays as 32-bit origins and directions."""
    for i in range(count):
        # Origins are computed from the vertex each time, so rounding errors do not accumulate.
        v, sign, along = rays.owner[i], rays.signs[i], rays.along[i]
        for k in range(3):
            d = sign * rays.closing[i, k]
            origins[i, k] = points[v, k] + along * d
            directions[i, k] = d


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
        copy(closing[i], closing[remaining])
        along[remaining], step[remaining], last[remaining] = along[i], step[i], last[i]
        remaining += 1
    return remaining


GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))
"""Turn between consecutive directions of a sunflower spiral [rad]."""


class Frames(NamedTuple):
    """Coordinate frames of the directions at each vertex."""

    centres: npt.NDArray[np.float64]
    """Centre of the vertex's set of normals (V, 3)."""
    tangents: npt.NDArray[np.float64]
    """A unit vector orthogonal to the centre (V, 3)."""
    radii: npt.NDArray[np.float64]
    """Largest angle from the centre to a normal [rad] (V,)."""


@kernel
def seed_rays(vertices, rays, batch, cone, sign, frames, sets, grasps):
    """Rays in initial closing directions about each vertex's normals.

    A sunflower spiral over the cap of half-angle `cone` about the normal, the first ray along it.
    At a crease the cap is about the centre of the set of normals and large enough for all of them,
    the corners of the set come next, and directions outside the union of the normals' cones are
    skipped. So are directions at a larger angle to the normals than the critical angles of all
    cached grasps: no second contact could make them better.

    Args:
        vertices: Vertices (n,).
        rays: Directions per vertex.
        batch: (first, last): range of the directions; last is excluded.
        cone: Half-angle of the search cone [rad].
        sign: +1 squeeze, -1 expand.
        frames: `Frames`.
        sets: `ContactNormals`.
        grasps: `BestPairs`.

    Returns:
        The `Rays`.
    """
    start, counts, normals = sets.start, sets.counts, sets.normals
    written, size = make_rays(vertices.shape[0] * (batch[1] - batch[0])), 0
    for v in vertices:
        # The critical angle is at least the angle between the direction and the vertex's normals.
        bound = min(cone, grasps.start_angles[v, -1])
        c, t = frames.centres[v], frames.tangents[v]
        bx, by, bz = cross(c, t)
        cap = 1.0 - math.cos(min(cone + frames.radii[v], math.pi))
        set_corners = 0 if counts[v] == 1 else min(counts[v], rays // 4)
        spiral_size = rays - set_corners
        for k in range(batch[0], batch[1]):
            if 0 < k <= set_corners:
                n = normals[start[v] + k - 1]
                x, y, z = n[0], n[1], n[2]
            else:
                step = 0 if k == 0 else k - set_corners
                # Equal steps of height cover equal areas of the cap.
                cosine = 1.0 - cap * step / spiral_size
                sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
                p, q = sine * math.cos(step * GOLDEN_ANGLE), sine * math.sin(step * GOLDEN_ANGLE)
                x = cosine * c[0] + p * t[0] + q * bx
                y = cosine * c[1] + p * t[1] + q * by
                z = cosine * c[2] + p * t[2] + q * bz
            size = append_ray(size, v, sign, (x, y, z), bound, sets, written)
    return starting_rays(*written, size)


@kernel
def neighbour_rays(vertices, cone, points, neighbours, sets, grasps):
    """Rays from each vertex toward the opposing contacts that its neighbours found.

    Args:
        vertices: Vertices (n,).
        cone: Half-angle of the search cone [rad].
        points: Positions of the vertices (V, 3).
        neighbours: (first, index): the vertices around each vertex.
        sets: `ContactNormals`.
        grasps: `BestPairs`.

    Returns:
        The `Rays`.
    """
    first, index = neighbours
    capacity = 0
    for v in vertices:
        capacity += first[v + 1] - first[v]
    rays, size = make_rays(capacity), 0
    for v in vertices:
        bound = min(cone, grasps.worst[v])
        for k in range(first[v], first[v + 1]):
            other = index[k]
            # An opposing contact of a neighbour is nearly one of this vertex: good grasps spread
            # from vertex to vertex.
            if grasps.reason[other] != FOUND:
                continue
            sign = grasps.signs[other]
            x = grasps.partner[other, 0] - points[v, 0]
            y = grasps.partner[other, 1] - points[v, 1]
            z = grasps.partner[other, 2] - points[v, 2]
            length = math.sqrt(x * x + y * y + z * z)
            if length < 1e-6:
                continue
            toward = sign * x / length, sign * y / length, sign * z / length
            size = append_ray(size, v, sign, toward, bound, sets, rays)
    return starting_rays(*rays, size)


RAYS_PER_ROUND = 13
"""Most rays per vertex of a round of refinement: two rings and a bisector."""

LONGER = 1.25
"""Factor by which openings may grow in a round: with uncertain locations wider grasps cost less."""


@part
def _across(axis, vector):
    """The part of a vector orthogonal to a unit vector, and its length."""
    along = dot(axis, vector)
    x, y, z = vector[0] - along * axis[0], vector[1] - along * axis[1], vector[2] - along * axis[2]
    return (x, y, z), math.sqrt(x * x + y * y + z * z)


@part
def _ring(size, v, sign, axis, radius, turn, tangent, bound, sets, rays):
    """Append six directions at an angle of `radius` about `axis`; returns the new number of rays.

    Only those within `bound` of the normals, as others cannot have a smaller critical angle.
    """
    # The tangents turn with the object, so the same directions are tried in any orientation.
    e1, length = _across(axis, (tangent[0], tangent[1], tangent[2]))
    if length < 1e-6:  # the axis is parallel to the tangent: any other vector will do
        x, y, z = abs(axis[0]), abs(axis[1]), abs(axis[2])
        if x <= min(y, z):
            e1, length = _across(axis, (1.0, 0.0, 0.0))
        elif y <= z:
            e1, length = _across(axis, (0.0, 1.0, 0.0))
        else:
            e1, length = _across(axis, (0.0, 0.0, 1.0))
    e1 = e1[0] / length, e1[1] / length, e1[2] / length
    e2 = cross(axis, e1)
    along, aside = math.cos(radius), math.sin(radius)
    for k in range(6):
        azimuth = (k + turn) * math.pi / 3.0
        p, q = aside * math.cos(azimuth), aside * math.sin(azimuth)
        direction = (
            along * axis[0] + p * e1[0] + q * e2[0],
            along * axis[1] + p * e1[1] + q * e2[1],
            along * axis[2] + p * e1[2] + q * e2[2],
        )
        size = append_ray(size, v, sign, direction, bound, sets, rays)
    return size


@part
def _largest_angle(v, points, grasps):
    """Largest angle to a normal at which a grasp near the best one may cost less [rad]."""
    cost = grasps.worst[v]
    if grasps.location == 0.0 or cost == math.inf:
        return cost
    square = 0.0
    for k in range(3):
        square += (grasps.partner[v, k] - points[v, k]) ** 2
    return cost - line_turn(grasps.location, LONGER * math.sqrt(square))


@kernel
def refining_rays(vertices, radii, turn, cone, points, frames, sets, grasps):
    """Rays near each vertex's best grasp: a ring, and the bisector of the two normals.

    The bisector of n1 and -n2 has equal angles to both normals: it is the optimum wherever the
    surface at the second contact is flat.

    Args:
        vertices: Vertices with a grasp (n,).
        radii: Angle of the ring about the grasp of each vertex [rad] (V,).
        turn: Rotation of the ring in sixths of a turn.
        cone: Half-angle of the search cone [rad].
        points: Positions of the vertices (V, 3).
        frames: `Frames`.
        sets: `ContactNormals`.
        grasps: `BestPairs`.

    Returns:
        The `Rays`.
    """
    rays, size = make_rays(vertices.shape[0] * RAYS_PER_ROUND), 0
    for v in vertices:
        sign, axis, tangent = grasps.signs[v], grasps.closing[v], frames.tangents[v]
        radius, bound = radii[v], min(cone, _largest_angle(v, points, grasps))
        one, two = frames.centres[v], grasps.partner_normal[v]
        x, y, z = one[0] - two[0], one[1] - two[1], one[2] - two[2]
        length = math.sqrt(x * x + y * y + z * z)
        if length > 1e-9:
            middle = x / length, y / length, z / length
            size = append_ray(size, v, sign, middle, bound, sets, rays)
        size = _ring(size, v, sign, axis, radius, turn, tangent, bound, sets, rays)
        # On creases the best grasp over the best normals may be another one, with its own ring.
        other = grasps.closing_best[v]
        if sets.counts[v] != 1 and dot(axis, other) < math.cos(0.5 * radius):
            sign = grasps.signs_best[v]
            size = _ring(size, v, sign, other, radius, turn, tangent, bound, sets, rays)
    return starting_rays(*rays, size)


@kernel
def exploring_rays(vertices, radius, turn, cone, frames, sets, grasps):
    """Rays in rings about the cached closing directions of each vertex except the best one.

    Args:
        vertices: Vertices (n,).
        radius: Angle of the rings [rad].
        turn: Rotation of the rings in sixths of a turn.
        cone: Half-angle of the search cone [rad].
        frames: `Frames`.
        sets: `ContactNormals`.
        grasps: `BestPairs`.

    Returns:
        The `Rays`.
    """
    rays, size = make_rays(vertices.shape[0] * 6 * (grasps.starts.shape[1] - 1)), 0
    for v in vertices:
        bound = min(cone, grasps.start_angles[v, -1])
        for k in range(1, grasps.starts.shape[1]):
            if grasps.start_angles[v, k] < math.inf:
                axis, sign = grasps.starts[v, k], grasps.start_signs[v, k]
                tangent = frames.tangents[v]
                size = _ring(size, v, sign, axis, radius, turn, tangent, bound, sets, rays)
    return starting_rays(*rays, size)
