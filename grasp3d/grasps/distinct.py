"""The best grasps of a labelled surface that are distinct from each other."""

import itertools
import math

import numpy as np

from grasp3d.arrays import Floats, Ints, locked
from grasp3d.errors import SettingError
from grasp3d.grasps.surface_grasps import SurfaceGrasps
from grasp3d.surface.critical_angles import critical_angles
from grasp3d.surface.labels import Reason, SurfaceLabels
from grasp3d.surface.vertex_grasps import grasps_at

APART = 1.0 / 8.0
"""Distance, in object sizes, between corresponding contacts of grasps that count as distinct."""

ALIKE = math.radians(1.0)
"""Steps of the critical angle within which the larger epsilon is the better grasp."""

MOST_MATCHED = 5
"""Contacts of grasps that are matched in every order."""


def best_grasps(
    labels: SurfaceLabels, count: int, *, distance: float | None = None
) -> SurfaceGrasps:
    """Take the best grasps of a labelled surface that are distinct, best first.

    The grasps are those of the vertices. A smaller critical friction angle, in whole degrees, is
    better, and among those of one degree the larger epsilon. A grasp is
    left out when its contacts can be matched with those of a better one so that all pairs are
    nearer than `distance` (non-maximum suppression).

    Args:
        labels: The labelled surface.
        count: How many grasps to take at most; there may be fewer.
        distance: In the mesh's unit; None: 1/8 of the object's size. 0: only the same grasp is
            left out.

    Returns:
        At most `count` grasps, each with its first finger at a vertex.

    Raises:
        SettingError: A count below 1, or a distance that is none.
    """
    if count < 1:
        raise SettingError(f"the number of best grasps must be at least 1; got {count}")
    apart = APART * labels.mesh.size if distance is None else distance
    if not (apart >= 0.0 and math.isfinite(apart)):
        raise SettingError(f"distance must be a finite length of at least 0; got {apart:g}")
    vertices = _ranked(labels)
    contacts = grasps_at(labels.mesh, labels.partner_points, vertices, 0)
    kept = _distinct(contacts.points, count, apart)
    found = contacts.take(kept)
    worst, best = critical_angles(found, threads=labels.threads)
    return SurfaceGrasps(
        found, labels.model, locked(np.zeros((len(kept), found.count))), worst, best, labels.threads
    )


def _ranked(labels: SurfaceLabels) -> Ints:
    """Vertices with a grasp, one for each place, the best first."""
    mesh = labels.mesh
    held = np.unique(mesh.canonical[labels.reason == Reason.FOUND])
    held = held[np.isfinite(labels.critical_angle[held])]
    step = np.floor(labels.critical_angle[held] / ALIKE)
    order = np.lexsort((held, -np.nan_to_num(labels.epsilon[held]), step))
    return np.asarray(held[order])


def _distinct(points: Floats, count: int, apart: float) -> Ints:
    """Numbers of grasps (b, n, 3), best first, that are not near a better one."""
    kept: list[int] = []
    open_ = np.arange(len(points))
    while len(open_) and len(kept) < count:
        kept.append(int(open_[0]))
        open_ = open_[1:]
        farthest = matched_distance(points[open_], points[kept[-1]])
        open_ = open_[(farthest >= apart) & (farthest > 0.0)]
    return np.array(kept, dtype=np.int64)


def matched_distance(points: Floats, other: Floats) -> Floats:
    """How far grasps are from another one: the farthest pair when contacts are matched best.

    Args:
        points: Contacts, shape (b, n, 3).
        other: Shape (n, 3); with more than five contacts they are matched as they are numbered.

    Returns:
        Shape (b,).
    """
    gaps = np.linalg.norm(points[:, :, None] - other, axis=3)  # (b, n, n)
    numbers = np.arange(len(other))
    orders = itertools.permutations(numbers) if len(other) <= MOST_MATCHED else [tuple(numbers)]
    found = np.full(len(points), math.inf)
    for order in orders:
        np.minimum(found, gaps[:, numbers, order].max(axis=1), out=found)
    return found
