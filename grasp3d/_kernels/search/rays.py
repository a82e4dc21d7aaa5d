"""Rays from the vertices of a surface: their closing directions, and their crossings with it.

They serve fingers that expand: the surface that a ray away from the object meets first is a
candidate for the second contact. The directions are first spread over a cone; later ones point
toward the opposing contacts of neighbouring vertices, and surround the best directions in rings.

Positions are in the mesh's normalised frame (centred, size 1); angles in radians; normals point
into the object. A *closing direction* is the direction in which finger 1 pushes, away from
finger 2; rays run against it.

A tree of boxes gives the first face that each ray meets, in 64 bits.
"""

import math
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.compiling import (
    FixedFloats1,
    FixedFloats2,
    Floats1,
    Floats2,
    Int32s1,
    Ints1,
    kernel,
    merged,
    part,
)
from grasp3d._kernels.search.antipodal_candidates import (
    FOUND,
    NO_PARTNER,
    OPENING,
    SMALLEST_OPENING,
    evaluate_pair,
)
from grasp3d._kernels.surface.box_tree import corner_and_edges, leaf_rows
from grasp3d._kernels.surface.face_tree import STACK
from grasp3d._kernels.surface.surface_contacts import ContactNormals, smallest_angle
from grasp3d._kernels.surface.vectors import (
    combined,
    copy,
    cross,
    difference,
    divided,
    dot,
    in_triangle,
    norm,
    scaled,
    triple,
    weighted_sum,
)

BORDER = 1e-12
"""Amount by which a face is widened, relative to its sides, so that no ray slips between faces."""

STEEPEST = 1e-300
"""Smallest component of a direction in box tests, to avoid division by zero."""


@merged
def _entry(start, inverse, box, far):
    """Distance at which a ray enters a box, or `far` if that is not nearer."""
    low, high = 0.0, far
    for k in range(3):
        one = (box[k] - box[3 + k] - start[k]) * inverse[k]
        other = (box[k] + box[3 + k] - start[k]) * inverse[k]
        low, high = max(low, min(one, other)), min(high, max(one, other))
    return low if low <= high else far


@merged
def _distance(start, direction, triangle, far):
    """Distance at which a ray meets a triangle, or `far` (Moeller & Trumbore 1997)."""
    a, u, w = corner_and_edges(triangle)
    across = cross(direction, w)
    volume = dot(u, across)
    if volume == 0.0:
        return far
    r = difference(start, a)
    s = dot(r, across) / volume
    if not -BORDER <= s <= 1.0 + BORDER:
        return far
    turned = cross(r, u)
    t = dot(direction, turned) / volume
    if not (t >= -BORDER and s + t <= 1.0 + BORDER):
        return far
    distance = dot(w, turned) / volume
    return distance if 0.0 <= distance < far else far


@kernel("Float32s2, Float32s2, Float32s1, int, int, BoxTree, Int32s1, Float32s1")
def first_faces(origins, directions, lengths, first, last, tree, faces, far):
    """Find the first face that each ray in a range meets.

    Args:
        origins: Where the rays start (n, 3).
        directions: Their unit vectors (n, 3).
        lengths: Lengths of the rays, inf for no end (n,).
        first: First ray to trace.
        last: One past the last ray.
        tree: The `BoxTree` of the faces.
        faces: Written, the face that each ray meets, -1 for none (n,).
        far: Written, the distance to it, or else the length of the ray (n,).
    """
    nodes, entries = np.empty(STACK, np.int64), np.empty(STACK)
    boxes, order, triangles = tree.boxes, tree.order, tree.triangles
    for i in range(first, last):
        start = (float(origins[i, 0]), float(origins[i, 1]), float(origins[i, 2]))
        x, y, z = float(directions[i, 0]), float(directions[i, 1]), float(directions[i, 2])
        direction = (x, y, z)
        inverse = (
            1.0 / (x if abs(x) > STEEPEST else STEEPEST),
            1.0 / (y if abs(y) > STEEPEST else STEEPEST),
            1.0 / (z if abs(z) > STEEPEST else STEEPEST),
        )
        nearest, face = float(lengths[i]), -1
        count, nodes[0], entries[0] = 1, 0, 0.0
        while count:
            count -= 1
            node = nodes[count]
            if entries[count] >= nearest:
                continue
            begin, end = leaf_rows(node, tree)
            for row in range(begin, end):
                distance = _distance(start, direction, triangles[row], nearest)
                if distance < nearest:
                    nearest, face = distance, order[row]
            if end > begin:
                continue
            near, other = 2 * node + 1, 2 * node + 2
            one = _entry(start, inverse, boxes[near], nearest)
            two = _entry(start, inverse, boxes[other], nearest)
            if two < one:
                near, other, one, two = other, near, two, one
            if two < nearest:
                nodes[count], entries[count] = other, two
                count += 1
            if one < nearest:
                nodes[count], entries[count] = near, one
                count += 1
        faces[i], far[i] = face, nearest


STEP = 3e-7
"""Distance behind a crossing at which a ray continues: a few 32-bit rounding errors."""


class Rays(NamedTuple):
    """Rays from vertices; those that have met nothing yet are moved to the front."""

    owner: Int32s1
    """Vertex from which each ray starts (r,)."""
    closing: Floats2
    """Closing direction (r, 3)."""
    along: Floats1
    """Distance of the ray's current origin from the vertex (r,)."""
    step: Floats1
    """Distance by which the origin advances when the ray hits the same face again (r,)."""
    last: Int32s1
    """Face through which the ray continues, -1 for none (r,)."""


@kernel()
def starting_rays(owner, closing, size):
    """Make the first `size` rays, starting at their vertices."""
    return Rays(
        owner[:size],
        closing[:size],
        np.full(size, STEP),
        np.full(size, STEP),
        np.full(size, -1, dtype=np.int32),
    )


@kernel()
def make_rays(capacity):
    """Allocate owners and closing directions of a number of rays."""
    return np.empty(capacity, dtype=np.int32), np.empty((capacity, 3))


@part
def append_ray(size, v, direction, bound, sets, rays):
    """Append a ray if its angle to the vertex's normals is within a bound.

    Returns:
        The new number of rays.
    """
    x, y, z = direction
    if smallest_angle(sets.normals, sets.start[v], sets.counts[v], x, y, z) > bound:
        return size
    owner, closing = rays
    owner[size] = v
    copy(direction, closing[size])
    return size + 1


@kernel("int, Rays, FixedFloats2, Float32s2, Float32s2")
def write_rays(count, rays, points, origins, directions):
    """Write the first `count` rays as 32-bit origins and directions."""
    for i in range(count):
        # Origins are recomputed from the vertex, so rounding errors do not accumulate.
        v, along = rays.owner[i], rays.along[i]
        for k in range(3):
            d = -rays.closing[i, k]
            origins[i, k] = points[v, k] + along * d
            directions[i, k] = d


@kernel("int, Int32s1, Float32s1, Rays, Surface, ContactNormals, PairLimits, BestPairs")
def evaluate_crossings(count, hit, far, rays, surface, sets, limits, grasps):
    """Evaluate the grasps at the faces that the rays hit, and keep the rays that continue.

    A ray continues only behind faces at its vertex: an expanding finger cannot reach past the first
    surface. The face is intersected again in 64 bits and the point clipped to it, so every
    candidate is a point on the surface, whatever the rounding of the 32-bit tracer. The sign of the
    product of direction and face normal identifies an exit of the closing line.

    Args:
        count: Number of rays in flight, the first ones of `rays`.
        hit: Face that each ray hit, -1 for none (count,).
        far: Distance from the ray's current origin to the hit, 32-bit (count,).
        rays: `Rays`; compacted in place.
        surface: `Surface`.
        sets: `ContactNormals`.
        limits: `PairLimits`.
        grasps: `BestPairs`; written.

    Returns:
        Number of rays still in flight.
    """
    points, faces = surface.points, surface.faces
    owner, closing, along, step, last = rays
    scratch = np.empty((2, 3))
    remaining = 0
    for i in range(count):
        face = np.int64(hit[i])  # the type of other calls, so that Numba does not compile again
        if face < 0:
            continue
        v = np.int64(owner[i])
        origin, direction = points[v], scaled(-1.0, closing[i])
        corner = points[faces[face, 0]]
        u = difference(points[faces[face, 1]], corner)
        w = difference(points[faces[face, 2]], corner)
        normal = cross(u, w)
        square, slope = dot(normal, normal), dot(direction, normal)
        # The exact distance replaces the 32-bit one if the two agree.
        coarse = along[i] + far[i]
        t = coarse
        if abs(slope) > 1e-7 * math.sqrt(square):  # otherwise the ray nearly parallels the face
            exact = dot(difference(corner, origin), normal) / slope
            if abs(exact - coarse) < 1e-3:
                t = exact
        if face == last[i] or t <= STEP:
            # Rounding may put the origin before the face again: advance by doubled steps.
            step[i] *= 2.0
            owner[remaining] = owner[i]
            copy(closing[i], closing[remaining])
            along[remaining] = max(along[i], coarse) + step[i]
            step[remaining], last[remaining] = step[i], last[i]
            remaining += 1
        elif slope < 0.0:
            point = difference(combined(1.0, origin, t, direction), corner)
            b1, b2 = in_triangle(point, u, w, normal)
            # Barycentric coordinates, clipped to the face.
            b1, b2 = max(b1 / square, 0.0), max(b2 / square, 0.0)
            b0 = max(1.0 - b1 - b2, 0.0)
            weights = divided((b0, b1, b2), b0 + b1 + b2)
            partner = combined(1.0, corner, 1.0, combined(weights[1], u, weights[2], w))
            opening = norm(difference(partner, origin))
            if limits.smallest <= opening <= limits.largest:
                evaluate_pair(
                    v, -1.0, partner, opening, face, weights, surface, sets, grasps, scratch
                )
            elif opening >= SMALLEST_OPENING and grasps.reason[v] == NO_PARTNER:
                grasps.reason[v] = OPENING
    return remaining


GOLDEN_ANGLE = math.pi * (3.0 - math.sqrt(5.0))
"""Turn between consecutive directions of a sunflower spiral [rad]."""


class Origins(NamedTuple):
    """The vertices from which rays start, with frames for their directions."""

    points: FixedFloats2
    """Positions of the vertices (V, 3)."""
    sets: ContactNormals
    centres: FixedFloats2
    """Centre of each vertex's set of normals (V, 3)."""
    tangents: Floats2
    """A unit vector orthogonal to the centre (V, 3)."""
    radii: FixedFloats1
    """Largest angle from the centre to a normal [rad] (V,)."""
    neighbours: tuple[Ints1, Ints1]
    """First neighbour of each vertex (V + 1,), and the vertices around each vertex."""
    cone: float
    """Half-angle of the search cone [rad]."""


@kernel("Ints1, int, tuple[int, int], Origins, BestPairs")
def seed_rays(vertices, rays, batch, origins, grasps):
    """Make rays in initial closing directions about each vertex's normals.

    The directions form a sunflower spiral over the cap of half-angle `cone` about the normal,
    starting along it. At a crease the cap is about the centre of the set of normals and contains
    all of them; the corners of the set come next. Directions outside the union of the normals'
    cones are skipped, and those at a larger angle to the normals than the critical angles of all
    cached grasps, as no second contact could make them better.

    Args:
        vertices: Vertices (n,).
        rays: Number of directions per vertex.
        batch: (first, last), the range of the directions, without the last.
        origins: `Origins`.
        grasps: `BestPairs`.

    Returns:
        The `Rays`.
    """
    sets, cone = origins.sets, origins.cone
    written, size = make_rays(vertices.shape[0] * (batch[1] - batch[0])), 0
    for v in vertices:
        # The critical angle is at least the angle between the direction and the vertex's normals.
        bound = min(cone, grasps.start_angles[v, -1])
        c, t = origins.centres[v], origins.tangents[v]
        b = cross(c, t)
        cap = 1.0 - math.cos(min(cone + origins.radii[v], math.pi))
        set_corners = 0 if sets.counts[v] == 1 else min(sets.counts[v], rays // 4)
        spiral_size = rays - set_corners
        for k in range(batch[0], batch[1]):
            if 0 < k <= set_corners:
                direction = triple(sets.normals[sets.start[v] + k - 1], 0)
            else:
                step = 0 if k == 0 else k - set_corners
                # Equal steps of height cover equal areas of the cap.
                cosine = 1.0 - cap * step / spiral_size
                sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
                p, q = sine * math.cos(step * GOLDEN_ANGLE), sine * math.sin(step * GOLDEN_ANGLE)
                direction = weighted_sum((cosine, p, q), c, t, b)
            size = append_ray(size, v, direction, bound, sets, written)
    return starting_rays(*written, size)


@kernel("Ints1, Origins, BestPairs")
def neighbour_rays(vertices, origins, grasps):
    """Make rays from each vertex toward the opposing contacts that its neighbours found.

    Args:
        vertices: Vertices (n,).
        origins: `Origins`.
        grasps: `BestPairs`.

    Returns:
        The `Rays`.
    """
    first, index = origins.neighbours
    capacity = 0
    for v in vertices:
        capacity += first[v + 1] - first[v]
    rays, size = make_rays(capacity), 0
    for v in vertices:
        bound = min(origins.cone, grasps.worst[v])
        for k in range(first[v], first[v + 1]):
            other = index[k]
            # An opposing contact of a neighbour is nearly one of this vertex: good grasps spread
            # from vertex to vertex.
            if grasps.reason[other] != FOUND:
                continue
            line = difference(origins.points[v], grasps.partner[other])
            length = norm(line)
            if length < 1e-6:
                continue
            size = append_ray(size, v, divided(line, length), bound, origins.sets, rays)
    return starting_rays(*rays, size)


RAYS_PER_ROUND = 12
"""Most rays per vertex in a round of refinement: two rings."""


@part
def _ring(size, v, axis, radius, turn, tangent, bound, sets, rays):
    """Append six directions at an angle `radius` about `axis`; return the new number of rays.

    Directions beyond `bound` of the normals are left out: they cannot have a smaller angle.
    """
    # The tangents turn with the object, so the same directions are tried in any orientation.
    e1 = combined(1.0, tangent, -dot(axis, tangent), axis)
    if norm(e1) < 1e-6:  # the axis is parallel to the tangent: any other vector serves
        x, y, z = abs(axis[0]), abs(axis[1]), abs(axis[2])
        other = (0.0, 0.0, 1.0)
        if x <= min(y, z):
            other = (1.0, 0.0, 0.0)
        elif y <= z:
            other = (0.0, 1.0, 0.0)
        e1 = combined(1.0, other, -dot(axis, other), axis)
    e1 = divided(e1, norm(e1))
    e2 = cross(axis, e1)
    along, aside = math.cos(radius), math.sin(radius)
    for k in range(6):
        azimuth = (k + turn) * math.pi / 3.0
        parts = along, aside * math.cos(azimuth), aside * math.sin(azimuth)
        direction = weighted_sum(parts, axis, e1, e2)
        size = append_ray(size, v, direction, bound, sets, rays)
    return size


@kernel("Ints1, Floats1, float, Origins, BestPairs")
def refining_rays(vertices, radii, turn, origins, grasps):
    """Make rays near each vertex's best grasp: a ring, and the bisector of the two normals.

    The bisector of n1 and -n2 makes equal angles with both normals: it is optimal if the surface
    at the second contact is flat.

    Args:
        vertices: Vertices with a grasp (n,).
        radii: Angle of the ring about the grasp of each vertex [rad] (V,).
        turn: Rotation of the ring in sixths of a turn.
        origins: `Origins`.
        grasps: `BestPairs`.

    Returns:
        The `Rays`.
    """
    sets = origins.sets
    rays, size = make_rays(vertices.shape[0] * RAYS_PER_ROUND), 0
    for v in vertices:
        axis, tangent = grasps.closing[v], origins.tangents[v]
        radius, bound = radii[v], min(origins.cone, grasps.worst[v])
        bisector = difference(origins.centres[v], grasps.partner_normal[v])
        if norm(bisector) > 1e-9:
            middle = divided(bisector, norm(bisector))
            size = append_ray(size, v, middle, bound, sets, rays)
        size = _ring(size, v, axis, radius, turn, tangent, bound, sets, rays)
    return starting_rays(*rays, size)


@kernel("Ints1, float, float, Origins, BestPairs")
def exploring_rays(vertices, radius, turn, origins, grasps):
    """Make rays in rings about the cached closing directions of each vertex except the best one.

    Args:
        vertices: Vertices (n,).
        radius: Angle of the rings [rad].
        turn: Rotation of the rings in sixths of a turn.
        origins: `Origins`.
        grasps: `BestPairs`.

    Returns:
        The `Rays`.
    """
    rays, size = make_rays(vertices.shape[0] * 6 * (grasps.starts.shape[1] - 1)), 0
    for v in vertices:
        bound = min(origins.cone, grasps.start_angles[v, -1])
        for k in range(1, grasps.starts.shape[1]):
            if grasps.start_angles[v, k] < math.inf:
                axis, tangent = grasps.starts[v, k], origins.tangents[v]
                size = _ring(size, v, axis, radius, turn, tangent, bound, origins.sets, rays)
    return starting_rays(*rays, size)
