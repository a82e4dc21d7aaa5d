"""Noise of a scan: the error of contact normals that it causes."""

import math

import numpy as np

from grasp3d.arrays import Floats, Ints, unit_rows
from grasp3d.mesh.measures import Triangles
from grasp3d.mesh.normals import CornerNormals, corner_normals

CREASES = np.radians([(30.0, 1.5), (60.0, 5.0), (180.0, math.inf)])
"""Crease angles to try, each with the largest noise that makes no edges bend by so much [rad]."""

SCALE = 1.15
"""Ratio of the normals' median error to their median deviation from their neighbours' mean: errors
of neighbours, which share vertices, cancel in part. Measured 1.0 to 1.25 on spheres, cylinders and
tori of even and uneven triangles."""

FLAT = 1e-3
"""Determinant of the second moments of a vertex's neighbours, relative to their mean distance,
below which they are collinear."""


def normal_noise(surface: Triangles) -> float:
    """Estimate the error of the vertices' normals due to noise.

    Each normal is compared with the linear extrapolation of its neighbours' normals to its own
    position, which is equal to it on a surface of constant curvature. Creases are left out, unless
    the noise is so strong that it makes creases itself. Errors that are correlated over many faces
    count as shape, and so does noise that a scanner has smoothed away; corners of a coarse mesh of
    a round shape count as noise.

    Args:
        surface: Faces that all have an area.

    Returns:
        Median error over the area [rad], 0 where no normal has neighbours on all sides.
    """
    noise = 0.0
    for crease, largest in CREASES:
        noise = SCALE * _median_deviation(surface, corner_normals(surface, crease))
        if noise <= largest:
            break
    return noise


def _median_deviation(surface: Triangles, normals: CornerNormals) -> float:
    """Median angle between normals and their neighbours' extrapolation, if that had no error."""
    count, own = len(normals.normals), normals.normals
    ends = normals.corners, np.roll(normals.corners, -1, axis=1)
    pairs = np.concatenate([ends[0] * count + ends[1], ends[1] * count + ends[0]])
    one, two = np.divmod(np.unique(pairs), count)  # each side of a face in both directions
    points = surface.vertices[normals.vertices]
    weights = _weights(points[two] - points[one], own, one)
    expected = np.stack([np.bincount(one, weights * own[two, k], count) for k in range(3)], axis=1)
    spread = np.bincount(one, weights**2, count)
    usable = spread > 0.0
    if not usable.any():
        return 0.0
    sine = np.linalg.norm(np.cross(own, expected), axis=1)
    angles = np.arctan2(sine, (own * expected).sum(axis=1)) / np.sqrt(1.0 + spread)
    areas = np.bincount(normals.corners.ravel(), np.repeat(surface.areas, 3), count)
    weights = (areas / (1.0 + spread))[usable]
    return float(np.quantile(angles[usable], 0.5, weights=weights, method="inverted_cdf"))


def _weights(offsets: Floats, own: Floats, one: Ints) -> Floats:
    """Least-squares weights of neighbours whose mean is exact for linear functions, shape (m,).

    Args:
        offsets: From the position of a normal to that of its neighbour, for each pair (m, 3).
        own: The normals (C, 3).
        one: Number of the normal in each pair (m,).

    Returns:
        The weights, whose sum is 1 for each normal; 0 where the neighbours are collinear.
    """
    count = len(own)
    squares = np.bincount(one, (offsets**2).sum(axis=1), count)
    reach = np.sqrt(squares / np.bincount(one, minlength=count))
    across = unit_rows(np.cross(own, np.eye(3)[np.abs(own).argmin(axis=1)]))
    axes = np.stack([across, np.cross(own, across)], axis=1)  # (C, 2, 3)
    flat = np.einsum("mak,mk->ma", axes[one], offsets / reach[one, None])
    basis = np.column_stack([np.ones(len(one)), flat])  # (m, 3)
    moments = np.zeros((count, 3, 3))
    np.add.at(moments, one, basis[:, :, None] * basis[:, None])
    spread_out = np.linalg.det(moments) > FLAT
    factors = np.zeros((count, 3))
    factors[spread_out] = np.linalg.inv(moments[spread_out])[:, 0]
    return np.asarray((basis * factors[one]).sum(axis=1))
