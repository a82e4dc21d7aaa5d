"""Extreme normals, the method that enumerates them, and sets of normals at creases."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from grasp3d import Contacts, epsilon, force_closure
from grasp3d.arrays import Floats
from grasp3d.errors import ContactError, SettingError
from grasp3d.quality.wrenches import EpsilonOptions
from grasp3d.stability import normal_sets as module
from grasp3d.stability.normal_sets import (
    MAX_COMBINATIONS,
    Creases,
    NormalSets,
    check_combinations,
    extremes,
    face_normals,
    normals_to_test,
    rings_needed,
)
from grasp3d.system.context import running
from tests.helpers import grasps, oracles
from tests.helpers.random_grasps import random_grasps
from tests.helpers.tilts import all_combinations, angle_to_set, angles, within_sets

seeds = st.integers(0, 100_000)
few = settings(max_examples=20, deadline=None)


def batch(fingers: int, size: int, seed: int) -> Contacts:
    rng = np.random.default_rng(seed)
    return Contacts(
        rng.normal(size=(size, fingers, 3)),
        rng.normal(size=(size, fingers, 3)),
        rng.uniform(0.3, 1.0, size=(size, fingers)),
    )


@given(st.floats(0.0, 1.5), st.floats(0.01, 1.5))
@example(1.0, 0.5)  # alpha = 4 beta exactly
def test_the_number_of_rings_is_the_smallest_that_is_dense_enough(tilt: float, beta: float) -> None:
    rings = rings_needed(tilt, beta)
    assert rings >= 1
    assert tilt / rings <= 2.0 * beta * (1.0 + 1e-8)
    assert rings == 1 or tilt / (rings - 1) > 2.0 * beta
    assert rings_needed([0.0, 0.1, tilt], [0.0, 0.5, beta]) == rings


@given(st.integers(1, 4), seeds, st.integers(3, 12))
@few
def test_tested_normals_are_the_given_one_and_rings_at_even_steps(
    fingers: int, seed: int, count: int
) -> None:
    contacts = batch(fingers, 5, seed)
    tilt = np.random.default_rng(seed).uniform(0.0, 1.2, size=(5, fingers))
    rings = rings_needed(tilt, contacts.friction_angle)
    if (1 + rings * count) ** fingers > MAX_COMBINATIONS:
        with pytest.raises(SettingError, match="combinations"):
            normals_to_test(contacts, tilt, count=count, creases=None)
        return
    tested = normals_to_test(contacts, tilt, count=count, creases=None)
    assert len(tested) == fingers
    steps = np.repeat(np.arange(1, rings + 1) / rings, count)
    for i, normals in enumerate(tested):
        assert normals.shape == (5, 1 + rings * count, 3)
        np.testing.assert_array_equal(normals[:, 0], contacts.normals[:, i])
        np.testing.assert_allclose(np.linalg.norm(normals, axis=-1), 1.0, rtol=1e-14)
        radii = angles(contacts.normals[:, i, None], normals[:, 1:])
        np.testing.assert_allclose(radii, tilt[:, i, None] * steps, atol=1e-14)


@given(seeds, st.integers(2, 5), st.floats(0.1, 0.9), st.floats(0.05, 1.0))
@example(0, 2, 0.75, 1.0)  # three steps from face to face would omit the bisector
@few
def test_tested_normals_at_creases_are_within_the_tilt_of_the_set(
    seed: int, corners: int, half_width: float, tilt: float
) -> None:
    contacts = batch(2, 1, seed)
    faces = oracles.cone_edges(contacts.normals[0, 1], half_width, corners)
    first, second = normals_to_test(
        contacts, np.full((1, 2), tilt), count=4, creases={1: faces[None]}
    )
    assert first.shape[1] == 1 + 4 * rings_needed(np.full(2, tilt), contacts.friction_angle)
    for normal in second[0]:
        assert angle_to_set(faces, normal) <= tilt + 1e-7
    middle = contacts.normals[0, 1]
    bisectors = [*(a + b for a, b in zip(faces, np.roll(faces, 1, axis=0), strict=True)), middle]
    for required in (*faces, *(bisectors if corners > 2 else [middle])):
        assert min(oracles.angle(required, normal) for normal in second[0]) <= 1e-7


def test_opposite_faces_have_a_bisector() -> None:
    """The two sides of a sheet."""
    contacts = Contacts([[0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]])
    flat = Contacts(contacts.points[None], contacts.normals[None])
    faces = np.array([[[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
    (tested,) = normals_to_test(flat, np.full((1, 1), 0.1), count=3, creases={0: faces})
    np.testing.assert_allclose(np.linalg.norm(tested, axis=-1), 1.0, rtol=1e-12)
    assert np.abs(tested[0, :, 2]).min() == pytest.approx(0.0, abs=1e-12)


def test_too_many_combinations_are_refused() -> None:
    check_combinations([MAX_COMBINATIONS])
    with pytest.raises(SettingError, match=r"2 x 1000001 normals make 2e\+06 combinations"):
        check_combinations([2, MAX_COMBINATIONS // 2 + 1])


RTOL = 1e-3
COUNT = 4


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


@pytest.mark.parametrize("hulls", [1, 7])
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


PAIR = Contacts([[-1, 0, 0], [1, 0, 0]], [[1, 0, 0], [-1, 0, 0]])
CUBE_CORNER = -np.eye(3)


def random_set(corners: int, half_width: float, seed: int) -> np.ndarray:
    """Normals on a cone about a random direction, in order, at uneven angles."""
    rng = np.random.default_rng(seed)
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    cone = oracles.cone_edges(axis, half_width, 60)
    return cone[np.sort(rng.choice(60, corners, replace=False))]


def batch_of(*sets: np.ndarray) -> np.ndarray:
    """A batch of sets as `face_normals` returns it."""
    contacts = Contacts(np.zeros((len(sets), 1, 3)), np.ones((len(sets), 1, 3)))
    return face_normals({0: np.array(sets)}, contacts)[0]


@given(st.integers(2, 6), st.floats(0.02, 1.3), seeds)
@few
def test_a_cap_about_the_middle_contains_every_normal_of_a_set(
    corners: int, half_width: float, seed: int
) -> None:
    smooth = Contacts(np.zeros((1, 2, 3)), [[[0.0, 0, 1], [1, 2, 3]]])
    faces = face_normals({1: random_set(corners, half_width, seed)}, smooth)
    sets = NormalSets.of_contacts(smooth, faces)
    assert sets.radii[0, 0] == 0.0
    rng = np.random.default_rng(seed)
    inside = np.concatenate([within_sets(faces[1], rng) for _ in range(50)])
    assert angles(sets.middles[0, 1], inside).max() <= sets.radii[0, 1] + 1e-9
    assert sets.radii[0, 1] == pytest.approx(angles(sets.middles[0, 1], faces[1][0]).max())


@given(st.integers(3, 7), seeds)
@few
def test_corners_are_returned_in_order_whatever_their_order_and_length(
    corners: int, seed: int
) -> None:
    given_ = random_set(corners, 0.7, seed)
    rng = np.random.default_rng(seed)
    mixed = rng.permutation(given_) * rng.uniform(0.1, 10.0, size=(corners, 1))
    faces = batch_of(mixed)[0]
    np.testing.assert_allclose(np.linalg.norm(faces, axis=1), 1.0, rtol=1e-14)
    # All corners of a convex polygon lie on the same side of each of its edges.
    for i in range(corners):
        side = np.cross(faces[i], faces[(i + 1) % corners])
        assert (faces @ side >= -1e-12).all()
    assert angles(given_[:, None], faces).min(axis=1).max() <= 1e-12


def test_normals_inside_the_others_are_omitted_and_the_last_corner_is_repeated() -> None:
    inner = np.array([-1.0, -1.0, -1.0])
    faces = batch_of(np.vstack([CUBE_CORNER, inner]))[0]
    assert faces.shape == (4, 3)
    np.testing.assert_array_equal(faces[3], faces[2])
    found = {tuple(row) for row in faces}
    assert found == {tuple(row) for row in CUBE_CORNER}
    flat = batch_of(np.array([[1.0, 0, 0], [1, 1, 0], [0, 1, 0]]))[0]
    assert {tuple(row) for row in flat} == {(1.0, 0.0, 0.0), (0.0, 1.0, 0.0)}
    smooth = batch_of(np.array([[0.0, 0, 1], [0, 0, 2]]))
    np.testing.assert_array_equal(smooth, np.broadcast_to([0.0, 0, 1], (1, 2, 3)))


def test_the_corner_of_a_cube() -> None:
    corner = NormalSets.of_contacts(PAIR.reshape((1,)), {0: batch_of(CUBE_CORNER)})
    assert corner.middles[0, 0] == pytest.approx(np.full(3, -1.0 / math.sqrt(3.0)))
    assert corner.radii[0, 0] == pytest.approx(math.acos(1.0 / math.sqrt(3.0)))


@pytest.mark.parametrize(
    ("creases", "message"),
    [
        ({2: CUBE_CORNER}, r"creases name contact 2, but a grasp has contacts 0 to 1"),
        ({0: CUBE_CORNER[:1]}, r"contact 0: a crease needs two normals or more"),
        ({0: CUBE_CORNER[:, :2]}, r"two normals or more, shape \(..., k, 3\)"),
        ({1: [[1, 0, 0], [0, 0, 0]]}, r"contact 1: a normal at the crease has no direction"),
        (
            {0: [[1, 0, 0], [-1, 0, 0]]},
            r"contact 0: the crease.s normals do not lie within a hemisphere",
        ),
        ({0: [["a", "b", "c"], ["d", "e", "f"]]}, r"must be numbers"),
    ],
    ids=str,
)
def test_invalid_creases_are_refused(creases: Any, message: str) -> None:
    with pytest.raises(ContactError, match=message):
        face_normals(creases, PAIR)
