"""The planar oracle of three contacts, against hulls, linear programs and brute force."""

import itertools
import math

import numpy as np
import pytest
from numpy.typing import NDArray

from grasp3d import Contacts, critical_friction_angle, force_closure, load_mesh
from grasp3d.arrays import unit_rows
from tests.helpers import coplanar, grasps, shapes
from tests.helpers.random_grasps import Shape, random_contacts, regular_contacts
from tests.helpers.solids import box_mesh

Floats = NDArray[np.float64]

LIMIT = math.pi / 2.0 - 1e-6


def random_triples(count: int, seed: int) -> tuple[Floats, Floats]:
    """Three random contacts with random normals: many are never force-closed below 90 degrees."""
    rng = np.random.default_rng(seed)
    points, normals = rng.normal(size=(2, count, 3, 3))
    return points, unit_rows(normals)


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
    """The package's own plane has the same angles."""
    found = coplanar.critical_angles(points, normals)
    own = critical_friction_angle(Contacts(points, normals, 0.5), tolerance=1e-6)
    assert np.minimum(found, LIMIT) == pytest.approx(np.minimum(own, LIMIT), abs=3e-6), name
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


@pytest.mark.slow
def test_the_angle_of_caps_is_the_largest_of_their_normals() -> None:
    """No normals of the caps need more friction, and those that oppose the direction need it."""
    rng, count = np.random.default_rng(8), 400
    noise = rng.normal(size=(3, count, 3, 3))
    points = grasps.TRIANGLE + 0.2 * noise[0]
    normals, radii = unit_rows(-points + 0.2 * noise[1]), rng.uniform(0.0, 0.3, (count, 3))
    caps = coplanar.planar_grasps(points, normals, radii)
    worst = caps.critical_angles(np.full(count, LIMIT), 1e-6)
    largest = np.zeros(count)
    for _ in range(300):
        around = unit_rows(np.cross(normals, rng.normal(size=normals.shape)))
        turned = np.cos(radii)[..., None] * normals + np.sin(radii)[..., None] * around
        largest = np.fmax(largest, coplanar.critical_angles(points, turned, tolerance=1e-5))
    assert (largest <= worst + 2e-5).all()
    closed = np.isfinite(worst)
    assert closed.sum() > 100
    assert np.median((worst - largest)[closed]) < 0.03


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
    angles = search.grasps(which).critical_angles(np.full(len(which), limit), 1e-5)
    best = np.full(len(search.vertices), limit)
    np.fmin.at(best, which, angles[:, None])
    assert search.tested < len(which) / 2
    assert np.minimum(found, limit) == pytest.approx(best, abs=2e-4)
    assert (best < limit).mean() > 0.9
