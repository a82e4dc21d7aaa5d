"""What the motors of a hand hold: an oracle, closed forms, worst tilts and laws."""

import math
from types import SimpleNamespace
from typing import Any

import clarabel
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import grasp3d
from grasp3d.arrays import Floats
from grasp3d.contact.contacts import Contacts, turned
from grasp3d.errors import ContactError, SettingError
from grasp3d.quality import Acceleration, Weight, Wrenches, grip_force, payload
from grasp3d.quality.actuation import Actuation
from grasp3d.quality.hand_forces import HandGrasp, hand_payload
from tests.helpers.random_hands import by_polygons, driven, random_hand, with_normals

STANDARD_GRAVITY = 9.80665


def random_wrench(grasp: HandGrasp, generator: np.random.Generator) -> Floats:
    """A wrench that the contacts balance, if the drives can press them so."""
    contacts = grasp.contacts
    sideways = turned(
        contacts.normals, generator.normal(size=(contacts.count, 3)), np.full(contacts.count, 0.3)
    )
    forces = generator.uniform(size=(contacts.count, 1)) * sideways
    moments = np.cross(contacts.points, forces)
    return -np.concatenate([forces.sum(axis=0), moments.sum(axis=0)])


def check_polygons(hands: int, seed: int) -> tuple[int, int]:
    """Compare random hands with the oracle; how many loads are held, and how many are not."""
    generator = np.random.default_rng(seed)
    held = []
    for _ in range(hands):
        grasp = random_hand(generator)
        tilts = generator.uniform(0.0, 0.9, grasp.contacts.count) * grasp.contacts.friction_angle
        weight = Weight(direction=tuple(generator.normal(size=3)))
        for task, weighs in ((Wrenches(random_wrench(grasp, generator)), False), (weight, True)):
            (wrench,) = task.corners()
            found = hand_payload(grasp, task, tilt=tilts)
            angles = grasp.contacts.friction_angle - tilts
            inside, outside = (
                by_polygons(grasp, wrench, angles, outside=one, weighs=weighs).payload
                for one in (False, True)
            )
            size = 1e-6 * (1.0 + outside)
            assert inside - size <= found.upper
            assert found.lower <= outside + size
            if inside > 0.0:
                assert found.lower >= inside - size
                assert found.upper - found.lower <= 1e-6 * found.upper
            held.append(inside > 1e-3)
    return sum(held), len(held) - sum(held)


def test_payloads_are_between_those_of_polygons_in_the_cones_and_around_them() -> None:
    assert min(check_polygons(25, 3)) >= 10


@pytest.mark.slow
def test_payloads_of_1000_hands_are_between_those_of_polygons() -> None:
    assert min(check_polygons(1000, 4)) >= 200


def check_worst_tilt(hands: int, seed: int, tries: int) -> int:
    """No tilts hold less than the cones beta - a, and those of the oracle's proof no more.

    The oracle's relative velocities prove that no more is possible in those cones. With each normal
    turned away from them they prove the same for the full cones.
    """
    generator, reached = np.random.default_rng(seed), 0
    for _ in range(hands):
        grasp = random_hand(generator)
        contacts, normals = grasp.contacts, grasp.contacts.normals
        tilts = generator.uniform(0.0, 0.9, contacts.count) * contacts.friction_angle
        wrench = random_wrench(grasp, generator)
        found = hand_payload(grasp, wrench, tilt=tilts)
        for _ in range(tries):
            moved = normals + np.tan(tilts)[:, None] * generator.normal(size=normals.shape)
            other = with_normals(grasp, within(moved, normals, tilts))
            assert hand_payload(other, wrench).upper >= found.lower * (1.0 - 1e-6)
        angles = contacts.friction_angle - tilts
        proof = by_polygons(grasp, wrench, angles, outside=True, edges=96)
        # Around the cones the oracle limits normal components, which is less than forces.
        if found.lower > 1e-3 and found.limit != "the largest contact force":
            worst = with_normals(grasp, turned(normals, -proof.velocities, tilts))
            value = hand_payload(worst, wrench).lower
            assert found.lower * (1.0 - 1e-6) <= value <= found.lower * (1.0 + 1e-2)
            reached += 1
    return reached


def test_no_tilts_hold_less_and_the_worst_no_more() -> None:
    assert check_worst_tilt(10, 5, 3) >= 4


@pytest.mark.slow
def test_no_tilts_hold_less_and_the_worst_no_more_for_400_hands() -> None:
    assert check_worst_tilt(400, 6, 25) >= 150


def within(moved: Floats, normals: Floats, tilts: Floats) -> Floats:
    """Directions, turned back to within the tilts of normals."""
    unit = moved / np.linalg.norm(moved, axis=1, keepdims=True)
    across = unit - (unit * normals).sum(axis=1, keepdims=True) * normals
    length = np.linalg.norm(across, axis=1, keepdims=True)
    angle = np.arctan2(length, (unit * normals).sum(axis=1, keepdims=True))
    angle = np.minimum(angle, tilts[:, None])
    return np.cos(angle) * normals + np.sin(angle) * across / np.maximum(length, 1e-300)


@pytest.mark.parametrize("friction", [0.3, 0.8])
def test_two_planar_fingers_hold_a_disc_by_a_closed_form(friction: float) -> None:
    radius, limits = 0.03, np.array([0.4, 0.2])
    arms = np.array([[0.02, 0.09], [0.01, 0.05]])  # from each joint to the contact on the left
    jacobian = np.zeros((2, 3, 4))
    for side, sign in enumerate((1.0, -1.0)):
        for joint, (x, y) in enumerate(arms):
            jacobian[side, :, 2 * side + joint] = np.cross([0.0, 0.0, 1.0], [sign * x, y, 0.0])
    contacts = Contacts([[-radius, 0, 0], [radius, 0, 0]], [[1, 0, 0], [-1, 0, 0]], friction)
    grasp = HandGrasp(contacts, jacobian, Actuation([*limits, *limits]))
    found = hand_payload(grasp, Weight(direction=(0.0, -1.0, 0.0)))
    pressing = (limits / (arms[:, 1] - friction * arms[:, 0])).min()
    assert found.lower == pytest.approx(2.0 * friction * pressing / STANDARD_GRAVITY, rel=1e-7)
    strongest = int((limits / (arms[:, 1] - friction * arms[:, 0])).argmin())
    assert found.limit in (f"motor {strongest}", f"motor {strongest + 2}")


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
    actuation = Actuation(np.full(motors, 1e9))
    grasp = HandGrasp(contacts, jacobian, actuation, most_force=10.0)
    for _ in range(5):
        wrench = generator.normal(size=6) * [1, 1, 1, 0.02, 0.02, 0.02]
        force = grip_force(contacts, wrench, bound="norm", rtol=1e-7).value
        assert hand_payload(grasp, wrench).lower == pytest.approx(10.0 / force, rel=1e-6)


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
    actuation = Actuation([])
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
    actuation = Actuation(np.full(12, torque))
    return HandGrasp(contacts, jacobian, actuation)


def test_payload_grows_with_torque_and_not_with_the_size_of_all() -> None:
    base = hand_payload(hand_of(1), Weight(direction=(0, 0, -1))).lower
    more = hand_payload(hand_of(1, torque=1.5), Weight(direction=(0, 0, -1))).lower
    assert more == pytest.approx(3.0 * base, rel=1e-7)
    larger = hand_payload(hand_of(1, torque=5.0, size=10.0), Weight(direction=(0, 0, -1))).lower
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
    some = np.ones(len(actuation.limits))
    some[part % len(some)] = factor
    stronger = object.__new__(Actuation)
    for name, value in vars(actuation).items():
        object.__setattr__(stronger, name, some * value if name == "limits" else value)
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


def test_the_limit_is_the_motor_of_which_more_would_help_most() -> None:
    for seed in range(5):
        grasp = hand_of(seed)
        wrench = random_wrench(grasp, np.random.default_rng(seed))
        found = hand_payload(grasp, wrench, tilt=0.1)
        more = [
            hand_payload(driven(grasp, Actuation(0.5 + 1e-3 * row)), wrench, tilt=0.1).lower
            for row in np.eye(12)
        ]
        assert found.limit == f"motor {np.argmax(more)}"
        assert max(more) > found.lower


def test_no_motor_limits_what_contacts_do_not_hold_at_all() -> None:
    for seed in (28, 29):
        found = hand_payload(random_hand(np.random.default_rng(seed)), Weight(), tilt=0.4)
        assert found.lower == 0.0
        assert found.limit == "what can be pressed at the contacts"


def test_a_hand_that_cannot_hold_its_own_links_holds_nothing() -> None:
    grasp = hand_of(1)
    heavy = [[0.0, 0.0, 0.6 / STANDARD_GRAVITY], *np.zeros((11, 3))]
    weak = Actuation(np.full(12, 0.5), links=heavy)
    free = HandGrasp(grasp.contacts, np.zeros((4, 3, 12)), weak)
    for task in (Weight(), Weight(direction=(0, 0, -1))):
        found = hand_payload(free, task)
        assert found.lower == 0.0
        assert found.upper <= 1e-3
        assert found.limit == "the weight of the links"


def test_what_no_motor_limits_is_limited_by_the_contact_forces() -> None:
    unlimited = Actuation(np.full(12, math.inf))
    grasp, down = driven(hand_of(1), unlimited), Weight(direction=(0, 0, -1))
    found = hand_payload(grasp, down)
    assert found.limit == "the largest contact force"
    held = payload(grasp.contacts, down, 1000.0, bound="norm", rtol=1e-7)
    assert found.lower == pytest.approx(held, rel=1e-6)
    assert hand_payload(grasp, np.zeros(6)).lower == math.inf


def test_weight_of_the_links_is_taken_from_what_motors_hold() -> None:
    contacts = Contacts([[-0.02, 0, 0], [0.02, 0, 0]], [[1, 0, 0], [-1, 0, 0]], 0.5)
    jacobian = [[[0.05, 0], [0, 0], [0, 0]], [[0, -0.05], [0, 0], [0, 0]]]
    links = [[0.0, 0.0, -0.05 / STANDARD_GRAVITY], [0.0, 0.0, 0.0]]
    loaded = Actuation([0.2, 0.2], links=links)
    found = hand_payload(HandGrasp(contacts, jacobian, loaded), Weight(direction=(0, 0, -1)))
    assert found.lower == pytest.approx(0.15 / 0.05 / STANDARD_GRAVITY, rel=1e-7)
    assert found.limit == "motor 0"


def test_two_contacts_hold_what_hangs_below_them() -> None:
    contacts = Contacts([[-0.02, 0, 0.01], [0.02, 0, 0.01]], [[1, 0, 0], [-1, 0, 0]], 0.5)
    jacobian = [[[0.05, 0], [0, 0], [0, 0]], [[0, -0.05], [0, 0], [0, 0]]]
    grasp = HandGrasp(contacts, jacobian, Actuation([0.2, 0.2]))
    held = hand_payload(grasp, Weight(direction=(0, 0, -1)))
    assert held.lower == pytest.approx(4.0 / STANDARD_GRAVITY, rel=1e-7)
    for task in (Weight(direction=(0, 1, 0)), Weight()):
        turned_off = hand_payload(grasp, task)
        assert turned_off.lower == turned_off.upper == 0.0
        assert turned_off.limit == "the turn about the line of the contacts"


def test_what_is_held_only_with_a_load_is_no_payload() -> None:
    contacts = Contacts([[-0.02, 0, 0], [0.02, 0, 0]], [[1, 0, 0], [-1, 0, 0]], 0.5)
    jacobian = [[[0.05, 0], [0, 0], [0, 0]], [[0, -0.05], [0, 0], [0, 0]]]
    grasp = HandGrasp(contacts, jacobian, Actuation([0.2, 0.2]))  # 4 N up or down
    down = Weight(direction=(0, 0, -1))
    for lifted, held in ((3.0, (4.0 + 3.0) / STANDARD_GRAVITY), (10.0, 0.0)):
        lift = Wrenches([[0.0, 0.0, lifted, 0.0, 0.0, 0.0]])
        assert hand_payload(grasp, down + lift).lower == pytest.approx(held, rel=1e-7)


@pytest.mark.parametrize("task", [[0.0, 0.0, -1.0, 0.0, 0.0, 0.0], Weight()])
def test_nothing_rests_on_points_and_statuses_of_a_solver_that_errs(
    monkeypatch: pytest.MonkeyPatch, task: Any
) -> None:
    grasp = hand_of(1)
    right = hand_payload(grasp, task)
    make = clarabel.DefaultSolver
    factor, status = 1.0, "Solved"

    class Unreliable:
        def __init__(self, *program: Any) -> None:
            self.solver = make(*program)
            self.update = self.solver.update

        def solve(self) -> SimpleNamespace:
            found = self.solver.solve()
            x = factor * np.array(found.x)
            return SimpleNamespace(
                x=x, s=found.s, z=found.z, obj_val_dual=found.obj_val_dual, status=status
            )

    monkeypatch.setattr(clarabel, "DefaultSolver", Unreliable)
    assert hand_payload(grasp, task) == right
    factor = 1.001
    wrong = hand_payload(grasp, task)
    assert wrong.lower == 0.0
    assert wrong.upper >= right.lower
    factor, status = 1.0, "InsufficientProgress"
    unknown = hand_payload(grasp, task)
    assert unknown.upper == math.inf
    assert unknown.lower <= right.upper


def test_shapes_and_limits_that_do_not_fit_are_refused() -> None:
    contacts = Contacts([[-0.02, 0, 0], [0.02, 0, 0]], [[1, 0, 0], [-1, 0, 0]], 0.5)
    motors = Actuation([0.2, 0.2])
    for limits, options, words in (
        ([0.2, -0.1], {}, "limits of motors must be one torque for each"),
        ([0.2, math.nan], {}, "limits of motors must be one torque for each"),
        ([0.2], {"stops": [1, 0]}, r"stops of 1 joints .* shape \(1,\)"),
        ([0.2], {"links": [[0, 0, math.inf]]}, r"links of 1 joints"),
    ):
        with pytest.raises(SettingError, match=words):
            Actuation(limits, **options)
    for points, jacobian, most, words in (
        (Contacts(contacts.points, contacts.normals, 0.5, 0.01), np.zeros((2, 3, 2)), 1.0, "hard"),
        (contacts, np.zeros((2, 3, 1)), 1.0, r"Jacobian must have shape \(2, 3, 2\)"),
        (contacts, np.zeros((2, 3, 2)), math.inf, "largest contact force must be above 0"),
    ):
        with pytest.raises(ContactError, match=words):
            HandGrasp(points, jacobian, motors, most_force=most)
    with pytest.raises(SettingError, match="rtol must lie between 0 and 1"):
        hand_payload(HandGrasp(contacts, np.zeros((2, 3, 2)), motors), Weight(), rtol=0.0)
