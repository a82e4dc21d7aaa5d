"""Closed polygons: read and checked, counter-clockwise."""

import math

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Floats
from grasp3d.errors import SettingError

TINY = 1e-12
"""Share of an outline's size below which lengths are none."""

FEWEST = 3
"""Corners of a polygon."""

SMALLEST, LARGEST = 1e-100, 1e100
"""Lengths beyond these would be lost when they are squared."""


def length(name: str, value: float) -> float:
    """A finite length above 0.

    Raises:
        SettingError: It is not.
    """
    if not SMALLEST <= value <= LARGEST:
        raise SettingError(
            f"the {name} must be above 0, from {SMALLEST:g} to {LARGEST:g}; got {value:g}"
        )
    return float(value)


def simple_polygon(corners: npt.ArrayLike) -> Floats:
    """Corners of a polygon that goes round one region once, counter-clockwise.

    Corners that repeat one another in a row count once, and the first may stand at the end again.
    It stays the first where the order is reversed.

    Args:
        corners: Shape (k, 2), in either order.

    Returns:
        Shape (at most k, 2).

    Raises:
        SettingError: They are no such polygon.
    """
    points = _finite_points(corners)
    size = float(np.abs(points - points.mean(axis=0)).max())
    if size < SMALLEST:
        raise SettingError("the corners of the outline must not all be one point")
    near = (points - points.mean(axis=0)) / size
    steps = np.hypot(*(near - np.roll(near, -1, axis=0)).T)
    keep = steps > TINY * len(near)
    near, points = near[keep], points[keep]
    if len(points) < FEWEST:
        raise SettingError(
            f"an outline needs at least {FEWEST} different corners; got {len(points)}"
        )
    _check_apart(near)
    area = float(_cross(near, np.roll(near, -1, axis=0)).sum())  # twice, above 0 if in order
    return points if area > 0.0 else np.roll(points[::-1], 1, axis=0)


def area_centroid(corners: Floats) -> Floats:
    """Centroid of the area inside a polygon, shape (2,)."""
    middle = corners.mean(axis=0)
    here = corners - middle
    there = np.roll(here, -1, axis=0)
    parts = _cross(here, there)
    return np.asarray(middle + parts @ (here + there) / (3.0 * parts.sum()))


def _finite_points(corners: npt.ArrayLike) -> Floats:
    try:
        points = np.asarray(corners, dtype=np.float64)
    except (TypeError, ValueError) as error:
        raise SettingError(f"corners must be an array of numbers: {error}") from error
    if points.ndim != 2 or points.shape[1] != 2:
        raise SettingError(f"corners must have shape (k, 2); got {points.shape}")
    if len(points) < FEWEST:
        raise SettingError(f"an outline needs at least {FEWEST} corners; got {len(points)}")
    if not (np.abs(points) <= LARGEST).all():
        where = int(np.flatnonzero(~(np.abs(points) <= LARGEST).all(axis=1))[0])
        raise SettingError(
            f"corners must be finite and at most {LARGEST:g}; corner {where} is "
            f"({points[where, 0]:g}, {points[where, 1]:g})"
        )
    return points


def _check_apart(corners: Floats) -> None:
    """Refuse edges that cross, and corners on edges that are not theirs."""
    count = len(corners)
    ends = np.roll(corners, -1, axis=0)
    for i, (start, end) in enumerate(zip(corners, ends, strict=True)):
        along = end - start
        side = _cross(along, corners - start)  # of every corner
        share = np.clip((corners - start) @ along / (along @ along), 0.0, 1.0)
        distance = np.hypot(*(corners - start - share[:, None] * along).T)
        distance[[i, (i + 1) % count]] = math.inf
        if distance.min() <= TINY:
            raise SettingError(
                f"the outline must not touch itself; corner {int(distance.argmin())} lies on the "
                f"edge that starts at corner {i}"
            )
        parted = side * np.roll(side, -1) < 0.0
        across = ends - corners
        parts = _cross(across, start - corners) * _cross(across, end - corners) < 0.0
        if (parted & parts).any():
            raise SettingError(
                f"the outline must not cross itself; the edges that start at corners {i} and "
                f"{int((parted & parts).argmax())} do"
            )


def _cross(first: Floats, second: Floats) -> Floats:
    return np.asarray(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])
