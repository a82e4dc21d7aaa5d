"""The best distinct grasps of a labelled surface, or of a parallel gripper on it.

The best poses are those that score best in `evaluate_grasps` among a fixed pool. One fan of rays,
from points spread over the surface, finds pairs of opposed surface points at all exits of the rays.
Each pair is gripped from a fixed list of approach angles at a few depths on the pads. Widely spaced
pairs come first, then those between them, until each range of approach directions has enough free
poses, few of them of the same pair. So the pool depends neither on load and friction nor on the
allowed approach: these settings exclude poses, and wider settings lose none.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from grasp3d.arrays import Bools, Floats, Ints, first_alike, locked, unit_rows
from grasp3d.formats.frames import as_read_again
from grasp3d.formats.poses import GraspPoses
from grasp3d.grasps.evaluated_poses import (
    MOST_DISTINCT,
    distance_of_distinct,
    distinct_rows,
    matched_distance,
    most_distinct,
    ranked_rows,
)
from grasp3d.grasps.jaw_grasps import JawGrasps
from grasp3d.hand.jaws import Jaws
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.hand.reach import collides
from grasp3d.hand.scene import Scene
from grasp3d.hand.table import best_approach
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.measures import Triangles
from grasp3d.mesh.region import allowed_contacts
from grasp3d.mesh.surface_points import FaceRays
from grasp3d.quality.loads import Load
from grasp3d.settings import GraspModel, with_fingers
from grasp3d.settings.checks import check_range
from grasp3d.settings.pose_error import PoseError, poses_of
from grasp3d.stability.label import Label
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.system.context import unreported

POINTS = 1500
"""Number of points from which rays start."""

RINGS = ((0.0, 1), (math.radians(8.0), 6), (math.radians(16.0), 6))
"""Angles of the rays from the inward normal [rad], and number of rays at each angle."""

WIDEST = math.radians(20.0)
"""Largest angle between a normal and the line through both points [rad], whatever the friction:
jaws turn the object, and touch more than points."""

CROSSINGS = 16
"""Largest number of crossings of a ray with the surface; every other one is an exit."""

STEP = 1e-4
"""Distance behind a crossing at which a ray starts again, in object sizes."""

CELLS = tuple(0.25 / 1.3**step for step in range(9))
"""Cell sizes, in object sizes; each pair of cells keeps one pair of opposed points."""

DOWN = np.array([0.0, 0.0, -1.0])
"""Approach direction from which the ranges are measured where no direction is the best."""

BANDS = np.radians([30.0, 60.0, 90.0])
"""Angles from the best approach direction that separate the ranges [rad]."""

OF_PAIR = 2
"""Most free poses of a pair that are taken in each range."""

FREE = (240, 120, 80, 40)
"""Number of free poses that is enough, for each range."""

TESTED = 15_000
"""Number of tested poses after which a range takes part in no further cell size."""

ANGLES = 12
"""Approach angles about the closing axis; the first is the one nearest to straight down."""

DEPTHS = (-0.3, 0.3)
"""Distances of the contacts from the middle of the pads, in pad heights."""


class OpposedPlaces(NamedTuple):
    """Pairs of opposed surface points between which jaws may close, normalised: (p, 3) each."""

    starts: Floats
    ends: Floats
    angles: Floats
    """Larger angle between a normal and the line through the points [rad], shape (p,)."""

    def take(self, rows: Ints) -> "OpposedPlaces":
        """The chosen pairs."""
        return OpposedPlaces(*(one[rows] for one in self))

    def spread(self, cell: float) -> Ints:
        """Rows of the best pair of opposed points for each unordered pair of cells of this size."""
        cells = np.floor(np.stack([self.starts, self.ends], axis=1) / cell).astype(np.int64)
        _, number = first_alike(cells.reshape(-1, 3))
        keys = np.sort(number.reshape(-1, 2), axis=1)
        order = np.argsort(self.angles, kind="stable")
        first, _ = first_alike(keys[order])
        return np.sort(order[first])


_PLACES: WeakKeyDictionary[ObjectMesh, OpposedPlaces] = WeakKeyDictionary()


def candidate_poses(mesh: ObjectMesh, scene: Scene) -> Floats:
    """Free poses with an allowed approach, shape (k, 4, 4).

    Args:
        mesh: The object, whose unit is known. Its opposed points are found once.
        scene: The gripper, the table and the approach.
    """
    hand = scene.jaws
    assert hand is not None
    stroke = hand.max_opening
    if mesh not in _PLACES:
        _PLACES[mesh] = _opposed(mesh)
    places = _PLACES[mesh]
    width = np.linalg.norm(places.ends - places.starts, axis=1) * mesh.size
    places = places.take(np.flatnonzero(width <= stroke))
    left, found = np.ones(len(places.angles), dtype=np.bool_), [np.zeros((0, 4, 4))]
    wanted, tested = np.array(FREE), np.zeros(len(FREE), dtype=np.int64)
    toward = best_approach(scene.table, scene.approach)
    toward = DOWN if toward is None else toward
    wanted[1:][scene.approach.within <= BANDS] = 0
    for cell in CELLS:
        rows = places.spread(cell)
        rows = rows[left[rows]]
        left[rows] = False
        poses = _poses(mesh, hand, places.take(rows))
        pair = np.arange(len(poses)) // (ANGLES * len(DEPTHS))
        band = np.searchsorted(BANDS, np.arccos(np.clip(poses[:, :3, 2] @ toward, -1.0, 1.0)))
        looked_for = wanted[band] > 0
        poses, pair, band = poses[looked_for], pair[looked_for], band[looked_for]
        tested += np.bincount(band, minlength=len(tested))
        free = np.flatnonzero(is_free(mesh, scene, poses))
        free = free[_few_of_each(pair[free] * len(wanted) + band[free], OF_PAIR)]
        for number in range(len(wanted)):
            mine = free[band[free] == number]
            # Where there are more than enough, an even spread of them is taken.
            few = mine[np.linspace(0, len(mine) - 1, min(len(mine), wanted[number])).astype(int)]
            found.append(poses[few])
            wanted[number] -= len(few)
        wanted[tested > TESTED] = 0
        if not wanted.any():
            break
    poses = np.concatenate(found)
    return poses[scene.allows(poses)]


def _few_of_each(keys: Ints, most: int) -> Ints:
    """Indices of at most `most` items of each key (n,), spread evenly among those of the key."""
    order = np.argsort(keys, kind="stable")
    _, first, count = np.unique(keys[order], return_index=True, return_counts=True)
    few = np.minimum(count, most)
    step = np.arange(few.sum()) - np.repeat(np.cumsum(few) - few, few)
    within = ((2 * step + 1) * np.repeat(count, few)) // (2 * np.repeat(few, few))
    return np.sort(order[np.repeat(first, few) + within])


def is_free(mesh: ObjectMesh, scene: Scene, poses: Floats) -> Bools:
    """Whether a wide-open gripper touches neither object nor table, shape (k,).

    Args:
        mesh: The object, whose unit is known.
        scene: The gripper and the table.
        poses: Poses of the gripper (k, 4, 4).
    """
    hand = scene.jaws
    assert hand is not None
    wide = hand.limits[1]
    return ~collides(mesh, poses, wide, hand, table=scene.table)


def _poses(mesh: ObjectMesh, hand: Jaws, places: OpposedPlaces) -> Floats:
    """Poses that grip pairs of points from all angles at all depths, shape (k, 4, 4)."""
    closing = unit_rows(places.ends - places.starts)
    down = _across(closing, DOWN)
    side = np.cross(down, closing)
    angles = 2.0 * math.pi / ANGLES * np.arange(ANGLES)[:, None]
    poses = np.zeros((len(closing), ANGLES, len(DEPTHS), 4, 4))
    poses[..., 3, 3] = 1.0
    poses[..., :3, 0] = closing[:, None, None]
    approach = np.cos(angles) * down[:, None] + np.sin(angles) * side[:, None]  # (p, angles, 3)
    poses[..., :3, 2] = approach[:, :, None]
    poses[..., :3, 1] = np.cross(poses[..., :3, 2], poses[..., :3, 0])
    middle = mesh.from_normalized(0.5 * (places.starts + places.ends))
    depths = np.array(DEPTHS) * hand.pad_height
    poses[..., :3, 3] = middle[:, None, None] + depths[:, None] * poses[..., :3, 2]
    return poses.reshape(-1, 4, 4)


def _across(axes: Floats, wanted: Floats) -> Floats:
    """Unit vectors perpendicular to axes (p, 3), nearest to a wanted vector, or else to x."""
    across = wanted - (axes @ wanted)[:, None] * axes
    along = np.linalg.norm(across, axis=1) < STEP
    x = np.array([1.0, 0.0, 0.0])
    across[along] = x - (axes[along] @ x)[:, None] * axes[along]
    return unit_rows(across)


def _opposed(mesh: ObjectMesh) -> OpposedPlaces:
    """Pairs of opposed points at the starts and exits of all rays."""
    faces, weights = _spread(mesh)
    points, normals = _points(mesh, faces, weights), _normals(mesh, faces, weights)
    directions = _fan(normals)
    each = np.repeat(np.arange(len(points)), directions.shape[1])
    directions = directions.reshape(-1, 3)
    outward = -Triangles(mesh.normalized, mesh.faces).normals
    rays = FaceRays(mesh.normalized, mesh.faces)
    along, going = np.full(len(each), STEP), np.arange(len(each))
    found = [OpposedPlaces(np.zeros((0, 3)), np.zeros((0, 3)), np.zeros(0))]
    for _ in range(CROSSINGS):
        origins = points[each[going]] + along[going, None] * directions[going]
        face, far = rays.hits(origins.astype(np.float32), directions[going].astype(np.float32))
        met = face >= 0
        going, face = going[met], face[met].astype(np.int64)
        if not len(going):
            break
        along[going] += far[met]
        leaves = np.vecdot(outward[face], directions[going]) > 0.0
        exits, face = going[leaves], face[leaves]
        starts, toward = points[each[exits]], directions[exits]
        ends = starts + along[exits, None] * toward
        opposite = _normals(mesh, face, _weights(mesh, face, ends))
        cosines = np.minimum(np.vecdot(normals[each[exits]], toward), -np.vecdot(opposite, toward))
        kept = np.flatnonzero(cosines >= math.cos(WIDEST))
        angles = np.arccos(np.minimum(cosines, 1.0))
        found.append(OpposedPlaces(starts, ends, angles).take(kept))
        along[going] += STEP
    return OpposedPlaces(*(locked(np.concatenate(parts)) for parts in zip(*found, strict=True)))


def _spread(mesh: ObjectMesh) -> tuple[Ints, Floats]:
    """Faces (n,) and barycentric coordinates (n, 3) of points spread evenly over the area.

    A low-discrepancy sequence puts them on the part where contacts may be, the same each time.
    """
    faces = mesh.contact_faces
    areas = np.cumsum(Triangles(mesh.normalized, mesh.faces[faces]).areas)
    numbers = np.arange(POINTS) + 0.5
    chosen = np.searchsorted(areas, numbers / POINTS * areas[-1])
    plastic = 1.324717957244746
    u, v = np.sqrt(np.modf(numbers / plastic)[0]), np.modf(numbers / plastic**2)[0]
    weights = np.stack([1.0 - u, u * (1.0 - v), u * v], axis=1)
    return faces[np.minimum(chosen, len(faces) - 1)], weights


def _points(mesh: ObjectMesh, faces: Ints, weights: Floats) -> Floats:
    return np.asarray((weights[:, None] @ mesh.normalized[mesh.faces[faces]])[:, 0])


def _normals(mesh: ObjectMesh, faces: Ints, weights: Floats) -> Floats:
    """Interpolated inward unit normals (n, 3)."""
    corners = mesh.corner_normals
    return unit_rows((weights[:, None] @ corners.normals[corners.corners[faces]])[:, 0])


def _weights(mesh: ObjectMesh, faces: Ints, points: Floats) -> Floats:
    """Barycentric coordinates of points on their faces (n, 3)."""
    corners = mesh.normalized[mesh.faces[faces]]
    one, two = corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]
    arm, normal = points - corners[:, 0], np.cross(one, two)
    square = np.maximum(np.vecdot(normal, normal), np.finfo(float).tiny)
    second = np.vecdot(np.cross(arm, two), normal) / square
    third = np.vecdot(np.cross(one, arm), normal) / square
    weights = np.clip(np.stack([1.0 - second - third, second, third], axis=1), 0.0, 1.0)
    return np.asarray(weights / weights.sum(axis=1, keepdims=True))


def _fan(normals: Floats) -> Floats:
    """Directions of rays about inward normals (n, 3), shape (n, r, 3)."""
    one = _across(normals, np.array([0.0, 0.0, 1.0]))
    two = np.cross(normals, one)
    rays = []
    for number, (tilt, count) in enumerate(RINGS):
        for around in 2.0 * math.pi / count * (np.arange(count) + 0.5 * number):
            side = math.cos(around) * one + math.sin(around) * two
            rays.append(math.cos(tilt) * normals + math.sin(tilt) * side)
    return np.stack(rays, axis=1)


MOST_TRIED = 50
"""Poses of the pool that are also evaluated with the pose error, unless more are asked for."""

TURNS = tuple(map(math.radians, (10.0, 5.0, 5.0)))
"""Turns about x, y and z of the gripper in the first round of refinement [rad]."""

SHIFT = 0.25
"""Shifts along y and z in the first round, in widths and heights of the pads."""

EQUAL = 1e-3
"""Loss of score that is accepted for a pose at which the jaws do not move the object."""

ROUNDS = 2
"""Rounds of refinement; a round that improves at most half of the poses halves the steps."""


@dataclass(frozen=True, eq=False)
class PoseSearch:
    """Search for poses of a gripper on one object."""

    mesh: ObjectMesh
    model: GraspModel
    scene: Scene
    load: Load | None
    openings: tuple[float, float] = (0.0, math.inf)
    """Smallest and largest distance between the closed jaws [m]."""

    @classmethod
    def of(cls, labels: SurfaceLabels) -> "PoseSearch":
        """Return the search for the gripper, the table and the load of a labelled surface."""
        assert labels.scene is not None
        model = with_fingers(labels.model, labels.scene.hand.fingers[-1])
        limits, sampling = (0.0, math.inf), labels.sampling
        if sampling is not None and labels.model.fingers == 2:
            limits = sampling.min_opening, sampling.max_opening
        return cls(labels.mesh, model, labels.scene, labels.load, limits)

    @property
    def jaws(self) -> ParallelGripper:
        """The gripper."""
        assert isinstance(self.scene.hand, ParallelGripper)
        return self.scene.hand

    def pool(self) -> JawGrasps:
        """All free poses of the pool with an allowed approach, evaluated without a pose error.

        Their contacts are in the region of the mesh, and their openings within the limits.
        """
        found = self.evaluated(candidate_poses(self.mesh, self.scene), PoseError())
        return found.take(np.flatnonzero(self._allowed(found)))

    def best(self, pool: JawGrasps, count: int, *, unstable: bool = False) -> JawGrasps:
        """Best distinct poses of a pool that may hold, each refined, best first.

        Args:
            pool: What `pool` returned.
            count: Largest number of poses.
            unstable: Whether poses labelled U follow them.
        """
        least = Label.U if unstable else Label.M
        if self.scene.pose_error:
            pool = pool.take(self._distinct(pool, max(count, MOST_TRIED), least))
            pool = self.evaluated(pool.poses)
        chosen = self._refined(pool.take(self._distinct(pool, count, least)))
        chosen = self.evaluated(as_read_again(self._closed_upon(chosen)))
        return self.evaluated(chosen.poses[ranked_rows(chosen)])

    def _closed_upon(self, chosen: JawGrasps) -> Floats:
        """Poses (k, 4, 4) at which the closing jaws do not move the object, where as good."""
        poses, rest = chosen.poses.copy(), chosen.jaws.poses
        rows = np.flatnonzero(self._free(rest))
        found = self.evaluated(rest[rows])
        better = self._allowed(found) & (found.score >= chosen.score[rows] - EQUAL)
        better &= found.letter >= chosen.letter[rows]
        poses[rows[better]] = rest[rows[better]]
        return poses

    def _distinct(self, pool: JawGrasps, count: int, least: Label) -> Ints:
        """Rows of distinct poses with the label `least` or a better one, best first.

        While fewer than `count` are S, an S that excludes two distinct ones is exchanged for them.
        """
        limit = distance_of_distinct(self.mesh)
        order, points = ranked_rows(pool), pool.jaws.points
        rows = order[pool.letter[order] == Label.S]
        sure = most_distinct(points[rows], pool.score[rows], limit, count)
        sure = rows[sure]
        others = order[(pool.letter[order] >= least) & (pool.letter[order] < Label.S)]
        for row in sure.tolist():
            others = others[matched_distance(points[others], points[row]) >= limit]
        apart = distinct_rows(points[others], count - len(sure), limit)
        return np.append(sure, others[apart])

    def _free(self, poses: Floats) -> Bools:
        """Whether poses (k, 4, 4) have an allowed approach and leave the open gripper free."""
        free = self.scene.allows(poses)
        free[free] = is_free(self.mesh, self.scene, poses[free])
        return free

    def evaluated(self, poses: Floats, error: PoseError | None = None) -> JawGrasps:
        """Evaluate poses (k, 4, 4) as `evaluate_grasps` does.

        Args:
            poses: The poses, in metres.
            error: Pose error; None: that of the scene.
        """
        stroke = self.jaws.max_opening
        given = GraspPoses(
            poses=poses, pregrasp_opening=np.full(len(poses), stroke), unit=self.mesh.unit,
            hand=self.jaws, object_file=self.mesh.report.source,
            object_scale=self.mesh.file_scale,
        )  # fmt: skip
        scene = self.scene if error is None else replace(self.scene, pose_error=error)
        with unreported():
            return JawGrasps.closed_at(self.mesh, given, self.model, scene, load=self.load)

    def _allowed(self, found: JawGrasps) -> Bools:
        """Whether the jaws close where contacts may be, with an allowed opening."""
        least, most = self.openings
        # The object yields to the pads, as in the test of the stroke.
        soft = 2.0 * self.jaws.compliance
        within = (found.opening >= least - soft) & (found.opening - soft <= most)
        return found.jaws.closed & within & allowed_contacts(self.mesh, found.jaws.points)

    def _refined(self, chosen: JawGrasps) -> JawGrasps:
        """Poses improved by small turns and shifts.

        A pose that would come too near another one stays as it was.
        """
        limit, scale = distance_of_distinct(self.mesh), 1.0
        for _ in range(ROUNDS if chosen.size else 0):
            tried = chosen.poses[:, None] @ self._moves(scale)  # (k, m, 4, 4)
            flat = tried.reshape(-1, 4, 4)
            as_it_was = np.arange(0, len(flat), tried.shape[1])
            free = np.union1d(as_it_was, np.flatnonzero(self._free(flat)))
            found = self.evaluated(flat[free])
            scores = np.full(len(flat), -1.0)
            scores[free] = np.where(self._allowed(found), found.score, -1.0)
            best = as_it_was + scores.reshape(tried.shape[:2]).argmax(axis=1)
            rows, better = np.searchsorted(free, as_it_was), np.searchsorted(free, best)
            points, moved = chosen.jaws.points.copy(), 0
            for row in np.flatnonzero(scores[best] > chosen.score).tolist():
                own = found.jaws.points[better[row]]
                gaps = np.delete(matched_distance(points, own), row)
                if gaps.min(initial=math.inf) >= limit:
                    rows[row], points[row] = better[row], own
                    moved += 1
            chosen = found.take(rows)
            if 2 * moved <= chosen.size:
                scale *= 0.5
        return chosen

    def _moves(self, scale: float) -> Floats:
        """Small motions in the frame of the gripper, shape (m, 4, 4); the first is the identity."""
        turns = np.kron(np.diag(TURNS), [[1.0], [-1.0]])
        sizes = np.array([0.0, self.jaws.pad_width, self.jaws.pad_height])
        shifts = np.kron(np.diag(SHIFT * sizes)[1:], [[1.0], [-1.0]])
        still = np.zeros_like
        turned = poses_of(still(turns), np.asarray(scale * turns))
        return np.concatenate([turned, poses_of(np.asarray(scale * shifts), still(shifts))[1:]])


LISTED = 10
"""Fewest poses that are chosen, so that every shorter list is the beginning of this one."""


def best_grasps(
    labels: SurfaceLabels, count: int, *, unstable: bool = False
) -> GraspTable | JawGrasps:
    """Best distinct grasps of a labelled surface that may hold, best first.

    Without a gripper they are those of the vertices. With a parallel gripper they are poses: the
    best that `evaluate_grasps` finds in a fixed set of candidates, each refined. Approach, load and
    sensor only select among the candidates. A grasp is omitted if its contacts can be matched with
    those of a better one so that all pairs are nearer than 1/8 of the object's size.

    Args:
        labels: The labelled surface.
        count: Largest number of grasps; there may be fewer.
        unstable: Whether grasps labelled U follow those that may hold.

    Returns:
        At most `count` grasps, none of them U unless asked for. With a gripper they are the result
        of `evaluate_grasps` for the poses, else grasps with their first contact at a vertex.

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
    """Whether a gripper that has poses for them makes the grasps of a labelled surface."""
    scene = labels.scene
    return scene is not None and scene.jaws is not None and labels.mode == "label"


_POOLS: WeakKeyDictionary[SurfaceLabels, JawGrasps] = WeakKeyDictionary()
_NAMED: WeakKeyDictionary[SurfaceLabels, dict[tuple[bool, int], JawGrasps]] = WeakKeyDictionary()
_DISTINCT: WeakKeyDictionary[SurfaceLabels, dict[bool, GraspTable]] = WeakKeyDictionary()


def pool_of(labels: SurfaceLabels) -> JawGrasps:
    """Evaluated poses among which the best ones of a surface are sought; found once.

    Args:
        labels: Labels with a gripper; see `has_poses`.
    """
    if labels not in _POOLS:
        _POOLS[labels] = PoseSearch.of(labels).pool()
    return _POOLS[labels]


def distinct_grasps(labels: SurfaceLabels, *, unstable: bool = False) -> GraspTable:
    """Distinct grasps of the vertices that may hold, best first, 1,000 at most; found once.

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
    """Vertices at which grasps of a labelled surface have their first contact, shape (b,)."""
    contacts, mesh = grasps.contacts.surface_points, grasps.mesh
    corners = contacts.weights[:, 0].argmax(axis=1)
    return np.asarray(mesh.canonical[mesh.faces[contacts.faces[:, 0], corners]])


def count_sure(labels: SurfaceLabels) -> int:
    """Number of distinct poses of the pool that are labelled S, 1,000 at most.

    Args:
        labels: Labels with a gripper; see `has_poses`.
    """
    pool = pool_of(labels)
    rows = ranked_rows(pool)
    rows = rows[pool.letter[rows] == Label.S]
    limit, scores = distance_of_distinct(labels.mesh), pool.score[rows]
    return len(most_distinct(pool.jaws.points[rows], scores, limit, MOST_DISTINCT))
