import math

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial import ConvexHull

from grasp3d import load_mesh
from grasp3d.mesh.diagnosis import normal_noise
from grasp3d.mesh.measures import Triangles
from grasp3d.mesh.mesh_files import read_mesh
from grasp3d.mesh.normals import corner_normals
from grasp3d.mesh.repair import repair_surface
from tests.helpers import shapes
from tests.helpers.shapes import Surface

HALF_DEGREE = math.radians(0.5)


def uneven_sphere(count: int) -> Surface:
    """A sphere of triangles of all sizes."""
    points = np.random.default_rng(0).normal(size=(count, 3))
    points /= np.linalg.norm(points, axis=1)[:, None]
    faces = ConvexHull(points).simplices.astype(np.int64)
    a, b, c = points[faces].swapaxes(0, 1)
    inside_out = (np.cross(b - a, c - a) * a).sum(axis=1) < 0.0
    faces[inside_out] = faces[inside_out][:, ::-1]
    return points, faces


def cylinder_side(stretch: float) -> Surface:
    """An open cylinder of 96 by 30 quadrangles of an aspect ratio."""
    angle = np.linspace(0.0, 2.0 * np.pi, 96, endpoint=False)
    height = np.arange(30)[:, None] * stretch * 2.0 * np.pi / 96.0
    grid = np.broadcast_arrays(np.cos(angle)[None], np.sin(angle)[None], height)
    i, j = np.meshgrid(np.arange(29) * 96, np.arange(96), indexing="ij")
    a, b = i + j, i + (j + 1) % 96
    faces = [np.stack([a, b, b + 96], -1), np.stack([a, b + 96, a + 96], -1)]
    return np.stack(grid, axis=-1).reshape(-1, 3), np.concatenate(faces).reshape(-1, 3)


def true_normals(name: str, points: np.ndarray) -> np.ndarray:
    """Outward normals of the smooth shape."""
    normals = points.copy()
    if "cylinder" in name:
        normals[:, 2] = 0.0
    if "torus" in name:
        normals[:, :2] *= 1.0 - 1.0 / np.linalg.norm(points[:, :2], axis=1)[:, None]
    return normals / np.linalg.norm(normals, axis=1)[:, None]


def noisy(shape: Surface, sigma: float) -> np.ndarray:
    """Move each vertex by a Gaussian error, in units of the usual edge length."""
    points, faces = shape
    edge = np.median(np.linalg.norm(points[faces[:, 0]] - points[faces[:, 1]], axis=1))
    moved: np.ndarray = points + sigma * edge * np.random.default_rng(1).normal(size=points.shape)
    return moved


def weighted_median(values: np.ndarray, weights: np.ndarray) -> float:
    order = np.argsort(values)
    total = np.cumsum(weights[order])
    return float(values[order][np.searchsorted(total, total[-1] / 2.0)])


ROUND = {
    "sphere": shapes.sphere(4),
    "uneven sphere": uneven_sphere(2000),
    "cylinder": cylinder_side(1.0),
    "long cylinder": cylinder_side(4.0),
    "torus": shapes.torus(),
}


@pytest.mark.slow
@pytest.mark.parametrize("sigma", [0.03, 0.1, 0.2, 0.5])
@pytest.mark.parametrize("name", ROUND)
def test_added_noise_is_measured(name: str, sigma: float) -> None:
    points, faces = noisy(ROUND[name], sigma), ROUND[name][1]
    found = corner_normals(Triangles(points, faces), math.pi)
    cosine = -(found.normals * true_normals(name, ROUND[name][0])[found.vertices]).sum(axis=1)
    weights = np.bincount(found.corners.ravel()).astype(np.float64)
    truth = weighted_median(np.arccos(np.clip(cosine, -1.0, 1.0)), weights)
    assert 0.75 * truth < normal_noise(Triangles(points, faces)) < 1.15 * truth


FLAT = {
    "box": shapes.box(),
    "plate": shapes.box((1.0, 0.1, 0.02)),
    "cylinder of 8": shapes.arrays(trimesh.creation.cylinder(0.5, 0.2, sections=8)),
    "cylinder of 32": shapes.arrays(trimesh.creation.cylinder(0.5, 2.0, sections=32)),
    "cone": shapes.cone(0.3),
    "tube": shapes.tube(),
    "tetrahedron": (
        np.vstack([np.zeros(3), np.eye(3)]),
        np.array([[0, 2, 1], [0, 1, 3], [1, 2, 3], [0, 3, 2]]),
    ),
    "one triangle": (np.eye(3), np.array([[0, 1, 2]])),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", FLAT)
def test_sharp_solids_have_no_noise_coarse_or_refined(name: str) -> None:
    assert normal_noise(Triangles(*FLAT[name])) < HALF_DEGREE
    mesh = load_mesh(FLAT[name])
    assert normal_noise(Triangles(mesh.vertices, mesh.faces)) < HALF_DEGREE


@pytest.mark.parametrize(
    "shape",
    [shapes.sphere(3), shapes.sphere(4), shapes.torus(), shapes.lopsided(), cylinder_side(4.0)],
)
def test_smooth_shapes_have_hardly_any_noise(shape: Surface) -> None:
    assert normal_noise(Triangles(*shape)) < HALF_DEGREE


def test_errors_of_normals_of_a_coarse_mesh_count_as_noise() -> None:
    points, faces = uneven_sphere(500)
    found = corner_normals(Triangles(points, faces), math.pi)
    cosine = -(found.normals * points[found.vertices]).sum(axis=1)
    truth = float(np.median(np.arccos(np.clip(cosine, -1.0, 1.0))))
    assert 0.7 * truth < normal_noise(Triangles(points, faces)) < 1.4 * truth


def test_creases_do_not_hide_noise_nor_add_to_it() -> None:
    box = load_mesh(shapes.box(), max_edge=0.05)
    inner = box.contact_normals.counts == 1
    for sigma in (0.02, 0.1, 0.3):
        points = noisy((box.vertices, box.faces), sigma)
        found = corner_normals(Triangles(points, box.faces), math.pi)
        cosine = (found.normals * box.normals[found.vertices]).sum(axis=1)[inner[found.vertices]]
        truth = float(np.median(np.arccos(np.clip(cosine, -1.0, 1.0))))
        assert normal_noise(Triangles(points, box.faces)) == pytest.approx(truth, rel=0.15)


def test_very_strong_noise_is_reported_as_large() -> None:
    for sigma in (2.0, 10.0):
        assert normal_noise(
            Triangles(noisy(ROUND["sphere"], sigma), ROUND["sphere"][1])
        ) > math.radians(60.0)


@settings(max_examples=20, deadline=None)
@given(seed=st.integers(0, 2**32), exponent=st.integers(-6, 6))
def test_noise_is_independent_of_size_rotation_and_order(seed: int, exponent: int) -> None:
    rng = np.random.default_rng(seed)
    points, faces = noisy((shapes.sphere(2)), 0.05), shapes.sphere(2)[1]
    order = rng.permutation(len(points))
    moved = np.empty_like(points)
    moved[order] = points @ shapes.rotation(seed).T * 10.0**exponent
    mixed = np.roll(order[faces], 1, axis=1)[rng.permutation(len(faces))]
    again = normal_noise(Triangles(moved, mixed))
    assert again == pytest.approx(normal_noise(Triangles(points, faces)), rel=1e-6)


@pytest.mark.slow
def test_shipped_meshes_are_clean() -> None:
    for path in sorted(shapes.LIBRARY.glob("*.*")):
        if path.suffix not in {".md", ".png"}:
            raw = read_mesh(path)
            surface = repair_surface(raw.vertices, raw.faces, "safe", path.name)
            assert normal_noise(Triangles(surface.vertices, surface.faces)) < math.radians(1.5)
