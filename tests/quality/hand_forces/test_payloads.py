"""What the motors of a hand hold: closed forms, worst tilts, laws, and certificates."""

import math
from collections.abc import Iterator
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import grasp3d
from grasp3d.contact.contacts import Contacts
from grasp3d.quality import Acceleration, Weight, Wrenches, grip_force, payload
from grasp3d.quality.hand_forces.actuation import Actuation
from grasp3d.quality.hand_forces.cone_program import ConeProgram, Solution
from grasp3d.quality.hand_forces.hand_grasp import HandGrasp
from grasp3d.quality.hand_forces.payloads import HandPayload, hand_payload
from grasp3d.quality.hand_forces.wrench_slice import WrenchSlice
from tests.helpers.random_hands import driven, random_hand, with_normals, worst_grasp

STANDARD_GRAVITY = 9.80665


def random_wrench(grasp: HandGrasp, generator: np.random.Generator) -> np.ndarray[Any, Any]:
    """A wrench that the contacts balance, if the drives can press them so."""
    count = grasp.contacts.count
    sideways = 0.7 * grasp.contacts.friction * generator.uniform(-1.0, 1.0, size=count)
    forces = grasp.frames[:, 0] + sideways[:, None] * grasp.frames[:, 1]
    return -grasp.balance(forces * generator.uniform(size=(count, 1)))


def worst_tilts(
    hands: int, seed: int
) -> Iterator[tuple[HandGrasp, np.ndarray[Any, Any], np.ndarray[Any, Any], HandPayload]]:
    """Random hands, a wrench, tilts, and the payload over them."""
    generator = np.random.default_rng(seed)
    for _ in range(hands):
        grasp = random_hand(generator)
        tilts = 0.9 * generator.uniform(size=grasp.contacts.count) * grasp.contacts.friction_angle
        wrench = random_wrench(grasp, generator)
        yield grasp, wrench, tilts, hand_payload(grasp, wrench, tilt=tilts)


def check_worst_tilt(
    grasp: HandGrasp,
    wrench: np.ndarray[Any, Any],
    tilts: np.ndarray[Any, Any],
    found: HandPayload,
    tries: int,
    generator: np.random.Generator,
) -> bool:
    """The certificate's tilt reaches the payload, no other falls below it; whether it is any."""
    assert found.limiting.proven
    if not 1e-6 < found.lower < math.inf:
        return False
    assert found.upper - found.lower <= 1e-6 * found.upper
    worst = worst_grasp(found, tilts)
    angles = np.arccos(np.clip((worst.contacts.normals * grasp.contacts.normals).sum(1), -1, 1))
    assert (angles <= tilts + 1e-7).all()
    assert hand_payload(worst, wrench).value == pytest.approx(found.value, rel=1e-6)
    # Searched: random tilts, and steps from the best of them.
    best, normals = math.inf, grasp.contacts.normals
    for k in range(2 * tries):
        start, size = (grasp.contacts.normals, 1.0) if k < tries else (normals, 0.2)
        moved = start + size * np.tan(tilts)[:, None] * generator.normal(size=start.shape)
        other = within(moved, grasp.contacts.normals, tilts)
        value = hand_payload(with_normals(grasp, other), wrench).value
        assert value >= found.value * (1.0 - 1e-6)
        if value < best:
            best, normals = value, other
    return True


def within(
    moved: np.ndarray[Any, Any], normals: np.ndarray[Any, Any], tilts: np.ndarray[Any, Any]
) -> np.ndarray[Any, Any]:
    """Directions, turned back to within the tilts of normals."""
    unit = moved / np.linalg.norm(moved, axis=1, keepdims=True)
    across = unit - (unit * normals).sum(axis=1, keepdims=True) * normals
    length = np.linalg.norm(across, axis=1, keepdims=True)
    angle = np.arctan2(length, (unit * normals).sum(axis=1, keepdims=True))
    angle = np.minimum(angle, tilts[:, None])
    return np.cos(angle) * normals + np.sin(angle) * across / np.maximum(length, 1e-300)


def test_the_tilt_of_a_certificate_is_the_worst() -> None:
    generator = np.random.default_rng(0)
    reached = [check_worst_tilt(*case, 2, generator) for case in worst_tilts(8, 5)]
    assert sum(reached) >= 4


@pytest.mark.slow
def test_the_tilt_of_a_certificate_is_the_worst_for_400_hands() -> None:
    generator = np.random.default_rng(1)
    reached = [check_worst_tilt(*case, 25, generator) for case in worst_tilts(400, 6)]
    assert sum(reached) >= 150


LENGTHS, LIMIT = (0.04, 0.03), 0.3


def fingertip(direction: tuple[float, float, float]) -> HandGrasp:
    """A fingertip at the origin, its last two joints along z at distances on a bent finger."""
    axes = np.array([[-0.05, -0.03, 0.0], [-0.02, -0.02, 0.0]])
    columns = [np.cross([0.0, 0.0, 1.0], -axis) for axis in axes]
    jacobian = np.stack([*columns, [0.0, 0.0, 0.06]], axis=1)[None]  # a lateral joint besides
    arms = [[1.0, 1.0, 0.0], [0.0, 0.0, 1.0]]
    actuation = Actuation.of_hand([LIMIT, LIMIT], joints=3, arms=arms)
    contacts = Contacts([[0.0, 0.0, 0.0]], [direction], 0.5)
    return HandGrasp(contacts, jacobian, actuation)


def test_a_differential_presses_only_along_the_line_between_its_axes() -> None:
    line = np.array([0.03, 0.01, 0.0]) / math.hypot(0.03, 0.01)
    across = np.array([-line[1], line[0], 0.0])
    along = hand_payload(fingertip(tuple(line)), [*-line, 0, 0, 0])
    arm = abs(np.cross([0.05, 0.03, 0.0], line)[2])
    assert along.value == pytest.approx(LIMIT / arm, rel=1e-7)
    off = hand_payload(fingertip(tuple(across)), [*-across, 0, 0, 0])
    assert off.upper <= 1e-9


@pytest.mark.parametrize("friction", [0.3, 0.8])
def test_two_planar_fingers_hold_a_disc_by_a_closed_form(friction: float) -> None:
    radius, limits = 0.03, np.array([0.4, 0.2])
    arms = np.array([[0.02, 0.09], [0.01, 0.05]])  # from each joint to the contact on the left
    jacobian = np.zeros((2, 3, 4))
    for side, sign in enumerate((1.0, -1.0)):
        for joint, (x, y) in enumerate(arms):
            jacobian[side, :, 2 * side + joint] = np.cross([0.0, 0.0, 1.0], [sign * x, y, 0.0])
    contacts = Contacts([[-radius, 0, 0], [radius, 0, 0]], [[1, 0, 0], [-1, 0, 0]], friction)
    grasp = HandGrasp(contacts, jacobian, Actuation.of_hand([*limits, *limits], joints=4))
    found = hand_payload(grasp, Weight(direction=(0.0, -1.0, 0.0)))
    pressing = (limits / (arms[:, 1] - friction * arms[:, 0])).min()
    assert found.value == pytest.approx(2.0 * friction * pressing / STANDARD_GRAVITY, rel=1e-7)
    strongest = int((limits / (arms[:, 1] - friction * arms[:, 0])).argmin())
    assert found.limit in (f"joint {strongest}", f"joint {strongest + 2}")


def ball_grasp(seed: int, count: int = 4, friction: float = 0.8) -> Contacts:
    """Contacts about a ball, pressing inward but for some disorder."""
    generator = np.random.default_rng(seed)
    directions = generator.normal(size=(count, 3))
    directions -= directions.mean(axis=0)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    normals = -directions + 0.1 * generator.normal(size=(count, 3))
    return Contacts(0.03 * directions, normals, friction)


@pytest.mark.parametrize("motors", [0, 6])
def test_strong_motors_hold_what_the_largest_forces_hold(motors: int) -> None:
    generator = np.random.default_rng(7)
    contacts = ball_grasp(2)
    jacobian = 0.03 * generator.normal(size=(4, 3, motors))
    actuation = Actuation.of_hand(np.full(motors, 1e9), joints=motors)
    grasp = HandGrasp(contacts, jacobian, actuation, most_force=10.0)
    for _ in range(5):
        wrench = generator.normal(size=6) * [1, 1, 1, 0.02, 0.02, 0.02]
        force = grip_force(contacts, wrench, bound="norm", rtol=1e-7).value
        assert hand_payload(grasp, wrench).value == pytest.approx(10.0 / force, rel=1e-6)


TASKS = [
    Weight(),
    Weight(direction=(0.0, 0.3, -1.0), within=0.4),
    Weight(direction=(0.0, 0.3, -1.0)),
    Weight() + Acceleration(acceleration=3.0),
    Weight() + Wrenches([[0.0, 0.0, 1.0, 0.0, 0.0, 0.01]]),
]


@pytest.mark.parametrize("task", TASKS, ids=str)
def test_tasks_are_those_of_the_payload_of_forces(task: grasp3d.quality.Task) -> None:
    contacts = ball_grasp(2)
    actuation = Actuation.of_hand([], joints=0)
    grasp = HandGrasp(contacts, np.zeros((4, 3, 0)), actuation, most_force=10.0)
    found = hand_payload(grasp, task, rtol=1e-2)
    expected = payload(contacts, task, 10.0, bound="norm", rtol=1e-6)
    assert found.lower <= expected * (1.0 + 1e-6)
    assert found.upper >= expected * (1.0 - 1e-6)
    assert found.upper - found.lower <= 1.01e-2 * found.upper


def hand_of(seed: int, torque: float = 0.5, friction: float = 0.8, size: float = 1.0) -> HandGrasp:
    """Four contacts with twelve motors."""
    contacts = ball_grasp(2)
    contacts = Contacts(size * contacts.points, contacts.normals, friction)
    jacobian = 0.03 * size * np.random.default_rng(seed).normal(size=(4, 3, 12))
    actuation = Actuation.of_hand(np.full(12, torque), joints=12)
    return HandGrasp(contacts, jacobian, actuation)


def test_payload_grows_with_torque_and_not_with_the_size_of_all() -> None:
    base = hand_payload(hand_of(1), Weight(direction=(0, 0, -1))).value
    more = hand_payload(hand_of(1, torque=1.5), Weight(direction=(0, 0, -1))).value
    assert more == pytest.approx(3.0 * base, rel=1e-7)
    larger = hand_payload(hand_of(1, torque=5.0, size=10.0), Weight(direction=(0, 0, -1))).value
    assert larger == pytest.approx(base, rel=1e-7)


@settings(max_examples=10, deadline=None)
@given(seed=st.integers(0, 10**6), factor=st.floats(1.0, 3.0), part=st.integers(0, 10**6))
def test_more_torque_friction_or_contacts_never_hold_less(
    seed: int, factor: float, part: int
) -> None:
    generator = np.random.default_rng(seed)
    grasp = random_hand(generator)
    wrench = random_wrench(grasp, generator)
    found = hand_payload(grasp, wrench)
    least = found.lower * (1.0 - 1e-6) - 1e-9 if math.isfinite(found.lower) else 1e3
    actuation, contacts = grasp.actuation, grasp.contacts
    some = np.ones(len(actuation.lower))
    some[part % len(some)] = factor
    stronger = replace(actuation, lower=some * actuation.lower, upper=some * actuation.upper)
    assert hand_payload(driven(grasp, stronger), wrench).upper >= least
    friction = contacts.friction.copy()
    friction[part % contacts.count] *= factor
    rougher = Contacts(contacts.points, contacts.normals, friction)
    assert hand_payload(HandGrasp(rougher, grasp.jacobian, actuation), wrench).upper >= least
    point = 0.03 * generator.normal(size=(1, 3))
    more = Contacts(
        np.concatenate([contacts.points, point]),
        np.concatenate([contacts.normals, generator.normal(size=(1, 3))]),
        np.append(contacts.friction, 0.5),
    )
    jacobian = np.concatenate(
        [grasp.jacobian, generator.normal(size=(1, *grasp.jacobian[0].shape))]
    )
    assert hand_payload(HandGrasp(more, jacobian, actuation), wrench).upper >= least


def test_duals_say_what_a_tenth_more_would_help() -> None:
    grasp = hand_of(3)
    wrench = random_wrench(grasp, np.random.default_rng(0))
    found = hand_payload(grasp, wrench, tilt=0.1)
    assert found.drive_shares.sum() == pytest.approx(found.value, rel=1e-7)
    step = 1e-3
    for drive in np.flatnonzero(found.drive_shares):
        factors = np.ones(12)
        factors[drive] += step
        limits = 0.5 * factors
        stronger = driven(grasp, Actuation.of_hand(limits, joints=12))
        more = hand_payload(stronger, wrench, tilt=0.1).value - found.value
        assert more / step == pytest.approx(found.drive_shares[drive], rel=1e-2, abs=1e-5)
    for contact in range(4):
        friction = grasp.contacts.friction.copy()
        friction[contact] *= 1.001
        contacts = Contacts(grasp.contacts.points, grasp.contacts.normals, friction)
        rougher = HandGrasp(contacts, grasp.jacobian, grasp.actuation)
        more = hand_payload(rougher, wrench, tilt=0.1).value - found.value
        assert 100.0 * more == pytest.approx(found.friction_gains[contact], rel=0.1, abs=1e-3)
    assert found.limit == f"joint {found.drive_shares.argmax()}"


def test_no_motor_limits_what_contacts_do_not_hold_at_all() -> None:
    for seed in (28, 29):
        found = hand_payload(random_hand(np.random.default_rng(seed)), Weight(), tilt=0.4)
        assert found.value == 0.0
        assert found.limit.startswith("friction") or found.limit == "the place of the contacts"


def test_a_hand_that_cannot_hold_its_own_links_holds_nothing() -> None:
    grasp = hand_of(1)
    heavy = [[0.0, 0.0, 0.6 / STANDARD_GRAVITY], *np.zeros((11, 3))]
    weak = Actuation.of_hand(np.full(12, 0.5), joints=12, links=heavy)
    free = HandGrasp(grasp.contacts, np.zeros((4, 3, 12)), weak)
    for task in (Weight(), Weight(direction=(0, 0, -1))):
        found = hand_payload(free, task)
        assert found.lower == 0.0
        assert found.upper <= 1e-3
        assert found.limit == "the weight of the links"


def test_without_any_limit_the_payload_has_none() -> None:
    unlimited = Actuation.of_hand(np.full(12, math.inf), joints=12)
    grasp = driven(hand_of(1), unlimited)
    found = hand_payload(grasp, Weight(direction=(0, 0, -1)))
    assert found.lower == found.upper == math.inf
    assert found.limit == "nothing"


def test_weight_of_the_links_is_taken_from_what_motors_hold() -> None:
    contacts = Contacts([[-0.02, 0, 0], [0.02, 0, 0]], [[1, 0, 0], [-1, 0, 0]], 0.5)
    jacobian = [[[0.05, 0], [0, 0], [0, 0]], [[0, -0.05], [0, 0], [0, 0]]]
    links = [[0.0, 0.0, -0.05 / STANDARD_GRAVITY], [0.0, 0.0, 0.0]]
    loaded = Actuation.of_hand([0.2, 0.2], joints=2, links=links)
    found = hand_payload(HandGrasp(contacts, jacobian, loaded), Weight(direction=(0, 0, -1)))
    assert found.value == pytest.approx(0.15 / 0.05 / STANDARD_GRAVITY, rel=1e-7)
    assert found.limit == "joint 0"


def test_what_is_held_only_with_a_load_is_no_payload() -> None:
    contacts = Contacts([[-0.02, 0, 0], [0.02, 0, 0]], [[1, 0, 0], [-1, 0, 0]], 0.5)
    jacobian = [[[0.05, 0], [0, 0], [0, 0]], [[0, -0.05], [0, 0], [0, 0]]]
    grasp = HandGrasp(contacts, jacobian, Actuation.of_hand([0.2, 0.2], joints=2))  # 4 N up or down
    down = Weight(direction=(0, 0, -1))
    for lifted, held in ((3.0, (4.0 + 3.0) / STANDARD_GRAVITY), (10.0, 0.0)):
        lift = Wrenches([[0.0, 0.0, lifted, 0.0, 0.0, 0.0]])
        assert hand_payload(grasp, down + lift).value == pytest.approx(held, rel=1e-7)


def test_proofs_do_not_rest_on_the_solver(monkeypatch: pytest.MonkeyPatch) -> None:
    grasp, wrench = hand_of(1), [0.0, 0.0, -1.0, 0.0, 0.0, 0.0]
    right = hand_payload(grasp, wrench)
    solve = ConeProgram.solve
    fails = {"first"}

    def unreliable(self: ConeProgram, cost: Any, *, retry: bool = False) -> Solution:
        found = solve(self, cost, retry=retry)
        if "always" in fails or not retry:
            noise = 1.0 + np.arange(len(found.x)) / len(found.x)
            return replace(found, x=noise * found.x, z=found.z[::-1], status="InsufficientProgress")
        return found

    monkeypatch.setattr(ConeProgram, "solve", unreliable)
    assert hand_payload(grasp, wrench).value == pytest.approx(right.value, rel=1e-6)
    fails.add("always")
    found = hand_payload(grasp, wrench)
    assert found.lower <= right.lower * (1.0 + 1e-6)
    assert found.upper >= right.upper * (1.0 - 1e-6)


def test_bounds_of_motions_that_prove_nothing_are_infinite() -> None:
    grasp = hand_of(1)
    part = WrenchSlice(grasp, grasp.half_angles(), np.eye(6)[:1], np.zeros(6))
    found = part.reach(np.ones(1))
    upper, slack = part.bound(found.twist, found.motion)
    assert upper == found.upper
    assert slack == found.slack
    assert part.bound(found.twist, 0.5 * found.motion)[0] == math.inf
    unlimited = driven(grasp, Actuation.of_hand(np.full(12, math.inf), joints=12))
    free = WrenchSlice(unlimited, grasp.half_angles(), np.eye(6)[:1], np.zeros(6))
    assert free.bound(found.twist, found.motion)[0] == math.inf
