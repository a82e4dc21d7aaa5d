"""The search for grasps of three fingers, compared with all triples of vertices, and by chance."""

import math
from functools import cache

import numpy as np
import pytest
import trimesh
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from grasp3d import GraspModel, ObjectMesh, Sampling, SurfaceLabels, label_surface, load_mesh
from grasp3d.mesh.measures import face_areas
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.settings.sampling import CandidatePoints
from grasp3d.surface.contacts import SurfaceContacts
from tests.helpers import coplanar, shapes
from tests.helpers.solids import box_mesh, sphere_mesh

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]

pytestmark = pytest.mark.slow

LIMIT = math.radians(80.0)
TOLERANCE = 2e-4
"""Largest amount by which the exhaustive angles may be too large [rad]."""

CLOSE = 0.02
UNDIVIDED = 1e3
"""Edge length up to which no edge is divided."""


def cylinder() -> ObjectMesh:
    """A cylinder of 16 sides, with rings of vertices along it and on its ends."""
    profile = [(0, -1.5), (0.5, -1.5), (1, -1.5), (1, -0.75), (1, 0), (1, 0.75)]
    profile += [(1, 1.5), (0.5, 1.5), (0, 1.5)]
    turned = trimesh.creation.revolve(np.array(profile, dtype=np.float64), sections=16)
    return load_mesh(shapes.arrays(turned), max_edge=UNDIVIDED)


def mug(sections: int) -> ObjectMesh:
    """A cup with a handle that a finger fits through; half of its vertices are on creases."""
    shapes.reader("manifold3d")
    outside = [(0, 0), (22, 0), (40, 0), (40, 30), (40, 64), (40, 95), (0, 95)]
    inside = [(0, 5), (20, 5), (36, 5), (36, 32), (36, 64), (36, 95), (36, 120), (0, 120)]
    body, hollow = (
        trimesh.creation.revolve(np.array(profile, dtype=np.float64), sections=sections)
        for profile in (outside, inside)
    )
    handle = trimesh.creation.torus(28.0, 7.0, major_sections=10, minor_sections=6)
    upright = trimesh.transformations.rotation_matrix(math.pi / 2.0, (1.0, 0.0, 0.0))
    handle.apply_transform(upright)
    handle.apply_translation((44.0, 0.0, 47.5))
    filled = trimesh.boolean.union([body, handle], engine="manifold")
    made = trimesh.boolean.difference([filled, hollow], engine="manifold")
    return load_mesh(shapes.arrays(made), max_edge=UNDIVIDED)


SHAPES = {
    "sphere": lambda: sphere_mesh(subdivisions=2),
    "box": lambda: box_mesh((2.0, 1.5, 1.0), max_edge=0.6),
    "cylinder": cylinder,
    "mug": lambda: mug(11),
}


@cache
def truth(name: str) -> tuple[ObjectMesh, Ints, Floats]:
    """A mesh, its vertices, and the best critical angle of three vertices through each."""
    mesh = SHAPES[name]()
    assert 100 < len(np.unique(mesh.faces)) <= 200
    search = coplanar.Exhaustive(mesh, LIMIT, TOLERANCE)
    angles = search.run()
    assert np.isfinite(angles).mean() > 0.95  # nearly all vertices can be compared
    return mesh, search.vertices, angles


def searched(mesh: ObjectMesh, candidate_points: CandidatePoints, seed: int = 0) -> SurfaceLabels:
    """Grasps that the search finds at every vertex."""
    sampling = Sampling(candidate_points=candidate_points, search_angle=LIMIT, seed=seed)
    return label_surface(mesh, GraspModel(fingers=3), sampling=sampling)


@pytest.mark.parametrize("name", SHAPES)
def test_with_contacts_on_vertices_the_search_is_never_better_and_rarely_worse(name: str) -> None:
    mesh, vertices, best = truth(name)
    best, labels = np.minimum(best, LIMIT), searched(mesh, "vertices")
    found = np.minimum(labels.critical_angle[vertices], LIMIT)
    smooth = labels.distinct[~labels.distinct_contacts.on_crease.any(axis=1)]
    never_better = np.isin(vertices, smooth)
    assert never_better.sum() > 20
    assert (found >= best - TOLERANCE - 1e-6)[never_better].all()
    assert np.mean(found <= best + CLOSE) >= 0.95


@pytest.mark.parametrize("name", SHAPES)
def test_with_contacts_on_the_surface_the_search_is_rarely_worse(name: str) -> None:
    """It may be better, as contacts may be anywhere on the surface."""
    mesh, vertices, best = truth(name)
    found = np.minimum(searched(mesh, "surface").critical_angle[vertices], LIMIT)
    assert np.mean(found <= np.minimum(best, LIMIT) + CLOSE) >= 0.95


STARTS, ROUNDS, VARIATIONS = 8, 14, 32
"""Grasps that the other search varies, how often, and the variations of each."""


def by_chance(mesh: ObjectMesh, vertex: int, rng: np.random.Generator) -> float:
    """Critical angle of a search of its own: pairs of random points, the best moved at random."""
    count = 100_000
    areas = face_areas(mesh.vertices, mesh.faces)
    faces = rng.choice(len(areas), count, p=areas / areas.sum())
    weights = rng.dirichlet(np.ones(3), count)
    sample = SurfaceContacts(mesh, SurfacePoints(faces[:, None], weights[:, None]))
    points, normals = sample.points[:, 0] / mesh.size, sample.normals[:, 0]
    tree = cKDTree(points)
    here, normal = mesh.vertices[vertex] / mesh.size, mesh.normal_centres[vertex]

    def evaluate(pairs: Ints) -> Floats:
        contacts = np.concatenate([np.broadcast_to(here, (len(pairs), 1, 3)), points[pairs]], 1)
        inward = np.concatenate([np.broadcast_to(normal, (len(pairs), 1, 3)), normals[pairs]], 1)
        gaps = contacts - np.roll(contacts, 1, axis=1)
        up = np.cross(gaps[:, 1], gaps[:, 2])
        elevation = np.abs(np.einsum("bij,bj->bi", inward, up)).max(axis=1)
        flat = elevation < math.sin(math.radians(15.0)) * np.linalg.norm(up, axis=1)
        allowed = flat & (np.linalg.norm(gaps, axis=2).min(axis=1) > 0.011)
        angles = np.full(len(pairs), math.inf)
        angles[allowed] = coplanar.critical_angles(
            contacts[allowed], inward[allowed], tolerance=5e-4
        )
        return np.asarray(np.nan_to_num(angles, nan=math.inf))

    pairs = rng.integers(count, size=(20_000, 2))
    angles = evaluate(pairs)
    order = np.argsort(angles)[:STARTS]
    pairs, angles = pairs[order], angles[order]
    for radius in np.geomspace(0.08, 0.004, ROUNDS):
        near = [
            [rng.choice(found, VARIATIONS) for found in row]
            for row in [tree.query_ball_point(points[pair], radius) for pair in pairs]
        ]
        moved = np.array(near).transpose(0, 2, 1)  # (starts, variations, 2)
        changed = evaluate(moved.reshape(-1, 2)).reshape(len(pairs), VARIATIONS)
        best = changed.argmin(axis=1)
        better = changed.min(axis=1) < angles
        rows = np.flatnonzero(better)
        pairs[rows], angles[rows] = moved[rows, best[rows]], changed[rows, best[rows]]
    return float(angles.min())


@pytest.mark.parametrize("name", ["spray.glb", "banana.ply"])
def test_another_search_finds_hardly_anything_better(name: str) -> None:
    mesh = load_mesh(shapes.LIBRARY / name)
    found = label_surface(mesh, GraspModel(fingers=3)).critical_angle
    rng = np.random.default_rng(0)
    smooth = np.flatnonzero((mesh.normal_radii == 0.0) & mesh.on_surface)
    vertices = rng.choice(smooth, 12, replace=False)
    best = np.array([by_chance(mesh, vertex, rng) for vertex in vertices])
    assert np.sum(found[vertices] > best + math.radians(0.2)) <= 1
