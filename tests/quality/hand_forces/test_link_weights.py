"""Payloads of hands whose links weigh something, which turns with the load."""

import math

import numpy as np
import pytest

from grasp3d.contact.contacts import Contacts
from grasp3d.quality.hand_forces.actuation import Actuation
from grasp3d.quality.hand_forces.hand_grasp import HandGrasp
from grasp3d.quality.hand_forces.payloads import hand_payload, links_weigh
from grasp3d.quality.tasks import STANDARD_GRAVITY, Task, Weight, Wrenches

MOST, FRICTION = 20.0, 0.3


def jaws(mass: float, *, least: float = -MOST) -> HandGrasp:
    """Two fingers that slide along x, of a mass each, with a part between them."""
    contacts = Contacts([[-0.02, 0, 0], [0.02, 0, 0]], [[1, 0, 0], [-1, 0, 0]], FRICTION)
    slides = [[[1, 0], [0, 0], [0, 0]], [[0, 0], [0, 0], [0, 0]]]
    slides[1][0][1] = -1  # both values grow where the fingers close
    links = [[-mass, 0.0, 0.0], [mass, 0.0, 0.0]]
    return HandGrasp(
        contacts, slides, Actuation.of_hand([[least, MOST]] * 2, joints=2, links=links)
    )


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
    assert found.value == pytest.approx(closed_form(0.5, np.array(angle)), rel=1e-6)
    assert found.upper == pytest.approx(found.lower, rel=1e-6)


@pytest.mark.slow
@pytest.mark.parametrize("mass", [0.05, 0.5, 1.2])
def test_in_any_direction_it_is_that_of_the_worst(mass: float) -> None:
    expected = closed_form(mass, np.linspace(0.0, 0.5 * math.pi, 20001)).min()
    found = hand_payload(jaws(mass), Weight(), rtol=1e-2)
    assert found.lower <= expected * (1.0 + 1e-6)
    assert found.upper >= expected * (1.0 - 1e-6)
    assert found.upper - found.lower <= 1e-2 * found.upper


def test_links_may_rest_on_the_part_where_tendons_only_pull() -> None:
    two_way, pulled = (
        hand_payload(jaws(0.1, least=least), Weight(), rtol=5e-2) for least in (-MOST, 0.0)
    )
    assert pulled.lower == pytest.approx(two_way.lower, rel=5e-2)
    assert pulled.programs > two_way.programs  # without the part nothing holds them


def test_links_that_motors_cannot_hold_leave_nothing() -> None:
    too_heavy = 1.01 * MOST / STANDARD_GRAVITY
    found = hand_payload(jaws(too_heavy), Weight(), rtol=5e-2)
    assert found.lower == 0.0
    assert found.upper < 0.1
    assert hand_payload(jaws(too_heavy), Weight(direction=(1, 0, 0))).upper == 0.0


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
        drives = Actuation.of_hand([0.7] * 6, joints=6, links=links)
        grasp = HandGrasp(Contacts(-0.03 * normals, normals, 0.8), jacobian, drives)
        found = hand_payload(grasp, Weight(), rtol=1e-2)
        for way in generator.normal(size=(20, 3)):
            assert found.lower <= hand_payload(grasp, Weight(direction=way)).upper


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
