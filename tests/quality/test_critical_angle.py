import math
import time
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from scipy.optimize import minimize

from grasp3d import Contacts, critical_friction_angle, force_closure
from grasp3d._kernels.hull.critical_angle import climb
from grasp3d.arrays import angles_between
from grasp3d.contact.contacts import centred
from grasp3d.errors import SettingError
from grasp3d.quality.wrench_problem import WrenchProblem
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
    """Wan & Howe 2018, Sec. III-A: the effective friction, negative angles included."""
    rng = np.random.default_rng(seed)
    contacts = (
        grasps.frictionless_grasp(seed % 10)
        if seed % 2
        else grasps.random_grasp(3 + seed % 3, seed)
    )
    angle = float(critical_friction_angle(contacts))
    beta = max(angle, 0.0) + 0.2
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


@pytest.mark.parametrize("count", [4, 6, 9])
def test_steps_without_the_kernel_find_the_same_angles(count: int) -> None:
    """As where a closure has no proof, and the kernel leaves the interval as it is."""
    contacts = random_contacts(Shape(count, 8, soft=False), 40, seed=2)
    angles = critical_friction_angle(contacts)
    with patch.object(WrenchProblem, "narrow") as narrow:
        stepwise = critical_friction_angle(contacts)
    narrow.assert_called_once()
    np.testing.assert_allclose(angles, stepwise, atol=TOLERANCE)
    assert len(set(angles.round(2))) > 10


@pytest.mark.parametrize("count", [4, 8])
def test_motions_climb_to_the_critical_angle(count: int) -> None:
    """From those that separate grasps without friction; what they separate is what they claim."""
    contacts = random_contacts(Shape(count, 8, soft=False), 60, seed=2)
    points, _, _ = centred(contacts.points)
    motions = force_closure(Contacts(points, contacts.normals, friction=0.01)).certificate.direction
    critical = critical_friction_angle(contacts, tolerance=1e-8)
    scratch, left = np.zeros((11, 6)), []
    for p, normals, u, angle in zip(points, contacts.normals, motions, critical, strict=True):
        if angle < 0.02:
            continue
        found = climb(p, normals, TOLERANCE, u := u.copy(), scratch)
        velocities = u[:3] + np.cross(u[3:], p)
        separated = angles_between(velocities, normals).min() - RIGHT_ANGLE
        assert found == pytest.approx(separated, abs=1e-9)
        assert found <= angle + 1e-8
        left.append(angle - found)
    assert len(left) > 30
    assert np.quantile(left, 0.9) < 0.2 * TOLERANCE


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


def test_a_known_negative_angle() -> None:
    angle = critical_friction_angle(grasps.frictionless_grasp(0))
    assert math.degrees(angle) == pytest.approx(-12.23, abs=0.01)


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
    assert (angle < 0.0) == force_closure(contacts).closed
    angles = oracles.smallest_angles_to_normals(
        contacts.points, contacts.normals, random_directions(50_000, 0)
    )
    assert angle >= angles.max() - RIGHT_ANGLE - 1e-12


def barely_closed(seed: int, count: int) -> Contacts:
    """A grasp that is just force-closed without friction: beyond it, normals turn too far."""
    rng = np.random.default_rng(seed)
    while True:
        closed = grasps.frictionless_grasp(int(rng.integers(1 << 30)), count)
        if force_closure(closed).closed:
            break
    turned = closed.normals + rng.normal(size=(count, 3))
    low, high = 0.0, 1.0
    for _ in range(10):
        middle = 0.5 * (low + high)
        normals = (1.0 - middle) * closed.normals + middle * turned
        is_closed = bool(force_closure(grasps.changed(closed, normals=normals)).closed)
        low, high = (middle, high) if is_closed else (low, middle)
    return grasps.changed(closed, normals=(1.0 - low) * closed.normals + low * turned)


def deepest_motion(contacts: Contacts, starts: int, seed: int) -> float:
    """Smallest of the largest cosines between velocities and normals: sequential programs."""
    points, normals = contacts.points, contacts.normals

    def velocities(u: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        v = u[..., None, :3] + np.cross(u[..., None, 3:6], points)
        return v, np.linalg.norm(v, axis=-1)

    def largest_cosine(u: np.ndarray) -> np.ndarray:
        v, speed = velocities(u)
        return np.asarray(((v * normals).sum(axis=-1) / speed).max(axis=-1))

    def slack(x: np.ndarray) -> np.ndarray:
        v, speed = velocities(x)
        return np.append(x[6] * speed - (v * normals).sum(axis=-1), 1.0 - x[:6] @ x[:6])

    def slope(x: np.ndarray) -> np.ndarray:
        v, speed = velocities(x)
        force = x[6] * v / speed[:, None] - normals
        rows = np.column_stack([force, np.cross(points, force), speed])
        return np.vstack([rows, np.append(-2.0 * x[:6], 0.0)])

    directions = random_directions(4000, seed)
    best = math.inf
    for u in directions[np.argsort(largest_cosine(directions))[:starts]]:
        unit = u / np.linalg.norm(u)
        x = minimize(
            lambda x: (x[6], np.eye(7)[6]),
            np.append(unit, largest_cosine(unit)),
            jac=True,
            method="SLSQP",
            constraints={"type": "ineq", "fun": slack, "jac": slope},
            options={"maxiter": 60, "ftol": 1e-12},
        ).x
        if np.linalg.norm(x[:6]) > 0.5:
            best = min(best, float(largest_cosine(x[:6])))
    return best


@pytest.mark.slow
@pytest.mark.parametrize("count", [7, 8, 9, 10, 12, 20, 30])
def test_negative_angles_against_local_searches(count: int) -> None:
    rng = np.random.default_rng(count)
    found = 0
    for _ in range(1000):
        contacts = grasps.frictionless_grasp(int(rng.integers(1 << 30)), count)
        if not force_closure(contacts).closed:
            continue
        angle = -math.asin(deepest_motion(contacts, 100, count))
        # Motions prove that no angle is smaller; some search finds the largest one.
        assert angle <= critical_friction_angle(contacts) <= angle + 2.0 * TOLERANCE
        found += 1
        if found == 2:
            return
    pytest.fail("no grasps")


@pytest.mark.slow
@pytest.mark.parametrize("row", [0, 1, 2, 13, 73, 279])
def test_grasps_that_barely_close_without_friction_are_fast(row: int) -> None:
    """All contacts matter, and each excludes few directions by itself; some took seconds."""
    if row < 3:
        contacts = barely_closed(row, 8 + row)
    else:
        with np.load(shapes.shared("reference", "slow_contacts.npz")) as file:
            contacts = Contacts(file[f"points_{row}"], file[f"normals_{row}"], 0.0)
    angle = -math.asin(deepest_motion(contacts, 100, row))
    start = time.process_time()
    found = critical_friction_angle(contacts)
    assert time.process_time() - start < 0.2
    assert angle <= found <= min(angle + 2.0 * TOLERANCE, 0.0)


def test_contacts_at_one_point_are_force_closed_without_friction() -> None:
    """Rank 3: every direction is within 70.5 degrees of a normal to a tetrahedron's corner."""
    contacts = Contacts([[1.0, 0.0, 0.0]] * 4, grasps.TETRAHEDRON, 0.0)
    assert force_closure(contacts).closed
    angle = critical_friction_angle(contacts)
    assert angle == pytest.approx(math.acos(1.0 / 3.0) - RIGHT_ANGLE, abs=TOLERANCE)


@pytest.mark.slow
@pytest.mark.parametrize("tolerance", [1e-2, 1e-3])
def test_negative_angles_are_within_the_tolerance_from_above(tolerance: float) -> None:
    contacts = grasps.frictionless_grasp(1)
    fine = critical_friction_angle(contacts, tolerance=TOLERANCE)
    coarse = critical_friction_angle(contacts, tolerance=tolerance)
    assert fine - TOLERANCE <= coarse <= fine + tolerance


# Batches


@pytest.mark.slow
def test_a_batch_may_mix_grasps_with_and_without_frictionless_closure() -> None:
    closed, other = grasps.frictionless_grasp(0), grasps.frictionless_grasp(1)
    parallel = grasps.changed(closed, normals=[[0.0, 0.0, 1.0]] * 16)
    arbitrary = grasps.changed(closed, normals=np.tile(grasps.random_grasp(4, 0).normals, (4, 1)))
    many = grasps.stacked([closed, parallel, arbitrary, other])
    angles = critical_friction_angle(many)
    for i in range(4):
        # The normals of one grasp are scaled to length 1 again, which may change their last bit.
        assert angles[i] == pytest.approx(critical_friction_angle(grasps.one(many, i)), abs=1e-12)
    assert angles[0] < 0.0
    assert angles[3] < 0.0


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
