"""Poses of a parallel gripper on an object among which the best are sought.

Pairs of opposed places come from one fan of rays at points that are spread over the surface, at all
of their exits. Each is gripped from a fixed list of approach angles, at a few depths on the pads,
first widely spaced pairs and then those between them, until enough poses are free for each range of
approach directions, few of them of the same pair. So none depends on the load, on friction or on
how far approaches may be from the best direction: these settings leave poses out, and wider ones
lose none.
"""

import math
from typing import NamedTuple
from weakref import WeakKeyDictionary

import numpy as np

from grasp3d.arrays import Bools, Floats, Ints, first_alike, locked, unit_rows
from grasp3d.hand.jaws import Jaws
from grasp3d.hand.reach import collides
from grasp3d.hand.scene import Scene
from grasp3d.hand.table import best_approach
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.measures import Triangles
from grasp3d.mesh.ray_tracing import FaceRays

POINTS = 1500
"""Points from which rays start."""

RINGS = ((0.0, 1), (math.radians(8.0), 6), (math.radians(16.0), 6))
"""Angles of the rays from the inward normal [rad], and their numbers."""

WIDEST = math.radians(20.0)
"""Largest angle of a normal from the line through both places [rad], whatever the friction: jaws
turn the object, and touch more than points."""

CROSSINGS = 16
"""Most crossings of a ray with the surface, every other of which is an exit."""

STEP = 1e-4
"""Distance behind a crossing from which a ray goes on, in object sizes."""

CELLS = tuple(0.25 / 1.3**step for step in range(9))
"""Sizes of the cells for both ends of which each keeps one pair [object sizes]."""

DOWN = np.array([0.0, 0.0, -1.0])
"""Approach direction about which ranges are where none is better than others."""

BANDS = np.radians([30.0, 60.0, 90.0])
"""Angles from the best approach direction that divide it into ranges [rad]."""

OF_PAIR = 2
"""Free poses of a pair that are taken at most in each range."""

FREE = (240, 120, 80, 40)
"""Free poses in each range that are enough."""

TESTED = 15_000
"""Poses that are tested at most in each range, but for those of one size of cells."""

ANGLES = 12
"""Approach angles about the closing axis; the first is the one nearest to straight down."""

DEPTHS = (-0.3, 0.3)
"""Places of the contacts on the pads, in pad heights from their middle."""


class OpposedPlaces(NamedTuple):
    """Pairs of places on a surface between which jaws may close, normalised: (p, 3) each."""

    starts: Floats
    ends: Floats
    angles: Floats
    """The larger angle of both normals from the line through the places [rad], shape (p,)."""

    def take(self, rows: Ints) -> "OpposedPlaces":
        """The chosen pairs."""
        return OpposedPlaces(*(one[rows] for one in self))

    def spread(self, cell: float) -> Ints:
        """Rows of the best opposed pair of each pair of cells of such a size, either way round."""
        cells = np.floor(np.stack([self.starts, self.ends], axis=1) / cell).astype(np.int64)
        _, number = first_alike(cells.reshape(-1, 3))
        keys = np.sort(number.reshape(-1, 2), axis=1)
        order = np.argsort(self.angles, kind="stable")
        first, _ = first_alike(keys[order])
        return np.sort(order[first])


_PLACES: WeakKeyDictionary[ObjectMesh, OpposedPlaces] = WeakKeyDictionary()


def candidate_poses(mesh: ObjectMesh, scene: Scene) -> Floats:
    """Poses that are free, and within the approach, shape (k, 4, 4).

    Args:
        mesh: The object, whose unit is known. Its pairs are found once.
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
            # Of more than enough, those are taken that are spread evenly.
            few = mine[np.linspace(0, len(mine) - 1, min(len(mine), wanted[number])).astype(int)]
            found.append(poses[few])
            wanted[number] -= len(few)
        wanted[tested > TESTED] = 0
        if not wanted.any():
            break
    poses = np.concatenate(found)
    return poses[scene.allows(poses)]


def _few_of_each(keys: Ints, most: int) -> Ints:
    """Indices of at most so many of each key (n,), evenly spread among those of the key."""
    order = np.argsort(keys, kind="stable")
    _, first, count = np.unique(keys[order], return_index=True, return_counts=True)
    few = np.minimum(count, most)
    step = np.arange(few.sum()) - np.repeat(np.cumsum(few) - few, few)
    within = ((2 * step + 1) * np.repeat(count, few)) // (2 * np.repeat(few, few))
    return np.sort(order[np.repeat(first, few) + within])


def is_free(mesh: ObjectMesh, scene: Scene, poses: Floats) -> Bools:
    """Whether a gripper, wide open, touches neither object nor table, shape (k,).

    Args:
        mesh: The object, whose unit is known.
        scene: The gripper and the table.
        poses: Its poses (k, 4, 4).
    """
    hand = scene.jaws
    assert hand is not None
    wide = hand.limits[1]
    return ~collides(mesh, poses, wide, hand, table=scene.table)


def _poses(mesh: ObjectMesh, hand: Jaws, places: OpposedPlaces) -> Floats:
    """Poses that grip pairs from all angles at all depths, shape (k, 4, 4)."""
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
    """Unit vectors across axes (p, 3) that are nearest to a wanted one, or else to x."""
    across = wanted - (axes @ wanted)[:, None] * axes
    along = np.linalg.norm(across, axis=1) < STEP
    x = np.array([1.0, 0.0, 0.0])
    across[along] = x - (axes[along] @ x)[:, None] * axes[along]
    return unit_rows(across)


def _opposed(mesh: ObjectMesh) -> OpposedPlaces:
    """Starts and exits of all rays."""
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
    """Faces (n,) and barycentric coordinates (n, 3) of points that are spread over the area.

    Of the part where contacts may be, by a sequence of low discrepancy: the same each time.
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
