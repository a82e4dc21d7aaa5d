"""Where a round tip that moves along x touches a face; frames and positions as in `first_touch`."""

import math

from grasp3d._kernels.compiling.decorators import kernel
from grasp3d._kernels.jaws.jaws import EDGE_ON, ROUNDING, edge_and_normal


@kernel
def ball_position(corners, normal, side, jaw, start, scratch):
    """(whether a ball overlaps a face at its start, position at which it touches it, inf: never).

    The point touched is written to `scratch.mean`.
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
