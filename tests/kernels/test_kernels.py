import json
import math
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d._kernels.search.antipodal_candidates import no_pairs, scan
from grasp3d._kernels.search.rays import Origins, seed_rays
from grasp3d._kernels.surface.surface_contacts import (
    ContactNormals,
    largest_angle,
    order_normal_sets,
    smallest_angle,
)
from grasp3d.arrays import Floats
from tests.helpers import oracles

seeds = st.integers(0, 100_000)


def unit(rng: np.random.Generator) -> np.ndarray:
    vector = rng.normal(size=3)
    return vector / np.linalg.norm(vector)


def polygon(normals: np.ndarray) -> tuple[np.ndarray, int, np.ndarray, float]:
    rows = np.ascontiguousarray(normals, dtype=np.float64).copy()
    start = np.array([0, len(rows)])
    counts, centres, radii = np.zeros(1, dtype=np.int64), np.zeros((1, 3)), np.zeros(1)
    order_normal_sets(start, rows, counts, centres, radii)
    return rows, int(counts[0]), centres[0], float(radii[0])


@pytest.mark.slow
@given(seeds, st.integers(1, 7), st.floats(0.05, 1.2))
@settings(max_examples=40, deadline=None)
def test_smallest_and_largest_angle_to_a_set_of_normals(
    seed: int, count: int, spread: float
) -> None:
    rng = np.random.default_rng(seed)
    middle = unit(rng)
    normals = np.array([oracles.tilted(middle, spread, rng) for _ in range(count)])
    rows, corners, _, _ = polygon(normals)
    direction = unit(rng)
    least = smallest_angle(rows, 0, corners, *direction)
    most = largest_angle(rows, 0, corners, *direction)
    assert least == pytest.approx(oracles.smallest_angle(normals, direction), abs=2e-3)
    assert most == pytest.approx(math.pi - oracles.smallest_angle(normals, -direction), abs=2e-3)


def test_known_sets_of_normals() -> None:
    """One normal, an arc of a great circle, and opposite ones, which allow every direction."""
    for tiny in (0.0, 1e-12, 1e-9):
        normal = np.array([[1.0, 0.0, 0.0]])
        turned = (math.cos(tiny), math.sin(tiny), 0.0)
        assert smallest_angle(normal, 0, 1, *turned) == pytest.approx(tiny, rel=1e-9)
        assert largest_angle(normal, 0, 1, -1.0, 0.0, 0.0) == math.pi
    turns = np.radians([0.0, 10.0, 25.0, 40.0])
    rows, corners, _, _ = polygon(np.stack([np.cos(turns), np.sin(turns), 0 * turns], axis=1))
    assert corners == 2
    assert smallest_angle(rows, 0, corners, 0.0, 1.0, 0.0) == pytest.approx(math.radians(50.0))
    _, corners, _, radius = polygon(np.eye(3))
    assert (corners, radius) == (3, pytest.approx(math.acos(1.0 / math.sqrt(3.0))))
    rows, corners, _, radius = polygon(np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]))
    assert (corners, radius) == (0, math.pi)
    assert smallest_angle(rows, 0, corners, 1.0, 0.0, 0.0) == 0.0
    assert largest_angle(rows, 0, corners, 1.0, 0.0, 0.0) == math.pi


def critical_angle(p1: np.ndarray, n1: np.ndarray, p2: np.ndarray, n2: np.ndarray) -> float:
    sets = ContactNormals(np.array([0, 1]), np.array([1]), n2[None].copy())
    worst, best, signs = np.empty(1), np.empty(1), np.empty(1, dtype=np.int8)
    scan(p1, n1[None].copy(), p2[None].copy(), sets, worst, best, signs)
    assert worst == best
    return float(worst[0])


@pytest.mark.slow
@given(seeds)
@settings(max_examples=100, deadline=None)
def test_two_fingers_against_the_definition(seed: int) -> None:
    rng = np.random.default_rng(seed)
    grasp = (rng.normal(size=3), unit(rng), rng.normal(size=3), unit(rng))
    assert critical_angle(*grasp) == pytest.approx(oracles.critical_angle(*grasp), abs=1e-12)


def initial_directions(sets: ContactNormals, centre: Floats, radius: float, cone: float) -> Floats:
    """Closing directions of the first 500 rays of one vertex."""
    nowhere = np.zeros((1, 3))
    tangent = np.cross(centre, [0.6, 0.8, 0.1])[None]
    tangent /= np.linalg.norm(tangent)
    around = np.zeros(2, dtype=np.int64), np.zeros(0, dtype=np.int64)
    origins = Origins(nowhere, sets, centre[None], tangent, np.array([radius]), around, cone)
    rays = seed_rays(np.array([0]), 500, (0, 500), origins, no_pairs(1, 3, 1.0))
    assert set(rays.owner) == {0}
    return np.array(rays.closing)


@pytest.mark.slow
def test_initial_directions_fill_their_cone_and_begin_with_the_normal() -> None:
    normal, cone = np.array([0.0, 0.0, 1.0]), 0.7
    sets = ContactNormals(np.array([0, 1]), np.array([1]), normal[None])
    closing = initial_directions(sets, normal, 0.0, cone)
    assert len(closing) == 500
    assert closing[0] == pytest.approx(normal)
    assert np.linalg.norm(closing, axis=1) == pytest.approx(np.ones(500))
    heights = closing[:, 2]
    assert heights.min() >= math.cos(cone)
    # As many in every slice of equal area, and balanced all around.
    slices = np.histogram(heights, bins=5, range=(math.cos(cone), 1.0))[0]
    assert slices.min() >= 95
    assert np.abs(closing[:, :2].mean(axis=0)).max() < 0.02


def test_initial_directions_at_a_crease_cover_both_cones() -> None:
    rows, corners, centre, radius = polygon(np.array([[0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]))
    sets, cone = ContactNormals(np.array([0, 2]), np.array([corners]), rows), 0.5
    closing = initial_directions(sets, centre, radius, cone)
    assert max(smallest_angle(rows, 0, corners, *d) for d in closing) <= cone
    assert 0.95 * (radius + cone) < np.arccos(closing @ centre).max() <= radius + cone + 1e-12
    for normal in rows[:2]:
        assert np.abs(closing - normal).sum(axis=1).min() < 1e-12
        assert (closing @ normal > math.cos(cone)).sum() > 40


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "chosen"),
    [("test_kernels", "not compilation"), ("test_growing_hull", "nearest or cubes")],
)
def test_kernels_compute_the_same_without_compilation(name: str, chosen: str) -> None:
    path = Path(__file__).with_name(f"{name}.py")
    command = [sys.executable, "-m", "pytest", "-q", path, "-k", chosen, "-p", "no:cacheprovider"]
    subprocess.run(command, check=True, env={**os.environ, "NUMBA_DISABLE_JIT": "1"})


EPSILONS = """
import json
from grasp3d import epsilon
from grasp3d._kernels.hull import growing_hull
from tests.helpers.grasps import at_angle, random_grasp

found = [
    epsilon(at_angle(grasp, 0.9), edges=edges)
    for grasp in (random_grasp(2, 1, soft=True), random_grasp(3, 1)) for edges in (None, 6)
]
numbers = [[float(one.lower), float(one.upper), bool(one.closed)] for one in found]
print(json.dumps([hasattr(growing_hull.grow, "py_func"), numbers]))
"""
"""Prints whether kernels are compiled, and bounds of hard and soft grasps, force-closed or not."""


@pytest.mark.slow
def test_epsilon_is_the_same_without_compilation() -> None:
    root = Path(__file__).parents[2]
    path = os.pathsep.join([str(root), str(root / "scripts")])
    (compiled, expected), (same, found) = (
        json.loads(subprocess.check_output(
            [sys.executable, "-c", EPSILONS],
            env={**os.environ, "PYTHONPATH": path, "NUMBA_DISABLE_JIT": disabled},
        ))
        for disabled in ("0", "1")
    )  # fmt: skip
    assert (compiled, same) == (True, False)
    np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
    assert {closed for *_, closed in expected} == {True, False}
