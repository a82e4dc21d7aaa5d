"""How deep frictionless closure is: by how much all normals may tilt before it is lost."""

import math

import numpy as np

from grasp3d._kernels.compiling import merged, scratch_kernel

STACK = 1024
"""Cells that wait; a depth-first search has one more for each halving, and 64 at first."""


CROSSING_STEPS = 10
"""Halvings of an edge to find where it leaves a cone; the point kept is inside."""

SHRUNK = 0.9
"""Share of its edges to which a cell must shrink, or it is halved."""


@merged
def _weigh(axes, dim, rays, cosines, cell, k):
    """Write the cosines between a ray's work and the contacts' normals; returns the largest."""
    best = -1.0
    for i in range(axes.shape[0]):
        z0 = z1 = z2 = 0.0
        for c in range(dim):
            z0 += axes[i, 0, c] * rays[cell, k, c]
            z1 += axes[i, 1, c] * rays[cell, k, c]
            z2 += axes[i, 2, c] * rays[cell, k, c]
        length = math.sqrt(z0 * z0 + z1 * z1 + z2 * z2)
        if length > 0.0:
            cosines[cell, k, i] = z0 / length
            best = max(best, z0 / length)
        else:  # no work at this contact: it resists nothing, and no cone leaves it out
            cosines[cell, k, i] = 1.0
    return best


@merged
def _left_out(cosines, dim, cell, enough):
    """The contact whose cone leaves the fewest rays of a cell out: (contact, how many)."""
    chosen, fewest = 0, dim + 1
    for i in range(cosines.shape[2]):
        out = 0
        for k in range(dim):
            out += cosines[cell, k, i] < enough
        if out < fewest:
            chosen, fewest = i, out
    return chosen, fewest


@merged
def _crossing(axes, i, dim, rays, cell, out, inside, enough):
    """How far from a ray outside contact i's cone to one inside its boundary lies, 0 to 1."""
    low, high = 0.0, 1.0
    for _ in range(CROSSING_STEPS):
        middle = 0.5 * (low + high)
        z0 = z1 = z2 = 0.0
        for c in range(dim):
            x = (1.0 - middle) * rays[cell, out, c] + middle * rays[cell, inside, c]
            z0 += axes[i, 0, c] * x
            z1 += axes[i, 1, c] * x
            z2 += axes[i, 2, c] * x
        if z0 >= enough * math.sqrt(z0 * z0 + z1 * z1 + z2 * z2):
            high = middle
        else:
            low = middle
    return high


@merged
def _move(axes, dim, rays, cosines, cell, k, other, share):
    """Move a ray of a cell toward another; returns the largest cosine there."""
    length = 0.0
    for c in range(dim):
        x = (1.0 - share) * rays[cell, k, c] + share * rays[cell, other, c]
        rays[cell, k, c] = x
        length += x * x
    for c in range(dim):
        rays[cell, k, c] /= math.sqrt(length)
    return _weigh(axes, dim, rays, cosines, cell, k)


@merged
def _longest_edge(rays, dim, cell):
    first, second, least = 0, 1, 2.0
    for a in range(dim):
        for b in range(a):
            cosine = 0.0
            for c in range(dim):
                cosine += rays[cell, a, c] * rays[cell, b, c]
            if cosine < least:
                first, second, least = a, b, cosine
    return first, second


@scratch_kernel
def frictionless_depth(axes, dim, best, tolerance, cells, rays, cosines):
    """Smallest over all directions of the largest cosine between work and a contact's normal.

    Branch and bound: the directions are parted into simplicial cones; one is done with when a
    single contact keeps a large enough cosine at all its rays, hence all over it.

    Args:
        axes: Wrenches of the contacts' normals and tangents in the span (n, 3, 6).
        dim: Rank.
        best: A cosine known to be reached by no contact somewhere, 1 if none is; the better it
            is, the fewer cells are needed.
        tolerance: How far from the smallest the result may be, as an angle [rad].
        cells: Cells after which to give up.
        rays: Scratch (STACK, 6, 6).
        cosines: Scratch (STACK, 6, n).

    Returns:
        (found, sure): the smallest found, and a cosine that is certainly reached in every
        direction, 0 when given up.
    """
    size = 0
    for corner in range(1 << dim):
        for k in range(dim):
            for c in range(dim):
                rays[size, k, c] = 0.0
            rays[size, k, k] = -1.0 if corner >> k & 1 else 1.0
            best = min(best, _weigh(axes, dim, rays, cosines, size, k))
        size += 1
    for _ in range(cells):
        if best <= 0.0 or size == 0:
            break
        cell = size - 1
        enough = math.sin(math.asin(best) - tolerance)
        i, out = _left_out(cosines, dim, cell, enough)
        if out == 0:
            size -= 1
            continue
        if out == 1:  # the cone is convex: only the corner about that ray is left
            lone = 0
            while cosines[cell, lone, i] >= enough:
                lone += 1
            longest = 0.0
            for k in range(dim):
                if k != lone:
                    share = _crossing(axes, i, dim, rays, cell, lone, k, enough)
                    longest = max(longest, share)
                    best = min(best, _move(axes, dim, rays, cosines, cell, k, lone, 1.0 - share))
            if longest < SHRUNK:
                continue
        if size >= rays.shape[0]:
            break
        a, b = _longest_edge(rays, dim, cell)
        for k in range(dim):
            for c in range(dim):
                rays[size, k, c] = rays[cell, k, c]
            for j in range(axes.shape[0]):
                cosines[size, k, j] = cosines[cell, k, j]
        best = min(best, _move(axes, dim, rays, cosines, size, a, b, 0.5))
        best = min(best, _move(axes, dim, rays, cosines, cell, b, a, 0.5))
        size += 1
    if size > 0 or best <= 0.0:
        return best, 0.0
    return best, max(math.sin(math.asin(best) - tolerance), 0.0)


def make_cells(count):
    """Allocate the scratch of `frictionless_depth` for so many contacts: (rays, cosines)."""
    return np.zeros((STACK, 6, 6)), np.zeros((STACK, 6, count))
