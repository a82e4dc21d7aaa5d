"""The planar oracle of three contacts, against hulls, linear programs and brute force."""

import itertools
import math

import numpy as np
import pytest
from numpy.typing import NDArray
from random_grasps import Shape, random_contacts, regular_contacts

from grasp3d import Contacts, critical_friction_angle, force_closure, load_mesh
from grasp3d.mesh.primitives import box_mesh
from tests.helpers import coplanar, grasps, oracles, shapes

Floats = NDArray[np.float64]

LIMIT = math.pi / 2.0 - 1e-6


def random_triples(count: int, seed: int) -> tuple[Floats, Floats]:
    """Three random contacts with random normals: many are never force-closed below 90 degrees."""
    rng = np.random.default_rng(seed)
    points, normals = rng.normal(size=(2, count, 3, 3))
    return points, normals / np.linalg.norm(normals, axis=2, keepdims=True)


def families() -> list[tuple[str, Floats, Floats]]:
    around = random_contacts(Shape(3, 8, soft=False), 3000, 1)
    found = [("around a ball", around.points, around.normals), ("random", *random_triples(3000, 2))]
    for noise in (1e-1, 1e-3, 1e-6):
        some = regular_contacts("three at 120 deg", 200, noise, 3)
        found.append((f"regular, noise {noise:g}", some.points, some.normals))
    return found


@pytest.mark.slow
@pytest.mark.parametrize(("name", "points", "normals"), families())
def test_hulls_are_force_closed_just_above_the_angle_and_not_just_below(
    name: str, points: Floats, normals: Floats
) -> None:
    found = coplanar.critical_angles(points, normals)
    assert not np.isnan(found).any()
    finite = np.isfinite(found)
    assert finite.any()
    for rows, beta, closed in (
        (finite, found + 1e-4, True),
        (finite & (found > 2e-4), found - 1e-4, False),
        (~finite, np.full(len(found), 1.5), False),
    ):
        friction = np.tan(np.minimum(beta, 1.55))[rows, None]
        sure = beta[rows] < 1.55
        answer = force_closure(Contacts(points[rows], normals[rows], friction))
        assert (answer.closed[sure] == closed).all(), name


@pytest.mark.slow
@pytest.mark.parametrize(("name", "points", "normals"), families())
def test_the_package_computes_the_same_angle(name: str, points: Floats, normals: Floats) -> None:
    expected = coplanar.critical_angles(points, normals)
    found = critical_friction_angle(Contacts(points, normals, 0.5), tolerance=1e-6)
    assert np.minimum(expected, LIMIT) == pytest.approx(np.minimum(found, LIMIT), abs=3e-6), name


@pytest.mark.slow
def test_linear_programs_over_polygonal_cones_agree() -> None:
    points, normals = (np.concatenate([f[k] for f in families()[:2]]) for k in (1, 2))
    found = coplanar.critical_angles(points, normals)
    rows = np.flatnonzero((found > 0.05) & (found < 1.4))[::60]
    assert len(rows) > 60
    for row in rows:
        for beta, closed in ((found[row] + 0.02, True), (found[row] - 1e-4, False)):
            edges = [oracles.cone_edges(n, beta, 90) for n in normals[row]]
            wrenches = [
                np.hstack([f, np.cross(p, f)]) for p, f in zip(points[row], edges, strict=True)
            ]
            assert oracles.hull_contains_origin(np.vstack(wrenches)) == closed


def test_known_angles() -> None:
    """Three at 120 degrees: 0; on one face: infinite; collinear: nan.

    Two opposing contacts and a third orthogonal to them: 0.
    """
    ring = grasps.TRIANGLE
    down = np.tile([0.0, 0.0, -1.0], (3, 1))
    tee = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    points = np.stack([ring, ring, grasps.LINE.points, tee])
    normals = np.stack([-ring, down, grasps.LINE.normals, -tee])
    found = coplanar.critical_angles(points, normals)
    assert found[[0, 3]] == pytest.approx(0.0, abs=2e-6)
    assert math.isinf(found[1])
    assert math.isnan(found[2])


def worst_angle(points: Floats, sets: list[Floats]) -> float:
    """Worst angle over all combinations of normals of one grasp, from their common cones."""
    grasp = coplanar.planar_grasps(points[None], sets, np.arange(3)[None])
    return float(grasp.critical_angles(np.array([LIMIT]), 1e-6)[0])


def angles_of_combinations(points: Floats, sets: list[Floats]) -> tuple[Floats, Floats]:
    """(normals, angles) of every combination by itself."""
    normals = np.array(list(itertools.product(*sets)))
    every = np.broadcast_to(points, normals.shape)
    return normals, coplanar.critical_angles(every, normals, tolerance=2e-4)


def corners_of_sets(points: Floats, rng: np.random.Generator) -> list[Floats]:
    """For each contact one normal, the two of a crease, or the three of a box's corner."""
    found = []
    for point in points:
        middle = -point / np.linalg.norm(point) + 0.3 * rng.normal(size=3)
        kind = rng.integers(3)
        corners = middle + (kind > 0) * rng.uniform(0.05, 0.8) * rng.normal(size=(1 + kind, 3))
        if kind == 2:
            corners = shapes.rotation(int(rng.integers(1 << 30)))
            corners *= np.sign(corners @ middle)[:, None]
        found.append(corners / np.linalg.norm(corners, axis=1, keepdims=True))
    return found


@pytest.mark.slow
def test_the_worst_of_all_combinations_on_creases() -> None:
    """Single combinations, varied contact by contact, reach the worst angle but never exceed it."""
    rng = np.random.default_rng(5)
    shortfalls = []
    for _ in range(30):
        points = grasps.TRIANGLE + 0.2 * rng.normal(size=(3, 3))
        sets = [coplanar.sampled_normals(some) for some in corners_of_sets(points, rng)]
        worst = worst_angle(points, sets)
        normals, reached = angles_of_combinations(
            points, [some[:: max(1, len(some) // 5)] for some in sets]
        )
        for start in np.argsort(-reached)[:2]:
            chosen, best = normals[start], reached[start]
            for contact in (0, 1, 2) * 2:
                varied = [some[None] for some in chosen]
                varied[contact] = sets[contact]
                near, angles = angles_of_combinations(points, varied)
                chosen, best = near[np.argmax(angles)], angles.max()
            assert worst >= best - 2.5e-4
            reached[start] = best
        if np.isfinite(worst):
            shortfalls.append(worst - reached.max())
    assert len(shortfalls) > 9
    assert np.mean(np.array(shortfalls) < 2e-3) > 0.8


@pytest.mark.slow
def test_all_combinations_on_two_creases() -> None:
    rng = np.random.default_rng(8)
    compared = 0
    for _ in range(25):
        points = grasps.TRIANGLE + 0.2 * rng.normal(size=(3, 3))
        middles = -points + 0.2 * rng.normal(size=(3, 3))
        spread = rng.uniform(0.1, 1.0) * rng.normal(size=3)
        corners = [middles[:1], *(np.stack([m + spread, m - spread]) for m in middles[1:])]
        corners = [rows / np.linalg.norm(rows, axis=1, keepdims=True) for rows in corners]
        sets = [coplanar.sampled_normals(rows) for rows in corners]
        worst, largest = worst_angle(points, sets), angles_of_combinations(points, sets)[1].max()
        assert np.isfinite(worst) == np.isfinite(largest)
        if np.isfinite(worst):
            assert worst == pytest.approx(largest, abs=2e-3)
            compared += 1
    assert compared > 9


@pytest.mark.slow
@pytest.mark.parametrize("shape", ["ball", "box"])
def test_the_exhaustive_search_misses_no_grasp(shape: str) -> None:
    """Compared with the angles of all triples of a very coarse mesh."""
    if shape == "ball":
        vertices, faces = shapes.sphere(1)
        mesh = load_mesh((vertices * (1.0, 0.8, 1.3), faces), max_edge=10.0)
    else:
        mesh = box_mesh((2.0, 1.6, 1.0), max_edge=1.3)
    limit = math.radians(80.0)
    search = coplanar.Exhaustive(mesh, limit, 2e-4)
    found = search.run()
    which = np.array(list(itertools.combinations(range(len(search.vertices)), 3)))
    all_grasps = coplanar.planar_grasps(search.points[which], search.normals, which)
    angles = all_grasps.critical_angles(np.full(len(which), limit), 1e-5)
    best = np.full(len(search.vertices), limit)
    np.fmin.at(best, which, angles[:, None])
    assert search.tested < len(which) / 2
    assert np.minimum(found, limit) == pytest.approx(best, abs=2e-4)
    assert (best < limit).mean() > 0.9
