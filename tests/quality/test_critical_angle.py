import math
import time

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st

from grasp3d import Contacts, critical_friction_angle, force_closure
from grasp3d.arrays import angles_between
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


def random_directions(count: int, seed: int) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(count, 6))


# Laws


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


@pytest.mark.slow
@given(st.integers(2, 5), seeds)
@few
def test_friction_torsion_and_order_do_not_matter(count: int, seed: int) -> None:
    contacts = grasps.random_grasp(count, seed)
    other = Contacts(contacts.points[::-1], contacts.normals[::-1], 3.0, 0.4)
    angle = critical_friction_angle(contacts)
    assert critical_friction_angle(other) == pytest.approx(angle, abs=TOLERANCE + 1e-9)


@given(st.integers(2, 4), seeds)
@few
def test_another_contact_never_needs_more_friction(count: int, seed: int) -> None:
    more = grasps.random_grasp(count + 1, seed)
    less = grasps.one(more, np.arange(count))
    if count == 2:  # rank 5: two may be force-closed where three are not
        return
    assert critical_friction_angle(more) <= critical_friction_angle(less) + TOLERANCE


@given(st.integers(3, 5), seeds)
@few
def test_no_direction_has_a_larger_angle(count: int, seed: int) -> None:
    """By definition the largest over all directions of the smallest angle to a normal."""
    contacts = grasps.random_grasp(count, seed)
    angles = oracles.smallest_angles_to_normals(
        contacts.points, contacts.normals, random_directions(2000, seed)
    )
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
    angle = float(critical_friction_angle(coincident))
    rng = np.random.default_rng(seed)
    for line in rng.normal(size=(200, 3)):
        to_normals = [
            max(oracles.angle(coincident.normals[0], d), oracles.angle(coincident.normals[1], -d))
            for d in (line, -line)
        ]
        assert angle <= min(to_normals) + 1e-12
    halfway = coincident.normals[0] - coincident.normals[1]
    expected = oracles.angle(coincident.normals[0], halfway)
    assert angle == pytest.approx(expected, abs=1e-9)


@pytest.mark.slow
@given(seeds, st.floats(0.05, 1.0))
@few
def test_tilts_within_the_margin_keep_force_closure(seed: int, fraction: float) -> None:
    """Wan & Howe 2018, Sec. III-A: the effective friction."""
    rng = np.random.default_rng(seed)
    contacts = (
        grasps.frictionless_grasp(seed % 10)
        if seed % 2
        else grasps.random_grasp(3 + seed % 3, seed)
    )
    angle = float(critical_friction_angle(contacts))
    beta = angle + 0.2
    assume(beta < math.pi / 2.0)  # friction has no larger angle
    tilt = fraction * (beta - angle)
    for _ in range(10):
        normals = np.array([oracles.tilted(n, 0.999 * tilt, rng) for n in contacts.normals])
        tilted = grasps.at_angle(grasps.changed(contacts, normals=normals), beta)
        assert force_closure(tilted).closed


# Oracles


@pytest.mark.slow
def test_angles_equal_those_of_the_reference() -> None:
    for case in grasps.reference("epsilon.json"):
        tolerance = 1e-6 if len(case["points"]) == 2 else 2.0 * TOLERANCE
        angle = critical_friction_angle(grasps.of_case(case))
        expected = pytest.approx(case["critical_friction_angle"], abs=tolerance)
        assert angle == expected, case["id"]


@pytest.mark.parametrize("tolerance", [1e-2, 1e-3, 1e-6])
def test_the_error_is_within_the_tolerance(tolerance: float) -> None:
    contacts = random_contacts(Shape(3, 8, soft=False), 40, seed=2)
    fine = critical_friction_angle(contacts, tolerance=1e-9)
    coarse = critical_friction_angle(contacts, tolerance=tolerance)
    assert (coarse >= fine - 1e-9).all()
    assert (coarse <= fine + tolerance + 1e-9).all()


@pytest.mark.parametrize("count", [3, 4, 8])
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
    decided = (np.abs(asked - high) > 2.0 * TOLERANCE) & (asked > 0.1)
    np.testing.assert_array_equal((sure[1] < asked)[inside & decided], (high < asked)[
        inside & decided
    ])  # fmt: skip
    np.testing.assert_array_equal((sure[0] >= asked)[inside & decided], (low >= asked)[
        inside & decided
    ])  # fmt: skip


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


# Known shapes


def test_one_contact_is_never_force_closed() -> None:
    assert critical_friction_angle(Contacts([[1.0, 2.0, 3.0]], [[0.0, 0.0, 1.0]])) == math.inf


def test_two_contacts_that_push_the_same_way_need_a_right_angle_or_more() -> None:
    along = Contacts(grasps.PAIR, [[1.0, 0.0, 0.0]] * 2)
    assert critical_friction_angle(along) == pytest.approx(math.pi)
    across = Contacts(grasps.PAIR, [[0.0, 0.0, 1.0]] * 2)
    assert critical_friction_angle(across) == pytest.approx(RIGHT_ANGLE)
    oblique = Contacts(grasps.PAIR, [[1.0, 1.0, 0.0], [1.0, 1.0, 0.0]])
    assert critical_friction_angle(oblique) == pytest.approx(0.75 * math.pi)


def test_internal_grasps_have_the_same_angle_as_external_ones() -> None:
    squeeze = Contacts(grasps.PAIR, -grasps.PAIR)
    expand = Contacts(grasps.PAIR, grasps.PAIR)
    assert critical_friction_angle(squeeze) == critical_friction_angle(expand) == 0.0


@pytest.mark.parametrize("count", [3, 5])
def test_contacts_on_one_face_are_never_force_closed(count: int) -> None:
    rng = np.random.default_rng(count)
    points = np.column_stack([rng.normal(size=(count, 2)), np.zeros(count)])
    contacts = Contacts(points, [[0.0, 0.0, 1.0]] * count)
    assert critical_friction_angle(contacts) == pytest.approx(RIGHT_ANGLE, abs=1e-12)


def test_contacts_in_a_plane_with_converging_normals_can_be_force_closed() -> None:
    inward = np.column_stack([-grasps.TRIANGLE[:, :2], np.ones(3)])
    angle = critical_friction_angle(Contacts(grasps.TRIANGLE, inward))
    assert angle == pytest.approx(math.pi / 4.0, abs=TOLERANCE)


def test_three_fingers_between_two_faces() -> None:
    """A thumb opposite two fingers: normals are parallel, with forces in equilibrium along them."""
    points = [[0.0, 0.0, -1.0], [1.0, 0.0, 1.0], [-1.0, 0.0, 1.0]]
    normals = np.array([[0.0, 0.0, 1.0], [0.0, 0.0, -1.0], [0.0, 0.0, -1.0]])
    assert critical_friction_angle(Contacts(points, normals)) == pytest.approx(0.0, abs=TOLERANCE)


def test_contacts_on_one_line() -> None:
    tilt = 0.3
    normals = [
        [math.cos(tilt), math.sin(tilt), 0.0],
        [0.0, 1.0, 0.0],
        [-math.cos(tilt), math.sin(tilt), 0.0],
    ]
    contacts = Contacts(grasps.LINE.points, normals)
    angle = float(critical_friction_angle(contacts))
    assert force_closure(grasps.at_angle(contacts, angle + 1e-3)).closed
    assert not force_closure(grasps.at_angle(contacts, angle - 1e-3)).closed


# Grasps that are force-closed without friction


@pytest.mark.parametrize("count", [8, 12, 30])
def test_the_angle_is_0_where_no_friction_is_needed(count: int) -> None:
    contacts = grasps.stacked([grasps.frictionless_grasp(seed, count) for seed in range(40)])
    closed = force_closure(contacts).closed
    assert closed.any()
    np.testing.assert_array_equal(critical_friction_angle(contacts) == 0.0, closed)


def test_a_cage_of_many_contacts() -> None:
    """Four contacts on each face of a cube, with normals tilted in both senses about its centre."""
    points, normals = [], []
    for axis in range(3):
        for side in (-1.0, 1.0):
            for a in (-0.5, 0.5):
                for b in (-0.5, 0.5):
                    normal = np.roll([-side, 0.0, 0.0], axis)
                    points.append(np.roll([side, a, b], axis))
                    normals.append(normal + 0.3 * np.roll([0.0, np.sign(a * b), 0.0], axis))
    contacts = Contacts(points, normals, 0.0)
    angle = float(critical_friction_angle(contacts))
    assert (angle == 0.0) == force_closure(contacts).closed
    angles = oracles.smallest_angles_to_normals(
        contacts.points, contacts.normals, random_directions(50_000, 0)
    )
    assert angle >= angles.max() - RIGHT_ANGLE - 1e-12


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


def test_contacts_at_one_point_are_force_closed_without_friction() -> None:
    """Rank 3: every direction is within 70.5 degrees of a normal to a tetrahedron's corner."""
    contacts = Contacts([[1.0, 0.0, 0.0]] * 4, grasps.TETRAHEDRON, 0.0)
    assert force_closure(contacts).closed
    assert critical_friction_angle(contacts) == 0.0


# Degenerate cases


def test_duplicated_contacts_do_not_change_the_angle() -> None:
    for seed in range(6):
        contacts = grasps.random_grasp(3, seed)
        doubled = Contacts(np.tile(contacts.points, (2, 1)), np.tile(contacts.normals, (2, 1)))
        expected = critical_friction_angle(contacts)
        assert critical_friction_angle(doubled) == pytest.approx(expected, abs=2.0 * TOLERANCE)


@pytest.mark.parametrize("noise", [0.0, 1e-14, 1e-12, 1e-10, 1e-8, 1e-6])
def test_nearly_regular_grasps_have_nearly_the_regular_angle(noise: float) -> None:
    rng = np.random.default_rng(0)
    for name in grasps.REGULAR_SHAPES:
        exact = grasps.REGULAR_SHAPES[name]
        points = exact + noise * rng.normal(size=exact.shape)
        contacts = Contacts(points, -exact + noise * rng.normal(size=exact.shape))
        assert critical_friction_angle(contacts) == pytest.approx(0.0, abs=10.0 * noise + TOLERANCE)


def test_all_contacts_at_the_origin() -> None:
    contacts = Contacts(np.zeros((3, 3)), [[1.0, 0.0, 0.0], [-1.0, 0.2, 0.0], [0.0, -1.0, 0.3]])
    assert 0.0 <= critical_friction_angle(contacts) <= RIGHT_ANGLE
    same_way = Contacts(np.zeros((3, 3)), [[1.0, 0.0, 0.0]] * 3)
    assert critical_friction_angle(same_way) == pytest.approx(RIGHT_ANGLE)


def test_angles_are_accurate_near_0_and_pi() -> None:
    x = np.array([1.0, 0.0, 0.0])
    for small in (0.0, 1e-12, 1e-8):
        near = np.array([math.cos(small), math.sin(small), 0.0])
        assert angles_between(x, near) == pytest.approx(small, rel=1e-12)
        assert angles_between(x, -near) == pytest.approx(math.pi - small, rel=1e-15)


@pytest.mark.parametrize("tolerance", [0.0, -1e-3, math.nan])
def test_a_tolerance_must_be_above_zero(tolerance: float) -> None:
    with pytest.raises(SettingError, match="tolerance must be above 0; got"):
        critical_friction_angle(grasps.random_grasp(3, 0), tolerance=tolerance)
