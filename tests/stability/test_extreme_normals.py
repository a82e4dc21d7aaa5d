"""Tests of extreme normals: their positions, density and nesting."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st

from grasp3d import Contacts
from grasp3d.errors import SettingError
from grasp3d.stability.normal_sets import (
    MAX_COMBINATIONS,
    check_combinations,
    normals_to_test,
    rings_needed,
)
from tests.helpers import grasps, oracles
from tests.helpers.tilts import angle_to_set, angles

few = settings(max_examples=30, deadline=None)
seeds = st.integers(0, 100_000)


def batch(fingers: int, size: int, seed: int) -> Contacts:
    rng = np.random.default_rng(seed)
    return Contacts(
        rng.normal(size=(size, fingers, 3)),
        rng.normal(size=(size, fingers, 3)),
        rng.uniform(0.3, 1.0, size=(size, fingers)),
    )


# Laws


@given(st.floats(0.0, 1.5), st.floats(0.01, 1.5))
def test_the_number_of_rings_is_the_smallest_that_is_dense_enough(tilt: float, beta: float) -> None:
    rings = rings_needed(tilt, beta)
    assert rings >= 1
    assert tilt / rings <= 2.0 * beta * (1.0 + 1e-8)
    assert rings == 1 or tilt / (rings - 1) > 2.0 * beta


@given(st.floats(0.05, 1.5), st.floats(0.02, 1.5), st.floats(0.0, 1.0), seeds)
@few
def test_every_tilt_is_within_the_friction_angle_of_a_ring(
    tilt: float, beta: float, fraction: float, seed: int
) -> None:
    contacts = grasps.at_angle(batch(1, 1, seed), beta)
    (tested,) = normals_to_test(contacts, np.full((1, 1), tilt), count=3, creases=None)
    radii = angles(contacts.normals[0, 0], tested[0])
    assert np.abs(radii - fraction * tilt).min() <= beta * (1.0 + 1e-8)


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


@given(seeds, st.integers(3, 10), st.integers(2, 3))
@few
def test_multiples_of_the_count_include_the_same_normals(seed: int, count: int, times: int) -> None:
    contacts, tilt = batch(2, 3, seed), np.full((3, 2), 0.3)
    for less, more in zip(
        normals_to_test(contacts, tilt, count=count, creases=None),
        normals_to_test(contacts, tilt, count=times * count, creases=None),
        strict=True,
    ):
        distances = angles(less[:, :, None], more[:, None]).min(axis=2)
        assert distances.max() <= 1e-14


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


@given(seeds, st.floats(0.01, 1.0), st.floats(0.05, 1.5), st.floats(0.0, 1.0))
@few
def test_every_normal_on_a_crease_is_within_the_friction_angle_of_a_tested_one(
    seed: int, beta: float, half_width: float, fraction: float
) -> None:
    contacts = grasps.at_angle(batch(1, 1, seed), beta)
    faces = oracles.cone_edges(contacts.normals[0, 0], half_width, 2)
    (tested,) = normals_to_test(contacts, np.zeros((1, 1)), count=3, creases={0: faces[None]})
    between = oracles.turned(faces[0], faces[1], 2.0 * fraction * half_width)
    assert min(oracles.angle(between, normal) for normal in tested[0]) <= beta * (1.0 + 1e-6)


def test_opposite_faces_have_a_bisector() -> None:
    """The two sides of a sheet."""
    contacts = Contacts([[0.0, 0.0, 0.0]], [[0.0, 0.0, 1.0]])
    flat = Contacts(contacts.points[None], contacts.normals[None])
    faces = np.array([[[0.0, 0.0, 1.0], [0.0, 0.0, -1.0]]])
    (tested,) = normals_to_test(flat, np.full((1, 1), 0.1), count=3, creases={0: faces})
    np.testing.assert_allclose(np.linalg.norm(tested, axis=-1), 1.0, rtol=1e-12)
    assert np.abs(tested[0, :, 2]).min() == pytest.approx(0.0, abs=1e-12)


# Known numbers and degenerate cases


@pytest.mark.parametrize(
    ("tilt", "beta", "rings"),
    [
        (0.0, 0.5, 1),
        (0.5, 0.5, 1),
        (1.0, 0.5, 1),  # alpha = 4 beta exactly
        (1.001, 0.5, 2),
        (math.radians(20.0), math.radians(5.7), 2),
        (0.3, 0.1, 2),
        ([0.1, 0.6], [0.5, 0.1], 3),
        ([], [], 1),
        ([0.0, 0.5], [0.0, 0.5], 1),
    ],
)
def test_known_numbers_of_rings(tilt: Any, beta: Any, rings: int) -> None:
    assert rings_needed(tilt, beta) == rings


@pytest.mark.parametrize(
    ("sizes", "accepted"), [([MAX_COMBINATIONS], True), ([2, MAX_COMBINATIONS // 2 + 1], False)]
)
def test_too_many_combinations_are_refused(sizes: list[int], accepted: bool) -> None:
    if accepted:
        check_combinations(sizes)
        return
    with pytest.raises(SettingError, match=r"2 x 1000001 normals make 2e\+06 combinations"):
        check_combinations(sizes)
