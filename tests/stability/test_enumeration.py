"""Tests of the enumeration: comparison with all combinations, one by one."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import Contacts, epsilon, force_closure
from grasp3d.quality.wrenches import EpsilonOptions
from grasp3d.stability import enumeration
from grasp3d.stability.enumeration import Tested, closure_at, extreme_normals, extremes
from grasp3d.system.context import running
from tests.helpers import grasps, oracles
from tests.helpers.grasps import with_options
from tests.helpers.random_grasps import random_grasps
from tests.helpers.tilts import all_combinations

RTOL = 1e-3
seeds = st.integers(0, 100_000)
few = settings(max_examples=20, deadline=None)


def random_problem(
    fingers: int, size: int, seed: int, *, count: int = 4, crease: bool = False, soft: bool = False
) -> tuple[Contacts, Tested]:
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
    tilt = fraction * contacts.friction_angle
    creases = None
    if crease:
        creases = {
            fingers - 1: np.stack(
                [oracles.cone_edges(n, rng.uniform(0.02, 0.4), 2) for n in contacts.normals[:, -1]]
            )
        }
    return contacts, extreme_normals(contacts, tilt, count=count, rings=1, creases=creases)


def combinations_of(contacts: Contacts, tested: Tested, b: int) -> Contacts:
    """Every combination of grasp b, as a batch."""
    return all_combinations(grasps.one(contacts, b), [normals[b] for normals in tested])


# The oracle: every combination, one by one


@pytest.mark.slow
@pytest.mark.parametrize("edges", [None, 6])
@pytest.mark.parametrize(("fingers", "crease"), [(1, False), (2, False), (2, True), (3, True)])
def test_closure_is_that_of_all_combinations(fingers: int, crease: bool, edges: int | None) -> None:
    contacts, tested = random_problem(fingers, 60, 1, crease=crease)
    closure = closure_at(contacts, tested, options=EpsilonOptions(edges=edges))
    kinds = set()
    for b in range(60):
        closed = force_closure(combinations_of(contacts, tested, b), edges=edges).closed
        assert closure.closing[b] == closed.any()
        assert closure.failing[b] == (not closed.all())
        kinds.add((bool(closed.any()), bool(closed.all())))
    assert fingers == 1 or len(kinds) == 3


def test_closure_with_cone_offsets_per_contact() -> None:
    contacts, tested = random_problem(2, 30, 2)
    rng = np.random.default_rng(0)
    cone_offset = rng.uniform(-0.3, 0.3, size=(30, 2))
    cone_offset = np.maximum(cone_offset, 0.05 - contacts.friction_angle)
    closure = closure_at(contacts, tested, cone_offset=cone_offset)
    assert 0.1 < closure.closing.mean() < 1.0
    for b in range(30):
        closed = force_closure(
            combinations_of(contacts, tested, b), cone_offset=cone_offset[b]
        ).closed
        assert (closure.closing[b], closure.failing[b]) == (closed.any(), not closed.all())


KINDS: list[dict[str, Any]] = [
    {},
    {"actuation": "per_finger"},
    {"edges": 6},
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
    size = 12
    contacts, tested = random_problem(fingers, size, 3, crease=crease, soft=soft)
    found = extremes(contacts, tested, **with_options(rtol=RTOL, **options))
    assert found.hulls == math.prod(normals.shape[1] for normals in tested)
    rounding = 1e-9 if "edges" in options else RTOL
    for b in range(size):
        every = epsilon(combinations_of(contacts, tested, b), rtol=RTOL, **options).lower
        assert len(every) == found.hulls
        assert found.minimum[b] == pytest.approx(every.min(), rel=rounding, abs=1e-12)
        assert found.maximum[b] == pytest.approx(every.max(), rel=rounding, abs=1e-12)
        for normals, value in (
            (found.worst_normals[b], found.minimum[b]),
            (found.best_normals[b], found.maximum[b]),
        ):
            for normal, candidates in zip(normals, tested, strict=True):
                assert (candidates[b] == normal).all(axis=1).any()
            attained = epsilon(
                grasps.changed(grasps.one(contacts, b), normals=normals), rtol=RTOL, **options
            )
            assert attained.lower == pytest.approx(value, rel=rounding, abs=1e-12)
    assert (found.maximum > found.minimum).any()


# Laws


@given(st.integers(2, 3), seeds, st.sampled_from([None, 5]))
@few
def test_epsilon_and_closure_agree(fingers: int, seed: int, edges: int | None) -> None:
    contacts, tested = random_problem(fingers, 5, seed)
    closure = closure_at(contacts, tested, options=EpsilonOptions(edges=edges))
    found = extremes(contacts, tested, options=EpsilonOptions(edges=edges))
    far = (found.minimum > 1e-6) | (found.minimum == 0.0)
    np.testing.assert_array_equal((found.minimum > 0.0)[far], ~closure.failing[far])
    far = (found.maximum > 1e-6) | (found.maximum == 0.0)
    np.testing.assert_array_equal((found.maximum > 0.0)[far], closure.closing[far])


@given(st.integers(2, 3), seeds)
@few
def test_combinations_are_tested_until_the_label_is_decided(fingers: int, seed: int) -> None:
    contacts, tested = random_problem(fingers, 20, seed, count=8)
    closure = closure_at(contacts, tested)
    combinations = 9**fingers
    decided = closure.closing & closure.failing
    assert (closure.closing | closure.failing).all()
    assert (closure.hulls[~decided] == combinations).all()
    assert (closure.hulls >= 1).all()
    assert (closure.hulls <= combinations).all()


def test_torsion_position_and_size_do_not_affect_closure() -> None:
    contacts, tested = random_problem(3, 40, 5, soft=True)
    closure = closure_at(contacts, tested)
    moved = Contacts(
        1e-3 * (contacts.points + [5.0, -3.0, 1.0]), contacts.normals, contacts.friction
    )
    other = closure_at(moved, tested)
    np.testing.assert_array_equal(closure.closing, other.closing)
    np.testing.assert_array_equal(closure.failing, other.failing)


@pytest.mark.parametrize(("hulls", "axes"), [(1, 1), (7, 140), (100, 2000)])
def test_chunks_and_threads_do_not_change_results(
    hulls: int, axes: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    """From one grasp in memory at once to all; nor do the other grasps of a batch."""
    contacts, tested = random_problem(2, 15, 6, crease=True)
    cone_offset = np.random.default_rng(1).uniform(-0.2, 0.2, size=(15, 2))
    closure = closure_at(contacts, tested, cone_offset=cone_offset)
    found = extremes(contacts, tested)
    monkeypatch.setattr(enumeration, "MAX_AXES", axes)
    again = running(threads=2)(closure_at)(contacts, tested, cone_offset=cone_offset)
    other = running(threads=2)(extremes)(contacts, tested)
    for name in ("closing", "failing", "hulls"):
        np.testing.assert_array_equal(getattr(again, name), getattr(closure, name))
    for name in ("minimum", "maximum"):
        assert getattr(other, name) == pytest.approx(getattr(found, name), rel=1e-9)
    assert other.hulls == found.hulls
    monkeypatch.setattr(enumeration, "MAX_HULLS", hulls)
    again = closure_at(contacts, tested, cone_offset=cone_offset)
    np.testing.assert_array_equal(again.closing, closure.closing)
    np.testing.assert_array_equal(again.failing, closure.failing)
    decided = closure.closing & closure.failing
    np.testing.assert_array_equal(again.hulls[~decided], closure.hulls[~decided])


# Known and degenerate grasps


def test_a_pair_that_is_open_only_at_the_rim() -> None:
    """The third normal of the first contact is tilted by 0.4; the friction angle is 0.3."""
    pair = Contacts([[[-1, 0, 0], [1, 0, 0]]], [[[1, 0, 0], [-1, 0, 0]]], math.tan(0.3))
    tilted = [[math.cos(t), math.sin(t), 0.0] for t in (0.0, 0.2, 0.4)]
    tested = (np.array([tilted]), pair.normals[:, 1:])
    closure = closure_at(pair, tested)
    assert (closure.closing[0], closure.failing[0], closure.hulls[0]) == (True, True, 3)
    found = extremes(pair, tested)
    assert found.minimum[0] == 0.0
    np.testing.assert_array_equal(found.worst_normals[0, 0], tilted[2])
    np.testing.assert_array_equal(found.best_normals[0], pair.normals[0])


@pytest.mark.slow
def test_without_tilt_all_combinations_are_the_same_grasp() -> None:
    contacts = grasps.stacked([grasps.regular_on_ball("triangle")])
    tested = extreme_normals(contacts, np.zeros((1, 3)), count=3)
    closure, found = closure_at(contacts, tested), extremes(contacts, tested)
    assert (closure.closing[0], closure.failing[0], closure.hulls[0]) == (True, False, 4**3)
    assert found.minimum[0] == pytest.approx(found.maximum[0], rel=1e-6)
