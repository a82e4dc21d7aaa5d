"""The best distinct grasps of a labelled surface."""

import itertools
import math

import numpy as np

from grasp3d.arrays import Floats, Ints, locked
from grasp3d.errors import SettingError
from grasp3d.grasps.kinds import grasp_kinds
from grasp3d.grasps.surface_grasps import SurfaceGrasps
from grasp3d.mesh import ObjectMesh
from grasp3d.stability.label import Label
from grasp3d.surface.critical_angles import critical_angles
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_grasps import grasps_at

DISTINCT = 1.0 / 8.0
"""Distance of corresponding contacts, in object sizes, from which grasps are distinct."""

ANGLE_STEP = math.radians(1.0)
"""Critical angles are compared in steps of this size [rad]; within one, the approach margin decides
if there is a gripper, and then epsilon."""

MARGIN_STEP = math.radians(15.0)
"""Approach margins are compared in steps of this size [rad]."""

SMALL_KIND = 0.002
"""Area fraction up to which the grasps of one kind count as one of many others."""

MAX_PERMUTED = 5
"""Most contacts of grasps whose contacts are matched in every order."""


def best_grasps(
    labels: SurfaceLabels, count: int, *, distance: float | None = None
) -> SurfaceGrasps:
    """The best distinct grasps of a labelled surface, best first.

    The grasps are those of the vertices. Better is the smaller critical friction angle in whole
    degrees, then, with a gripper, the larger approach margin in steps of 15 degrees, and then the
    larger epsilon. A grasp is omitted if its contacts can be matched with those of a better one so
    that all pairs are nearer than `distance` (non-maximum suppression).

    With a gripper the kinds of grasps take turns, see `grasp_kinds`: first comes the best one of
    each kind that has the best label, then the second one of each, and so on.

    With a load whose mass and force are known, grasps that hold it come first: those with the
    better `holding.label`.

    Args:
        labels: The labelled surface.
        count: Largest number of grasps; there may be fewer.
        distance: In the mesh's unit; None: 1/8 of the object's size. 0: only identical grasps are
            omitted.

    Returns:
        At most `count` grasps, each with its first contact at a vertex; with a gripper also how it
        reaches them, `reach`.

    Raises:
        SettingError: A count below 1, or a distance that is not a finite length.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> box = trimesh.creation.box([0.08, 0.05, 0.03])
        >>> labels = grasp3d.label_surface(grasp3d.load_mesh(box, unit="m", max_edge=0.02))
        >>> grasps = grasp3d.best_grasps(labels, 3)
        >>> grasps.contacts.points.shape, grasps.opening.round(3).tolist()
        ((3, 2, 3), [0.08, 0.08, 0.08])
    """
    if count < 1:
        raise SettingError(f"the number of best grasps must be at least 1; got {count}")
    limit = distance_of_distinct(labels.mesh) if distance is None else distance
    if not (limit >= 0.0 and math.isfinite(limit)):
        raise SettingError(f"distance must be a finite length of at least 0; got {limit:g}")
    vertices = ranked_vertices(labels)
    points = grasps_at(labels.mesh, labels.partner_points, vertices, 0).points
    if labels.reach is None:
        kept = distinct_rows(points, count, limit)
    else:
        kept = _by_kinds(labels, vertices, points, count, limit)
    return grasps_of_vertices(labels, vertices[kept])


def grasps_of_vertices(labels: SurfaceLabels, vertices: Ints) -> SurfaceGrasps:
    """The grasps of chosen vertices, which have one, shape (b,)."""
    found = grasps_at(labels.mesh, labels.partner_points, vertices, 0)
    angles = critical_angles(found, threads=labels.threads)
    on_surface = locked(np.zeros((found.size, found.count)))
    return SurfaceGrasps(
        found,
        labels.model,
        on_surface,
        *angles,
        reaching=labels.reaching,
        reach=None if labels.reach is None else labels.reach.take(vertices),
        load=labels.load,
        threads=labels.threads,
    )


def distance_of_distinct(mesh: ObjectMesh) -> float:
    """Default distance from which grasps are distinct, in the mesh's unit."""
    return DISTINCT * mesh.size


def ranked_vertices(labels: SurfaceLabels) -> Ints:
    """Vertices with a grasp, one for each position, best grasp first; computes epsilon.

    With a load whose mass and force are known also the grip forces.
    """
    vertices = labels.grasps.vertices
    angles, _ = labels.located_angles
    vertices = vertices[np.isfinite(angles[vertices])]
    quality = -np.nan_to_num(labels.epsilon[vertices])
    step = np.floor(angles[vertices] / ANGLE_STEP)
    margin = np.zeros(len(vertices))
    if labels.reach is not None:
        margin = np.floor(np.nan_to_num(labels.reach.approach_margin[vertices]) / MARGIN_STEP)
    order = np.lexsort((vertices, quality, -margin, step, -_held(labels)[vertices]))
    return np.asarray(vertices[order])


def _by_kinds(
    labels: SurfaceLabels, vertices: Ints, points: Floats, count: int, limit: float
) -> Ints:
    """Rows of distinct grasps (b, n, 3), the kinds taking turns within each label."""
    kinds = _large_kinds(labels, vertices)
    codes = len(Label) * _held(labels)[vertices] + labels.label[vertices]
    kept = distinct_rows(points, len(points), limit)
    turn = np.zeros(len(kept), dtype=np.int64)
    for position, row in enumerate(kept):
        before = kept[:position]
        turn[position] = np.sum((kinds[before] == kinds[row]) & (codes[before] == codes[row]))
    order = np.lexsort((np.arange(len(kept)), turn, -codes[kept]))
    return kept[order[:count]]


def _held(labels: SurfaceLabels) -> Ints:
    """Codes of the labels with force (V,); 0 where the load is not known."""
    codes = None if labels.holding is None else labels.holding.label
    return np.zeros(len(labels.reason), np.int64) if codes is None else codes.astype(np.int64)


def _large_kinds(labels: SurfaceLabels, vertices: Ints) -> Ints:
    """Kinds of vertices' grasps, shape (b,); those of very little area count as one."""
    every = grasp_kinds(labels)
    with_kind = every >= 0
    areas = np.bincount(every[with_kind], labels.mesh.vertex_areas[with_kind])
    kinds = every[vertices]
    return np.where(areas[kinds] > SMALL_KIND * labels.mesh.vertex_areas.sum(), kinds, -1)


def distinct_rows(points: Floats, count: int, limit: float) -> Ints:
    """Indices of grasps (b, n, 3), best first, that are not near a better one."""
    kept: list[int] = []
    remaining = np.arange(len(points))
    while len(remaining) and len(kept) < count:
        kept.append(int(remaining[0]))
        remaining = remaining[1:]
        distance = matched_distance(points[remaining], points[kept[-1]])
        remaining = remaining[(distance >= limit) & (distance > 0.0)]
    return np.array(kept, dtype=np.int64)


def matched_distance(points: Floats, other: Floats) -> Floats:
    """Distances of grasps from another one: the farthest pair of contacts in the best matching.

    Args:
        points: Contacts, shape (b, n, 3).
        other: Shape (n, 3); more than five contacts are matched in their order.

    Returns:
        Shape (b,).
    """
    gaps = np.linalg.norm(points[:, :, None] - other, axis=3)  # (b, n, n)
    indices = np.arange(len(other))
    orders = itertools.permutations(indices) if len(other) <= MAX_PERMUTED else [tuple(indices)]
    smallest = np.full(len(points), math.inf)
    for order in orders:
        np.minimum(smallest, gaps[:, indices, order].max(axis=1), out=smallest)
    return smallest
