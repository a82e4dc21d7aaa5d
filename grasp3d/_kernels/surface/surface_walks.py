"""Straight walks over a surface, from face to face, and random numbers for kernels."""

import math

import numpy as np

from grasp3d._kernels.compiling.decorators import merged, part

MOST_FACES = 512
"""Most faces that a walk crosses."""

INSIDE = 1e-4
"""Smallest barycentric coordinate at the end of a walk: contacts stay off edges and creases."""

_GOLDEN = np.uint64(0x9E3779B97F4A7C15)
_ONE, _TWO = np.uint64(0xBF58476D1CE4E5B9), np.uint64(0x94D049BB133111EB)
_S11, _S27, _S30, _S31 = np.uint64(11), np.uint64(27), np.uint64(30), np.uint64(31)


@merged
def random_bits(state):
    """Next 64-bit number of a pseudo-random sequence (splitmix64: Steele, Lea & Flood 2014)."""
    state[0] += _GOLDEN
    z = state[0]
    z = (z ^ (z >> _S30)) * _ONE
    z = (z ^ (z >> _S27)) * _TWO
    return z ^ (z >> _S31)


@merged
def random_fraction(state):
    """Next random number, at least 0 and below 1."""
    return np.float64(random_bits(state) >> _S11) * (1.0 / 9007199254740992.0)


@merged
def _corner(points, faces, face, i):
    """Coordinates of corner i of a face."""
    v = faces[face, i]
    return points[v, 0], points[v, 1], points[v, 2]


@part
def walk(face, weights, angle, length, points, faces, adjacent_faces):
    """Walk straight over a surface: each next face is unfolded about the common edge.

    Args:
        face: Face to start from.
        weights: Barycentric coordinates of the start (3,); written, those of the end.
        angle: Direction in the plane of the face, from its first edge [rad].
        length: Length of the walk, which ends early at the border of the surface.
        points: Positions of the vertices (V, 3).
        faces: Vertices of each face (F, 3).
        adjacent_faces: Face across the edge opposite each corner (F, 3); -1: none, or several.

    Returns:
        The face where the walk ends.
    """
    ax, ay, az = _corner(points, faces, face, 0)
    bx, by, bz = _corner(points, faces, face, 1)
    cx, cy, cz = _corner(points, faces, face, 2)
    # The direction from its components along the first edge (e) and orthogonal to it (g).
    ex, ey, ez = bx - ax, by - ay, bz - az
    gx, gy, gz = cx - ax, cy - ay, cz - az
    size = math.sqrt(ex * ex + ey * ey + ez * ez)
    ex, ey, ez = ex / size, ey / size, ez / size
    component = ex * gx + ey * gy + ez * gz
    gx, gy, gz = gx - component * ex, gy - component * ey, gz - component * ez
    size = math.sqrt(gx * gx + gy * gy + gz * gz)
    c, s = math.cos(angle), math.sin(angle) / size
    dx, dy, dz = c * ex + s * gx, c * ey + s * gy, c * ez + s * gz
    for _ in range(MOST_FACES):
        ax, ay, az = _corner(points, faces, face, 0)
        bx, by, bz = _corner(points, faces, face, 1)
        cx, cy, cz = _corner(points, faces, face, 2)
        ux, uy, uz = bx - ax, by - ay, bz - az
        vx, vy, vz = cx - ax, cy - ay, cz - az
        uu, vv = ux * ux + uy * uy + uz * uz, vx * vx + vy * vy + vz * vz
        uv = ux * vx + uy * vy + uz * vz
        du, dv = ux * dx + uy * dy + uz * dz, vx * dx + vy * dy + vz * dz
        area = uu * vv - uv * uv
        r1, r2 = (vv * du - uv * dv) / area, (uu * dv - uv * du) / area
        # Rates of the barycentric coordinates along the direction: the first to reach 0 decides
        # the edge through which the walk leaves the face.
        rates = (-(r1 + r2), r1, r2)
        step, leaving = length, -1
        for i in range(3):
            if rates[i] < 0.0 and weights[i] < -rates[i] * step:
                step, leaving = weights[i] / -rates[i], i
        for i in range(3):
            weights[i] += step * rates[i]
        length -= step
        if leaving < 0 or adjacent_faces[face, leaving] < 0:
            break
        # The direction's component along the edge stays; the rest turns into the next face.
        other = adjacent_faces[face, leaving]
        p, q = faces[face, (leaving + 1) % 3], faces[face, (leaving + 2) % 3]
        wp, wq = max(weights[(leaving + 1) % 3], 0.0), max(weights[(leaving + 2) % 3], 0.0)
        total = max(wp + wq, 1e-300)
        px, py, pz = points[p, 0], points[p, 1], points[p, 2]
        kx, ky, kz = points[q, 0] - px, points[q, 1] - py, points[q, 2] - pz
        size = math.sqrt(kx * kx + ky * ky + kz * kz)
        kx, ky, kz = kx / size, ky / size, kz / size
        along = dx * kx + dy * ky + dz * kz
        opposite = 0
        for i in range(3):
            weights[i] = 0.0
            if faces[other, i] == p:
                weights[i] = wp / total
            elif faces[other, i] == q:
                weights[i] = wq / total
            else:
                opposite = i
        v = faces[other, opposite]
        tx, ty, tz = points[v, 0] - px, points[v, 1] - py, points[v, 2] - pz
        component = tx * kx + ty * ky + tz * kz
        tx, ty, tz = tx - component * kx, ty - component * ky, tz - component * kz
        size = math.sqrt(tx * tx + ty * ty + tz * tz)
        side = math.sqrt(max(0.0, 1.0 - along * along)) / size
        dx, dy, dz = along * kx + side * tx, along * ky + side * ty, along * kz + side * tz
        face = other
    # Away from the edges, where a contact would have two normals.
    total = 0.0
    for i in range(3):
        weights[i] = max(weights[i], INSIDE)
        total += weights[i]
    for i in range(3):
        weights[i] /= total
    return face
