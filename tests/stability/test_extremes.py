"""Tests of the paper's method: comparison with all combinations, one by one."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import Contacts, epsilon, force_closure
from grasp3d.arrays import Floats
from grasp3d.quality.wrenches import EpsilonOptions
from grasp3d.stability import normal_sets as module
from grasp3d.stability.normal_sets import Creases, extremes, normals_to_test
from grasp3d.system.context import running
from tests.helpers import grasps, oracles
from tests.helpers.random_grasps import random_grasps
from tests.helpers.tilts import all_combinations

RTOL = 1e-3
COUNT = 4
seeds = st.integers(0, 100_000)
few = settings(max_examples=20, deadline=None)


def random_problem(
    fingers: int, size: int, seed: int, *, crease: bool = False, soft: bool = False
) -> tuple[Contacts, Floats, Creases]:
    """Random grasps with different friction and tilts at each contact."""
    rng = np.random.default_rng(seed)
    random, _ = random_grasps(fingers, size, seed)
    friction = rng.uniform(0.4, 1.0, size=(size, fingers))
    contacts = grasps.changed(
        random,
        friction=friction,
        torsion_radius=rng.uniform(0.0, 0.3, size=(size, fingers)) if soft else 0.0,
    )
    fraction = rng.uniform(0.0, 1.2, size=(size, 1)) * rng.uniform(0.5, 1.0, size=(size, fingers))
    creases = {}
    if crease:
        last = [oracles.cone_edges(n, rng.uniform(0.02, 0.4), 2) for n in contacts.normals[:, -1]]
        creases = {fingers - 1: np.stack(last)}
    return contacts, fraction * contacts.friction_angle, creases


def combinations_of(contacts: Contacts, tilt: Floats, creases: Creases, b: int) -> Contacts:
    """Every combination of grasp b, as a batch."""
    tested = normals_to_test(contacts, tilt, count=COUNT, creases=creases)
    return all_combinations(grasps.one(contacts, b), [normals[b] for normals in tested])


@pytest.mark.parametrize(("fingers", "crease"), [(1, False), (2, False), (2, True), (3, True)])
def test_closure_is_that_of_all_combinations(fingers: int, crease: bool) -> None:
    contacts, tilt, creases = random_problem(fingers, 60, 1, crease=crease)
    found = extremes(contacts, tilt, count=COUNT, creases=creases)
    kinds = set()
    for b in range(60):
        closed = force_closure(combinations_of(contacts, tilt, creases, b)).closed
        assert found.stable[b] == closed.all()
        assert found.unstable[b] == (not closed.any())
        kinds.add((bool(closed.any()), bool(closed.all())))
    assert fingers == 1 or len(kinds) == 3


KINDS: list[dict[str, Any]] = [
    {},
    {"actuation": "per_finger"},
    {"edges": 5, "actuation": "per_finger", "torque_scale": 0.7},
]


@pytest.mark.slow
@pytest.mark.parametrize("options", KINDS, ids=str)
@pytest.mark.parametrize(
    ("fingers", "crease", "soft"), [(2, False, False), (2, True, True), (3, False, False)]
)
def test_smallest_and_largest_epsilon_are_those_of_all_combinations(
    fingers: int, crease: bool, soft: bool, options: dict[str, Any]
) -> None:
    contacts, tilt, creases = random_problem(fingers, 12, 3, crease=crease, soft=soft)
    of = EpsilonOptions(rtol=RTOL, **options)
    found = extremes(contacts, tilt, count=COUNT, creases=creases, options=of)
    rounding = 1e-9 if "edges" in options else RTOL
    for b in range(12):
        combinations = combinations_of(contacts, tilt, creases, b)
        every = epsilon(combinations, rtol=RTOL, **options).lower
        assert found.minimum[b] == pytest.approx(every.min(), rel=rounding, abs=1e-12)
        assert found.maximum[b] == pytest.approx(every.max(), rel=rounding, abs=1e-12)
    assert (found.maximum > found.minimum).any()


@given(st.integers(2, 3), seeds)
@few
def test_epsilon_and_closure_agree(fingers: int, seed: int) -> None:
    contacts, tilt, _ = random_problem(fingers, 5, seed)
    closure = extremes(contacts, tilt, count=COUNT)
    found = extremes(contacts, tilt, count=COUNT, options=EpsilonOptions())
    far = (found.minimum > 1e-6) | (found.minimum == 0.0)
    np.testing.assert_array_equal((found.minimum > 0.0)[far], closure.stable[far])
    far = (found.maximum > 1e-6) | (found.maximum == 0.0)
    np.testing.assert_array_equal((found.maximum == 0.0)[far], closure.unstable[far])
    np.testing.assert_array_equal(found.stable, closure.stable)
    np.testing.assert_array_equal(found.unstable, closure.unstable)


@pytest.mark.parametrize("hulls", [1, 7, 100])
def test_blocks_and_threads_do_not_change_results(
    hulls: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From one hull in memory at once; nor do the other grasps of a batch."""
    contacts, tilt, creases = random_problem(2, 15, 6, crease=True)
    of: dict[str, Any] = {"count": COUNT, "creases": creases}
    closure = extremes(contacts, tilt, **of)
    found = extremes(contacts, tilt, **of, options=EpsilonOptions())
    monkeypatch.setattr(module, "MAX_HULLS", hulls)
    again = running(threads=2)(extremes)(contacts, tilt, **of)
    other = running(threads=2)(extremes)(contacts, tilt, **of, options=EpsilonOptions())
    for name in ("stable", "unstable"):
        np.testing.assert_array_equal(getattr(again, name), getattr(closure, name))
    for name in ("minimum", "maximum"):
        assert getattr(other, name) == pytest.approx(getattr(found, name), rel=1e-9)


def test_without_tilt_all_combinations_are_the_same_grasp() -> None:
    contacts = grasps.stacked([grasps.regular_on_ball("triangle")])
    found = extremes(contacts, np.zeros((1, 3)), count=3, options=EpsilonOptions())
    assert (found.stable[0], found.unstable[0]) == (True, False)
    assert found.minimum[0] == pytest.approx(found.maximum[0], rel=1e-6)
    assert math.isinf(extremes(contacts, np.zeros((1, 3)), count=3).minimum[0])
