import math

import numpy as np
import pytest

from grasp3d import MeshOptions, load_mesh
from grasp3d.errors import MeshError
from grasp3d.mesh.noise import random_field
from grasp3d.mesh.noisy_copies import MovableSurface, movable_surface, noise_length
from tests.helpers import shapes

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
def test_it_is_in_the_unit_of_the_mesh() -> None:
    small, large = noise_length(ball(0.004)), noise_length(ball(0.004, 1000.0))
    assert small == pytest.approx(0.004, rel=0.15)
    assert large == pytest.approx(1000.0 * small, rel=1e-6)


@pytest.mark.slow
def test_more_noise_is_more() -> None:
    found = [noise_length(ball(noise)) for noise in (0.001, 0.003, 0.01)]
    assert found == sorted(found)
    assert found[2] > 5.0 * found[0]


def test_a_smooth_surface_has_none() -> None:
    box = movable_surface(shapes.box(), MeshOptions(max_edge=0.2))
    with pytest.raises(MeshError, match="no noise that can be measured"):
        noise_length(box)
    assert math.isfinite(noise_length(ball(0.002)))
