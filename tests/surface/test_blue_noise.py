import math
import time

import numpy as np
import pytest
from numpy.typing import NDArray
from scipy.spatial import cKDTree

from grasp3d import ObjectMesh, load_mesh
from grasp3d.mesh.measures import face_areas
from grasp3d.surface.candidate_points import INSIDE, spread_points, spread_vertices
from tests.helpers import shapes
from tests.helpers.solids import box_mesh, sphere_mesh

Floats = NDArray[np.float64]

BALL = sphere_mesh(subdivisions=4)


def widest(count: int, area: float = 4.0 * math.pi) -> float:
    """Distance between the centres of so many discs in the densest packing of an area."""
    return 2.0 * math.sqrt(area / (2.0 * math.sqrt(3.0) * count))


def nearest(points: Floats) -> Floats:
    return np.asarray(cKDTree(points).query(points, 2)[0][:, 1])


def spacing(points: Floats) -> float:
    """Smallest distance between two points, relative to the largest possible on the ball."""
    return float(nearest(points).min()) / widest(len(points))


def positions(mesh: ObjectMesh, count: int, seed: int) -> Floats:
    return spread_points(mesh, count, seed=seed).positions(mesh)


@pytest.mark.slow
def test_samples_have_the_distances_of_a_poisson_disk_set() -> None:
    """Seven tenths of the densest packing's; independent uniform points come much closer."""
    spread = [spacing(positions(BALL, 200, seed)) for seed in range(8)]
    assert min(spread) > 0.64
    assert np.mean(spread) > 0.68
    points = np.random.default_rng(0).normal(size=(200, 3))
    assert spacing(points / np.linalg.norm(points, axis=1, keepdims=True)) < 0.25


def test_every_beginning_is_evenly_spread() -> None:
    points = positions(BALL, 1000, 0)
    chosen = spread_vertices(BALL, 10**6)
    assert sorted(chosen.tolist()) == list(range(len(BALL.vertices)))
    for count in (2, 3, 4, 7, 10, 16, 31, 62, 100, 125, 250, 333, 500, 700, 999):
        assert spacing(points[:count]) > 0.55
        assert spacing(BALL.vertices[chosen[:count]]) > 0.5


def test_samples_lie_strictly_inside_faces() -> None:
    mesh = box_mesh(max_edge=1.0)
    samples = spread_points(mesh, 2000, seed=3)
    assert samples.faces.shape == (2000,)
    assert samples.weights.min() >= INSIDE
    assert samples.weights.sum(axis=1) == pytest.approx(1.0)
    assert np.abs(samples.positions(mesh)).max(axis=1) == pytest.approx(1.0)


def test_only_the_seed_changes_the_samples() -> None:
    vertices, faces = shapes.sphere(3)
    mesh, moved = load_mesh((vertices, faces)), load_mesh((1024.0 * vertices + 4096.0, faces))
    one, two = spread_points(mesh, 40, seed=5), spread_points(moved, 40, seed=5)
    assert np.array_equal(one.faces, two.faces)
    assert not np.array_equal(one.faces, spread_points(mesh, 40, seed=6).faces)
    chosen = [spread_vertices(mesh, 50, seed=seed) for seed in (5, 5, 6)]
    assert np.array_equal(chosen[0], chosen[1])
    assert not np.array_equal(chosen[0], chosen[2])


def test_samples_are_distributed_by_area() -> None:
    """A box of 1 x 2 x 4: each pair of sides gets its fraction, more evenly than by chance."""
    extents = np.array([1.0, 2.0, 4.0])
    mesh = box_mesh((1.0, 2.0, 4.0), max_edge=0.5)
    fractions = (1.0 / extents) / (1.0 / extents).sum()
    errors = []
    for seed in range(10):
        points = positions(mesh, 300, seed)
        box_sides = np.argmax(np.abs(points) / (0.5 * extents), axis=1)
        errors.append(np.bincount(box_sides, minlength=3) - 300 * fractions)
    chance = np.sqrt(300 * fractions * (1.0 - fractions))
    assert (np.sqrt(np.mean(np.square(errors), axis=0)) < 0.7 * chance).all()


def test_both_sides_of_a_thin_plate_are_sampled_independently() -> None:
    """About as many points on either side, with the distances of a single sheet."""
    mesh = box_mesh((2.0, 2.0, 0.002), max_edge=0.2)
    for seed in range(4):
        points = positions(mesh, 200, seed)
        top, bottom = points[points[:, 2] > 0.0009], points[points[:, 2] < -0.0009]
        assert abs(len(top) - len(bottom)) <= 12
        for side in (top, bottom):
            assert nearest(side).min() > 0.6 * widest(100, 4.0)
        to_other_side = cKDTree(top).query(bottom)[0]
        assert to_other_side.min() < 0.3 * widest(100, 4.0)  # the sides are independent


def test_a_few_samples_fit_on_a_single_triangle_and_many_on_a_tiny_mesh() -> None:
    mesh = load_mesh((np.eye(3), [[0, 1, 2]]), max_edge=10.0)
    for count in (1, 2, 3):
        assert spread_points(mesh, count).faces.tolist() == [0] * count
        assert spread_vertices(mesh, count).shape == (count,)
    assert sorted(spread_vertices(mesh, 100).tolist()) == [0, 1, 2]
    many = positions(load_mesh(shapes.box(), max_edge=10.0), 300, 0)
    assert nearest(many).min() > 0.55 * widest(300, 6.0)


def test_duplicates_and_loose_vertices_are_never_chosen() -> None:
    vertices, faces = shapes.box()
    split = np.vstack([vertices[faces].reshape(-1, 3), [[9.0, 9.0, 9.0]]])
    mesh = load_mesh((split, np.arange(3 * len(faces)).reshape(-1, 3)), max_edge=10.0)
    chosen = spread_vertices(mesh, 50)
    assert sorted(chosen.tolist()) == np.unique(mesh.faces).tolist()
    assert len(chosen) == 8


@pytest.mark.slow
def test_dense_vertices_are_thinned_without_computing_every_pair() -> None:
    """Nine tenths of the vertices in a hundredth of the area, on a little knob."""
    vertices, faces = shapes.sphere(5)
    knob = vertices[:, 2] > -0.8
    vertices[knob] = (0.0, 0.0, -0.8) + 0.03 * (vertices[knob] - (0.0, 0.0, -0.8))
    mesh = load_mesh((vertices, faces), max_edge=10.0)
    started = time.perf_counter()
    chosen = spread_vertices(mesh, 10**6)
    assert time.perf_counter() - started < 20.0  # 40 million pairs within reach of each other
    assert len(chosen) == len(vertices)
    assert np.mean(knob) > 0.85
    assert knob[chosen[:30]].sum() <= 4  # its opposite sides are independent
    off_knob = chosen[:30][~knob[chosen[:30]]]
    area = float(face_areas(mesh.vertices, mesh.faces).sum())
    assert nearest(mesh.vertices[off_knob]).min() > 0.4 * widest(30, area)
