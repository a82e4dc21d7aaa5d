"""Views of thumbnails: directions that show most of an object and of its labels."""

import itertools
import math

import numpy as np

from grasp3d.arrays import Bytes, Floats, Ints
from grasp3d.rendering import View
from grasp3d.settings import DEGREE

AZIMUTH_OFFSETS = tuple(degrees * DEGREE for degrees in (60.0, 75.0, 105.0, 120.0))
"""Azimuths of the views from the object's long horizontal axis, nearly sideways [rad]."""

ELEVATIONS = ((20.0 * DEGREE, 0.9), (35.0 * DEGREE, 1.0), (55.0 * DEGREE, 0.85))
"""Elevations of the views [rad], and the weight of each."""

EQUAL_SCORES = 1e-6
"""Relative difference below which scores of views are equal; the first view is taken."""

MAX_FACES = 3000
"""Number of faces from which a view is chosen."""

THINNEST = 1.0 / 40.0
"""Least thickness at which an object is drawn, as a fraction of its length."""


def thickened(points: Floats) -> Floats:
    """Thicken an object to at least 1/40 of its length in each direction, to make needles visible.

    Args:
        points: Centred positions, shape (V, 3).
    """
    axes = np.linalg.eigh(points.T @ points)[1]
    along = axes.T @ points.T  # (3, V)
    extents = along.max(axis=1) - along.min(axis=1)
    least = THINNEST * extents.max()
    if extents.min() >= least:
        return points
    grown = np.where(extents < least, least / np.maximum(extents, 1e-3 * least), 1.0)
    return np.asarray((axes @ (grown[:, None] * along)).T)


def informative_view(points: Floats, faces: Ints, labels: Bytes, aspect: float) -> View:
    """Choose a three-quarter view in which the object is large and its labels are visible.

    Args:
        points: Positions, shape (V, 3).
        faces: Corners, counter-clockwise from outside, shape (F, 3).
        labels: Codes of the faces, shape (F,).
        aspect: Width of the picture over its height.
    """
    some = slice(None, None, max(1, len(faces) // MAX_FACES))
    corners = points[faces[some]]  # (f, 3, 3)
    normals = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    is_label = np.eye(3)[labels[some]]  # (f, 3)
    positions = np.ascontiguousarray(corners.reshape(-1, 3).T)  # (3, k)
    long = _long_axis(positions)
    views = [
        (View(long + offset + turn, elevation), weight)
        for offset, turn, (elevation, weight) in itertools.product(
            AZIMUTH_OFFSETS, (0.0, math.pi), ELEVATIONS
        )
    ]
    axes = np.stack([view.axes for view, _ in views])  # (n, 3, 3)
    across = axes[:, :2].reshape(-1, 3) @ positions
    extents = (across.max(axis=1) - across.min(axis=1)).reshape(-1, 2)
    visible = np.maximum(axes[:, 2] @ normals.T, 0.0) @ is_label  # (n, 3)
    scores = _scores(visible, extents, aspect) * np.array([weight for _, weight in views])
    return views[int(np.argmax(scores > scores.max() * (1.0 - EQUAL_SCORES)))][0]


def _long_axis(positions: Floats) -> float:
    """Direction of the largest horizontal spread about the z-axis [rad]; positions (3, k)."""
    x, y = (positions - positions.mean(axis=1, keepdims=True))[:2]
    return 0.5 * math.atan2(2.0 * float(x @ y), float(x @ x - y @ y))


def _scores(visible: Floats, extents: Floats, aspect: float) -> Floats:
    """Filled fraction of the picture times how evenly the labels are visible, shape (n,).

    Args:
        visible: Visible area of each label in each view, shape (n, 3).
        extents: Width and height of each view, shape (n, 2).
        aspect: Width of the picture over its height.
    """
    total = np.maximum(visible.sum(axis=1), np.finfo(np.float64).tiny)
    filled = total / np.maximum(extents[:, 0], extents[:, 1] * aspect) ** 2
    return np.asarray(filled * np.sqrt(visible / total[:, None]).sum(axis=1))
