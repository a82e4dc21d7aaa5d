"""Measures of the contacts' positions: centroid, finger polygon, orthogonality."""

import math
from typing import NamedTuple

import numpy as np

from grasp3d.arrays import Bools, Floats, angles_between
from grasp3d.quality.measures.geometry import GraspGeometry
from grasp3d.quality.measures.metric import AT_ONE_POINT, Measured

FLAT = 1e-9
"""Width relative to the length from which contacts are not on one line."""

NEAR = 1e-9
"""Distance relative to the grasp's size from which two contacts do not coincide."""

ROUND = 1e-6
"""Difference of two extents of the contacts, relative to the larger, from which they differ."""

NO_PLANE = "the contacts are nearest to no single plane"
NO_AXIS = "no longest principal axis of the object is given"


class _Plane(NamedTuple):
    """The plane nearest to the contacts."""

    flat: Floats
    """Contacts in the plane, in order of their angle about the mean, shape (b, n, 2)."""
    line: Floats
    """Unit direction in which the contacts extend most, shape (b, 3)."""
    normal: Floats
    """Unit normal, shape (b, 3)."""
    collinear: Bools
    """Whether the contacts are on one line, shape (b,)."""
    ambiguous: Bools
    """Whether other planes are as near, as for a regular tetrahedron, shape (b,)."""


def centroid_distance(grasps: GraspGeometry) -> Measured:
    """Distance of the contacts' mean from the centre of mass."""
    return Measured.of(np.linalg.norm(grasps.contacts.points.mean(axis=1), axis=-1))


def polygon_area(grasps: GraspGeometry) -> Measured:
    """Area of the finger polygon in its plane."""
    plane = _plane(grasps)
    corners = plane.flat
    following = np.roll(corners, -1, axis=1)
    cross = corners[..., 0] * following[..., 1] - corners[..., 1] * following[..., 0]
    area = 0.5 * np.abs(cross.sum(axis=1)) * grasps.extent**2
    return Measured.of(area, (plane.ambiguous, NO_PLANE))


def polygon_shape(grasps: GraspGeometry) -> Measured:
    """Difference of the polygon's inner angles from the regular ones; 0: regular, 1: a line."""
    plane, count = _plane(grasps), grasps.count
    regular = math.pi * (count - 2) / count
    worst = (count - 2) * (math.pi - regular) + 2.0 * regular
    difference = np.abs(_inner_angles(plane.flat) - regular).sum(axis=1) / worst
    # A concave polygon may differ more than one that is a line.
    values = np.where(plane.collinear, 1.0, np.minimum(difference, 1.0))
    return Measured.of(
        values,
        (_any_coincide(plane.flat), "two contacts coincide in the plane of the polygon"),
        (plane.ambiguous, NO_PLANE),
    )


def orthogonality(grasps: GraspGeometry) -> Measured:
    """Angle between the grasp's axis and the object's, or its complement if that is smaller."""
    plane, axis = _plane(grasps), grasps.principal_axis
    on_line = plane.collinear | (grasps.count == 2)
    direction = np.where(on_line[:, None], plane.line, plane.normal)
    angle = angles_between(direction, axis)
    angle = np.minimum(angle, math.pi - angle)
    return Measured.of(
        np.minimum(angle, math.pi / 2.0 - angle),
        (np.asarray(np.isnan(axis).any(axis=1)), NO_AXIS),
        (grasps.at_one_point, AT_ONE_POINT),
        (plane.ambiguous & ~on_line, NO_PLANE),
    )


def _plane(grasps: GraspGeometry) -> _Plane:
    """The plane of least squares, with lengths relative to the grasp's size."""
    points = grasps.centred_points
    _, sizes, axes = np.linalg.svd(points)
    flat = points @ np.swapaxes(axes[:, :2], 1, 2)  # (b, n, 2)
    order = np.argsort(np.arctan2(flat[..., 1], flat[..., 0]), axis=1, kind="stable")
    flat = np.take_along_axis(flat, order[..., None], axis=1)
    second, third = sizes[:, 1], sizes[:, 2] if sizes.shape[1] > 2 else np.zeros(len(sizes))
    collinear = second <= FLAT * sizes[:, 0]
    ambiguous = ~collinear & (second - third <= ROUND * second)
    return _Plane(flat, axes[:, 0], axes[:, 2], collinear, ambiguous)


def _inner_angles(corners: Floats) -> Floats:
    """Inner angles of polygons (b, n, 2) in counter-clockwise order [rad], shape (b, n)."""
    ahead = np.roll(corners, -1, axis=1) - corners
    behind = np.roll(corners, 1, axis=1) - corners
    cross = ahead[..., 0] * behind[..., 1] - ahead[..., 1] * behind[..., 0]
    angles = np.arctan2(cross, (ahead * behind).sum(axis=-1))
    return np.asarray(np.where(angles < 0.0, angles + 2.0 * math.pi, angles))


def _any_coincide(points: Floats) -> Bools:
    """Whether any two of the points (b, n, 2) of each grasp coincide, shape (b,)."""
    first, second = np.triu_indices(points.shape[1], 1)
    gaps = np.linalg.norm(points[:, first] - points[:, second], axis=-1)
    return np.asarray((gaps <= NEAR).any(axis=1))
