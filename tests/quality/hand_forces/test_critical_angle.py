"""Closure by a hand's own drives: bounds, certificates, and linear programs as an oracle."""

import math
from dataclasses import replace

import numpy as np
import pytest

import grasp3d
from grasp3d.contact.contacts import Contacts
from grasp3d.errors import SettingError
from grasp3d.quality.hand_forces.actuation import Actuation
from grasp3d.quality.hand_forces.critical_angle import (
    PressedForces,
    hand_closes,
    hand_critical_angle,
)
from grasp3d.quality.hand_forces.hand_grasp import HandGrasp
from tests.helpers.hand_programs import closes_by_linear_programs, tight_by_linear_programs
from tests.helpers.random_hands import random_actuation, random_hand

TOLERANCE = 1e-4


def check(grasp: HandGrasp, generator: np.random.Generator) -> None:
    """Certificates prove both bounds, which no linear program contradicts."""
    found = hand_critical_angle(grasp)
    forces = PressedForces(grasp)
    assert found.upper - max(found.lower, 0.0) <= 5.0 * TOLERANCE or found.closing is None
    if found.closing is not None:
        assert forces.closing_angle(found.closing) == found.upper
    if found.separating is not None:
        proven = forces.separating_angle(found.separating)
        assert min(proven, math.pi / 2.0) == found.lower
    if grasp.actuation.two_way:
        locked = grasp3d.critical_friction_angle(grasp.contacts, tolerance=1e-5)
        assert min(max(locked, 0.0), math.pi / 2.0) == pytest.approx(found.upper, abs=2e-4)
    angle = generator.uniform(0.1, 1.3)
    if closes_by_linear_programs(grasp, angle, edges=12, outer=False):
        assert found.lower <= angle + 1e-6
    if not closes_by_linear_programs(grasp, angle, edges=12, outer=True):
        assert found.upper >= angle - 1e-6


def test_bounds_are_proven_and_contradicted_by_no_linear_program() -> None:
    generator = np.random.default_rng(3)
    for _ in range(3):
        check(random_hand(generator), generator)


@pytest.mark.slow
def test_bounds_of_400_hands_are_contradicted_by_no_linear_program() -> None:
    generator = np.random.default_rng(4)
    for _ in range(400):
        check(random_hand(generator), generator)


def test_few_programs_bracket_the_angle() -> None:
    generator = np.random.default_rng(0)
    hands = [one for one in map(random_hand, [generator] * 90) if not one.actuation.two_way]
    programs = [hand_critical_angle(one).programs for one in hands]
    assert np.quantile(programs, 0.9) <= 9
    assert max(programs) <= 24


def check_drives_at_rest(generator: np.random.Generator) -> None:
    joints = int(generator.integers(2, 9))
    drives = random_actuation(generator, joints)
    if generator.random() < 0.5:  # more tendons than joints, which may pull against each other
        arms = generator.normal(size=(joints + 2, joints))
        limits = np.sort(generator.normal(size=(joints + 2, 2)) * generator.choice([0, 1], 2))
        weight = 0.1 * generator.normal(size=joints) * generator.integers(0, 2)
        drives = Actuation.of_hand(limits, joints=joints, arms=arms, weight=weight)
    expected = tight_by_linear_programs(drives)
    assert (drives.tight is None) == (expected is None)
    assert expected is None or (drives.tight == expected).all()


def test_drives_stay_at_the_bounds_of_linear_programs() -> None:
    generator = np.random.default_rng(5)
    for _ in range(8):
        check_drives_at_rest(generator)


@pytest.mark.slow
def test_drives_of_300_hands_stay_at_the_bounds_of_linear_programs() -> None:
    generator = np.random.default_rng(6)
    for _ in range(300):
        check_drives_at_rest(generator)


def pinch(actuation: Actuation, *, offset: float = 0.3) -> HandGrasp:
    """Two fingers with one joint each press a ball from both sides, along tilted normals."""
    points = np.array([[-0.03, 0.0, 0.0], [0.03, 0.0, 0.0]])
    normals = [[1.0, offset, 0.0], [-1.0, offset, 0.0]]
    jacobian = [[[0.05, 0.0], [0.0, 0.0], [0.0, 0.0]], [[0.0, -0.05], [0.0, 0.0], [0.0, 0.0]]]
    return HandGrasp(Contacts(points, normals, 0.5), jacobian, actuation)


def test_two_fingers_that_motors_close_have_the_angle_of_their_contacts() -> None:
    found = hand_critical_angle(pinch(Actuation.of_hand([1.0, 1.0], joints=2)))
    assert found.upper == pytest.approx(math.atan(0.3), abs=TOLERANCE)
    assert found.lower == pytest.approx(math.atan(0.3), abs=TOLERANCE)


@pytest.mark.parametrize("towards", [1.0, -1.0])
def test_tendons_that_pull_one_way_close_only_that_way(towards: float) -> None:
    limits = np.sort([[0.0, towards], [0.0, towards]], axis=1)
    found = hand_critical_angle(pinch(Actuation.of_hand(limits, joints=2)))
    expected = math.atan(0.3) if towards > 0.0 else math.pi / 2.0
    assert found.upper == pytest.approx(expected, abs=TOLERANCE)
    assert found.lower >= expected - TOLERANCE


def test_a_joint_that_nothing_drives_presses_nothing() -> None:
    unmoved = Actuation.of_hand([1.0], joints=2, arms=[[1.0, 0.0]])
    found = hand_critical_angle(pinch(unmoved))
    assert found.closing is None
    assert found.lower == pytest.approx(math.pi / 2.0, abs=1e-9)
    stopped = Actuation.of_hand([1.0], joints=2, arms=[[1.0, 0.0]], stops=[0, 1])
    assert hand_critical_angle(pinch(stopped)).upper == pytest.approx(math.atan(0.3), abs=1e-4)
    against = Actuation.of_hand([1.0], joints=2, arms=[[1.0, 0.0]], stops=[0, -1])
    assert hand_critical_angle(pinch(against)).closing is None


def test_forces_in_equilibrium_are_not_enough_where_drives_span_too_little() -> None:
    grasp = pinch(Actuation.of_hand([1.0, 1.0], joints=2))
    # A joint that nothing drives lets the first finger give way along z.
    loose = np.concatenate([grasp.jacobian, np.zeros((2, 3, 1))], axis=2)
    loose[0, 2, 2] = 0.05
    motors = Actuation.of_hand([1.0, 1.0], joints=3, arms=np.eye(3)[:2])
    found = hand_critical_angle(HandGrasp(grasp.contacts, loose, motors))
    assert found.closing is None
    assert not hand_closes(HandGrasp(grasp.contacts, loose, motors), 1.0)


def test_weight_within_the_limits_of_motors_changes_no_angle() -> None:
    loaded = Actuation.of_hand([1.0, 1.0], joints=2, weight=[0.9, -0.5])
    assert loaded.two_way
    assert hand_critical_angle(pinch(loaded)).upper == pytest.approx(math.atan(0.3), abs=1e-4)
    # Beyond them the object must carry the links: contacts press only outward or inward.
    beyond = Actuation.of_hand([1.0, 1.0], joints=2, weight=[1.1, 1.1])
    assert beyond.tight is None
    held = Actuation.of_hand([1.0, 1.0], joints=2, weight=[-1.1, -1.1])
    assert hand_critical_angle(pinch(held)).upper == pytest.approx(math.atan(0.3), abs=1e-4)
    assert hand_critical_angle(pinch(beyond)).closing is None


def test_margins_are_minus_the_angle_with_offsets() -> None:
    grasp = pinch(Actuation.of_hand([[0.0, 1.0]] * 2, joints=2))
    margin = -hand_critical_angle(grasp, offset=[0.5, 0.4]).upper
    assert margin == pytest.approx(0.4 - math.atan(0.3), abs=TOLERANCE)
    assert hand_closes(grasp, [0.5, 0.4])
    assert not hand_closes(grasp, [0.5, 0.29])
    assert not hand_closes(grasp, [0.5, -0.1])


def test_certificates_fail_for_what_they_do_not_prove() -> None:
    generator = np.random.default_rng(2)
    grasp = pinch(Actuation.of_hand([[0.0, 1.0]] * 2, joints=2))
    found, forces = hand_critical_angle(grasp), PressedForces(grasp)
    assert found.closing is not None
    assert found.separating is not None
    for changed in (-found.closing.forces, found.closing.forces + [[0.0, 0.0, 0.01], [0, 0, 0]]):
        assert math.isnan(forces.closing_angle(replace(found.closing, forces=changed)))
    assert math.isnan(forces.separating_angle(replace(found.separating, twist=np.zeros(6))))
    pulling = replace(found.separating, motion=np.array([1.0, -1.0]))
    assert math.isnan(forces.separating_angle(pulling))
    for _ in range(20):
        twist = found.separating.twist + 0.1 * generator.normal(size=6)
        assert not forces.separating_angle(replace(found.separating, twist=twist)) > found.upper


def test_a_tolerance_must_be_above_0() -> None:
    with pytest.raises(SettingError, match="tolerance"):
        hand_critical_angle(pinch(Actuation.of_hand([1.0, 1.0], joints=2)), tolerance=0.0)
