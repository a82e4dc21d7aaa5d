"""The best distinct grasps of a labelled surface."""

import itertools
import math
from functools import reduce
from weakref import WeakKeyDictionary

import numpy as np

from grasp3d.arrays import Bools, Floats, Ints
from grasp3d.errors import SettingError
from grasp3d.grasps.ranking import ranked_rows, stated_label
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.measures import connected
from grasp3d.settings.checks import check_range
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.labels import SurfaceLabels

DISTINCT = 1.0 / 8.0
"""Distance of corresponding contacts, in object sizes, from which grasps are distinct."""

CANDIDATES = 0.7
"""Distance of grasps at which jaws are closed, relative to that of distinct ones: where the better
of two neighbours is worse after closing, the other one is not lost."""

SMALL_KIND = 0.002
"""Area fraction up to which the grasps of one kind count as one of many others."""

MOST_DISTINCT = 1000
"""Distinct grasps that are found at most."""

MOST_TRIED = 50
"""Distinct grasps of which wrong poses are tried."""

MAX_PERMUTED = 5
"""Most contacts of grasps whose contacts are matched in every order."""


def best_grasps(labels: SurfaceLabels, count: int, *, distance: float | None = None) -> GraspTable:
    """The best distinct grasps of a labelled surface, best first.

    The grasps are those of `distinct_grasps`. With a gripper as many kinds as possible, of grasps
    with the same label, are in the list; see `grasp_kinds`.

    Args:
        labels: The labelled surface.
        count: Largest number of grasps; there may be fewer.
        distance: As in `distinct_grasps`.

    Returns:
        At most `count` grasps, each with its first contact at a vertex; with a gripper also how it
        reaches them, `reach`, what its jaws touch there, `closed`, and `holding` at that.

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
    check_range("the number of best grasps", count, 1)
    ranked = distinct_grasps(labels, distance=distance)
    rows = np.arange(min(count, ranked.size))
    if labels.reach is not None:
        rows = _in_turns(ranked, _kinds_of(labels, ranked), count)
    return ranked.take(rows).whole()


_DISTINCT: WeakKeyDictionary[SurfaceLabels, GraspTable] = WeakKeyDictionary()


def distinct_grasps(labels: SurfaceLabels, *, distance: float | None = None) -> GraspTable:
    """All distinct grasps of a labelled surface in the order of `ranked_rows`, 1,000 at most.

    With a pose error (`Scene.pose_error`) the best 50 are closed at wrong poses, too, and ranked
    by what they are at these.

    The grasps are those of the vertices. One is omitted if its contacts can be matched with those
    of a better one so that all pairs are nearer than `distance` (non-maximum suppression).

    With a gripper of two fingers the jaws close on a free object at the poses of the candidates, as
    in `evaluate_grasps`, before they are ranked: labels, margins and forces that count are those at
    what the jaws touch, `closed` and `holding`. Grasps whose jaws touch the object outside the
    mesh's region are omitted.

    Args:
        labels: The labelled surface. Its grasps of the default distance are found once.
        distance: In the mesh's unit; None: 1/8 of the object's size. 0: only identical grasps are
            omitted.

    Raises:
        SettingError: A distance that is not a finite length.
    """
    limit = distance_of_distinct(labels.mesh) if distance is None else distance
    if not (limit >= 0.0 and math.isfinite(limit)):
        raise SettingError(f"distance must be a finite length of at least 0; got {limit:g}")
    found = _DISTINCT.get(labels) if distance is None else None
    if found is None:
        found = _find_distinct(labels, limit)
        if distance is None:
            _DISTINCT[labels] = found
    return found


def _find_distinct(labels: SurfaceLabels, limit: float) -> GraspTable:
    grasps = labels.grasps
    rows, holding = ranked_rows(grasps), grasps.holding

    def distinct(rows: Ints, limit: float) -> Ints:
        return rows[distinct_rows(grasps.contacts.take(rows).points, MOST_DISTINCT, limit)]

    if labels.reach is None:
        return grasps.take(distinct(rows, limit))
    chosen = distinct(rows, limit * CANDIDATES)
    if holding is not None:  # those of least force, which are the same whatever is at hand
        weakest = rows[np.argsort(holding.grip_force_largest[rows], kind="stable")]
        chosen = np.union1d(chosen, distinct(weakest, limit * CANDIDATES))
    candidates = grasps.take(rows[np.isin(rows, chosen)]).after_closing()
    if candidates.closed is not None:
        candidates = candidates.take(np.flatnonzero(candidates.closed.allowed(labels.mesh)))
    order = ranked_rows(candidates, candidates.closed)
    points, wrong = candidates.contacts.take(order).points, labels.scene and labels.scene.pose_error
    most = MOST_TRIED if wrong else MOST_DISTINCT
    found = candidates.take(order[distinct_rows(points, most, limit)]).at_wrong_poses()
    return found.take(ranked_rows(found, found.closed)) if wrong else found


def distance_of_distinct(mesh: ObjectMesh) -> float:
    """Default distance from which grasps are distinct, in the mesh's unit."""
    return DISTINCT * mesh.size


def _in_turns(ranked: GraspTable, kinds: Ints, count: int) -> Ints:
    """The rows of a list of grasps, of which as many kinds as possible are in it, best first.

    Kinds take turns among grasps of the same label.

    Args:
        ranked: Grasps, best first.
        kinds: Their kinds, shape (b,).
        count: Length of the list.
    """
    codes, turn = stated_label(ranked, ranked.closed), np.zeros(ranked.size, dtype=np.int64)
    for row in range(ranked.size):
        turn[row] = np.sum((kinds[:row] == kinds[row]) & (codes[:row] == codes[row]))
    return np.sort(np.lexsort((np.arange(ranked.size), turn, -codes))[:count])


def _kinds_of(labels: SurfaceLabels, grasps: GraspTable) -> Ints:
    """Kinds of grasps of the vertices, shape (b,); those of very little area count as one, -1."""
    kinds, areas = grasp_kinds(labels), labels.mesh.vertex_areas
    sizes = np.bincount(kinds[kinds >= 0], areas[kinds >= 0])
    small = np.append(sizes <= SMALL_KIND * areas.sum(), True)  # the last: no grasp
    own = kinds[first_vertices(grasps)]
    return np.where(small[own], -1, own)


def first_vertices(grasps: GraspTable) -> Ints:
    """The vertices at which grasps of a labelled surface have their first contact, shape (b,)."""
    contacts, mesh = grasps.contacts.surface_points, grasps.mesh
    corners = contacts.weights[:, 0].argmax(axis=1)
    return np.asarray(mesh.canonical[mesh.faces[contacts.faces[:, 0], corners]])


def distinct_rows(points: Floats, count: int, limit: float) -> Ints:
    """Indices of grasps (b, n, 3), best first, that are not near a better one."""
    rows: list[int] = []
    remaining = np.arange(len(points))
    while len(remaining) and len(rows) < count:
        rows.append(int(remaining[0]))
        remaining = remaining[1:]
        distance = matched_distance(points[remaining], points[rows[-1]])
        remaining = remaining[(distance >= limit) & (distance > 0.0)]
    return np.array(rows, dtype=np.int64)


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


TURN = math.radians(30.0)
"""Largest angle between the approach directions of neighbouring grasps of one kind [rad]."""

STRETCH = 4.0
"""Largest distance of neighbours' opposing contacts, relative to that of the neighbours."""

NEAR = 1.0 / 32.0
"""Distance of neighbours' opposing contacts, in object sizes, that is allowed in any case."""


def grasp_kinds(labels: SurfaceLabels) -> Ints:
    """Number the kinds of the vertices' grasps, such as across, at the rim, at the handle.

    Neighbouring vertices have one kind of grasp where their opposing contacts are near each other
    and the gripper, if there is one, approaches from nearly the same direction.

    Args:
        labels: The labelled surface.

    Returns:
        The kind of each vertex's grasp, from 0, shape (V,); -1: no grasp.
    """
    mesh, faces = labels.mesh, labels.mesh.faces
    edges = np.concatenate([faces[:, [0, 1]], faces[:, [1, 2]], faces[:, [2, 0]]])
    has_grasp = np.zeros(len(mesh.vertices), dtype=bool)
    has_grasp[labels.vertices] = True
    edges = edges[has_grasp[edges].all(axis=1)]
    edges = edges[_alike(labels, edges)]
    count = len(mesh.vertices)
    kinds = connected(count, edges[:, 0], edges[:, 1])
    numbers = np.full(count, -1, dtype=np.int64)
    _, numbers[has_grasp] = np.unique(kinds[has_grasp], return_inverse=True)
    return numbers[mesh.canonical]


def _alike(labels: SurfaceLabels, edges: Ints) -> Bools:
    """Whether the grasps at the ends of edges (e, 2) pass into each other, shape (e,)."""
    one, two = edges.T
    vertices, size = labels.mesh.vertices, labels.mesh.size
    lengths = np.linalg.norm(vertices[one] - vertices[two], axis=1)
    gaps = np.linalg.norm(labels.partners[one] - labels.partners[two], axis=2).max(axis=1)
    alike = gaps <= np.maximum(STRETCH * lengths, NEAR * size)
    if labels.reach is not None:
        directions = labels.reach.poses[:, :3, 2]
        cosines = (directions[one] * directions[two]).sum(axis=1)
        # For more than two fingers there are no directions.
        alike &= np.nan_to_num(cosines, nan=1.0) >= math.cos(TURN)
    return np.asarray(alike)
