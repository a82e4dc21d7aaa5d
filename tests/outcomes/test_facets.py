"""Two tips on two facets slip at the critical friction angle, and hold with the grip force."""

import math

import numpy as np
import pytest

from grasp3d import Contacts, Label, classify, critical_friction_angle, grip_force
from grasp3d.arrays import angles_between
from tests.helpers.facets import (
    SLIPPED,
    FacetPress,
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


def test_friction_is_not_what_moves_parallel_facets() -> None:
    assert facet_slip(facets(0.0, 0.0), 0.05) < SLIPPED


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(3))
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


def test_tilts_are_even_over_the_cap() -> None:
    """The area of a cap grows as 1 - cos."""
    normals = np.tile([0.0, 0.6, 0.8], (20_000, 1))
    tilted = tilt_at_random(normals, np.full(len(normals), 0.5), np.random.default_rng(0))
    angle = angles_between(normals, tilted)
    inner = math.acos(1.0 - 0.5 * (1.0 - math.cos(0.5)))
    assert angle.max() <= 0.5 + 1e-12
    assert np.mean(angle < inner) == pytest.approx(0.5, abs=0.02)
    sideways = tilted - normals * (tilted * normals).sum(axis=1)[:, None]
    assert np.abs(sideways.mean(axis=0)).max() < 0.02


def test_with_the_defaults_of_mujoco_even_a_safe_grasp_creeps() -> None:
    press = FacetPress(seconds=2.0, most_shift=1.0)
    assert facet_slip(facets(20.0, 0.0), 0.5, press) < 1e-5
    soft = FacetPress(seconds=2.0, most_shift=1.0, dry_friction=False)
    assert facet_slip(facets(20.0, 0.0), 0.5, soft) > 1e-2


OPPOSED = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]


def contact_points(
    opening: float, center: tuple[float, float, float] = (0.0, 0.0, 0.0)
) -> np.ndarray:
    """Contacts on the x axis, relative to a centre of mass."""
    return 0.5 * opening * np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]) - center


def test_a_weight_beside_the_line_of_soft_fingers() -> None:
    """0.5 m g sqrt(1 / mu^2 + (l / e)^2) with l = 5 mm and e = 4 mm."""
    contacts = Contacts(contact_points(0.04, (0.0, 0.005, 0.0)), OPPOSED, 0.5, 0.004)
    found = holding_force(contacts, [0, 0, -2.0, 0, 0, 0])
    assert found.normal == pytest.approx(math.sqrt(4.0 + 1.25**2), rel=0.02)


def test_hard_fingers_do_not_hold_it_at_all() -> None:
    contacts = Contacts(contact_points(0.04, (0.0, 0.005, 0.0)), OPPOSED, 0.5)
    assert holding_force(contacts, [0, 0, -1.0, 0, 0, 0], within=0.5).motor == math.inf


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(4))
def test_the_smallest_force_is_the_grip_force(seed: int) -> None:
    random = np.random.default_rng(seed)
    friction, soft = float(random.uniform(0.3, 0.9)), seed % 2
    center = tuple(random.uniform(-0.01, 0.01, 3) * soft)
    normals = random_facets(random, 0.5 * math.atan(friction))
    contacts = Contacts(contact_points(0.05, center), normals, friction, 0.003 * soft)
    wrench = np.concatenate([random.standard_normal(3), np.zeros(3)])
    computed = float(grip_force(contacts, wrench).value)
    assert holding_force(contacts, wrench).normal == pytest.approx(computed, rel=0.03)


def test_the_frame_of_the_contacts_does_not_matter() -> None:
    random = np.random.default_rng(3)
    turn, _ = np.linalg.qr(random.standard_normal((3, 3)))
    turn *= np.linalg.det(turn)
    wrench = np.array([0.2, 0.9, -0.4, 0.0, 0.0, 0.0])
    one = holding_force(Contacts(contact_points(0.05), OPPOSED, 0.5), wrench)
    turned = Contacts(contact_points(0.05) @ turn.T, np.array(OPPOSED) @ turn.T, 0.5)
    other = holding_force(turned, np.concatenate([turn @ wrench[:3], np.zeros(3)]))
    assert one.normal == pytest.approx(other.normal, rel=0.02)
