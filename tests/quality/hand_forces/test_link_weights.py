"""Payloads of hands whose links weigh something, which turns with the load."""

import math

import numpy as np
import pytest

from grasp3d.contact.contacts import Contacts
from grasp3d.quality.actuation import Actuation
from grasp3d.quality.hand_forces import HandGrasp, hand_payload, links_weigh
from grasp3d.quality.tasks import STANDARD_GRAVITY, Task, Weight, Wrenches

MOST, FRICTION = 20.0, 0.3


def jaws(mass: float, *, most: float = MOST, friction: float = FRICTION) -> HandGrasp:
    """Two fingers that slide along x, of a mass each, with a part between them.

    A negative mass is a counterweight.
    """
    contacts = Contacts([[-0.02, 0, 0], [0.02, 0, 0]], [[1, 0, 0], [-1, 0, 0]], friction)
    slides = [[[1, 0], [0, 0], [0, 0]], [[0, 0], [0, 0], [0, 0]]]
    slides[1][0][1] = -1  # both values grow where the fingers close
    links = [[-mass, 0.0, 0.0], [mass, 0.0, 0.0]]
    return HandGrasp(contacts, slides, Actuation([most] * 2, links=links))


def palm(mass: float) -> HandGrasp:
    """A part on three supports, and a finger that presses on it from above, with a weight on it."""
    points = [[0.03, 0, -0.03], [-0.015, 0.026, -0.03], [-0.015, -0.026, -0.03], [0, 0, 0.03]]
    normals = [[0, 0, 1]] * 3 + [[0, 0, -1]]
    jacobian = np.zeros((4, 3, 1))
    jacobian[3, 2, 0] = -0.1
    drives = Actuation([0.1], links=[[0, 0, 0.1 * mass]])
    return HandGrasp(Contacts(points, normals, 0.5), jacobian, drives)


def caged(mass: float) -> HandGrasp:
    """A part between six supports without limit, and a link that touches nothing."""
    normals = np.concatenate([np.eye(3), -np.eye(3)])
    drives = Actuation([0.1], links=[[0, 0, 0.1 * mass]])
    return HandGrasp(Contacts(-0.03 * normals, normals, 0.5), np.zeros((6, 3, 1)), drives)


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
@pytest.mark.parametrize("mass", [0.05, 0.5, 1.2])
def test_in_any_direction_it_is_that_of_the_worst(mass: float) -> None:
    expected = closed_form(mass, np.linspace(0.0, 0.5 * math.pi, 20001)).min()
    found = hand_payload(jaws(mass), Weight(), rtol=1e-2)
    assert found.lower <= expected * (1.0 + 1e-6)
    assert found.upper >= expected * (1.0 - 1e-6)
    assert found.upper - found.lower <= 1e-2 * found.upper


@pytest.mark.slow
@pytest.mark.parametrize("friction", [0.3, 1.0])
def test_counterweights_hold_more_in_any_direction(friction: float) -> None:
    grasp = jaws(-0.5, friction=friction)
    angles = np.linspace(0.0, 0.5 * math.pi, 200)
    ways = np.stack([np.cos(angles), np.zeros(200), np.sin(angles)], axis=1)
    found, expected = hand_payload(grasp, Weight(), rtol=1e-2), least_of(grasp, ways)
    assert found.lower <= expected <= found.upper * (1.0 + 1e-4)
    assert found.upper - found.lower <= 1e-2 * found.upper
    assert found.lower > 1.02 * hand_payload(jaws(0.0, friction=friction), Weight()).upper


@pytest.mark.slow
def test_a_weight_on_the_finger_helps_to_press_on_a_palm() -> None:
    angles = np.linspace(0.0, math.pi / 4, 100)
    turns = np.linspace(0.0, 2.0 * math.pi, 7)[:-1, None]
    ways = [
        np.sin(angles) * np.cos(turns),
        np.sin(angles) * np.sin(turns),
        -np.cos(angles) + 0 * turns,
    ]
    expected = least_of(palm(0.1), np.stack(ways, axis=-1).reshape(-1, 3))
    task = Weight(direction=(0, 0, -1), within=math.pi / 4)
    found = hand_payload(palm(0.1), task, rtol=1e-2)
    assert found.lower <= expected <= found.upper * 1.002
    assert found.upper - found.lower <= 1e-2 * found.upper


def test_a_caged_part_is_held_where_the_links_are() -> None:
    heavy, light = (hand_payload(caged(mass), Weight()) for mass in (0.5, 0.05))
    assert heavy.lower == 0.0
    assert heavy.limit == "the weight of the links"
    assert light.lower > 0.99 * 1000.0 / STANDARD_GRAVITY
    assert light.limit == "the largest contact force"
    assert hand_payload(caged(0.5), Weight(direction=(0, 0, -1))).upper == 0.0


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


def test_links_that_motors_cannot_hold_leave_nothing() -> None:
    too_heavy = 1.01 * MOST / STANDARD_GRAVITY
    found = hand_payload(jaws(too_heavy), Weight(), rtol=5e-2)
    assert found.lower == 0.0
    assert found.upper < 0.1
    assert hand_payload(jaws(too_heavy), Weight(direction=(1, 0, 0))).upper == 0.0


@pytest.mark.slow
def test_what_only_pushes_one_side_holds_nothing() -> None:
    """Three contacts of one finger with heavy links."""
    generator = np.random.default_rng(0)
    for _ in range(12):
        normals = generator.normal(size=(3, 3)) + [2.0, 0.0, 0.0]
        contacts = Contacts(0.05 * generator.normal(size=(3, 3)), normals, 0.5)
        jacobian = 0.05 * generator.normal(size=(3, 3, 4))
        links = 0.002 * generator.normal(size=(4, 3))
        drives = Actuation([0.9] * 4, links=links)
        found = hand_payload(HandGrasp(contacts, jacobian, drives), Weight(), tilt=0.2, rtol=1e-2)
        assert found.lower == 0.0
        assert found.upper < 1e-4


def test_the_cone_within_which_gravity_acts_counts_for_links() -> None:
    angles = np.linspace(math.pi / 2 - 0.4, math.pi / 2, 20001)
    found = hand_payload(jaws(0.5), Weight(direction=(0, 0, -1), within=0.4), rtol=1e-2)
    expected = closed_form(0.5, angles).min()
    assert found.lower <= expected * (1.0 + 1e-6)
    assert found.upper == pytest.approx(expected, rel=1e-2)


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
