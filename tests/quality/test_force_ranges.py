import math
from typing import Any

import numpy as np
import pytest

from grasp3d import Contacts, force_closure, grip_force
from grasp3d.contact.contacts import turned
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


def test_no_tilt_of_the_points_of_pads_needs_more_than_smaller_cones() -> None:
    """Points of a finger share its bound; their normals tilt independently of each other."""
    rng = np.random.default_rng(4)
    pads, tilts = tilt_adversary.random_pads(60, rng)
    weights = np.zeros((60, 6))
    weights[:, :3] = rng.normal(size=(60, 3))
    points = pads.as_points()
    each = tilts.repeat(points.count // 2, axis=1)
    found = force_range(points, weights, each, bound="norm", rtol=1e-4)
    assert found.how == "exact"
    finite = np.isfinite(found.largest)
    assert finite.mean() > 0.8
    adversary = tilt_adversary.Attack(points, each, weights, "norm")
    largest, least = adversary.largest(6, 8, rng), adversary.least(6, 8, rng)
    assert (largest <= found.largest * (1.0 + 1e-6)).all()
    assert (least >= found.least * (1.0 - 1e-6)).all()
    assert np.median(found.largest[finite] / largest[finite]) < 1.02


def test_soft_fingers_need_what_their_points_and_their_limit_surface_do() -> None:
    rng = np.random.default_rng(5)
    pads, tilts = tilt_adversary.random_pads(60, rng)
    weights = np.zeros((60, 6))
    weights[:, :3] = rng.normal(size=(60, 3))
    found = force_range(pads, weights, tilts)
    points = pads.as_points()
    each = tilts.repeat(points.count // 2, axis=1)
    at_points = force_range(points, weights, each, bound="norm").largest
    np.testing.assert_allclose(found.largest, np.maximum(at_points, found.nominal), rtol=3e-3)
    assert (found.nominal <= found.largest).all()
    together = Contacts(0.0 * pads.points, pads.normals, pads.friction)
    forces = force_range(together, weights, tilts, rtol=1e-4).least
    np.testing.assert_allclose(found.least, np.minimum(forces, found.nominal), rtol=3e-3)
    weights[:, 3:] = 1e-3
    assert (force_range(pads, weights, tilts).least == 0.0).all()


def test_points_gather_the_pressure_that_a_limit_surface_spreads() -> None:
    """Opposed pads with the weight across, at levers of 0, 1/2, 1, 2 and 3 times e / friction."""
    ratios = []
    for lever in (0.0, 0.5, 1.0, 2.0, 3.0):
        pads = moved(opposed(friction=0.5, torsion=0.004), [0.0, lever * 0.004 / 0.5, 0.0])
        down = [0.0, 0.0, -1.0, 0.0, 0.0, 0.0]
        spread, gathered = (grip_force(c, down, rtol=1e-6).value for c in (pads, pads.as_points()))
        ratios.append(spread / gathered)
    assert ratios == pytest.approx([1.0, 1.12, 1.41, 1.12, 1.05], abs=0.01)


@pytest.mark.parametrize("bound", ["normal", "norm", "total"])
def test_without_tilts_the_bounds_of_hard_fingers_hold_their_forces(bound: Any) -> None:
    """Where normal components are bounded, the lengths of forces are up to 1 / cos(beta) longer."""
    contacts = hard_grasps(3, 60, 0.0)
    exact = grip_force(contacts, NEWTON, bound=bound, rtol=1e-5)
    found = force_range(contacts, NEWTON, 1e-9, bound=bound, rtol=1e-5)
    held = exact.finite
    assert held.any()
    longer = 1.0 if bound == "norm" else 1.0 / np.cos(contacts.friction_angle[held]).min(axis=1)
    for one, other in ((found.least, exact.upper), (exact.upper, found.largest)):
        assert (one[held] <= other[held] * (1.0 + 1e-4)).all()
        assert (one[held] * longer >= other[held] * (1.0 - 1e-4)).all()


def test_at_the_best_tilt_two_fingers_share_the_weight() -> None:
    """Across the line friction of an angle beta + a carries half of it at each finger."""
    down = [0.0, 0.0, -1.0, 0.0, 0.0, 0.0]
    found = force_range(opposed(torsion=0.0), down, TILT, bound="norm", rtol=1e-5)
    assert found.least == pytest.approx(0.5 / math.sin(math.atan(0.5) + TILT), rel=1e-3)


def test_soft_fingers_that_some_tilt_opens_need_an_infinite_force() -> None:
    contacts = leaning(20.0)
    # 20 degrees off the line, 26.6 of friction: a tilt of 8 degrees opens the grasp.
    found = force_range(contacts, NEWTON, TILT)
    assert math.isfinite(found.nominal)
    assert found.largest == math.inf
    assert math.isfinite(force_range(contacts, NEWTON, math.radians(4.0)).largest)


def test_tilts_can_close_fingers_that_are_open() -> None:
    contacts = hard_grasps(3, 200, -2.0 * TILT)
    opened = contacts.take(np.flatnonzero(~force_closure(contacts).closed))
    assert len(opened.points) > 3
    found = force_range(opened, NEWTON, 2.0 * TILT)
    assert (found.nominal == math.inf).all()
    assert np.isfinite(found.least).all()


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


def test_where_a_tilt_exceeds_friction_no_force_is_sure() -> None:
    points = 0.02 * np.array([[0.0, -1, 0], [0, 1, 0], [1, 0, 0], [-1, 0, 0]])
    contacts = Contacts(points, -points, [0.8, 0.8, 0.8, 0.1])
    tilts = np.array([0.05, 0.05, 0.05, 0.2])
    down = Weight(0.5, direction=(0.0, 0.0, -1.0))
    found = force_range(contacts, down, tilts, bound="norm")
    assert (found.how, found.largest) == ("bound", math.inf)
    assert math.isfinite(found.nominal)


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
