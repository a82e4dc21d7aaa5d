"""Wrench spaces of contacts with patches: epsilon, force closure and grip force."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import Contacts, epsilon, force_closure, grip_force
from grasp3d.contact import disc
from grasp3d.errors import SettingError
from grasp3d.quality import (
    EpsilonOptions,
    Weight,
    epsilon_of_wrenches,
    epsilon_range,
    force_range,
    location_tolerance,
    metrics,
    payload,
)
from grasp3d.quality.wrenches import wrench_axes, wrenches
from tests.helpers import patches
from tests.helpers.forces import GRAVITY

RTOL = 1e-3
FINE = {"rtol": 1e-5}


def wrench_of(contacts: Contacts, forces: np.ndarray) -> np.ndarray:
    """Wrenches of forces and moments about the contacts (..., n, 6), shape (..., 6)."""
    moments = np.cross(contacts.points, forces[..., :3]) + forces[..., 3:]
    return np.concatenate([forces[..., :3].sum(axis=-2), moments.sum(axis=-2)], axis=-1)


@pytest.mark.parametrize("actuation", ["total", "per_finger"])
@pytest.mark.parametrize(("fingers", "torsion"), [(2, 0.1), (3, 0.0), (4, 0.05)])
def test_the_support_function_is_that_of_the_best_pressure_and_force(
    fingers: int, torsion: float, actuation: str
) -> None:
    """The certificate's direction: every force in the cone, at every point of the patch."""
    contacts = patches.random_patches(20, fingers, 1, torsion=torsion)
    found = epsilon(contacts, actuation=actuation, rtol=RTOL)  # type: ignore[arg-type]
    u = found.certificate.direction
    axes = wrench_axes(
        contacts.points, contacts.normals, contacts.torsion_radius, 1.0, contacts.rolling_arms
    )
    z = (axes @ u[:, None, :, None])[..., 0]  # (b, n, 6)
    angles = np.linspace(0.0, 2.0 * math.pi, 400)
    rim = np.stack([np.cos(angles), np.sin(angles)])
    lever = (z[..., 4:] @ rim).max(axis=-1)
    beta = np.linspace(0.0, 1.0, 2000)[:, None, None] * contacts.friction_angle
    sideways = np.hypot(z[..., 1], z[..., 2])
    support = (np.cos(beta) * (z[..., 0] + lever) + np.sin(beta) * sideways).max(axis=0)
    support = np.maximum(support, z[..., 0] + lever + np.abs(z[..., 3]))
    expected = support.max(axis=-1) if actuation == "total" else support.clip(0.0).sum(axis=-1)
    assert found.closed.any()
    assert found.upper[found.closed] == pytest.approx(expected[found.closed], rel=1e-4)


@pytest.mark.parametrize("bounded", ["force", "normal"])
@pytest.mark.parametrize(("fingers", "torsion"), [(2, 0.1), (2, 0.0), (3, 0.0), (4, 0.05)])
def test_polygons_have_the_hull_of_their_wrenches(
    fingers: int, torsion: float, bounded: str
) -> None:
    contacts = patches.random_patches(30, fingers, 2, torsion=torsion)
    found = epsilon(contacts, edges=5, bounded=bounded)  # type: ignore[arg-type]
    rows = wrenches(contacts, edges=5, bounded=bounded)  # type: ignore[arg-type]
    hulls = epsilon_of_wrenches(rows)
    assert np.array_equal(found.closed, hulls.closed)
    assert 0.1 < found.closed.mean() < 1.0
    assert found.value == pytest.approx(hulls.value, abs=1e-12)


def test_polygons_approach_the_ellipse_from_inside() -> None:
    contacts = patches.random_patches(20, 3, 3, torsion=0.1)
    exact = epsilon(contacts, **FINE)
    found = [epsilon(contacts, edges=edges).value for edges in (4, 8, 32)]
    assert (found[1] <= exact.upper).all()
    assert (found[2] <= exact.upper).all()
    assert found[2][exact.closed] == pytest.approx(exact.upper[exact.closed], rel=0.03)
    assert np.abs(found[0] - exact.upper).max() > 0.05 * exact.upper.max()


def test_without_friction_a_patch_is_its_rim() -> None:
    """Pressure at a point of a rim is what a frictionless point contact there applies."""
    normals = np.concatenate([np.eye(3), -np.eye(3)])
    rng = np.random.default_rng(4)
    points = -normals + 0.2 * rng.normal(size=(6, 3))
    axes = disc(normals, rng.uniform(0.3, 0.6, 6))
    whole = Contacts(points, normals, 0.0, patch=axes)
    angles = 2.0 * math.pi * np.arange(6) / 6
    rim = np.stack([np.cos(angles), np.sin(angles)], axis=-1) @ axes  # (6, 6, 3)
    around = Contacts(
        (points[:, None] + rim).reshape(-1, 3), np.repeat(normals, 6, axis=0), friction=0.0
    )
    assert epsilon(whole, edges=6).closed
    assert epsilon(whole, edges=6).value == pytest.approx(epsilon(around).value, rel=1e-3)
    assert not epsilon(whole.without_patches()).closed


@pytest.mark.parametrize(("fingers", "torsion"), [(2, 0.1), (2, 0.0), (3, 0.0), (3, 0.1)])
def test_certificates_prove_closure_and_its_absence(fingers: int, torsion: float) -> None:
    contacts = patches.random_patches(60, fingers, 5, torsion=torsion)
    found = force_closure(contacts)
    forces = found.certificate.equilibrium
    assert np.abs(wrench_of(contacts, forces)[found.closed]).max() < 1e-9
    pressing = (forces[..., :3] * contacts.normals).sum(axis=-1)
    sideways = np.linalg.norm(forces[..., :3] - pressing[..., None] * contacts.normals, axis=-1)
    twist = np.abs((forces[..., 3:] * contacts.normals).sum(axis=-1))
    spare = pressing - (twist / torsion if torsion else 0.0)
    rolling = np.cross(contacts.patch, contacts.normals[..., None, :])
    levers = np.linalg.pinv(np.swapaxes(rolling, -1, -2)) @ forces[..., 3:, None]
    chosen = found.closed
    assert 0.1 < chosen.mean() < 1.0
    assert (sideways < contacts.friction * spare)[chosen].all()
    assert (np.linalg.norm(levers[..., 0], axis=-1) < pressing)[chosen].all()
    # A direction that separates: no force at any point of the patches has a positive component.
    u = found.certificate.direction[~chosen]
    open_ = contacts.take(np.flatnonzero(~chosen))
    rows = wrenches(open_, edges=60)
    assert (rows @ u[..., None]).max() <= 1e-9


def test_small_patches_change_nothing_in_the_limit() -> None:
    contacts = patches.random_patches(20, 3, 6, torsion=0.1)
    given = contacts.points, contacts.normals, contacts.friction, contacts.torsion_radius
    points, none = Contacts(*given), Contacts(*given, np.zeros_like(contacts.patch))
    for arguments in ({}, {"edges": 6}, {"actuation": "per_finger"}):
        exact, same = epsilon(points, **arguments), epsilon(none, **arguments)
        assert np.array_equal(exact.lower, same.lower)
        assert np.array_equal(exact.upper, same.upper)
    tiny = epsilon(patches.resized(contacts, 1e-9), **FINE)
    assert tiny.upper == pytest.approx(epsilon(points, **FINE).upper, abs=1e-5)


@settings(deadline=None, max_examples=40)
@given(st.integers(0, 10_000))
def test_larger_patches_never_lower_epsilon_or_raise_the_force(seed: int) -> None:
    contacts = patches.random_patches(1, 3, seed, torsion=0.05)
    small, large = patches.resized(contacts, 0.5), contacts
    assert (epsilon(small).lower <= epsilon(large).upper).all()
    forces = [grip_force(one, Weight(1.0)) for one in (small, large)]
    assert (forces[1].lower <= forces[0].upper).all()


def test_the_worst_tilt_of_hard_patches_is_a_smaller_cone() -> None:
    """Fact 1: cones tilt by a, patches stay; the minimum is epsilon at beta - a, and is reached."""
    tilt, rng = 0.15, np.random.default_rng(8)
    contacts = patches.random_patches(40, 3, 8)
    smaller = epsilon(contacts, cone_offset=-tilt, **FINE)
    exact = epsilon_range(contacts, tilt, EpsilonOptions(rtol=1e-5)).minimum
    assert exact == pytest.approx(smaller.lower, rel=2e-5)
    u = smaller.certificate.direction
    for g in np.flatnonzero(smaller.lower > 0.05)[:3]:
        one = contacts.take(slice(g, g + 1)).reshape(())
        lever = np.cross(one.patch, one.normals[:, None]) @ u[g, 3:]
        velocity = u[g, :3] + np.cross(u[g, 3:], one.points)
        velocity = velocity + np.linalg.norm(lever, axis=-1)[:, None] * one.normals
        across = velocity - (velocity * one.normals).sum(axis=-1)[:, None] * one.normals
        across /= np.linalg.norm(across, axis=-1)[:, None]
        worst = math.cos(tilt) * one.normals - math.sin(tilt) * across
        found = epsilon_of_wrenches(patches.tilted_wrenches(one, worst, edges=48)).upper
        assert found == pytest.approx(smaller.upper[g], rel=0.04)
        for _ in range(5):
            away = np.cross(one.normals, rng.normal(size=(3, 3)))
            away /= np.linalg.norm(away, axis=-1, keepdims=True)
            normals = math.cos(tilt) * one.normals + math.sin(tilt) * away
            other = epsilon_of_wrenches(patches.tilted_wrenches(one, normals)).upper
            assert other > 0.96 * smaller.lower[g]  # polygons are smaller than their cones


@pytest.mark.parametrize("torsion", [0.0, 0.08])
def test_ranges_over_tilts_hold_what_tilts_have(torsion: float) -> None:
    contacts = patches.random_patches(6, 2, 9, torsion=torsion)
    found = epsilon_range(contacts, 0.1)
    assert (found.minimum <= found.nominal).all()
    assert (found.nominal <= found.maximum).all()
    rng = np.random.default_rng(0)
    for _ in range(10):
        change = rng.normal(size=contacts.normals.shape)
        change /= np.linalg.norm(change, axis=-1, keepdims=True)
        normals = contacts.normals + math.sin(0.1) * change
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
        assert (epsilon(contacts.with_normals(normals)).lower <= found.maximum + 1e-3).all()
    wide = epsilon_range(contacts, 1.2).maximum
    assert (wide >= found.maximum - 1e-9).all()
    assert (wide <= 1.0).all()


@pytest.mark.parametrize("bound", ["normal", "norm"])
@pytest.mark.parametrize("fingers", [2, 3])
def test_grip_forces_are_those_of_a_cone_program(fingers: int, bound: Any) -> None:
    contacts = patches.random_patches(12, fingers, 10)
    wrench = np.random.default_rng(0).normal(size=(12, 6)) * [1, 1, 1, 0.2, 0.2, 0.2]
    found = grip_force(contacts, wrench, bound=bound, rtol=1e-4)
    expected = [
        patches.force_by_program(contacts.take(slice(g, g + 1)).reshape(()), wrench[g], bound)
        for g in range(12)
    ]
    finite = np.isfinite(expected)
    assert finite.sum() >= 4
    assert np.array_equal(found.finite, finite)
    assert found.upper[finite] == pytest.approx(np.array(expected)[finite], rel=1e-3)
    assert (found.lower[finite] <= np.array(expected)[finite] * (1.0 + 1e-6)).all()
    balance = wrench_of(contacts, found.certificate.forces) + wrench
    assert np.abs(balance[finite]).max() < 1e-7 * found.upper[finite].max()


def held_beside(radius: float, lever: float = 0.01) -> Contacts:
    """Two fingers that hold a part whose centre of mass is beside their line, along the line."""
    points = [[-0.02 + lever, 0.0, 0.0], [0.02 + lever, 0.0, 0.0]]
    normals = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]
    return Contacts(points, normals, 0.5, 0.002, disc(normals, radius))


def test_a_large_patch_shares_a_weight_beside_the_middle() -> None:
    """The nearer point bears 3/4 of the weight; rolling moments of 2 r N bring both to 1/2."""
    down = [0.0, 0.0, -GRAVITY, 0.0, 0.0, 0.0]
    half = GRAVITY / (2 * 0.5)
    assert grip_force(held_beside(0.0), down).value == pytest.approx(1.5 * half)
    for radius in (0.001, 0.004):
        expected = GRAVITY * 0.03 / (0.04 * 0.5 + 2.0 * radius)
        assert grip_force(held_beside(radius), down).value == pytest.approx(expected, rel=2e-3)
    assert grip_force(held_beside(0.02), down).value == pytest.approx(half, rel=2e-3)


def test_payload_and_force_range_take_patches() -> None:
    large, small = held_beside(0.006), held_beside(0.001)
    assert payload(large, Weight(), 20.0) > 1.02 * payload(small, Weight(), 20.0)
    hard = patches.random_patches(4, 3, 11)
    found = force_range(hard, Weight(0.2), 0.1, bound="norm")
    exact = grip_force(hard, Weight(0.2), bound="norm", cone_offset=-0.1)
    assert found.how == "exact"
    assert found.largest == pytest.approx(exact.upper, rel=3 * RTOL)
    pressed = force_range(large, Weight(0.2), 0.1)
    assert pressed.how == "bound"
    assert pressed.least <= pressed.nominal <= pressed.largest < math.inf
    with pytest.raises(SettingError, match="leave edges out"):
        grip_force(large, Weight(0.2), edges=8)


def test_one_patch_resists_no_torque_beyond_its_rim() -> None:
    """Pressed on a table by its weight a box tips over its rim, and no force resists more."""
    normals, weight = [[0.0, 0.0, 1.0]], 10.0
    contacts = Contacts([[0.0, 0.0, -0.1]], normals, 0.5, 0.01, disc(normals, 0.03))
    for torque, held in ((0.29, True), (0.31, False)):
        found = grip_force(contacts, [0.0, 0.0, -weight, 0.0, torque, 0.0])
        assert found.finite == held
        assert not held or found.value == pytest.approx(weight)


def test_points_among_patches_resist_no_rolling() -> None:
    contacts = patches.random_patches(10, 3, 12)
    patch = contacts.patch * np.array([1.0, 0.0, 0.0])[:, None, None]
    some = Contacts(contacts.points, contacts.normals, contacts.friction, 0.0, patch)
    values = [epsilon(one).upper for one in (contacts.without_patches(), some, contacts)]
    assert (values[0] <= values[1] * (1 + RTOL) + 1e-12).all()
    assert (values[1] <= values[2] * (1 + RTOL) + 1e-12).all()
    assert (values[0] < 0.99 * values[1]).any()
    assert (values[1] < 0.99 * values[2]).any()


def test_what_is_known_of_points_only_is_refused() -> None:
    contacts = patches.random_patches(2, 3, 13)
    for refused in (metrics, location_tolerance):
        with pytest.raises(SettingError, match=r"contacts\.without_patches\(\)"):
            refused(contacts)
    assert np.isfinite(location_tolerance(contacts.without_patches())).all()
