"""Rays from the vertices of a surface.

Positions are in the mesh's normalised frame (centred, size 1); angles in radians; normals point
into the object. A *closing direction* is the one in which finger 1 pushes: toward finger 2 when
squeezing (sign +1), away from it when expanding (sign -1).
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling.decorators import kernel, part
from grasp3d._kernels.surface.normal_angles import smallest_angle

STEP = 3e-7
"""Distance behind a crossing at which the ray continues: a few 32-bit rounding errors."""


class Rays(NamedTuple):
    """Rays from vertices; those that continue are moved to the front."""

    owner: npt.NDArray[np.int32]
    """Vertex from which each ray starts (r,)."""
    closing: npt.NDArray[np.float64]
    """Closing direction (r, 3)."""
    signs: npt.NDArray[np.int8]
    """+1: the ray runs along the closing direction, -1: against it (r,)."""
    along: npt.NDArray[np.float64]
    """Distance of the ray's current origin from the vertex (r,)."""
    step: npt.NDArray[np.float64]
    """Distance by which the origin advances when the ray hits the same face again (r,)."""
    last: npt.NDArray[np.int32]
    """Face crossed last, -1 none (r,)."""


@kernel
def starting_rays(owner, closing, signs, size):
    """The first `size` rays, starting at their vertices."""
    return Rays(
        owner[:size],
        closing[:size],
        signs[:size],
        np.full(size, STEP),
        np.full(size, STEP),
        np.full(size, -1, dtype=np.int32),
    )


@part
def append_ray(size, v, sign, direction, bound, sets, owner, closing, signs):
    """Write a ray where its angle to the vertex's normals is within a bound.

    Returns:
        The new number of rays.
    """
    x, y, z = direction
    if smallest_angle(sets.normals, sets.start[v], sets.counts[v], x, y, z) > bound:
        return size
    owner[size], signs[size] = v, sign
    closing[size, 0], closing[size, 1], closing[size, 2] = x, y, z
    return size + 1


@kernel
def write_rays(count, rays, points, origins, directions):
    """Write the first `count` rays as 32-bit origins and directions."""
    for i in range(count):
        # Origins are computed from the vertex each time, so rounding errors do not accumulate.
        v, sign, along = rays.owner[i], rays.signs[i], rays.along[i]
        for k in range(3):
            d = sign * rays.closing[i, k]
            origins[i, k] = points[v, k] + along * d
            directions[i, k] = d
