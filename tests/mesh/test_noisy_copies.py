import math

import numpy as np
import pytest

from grasp3d import MeshOptions, ObjectMesh, label_surface, load_mesh
from grasp3d._kernels.search.antipodal_candidates import TIE
from grasp3d._kernels.search.face_minimum import RESOLVED
from grasp3d.errors import MeshError
from grasp3d.mesh.noise import random_field
from grasp3d.mesh.noisy_copies import MovableSurface, movable_surface, noise_length
from tests.helpers import shapes
from tests.helpers.repairs import joined, moved

SOLIDS = {
    "box": shapes.box(),  # creases, and all edges are divided
    "cone": shapes.cone(0.3, sections=12),  # long thin triangles
    "ball": shapes.sphere(2),
    "tube": shapes.tube(),
    "two boxes": joined(shapes.box(), moved(shapes.box(), (3.0, 3.0, 3.0))),
    "open": (shapes.box()[0], shapes.box()[1][2:]),
}


def corners(mesh: ObjectMesh) -> np.ndarray:
    """Normals at the corners of the faces, (F, 3, 3)."""
    found: np.ndarray = mesh.corner_normals.normals[mesh.corner_normals.corners]
    return found


@pytest.mark.slow
@pytest.mark.parametrize("name", SOLIDS)
def test_without_shifts_a_copy_is_the_mesh(name: str) -> None:
    surface = movable_surface(SOLIDS[name])
    copy, mesh = surface.moved(np.zeros(surface.points.shape)), surface.mesh
    given = load_mesh(SOLIDS[name])
    np.testing.assert_array_equal(given.faces, mesh.faces)
    np.testing.assert_allclose(copy.vertices, mesh.vertices, atol=1e-14 * mesh.size)
    np.testing.assert_allclose(corners(copy), corners(mesh), atol=1e-14)
    assert len(copy.corner_normals.normals) == len(mesh.corner_normals.normals)
    np.testing.assert_array_equal(copy.normal_sets.counts, mesh.normal_sets.counts)
    one, two = copy.contact_surface.twins, mesh.contact_surface.twins
    np.testing.assert_array_equal(one < 0, two < 0)


def test_a_copy_has_the_labels_of_the_mesh() -> None:
    surface = movable_surface(shapes.box((2.0, 1.0, 1.0)), MeshOptions(max_edge=0.3))
    copy = surface.moved(np.zeros(surface.points.shape))
    for name in ("critical_angle", "critical_angle_best", "opening"):
        one, two = (getattr(label_surface(mesh), name) for mesh in (surface.mesh, copy))
        # Better angles are searched for, and kept, from these steps: rounding decides which of two
        # equal faces is taken.
        tolerance = 1e-12 if name == "opening" else RESOLVED + TIE
        np.testing.assert_allclose(one, two, atol=tolerance)


@pytest.mark.parametrize("name", ["ball", "cone"])
def test_a_moved_copy_is_the_mesh_of_the_moved_surface(name: str) -> None:
    """Undivided, it is what reading the moved vertices gives."""
    points, faces = SOLIDS[name]
    options = MeshOptions(max_edge=9.0)
    surface = movable_surface((points, faces), options)
    shifts = np.random.default_rng(1).normal(0.0, 0.02, surface.points.shape)
    copy, read = surface.moved(shifts), load_mesh((points + shifts, faces), options)
    np.testing.assert_allclose(copy.vertices, read.vertices, atol=1e-12)
    np.testing.assert_allclose(corners(copy), corners(read), atol=1e-9)
    np.testing.assert_array_equal(copy.normal_sets.counts, read.normal_sets.counts)


def test_vertices_that_divide_edges_stay_on_their_faces() -> None:
    surface = movable_surface(shapes.box())
    assert len(surface.points) == 8 < len(surface.mesh.vertices)
    copy = surface.moved(np.random.default_rng(2).normal(0.0, 0.05, (8, 3)))
    given = copy.vertices[surface.repaired.faces[surface.parents]]  # (F, 3, 3)
    normals = np.cross(given[:, 1] - given[:, 0], given[:, 2] - given[:, 0])
    offsets = copy.vertices[copy.faces] - given[:, :1]
    assert np.abs(np.einsum("fkc,fc->fk", offsets, normals)).max() < 1e-12


def test_vertices_at_one_position_move_together() -> None:
    soup = (shapes.sphere(1)[0][shapes.sphere(1)[1]].reshape(-1, 3), np.arange(240).reshape(-1, 3))
    surface = movable_surface(soup, MeshOptions(max_edge=9.0))
    shifts = np.random.default_rng(3).normal(0.0, 0.01, surface.points.shape)
    copy = surface.moved(shifts)
    assert len(surface.points) == 42
    np.testing.assert_array_equal(copy.vertices, copy.vertices[copy.canonical])


def test_the_patch_of_a_fingertip_is_that_of_the_copy() -> None:
    points, faces = shapes.sphere(3)
    options = MeshOptions(max_edge=9.0, patch_radius=0.3)
    surface = movable_surface((points, faces), options)
    shifts = np.random.default_rng(4).normal(0.0, 0.02, points.shape)
    copy, read = surface.moved(shifts), load_mesh((points + shifts, faces), options)
    # Both are in units of their own size, by which the radius is divided.
    np.testing.assert_allclose(copy.normals, read.normals, atol=1e-6)


def test_an_object_mesh_keeps_its_options() -> None:
    mesh = load_mesh(shapes.sphere(2), max_edge=0.2, unit="cm")
    surface = movable_surface(mesh)
    assert surface.mesh.options == mesh.options
    assert len(surface.points) == len(mesh.vertices)


FINE = 40.0
"""Edges per size of a scan."""


def scan_of(
    name: str, noise: float, correlation: float, seed: int = 1
) -> tuple[MovableSurface, float]:
    """A shipped mesh as a scan with noise and correlation in mean edges; and the noise."""
    path = shapes.LIBRARY / name
    fine = load_mesh(path, unit="m", max_edge=load_mesh(path, unit="m").size / FINE)
    undivided = MeshOptions(unit="m", max_edge=fine.size)
    clean = movable_surface((fine.vertices, fine.faces), undivided)
    sigma, length = noise * clean.mean_edge, correlation * clean.mean_edge
    field = random_field(clean.points, clean.normals, length, np.random.default_rng(seed))
    scan = clean.moved(sigma * field[:, None] * clean.normals)
    return movable_surface((scan.vertices, scan.faces), undivided), sigma


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "noise"), [("banana.ply", 0.1), ("hammer.ply", 0.05), ("spray.glb", 0.2)]
)
def test_known_noise_of_shipped_meshes_is_found(name: str, noise: float) -> None:
    scan, sigma = scan_of(name, noise, 0.0)
    assert noise_length(scan) == pytest.approx(sigma, rel=0.2)


@pytest.mark.slow
@pytest.mark.parametrize("correlation", [1.0, 2.0])
def test_known_correlated_noise_is_found(correlation: float) -> None:
    """Without the correlation only a third to two thirds of it would be found."""
    scan, sigma = scan_of("hammer.ply", 0.1, correlation)
    assert noise_length(scan, correlation * scan.mean_edge) == pytest.approx(sigma, rel=0.25)
    assert noise_length(scan) < 0.7 * sigma


def ball(noise: float, scale: float = 1.0) -> MovableSurface:
    points, faces = shapes.sphere(4, radius=scale)
    errors = np.random.default_rng(0).normal(0.0, noise, len(points))
    options = MeshOptions(max_edge=9.0 * scale)
    return movable_surface((points * (1.0 + errors)[:, None], faces), options)


@pytest.mark.slow
def test_measured_noise_is_in_the_unit_of_the_mesh() -> None:
    small, large = noise_length(ball(0.004)), noise_length(ball(0.004, 1000.0))
    assert small == pytest.approx(0.004, rel=0.15)
    assert large == pytest.approx(1000.0 * small, rel=1e-6)


@pytest.mark.slow
def test_more_noise_measures_as_more() -> None:
    found = [noise_length(ball(noise)) for noise in (0.001, 0.003, 0.01)]
    assert found == sorted(found)
    assert found[2] > 5.0 * found[0]


def test_a_smooth_surface_has_no_noise() -> None:
    box = movable_surface(shapes.box(), MeshOptions(max_edge=0.2))
    with pytest.raises(MeshError, match="no noise that can be measured"):
        noise_length(box)
    assert math.isfinite(noise_length(ball(0.002)))
