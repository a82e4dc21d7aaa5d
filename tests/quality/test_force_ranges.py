import math
from typing import Any

import numpy as np
import pytest

from grasp3d import Contacts, force_closure, grip_force
from grasp3d.contact.friction_cones import tilted_normals, turned
from grasp3d.errors import SettingError
from grasp3d.quality import Acceleration, Weight, Wrenches, force_range, payload
from tests.helpers import grasps, tilt_adversary
from tests.helpers.forces import GRAVITY, moved, opposed
from tests.helpers.random_grasps import Shape, random_contacts
from tests.helpers.tilts import with_normals

NEWTON = Weight(1.0 / GRAVITY)
TILT = math.radians(8.0)


def hard_grasps(count: int, size: int, tilt: float, seed: int = 5) -> Contacts:
    """Grasps whose cones are force-closed when they are narrower by the tilt."""
    contacts = random_contacts(Shape(count, 8, soft=False), size, seed)
    closed = force_closure(contacts, cone_offset=-tilt).closed
    return contacts.take(np.flatnonzero(closed))


def leaning(degrees: float) -> Contacts:
    """Two soft fingers whose normals are an angle off the line between them, toward z."""
    contacts = opposed(friction=0.5)
    up = np.array([0.0, 0.0, 1.0])
    return with_normals(contacts, turned(contacts.normals, up, np.full(2, math.radians(degrees))))


def random_tilts(contacts: Contacts, tilt: float, count: int, seed: int) -> np.ndarray:
    """Normals within a tilt, half of them at it, shape (count, b, n, 3)."""
    rng = np.random.default_rng(seed)
    shape = (count, *contacts.points.shape[:-1])
    angles = np.where(rng.random(shape) < 0.5, tilt, tilt * np.sqrt(rng.random(shape)))
    goals = rng.normal(size=(*shape, 3))
    goals -= (goals * contacts.normals).sum(axis=-1, keepdims=True) * contacts.normals
    return turned(np.broadcast_to(contacts.normals, goals.shape), goals, angles)


@pytest.mark.slow
@pytest.mark.parametrize("count", [3, 4])
def test_no_tilt_needs_more_than_smaller_cones(count: int) -> None:
    contacts = hard_grasps(count, 700, TILT)
    contacts = contacts.take(np.arange(100))
    wrenches = np.random.default_rng(3).normal(size=(100, 6))
    found = force_range(contacts, wrenches, TILT, bound="norm", rtol=1e-6)
    assert found.how == "exact"
    attacked = np.zeros(100)
    for normals in random_tilts(contacts, TILT, 300, 4):
        force = grip_force(with_normals(contacts, normals), wrenches, bound="norm", rtol=1e-5)
        assert (force.lower <= found.largest * (1.0 + 1e-6)).all()
        assert (force.upper >= found.least * (1.0 - 1e-6)).all()
        attacked = np.maximum(attacked, force.lower)
    # Ascent from the nominal normals: tilt away from the direction that is weakest.
    direction = grip_force(contacts, wrenches, bound="norm", rtol=1e-6).certificate.direction
    for _ in range(40):
        g = direction[:, None, :3] + np.cross(direction[:, None, 3:], contacts.points)
        tilted = with_normals(contacts, turned(contacts.normals, -g, np.full(g.shape[:2], TILT)))
        force = grip_force(tilted, wrenches, bound="norm", rtol=1e-6)
        assert (force.lower <= found.largest * (1.0 + 1e-6)).all()
        attacked = np.maximum(attacked, force.lower)
        direction = force.certificate.direction
    assert (attacked >= found.largest * (1.0 - 1e-3)).all()


@pytest.mark.parametrize("bound", ["normal", "total"])
def test_bounds_of_normal_forces_are_safe(bound: Any) -> None:
    contacts = hard_grasps(3, 60, TILT)
    found = force_range(contacts, NEWTON, TILT, bound=bound)
    assert found.how == "bound"
    assert (found.least <= found.nominal).all()
    assert (found.nominal <= found.largest).all()
    for normals in random_tilts(contacts, TILT, 12, 6):
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
    for tilted in random_tilts(contacts, 0.1, 200, 9):
        force = grip_force(with_normals(contacts, tilted), wrench, bound=bound)
        assert (force.upper >= found.least).all()


def test_a_tilt_beyond_friction_has_no_safe_force_and_wide_cones_a_small_one() -> None:
    """The cones of all normals together are wider than 90 degrees: they are not convex."""
    contacts = hard_grasps(3, 20, 0.0)
    found = force_range(contacts, NEWTON, 1.2)
    assert (found.largest == math.inf).all()
    assert (found.least < 0.5 * found.nominal).all()
    for normals in random_tilts(contacts, 1.2, 60, 7):
        force = grip_force(with_normals(contacts, normals), NEWTON)
        assert (force.upper >= found.least).all()


@pytest.mark.parametrize("bound", ["normal", "norm", "total"])
def test_no_tilt_of_soft_fingers_is_beyond_the_bounds(bound: Any) -> None:
    contacts = random_contacts(Shape(2, 8, soft=True), 80, 9)
    contacts = contacts.take(np.flatnonzero(force_closure(contacts, cone_offset=-TILT).closed))
    wrenches = np.random.default_rng(2).normal(size=(len(contacts.points), 6))
    found = force_range(contacts, wrenches, TILT, bound=bound)
    assert found.how == "bound"
    assert (found.least <= found.nominal * (1.0 + 1e-9)).all()
    assert (found.nominal <= found.largest).all()
    assert np.isfinite(found.largest).mean() > 0.5
    rims = tilted_normals(contacts.normals, TILT, count=6)[..., 1:, :]
    most, least = np.zeros(len(contacts.points)), np.full(len(contacts.points), math.inf)
    for i in range(6):
        for j in range(6):
            normals = np.stack([rims[:, 0, i], rims[:, 1, j]], axis=1)
            force = grip_force(with_normals(contacts, normals), wrenches, bound=bound, rtol=1e-3)
            most, least = np.maximum(most, force.lower), np.minimum(least, force.upper)
    assert (most <= found.largest).all()
    assert (least >= found.least).all()


def test_bounds_of_soft_fingers_are_near_what_some_tilts_need() -> None:
    """Pads on a part: how much the bounds give away was measured, and does not grow."""
    rng = np.random.default_rng(4)
    contacts, tilts = tilt_adversary.random_pads(60, rng)
    weights = np.zeros((60, 6))
    weights[:, :3] = rng.normal(size=(60, 3))
    found = force_range(contacts, weights, tilts)

    adversary = tilt_adversary.Attack(contacts, tilts, weights, "normal")
    largest, least = adversary.largest(6, 8, rng), adversary.least(6, 8, rng)
    assert (largest <= found.largest).all()
    assert (least >= found.least).all()
    finite = np.isfinite(found.largest)
    assert finite.mean() > 0.8
    assert np.median(found.largest[finite] / largest[finite]) < 1.12
    assert np.median(least / found.least) < 1.16


def test_without_tilts_the_bounds_of_soft_fingers_hold_their_forces() -> None:
    """What is sure becomes the limit surface itself, what is possible contains it."""
    rng = np.random.default_rng(5)
    contacts, _ = tilt_adversary.random_pads(60, rng)
    weights = np.zeros((60, 6))
    weights[:, :3] = rng.normal(size=(60, 3))
    bounds: tuple[Any, ...] = ("normal", "norm")
    for bound in bounds:
        exact = grip_force(contacts, weights, bound=bound, rtol=1e-5)
        found = force_range(contacts, weights, 1e-9, bound=bound, rtol=1e-5)
        held = exact.finite
        assert held.sum() > 40
        assert (found.largest >= exact.lower)[held].all()
        assert found.largest[held] == pytest.approx(exact.upper[held], rel=0.05)
        assert (found.least <= exact.upper).all()
        assert np.median(exact.upper[held] / found.least[held]) < 1.16


@pytest.mark.parametrize("bound", ["normal", "norm", "total"])
def test_without_tilts_the_bounds_of_hard_fingers_are_their_forces(bound: Any) -> None:
    contacts = hard_grasps(3, 60, 0.0)
    exact = grip_force(contacts, NEWTON, bound=bound, rtol=1e-5)
    found = force_range(contacts, NEWTON, 1e-9, bound=bound, rtol=1e-5)
    held = exact.finite
    assert held.any()
    assert found.least[held] == pytest.approx(exact.upper[held], rel=1e-4)
    assert found.largest[held] == pytest.approx(exact.upper[held], rel=1e-4)


def test_at_the_best_tilt_torsion_does_not_carry_the_weight() -> None:
    """Across the line friction of an angle beta + a does, half of it at each finger."""
    down = [0.0, 0.0, -1.0, 0.0, 0.0, 0.0]
    found = force_range(opposed(torsion=0.1), down, TILT, bound="norm", rtol=1e-5)
    assert found.least == pytest.approx(0.5 / math.sin(math.atan(0.5) + TILT), rel=1e-3)


def test_soft_fingers_that_some_tilt_opens_need_an_infinite_force() -> None:
    contacts = leaning(20.0)
    # 20 degrees off the line, 26.6 of friction: a tilt of 8 degrees opens the grasp.
    found = force_range(contacts, NEWTON, TILT)
    assert math.isfinite(found.nominal)
    assert found.largest == math.inf
    assert math.isfinite(force_range(contacts, NEWTON, math.radians(4.0)).largest)


def test_tilts_can_close_soft_fingers_that_are_open() -> None:
    found = force_range(leaning(30.0), NEWTON, TILT)
    assert found.nominal == math.inf
    assert math.isfinite(found.least)


def test_one_task_written_in_two_ways_needs_the_same() -> None:
    contacts = random_contacts(Shape(2, 8, soft=True), 30, 11)
    push = Wrenches([0.0, 0.0, -5.0, 0.0, 0.0, 0.0])
    sum_of_two = Weight(1.0 / GRAVITY, direction=(0.0, 0.0, -1.0)) + push
    both = Wrenches([0.0, 0.0, -6.0, 0.0, 0.0, 0.0])
    one, other = (force_range(contacts, task, TILT) for task in (sum_of_two, both))
    assert one.nominal == pytest.approx(other.nominal, rel=1e-3)
    assert one.largest == pytest.approx(other.largest, rel=1e-3)


def test_without_tilt_there_is_nothing_to_range_over() -> None:
    found = force_range(opposed(), NEWTON, 0.0)
    assert found.how == "exact"
    assert found.least <= found.nominal == found.largest
    assert found.least >= found.nominal * (1.0 - 1e-3)


def test_where_one_tilt_exceeds_friction_the_others_hold() -> None:
    points = 0.02 * np.array([[0.0, -1, 0], [0, 1, 0], [1, 0, 0], [-1, 0, 0]])
    contacts = Contacts(points, -points, [0.8, 0.8, 0.8, 0.1])
    tilts = np.array([0.05, 0.05, 0.05, 0.2])
    down = Weight(0.5, direction=(0.0, 0.0, -1.0))
    found = force_range(contacts, down, tilts, bound="norm")
    three = Contacts(points[:3], -points[:3], 0.8)
    assert found.how == "bound"
    assert found.largest == pytest.approx(
        force_range(three, down, 0.05, bound="norm").largest, rel=1e-3
    )
    for normals in random_tilts(contacts.reshape((1,)), 0.05, 20, 8):
        force = grip_force(with_normals(contacts, normals[0]), down, bound="norm")
        assert force.lower <= found.largest


@pytest.mark.parametrize("tilt", [-0.1, 2.0, math.nan])
def test_tilts_outside_their_range(tilt: float) -> None:
    with pytest.raises(SettingError):
        force_range(opposed(), NEWTON, tilt)


# Payload


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


def test_parts_of_a_task_carry_the_same_mass() -> None:
    contacts = moved(opposed(), [0.0, 0.01, 0.0])
    equal = Weight(1.0) + Acceleration(1.0, acceleration=3.0)
    unequal = Weight(0.2) + Acceleration(4.0, acceleration=3.0)
    assert payload(contacts, unequal, 40.0) == payload(contacts, equal, 40.0)


def test_no_grasps_have_no_forces() -> None:
    none = random_contacts(Shape(2, 8, soft=True), 5, 1).take(np.arange(0))
    for task in (Weight(), Wrenches([1.0, 0, 0, 0, 0, 0]), Weight() + Wrenches(np.ones(6))):
        assert force_range(none, task, TILT).largest.shape == (0,)


@pytest.mark.parametrize("force", [0.0, -1.0, math.inf, math.nan])
def test_payload_needs_a_force(force: float) -> None:
    with pytest.raises(SettingError):
        payload(opposed(), Weight(), force)


def test_payload_needs_a_task_with_a_mass() -> None:
    with pytest.raises(SettingError, match="weight"):
        payload(opposed(), Wrenches([1.0, 0, 0, 0, 0, 0]), 10.0)
