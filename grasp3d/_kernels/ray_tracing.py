"""Rays from the vertices of a surface.

Positions are in the mesh's normalised frame (centred, size 1); angles in radians; normals point
into the object. A *closing direction* is the one in which finger 1 pushes: toward finger 2 when
squeezing (sign +1), away from it when expanding (sign -1).
"""

from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling import kernel

STEP = 3e-7
"""How far behind a crossing the next ray starts; a few roundings of a 32-bit coordinate."""


class Rays(NamedTuple):
    """Rays from vertices, compacted in place as they end."""

    owner: npt.NDArray[np.int32]
    """Vertex that each starts from (r,)."""
    closing: npt.NDArray[np.float64]
    """Closing direction (r, 3)."""
    signs: npt.NDArray[np.int8]
    """+1: the ray runs along the closing direction, -1: against it (r,)."""
    along: npt.NDArray[np.float64]
    """Distance from the vertex at which the ray goes on (r,)."""
    step: npt.NDArray[np.float64]
    """How much farther it starts when it meets the same face again (r,)."""
    last: npt.NDArray[np.int32]
    """Face crossed last, -1 none (r,)."""


@kernel
def starting_rays(owner, closing, signs, size):
    """Rays that start at their vertices."""
    return Rays(
        owner[:size],
        closing[:size],
        signs[:size],
        np.full(size, STEP),
        np.full(size, STEP),
        np.full(size, -1, dtype=np.int32),
    )


@kernel
def aim(count, rays, points, origins, directions):
    """Write the first `count` rays as 32-bit origins and directions."""
    for i in range(count):
        v, sign, along = rays.owner[i], rays.signs[i], rays.along[i]
        for k in range(3):
            d = sign * rays.closing[i, k]
            origins[i, k] = points[v, k] + along * d
            directions[i, k] = d
