"""The inner side of a jaw, and faces of a surface that it might touch."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling.decorators import kernel
from grasp3d._kernels.surface.clipping import CORNERS

ROUNDING = 1e-9
"""Distance, in object sizes, that counts as none: pads that only graze an edge do not touch it."""

EDGE_ON = 1e-9
"""Largest x of the unit normal of a face that counts as parallel to x, which is not touched."""


class Jaw(NamedTuple):
    """Shape of a jaw, in object sizes."""

    planes: npt.NDArray[np.float64]
    """Faces of its inner side: each is at x = a + b y + c z, a <= 0 behind the foremost (m, 3)."""
    edges: npt.NDArray[np.float64]
    """Sides of each face: edges[..., 0] y + edges[..., 1] z <= edges[..., 2] (m, e, 3)."""
    bounds: npt.NDArray[np.float64]
    """Smallest y and z, largest y and z of all of them (4,)."""
    radius: float
    """Radius of a round tip; 0: flat pad."""
    depth: float
    """Distance of the rearmost part of its inner side from the foremost."""
    thickness: float
    """Of the finger behind its inner side; -inf: what is behind that does not count."""
    compliance: float
    """Depth to which the surface may press into the jaw."""
    footprint: float
    """Depth to which the surface opposite the jaw makes the normal of a free object; 0: no more
    than what is touched."""


class Faces(NamedTuple):
    """Faces that a jaw might touch, in the first rows; see `closing.gather`."""

    numbers: npt.NDArray[np.int64]
    """Face of the mesh (F,)."""
    corners: npt.NDArray[np.float64]
    """Corners in the frame of the gripper (F, 3, 3)."""
    normals: npt.NDArray[np.float64]
    """Outward unit normals in that frame (F, 3)."""


class Scratch(NamedTuple):
    """Memory for one jaw."""

    polygon: npt.NDArray[np.float64]
    spare: npt.NDArray[np.float64]
    mean: npt.NDArray[np.float64]
    row: npt.NDArray[np.float64]


@kernel
def make_faces(size):
    """Allocate the memory for faces."""
    return Faces(np.empty(size, np.int64), np.empty((size, 3, 3)), np.empty((size, 3)))


@kernel
def make_scratch():
    """Allocate the memory for one jaw."""
    return Scratch(np.empty((CORNERS, 6)), np.empty((CORNERS, 6)), np.empty(6), np.empty(6))


@kernel
def without_back(jaw):
    """A jaw that passes through what is behind its inner side before it moves."""
    return Jaw(
        jaw.planes,
        jaw.edges,
        jaw.bounds,
        jaw.radius,
        jaw.depth,
        -math.inf,
        jaw.compliance,
        jaw.footprint,
    )


@kernel
def start_before(opening, width, jaw):
    """Position from which jaws that are closed to a width close again after a small motion.

    What they have passed is behind them.
    """
    gap = jaw.radius if jaw.radius > 0.0 else 0.5 * jaw.thickness
    return -min(0.5 * opening, 0.5 * width + gap)


@kernel
def nearest(corners, side):
    """Smallest x of a triangle; no jaw touches it at a smaller position."""
    return min(side * corners[0, 0], side * corners[1, 0], side * corners[2, 0])


@kernel
def nearest_to(corners, side, plane):
    """The same for a face of the jaw that is inclined."""
    low = math.inf
    for c in range(3):
        x = plane[0] + plane[1] * corners[c, 1] + plane[2] * corners[c, 2]
        low = min(low, side * corners[c, 0] - x)
    return low


@kernel
def edge_and_normal(corners, side):
    """First edge of a triangle, and its normal, not scaled."""
    ux, uy = side * (corners[1, 0] - corners[0, 0]), corners[1, 1] - corners[0, 1]
    uz = corners[1, 2] - corners[0, 2]
    vx, vy = side * (corners[2, 0] - corners[0, 0]), corners[2, 1] - corners[0, 1]
    vz = corners[2, 2] - corners[0, 2]
    return ux, uy, uz, uy * vz - uz * vy, uz * vx - ux * vz, ux * vy - uy * vx
