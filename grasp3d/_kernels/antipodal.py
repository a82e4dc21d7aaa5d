"""Critical angles of two-finger grasps, and the rays that search for them.

Frames and units: every position is in the mesh's normalised frame (centred, size 1); angles in
radians; normals point into the object. A *closing direction* is the one in which finger 1 pushes:
toward finger 2 when squeezing (sign +1), away from it when expanding (sign -1).
"""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling import inlined, kernel

TIE = 1e-7
"""A candidate must be better by this angle, so that rounding does not choose among equals."""

STEP = 3e-7
"""How far behind a crossing the next ray starts; a few roundings of a 32-bit coordinate."""

PROPOSALS = 13
"""Most rays per vertex that a round of refinement proposes: two rings and a bisector."""

ON_EDGE = 1e-9
"""Barycentric coordinate below which a contact lies on the opposite edge."""

ANY_NORMAL = -2
"""Mark of an edge at which more than two faces meet."""

SMALLEST = 1e-6
"""Smallest opening, in object sizes, that the rounding of 32-bit rays lets us see."""

GOLDEN = math.pi * (3.0 - math.sqrt(5.0))

FOUND, NO_PARTNER, OPENING = 0, 1, 2
"""Why a vertex has a grasp or none."""


class Sets(NamedTuple):
    """All normals that a contact at a vertex may have; see `normal_sets`."""

    start: npt.NDArray[np.int64]
    """First row of each vertex in `normals` (V + 1,)."""
    counts: npt.NDArray[np.int64]
    """Corners of each polygon of normals (V,)."""
    normals: npt.NDArray[np.float64]
    """Unit normals (K, 3)."""


class Frames(NamedTuple):
    """Where the directions about each vertex are laid out."""

    centres: npt.NDArray[np.float64]
    """Middle of the vertex's normals (V, 3)."""
    tangents: npt.NDArray[np.float64]
    """A direction across it (V, 3)."""
    radii: npt.NDArray[np.float64]
    """Largest angle from the middle to a normal [rad] (V,)."""


class Surface(NamedTuple):
    """The faces that rays meet, with the normals along them."""

    points: npt.NDArray[np.float64]
    """Positions of the vertices (V, 3)."""
    faces: npt.NDArray[np.int64]
    """Vertices of each face (F, 3)."""
    corners: npt.NDArray[np.int64]
    """Row of `normals` at each corner of each face (F, 3)."""
    normals: npt.NDArray[np.float64]
    """Unit normals at the corners (C, 3)."""
    twins: npt.NDArray[np.int64]
    """Rows of `normals` across each crease (F, 3, 2); -1 where smooth or open, -2 where more than
    two faces meet and any normal may be."""


class Grasps(NamedTuple):
    """The best grasps so far, a row per vertex; written in place."""

    worst: npt.NDArray[np.float64]
    """Critical angle over the worst normals [rad]."""
    best: npt.NDArray[np.float64]
    """Critical angle over the best normals, of a grasp of its own [rad]."""
    closing: npt.NDArray[np.float64]
    """Closing direction of the grasp of `worst` (V, 3)."""
    closing_best: npt.NDArray[np.float64]
    """Closing direction of the grasp of `best` (V, 3)."""
    partner: npt.NDArray[np.float64]
    """Second contact of the grasp of `worst` (V, 3)."""
    partner_normal: npt.NDArray[np.float64]
    """Normal there (V, 3)."""
    signs: npt.NDArray[np.int8]
    """+1 squeeze, -1 expand, of the grasp of `worst`."""
    signs_best: npt.NDArray[np.int8]
    """The same for the grasp of `best`."""
    reason: npt.NDArray[np.uint8]
    """FOUND, NO_PARTNER or OPENING."""
    starts: npt.NDArray[np.float64]
    """Closing directions of the best grasps that lie apart, ordered (V, k, 3)."""
    start_angles: npt.NDArray[np.float64]
    """Their critical angles over the worst normals [rad] (V, k)."""
    start_signs: npt.NDArray[np.int8]
    """+1 squeeze, -1 expand (V, k)."""
    apart: float
    """Cosine of the angle from which two closing directions lie apart."""


class Rays(NamedTuple):
    """Rays from vertices, compacted in place as they end."""

    owner: npt.NDArray[np.int32]
    """Vertex that each starts from (r,)."""
    closing: npt.NDArray[np.float64]
    """Closing direction (r, 3)."""
    signs: npt.NDArray[np.int8]
    """+1: the ray runs along the closing direction, -1: against it (r,)."""
    along: npt.NDArray[np.float64]
    """Distance from the vertex at which the ray goes on (r,)."""
    step: npt.NDArray[np.float64]
    """How much farther it starts when it meets the same face again (r,)."""
    last: npt.NDArray[np.int32]
    """Face crossed last, -1 none (r,)."""


@kernel
def _angle(ax, ay, az, bx, by, bz):
    """Angle between two vectors, exact near 0 and pi."""
    cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return math.atan2(math.sqrt(cx * cx + cy * cy + cz * cz), ax * bx + ay * by + az * bz)


@kernel
def _arc_angle(a, b, x, y, z):
    """Smallest angle between a direction and the normals on the arc from a to b."""
    wx, wy, wz = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    length = math.sqrt(wx * wx + wy * wy + wz * wz)
    if length > 1e-15:
        wx, wy, wz = wx / length, wy / length, wz / length
        after = x * (wy * a[2] - wz * a[1]) + y * (wz * a[0] - wx * a[2])
        after += z * (wx * a[1] - wy * a[0])
        before = x * (b[1] * wz - b[2] * wy) + y * (b[2] * wx - b[0] * wz)
        before += z * (b[0] * wy - b[1] * wx)
        if after >= 0.0 and before >= 0.0:
            height = x * wx + y * wy + z * wz
            px, py, pz = x - height * wx, y - height * wy, z - height * wz
            return math.atan2(abs(height), math.sqrt(px * px + py * py + pz * pz))
    return min(_angle(a[0], a[1], a[2], x, y, z), _angle(b[0], b[1], b[2], x, y, z))


@kernel
def smallest_angle(normals, first, count, x, y, z):
    """Smallest angle between a direction and a set of normals (see normal_sets)."""
    if count == 1:
        return _angle(normals[first, 0], normals[first, 1], normals[first, 2], x, y, z)
    if count == 0:
        return 0.0
    if count == 2:
        return _arc_angle(normals[first], normals[first + 1], x, y, z)
    inside = True
    least = math.pi
    for i in range(count):
        a, b = normals[first + i], normals[first + (i + 1) % count]
        side = (a[1] * b[2] - a[2] * b[1]) * x + (a[2] * b[0] - a[0] * b[2]) * y
        side += (a[0] * b[1] - a[1] * b[0]) * z
        if side < 0.0:
            inside = False
            least = min(least, _arc_angle(a, b, x, y, z))
    return 0.0 if inside else least


@kernel
def largest_angle(normals, first, count, x, y, z):
    """Largest angle between a direction and a set of normals."""
    if count == 1:  # to the last bit what smallest_angle says
        return smallest_angle(normals, first, count, x, y, z)
    return math.pi - smallest_angle(normals, first, count, -x, -y, -z)


@inlined
def _normals_at(face, weights, surface, sets, found):
    """Write the normals that a contact inside or on the border of a face may have.

    Args:
        face: The face.
        weights: Barycentric coordinates of the contact, three numbers.
        surface: `Surface`.
        sets: `Sets`.
        found: Written, room for two normals (2, 3).

    Returns:
        (count, vertex): one normal or an arc in `found`, or 0 for any direction at all, with
        vertex -1; or the vertex whose own set holds, when the contact is that vertex.
    """
    normals, corners, twins = surface.normals, surface.corners, surface.twins
    b0, b1, b2 = weights
    c0, c1, c2 = corners[face, 0], corners[face, 1], corners[face, 2]
    for k in range(3):
        found[0, k] = b0 * normals[c0, k] + b1 * normals[c1, k] + b2 * normals[c2, k]
    count = 1
    if min(b0, b1, b2) <= ON_EDGE:
        for i in range(3):
            after, before = weights[(i + 1) % 3], weights[(i + 2) % 3]
            if after <= ON_EDGE and before <= ON_EDGE:
                vertex = surface.faces[face, i]
                if sets.counts[vertex] != 1:
                    return 0, vertex
            if weights[i] <= ON_EDGE and twins[face, i, 0] == ANY_NORMAL:
                return 0, -1
            if weights[i] <= ON_EDGE and twins[face, i, 0] >= 0:
                for k in range(3):
                    found[1, k] = after * normals[twins[face, i, 0], k]
                    found[1, k] += before * normals[twins[face, i, 1], k]
                count = 2
    for row in range(count):
        x, y, z = found[row, 0], found[row, 1], found[row, 2]
        length = math.sqrt(x * x + y * y + z * z)
        if length > 1e-12:
            found[row, 0], found[row, 1], found[row, 2] = x / length, y / length, z / length
        else:
            found[row] = normals[c0]
    return count, -1


@kernel
def normals_at(face, weights, surface, sets, found):
    """Do the same for callers from Python."""
    return _normals_at(face, weights, surface, sets, found)


@kernel
def _rays(owner, closing, signs, size):
    """Rays that start at their vertices."""
    return Rays(
        owner[:size],
        closing[:size],
        signs[:size],
        np.full(size, STEP),
        np.full(size, STEP),
        np.full(size, -1, dtype=np.int32),
    )


@kernel
def seed_rays(places, rays, batch, cone, sign, frames, sets, grasps):
    """Lay out the first directions about each place's own normals.

    A sunflower spiral over the cap of half-angle `cone` about the normal, the first ray along it.
    At a crease the cap is about the middle of the normals and wide enough for all of them, the
    normals themselves come next, and what lies outside the union of their cones is left out. So is
    a direction that is farther from the normal than all the grasps that are kept need: no partner
    could make it better.

    Args:
        places: Vertices (n,).
        rays: Directions per vertex.
        batch: (first, last): which of them; last not included.
        cone: Half-angle of the search cone [rad].
        sign: +1 squeeze, -1 expand.
        frames: `Frames`.
        sets: `Sets`.
        grasps: `Grasps`.

    Returns:
        The `Rays`.
    """
    start, counts, normals = sets.start, sets.counts, sets.normals
    room = places.shape[0] * (batch[1] - batch[0])
    owner = np.empty(room, dtype=np.int32)
    closing = np.empty((room, 3))
    size = 0
    for v in places:
        bound = min(cone, grasps.start_angles[v, -1])
        c, t = frames.centres[v], frames.tangents[v]
        bx, by, bz = (
            c[1] * t[2] - c[2] * t[1],
            c[2] * t[0] - c[0] * t[2],
            c[0] * t[1] - c[1] * t[0],
        )
        cap = 1.0 - math.cos(min(cone + frames.radii[v], math.pi))
        direct = 0 if counts[v] == 1 else min(counts[v], rays // 4)
        spread = rays - direct
        for k in range(batch[0], batch[1]):
            if 0 < k <= direct:
                n = normals[start[v] + k - 1]
                x, y, z = n[0], n[1], n[2]
            else:
                step = 0 if k == 0 else k - direct
                cosine = 1.0 - cap * step / spread
                sine = math.sqrt(max(0.0, 1.0 - cosine * cosine))
                p, q = sine * math.cos(step * GOLDEN), sine * math.sin(step * GOLDEN)
                x = cosine * c[0] + p * t[0] + q * bx
                y = cosine * c[1] + p * t[1] + q * by
                z = cosine * c[2] + p * t[2] + q * bz
            if smallest_angle(normals, start[v], counts[v], x, y, z) > bound:
                continue
            owner[size] = v
            closing[size, 0], closing[size, 1], closing[size, 2] = x, y, z
            size += 1
    return _rays(owner, closing, np.full(size, sign, dtype=np.int8), size)


@kernel
def _ring(size, v, sign, around, radius, turn, tangent, bound, sets, owner, closing, signs):
    """Add six directions at `radius` about one, within `bound` of the normals; returns the size."""
    start, counts, normals = sets.start, sets.counts, sets.normals
    dot = np.dot(around, tangent)
    e1 = tangent - dot * around
    length = math.sqrt(np.dot(e1, e1))
    if length < 1e-6:  # the tangent itself is the direction: any other will do
        e1 = np.zeros(3)
        e1[np.argmin(np.abs(around))] = 1.0
        e1 -= np.dot(e1, around) * around
        length = math.sqrt(np.dot(e1, e1))
    e1 /= length
    e2 = np.cross(around, e1)
    for k in range(6):
        azimuth = (k + turn) * math.pi / 3.0
        p, q = math.sin(radius) * math.cos(azimuth), math.sin(radius) * math.sin(azimuth)
        d = math.cos(radius) * around + p * e1 + q * e2
        if smallest_angle(normals, start[v], counts[v], d[0], d[1], d[2]) <= bound:
            owner[size], signs[size] = v, sign
            closing[size] = d
            size += 1
    return size


@kernel
def refining_rays(places, radii, turn, cone, frames, sets, grasps):
    """Directions near each place's best grasp: a ring, and the bisector of the two normals.

    The bisector of n1 and -n2 is the optimum wherever the partner's surface is locally flat.

    Args:
        places: Vertices that have a candidate (n,).
        radii: Angle of the ring about the grasp of each vertex [rad] (V,).
        turn: Rotation of the ring in sixths of a turn.
        cone: Half-angle of the search cone [rad].
        frames: `Frames`.
        sets: `Sets`.
        grasps: `Grasps`.

    Returns:
        The `Rays`.
    """
    start, counts, normals = sets.start, sets.counts, sets.normals
    room = places.shape[0] * PROPOSALS
    owner = np.empty(room, dtype=np.int32)
    closing = np.empty((room, 3))
    signs = np.empty(room, dtype=np.int8)
    size = 0
    for v in places:
        sign, around, tangent = grasps.signs[v], grasps.closing[v], frames.tangents[v]
        radius, bound = radii[v], min(cone, grasps.worst[v])
        middle = frames.centres[v] - grasps.partner_normal[v]
        length = math.sqrt(np.dot(middle, middle))
        if length > 1e-9:
            x, y, z = middle[0] / length, middle[1] / length, middle[2] / length
            if smallest_angle(normals, start[v], counts[v], x, y, z) <= bound:
                owner[size], signs[size] = v, sign
                closing[size, 0], closing[size, 1], closing[size, 2] = x, y, z
                size += 1
        size = _ring(
            size, v, sign, around, radius, turn, tangent, bound, sets, owner, closing, signs
        )
        other = grasps.closing_best[v]
        if counts[v] != 1 and np.dot(around, other) < math.cos(0.5 * radius):
            sign = grasps.signs_best[v]
            size = _ring(
                size, v, sign, other, radius, turn, tangent, bound, sets, owner, closing, signs
            )
    return _rays(owner, closing, signs, size)


@kernel
def exploring_rays(places, radius, turn, cone, frames, sets, grasps):
    """Rings about the starts of each place that are not its best grasp.

    Args:
        places: Vertices (n,).
        radius: Angle of the rings [rad].
        turn: Rotation of the rings in sixths of a turn.
        cone: Half-angle of the search cone [rad].
        frames: `Frames`.
        sets: `Sets`.
        grasps: `Grasps`.

    Returns:
        The `Rays`.
    """
    room = places.shape[0] * 6 * (grasps.starts.shape[1] - 1)
    owner = np.empty(room, dtype=np.int32)
    closing = np.empty((room, 3))
    signs = np.empty(room, dtype=np.int8)
    size = 0
    for v in places:
        bound = min(cone, grasps.start_angles[v, -1])
        for k in range(1, grasps.starts.shape[1]):
            if grasps.start_angles[v, k] < math.inf:
                around, sign = grasps.starts[v, k].copy(), grasps.start_signs[v, k]
                tangent = frames.tangents[v]
                size = _ring(
                    size, v, sign, around, radius, turn, tangent, bound, sets, owner, closing, signs
                )
    return _rays(owner, closing, signs, size)


@kernel
def shared_rays(places, cone, points, neighbours, sets, grasps):
    """Directions from each place to the partners that its neighbours found.

    Args:
        places: Vertices (n,).
        cone: Half-angle of the search cone [rad].
        points: Positions of the vertices (V, 3).
        neighbours: (first, index): the vertices around each vertex.
        sets: `Sets`.
        grasps: `Grasps`.

    Returns:
        The `Rays`.
    """
    start, counts, normals = sets.start, sets.counts, sets.normals
    first, index = neighbours
    room = 0
    for v in places:
        room += first[v + 1] - first[v]
    owner = np.empty(room, dtype=np.int32)
    closing = np.empty((room, 3))
    signs = np.empty(room, dtype=np.int8)
    size = 0
    for v in places:
        bound = min(cone, grasps.worst[v])
        for k in range(first[v], first[v + 1]):
            other = index[k]
            if grasps.reason[other] != FOUND:
                continue
            sign = grasps.signs[other]
            d = sign * (grasps.partner[other] - points[v])
            length = math.sqrt(np.dot(d, d))
            if length < 1e-6:
                continue
            d /= length
            if smallest_angle(normals, start[v], counts[v], d[0], d[1], d[2]) <= bound:
                owner[size], signs[size] = v, sign
                closing[size] = d
                size += 1
    return _rays(owner, closing, signs, size)


@kernel
def aim(count, rays, points, origins, directions):
    """Write the first `count` rays as 32-bit origins and directions."""
    for i in range(count):
        v, sign, along = rays.owner[i], rays.signs[i], rays.along[i]
        for k in range(3):
            d = sign * rays.closing[i, k]
            origins[i, k] = points[v, k] + along * d
            directions[i, k] = d


@inlined
def _remember(v, sign, x, y, z, angle, grasps):
    """Keep a vertex's best closing directions that lie apart from each other, in order."""
    directions, angles, signs = grasps.starts[v], grasps.start_angles[v], grasps.start_signs[v]
    row = angles.shape[0] - 1
    for k in range(angles.shape[0]):  # a start close by gives way to a better one, or stays
        cosine = x * directions[k, 0] + y * directions[k, 1] + z * directions[k, 2]
        if angles[k] < math.inf and signs[k] == sign and cosine > grasps.apart:
            row = k
            break
    if angle >= angles[row] - TIE:
        return
    while row > 0 and angle < angles[row - 1] - TIE:
        angles[row], signs[row] = angles[row - 1], signs[row - 1]
        directions[row] = directions[row - 1]
        row -= 1
    angles[row], signs[row] = angle, sign
    directions[row, 0], directions[row, 1], directions[row, 2] = x, y, z


@inlined
def _consider(v, sign, partner, opening, face, weights, surface, sets, grasps, found):
    """Weigh the grasp of a vertex and a place on a face; keep it where it is the best so far."""
    start, counts, normals = sets.start, sets.counts, sets.normals
    scale = sign / opening
    x = scale * (partner[0] - surface.points[v, 0])
    y = scale * (partner[1] - surface.points[v, 1])
    z = scale * (partner[2] - surface.points[v, 2])
    low = smallest_angle(normals, start[v], counts[v], x, y, z)
    if low > grasps.start_angles[v, -1]:
        return  # as good as it could be, it is worse than all that are kept
    high = low
    if counts[v] != 1:
        high = largest_angle(normals, start[v], counts[v], x, y, z)
    count, vertex = _normals_at(face, weights, surface, sets, found)
    if vertex >= 0:
        first, count = start[vertex], counts[vertex]
        low = max(low, smallest_angle(normals, first, count, -x, -y, -z))
        high = max(high, largest_angle(normals, first, count, -x, -y, -z))
        found[0] = normals[first]
    else:
        low = max(low, smallest_angle(found, 0, count, -x, -y, -z))
        high = max(high, largest_angle(found, 0, count, -x, -y, -z))
    if high < grasps.start_angles[v, -1]:
        _remember(v, sign, x, y, z, high, grasps)
    if high < grasps.worst[v] - TIE:
        grasps.worst[v] = high
        grasps.reason[v] = FOUND
        grasps.signs[v] = sign
        grasps.closing[v, 0], grasps.closing[v, 1], grasps.closing[v, 2] = x, y, z
        for k in range(3):
            grasps.partner[v, k] = partner[k]
            grasps.partner_normal[v, k] = found[0, k]
    if low < grasps.best[v] - TIE:
        grasps.best[v] = low
        grasps.signs_best[v] = sign
        grasps.closing_best[v, 0], grasps.closing_best[v, 1] = x, y
        grasps.closing_best[v, 2] = z


@kernel
def settle(count, hit, far, rays, surface, sets, limits, grasps):
    """Turn the faces that the rays hit into grasps, and keep the rays that must go on.

    The face is intersected again in 64 bits and the point clipped to it, so that every candidate
    is a place on the surface, whatever the 32-bit tracer rounded. An exit is told by the sign of
    direction and face normal, never by counting.

    Args:
        count: Rays in flight; the first ones of `rays`.
        hit: Face that each ray hit, -1 none (count,).
        far: Distance from where the ray went on to the hit, 32-bit (count,).
        rays: `Rays`; compacted in place.
        surface: `Surface`.
        sets: `Sets`.
        limits: (smallest, largest) opening.
        grasps: `Grasps`; written.

    Returns:
        Rays still in flight.
    """
    points, faces = surface.points, surface.faces
    owner, closing, signs, along, step, last = rays
    found = np.empty((2, 3))
    kept = 0
    for i in range(count):
        face = hit[i]
        if face < 0:
            continue
        v, sign = owner[i], signs[i]
        ox, oy, oz = points[v, 0], points[v, 1], points[v, 2]
        dx, dy, dz = sign * closing[i, 0], sign * closing[i, 1], sign * closing[i, 2]
        f0, f1, f2 = faces[face, 0], faces[face, 1], faces[face, 2]
        ax, ay, az = points[f0, 0], points[f0, 1], points[f0, 2]
        ux, uy, uz = points[f1, 0] - ax, points[f1, 1] - ay, points[f1, 2] - az
        wx, wy, wz = points[f2, 0] - ax, points[f2, 1] - ay, points[f2, 2] - az
        nx, ny, nz = uy * wz - uz * wy, uz * wx - ux * wz, ux * wy - uy * wx
        square = nx * nx + ny * ny + nz * nz
        slope = dx * nx + dy * ny + dz * nz
        coarse = along[i] + far[i]
        t = coarse
        if abs(slope) > 1e-7 * math.sqrt(square):  # else the ray runs along the face
            exact = ((ax - ox) * nx + (ay - oy) * ny + (az - oz) * nz) / slope
            if abs(exact - coarse) < 1e-3:
                t = exact
        if face == last[i] or t <= STEP:  # the face just left, or one at the vertex itself
            step[i] *= 2.0
            along[i] = max(along[i], coarse) + step[i]
        else:
            along[i] = max(along[i], t) + STEP
            step[i], last[i] = STEP, face
            if sign * slope > 0.0:
                rx, ry, rz = ox + t * dx - ax, oy + t * dy - ay, oz + t * dz - az
                b1 = (ry * wz - rz * wy) * nx + (rz * wx - rx * wz) * ny + (rx * wy - ry * wx) * nz
                b2 = (uy * rz - uz * ry) * nx + (uz * rx - ux * rz) * ny + (ux * ry - uy * rx) * nz
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
                    _consider(
                        v, sign, partner, opening, face, (b0, b1, b2), surface, sets, grasps, found
                    )
                elif opening >= SMALLEST and grasps.reason[v] == NO_PARTNER:
                    grasps.reason[v] = OPENING
            # Pushing apart, what lies behind the first wall is not reached from here.
            if sign < 0 or along[i] > limits[1]:
                continue
        owner[kept], signs[kept] = owner[i], signs[i]
        for k in range(3):
            closing[kept, k] = closing[i, k]
        along[kept], step[kept], last[kept] = along[i], step[i], last[i]
        kept += 1
    return kept


@kernel
def scan(fixed_point, fixed_normals, points, sets, worst, best, signs):
    """Critical angles of the grasps that one fixed contact makes with every vertex.

    Wan & Howe 2018, Sec. IV: both signs of the line count, so a grasp that squeezes and one that
    expands are both found.

    Args:
        fixed_point: The fixed contact (3,).
        fixed_normals: Its normals, as a set (k, 3).
        points: Positions of the vertices (V, 3).
        sets: `Sets`.
        worst: Written, critical angle over the worst normals [rad] (V,); inf where the contacts
            coincide.
        best: Written, the same over the best normals (V,).
        signs: Written, +1 squeeze, -1 expand, of the worst (V,).
    """
    start, counts, normals = sets.start, sets.counts, sets.normals
    many = fixed_normals.shape[0]
    for v in range(points.shape[0]):
        x, y, z = (
            points[v, 0] - fixed_point[0],
            points[v, 1] - fixed_point[1],
            points[v, 2] - fixed_point[2],
        )
        length = math.sqrt(x * x + y * y + z * z)
        worst[v] = best[v] = math.inf
        signs[v] = 0
        if length < 1e-12 or (counts[v] == 0 and start[v + 1] == start[v]):
            continue
        for sign in (1, -1):
            ex, ey, ez = sign * x / length, sign * y / length, sign * z / length
            high = max(
                largest_angle(fixed_normals, 0, many, ex, ey, ez),
                largest_angle(normals, start[v], counts[v], -ex, -ey, -ez),
            )
            low = max(
                smallest_angle(fixed_normals, 0, many, ex, ey, ez),
                smallest_angle(normals, start[v], counts[v], -ex, -ey, -ez),
            )
            if high < worst[v]:
                worst[v], signs[v] = high, sign
            best[v] = min(best[v], low)
