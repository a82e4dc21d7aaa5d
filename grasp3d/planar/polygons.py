"""Checks of closed polygons, and their conversion to counter-clockwise order."""

import math

import numpy as np

from grasp3d.arrays import ArrayLike, Floats
from grasp3d.errors import SettingError

TINY = 1e-12
"""Fraction of an outline's size below which lengths count as 0."""

FEWEST = 3
"""Least number of corners of a polygon."""

SMALLEST, LARGEST = 1e-100, 1e100
"""Limits of lengths: squares of smaller and larger ones underflow and overflow."""


def length(name: str, value: float) -> float:
    """Check a length: finite and above 0.

    Raises:
        SettingError: It is outside the limits.
    """
    if not SMALLEST <= value <= LARGEST:
        raise SettingError(
            f"the {name} must be above 0, from {SMALLEST:g} to {LARGEST:g}; got {value:g}"
        )
    return float(value)


def simple_polygon(corners: ArrayLike) -> Floats:
    """Corners of a simple polygon, counter-clockwise.

    Consecutive equal corners count once, and the first corner may be repeated at the end. The first
    corner stays the first if the order is reversed.

    Args:
        corners: Shape (k, 2), in either order.

    Returns:
        Shape (at most k, 2).

    Raises:
        SettingError: They are not a simple polygon.
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


def _finite_points(corners: ArrayLike) -> Floats:
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
    """Refuse edges that cross, and corners that lie on other edges."""
    count = len(corners)
    ends = np.roll(corners, -1, axis=0)
    for i, (start, end) in enumerate(zip(corners, ends, strict=True)):
        along = end - start
        side = _cross(along, corners - start)  # of every corner
        fraction = np.clip((corners - start) @ along / (along @ along), 0.0, 1.0)
        distance = np.hypot(*(corners - start - fraction[:, None] * along).T)
        distance[[i, (i + 1) % count]] = math.inf
        if distance.min() <= TINY:
            raise SettingError(
                f"the outline must not touch itself; corner {int(distance.argmin())} lies on the "
                f"edge that starts at corner {i}"
            )
        straddles = side * np.roll(side, -1) < 0.0
        across = ends - corners
        parts = _cross(across, start - corners) * _cross(across, end - corners) < 0.0
        if (straddles & parts).any():
            raise SettingError(
                f"the outline must not cross itself; the edges that start at corners {i} and "
                f"{int((straddles & parts).argmax())} do"
            )


def _cross(first: Floats, second: Floats) -> Floats:
    return np.asarray(first[..., 0] * second[..., 1] - first[..., 1] * second[..., 0])
