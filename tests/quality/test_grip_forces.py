import math
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from grasp3d import Contacts, epsilon, force_closure, grip_force
from grasp3d.errors import ContactError
from grasp3d.quality import Acceleration, Resistance, Weight, Wrenches
from grasp3d.system.context import running
from tests.helpers import grasps
from tests.helpers.cone_programs import ConeProgram
from tests.helpers.forces import GRAVITY, check_proof, moved, opposed, wrench_of
from tests.helpers.patches import force_of_points
from tests.helpers.random_grasps import Shape, random_contacts

SHARP, RTOL = 1e-8, 1e-3
BOUNDS: list[Any] = ["normal", "norm", "total"]
NEWTON = Weight(1.0 / GRAVITY)

seeds = st.integers(0, 100_000)
fingers = st.integers(2, 5)
bounds = st.sampled_from(BOUNDS)
few = settings(max_examples=25, deadline=None)


def closed_grasps(count: int, size: int, seed: int, *, soft: bool) -> Contacts:
    contacts = random_contacts(Shape(count, 8, soft=soft), size, seed)
    return contacts.take(np.flatnonzero(force_closure(contacts).closed))


def wrenches_in_span(contacts: Contacts, seed: int) -> np.ndarray:
    """Wrenches that contact forces in any direction add up to, shape (..., 6)."""
    rng = np.random.default_rng(seed)
    forces = rng.normal(size=(*contacts.points.shape[:-1], 4))
    forces[..., 3] *= contacts.torsion_radius
    return wrench_of(contacts, forces)


@pytest.mark.parametrize("bound", BOUNDS)
def test_reference_wrenches(bound: Any) -> None:
    for case in grasps.reference("grip_force.json"):
        contacts, known = grasps.of_force_case(case), case["force"][bound]
        found = grip_force(contacts, case["wrench"], bound=bound, rtol=SHARP)
        if known is None:
            assert found.upper == math.inf
            assert found.resistance != Resistance.RESISTED
        else:
            assert found.lower == pytest.approx(known, rel=1e-6)
            assert found.upper == pytest.approx(known, rel=1e-6)
        check_proof(contacts, found, bound=bound)


@pytest.mark.parametrize("bound", ["normal", "norm"])
def test_reference_directions_of_gravity(bound: Any) -> None:
    compared = 0
    for case in grasps.reference("grip_force.json"):
        contacts, known = grasps.of_force_case(case), case["worst_gravity"][bound]
        found = grip_force(contacts, NEWTON, bound=bound, rtol=1e-10)
        if known["force"] is None if known else True:
            assert found.upper == math.inf
            continue
        assert found.upper == pytest.approx(known["force"], rel=1e-6)
        assert found.certificate.wrench[:3] == pytest.approx(known["direction"], abs=1e-5)
        compared += 1
    assert compared > 30


@pytest.mark.slow
@pytest.mark.parametrize("bound", BOUNDS)
@pytest.mark.parametrize("soft", [False, True])
@pytest.mark.parametrize("count", [2, 3, 5])
def test_cone_programs_agree(count: int, soft: bool, bound: Any) -> None:
    contacts = random_contacts(Shape(count, 8, soft=soft), 60, 7)
    wrenches = wrenches_in_span(contacts, 8)
    found = grip_force(contacts, wrenches, bound=bound, rtol=SHARP)
    check_proof(contacts, found, bound=bound)
    solved = 0
    for g in range(len(wrenches)):
        known = ConeProgram(grasps.one(contacts, g), bound).force(wrenches[g])
        if math.isnan(known):
            continue
        solved += 1
        assert np.isfinite(known) == np.isfinite(found.upper[g])
        if np.isfinite(known):
            assert found.upper[g] == pytest.approx(known, rel=2e-6)
    assert solved > 45


@given(st.floats(0.1, 2.0), st.floats(1e-3, 0.02), st.floats(0.0, 0.05), st.floats(0.0, 6.0))
@example(0.5, 2.0**-6 * 1.25, 2.0**-5, 2.0**-24)
@few
def test_opposed_fingers_with_the_weight_beside_their_line(
    friction: float, torsion: float, arm: float, turn: float
) -> None:
    across = np.array([0.0, math.cos(turn), math.sin(turn)])
    contacts = moved(opposed(friction=friction, torsion=torsion), -arm * across)
    wrench = [*np.cross([1.0, 0.0, 0.0], across), 0.0, 0.0, 0.0]
    expected = 0.5 * math.hypot(1.0 / friction, arm / torsion)
    found = grip_force(contacts, wrench, rtol=SHARP)
    assert found.upper == pytest.approx(expected, rel=1e-7)
    check_proof(contacts, found, rtol=RTOL)


def test_opposed_fingers_in_any_direction() -> None:
    """Along the line one finger bears the weight, besides the friction force of both."""
    for width, torsion, offset in ((0.04, 0.004, 0.0), (1e-7, 1e-8, 0.0), (0.04, 0.0, 0.0)):
        contacts = moved(opposed(width, friction=0.5, torsion=torsion), [offset, 0.0, 0.0])
        found = grip_force(contacts, NEWTON, rtol=1e-5)
        assert found.upper == pytest.approx(math.sqrt(2.0), rel=1e-5)
    none = grip_force(opposed(), np.zeros(6))
    assert none.lower == none.upper == 0.0
    assert (none.certificate.forces == 0.0).all()


def test_hard_fingers_resist_no_torque_about_their_line() -> None:
    contacts = moved(opposed(torsion=0.0), [0.0, 0.01, 0.0])
    found = grip_force(contacts, [0.0, 0.0, -1.0, 0.0, 0.0, 0.0])
    assert found.upper == found.lower == math.inf
    assert found.resistance == Resistance.NO_SUCH_WRENCH
    assert grip_force(contacts, NEWTON).resistance == Resistance.NO_SUCH_WRENCH
    # Without friction they only push.
    smooth = opposed(friction=0.0, torsion=0.0)
    assert grip_force(smooth, [0.0, 0.0, -1.0, 0.0, 0.0, 0.0]).upper == math.inf
    assert grip_force(smooth, [3.0, 0.0, 0.0, 0.0, 0.0, 0.0]).upper == pytest.approx(3.0)


@given(fingers, seeds, st.booleans(), bounds, st.floats(0.01, 100.0))
@few
def test_the_force_is_convex_and_homogeneous_in_the_wrench(
    count: int, seed: int, soft: bool, bound: Any, factor: float
) -> None:
    contacts = grasps.random_grasp(count, seed, soft=soft)
    one, other = wrenches_in_span(contacts, seed), wrenches_in_span(contacts, seed + 1)
    force = [
        grip_force(contacts, w, bound=bound, rtol=1e-6)
        for w in (one, other, one + other, factor * one)
    ]
    if not all(f.finite for f in force):
        return
    assert force[2].lower <= (force[0].upper + force[1].upper) * (1.0 + 1e-9)
    assert force[3].upper == pytest.approx(factor * force[0].upper, rel=1e-5)


@given(fingers, seeds, st.booleans(), bounds)
@few
def test_more_friction_torsion_and_fingers_never_need_more(
    count: int, seed: int, soft: bool, bound: Any
) -> None:
    contacts = grasps.random_grasp(count, seed, soft=soft)
    wrench = wrenches_in_span(contacts, seed)
    enough = grip_force(contacts, wrench, bound=bound).upper
    more = contacts.with_friction(1.3 * contacts.friction)
    radius = contacts.torsion_radius + 0.2
    softer = Contacts(contacts.points, contacts.normals, contacts.friction, radius)
    further = Contacts(
        [*contacts.points, [0.3, 0.2, -0.8]],
        [*contacts.normals, [0.0, 0.0, 1.0]],
        [*contacts.friction, 0.5],
        [*contacts.torsion_radius, 0.0],
    )
    for better in (more, softer, further):
        assert grip_force(better, wrench, bound=bound).lower <= enough


@pytest.mark.parametrize(("bound", "actuation", "bounded", "points"), [
    ("normal", "per_finger", "normal", 1), ("norm", "per_finger", "force", 1),
    ("norm", "per_finger", "force", 4), ("total", "total", "normal", 1),
])  # fmt: skip
def test_the_hardest_unit_wrench_needs_one_over_epsilon(
    bound: Any, actuation: Any, bounded: Any, points: int
) -> None:
    """Also where fingers touch at several points."""
    contacts = closed_grasps(4, 20, 1, soft=False)
    if points > 1:
        contacts = pads(3, 6)
        contacts = contacts.take(np.flatnonzero(force_closure(contacts).closed)[:8])
    quality = epsilon(contacts, actuation=actuation, bounded=bounded)
    found = grip_force(contacts, -quality.certificate.direction, bound=bound)
    assert (found.lower <= 1.0 / quality.lower * (1.0 + 1e-9)).all()
    assert (found.upper >= 1.0 / quality.upper * (1.0 - 1e-9)).all()


def pads(count: int, seed: int) -> Contacts:
    """Grasps of fingers that touch at four points each, around a ball."""
    rng = np.random.default_rng(seed)
    fingers = random_contacts(Shape(count, 8, soft=False), 40, seed)
    arms = 0.3 * rng.normal(size=(40, count, 4, 3))
    normals = fingers.normals[:, :, None]
    points = fingers.points[:, :, None] + arms - (arms * normals).sum(-1, keepdims=True) * normals
    return Contacts(
        points.reshape(40, -1, 3), fingers.normals.repeat(4, axis=1),
        fingers.friction.repeat(4, axis=1), groups=np.arange(count).repeat(4),
    )  # fmt: skip


@pytest.mark.parametrize("bound", ["normal", "norm"])
@pytest.mark.parametrize("count", [2, 3])
def test_points_of_a_finger_share_its_bound(count: int, bound: Any) -> None:
    contacts = pads(count, 6)
    wrenches = wrenches_in_span(contacts, 8)
    found = grip_force(contacts, wrenches, bound=bound, rtol=SHARP)
    check_proof(contacts, found, bound=bound)
    resisted = np.flatnonzero(found.finite)
    assert len(resisted) > 10
    for g in resisted[:12]:
        own = contacts.points[g].reshape(count, 4, 3)
        normals, friction = contacts.normals[g, ::4], contacts.friction[g, ::4]
        known = force_of_points(own, normals, friction, wrenches[g], bound)
        assert found.upper[g] == pytest.approx(known, rel=2e-6)


@given(fingers, seeds, bounds)
@few
def test_tasks_with_corners_need_what_the_hardest_corner_needs(
    count: int, seed: int, bound: Any
) -> None:
    contacts = grasps.random_grasp(count, seed, soft=True)
    rng = np.random.default_rng(seed)
    corners = rng.normal(size=(3, 6))
    found = grip_force(contacts, Wrenches(corners), bound=bound)
    each = [grip_force(contacts, corner, bound=bound).upper for corner in corners]
    assert found.upper == max(each)
    # A curved border goes through the hull: small forces about the corners.
    rounded = Wrenches(corners) + Acceleration(acceleration=1e-9)
    assert grip_force(contacts, rounded, bound=bound).upper == pytest.approx(max(each), rel=3e-3)


def test_fingers_below_carry_weight_without_force_closure() -> None:
    angles = np.radians([0.0, 120.0, 240.0])
    points = np.stack([np.cos(angles), np.sin(angles), np.full(3, -0.5)], axis=1)
    contacts = Contacts(points, np.tile([0.0, 0.0, 1.0], (3, 1)), 0.5)
    assert not force_closure(contacts).closed
    down = grip_force(contacts, Weight(1.0, direction=(0.0, 0.0, -1.0)))
    assert down.upper == pytest.approx(GRAVITY / 3.0, rel=1e-3)
    tipped = Weight(1.0, direction=(0.0, 0.0, -1.0), within=math.radians(10.0))
    found = grip_force(contacts, tipped)
    assert found.finite
    assert found.upper > down.upper
    check_proof(contacts, found, tipped, rtol=RTOL)
    anywhere = grip_force(contacts, Weight(1.0))
    assert anywhere.upper == math.inf
    assert anywhere.resistance == Resistance.NO_PUSH
    steep = Weight(1.0, direction=(0.0, 0.0, -1.0), within=math.radians(40.0))
    assert grip_force(contacts, steep).upper == math.inf


def test_contacts_at_one_point_and_on_a_line() -> None:
    together = Contacts([[0.0, 0.0, 1.0]] * 3, [[0, 0, -1], [0, 1, 0], [1, 0, 0]], 0.5)
    found = grip_force(together, [0.0, 0.0, 1.0, 0.0, 0.0, 0.5])
    assert found.resistance == Resistance.NO_SUCH_WRENCH
    on_line = grip_force(grasps.LINE, [0.0, -0.1, 0.0, 0.0, 0.0, 0.0])
    assert on_line.finite
    check_proof(grasps.LINE, on_line)


def test_batches_and_masses() -> None:
    contacts = closed_grasps(3, 12, 2, soft=True)
    count = len(contacts.points)
    masses = np.linspace(0.1, 2.0, count)
    found = grip_force(contacts, Weight(), masses=masses)
    each = [grip_force(grasps.one(contacts, g), Weight(m)).upper for g, m in enumerate(masses)]
    assert found.upper == pytest.approx(each, rel=2e-3)
    one, two = (running(threads=n)(grip_force)(contacts, Weight()).upper for n in (1, 2))
    assert two == pytest.approx(one, rel=0.0)
    shaped = contacts.take(np.arange(4)).reshape((2, 2))
    assert grip_force(shaped, Weight()).certificate.forces.shape == (2, 2, 3, 4)


@pytest.mark.parametrize("wrench", [[1.0, 2.0], [math.nan] * 6, "weight", [[1.0] * 6] * 3])
def test_wrenches_that_are_none(wrench: Any) -> None:
    with pytest.raises(ContactError):
        grip_force(opposed(), wrench)
