"""The enumeration against all combinations tried one by one."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import Contacts, epsilon, force_closure
from grasp3d.paper.convergence import random_grasps
from grasp3d.stability import enumeration
from grasp3d.stability.enumeration import extremes, see
from grasp3d.stability.extreme_normals import Tested, extreme_normals
from tests.helpers import grasps, oracles
from tests.helpers.tilts import every

RTOL = 1e-3
seeds = st.integers(0, 100_000)
few = settings(max_examples=20, deadline=None)


def question(
    fingers: int, size: int, seed: int, *, count: int = 4, crease: bool = False, soft: bool = False
) -> tuple[Contacts, Tested]:
    """Random grasps with friction and tilt of their own at each contact."""
    rng = np.random.default_rng(seed)
    random, _ = random_grasps(fingers, size, seed)
    friction = rng.uniform(0.4, 1.0, size=(size, fingers))
    contacts = grasps.changed(
        random,
        friction=friction,
        torsion_radius=rng.uniform(0.0, 0.3, size=(size, fingers)) if soft else 0.0,
    )
    share = rng.uniform(0.0, 1.2, size=(size, 1)) * rng.uniform(0.5, 1.0, size=(size, fingers))
    tilt = share * contacts.friction_angle
    creases = None
    if crease:
        creases = {
            fingers - 1: np.stack(
                [oracles.cone_edges(n, rng.uniform(0.02, 0.4), 2) for n in contacts.normals[:, -1]]
            )
        }
    return contacts, extreme_normals(contacts, tilt, count=count, rings=1, creases=creases)


def one_of(contacts: Contacts, tested: Tested, b: int) -> Contacts:
    """Every combination of one of the grasps, as a batch."""
    return every(grasps.one(contacts, b), [normals[b] for normals in tested])


# The oracle: every combination, one by one


@pytest.mark.parametrize("edges", [None, 6])
@pytest.mark.parametrize(("fingers", "crease"), [(1, False), (2, False), (2, True), (3, True)])
def test_what_is_seen_is_what_all_combinations_show(
    fingers: int, crease: bool, edges: int | None
) -> None:
    contacts, tested = question(fingers, 60, 1, crease=crease)
    seen = see(contacts, tested, edges=edges)
    kinds = set()
    for b in range(60):
        closed = force_closure(one_of(contacts, tested, b), edges=edges).closed
        assert seen.closing[b] == closed.any()
        assert seen.failing[b] == (not closed.all())
        kinds.add((bool(closed.any()), bool(closed.all())))
    assert fingers == 1 or len(kinds) == 3


def test_what_is_seen_of_cones_narrowed_and_widened_one_by_one() -> None:
    contacts, tested = question(2, 30, 2)
    rng = np.random.default_rng(0)
    cone_offset = rng.uniform(-0.3, 0.3, size=(30, 2))
    cone_offset = np.maximum(cone_offset, 0.05 - contacts.friction_angle)
    seen = see(contacts, tested, cone_offset=cone_offset)
    assert 0.1 < seen.closing.mean() < 1.0
    for b in range(30):
        closed = force_closure(one_of(contacts, tested, b), cone_offset=cone_offset[b]).closed
        assert (seen.closing[b], seen.failing[b]) == (closed.any(), not closed.all())


KINDS: list[dict[str, Any]] = [
    {},
    {"actuation": "per_finger"},
    {"edges": 6},
    {"edges": 5, "actuation": "per_finger", "torque_scale": 0.7},
]


@pytest.mark.parametrize("options", KINDS, ids=str)
@pytest.mark.parametrize(
    ("fingers", "crease", "soft"), [(2, False, False), (2, True, True), (3, False, False)]
)
def test_smallest_and_largest_epsilon_are_those_of_all_combinations(
    fingers: int, crease: bool, soft: bool, options: dict[str, Any]
) -> None:
    size = 12
    contacts, tested = question(fingers, size, 3, crease=crease, soft=soft)
    found = extremes(contacts, tested, rtol=RTOL, **options)
    assert found.hulls == math.prod(normals.shape[1] for normals in tested)
    slack = 1e-9 if "edges" in options else RTOL
    for b in range(size):
        all_of_them = epsilon(one_of(contacts, tested, b), rtol=RTOL, **options).lower
        assert len(all_of_them) == found.hulls
        assert found.minimum[b] == pytest.approx(all_of_them.min(), rel=slack, abs=1e-12)
        assert found.maximum[b] == pytest.approx(all_of_them.max(), rel=slack, abs=1e-12)
        for normals, value in (
            (found.worst_normals[b], found.minimum[b]),
            (found.best_normals[b], found.maximum[b]),
        ):
            for normal, among in zip(normals, tested, strict=True):
                assert (among[b] == normal).all(axis=1).any()
            attained = epsilon(
                grasps.changed(grasps.one(contacts, b), normals=normals), rtol=RTOL, **options
            )
            assert attained.lower == pytest.approx(value, rel=slack, abs=1e-12)
    assert (found.maximum > found.minimum).any()


# Laws


@given(st.integers(2, 3), seeds, st.sampled_from([None, 5]))
@few
def test_epsilon_and_what_is_seen_agree(fingers: int, seed: int, edges: int | None) -> None:
    contacts, tested = question(fingers, 5, seed)
    seen = see(contacts, tested, edges=edges)
    found = extremes(contacts, tested, edges=edges)
    far = (found.minimum > 1e-6) | (found.minimum == 0.0)
    np.testing.assert_array_equal((found.minimum > 0.0)[far], ~seen.failing[far])
    far = (found.maximum > 1e-6) | (found.maximum == 0.0)
    np.testing.assert_array_equal((found.maximum > 0.0)[far], seen.closing[far])


@given(st.integers(2, 3), seeds)
@few
def test_only_what_is_not_settled_is_tried_on(fingers: int, seed: int) -> None:
    contacts, tested = question(fingers, 20, seed, count=8)
    seen = see(contacts, tested)
    combinations = 9**fingers
    settled = seen.closing & seen.failing
    assert (seen.closing | seen.failing).all()
    assert (seen.hulls[~settled] == combinations).all()
    assert (seen.hulls >= 1).all()
    assert (seen.hulls <= combinations).all()


def test_ambiguous_grasps_take_few_hulls() -> None:
    contacts, tested = question(3, 200, 0, count=8)
    seen = see(contacts, tested)
    settled = seen.closing & seen.failing
    assert settled.sum() > 50
    assert np.median(seen.hulls[settled]) <= 20
    assert seen.hulls[settled].mean() < 0.1 * 9**3


def test_torsion_place_and_size_play_no_part_in_what_is_seen() -> None:
    contacts, tested = question(3, 40, 5, soft=True)
    seen = see(contacts, tested)
    moved = Contacts(
        1e-3 * (contacts.points + [5.0, -3.0, 1.0]), contacts.normals, contacts.friction
    )
    other = see(moved, tested)
    np.testing.assert_array_equal(seen.closing, other.closing)
    np.testing.assert_array_equal(seen.failing, other.failing)


@pytest.mark.parametrize("part", [1, 7, 100])
def test_neither_parts_nor_threads_change_anything(
    part: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    contacts, tested = question(2, 15, 6, crease=True)
    seen, found = see(contacts, tested), extremes(contacts, tested)
    monkeypatch.setattr(enumeration, "PART", part)
    monkeypatch.setattr(enumeration, "LAID_OUT", 20 * part)
    again, other = see(contacts, tested, threads=2), extremes(contacts, tested, threads=2)
    np.testing.assert_array_equal(again.closing, seen.closing)
    np.testing.assert_array_equal(again.failing, seen.failing)
    settled = seen.closing & seen.failing
    np.testing.assert_array_equal(again.hulls[~settled], seen.hulls[~settled])
    for name in ("minimum", "maximum"):
        assert getattr(other, name) == pytest.approx(getattr(found, name), rel=1e-9)
    assert other.hulls == found.hulls


@pytest.mark.parametrize("laid_out", [1, 100])
def test_grasps_keep_their_own_cones_when_they_are_laid_out_in_parts(
    laid_out: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    contacts, tested = question(2, 15, 2)
    cone_offset = np.random.default_rng(1).uniform(-0.2, 0.2, size=(15, 2))
    seen = see(contacts, tested, cone_offset=cone_offset)
    monkeypatch.setattr(enumeration, "LAID_OUT", laid_out)
    again = see(contacts, tested, cone_offset=cone_offset)
    for name in ("closing", "failing", "hulls"):
        np.testing.assert_array_equal(getattr(again, name), getattr(seen, name))


def test_the_other_grasps_of_a_batch_change_nothing() -> None:
    contacts, tested = question(2, 10, 7)
    seen, found = see(contacts, tested), extremes(contacts, tested)
    for b in range(10):
        alone, own = grasps.one(contacts, [b]), tuple(normals[[b]] for normals in tested)
        one, other = see(alone, own), extremes(alone, own)
        assert (one.closing[0], one.failing[0]) == (seen.closing[b], seen.failing[b])
        assert one.hulls[0] == seen.hulls[b]
        assert other.minimum[0] == pytest.approx(found.minimum[b], rel=1e-9)


# Known and degenerate


def test_a_pair_that_loses_its_grip_only_at_the_rim() -> None:
    """The third normal of the first contact is 0.4 off, where friction reaches 0.3."""
    pair = Contacts([[[-1, 0, 0], [1, 0, 0]]], [[[1, 0, 0], [-1, 0, 0]]], math.tan(0.3))
    off = [[math.cos(t), math.sin(t), 0.0] for t in (0.0, 0.2, 0.4)]
    tested = (np.array([off]), pair.normals[:, 1:])
    seen = see(pair, tested)
    assert (seen.closing[0], seen.failing[0], seen.hulls[0]) == (True, True, 3)
    found = extremes(pair, tested)
    assert found.minimum[0] == 0.0
    np.testing.assert_array_equal(found.worst_normals[0, 0], off[2])
    np.testing.assert_array_equal(found.best_normals[0], pair.normals[0])


def test_the_same_normal_everywhere_is_one_grasp_again_and_again() -> None:
    contacts = grasps.stacked([grasps.around_a_ball("triangle")])
    tested = extreme_normals(contacts, np.zeros((1, 3)), count=3)
    seen, found = see(contacts, tested), extremes(contacts, tested)
    assert (seen.closing[0], seen.failing[0], seen.hulls[0]) == (True, False, 4**3)
    assert found.minimum[0] == pytest.approx(found.maximum[0], rel=1e-6)


def test_no_grasps() -> None:
    none = Contacts(np.zeros((0, 2, 3)), np.zeros((0, 2, 3)))
    tested = extreme_normals(none, np.zeros((0, 2)), count=3)
    assert see(none, tested).hulls.shape == (0,)
    assert extremes(none, tested).worst_normals.shape == (0, 2, 3)


def test_results_are_locked() -> None:
    contacts, tested = question(2, 3, 8)
    for answer in (see(contacts, tested), extremes(contacts, tested)):
        for values in vars(answer).values():
            assert isinstance(values, int) or not values.flags.writeable


def test_grasps_are_laid_out_some_at_a_time(monkeypatch: pytest.MonkeyPatch) -> None:
    contacts, tested = question(2, 30, 3, crease=True)
    cone_offset = np.random.default_rng(0).uniform(-0.1, 0.1, size=contacts.friction.shape)
    whole = see(contacts, tested, cone_offset=cone_offset), extremes(contacts, tested)
    monkeypatch.setattr(enumeration, "LAID_OUT", 7 * 2 * tested[1].shape[1])  # seven grasps
    parts = see(contacts, tested, cone_offset=cone_offset), extremes(contacts, tested)
    for one, other in zip(whole, parts, strict=True):
        for name, values in vars(one).items():
            assert np.array_equal(values, vars(other)[name]), name
