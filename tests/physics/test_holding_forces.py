"""The smallest force that holds in simulation is the grip force that is computed."""

import math

import numpy as np
import pytest

from grasp3d import Contacts, grip_force
from grasp3d.errors import ContactError
from grasp3d.physics import holding_force, random_facets

OPPOSED = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]


def points(opening: float, center: tuple[float, float, float] = (0.0, 0.0, 0.0)) -> np.ndarray:
    """Contacts on the x axis, relative to a centre of mass."""
    return 0.5 * opening * np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]) - center


def test_a_weight_beside_the_line_of_soft_fingers() -> None:
    """0.5 m g sqrt(1 / mu^2 + (l / e)^2) with l = 5 mm and e = 4 mm."""
    contacts = Contacts(points(0.04, (0.0, 0.005, 0.0)), OPPOSED, 0.5, 0.004)
    found = holding_force(contacts, [0, 0, -2.0, 0, 0, 0])
    assert found.normal == pytest.approx(math.sqrt(4.0 + 1.25**2), rel=0.02)


def test_hard_fingers_do_not_hold_it_at_all() -> None:
    contacts = Contacts(points(0.04, (0.0, 0.005, 0.0)), OPPOSED, 0.5)
    assert holding_force(contacts, [0, 0, -1.0, 0, 0, 0], within=0.5).motor == math.inf


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_random_contacts(seed: int) -> None:
    random = np.random.default_rng(seed)
    friction, soft = float(random.uniform(0.3, 0.9)), seed % 2
    center = tuple(random.uniform(-0.01, 0.01, 3) * soft)
    normals = random_facets(random, 0.5 * math.atan(friction))
    contacts = Contacts(points(0.05, center), normals, friction, 0.003 * soft)
    wrench = np.concatenate([random.standard_normal(3), np.zeros(3)])
    computed = float(grip_force(contacts, wrench).value)
    assert holding_force(contacts, wrench).normal == pytest.approx(computed, rel=0.03)


def test_the_frame_of_the_contacts_does_not_matter() -> None:
    random = np.random.default_rng(3)
    turn, _ = np.linalg.qr(random.standard_normal((3, 3)))
    turn *= np.linalg.det(turn)
    wrench = np.array([0.2, 0.9, -0.4, 0.0, 0.0, 0.0])
    one = holding_force(Contacts(points(0.05), OPPOSED, 0.5), wrench)
    turned = Contacts(points(0.05) @ turn.T, np.array(OPPOSED) @ turn.T, 0.5)
    other = holding_force(turned, np.concatenate([turn @ wrench[:3], np.zeros(3)]))
    assert one.normal == pytest.approx(other.normal, rel=0.02)


def test_what_is_no_grasp_of_two_like_contacts_is_refused() -> None:
    with pytest.raises(ContactError, match="one grasp of two contacts"):
        holding_force(Contacts(points(0.05), OPPOSED, 0.5), [0.0, 0.0, 1.0])
    with pytest.raises(ContactError, match="one friction"):
        holding_force(Contacts(points(0.05), OPPOSED, [0.5, 0.6]), np.ones(6))
