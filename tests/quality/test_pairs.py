"""Epsilon of two hard fingers with circular cones, which has a solver of its own."""

import math
from typing import Any
from unittest.mock import patch

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import Contacts, epsilon
from grasp3d.arrays import Floats
from grasp3d.quality.critical_angle import Status
from grasp3d.quality.ferrari_canny import Epsilon
from grasp3d.quality.wrench_problem import WrenchProblem
from tests.helpers import oracles

SEEDS = st.integers(0, 2**32)
KINDS = st.sampled_from(["antipodal", "nearly", "aligned", "centred", "random", "outward"])
FORMS = st.sampled_from(
    [
        {"actuation": actuation, "bounded": bounded}
        for actuation in ("total", "per_finger")
        for bounded in ("force", "normal")
    ]
)
NOISE = {
    "antipodal": (0.0, 0.0),
    "nearly": (1e-4, 1e-4),
    "aligned": (0.5, 0.0),
    "centred": (0.0, 0.3),
    "random": (0.5, 0.3),
    "outward": (0.5, 0.3),
}
"""Deviation of the line from the centre of mass, and of the normals from the line."""


def drawn(kind: str, seed: int, count: int = 1) -> Contacts:
    """Random pairs, most of them force-closed."""
    rng, (shift, tilt) = np.random.default_rng(seed), NOISE[kind]
    line = rng.normal(size=(count, 3))
    line /= np.linalg.norm(line, axis=1, keepdims=True)
    reach = line * rng.uniform(0.1, 2.0, size=(count, 1))
    center = shift * rng.normal(size=(count, 3))
    points = np.stack([center - reach, center + reach], axis=1)
    sense = -1.0 if kind == "outward" else 1.0
    normals = sense * np.stack([line, -line], axis=1) + tilt * rng.normal(size=(count, 2, 3))
    return Contacts(points, normals, rng.uniform(0.1, 1.5, size=(count, 1)))


def by_growing_hull(contacts: Contacts, **arguments: Any) -> Epsilon:
    with patch.object(WrenchProblem, "is_pairs", return_value=False):
        return epsilon(contacts, **arguments)


def left_to_the_hull(contacts: Contacts, **arguments: Any) -> int:
    """How many pairs the growing hull has to solve."""
    counts: list[int] = []
    original = WrenchProblem.grow_hulls

    def counted(self: WrenchProblem, *arguments: Any, **more: Any) -> None:
        counts.append(self.size)
        original(self, *arguments, **more)

    with patch.object(WrenchProblem, "grow_hulls", counted):
        epsilon(contacts, **arguments)
    return sum(counts)


@given(KINDS, SEEDS, FORMS, st.sampled_from([0.1, 1e-2, 2e-3]))
@settings(deadline=None, max_examples=60)
def test_the_growing_hull_finds_the_same(
    kind: str, seed: int, form: dict[str, Any], rtol: float
) -> None:
    contacts = drawn(kind, seed, 3)
    ours = epsilon(contacts, rtol=rtol, **form)
    theirs = by_growing_hull(contacts, rtol=1e-2, **form)
    assert ours.closed.tolist() == theirs.closed.tolist()
    assert ours.rank.tolist() == theirs.rank.tolist()
    assert (ours.lower <= theirs.upper * (1.0 + 1e-11)).all()
    assert (theirs.lower <= ours.upper * (1.0 + 1e-11)).all()
    assert (ours.upper - ours.lower <= rtol * ours.upper * (1.0 + 1e-9)).all()


def ratios(u: Floats, contacts: Contacts, *, per_finger: bool) -> Floats:
    """Supports in directions (..., 6), relative to the length of their part in the span."""
    d = contacts.points[1] - contacts.points[0]
    unresisted = np.concatenate([np.cross(contacts.points[0], d), d])
    unresisted /= np.linalg.norm(unresisted)
    within = u - (u @ unresisted)[..., None] * unresisted
    heights = []
    for p, n, beta in zip(contacts.points, contacts.normals, contacts.friction_angle, strict=True):
        g = within[..., :3] + np.cross(within[..., 3:], p)
        angle = np.arctan2(np.linalg.norm(np.cross(g, n), axis=-1), g @ n)
        outside = np.clip(angle - beta, 0.0, math.pi / 2.0)
        heights.append(np.linalg.norm(g, axis=-1) * np.cos(outside))
    height = sum(heights) if per_finger else np.maximum(*heights)
    return np.asarray(height / np.linalg.norm(within, axis=-1))


def least_ratio(contacts: Contacts, *, per_finger: bool, starts: int = 16) -> float:
    """Least ratio that random local searches find, each by steps that become smaller."""
    rng = np.random.default_rng(0)
    best = rng.normal(size=(starts, 6))
    for step in np.geomspace(1.0, 1e-8, 400):
        best /= np.linalg.norm(best, axis=1, keepdims=True)
        tried = best[:, None] + step * rng.normal(size=(starts, 48, 6))
        tried[:, 0] = best
        chosen = ratios(tried, contacts, per_finger=per_finger).argmin(axis=1)
        best = tried[np.arange(starts), chosen]
    return float(ratios(best, contacts, per_finger=per_finger).min())


@pytest.mark.slow
@pytest.mark.parametrize("actuation", ["total", "per_finger"])
@pytest.mark.parametrize("kind", ["nearly", "aligned", "random", "outward"])
def test_no_direction_is_below_and_some_is_at_epsilon(kind: str, actuation: Any) -> None:
    """Of many local searches among all directions none falls below the lower bound."""
    per_finger, found_at = actuation == "per_finger", 0
    for seed in range(8):
        contacts = drawn(kind, seed)
        one = Contacts(contacts.points[0], contacts.normals[0], contacts.friction[0])
        found = epsilon(one, rtol=1e-5, actuation=actuation)
        if not found.closed:
            continue
        least = least_ratio(one, per_finger=per_finger)
        assert least >= found.lower * (1.0 - 1e-9)
        found_at += least <= found.upper * 1.001
        assert ratios(found.certificate.direction, one, per_finger=per_finger) == pytest.approx(
            float(found.upper), rel=1e-9
        )
    assert found_at >= 4


@pytest.mark.parametrize("kind", NOISE)
def test_few_pairs_are_left_to_the_growing_hull(kind: str) -> None:
    contacts = drawn(kind, 1, 500)
    narrow = contacts.with_friction(np.minimum(contacts.friction, 0.9))
    for actuation in ("total", "per_finger"):
        assert left_to_the_hull(narrow, actuation=actuation, rtol=1e-2) <= 5


def test_wide_cones_are_left_to_the_growing_hull() -> None:
    """Both contacts may be on their caps, of which the search knows nothing."""
    points, tilt = [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]], math.radians(40.0)
    normals = [[math.cos(tilt), math.sin(tilt), 0.0], [-math.cos(tilt), math.sin(tilt), 0.0]]
    wide = Contacts(points, normals, math.tan(math.radians(60.0)))
    narrow = Contacts(points, normals, math.tan(math.radians(45.0)))
    assert left_to_the_hull(wide) == 1
    assert left_to_the_hull(narrow) == 0
    assert epsilon(wide).lower > epsilon(narrow).upper


@pytest.mark.parametrize("rtol", [1e-2, 1e-5, 1e-8])
def test_bounds_are_as_close_as_requested(rtol: float) -> None:
    for kind in NOISE:
        found = epsilon(drawn(kind, 3, 40), rtol=rtol)
        assert (found.upper - found.lower <= rtol * found.upper * (1.0 + 1e-9)).all()
        assert found.status.tolist() == [Status.CONVERGED] * 40


def test_closure_at_the_rim_of_a_cone() -> None:
    """The line is within rounding of the rim, or clearly inside or outside."""
    beta = math.atan(0.5)
    for angle, closed in ((-1e-3, True), (-1e-5, True), (1e-5, False), (1e-3, False)):
        tilt = beta + angle
        contacts = Contacts(
            [[-1.0, 0.2, 0.0], [1.0, 0.2, 0.0]],
            [[math.cos(tilt), math.sin(tilt), 0.0], [-1.0, 0.0, 0.0]],
            0.5,
        )
        found = epsilon(contacts)
        assert found.closed == closed
        assert (found.lower > 0.0) == closed
        theirs = by_growing_hull(contacts)
        assert found.lower <= theirs.upper
        assert theirs.lower <= found.upper
    exact = Contacts(
        [[-1.0, 0.2, 0.0], [1.0, 0.2, 0.0]],
        [[math.cos(beta), math.sin(beta), 0.0], [-1.0, 0.0, 0.0]],
        0.5,
    )
    assert left_to_the_hull(exact) == 1


@given(KINDS, SEEDS)
@settings(deadline=None)
def test_separating_directions_separate(kind: str, seed: int) -> None:
    contacts = drawn(kind, seed, 10)
    rng = np.random.default_rng(seed)
    turned = Contacts(contacts.points, rng.normal(size=(10, 2, 3)), contacts.friction)
    found = epsilon(turned)
    for g in np.flatnonzero(~found.closed):
        u = found.certificate.direction[g]
        assert np.linalg.norm(u) == pytest.approx(1.0)
        for p, n, beta in zip(
            turned.points[g], turned.normals[g], turned.friction_angle[g], strict=True
        ):
            seen = u[:3] + np.cross(u[3:], p)
            across = oracles.angle(seen, n) >= math.pi / 2.0 + float(beta) - 1e-9
            assert across or np.linalg.norm(seen) < 1e-9


@given(KINDS, SEEDS, FORMS)
@settings(deadline=None, max_examples=40)
def test_forces_in_equilibrium_press_against_each_other(
    kind: str, seed: int, form: dict[str, Any]
) -> None:
    contacts = drawn(kind, seed, 10)
    found = epsilon(contacts, **form)
    forces = found.certificate.equilibrium[found.closed, :, :3]
    known = np.isfinite(forces).all(axis=(1, 2))  # not where only the hull proves closure
    np.testing.assert_allclose(forces[known].sum(axis=1), 0.0, atol=1e-9)
    assert ((forces * contacts.normals[found.closed]).sum(axis=-1)[known] > 0.0).all()


def test_contacts_that_nearly_coincide_are_left_to_the_growing_hull() -> None:
    near = Contacts([[1.0, 0.0, 0.0], [1.0 + 1e-6, 0.0, 0.0]], [[1, 0, 0], [-1, 0, 0]], 0.5)
    assert left_to_the_hull(near) == 1
