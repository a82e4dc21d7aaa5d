"""The best distinct grasps of a labelled surface."""

from weakref import WeakKeyDictionary

import numpy as np

from grasp3d.arrays import Ints
from grasp3d.grasps.best_poses import PoseSearch
from grasp3d.grasps.jaw_grasps import JawGrasps
from grasp3d.grasps.ranking import (
    MOST_DISTINCT,
    distance_of_distinct,
    distinct_rows,
    most_distinct,
    ranked_rows,
)
from grasp3d.settings.checks import check_range
from grasp3d.stability.label import Label
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.labels import SurfaceLabels

LISTED = 10
"""Poses that are chosen at least, so that shorter lists are the beginnings of this one."""


def best_grasps(
    labels: SurfaceLabels, count: int, *, unstable: bool = False
) -> GraspTable | JawGrasps:
    """The best distinct grasps of a labelled surface that may hold, best first.

    Without a gripper they are those of the vertices. With a parallel gripper they are poses: those
    that `evaluate_grasps` finds best of a fixed pool, each refined; settings of the approach, the
    load and the sensor only choose among them. A grasp is omitted if its contacts can be matched
    with those of a better one so that all pairs are nearer than 1/8 of the object's size.

    Args:
        labels: The labelled surface.
        count: Largest number of grasps; there may be fewer.
        unstable: Whether grasps that are U follow those that may hold.

    Returns:
        At most `count` grasps, none of which is U unless that is asked for. With a gripper what
        `evaluate_grasps` returns of their poses; else each with its first contact at a vertex.

    Raises:
        SettingError: A count below 1.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> box = trimesh.creation.box([0.08, 0.05, 0.03])
        >>> labels = grasp3d.label_surface(grasp3d.load_mesh(box, unit="m", max_edge=0.02))
        >>> grasps = grasp3d.best_grasps(labels, 3)
        >>> grasps.contacts.points.shape, grasps.opening.round(3).tolist()
        ((3, 2, 3), [0.08, 0.08, 0.08])
    """
    check_range("the number of best grasps", count, 1)
    if has_poses(labels):
        known, key = _NAMED.setdefault(labels, {}), (unstable, max(count, LISTED))
        if key not in known:
            known[key] = PoseSearch.of(labels).best(pool_of(labels), key[1], unstable=unstable)
        poses = known[key]
        return poses.take(np.arange(min(count, poses.size)))
    distinct = distinct_grasps(labels, unstable=unstable)
    return distinct.take(np.arange(min(count, distinct.size))).whole()


def has_poses(labels: SurfaceLabels) -> bool:
    """Whether the grasps of a surface are made by a gripper that has poses for them."""
    scene = labels.scene
    return scene is not None and scene.jaws is not None and labels.mode == "label"


_POOLS: WeakKeyDictionary[SurfaceLabels, JawGrasps] = WeakKeyDictionary()
_NAMED: WeakKeyDictionary[SurfaceLabels, dict[tuple[bool, int], JawGrasps]] = WeakKeyDictionary()
_DISTINCT: WeakKeyDictionary[SurfaceLabels, dict[bool, GraspTable]] = WeakKeyDictionary()


def pool_of(labels: SurfaceLabels) -> JawGrasps:
    """The evaluated poses among which the best of a surface are sought; found once.

    Args:
        labels: Labels with a gripper; see `has_poses`.
    """
    if labels not in _POOLS:
        _POOLS[labels] = PoseSearch.of(labels).pool()
    return _POOLS[labels]


def distinct_grasps(labels: SurfaceLabels, *, unstable: bool = False) -> GraspTable:
    """The distinct grasps of the vertices that may hold, best first, 1,000 at most; found once.

    Args:
        labels: The labelled surface.
        unstable: As in `best_grasps`.
    """
    known = _DISTINCT.setdefault(labels, {})
    if unstable not in known:
        rows = ranked_rows(labels)
        rows = rows[np.isin(rows, labels.distinct)]
        if not unstable:
            rows = rows[labels.letter[rows] > Label.U]
        points = labels.contacts.take(rows).points
        limit = distance_of_distinct(labels.mesh)
        known[unstable] = labels.take(rows[distinct_rows(points, MOST_DISTINCT, limit)])
    return known[unstable]


def first_vertices(grasps: GraspTable) -> Ints:
    """The vertices at which grasps of a labelled surface have their first contact, shape (b,)."""
    contacts, mesh = grasps.contacts.surface_points, grasps.mesh
    corners = contacts.weights[:, 0].argmax(axis=1)
    return np.asarray(mesh.canonical[mesh.faces[contacts.faces[:, 0], corners]])


def count_sure(labels: SurfaceLabels) -> int:
    """Number of distinct poses of the pool that are S, 1,000 at most.

    Args:
        labels: Labels with a gripper; see `has_poses`.
    """
    pool = pool_of(labels)
    rows = ranked_rows(pool)
    rows = rows[pool.letter[rows] == Label.S]
    limit, scores = distance_of_distinct(labels.mesh), pool.score[rows]
    return len(most_distinct(pool.jaws.points[rows], scores, limit, MOST_DISTINCT))
