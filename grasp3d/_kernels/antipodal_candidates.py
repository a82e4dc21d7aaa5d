"""Candidates for the best grasps through a vertex, and the best ones so far."""

import math
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.compiling import inlined
from grasp3d._kernels.normal_angles import largest_angle, smallest_angle
from grasp3d._kernels.surface_contacts import write_normals

TIE = 1e-7
"""A candidate must be better by this angle, so that rounding does not choose among equals."""

FOUND, NO_PARTNER, OPENING = 0, 1, 2
"""Why a vertex has a grasp or none."""


class Grasps(NamedTuple):
    """The best grasps so far, a row per vertex; written in place."""

    worst: npt.NDArray[np.float64]
    """Critical angle over the worst normals [rad]."""
    best: npt.NDArray[np.float64]
    """Critical angle over the best normals, of a grasp of its own [rad]."""
    closing: npt.NDArray[np.float64]
    """Closing direction of the grasp of `worst` (V, 3)."""
    closing_best: npt.NDArray[np.float64]
    """Closing direction of the grasp of `best` (V, 3)."""
    partner: npt.NDArray[np.float64]
    """Second contact of the grasp of `worst` (V, 3)."""
    partner_normal: npt.NDArray[np.float64]
    """Normal there (V, 3)."""
    faces: npt.NDArray[np.int64]
    """Face of the second contact, of the grasp of `worst` and of that of `best` (V, 2); -1 none."""
    weights: npt.NDArray[np.float64]
    """Their barycentric coordinates (V, 2, 3)."""
    signs: npt.NDArray[np.int8]
    """+1 squeeze, -1 expand, of the grasp of `worst`."""
    signs_best: npt.NDArray[np.int8]
    """The same for the grasp of `best`."""
    reason: npt.NDArray[np.uint8]
    """FOUND, NO_PARTNER or OPENING."""
    starts: npt.NDArray[np.float64]
    """Closing directions of the best grasps that lie apart, ordered (V, k, 3)."""
    start_angles: npt.NDArray[np.float64]
    """Their critical angles over the worst normals [rad] (V, k)."""
    start_signs: npt.NDArray[np.int8]
    """+1 squeeze, -1 expand (V, k)."""
    apart: float
    """Cosine of the angle from which two closing directions lie apart."""


@inlined
def _remember(v, sign, x, y, z, angle, grasps):
    """Keep a vertex's best closing directions that lie apart from each other, in order."""
    directions, angles, signs = grasps.starts[v], grasps.start_angles[v], grasps.start_signs[v]
    row = angles.shape[0] - 1
    for k in range(angles.shape[0]):  # a start close by gives way to a better one, or stays
        cosine = x * directions[k, 0] + y * directions[k, 1] + z * directions[k, 2]
        if angles[k] < math.inf and signs[k] == sign and cosine > grasps.apart:
            row = k
            break
    if angle >= angles[row] - TIE:
        return
    while row > 0 and angle < angles[row - 1] - TIE:
        angles[row], signs[row] = angles[row - 1], signs[row - 1]
        directions[row] = directions[row - 1]
        row -= 1
    angles[row], signs[row] = angle, sign
    directions[row, 0], directions[row, 1], directions[row, 2] = x, y, z


@inlined
def consider(v, sign, partner, opening, face, weights, surface, sets, grasps, found):
    """Weigh the grasp of a vertex and a place on a face; keep it where it is the best so far."""
    start, counts, normals = sets.start, sets.counts, sets.normals
    scale = sign / opening
    x = scale * (partner[0] - surface.points[v, 0])
    y = scale * (partner[1] - surface.points[v, 1])
    z = scale * (partner[2] - surface.points[v, 2])
    low = smallest_angle(normals, start[v], counts[v], x, y, z)
    if low > grasps.start_angles[v, -1]:
        return  # as good as it could be, it is worse than all that are kept
    high = low
    if counts[v] != 1:
        high = largest_angle(normals, start[v], counts[v], x, y, z)
    count, vertex = write_normals(face, weights, surface, sets, found)
    if vertex >= 0:
        first, count = start[vertex], counts[vertex]
        low = max(low, smallest_angle(normals, first, count, -x, -y, -z))
        high = max(high, largest_angle(normals, first, count, -x, -y, -z))
        found[0] = normals[first]
    else:
        low = max(low, smallest_angle(found, 0, count, -x, -y, -z))
        high = max(high, largest_angle(found, 0, count, -x, -y, -z))
    if high < grasps.start_angles[v, -1]:
        _remember(v, sign, x, y, z, high, grasps)
    if high < grasps.worst[v] - TIE:
        grasps.worst[v] = high
        grasps.reason[v] = FOUND
        grasps.signs[v] = sign
        grasps.closing[v, 0], grasps.closing[v, 1], grasps.closing[v, 2] = x, y, z
        for k in range(3):
            grasps.partner[v, k] = partner[k]
            grasps.partner_normal[v, k] = found[0, k]
            grasps.weights[v, 0, k] = weights[k]
        grasps.faces[v, 0] = face
    if low < grasps.best[v] - TIE:
        grasps.best[v] = low
        grasps.signs_best[v] = sign
        grasps.closing_best[v, 0], grasps.closing_best[v, 1] = x, y
        grasps.closing_best[v, 2] = z
        for k in range(3):
            grasps.weights[v, 1, k] = weights[k]
        grasps.faces[v, 1] = face
