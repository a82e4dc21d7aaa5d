"""From where an object is seen in a small picture: where most of it, and of its labels, shows."""

import itertools
import math

import numpy as np

from grasp3d.arrays import Bytes, Floats, Ints
from grasp3d.rendering import View
from grasp3d.settings import DEGREE

ASIDE = tuple(degrees * DEGREE for degrees in (60.0, 75.0, 105.0, 120.0))
"""Directions of the eye from the object's long horizontal axis: nearly from the side."""

ELEVATIONS = ((20.0 * DEGREE, 0.9), (35.0 * DEGREE, 1.0), (55.0 * DEGREE, 0.85))
"""Angles of the eye above the horizon, and how much each is liked."""

ALIKE = 1e-6
"""Views whose scores differ by less count as equal; the first is taken."""

ENOUGH = 3000
"""Faces that are looked at to choose a view."""

THINNEST = 1.0 / 40.0
"""Least thickness at which an object is drawn, as a share of its length."""


def thickened(points: Floats) -> Floats:
    """Make what is thinner than 1/40 of its length so thick, so that needles can be seen.

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


def telling_view(points: Floats, faces: Ints, labels: Bytes, aspect: float) -> View:
    """Choose a three-quarter view in which the object is large and its labels show.

    Args:
        points: Positions, shape (V, 3).
        faces: Corners, counter-clockwise from outside, shape (F, 3).
        labels: Codes of the faces, shape (F,).
        aspect: Width of the picture over its height.
    """
    some = slice(None, None, max(1, len(faces) // ENOUGH))
    corners = points[faces[some]]  # (f, 3, 3)
    pointing = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    kinds = np.eye(3)[labels[some]]  # (f, 3)
    places = np.ascontiguousarray(corners.reshape(-1, 3).T)  # (3, k)
    long = _long_axis(places)
    views = [
        (View(long + aside + turn, elevation), liked)
        for aside, turn, (elevation, liked) in itertools.product(ASIDE, (0.0, math.pi), ELEVATIONS)
    ]
    axes = np.stack([view.axes for view, _ in views])  # (n, 3, 3)
    across = axes[:, :2].reshape(-1, 3) @ places
    extents = (across.max(axis=1) - across.min(axis=1)).reshape(-1, 2)
    seen = np.maximum(axes[:, 2] @ pointing.T, 0.0) @ kinds  # (n, 3)
    scores = _shown(seen, extents, aspect) * np.array([liked for _, liked in views])
    return views[int(np.argmax(scores > scores.max() * (1.0 - ALIKE)))][0]


def _long_axis(places: Floats) -> float:
    """Direction of the largest horizontal spread about the z-axis [rad]; places (3, k)."""
    x, y = (places - places.mean(axis=1, keepdims=True))[:2]
    return 0.5 * math.atan2(2.0 * float(x @ y), float(x @ x - y @ y))


def _shown(seen: Floats, extents: Floats, aspect: float) -> Floats:
    """How much of the picture is surface, times how evenly its labels show, shape (n,).

    Args:
        seen: Area of each label in each view, shape (n, 3).
        extents: Width and height of each view, shape (n, 2).
        aspect: Width of the picture over its height.
    """
    whole = np.maximum(seen.sum(axis=1), np.finfo(np.float64).tiny)
    filled = whole / np.maximum(extents[:, 0], extents[:, 1] * aspect) ** 2
    return np.asarray(filled * np.sqrt(seen / whole[:, None]).sum(axis=1))
