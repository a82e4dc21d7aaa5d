"""What the motors of a hand hold: an oracle, closed forms, worst tilts and laws."""

import math
from copy import copy
from types import SimpleNamespace
from typing import Any

import clarabel
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d.arrays import Floats
from grasp3d.contact.contacts import Contacts, turned
from grasp3d.errors import ContactError, SettingError
from grasp3d.quality import Acceleration, Weight, Wrenches, payload
from grasp3d.quality.actuation import Actuation
from grasp3d.quality.hand_forces import HandGrasp, hand_payload, links_weigh
from grasp3d.quality.tasks import STANDARD_GRAVITY, Task
from tests.helpers.random_hands import by_polygons, driven, random_hand, with_normals
from tests.helpers.tilts import random_tilts


def random_wrench(grasp: HandGrasp, generator: np.random.Generator) -> Floats:
    """A wrench that the contacts balance, if the drives can press them so."""
    contacts = grasp.contacts
    sideways = turned(
        contacts.normals, generator.normal(size=(contacts.count, 3)), np.full(contacts.count, 0.3)
    )
    forces = generator.uniform(size=(contacts.count, 1)) * sideways
    moments = np.cross(contacts.points, forces)
    return -np.concatenate([forces.sum(axis=0), moments.sum(axis=0)])


@pytest.mark.parametrize("hands", [25, pytest.param(150, marks=pytest.mark.slow)])
def test_payloads_are_between_those_of_polygons_in_the_cones_and_around_them(hands: int) -> None:
    generator = np.random.default_rng(hands)
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
    assert min(sum(held), len(held) - sum(held)) >= 0.2 * hands


@pytest.mark.parametrize("hands", [10, pytest.param(80, marks=pytest.mark.slow)])
def test_no_tilts_hold_less_and_the_worst_no_more(hands: int) -> None:
    """No tilts hold less than the cones beta - a, and those of the oracle's proof no more.

    The oracle's relative velocities prove that no more is possible in those cones. With each normal
    turned away from them they prove the same for the full cones.
    """
    generator, reached = np.random.default_rng(5), 0
    for _ in range(hands):
        grasp = random_hand(generator)
        contacts, normals = grasp.contacts, grasp.contacts.normals
        tilts = generator.uniform(0.0, 0.9, contacts.count) * contacts.friction_angle
        wrench = random_wrench(grasp, generator)
        found = hand_payload(grasp, wrench, tilt=tilts)
        for _ in range(5):
            other = with_normals(grasp, random_tilts(normals, tilts, generator))
            assert hand_payload(other, wrench).upper >= found.lower * (1.0 - 1e-6)
        angles = contacts.friction_angle - tilts
        proof = by_polygons(grasp, wrench, angles, outside=True, edges=96)
        # Around the cones the oracle limits normal components, which is less than forces.
        if found.lower > 1e-3 and found.limit != "the largest contact force":
            worst = with_normals(grasp, turned(normals, -proof.velocities, tilts))
            value = hand_payload(worst, wrench).lower
            assert found.lower * (1.0 - 1e-6) <= value <= found.lower * (1.0 + 1e-2)
            reached += 1
    assert reached >= 0.37 * hands


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


def ball_grasp(seed: int) -> Contacts:
    """Contacts about a ball, pressing inward but for some disorder."""
    generator = np.random.default_rng(seed)
    directions = generator.normal(size=(4, 3))
    directions -= directions.mean(axis=0)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    normals = -directions + 0.1 * generator.normal(size=(4, 3))
    return Contacts(0.03 * directions, normals, 0.8)


TASKS = [
    Weight(),
    Weight(direction=(0.0, 0.3, -1.0), within=0.4),
    Weight(direction=(0.0, 0.3, -1.0)),
    Weight() + Acceleration(acceleration=3.0),
    Weight() + Wrenches([[0.0, 0.0, 1.0, 0.0, 0.0, 0.01]]),
]


@pytest.mark.parametrize("task", TASKS, ids=str)
def test_tasks_are_those_of_the_payload_of_forces(task: Task) -> None:
    contacts = ball_grasp(2)
    actuation = Actuation([])
    grasp = HandGrasp(contacts, np.zeros((4, 3, 0)), actuation, most_force=10.0)
    found = hand_payload(grasp, task, rtol=1e-2)
    expected = payload(contacts, task, 10.0, bound="norm", rtol=1e-6)
    assert found.lower <= expected * (1.0 + 1e-6)
    assert found.upper >= expected * (1.0 - 1e-6)
    assert found.upper - found.lower <= 1.01e-2 * found.upper
    assert found.limit == "the largest contact force"
    unlimited = HandGrasp(contacts, np.ones((4, 3, 2)), Actuation([math.inf] * 2), most_force=10.0)
    again = hand_payload(unlimited, task, rtol=1e-2)
    assert (again.lower, again.limit) == (pytest.approx(found.lower, rel=2e-2), found.limit)


def hand_of(seed: int) -> HandGrasp:
    """Four contacts with twelve motors."""
    jacobian = 0.03 * np.random.default_rng(seed).normal(size=(4, 3, 12))
    return HandGrasp(ball_grasp(2), jacobian, Actuation(np.full(12, 0.5)))


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
    stronger = copy(actuation)
    object.__setattr__(stronger, "limits", some * actuation.limits)
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


def pinch(height: float = 0.0) -> HandGrasp:
    """Two fingers that press with 4 N each, at a height above the centre of mass."""
    contacts = Contacts([[-0.02, 0, height], [0.02, 0, height]], [[1, 0, 0], [-1, 0, 0]], 0.5)
    jacobian = [[[0.05, 0], [0, 0], [0, 0]], [[0, -0.05], [0, 0], [0, 0]]]
    return HandGrasp(contacts, jacobian, Actuation([0.2, 0.2]))


def test_two_contacts_hold_what_hangs_below_them() -> None:
    grasp = pinch(0.01)
    held = hand_payload(grasp, Weight(direction=(0, 0, -1)))
    assert held.lower == pytest.approx(4.0 / STANDARD_GRAVITY, rel=1e-7)
    assert hand_payload(grasp, np.zeros(6)).lower == math.inf
    for task in (Weight(direction=(0, 1, 0)), Weight()):
        turned_off = hand_payload(grasp, task)
        assert turned_off.lower == turned_off.upper == 0.0
        assert turned_off.limit == "the turn about the line of the contacts"


def test_links_that_motors_cannot_hold_leave_nothing() -> None:
    too_heavy = jaws(1.01 * MOST / STANDARD_GRAVITY)
    found = hand_payload(too_heavy, Weight(), rtol=5e-2)
    assert (found.lower, found.upper < 0.1) == (0.0, True)
    assert hand_payload(too_heavy, Weight(direction=(1, 0, 0))).upper == 0.0


def test_what_is_held_only_with_a_load_is_no_payload() -> None:
    down = Weight(direction=(0, 0, -1))
    for lifted, held in ((3.0, (4.0 + 3.0) / STANDARD_GRAVITY), (10.0, 0.0)):
        lift = Wrenches([[0.0, 0.0, lifted, 0.0, 0.0, 0.0]])
        assert hand_payload(pinch(), down + lift).lower == pytest.approx(held, rel=1e-7)


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
    contacts, motors = pinch().contacts, pinch().actuation
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


MOST, FRICTION = 20.0, 0.3


def jaws(mass: float) -> HandGrasp:
    """Two fingers that slide along x, of a mass each, with a part between them.

    A negative mass is a counterweight.
    """
    contacts = Contacts([[-0.02, 0, 0], [0.02, 0, 0]], [[1, 0, 0], [-1, 0, 0]], FRICTION)
    slides = [[[1, 0], [0, 0], [0, 0]], [[0, 0], [0, 0], [0, 0]]]
    slides[1][0][1] = -1  # both values grow where the fingers close
    links = [[-mass, 0.0, 0.0], [mass, 0.0, 0.0]]
    return HandGrasp(contacts, slides, Actuation([MOST] * 2, links=links))


def lever(most: float) -> HandGrasp:
    """A link of 1 kg that turns about y, and has a cage of six contacts beyond the axis, as far."""
    normals = np.concatenate([np.eye(3), -np.eye(3)])
    contacts = Contacts(-0.03 * normals, normals, 0.5)
    arms = contacts.points + [0.1, 0.0, 0.0]
    jacobian = np.cross([0.0, 1.0, 0.0], arms)[:, :, None]
    return HandGrasp(contacts, jacobian, Actuation([most], links=[[0.0, 0.0, -0.1]]))


def least_of(grasp: HandGrasp, ways: np.ndarray) -> float:
    """The least payload of single directions."""
    return min(hand_payload(grasp, Weight(direction=tuple(way))).upper for way in ways)


def closed_form(mass: float, angles: np.ndarray) -> np.ndarray:
    """Payload where gravity acts at angles from the jaws' line.

    The motor of the lower finger carries its link, the part, and what the upper one presses; both
    carry half of the weight across by friction.
    """
    force = MOST / STANDARD_GRAVITY - mass * np.cos(angles)
    held: np.ndarray = force / (np.cos(angles) + np.sin(angles) / (2.0 * FRICTION))
    return held


@pytest.mark.parametrize("angle", [0.2, 0.9, 1.5])
def test_the_lower_finger_carries_the_links_and_the_part(angle: float) -> None:
    task = Weight(direction=(math.cos(angle), 0.0, math.sin(angle)))
    found = hand_payload(jaws(0.5), task)
    assert found.lower == pytest.approx(closed_form(0.5, np.array(angle)), rel=1e-6)
    assert found.upper == pytest.approx(found.lower, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("mass", "task", "first"),
    [
        (0.05, Weight(), 0.0),
        (1.2, Weight(), 0.0),
        (0.5, Weight(direction=(0, 0, -1), within=0.4), math.pi / 2 - 0.4),
    ],
)
def test_in_any_direction_it_is_that_of_the_worst(mass: float, task: Task, first: float) -> None:
    expected = closed_form(mass, np.linspace(first, 0.5 * math.pi, 20001)).min()
    found = hand_payload(jaws(mass), task, rtol=1e-2)
    assert found.lower <= expected * (1.0 + 1e-6)
    assert found.upper >= expected * (1.0 - 1e-6)
    assert found.upper - found.lower <= 1e-2 * found.upper


@pytest.mark.parametrize("task", [Weight(), Weight(direction=(0, 0.2, -1))])
def test_a_counterweight_is_no_payload_where_the_links_alone_are_not_held(task: Task) -> None:
    share = float(task.support([0, 0, -0.1, 0, 0, 0]))  # torque of 1 kg about y
    for torque, held in ((0.5 * share, False), (1.5 * share, True)):
        found = hand_payload(lever(torque), task, rtol=1e-2)
        balanced = 1.0 + torque / share
        assert found.upper >= balanced * (1.0 - 1e-6)
        if held:
            assert found.lower >= balanced * (1.0 - 1e-2)
            assert found.upper <= balanced * (1.0 + 1e-2)
        else:
            assert found.lower == 0.0
            assert found.limit == "the weight of the links"


@pytest.mark.slow
def test_random_hands_hold_the_payload_of_any_direction_in_each() -> None:
    generator = np.random.default_rng(4)
    links = 0.02 * generator.normal(size=(6, 3))
    for _ in range(3):
        directions = generator.normal(size=(3, 3))
        directions -= directions.mean(axis=0)
        normals = -directions / np.linalg.norm(directions, axis=1, keepdims=True)
        jacobian = np.zeros((3, 3, 6))
        for finger in range(3):
            block = slice(2 * finger, 2 * finger + 2)
            jacobian[finger, :, block] = 0.05 * generator.normal(size=(3, 2))
        drives = Actuation([0.7] * 6, links=links)
        grasp = HandGrasp(Contacts(-0.03 * normals, normals, 0.8), jacobian, drives)
        found = hand_payload(grasp, Weight(), rtol=1e-2)
        assert 0.0 < found.lower <= least_of(grasp, generator.normal(size=(50, 3)))
        assert found.upper - found.lower <= 1e-2 * found.upper


@pytest.mark.parametrize(
    ("task", "weighs"),
    [
        (Weight(), True),
        (Weight(direction=(1, 0, -1)) + Wrenches([[1.0, 0, 0, 0, 0, 0]]), True),
        (Weight() + Wrenches([[1.0, 0, 0, 0, 0, 0]]), False),
        (Wrenches([[1.0, 0, 0, 0, 0, 0]]), False),
    ],
)
def test_tasks_that_do_not_say_where_gravity_acts_neglect_links(task: Task, weighs: bool) -> None:
    assert links_weigh(task) == weighs
    with_links, without = (hand_payload(jaws(mass), task, rtol=5e-2).lower for mass in (0.5, 0.0))
    assert (with_links < without - 1e-6) == weighs
