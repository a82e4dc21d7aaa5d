"""The axes of contacts: wrenches of unit forces along the normal and the tangents, and of torsion.

The tangents are those of `contact.friction_cones.tangents`.
"""

import math

from grasp3d._kernels.compiling.decorators import kernel, merged


@merged
def _write_wrench(axis, point, f0, f1, f2, scale):
    """Write the wrench of a force at a point, its torque divided by the torque scale."""
    axis[0], axis[1], axis[2] = f0, f1, f2
    axis[3] = (point[1] * f2 - point[2] * f1) / scale
    axis[4] = (point[2] * f0 - point[0] * f2) / scale
    axis[5] = (point[0] * f1 - point[1] * f0) / scale


@kernel
def write_axes(points, normals, torsion_radius, scale, near_x_axis, axes):
    """Write the axes of contacts.

    Args:
        points: Relative to the centre of mass (c, 3).
        normals: Inward unit normals (c, 3).
        torsion_radius: (c,).
        scale: The torque scale.
        near_x_axis: Absolute x-component of a normal above which its tangents come from the y-axis.
        axes: Written, the first four of each contact (c, 4 or 6, 6).
    """
    for i in range(points.shape[0]):
        point, own = points[i], axes[i]
        n0, n1, n2 = normals[i, 0], normals[i, 1], normals[i, 2]
        # The first tangent is the normal x the axis.
        if abs(n0) > near_x_axis:
            t0, t1, t2 = -n2, 0.0, n0
        else:
            t0, t1, t2 = 0.0, n2, -n1
        length = math.sqrt(t0 * t0 + t1 * t1 + t2 * t2)
        if length > 0.0:
            t0, t1, t2 = t0 / length, t1 / length, t2 / length
        _write_wrench(own[0], point, n0, n1, n2, scale)
        _write_wrench(own[1], point, t0, t1, t2, scale)
        _write_wrench(own[2], point, n1 * t2 - n2 * t1, n2 * t0 - n0 * t2, n0 * t1 - n1 * t0, scale)
        own[3, 0], own[3, 1], own[3, 2] = 0.0, 0.0, 0.0
        own[3, 3] = torsion_radius[i] * n0 / scale
        own[3, 4] = torsion_radius[i] * n1 / scale
        own[3, 5] = torsion_radius[i] * n2 / scale
