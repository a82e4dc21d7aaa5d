"""Two tips on two facets slip at the critical friction angle, and hold with the grip force."""

import math

import numpy as np
import pytest

from grasp3d import Contacts, Label, classify, critical_friction_angle, grip_force
from tests.helpers.facets import (
    SLIPPED,
    facet_slip,
    holding_force,
    random_facets,
    slip_friction,
    slip_tilt,
    tilt_at_random,
)

POINTS = [[-0.025, 0.0, 0.0], [0.025, 0.0, 0.0]]
NEAR = math.radians(0.3)


def facets(*degrees: float) -> list[list[float]]:
    """Normals tilted by two angles toward y."""
    one, two = map(math.radians, degrees)
    return [[math.cos(one), math.sin(one), 0.0], [-math.cos(two), math.sin(two), 0.0]]


@pytest.mark.parametrize(("friction", "holds"), [(0.45, True), (0.28, False)])
def test_a_known_wedge(friction: float, holds: bool) -> None:
    """Facets at 20 degrees need a friction of tan 20 = 0.364, whatever the other one is."""
    assert (facet_slip(facets(20.0, 5.0), friction) < SLIPPED) == holds
    assert facet_slip(facets(0.0, 0.0), 0.05) < SLIPPED


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_they_begin_to_slip_at_the_critical_friction_angle(seed: int) -> None:
    normals = random_facets(np.random.default_rng(seed), 1.2)
    computed = float(critical_friction_angle(Contacts(POINTS, normals, 0.5)))
    assert slip_friction(normals) == pytest.approx(computed, abs=NEAR)
    assert slip_tilt(normals, 0.8) == pytest.approx(math.atan(0.8), abs=NEAR)


@pytest.mark.slow
@pytest.mark.parametrize("label", [Label.S, Label.U])
def test_s_never_slips_and_u_never_holds(label: Label) -> None:
    random, alpha, tried = np.random.default_rng(7), math.radians(22.6), 0
    while tried < 20:
        seen = random_facets(random, 0.9)
        if classify(Contacts(POINTS, seen, 0.5), alpha).label != label:
            continue
        true = tilt_at_random(seen, np.full(2, 0.5 * alpha), random)
        assert (facet_slip(true, 0.5) < SLIPPED) == (label == Label.S)
        tried += 1


OPPOSED = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]


def contact_points(
    opening: float, center: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> np.ndarray:
    """Contacts on the x axis, relative to a centre of mass."""
    return 0.5 * opening * np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]) - center


def test_soft_fingers_hold_a_weight_beside_their_line_and_hard_ones_do_not() -> None:
    """0.5 m g sqrt(1 / mu^2 + (l / e)^2) with l = 5 mm and e = 4 mm."""
    contacts = Contacts(contact_points(0.04, (0.0, 0.005, 0.0)), OPPOSED, 0.5, 0.004)
    found = holding_force(contacts, [0, 0, -2.0, 0, 0, 0])
    assert found.normal == pytest.approx(math.sqrt(4.0 + 1.25**2), rel=0.02)
    hard = Contacts(contacts.points, OPPOSED, 0.5)
    assert holding_force(hard, [0, 0, -1.0, 0, 0, 0], within=0.5).motor == math.inf


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(2))
def test_the_smallest_force_is_the_grip_force(seed: int) -> None:
    random = np.random.default_rng(seed)
    friction, soft = float(random.uniform(0.3, 0.9)), seed % 2
    center = tuple(random.uniform(-0.01, 0.01, 3) * soft)
    normals = random_facets(random, 0.5 * math.atan(friction))
    contacts = Contacts(contact_points(0.05, center), normals, friction, 0.003 * soft)
    wrench = np.concatenate([random.standard_normal(3), np.zeros(3)])
    computed = float(grip_force(contacts, wrench).value)
    assert holding_force(contacts, wrench).normal == pytest.approx(computed, rel=0.03)
