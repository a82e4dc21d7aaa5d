"""The span of a grasp's wrenches: its rank and an orthonormal basis."""

import math

from grasp3d._kernels.compiling.decorators import merged, scratch_kernel
from grasp3d._kernels.surface.vectors import dot6

RANK_TOLERANCE = 1e-10
"""Length of a wrench's part orthogonal to the span so far, with forces and torques each relative to
their largest, below which it adds no dimension."""

NEGLIGIBLE = 1e-13
"""Size relative to the largest wrench below which all forces, or torques, are rounding errors."""

CLEARLY_INDEPENDENT = 1e-3
"""Length of the orthogonal part from which a wrench surely adds a dimension."""


@merged
def _balance(rows, scratch):
    """Copy wrenches with forces and torques each divided by their largest."""
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
        for k in range(6):
            b[k] = scratch[i, k]
        for j in range(size):
            component = dot6(basis[j], b)
            for k in range(6):
                b[k] -= component * basis[j, k]
        square = dot6(b, b)
        if square > CLEARLY_INDEPENDENT * CLEARLY_INDEPENDENT:
            factor = 1.0 / math.sqrt(square)
            for k in range(6):
                b[k] *= factor
            size += 1
            if size == 6:
                return True
    return False


@merged
def _orthonormalise(scratch, basis, max_rank, tolerance):
    """Gram-Schmidt, the longest remainder first; returns the number of basis rows written."""
    for size in range(max_rank):
        longest, chosen = tolerance * tolerance, -1
        for i in range(scratch.shape[0]):
            square = dot6(scratch[i], scratch[i])
            if square > longest:
                longest, chosen = square, i
        if chosen < 0:
            return size
        b = basis[size]
        for k in range(6):
            b[k] = scratch[chosen, k]
        for j in range(size):
            component = dot6(basis[j], b)
            for k in range(6):
                b[k] -= component * basis[j, k]
        factor = 1.0 / math.sqrt(dot6(b, b))
        for k in range(6):
            b[k] *= factor
        # Twice: one subtraction leaves rounding errors along b where nearly all cancels.
        for i in range(scratch.shape[0]):
            for _ in range(2):
                component = dot6(b, scratch[i])
                for k in range(6):
                    scratch[i, k] -= component * b[k]
    return max_rank


@scratch_kernel
def span(rows, tolerance, scratch, basis):
    """Find the span of wrenches.

    Args:
        rows: Wrenches (n, 6).
        tolerance: Usually RANK_TOLERANCE.
        scratch: Scratch (n, 6).
        basis: Written, an orthonormal basis of the span, a row per dimension, the direction in
            which the wrenches extend least last (6, 6); the unit vectors where they clearly span
            all six dimensions.

    Returns:
        The rank.
    """
    # The rank is decided on balanced wrenches: it must not depend on the unit of length.
    _balance(rows, scratch)
    full = _is_clearly_full(scratch, basis)
    rank = 6
    # The basis is then taken from the wrenches themselves, as epsilon is measured in their metric.
    if not full:
        rank = _orthonormalise(scratch, basis, 6, tolerance)
        for i in range(rows.shape[0]):
            for k in range(6):
                scratch[i, k] = rows[i, k]
        rank = _orthonormalise(scratch, basis, rank, 0.0)
    for j in range(0 if full else rank, 6):
        for k in range(6):
            basis[j, k] = 1.0 if full and j == k else 0.0
    return rank
