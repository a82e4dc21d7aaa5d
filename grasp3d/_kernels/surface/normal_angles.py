"""Angles between directions and the normals that a contact may have."""

import math

from grasp3d._kernels.compiling.decorators import kernel, merged, part


@merged
def _angle(ax, ay, az, bx, by, bz):
    """Angle between two vectors, by atan2: accurate near 0 and pi too."""
    cx, cy, cz = ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx
    return math.atan2(math.sqrt(cx * cx + cy * cy + cz * cz), ax * bx + ay * by + az * bz)


@part
def _arc_angle(a, b, x, y, z):
    """Smallest angle between a direction and the normals on the arc from a to b."""
    wx, wy, wz = a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]
    # w: axis of the great circle through a and b. The projection of the direction to that circle is
    # on the arc where it lies after a and before b; otherwise an end of the arc is nearest.
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
    # Inside a convex spherical polygon all its sides are passed on the left.
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
    if count == 1:  # bit-identical to smallest_angle
        return smallest_angle(normals, first, count, x, y, z)
    # The farthest normal from a direction is the nearest one to its opposite.
    return math.pi - smallest_angle(normals, first, count, -x, -y, -z)
