"""Nearest points of a surface, whether points are inside, and what rays meet first."""

import math

import numpy as np
import pytest
from numpy.typing import NDArray

from grasp3d import load_mesh
from grasp3d.mesh import ObjectMesh, surface_points
from grasp3d.mesh.surface_points import FaceRays, contains, nearest_surface_points
from grasp3d.system.context import running
from tests.helpers import oracles, shapes
from tests.helpers.oracles import distance_to_triangles
from tests.helpers.shapes import Surface

Floats = NDArray[np.float64]


def sliver_and_specks() -> ObjectMesh:
    """Faces of very different sizes: long thin ones beside a fine ball."""
    ball, faces = shapes.sphere(2, 0.001)
    plate, plate_faces = shapes.box((2.0, 1.0, 1e-4))
    vertices = np.concatenate([plate, ball + (0.9, 0.0, 0.2)])
    surface = np.concatenate([plate_faces, faces + len(plate)])
    return load_mesh((vertices, surface), max_edge=2.0)


MESHES = {
    "mug": lambda: load_mesh(shapes.LIBRARY / "mug.glb", max_edge=1.0),
    "lopsided": lambda: load_mesh(shapes.lopsided(), max_edge=9.0),
    "slivers": sliver_and_specks,
    "box": lambda: load_mesh(shapes.box((1.0, 2.0, 3.0))),
}


def sample_points(mesh: ObjectMesh, count: int, rng: np.random.Generator) -> Floats:
    """Points on the surface, at its vertices and edges, near it, inside and far away."""
    corners = mesh.vertices[mesh.faces[rng.integers(len(mesh.faces), size=count)]]
    weights = rng.dirichlet([1.0, 1.0, 1.0], count)
    on = (weights[:, None] @ corners)[:, 0]
    near = on + rng.normal(size=on.shape) * mesh.size * 10.0 ** rng.uniform(-9, 0, (count, 1))
    return np.concatenate([on, near, corners[:, 0], corners[:, :2].mean(axis=1), near[:9] * 100.0])


@pytest.mark.parametrize("name", MESHES)
def test_the_nearest_of_all_faces_is_found(name: str) -> None:
    mesh = MESHES[name]()
    points = sample_points(mesh, 25, np.random.default_rng(3))
    found, positions, distances = nearest_surface_points(mesh, points)
    triangles = mesh.vertices[mesh.faces]
    for point, position, distance in zip(points, positions, distances, strict=True):
        nearest = distance_to_triangles(point, triangles).min()
        rounding = 1e-9 * mesh.size + 1e-12 * float(np.linalg.norm(point))
        assert distance == pytest.approx(nearest, abs=rounding)
        assert np.linalg.norm(position - point) == pytest.approx(distance, abs=rounding)
    assert positions == pytest.approx(found.positions(mesh), abs=1e-12 * mesh.size)
    assert found.weights.min() >= 0.0
    assert found.weights.sum(axis=1) == pytest.approx(1.0)


def test_points_on_borders_have_exact_coordinates() -> None:
    """A contact on a crease is recognised as being on it, on slivers as well."""
    mesh = sliver_and_specks()
    corners = mesh.vertices[mesh.faces]
    found, _, distances = nearest_surface_points(mesh, corners.reshape(-1, 3))
    assert (np.sort(found.weights, axis=1) == (0.0, 0.0, 1.0)).all()
    assert distances == pytest.approx(0.0, abs=1e-12)
    fraction = 0.377
    for i in range(3):
        a, b = corners[:, i], corners[:, (i + 1) % 3]
        found, _, _ = nearest_surface_points(mesh, a + fraction * (b - a))
        assert (found.weights.min(axis=1) == 0.0).all()
        assert np.sort(found.weights, axis=1)[:, 1] == pytest.approx(fraction, abs=1e-6)


def test_points_beyond_the_limit_have_no_surface_point() -> None:
    mesh = load_mesh(shapes.sphere(3), max_edge=9.0)
    away = np.array([1.0, 1.009, 1.011, 1.1, 50.0, 0.9, 0.0])
    points = away[:, None] * mesh.vertices[7]
    found, positions, distances = nearest_surface_points(mesh, points, limit=0.01)
    near = np.array([True, True, *[False] * 5])
    assert np.array_equal(found.faces >= 0, near)
    assert np.array_equal(np.isfinite(positions).all(axis=1), near)
    assert distances == pytest.approx([0.0, 0.009, *[math.inf] * 5])


def test_single_points_all_points_and_parts_give_the_same(monkeypatch: pytest.MonkeyPatch) -> None:
    mesh = MESHES["lopsided"]()
    points = sample_points(mesh, 40, np.random.default_rng(5))
    found, positions, _ = nearest_surface_points(mesh, points)
    for number, point in enumerate(points):
        one, position, _ = nearest_surface_points(mesh, point[None])
        assert one.faces[0] == found.faces[number]
        assert np.array_equal(one.weights[0], found.weights[number])
        assert np.array_equal(position[0], positions[number])
    monkeypatch.setattr(surface_points, "CHUNK", 17)
    again, _, _ = running(threads=2)(nearest_surface_points)(mesh, points)
    assert np.array_equal(again.faces, found.faces)
    assert np.array_equal(again.weights, found.weights)


@pytest.mark.parametrize("name", ["lopsided", "box"])
def test_points_are_inside_as_the_winding_says(name: str) -> None:
    mesh = MESHES[name]()
    points = mesh.center + mesh.size * np.random.default_rng(1).uniform(-0.5, 0.5, (200, 3))
    corners = mesh.vertices[mesh.faces] - points[:, None, None]  # (k, F, 3, 3)
    lengths = np.linalg.norm(corners, axis=-1)
    volume = np.vecdot(corners[..., 0, :], np.cross(corners[..., 1, :], corners[..., 2, :]))
    below = lengths.prod(axis=-1)
    for one in range(3):
        two, three = (one + 1) % 3, (one + 2) % 3
        below += np.vecdot(corners[..., one, :], corners[..., two, :]) * lengths[..., three]
    solid_angle = 2.0 * np.arctan2(volume, below).sum(axis=1)  # van Oosterom & Strackee 1983
    inside = np.abs(solid_angle) > 2.0 * math.pi
    assert 10 < inside.sum() < 190
    np.testing.assert_array_equal(contains(mesh, points), inside)


def rays_from(mesh: ObjectMesh, count: int) -> tuple[np.ndarray, np.ndarray]:
    """Rays from just beside the surface, in any direction."""
    rng = np.random.default_rng(0)
    faces, weights = rng.integers(len(mesh.faces), size=count), rng.dirichlet([1, 1, 1], size=count)
    points = (mesh.normalized[mesh.faces[faces]] * weights[..., None]).sum(axis=1)
    directions = rng.standard_normal((count, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    origins = points + 1e-4 * directions
    return origins.astype(np.float32), directions.astype(np.float32)


@pytest.mark.parametrize("embree", [True, False])
@pytest.mark.parametrize("shape", [shapes.lopsided(), shapes.tube(), shapes.box(), shapes.torus()])
def test_a_ray_meets_the_first_face_of_all(
    shape: Surface, embree: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(surface_points, "EMBREE", embree)
    mesh, rounding = load_mesh(shape, max_edge=0.3), 1e-5 if embree else 1e-6
    origins, directions = rays_from(mesh, 300)
    rays = FaceRays(mesh.normalized, mesh.faces)
    faces, far = rays.hits(origins, directions)
    ends = np.full(len(far), 0.5, dtype=np.float32) * far
    assert (rays.hits(origins, directions, ends)[0] == -1).all()
    for origin, direction, face, distance in zip(origins, directions, faces, far, strict=True):
        met = oracles.crossings(
            origin.astype(float), direction.astype(float), mesh.normalized, mesh.faces
        )
        ahead = [(t, f) for f, t in met if t > 1e-9]
        assert (face >= 0) == bool(ahead)
        if ahead:
            assert distance == pytest.approx(min(ahead)[0], abs=rounding)
            assert any(f == face and t - min(ahead)[0] < rounding for t, f in ahead)
