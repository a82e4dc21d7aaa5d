"""The span of a grasp's wrenches: its rank, and coordinates in it."""

import math

from grasp3d._kernels.compiling import merged, scratch_kernel
from grasp3d._kernels.vectors import dot6

RANK_TOLERANCE = 1e-10
"""Length across the span so far, with forces and torques each measured by their largest, below
which a wrench adds no dimension."""

NOTHING = 1e-13
"""Share of the largest wrench below which all forces, or all torques, count as rounding."""

CLEAR = 1e-3
"""Length across the span from which a wrench surely adds a dimension."""


@merged
def _balance(rows, work):
    """Copy wrenches, their forces and their torques each divided by the largest."""
    force = torque = 0.0
    for i in range(rows.shape[0]):
        r = rows[i]
        force = max(force, r[0] * r[0] + r[1] * r[1] + r[2] * r[2])
        torque = max(torque, r[3] * r[3] + r[4] * r[4] + r[5] * r[5])
    force, torque = math.sqrt(force), math.sqrt(torque)
    per_force = 1.0 / force if force > NOTHING * torque else 0.0
    per_torque = 1.0 / torque if torque > NOTHING * force else 0.0
    for i in range(rows.shape[0]):
        for k in range(3):
            work[i, k] = per_force * rows[i, k]
            work[i, k + 3] = per_torque * rows[i, k + 3]


@merged
def _is_clearly_full(work, basis):
    """Whether the wrenches in their given order soon span all six dimensions."""
    size = 0
    for i in range(work.shape[0]):
        b = basis[size]
        for k in range(6):
            b[k] = work[i, k]
        for j in range(size):
            part = dot6(basis[j], b)
            for k in range(6):
                b[k] -= part * basis[j, k]
        square = dot6(b, b)
        if square > CLEAR * CLEAR:
            factor = 1.0 / math.sqrt(square)
            for k in range(6):
                b[k] *= factor
            size += 1
            if size == 6:
                return True
    return False


@merged
def _orthonormalise(work, basis, most, tolerance):
    """Gram-Schmidt, the longest remainder first; returns how many rows of the basis it filled."""
    for size in range(most):
        longest, chosen = tolerance * tolerance, -1
        for i in range(work.shape[0]):
            square = dot6(work[i], work[i])
            if square > longest:
                longest, chosen = square, i
        if chosen < 0:
            return size
        b = basis[size]
        for k in range(6):
            b[k] = work[chosen, k]
        for j in range(size):
            part = dot6(basis[j], b)
            for k in range(6):
                b[k] -= part * basis[j, k]
        factor = 1.0 / math.sqrt(dot6(b, b))
        for k in range(6):
            b[k] *= factor
        for i in range(work.shape[0]):
            for _ in range(2):
                part = dot6(b, work[i])
                for k in range(6):
                    work[i, k] -= part * b[k]
    return most


@scratch_kernel
def span(rows, work, basis):
    """Find the span of wrenches.

    Args:
        rows: Wrenches (n, 6).
        work: Scratch (n, 6).
        basis: Written, an orthonormal basis, a row per dimension, last the one along which
            the wrenches reach least (6, 6); the unit vectors where they clearly span all.

    Returns:
        The rank.
    """
    _balance(rows, work)
    full = _is_clearly_full(work, basis)
    rank = 6
    if not full:
        rank = _orthonormalise(work, basis, 6, RANK_TOLERANCE)
        for i in range(rows.shape[0]):
            for k in range(6):
                work[i, k] = rows[i, k]
        rank = _orthonormalise(work, basis, rank, 0.0)
    for j in range(0 if full else rank, 6):
        for k in range(6):
            basis[j, k] = 1.0 if full and j == k else 0.0
    return rank
