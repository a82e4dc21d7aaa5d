"""The best distinct grasps of a labelled surface."""

import itertools
import math
from functools import reduce

import numpy as np

from grasp3d.arrays import Floats, Ints, locked
from grasp3d.errors import SettingError
from grasp3d.grasps.closed_grasps import UNKNOWN, ClosedGrasps, close_on_grasps
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

    With a gripper of two fingers the jaws then close on a free object at the poses of all that
    remain, as in `evaluate_poses`: first come those with the better label at what the jaws touch,
    `closed`, then those with the better label of the vertex. An internal grasp, which is not
    closed, counts as M at most. Among grasps of the same labels their kinds take turns, see
    `grasp_kinds`: first comes the best one of each kind, then the second one of each, and so on.

    With a load whose mass and force are known, grasps that hold it come before all others: those
    with the better `holding.label`.

    Args:
        labels: The labelled surface.
        count: Largest number of grasps; there may be fewer.
        distance: In the mesh's unit; None: 1/8 of the object's size. 0: only identical grasps are
            omitted.

    Returns:
        At most `count` grasps, each with its first contact at a vertex; with a gripper also how it
        reaches them, `reach`, and what its jaws touch there, `closed`.

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
        return grasps_of_vertices(labels, vertices[distinct_rows(points, count, limit)])
    candidates = vertices[distinct_rows(points, len(points), limit)]
    closed = _closed(labels, candidates)
    order = _by_kinds(labels, candidates, closed)[:count]
    return grasps_of_vertices(
        labels, candidates[order], None if closed is None else closed.take(order)
    )


def grasps_of_vertices(
    labels: SurfaceLabels, vertices: Ints, closed: ClosedGrasps | None = None
) -> SurfaceGrasps:
    """The grasps of chosen vertices, which have one, shape (b,).

    Args:
        labels: The labelled surface.
        vertices: Numbers of the vertices.
        closed: What the jaws touch when they close there; None: not computed yet.
    """
    found = grasps_at(labels.mesh, labels.partner_points, vertices, 0)
    angles = critical_angles(found, threads=labels.threads)
    on_surface = locked(np.zeros((found.size, found.count)))
    grasps = SurfaceGrasps(
        found,
        labels.model,
        on_surface,
        *angles,
        scene=labels.scene,
        reach=None if labels.reach is None else labels.reach.take(vertices),
        load=labels.load,
        threads=labels.threads,
    )
    return grasps if closed is None else grasps.with_closed(closed)


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


def _closed(labels: SurfaceLabels, vertices: Ints) -> ClosedGrasps | None:
    """What the jaws touch at the grasps of vertices; None: more than two fingers have no poses."""
    reach, scene = labels.reach, labels.scene
    if reach is None or scene is None or labels.model.fingers > 2:
        return None
    return close_on_grasps(
        labels.mesh,
        reach.take(vertices),
        scene,
        labels.model,
        load=labels.load,
        threads=labels.threads,
    )


def _by_kinds(labels: SurfaceLabels, vertices: Ints, closed: ClosedGrasps | None) -> Ints:
    """Order of grasps, given best first, with the kinds taking turns among those alike in labels.

    The label with force comes first, then that after closing, then that of the vertex.
    """
    kinds = _large_kinds(labels, vertices)
    codes = labels.label[vertices].astype(np.int64)
    codes += len(Label) * (_after_closing(codes, closed) + len(Label) * _held(labels)[vertices])
    turn = np.zeros(len(vertices), dtype=np.int64)
    for row in range(len(vertices)):
        turn[row] = np.sum((kinds[:row] == kinds[row]) & (codes[:row] == codes[row]))
    return np.lexsort((np.arange(len(vertices)), turn, -codes))


def _after_closing(codes: Ints, closed: ClosedGrasps | None) -> Ints:
    """Labels after closing of grasps with label codes (b,): those not known are M at most."""
    if closed is None:
        return np.zeros_like(codes)
    return np.where(closed.label == UNKNOWN, np.minimum(codes, Label.M), closed.label)


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
    gaps = points[:, :, None] - other  # (b, n, n, 3)
    squares = np.add.reduce(gaps * gaps, axis=3)  # (b, n, n)
    indices = tuple(range(len(other)))
    orders = itertools.permutations(indices) if len(other) <= MAX_PERMUTED else [indices]
    farthest = (reduce(np.maximum, (squares[:, i, order[i]] for i in indices)) for order in orders)
    return np.asarray(np.sqrt(reduce(np.minimum, farthest)))
