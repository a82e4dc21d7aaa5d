import math
import time

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import Contacts, critical_friction_angle, force_closure
from grasp3d.errors import SettingError
from grasp3d.quality.critical_angle import angle_brackets
from tests.helpers import grasps, oracles, shapes
from tests.helpers.random_grasps import Shape, random_contacts

RIGHT_ANGLE = math.pi / 2.0
TOLERANCE = 1e-4

seeds = st.integers(0, 100_000)
few = settings(max_examples=30, deadline=None)


def random_pair(seed: int) -> Contacts:
    """Two contacts with random points and normals."""
    rng = np.random.default_rng(seed)
    return Contacts(rng.normal(size=(2, 3)), rng.normal(size=(2, 3)))


@pytest.mark.slow
@given(st.integers(2, 5), seeds)
@settings(max_examples=60, deadline=None)
def test_a_grasp_is_force_closed_above_the_angle_and_not_below(count: int, seed: int) -> None:
    contacts = grasps.random_grasp(count, seed)
    angle = float(critical_friction_angle(contacts))
    if 1e-3 < angle < RIGHT_ANGLE:
        assert not force_closure(grasps.at_angle(contacts, angle - 1e-3)).closed
    if angle < RIGHT_ANGLE - 2e-3:
        assert force_closure(grasps.at_angle(contacts, max(angle, 0.0) + 1e-3)).closed


@given(st.integers(3, 4), seeds)  # of rank 5 two may be force-closed where three are not
@few
def test_another_contact_never_needs_more_friction(count: int, seed: int) -> None:
    more = grasps.random_grasp(count + 1, seed)
    less = grasps.one(more, np.arange(count))
    assert critical_friction_angle(more) <= critical_friction_angle(less) + TOLERANCE


@given(st.integers(3, 5), seeds)
@few
def test_no_direction_has_a_larger_angle(count: int, seed: int) -> None:
    """By definition the largest over all directions of the smallest angle to a normal."""
    contacts = grasps.random_grasp(count, seed)
    directions = np.random.default_rng(seed).normal(size=(2000, 6))
    angles = oracles.smallest_angles_to_normals(contacts.points, contacts.normals, directions)
    assert critical_friction_angle(contacts) >= angles.max() - RIGHT_ANGLE


@pytest.mark.slow
@given(seeds)
@settings(max_examples=200, deadline=None)
def test_two_contacts_have_their_closed_form(seed: int) -> None:
    contacts = random_pair(seed)
    expected = oracles.critical_angle(
        contacts.points[0], contacts.normals[0], contacts.points[1], contacts.normals[1]
    )
    assert critical_friction_angle(contacts) == pytest.approx(expected, abs=1e-12)


@pytest.mark.slow
@given(seeds)
@few
def test_contacts_at_one_point_push_along_their_best_line(seed: int) -> None:
    contacts = random_pair(seed)
    coincident = grasps.changed(contacts, points=np.tile(contacts.points[:1], (2, 1)))
    halfway = coincident.normals[0] - coincident.normals[1]
    expected = oracles.angle(coincident.normals[0], halfway)
    assert critical_friction_angle(coincident) == pytest.approx(expected, abs=1e-9)


@pytest.mark.slow
def test_angles_equal_those_of_the_reference() -> None:
    for case in grasps.reference("epsilon.json"):
        tolerance = 1e-6 if len(case["points"]) == 2 else 2.0 * TOLERANCE
        angle = critical_friction_angle(grasps.of_case(case))
        expected = pytest.approx(case["critical_friction_angle"], abs=tolerance)
        assert angle == expected, case["id"]


@pytest.mark.parametrize("count", [3, 8])
def test_brackets_are_open_at_one_end_and_closed_at_the_other(count: int) -> None:
    """With cones that differ, and with an angle that is to be decided exactly."""
    contacts = random_contacts(Shape(count, 8, soft=False), 40, seed=2)
    points, normals = contacts.points, contacts.normals
    wider = np.random.default_rng(count).uniform(-0.1, 0.1, size=(40, count))
    low, high = angle_brackets(points, normals, wider, tolerance=TOLERANCE)
    assert (high - low <= TOLERANCE + 1e-8).all()
    ends = []
    for angle in (low, high):
        cones = np.maximum(angle[:, None] + wider, 0.0)
        ends.append(force_closure(Contacts(points, normals, np.tan(cones))))
    inside = (high < RIGHT_ANGLE - 0.11) & (low > 0.11)
    assert inside.sum() > 10
    assert (ends[0].status == 0)[inside].all()
    assert not ends[0].closed[inside].any()
    assert ends[1].closed[inside].all()
    asked = 0.5 * (low + high) + 0.05 * np.random.default_rng(0).normal(size=40)
    sure = angle_brackets(points, normals, wider, first=asked, tolerance=math.inf)
    decided = inside & (np.abs(asked - high) > 2.0 * TOLERANCE) & (asked > 0.1)
    np.testing.assert_array_equal((sure[1] < asked)[decided], (high < asked)[decided])
    np.testing.assert_array_equal((sure[0] >= asked)[decided], (low >= asked)[decided])


def test_a_search_ends_where_the_least_angle_is_not_decided() -> None:
    """Contacts may move farther than closure at that angle allows; nor is the grasp open there."""
    contacts = random_contacts(Shape(4, 8, soft=False), 200, seed=4)
    points, normals = contacts.points, contacts.normals
    wider = np.random.default_rng(4).uniform(-0.6, 0.0, size=(200, 4))
    low, high = angle_brackets(
        points, normals, wider, displacement=np.full(200, 0.05), tolerance=1e-3
    )
    least = -wider.min(axis=1)
    assert ((low < least) & (high > least + 0.01)).sum() > 10
    exact = angle_brackets(points, normals, wider, tolerance=TOLERANCE)
    assert (low <= exact[1]).all()
    assert (high >= exact[0]).all()


FLAT = np.array([[0.0, 0.0, 0.0], [1.0, 0.2, 0.0], [-0.3, 0.9, 0.0], [0.5, -0.7, 0.0]])
KNOWN = {
    "one contact": ([[1.0, 2.0, 3.0]], [[0.0, 0.0, 1.0]], math.inf),
    "squeezed": (grasps.PAIR, -grasps.PAIR, 0.0),
    "expanded": (grasps.PAIR, grasps.PAIR, 0.0),
    "pushed one way along the line": (grasps.PAIR, [[1.0, 0.0, 0.0]] * 2, math.pi),
    "pushed one way across it": (grasps.PAIR, [[0.0, 0.0, 1.0]] * 2, RIGHT_ANGLE),
    "pushed one way obliquely": (grasps.PAIR, [[1.0, 1.0, 0.0]] * 2, 0.75 * math.pi),
    "on one face": (FLAT, [[0.0, 0.0, 1.0]] * 4, RIGHT_ANGLE),
    "at one point": ([[0.0, 0.0, 0.0]] * 3, [[1.0, 0.0, 0.0]] * 3, RIGHT_ANGLE),
    "all around a point": ([[1.0, 0.0, 0.0]] * 4, grasps.TETRAHEDRON, 0.0),
    "in a plane, converging": (
        grasps.TRIANGLE, np.column_stack([-grasps.TRIANGLE[:, :2], np.ones(3)]), math.pi / 4.0,
    ),
    "a thumb opposite two fingers": (
        [[0, 0, -1], [1, 0, 1], [-1, 0, 1]], [[0, 0, 1], [0, 0, -1], [0, 0, -1]], 0.0,
    ),
}  # fmt: skip
"""Points, normals and the critical angle."""


@pytest.mark.parametrize("name", KNOWN)
def test_known_angles(name: str) -> None:
    points, normals, expected = KNOWN[name]
    found = critical_friction_angle(Contacts(points, normals))
    assert found == pytest.approx(expected, abs=1e-12 if len(points) == 2 else TOLERANCE)


@pytest.mark.parametrize("count", [8, 30])
def test_the_angle_is_0_where_no_friction_is_needed(count: int) -> None:
    contacts = grasps.stacked([grasps.frictionless_grasp(seed, count) for seed in range(40)])
    closed = force_closure(contacts).closed
    assert closed.any()
    np.testing.assert_array_equal(critical_friction_angle(contacts) == 0.0, closed)


@pytest.mark.slow
def test_grasps_that_barely_close_without_friction_are_fast() -> None:
    """All contacts matter, and each excludes few directions by itself."""
    with np.load(shapes.shared("reference", "slow_contacts.npz")) as file:
        numbers = [name.removeprefix("points_") for name in file.files if "points_" in name]
        slow = [Contacts(file[f"points_{k}"], file[f"normals_{k}"], 0.0) for k in numbers]
    critical_friction_angle(slow[0])
    for contacts in slow:
        start = time.process_time()
        angle = critical_friction_angle(contacts)
        assert time.process_time() - start < 0.05
        assert (angle == 0.0) == force_closure(contacts).closed


@pytest.mark.parametrize("noise", [0.0, 1e-14, 1e-10, 1e-6])
def test_nearly_regular_grasps_have_nearly_the_regular_angle(noise: float) -> None:
    rng = np.random.default_rng(0)
    for name in grasps.REGULAR_SHAPES:
        exact = grasps.REGULAR_SHAPES[name]
        points = exact + noise * rng.normal(size=exact.shape)
        contacts = Contacts(points, -exact + noise * rng.normal(size=exact.shape))
        assert critical_friction_angle(contacts) == pytest.approx(0.0, abs=10.0 * noise + TOLERANCE)


@pytest.mark.parametrize("tolerance", [0.0, -1e-3, math.nan])
def test_a_tolerance_must_be_above_zero(tolerance: float) -> None:
    with pytest.raises(SettingError, match="tolerance must be above 0; got"):
        critical_friction_angle(grasps.random_grasp(3, 0), tolerance=tolerance)
