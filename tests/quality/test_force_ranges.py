import math
from typing import Any

import numpy as np
import pytest

from grasp3d import Contacts, force_closure, grip_force
from grasp3d.contact.contacts import turned
from grasp3d.errors import SettingError
from grasp3d.quality import Weight, Wrenches, force_range, payload
from tests.helpers import grasps
from tests.helpers.forces import GRAVITY, moved, opposed
from tests.helpers.random_grasps import Shape, random_contacts
from tests.helpers.tilts import random_tilts, with_normals

NEWTON = Weight(1.0 / GRAVITY)
TILT = math.radians(8.0)
RNG = np.random.default_rng(7)


def hard_grasps(count: int, size: int, tilt: float, seed: int = 5) -> Contacts:
    """Grasps whose cones are force-closed when they are narrower by the tilt."""
    contacts = random_contacts(Shape(count, 8, soft=False), size, seed)
    closed = force_closure(contacts, cone_offset=-tilt).closed
    return contacts.take(np.flatnonzero(closed))


def soft_pairs(size: int, rng: np.random.Generator) -> tuple[Contacts, np.ndarray, np.ndarray]:
    """Opposed soft fingers beside the centre of mass, their tilts, and weights across or aslant."""
    fingers = opposed(friction=0.5).reshape((1,)).take(np.zeros(size, dtype=int))
    points = fingers.points + 0.004 * rng.normal(size=(size, 1, 3))
    normals = random_tilts(fingers.normals, 0.1, rng)
    friction = rng.uniform(0.4, 1.0, size=(size, 1))
    pads = Contacts(points, normals, friction, rng.uniform(0.001, 0.006, size=(size, 1)))
    tilts = rng.uniform(0.0, 0.5, size=(size, 2)) * pads.friction_angle
    weights = np.zeros((size, 6))
    weights[:, :3] = rng.normal(size=(size, 3))
    return pads, tilts, weights


@pytest.mark.slow
@pytest.mark.parametrize("kind", ["hard fingers", "points of pads"])
def test_no_tilt_needs_more_than_smaller_cones(kind: str) -> None:
    """Points of a finger share its bound; their normals tilt independently of each other."""
    rng = np.random.default_rng(4)
    if kind == "hard fingers":
        contacts = hard_grasps(4, 700, TILT).take(np.arange(60))
        tilts, loads = np.full((60, 4), TILT), rng.normal(size=(60, 6))
    else:
        pads, narrow, loads = soft_pairs(30, rng)
        contacts = pads.as_points()
        tilts = narrow.repeat(contacts.count // 2, axis=1)
    found = force_range(contacts, loads, tilts, bound="norm", rtol=1e-6)
    assert found.how == "exact"
    held = np.isfinite(found.largest)
    assert held.mean() > 0.8
    attacked = np.zeros(len(tilts))

    def attack(normals: np.ndarray) -> np.ndarray:
        """Direction that is weakest at some normals."""
        nonlocal attacked
        force = grip_force(with_normals(contacts, normals), loads, bound="norm", rtol=1e-6)
        assert (force.lower <= found.largest * (1.0 + 1e-6)).all()
        assert (force.upper >= found.least * (1.0 - 1e-6)).all()
        attacked = np.maximum(attacked, force.lower)
        return force.certificate.direction

    for _ in range(100):
        attack(random_tilts(contacts.normals, tilts, rng))
    direction = attack(contacts.normals)
    for _ in range(40):  # tilt away from what is weakest
        g = direction[:, None, :3] + np.cross(direction[:, None, 3:], contacts.points)
        direction = attack(turned(contacts.normals, -g, tilts))
    assert (attacked >= found.largest * (1.0 - 1e-3))[held].all()


def test_soft_fingers_need_what_their_points_and_their_limit_surface_do() -> None:
    pads, tilts, weights = soft_pairs(60, np.random.default_rng(5))
    found = force_range(pads, weights, tilts)
    points = pads.as_points()
    each = tilts.repeat(points.count // 2, axis=1)
    at_points = force_range(points, weights, each, bound="norm").largest
    np.testing.assert_allclose(found.largest, np.maximum(at_points, found.nominal), rtol=3e-3)
    together = Contacts(0.0 * pads.points, pads.normals, pads.friction)
    forces = force_range(together, weights, tilts, rtol=1e-4).least
    np.testing.assert_allclose(found.least, np.minimum(forces, found.nominal), rtol=3e-3)
    weights[:, 3:] = 1e-3
    assert (force_range(pads, weights, tilts).least == 0.0).all()


@pytest.mark.parametrize("bound", ["normal", "total"])
def test_bounds_of_normal_forces_are_safe(bound: Any) -> None:
    contacts = hard_grasps(3, 60, TILT)
    found = force_range(contacts, NEWTON, TILT, bound=bound)
    assert found.how == "bound"
    assert (found.least <= found.nominal).all()
    assert (found.nominal <= found.largest).all()
    for _ in range(12):
        normals = random_tilts(contacts.normals, TILT, RNG)
        force = grip_force(with_normals(contacts, normals), NEWTON, bound=bound)
        assert (force.lower <= found.largest).all()
        assert (force.upper >= found.least).all()


@pytest.mark.parametrize("bound", ["normal", "norm"])
def test_without_friction_tilts_need_no_less_than_the_least_force(bound: Any) -> None:
    normals = np.concatenate([np.eye(3), -np.eye(3)])
    offsets = 0.4 * np.roll(normals, 1, axis=1)
    contacts = Contacts(
        np.concatenate([offsets - normals, -offsets - normals])[None],
        np.concatenate([normals, normals])[None],
        friction=0.0,
    )
    wrench = np.random.default_rng(3).normal(size=(1, 6))
    found = force_range(contacts, wrench, 0.1, bound=bound)
    assert 0.0 < found.least[0] < found.nominal[0] < math.inf
    for _ in range(200):
        tilted = with_normals(contacts, random_tilts(contacts.normals, 0.1, RNG))
        force = grip_force(tilted, wrench, bound=bound)
        assert (force.upper >= found.least).all()


def test_a_tilt_beyond_friction_has_no_safe_force_and_wide_cones_a_small_one() -> None:
    """The cones of all normals together are wider than 90 degrees: they are not convex."""
    contacts = hard_grasps(3, 20, 0.0)
    found = force_range(contacts, NEWTON, 1.2)
    assert found.how == "bound"
    assert (found.largest == math.inf).all()
    assert (found.least < 0.5 * found.nominal).all()
    for _ in range(60):
        normals = random_tilts(contacts.normals, 1.2, RNG)
        force = grip_force(with_normals(contacts, normals), NEWTON)
        assert (force.upper >= found.least).all()


def test_at_the_best_tilt_two_fingers_share_the_weight() -> None:
    """Across the line friction of an angle beta + a carries half of it at each finger."""
    down = [0.0, 0.0, -1.0, 0.0, 0.0, 0.0]
    found = force_range(opposed(torsion=0.0), down, TILT, bound="norm", rtol=1e-5)
    assert found.least == pytest.approx(0.5 / math.sin(math.atan(0.5) + TILT), rel=1e-3)


def test_without_tilt_there_is_nothing_to_range_over() -> None:
    found = force_range(opposed(), NEWTON, 0.0)
    assert found.how == "exact"
    assert found.least <= found.nominal == found.largest
    assert found.least >= found.nominal * (1.0 - 1e-3)


def test_payload_is_the_force_over_that_of_a_kilogram() -> None:
    contacts = moved(opposed(), [0.0, 0.01, 0.0])
    carried = payload(contacts, Weight(), 40.0)
    assert grip_force(contacts, Weight(carried)).value == pytest.approx(40.0, rel=2e-3)
    assert payload(contacts, Weight(), 40.0, tilt=TILT) < carried
    assert payload(moved(opposed(torsion=0.0), [0.0, 0.01, 0.0]), Weight(), 40.0) == 0.0


def test_payload_beside_a_push_that_has_no_mass() -> None:
    contacts = grasps.stacked([opposed(), moved(opposed(), [0.0, 0.01, 0.0])])
    task = Weight() + Wrenches([[0.0, 3.0, 0.0, 0.0, 0.0, 0.0], [0.0, -3.0, 0.0, 0.0, 0.0, 0.0]])
    carried = payload(contacts, task, 20.0)
    held = grip_force(contacts, task, masses=carried)
    assert held.value == pytest.approx([20.0, 20.0], rel=5e-3)
    assert (payload(contacts, task, 1.0) == 0.0).all()
    tilted = payload(contacts, task, 20.0, tilt=TILT)
    assert (tilted < carried).all()
    largest = force_range(contacts, task, TILT, masses=tilted).largest
    assert largest == pytest.approx([20.0, 20.0], rel=0.1)


def test_no_grasps_have_no_forces() -> None:
    none = random_contacts(Shape(2, 8, soft=True), 5, 1).take(np.arange(0))
    for task in (Weight(), Wrenches([1.0, 0, 0, 0, 0, 0]), Weight() + Wrenches(np.ones(6))):
        assert force_range(none, task, TILT).largest.shape == (0,)


def test_what_makes_no_sense_is_refused() -> None:
    for tilt in (-0.1, 2.0, math.nan):
        with pytest.raises(SettingError):
            force_range(opposed(), NEWTON, tilt)
    for force in (0.0, -1.0, math.inf, math.nan):
        with pytest.raises(SettingError):
            payload(opposed(), Weight(), force)
    with pytest.raises(SettingError, match="weight"):
        payload(opposed(), Wrenches([1.0, 0, 0, 0, 0, 0]), 10.0)
