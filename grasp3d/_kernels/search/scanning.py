"""Critical angles of the grasps of one fixed contact with every vertex."""

import math

from grasp3d._kernels.compiling.decorators import kernel
from grasp3d._kernels.surface.normal_angles import largest_angle, smallest_angle


@kernel
def scan(fixed_point, fixed_normals, points, sets, worst, best, signs):
    """Critical angles of the grasps that one fixed contact makes with every vertex.

    Wan & Howe 2018, Sec. III-B: both signs of the line are evaluated, for grasps that squeeze and
    grasps that expand.

    Args:
        fixed_point: The fixed contact (3,).
        fixed_normals: Its normals, as a set (k, 3).
        points: Positions of the vertices (V, 3).
        sets: `ContactNormals`.
        worst: Written, critical angle over the worst normals [rad] (V,); inf where the contacts
            coincide.
        best: Written, the same over the best normals (V,).
        signs: Written, +1 squeeze, -1 expand, of the worst (V,).
    """
    start, counts, normals = sets.start, sets.counts, sets.normals
    count = fixed_normals.shape[0]
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
        # Closed form: the critical angle is the larger of the angles between line and normals.
        for sign in (1, -1):
            ex, ey, ez = sign * x / length, sign * y / length, sign * z / length
            high = max(
                largest_angle(fixed_normals, 0, count, ex, ey, ez),
                largest_angle(normals, start[v], counts[v], -ex, -ey, -ez),
            )
            low = max(
                smallest_angle(fixed_normals, 0, count, ex, ey, ez),
                smallest_angle(normals, start[v], counts[v], -ex, -ey, -ez),
            )
            if high < worst[v]:
                worst[v], signs[v] = high, sign
            best[v] = min(best[v], low)
