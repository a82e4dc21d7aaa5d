"""Depth of frictionless force closure: by how much all normals may tilt before it is lost."""

import math

import numpy as np

from grasp3d._kernels.compiling import merged, scratch_kernel

STACK = 1024
"""Capacity for pending cells: depth-first search adds one per bisection, starting from 64."""

CROSSING_STEPS = 10
"""Bisections of an edge to find where it leaves a cone; the result lies inside the cone."""

SHRINKAGE = 0.9
"""Factor by which cutting must shorten a cell's edges; otherwise the cell is bisected."""


@merged
def _write_cosines(axes, dim, rays, cosines, cell, k):
    """Write the cosines between a ray's contact directions and the normals; returns the largest."""
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
        else:  # the motion leaves this contact at rest: no cone excludes the ray
            cosines[cell, k, i] = 1.0
    return best


@merged
def _most_covering_contact(cosines, dim, cell, threshold):
    """(contact, number): the contact whose cone excludes the fewest rays of a cell."""
    chosen, fewest = 0, dim + 1
    for i in range(cosines.shape[2]):
        excluded = 0
        for k in range(dim):
            excluded += cosines[cell, k, i] < threshold
        if excluded < fewest:
            chosen, fewest = i, excluded
    return chosen, fewest


@merged
def _crossing(axes, i, dim, rays, cell, excluded, inside, threshold):
    """Position of the boundary of contact i's cone between a ray outside and one inside, 0 to 1."""
    low, high = 0.0, 1.0
    for _ in range(CROSSING_STEPS):
        middle = 0.5 * (low + high)
        z0 = z1 = z2 = 0.0
        for c in range(dim):
            x = (1.0 - middle) * rays[cell, excluded, c] + middle * rays[cell, inside, c]
            z0 += axes[i, 0, c] * x
            z1 += axes[i, 1, c] * x
            z2 += axes[i, 2, c] * x
        if z0 >= threshold * math.sqrt(z0 * z0 + z1 * z1 + z2 * z2):
            high = middle
        else:
            low = middle
    return high


@merged
def _move_ray(axes, dim, rays, cosines, cell, k, other, fraction):
    """Move a ray of a cell toward another one; returns its largest cosine."""
    length = 0.0
    for c in range(dim):
        x = (1.0 - fraction) * rays[cell, k, c] + fraction * rays[cell, other, c]
        rays[cell, k, c] = x
        length += x * x
    for c in range(dim):
        rays[cell, k, c] /= math.sqrt(length)
    return _write_cosines(axes, dim, rays, cosines, cell, k)


@merged
def _longest_edge(rays, dim, cell):
    """The two rays of a cell with the smallest cosine between them."""
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
    """Smallest, over all directions, of the largest cosine between a contact's motion and normal.

    A direction u of wrench space is an infinitesimal motion of the object, g_i = u_f + u_tau x p_i
    its velocity at contact i; the grasp is force-closed without friction if for every u some
    normal has a positive component along g_i. Branch and bound: the directions are divided into
    simplicial cones (cells), starting from the 2^d orthants. A cell is finished when one contact's
    cosine is large enough at all its rays, and hence, that contact's cone being convex, in all of
    the cell.

    Args:
        axes: Wrenches of the contacts' normals and tangents in the span (n, 3, 6).
        dim: Rank.
        best: An upper bound of the result, 1 if none is known; the lower it is, the fewer cells
            are needed.
        tolerance: Largest error of the result, as an angle [rad].
        cells: Largest number of cells.
        rays: Scratch (STACK, 6, 6).
        cosines: Scratch (STACK, 6, n).

    Returns:
        (found, sure): the smallest cosine found, and a lower bound that holds in every direction,
        0 where the number of cells did not suffice.
    """
    size = 0
    for corner in range(1 << dim):  # the orthants of the wrench space
        for k in range(dim):
            for c in range(dim):
                rays[size, k, c] = 0.0
            rays[size, k, k] = -1.0 if corner >> k & 1 else 1.0
            best = min(best, _write_cosines(axes, dim, rays, cosines, size, k))
        size += 1
    for _ in range(cells):
        if best <= 0.0 or size == 0:
            break
        cell = size - 1  # depth-first: the last cell
        threshold = math.sin(math.asin(best) - tolerance)
        i, excluded = _most_covering_contact(cosines, dim, cell, threshold)
        if excluded == 0:
            size -= 1
            continue
        if excluded == 1:  # the cone is convex: only the part near that ray remains
            # Cut the cell where its edges from the excluded ray enter the cone.
            lone = 0
            while cosines[cell, lone, i] >= threshold:
                lone += 1
            longest = 0.0
            for k in range(dim):
                if k != lone:
                    fraction = _crossing(axes, i, dim, rays, cell, lone, k, threshold)
                    longest = max(longest, fraction)
                    best = min(
                        best, _move_ray(axes, dim, rays, cosines, cell, k, lone, 1.0 - fraction)
                    )
            if longest < SHRINKAGE:
                continue
        if size >= rays.shape[0]:
            break
        # Bisect the longest edge: one half replaces the cell, the other is appended.
        a, b = _longest_edge(rays, dim, cell)
        for k in range(dim):
            for c in range(dim):
                rays[size, k, c] = rays[cell, k, c]
            for j in range(axes.shape[0]):
                cosines[size, k, j] = cosines[cell, k, j]
        best = min(best, _move_ray(axes, dim, rays, cosines, size, a, b, 0.5))
        best = min(best, _move_ray(axes, dim, rays, cosines, cell, b, a, 0.5))
        size += 1
    if size > 0 or best <= 0.0:
        return best, 0.0
    return best, max(math.sin(math.asin(best) - tolerance), 0.0)


def make_cells(count):
    """Allocate the scratch arrays (rays, cosines) of `frictionless_depth` for `count` contacts."""
    return np.zeros((STACK, 6, 6)), np.zeros((STACK, 6, count))
