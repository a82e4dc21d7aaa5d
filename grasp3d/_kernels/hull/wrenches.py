"""The wrenches that contacts apply along their axes, and the span of a grasp's wrenches.

The axes of a contact are the wrenches of unit forces along its normal and tangents, and of torsion.
The tangents are those of `contact.contacts.tangents`.
"""

import math

from grasp3d._kernels.compiling import kernel, merged, scratch_kernel
from grasp3d._kernels.surface.vectors import add6, copy6, dot6, scale6


@scratch_kernel("Floats3, Floats2, Floats1")
def centre(points, means, sizes):
    """Shift contacts so that their mean is 0, and divide them by their size.

    Args:
        points: Changed (b, n, 3).
        means: Written (b, 3).
        sizes: Written, the largest distance from the mean, or 1 if that is 0 (b,).
    """
    count = points.shape[1]
    for g in range(points.shape[0]):
        own, mean, square = points[g], means[g], 0.0
        # Differences of nearby points are exact; the mean of points far from the origin is not.
        for k in range(3):
            total, first = 0.0, own[0, k]
            for i in range(count):
                own[i, k] -= first
                total += own[i, k]
            for i in range(count):
                own[i, k] -= total / count
            mean[k] = first + total / count
        for i in range(count):
            square = max(square, own[i, 0] ** 2 + own[i, 1] ** 2 + own[i, 2] ** 2)
        sizes[g] = math.sqrt(square) if square > 0.0 else 1.0
        for i in range(count):
            for k in range(3):
                own[i, k] /= sizes[g]


@merged
def _write_wrench(axis, point, f0, f1, f2, scale):
    """Write the wrench of a force at a point, with the torque divided by the torque scale."""
    axis[0], axis[1], axis[2] = f0, f1, f2
    axis[3] = (point[1] * f2 - point[2] * f1) / scale
    axis[4] = (point[2] * f0 - point[0] * f2) / scale
    axis[5] = (point[0] * f1 - point[1] * f0) / scale


@kernel("FixedFloats2, FixedFloats2, FixedFloats1, float, float, Floats3")
def write_axes(points, normals, torsion_radius, scale, near_x_axis, axes):
    """Write the axes of contacts.

    Args:
        points: Relative to the centre of mass (c, 3).
        normals: Inward unit normals (c, 3).
        torsion_radius: Torsion radius of each contact (c,).
        scale: The torque scale.
        near_x_axis: Absolute x-component of a normal above which its tangents come from the y-axis.
        axes: Written, the axes of each contact (c, 4, 6).
    """
    for i in range(points.shape[0]):
        point, own = points[i], axes[i]
        n0, n1, n2 = normals[i, 0], normals[i, 1], normals[i, 2]
        # The first tangent is the normal x that axis.
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


RANK_TOLERANCE = 1e-12
"""Length of a wrench's part orthogonal to the span so far, with forces and torques each relative to
their largest, that rounding can explain, as it explains heights up to `polytope.TOLERANCE`.
Contacts that are farther from one line, but less than force closure needs, are undecided."""

NEGLIGIBLE = 1e-13
"""Size, relative to the largest wrench, below which all forces or torques are rounding errors."""

CLEARLY_INDEPENDENT = 1e-3
"""Length of the orthogonal part from which a wrench certainly adds a dimension."""


@merged
def _balance(rows, scratch):
    """Copy wrenches, with forces and torques each divided by the largest one."""
    force = torque = 0.0
    for i in range(rows.shape[0]):
        r = rows[i]
        force = max(force, r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
        torque = max(torque, r[3] * r[3] + r[4] * r[4] + r[5] * r[5])
    force, torque = math.sqrt(force), math.sqrt(torque)
    per_force = 1.0 / force if force > NEGLIGIBLE * torque else 0.0
    per_torque = 1.0 / torque if torque > NEGLIGIBLE * force else 0.0
    for i in range(rows.shape[0]):
        for k in range(3):
            scratch[i, k] = per_force * rows[i, k]
            scratch[i, k + 3] = per_torque * rows[i, k + 3]


@merged
def _is_clearly_full(scratch, basis):
    """Whether the wrenches, taken in their given order, clearly span all six dimensions."""
    size = 0
    for i in range(scratch.shape[0]):
        b = basis[size]
        copy6(scratch[i], b)
        for j in range(size):
            component = dot6(basis[j], b)
            add6(b, -component, basis[j])
        square = dot6(b, b)
        if square > CLEARLY_INDEPENDENT * CLEARLY_INDEPENDENT:
            factor = 1.0 / math.sqrt(square)
            scale6(b, factor)
            size += 1
            if size == 6:
                return True
    return False


@merged
def _orthonormalise(scratch, basis, max_rank, tolerance):
    """Gram-Schmidt, longest remainder first; return the number of basis rows written."""
    for size in range(max_rank):
        longest, row = tolerance * tolerance, -1
        for i in range(scratch.shape[0]):
            square = dot6(scratch[i], scratch[i])
            if square > longest:
                longest, row = square, i
        if row < 0:
            return size
        b = basis[size]
        copy6(scratch[row], b)
        for j in range(size):
            component = dot6(basis[j], b)
            add6(b, -component, basis[j])
        factor = 1.0 / math.sqrt(dot6(b, b))
        scale6(b, factor)
        # Twice: where nearly all cancels, one subtraction leaves rounding errors along b.
        for i in range(scratch.shape[0]):
            for _ in range(2):
                component = dot6(b, scratch[i])
                add6(scratch[i], -component, b)
    return max_rank


@scratch_kernel("Floats2, Floats2, Floats2")
def span(rows, scratch, basis):
    """Find the span of wrenches.

    Args:
        rows: Wrenches (n, 6).
        scratch: Scratch (n, 6).
        basis: Written, an orthonormal basis of the span, one row per dimension, ending with the
            direction in which the wrenches extend least (6, 6); the unit vectors if the wrenches
            clearly span all six dimensions.

    Returns:
        The rank.
    """
    # Balanced wrenches decide the rank, which must not depend on the unit of length.
    _balance(rows, scratch)
    full = _is_clearly_full(scratch, basis)
    rank = 6
    # The basis comes from the wrenches themselves, as epsilon is measured in their metric.
    if not full:
        rank = _orthonormalise(scratch, basis, 6, RANK_TOLERANCE)
        for i in range(rows.shape[0]):
            copy6(rows[i], scratch[i])
        rank = _orthonormalise(scratch, basis, rank, 0.0)
    for j in range(0 if full else rank, 6):
        for k in range(6):
            basis[j, k] = 1.0 if full and j == k else 0.0
    return rank
