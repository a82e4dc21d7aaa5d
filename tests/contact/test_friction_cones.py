import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp3d.contact.contacts import (
    NEAR_X_AXIS,
    cone_edges,
    effective_friction,
    on_arcs,
    tangents,
    tilted_normals,
    turned,
)
from grasp3d.errors import SettingError

coordinates = st.one_of(st.floats(-1.0, 1.0), st.sampled_from([-1.0, 0.0, 1.0, 1e-12, -1e-300]))
normals = (
    st.tuples(coordinates, coordinates, coordinates)
    .map(np.array)
    .filter(lambda v: bool(np.linalg.norm(v) > 1e-3))
    .map(lambda v: v / np.linalg.norm(v))
)
# Where the reference axis of the tangents changes.
steep_normals = st.tuples(st.sampled_from([-1.0, 1.0]), st.floats(0.0, 2.0 * math.pi)).map(
    lambda t: np.array(
        [
            t[0] * NEAR_X_AXIS,
            math.sqrt(1.0 - NEAR_X_AXIS**2) * math.cos(t[1]),
            math.sqrt(1.0 - NEAR_X_AXIS**2) * math.sin(t[1]),
        ]
    )
)
any_normals = st.one_of(normals, steep_normals)


def angles_to(normal: np.ndarray, vectors: np.ndarray) -> np.ndarray:
    across = np.linalg.norm(np.cross(normal, vectors), axis=-1)
    return np.arctan2(across, vectors @ normal)


@given(any_normals, st.floats(0.0, math.pi / 2.0), st.integers(3, 40), st.floats(-7.0, 7.0))
def test_every_edge_is_a_unit_force_at_the_friction_angle(
    normal: np.ndarray, beta: float, edges: int, phase: float
) -> None:
    forces = cone_edges(normal, beta, edges=edges, phase=phase)
    assert forces.shape == (edges, 3)
    np.testing.assert_allclose(np.linalg.norm(forces, axis=1), 1.0, rtol=1e-14)
    np.testing.assert_allclose(angles_to(normal, forces), beta, atol=1e-14)


@given(any_normals, st.floats(0.01, 1.5), st.integers(3, 40))
def test_edges_are_evenly_spaced_about_the_normal(
    normal: np.ndarray, beta: float, edges: int
) -> None:
    forces = cone_edges(normal, beta, edges=edges)
    steps = np.linalg.norm(forces - np.roll(forces, 1, axis=0), axis=1)
    np.testing.assert_allclose(steps, 2.0 * math.sin(beta) * math.sin(math.pi / edges), rtol=1e-12)
    np.testing.assert_allclose(forces.mean(axis=0), math.cos(beta) * normal, atol=1e-14)


@given(any_normals)
def test_tangents_make_a_right_handed_frame(normal: np.ndarray) -> None:
    first, second = tangents(normal)
    frame = np.stack([normal, first, second])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(frame) > 0.0


@given(st.floats(0.0, 2.0 * math.pi))
def test_contacts_in_the_xy_plane_have_their_first_tangent_along_z(angle: float) -> None:
    first, _ = tangents([math.cos(angle), math.sin(angle), 0.0])
    assert abs(first[2]) == pytest.approx(1.0, abs=1e-15)


@given(any_normals, st.floats(0.1, 1.4), st.integers(3, 20))
def test_the_phase_starts_at_the_first_tangent(normal: np.ndarray, beta: float, edges: int) -> None:
    forces = cone_edges(normal, beta, edges=edges)
    first, second = tangents(normal)
    np.testing.assert_allclose(forces[0], math.cos(beta) * normal + math.sin(beta) * first)
    quarter = cone_edges(normal, beta, edges=edges, phase=math.pi / 2.0)
    np.testing.assert_allclose(
        quarter[0], math.cos(beta) * normal + math.sin(beta) * second, atol=1e-15
    )
    step = cone_edges(normal, beta, edges=edges, phase=2.0 * math.pi / edges)
    np.testing.assert_allclose(step, np.roll(forces, -1, axis=0), atol=1e-14)


def test_each_normal_has_its_own_angle() -> None:
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(5, 4, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    betas = rng.uniform(0.0, 1.5, size=(5, 4))
    forces = cone_edges(directions, betas, edges=6)
    tilted = tilted_normals(directions, betas, count=6, rings=2)
    assert (forces.shape, tilted.shape) == ((5, 4, 6, 3), (5, 4, 13, 3))
    for index in np.ndindex(5, 4):
        alone = cone_edges(directions[index], betas[index], edges=6)
        np.testing.assert_array_equal(forces[index], alone)
        alone = tilted_normals(directions[index], betas[index], count=6, rings=2)
        np.testing.assert_array_equal(tilted[index], alone)


@given(any_normals, st.floats(0.0, math.pi / 2.0), st.integers(3, 20))
def test_extreme_normals_lie_on_the_rim_and_the_given_one_comes_first(
    normal: np.ndarray, tilt: float, count: int
) -> None:
    tilted = tilted_normals(normal, tilt, count=count)
    assert tilted.shape == (count + 1, 3)
    np.testing.assert_array_equal(tilted[0], normal)
    np.testing.assert_allclose(np.linalg.norm(tilted, axis=1), 1.0, rtol=1e-14)
    np.testing.assert_allclose(angles_to(normal, tilted[1:]), tilt, atol=1e-14)


@given(any_normals, st.floats(0.0, 1.5), st.integers(3, 9), st.integers(1, 4))
def test_rings_of_extreme_normals_are_at_even_steps(
    normal: np.ndarray, tilt: float, count: int, rings: int
) -> None:
    tilted = tilted_normals(normal, tilt, count=count, rings=rings)
    assert tilted.shape == (1 + rings * count, 3)
    np.testing.assert_array_equal(tilted[0], normal)
    steps = np.repeat(np.arange(1, rings + 1), count) / rings
    np.testing.assert_allclose(angles_to(normal, tilted[1:]), steps * tilt, atol=1e-14)
    rim = tilted_normals(normal, tilt, count=count)[1:]
    np.testing.assert_allclose(tilted[-count:], rim, atol=1e-15)


@given(any_normals, any_normals, st.floats(0.0, 3.2), st.floats(1e-3, 1e3))
def test_normals_turn_toward_the_goal_and_not_past_it(
    normal: np.ndarray, goal: np.ndarray, tilt: float, length: float
) -> None:
    result = turned(normal[None], length * goal[None], np.array([tilt]))[0]
    gap = angles_to(normal, goal)
    assert np.linalg.norm(result) == pytest.approx(1.0)
    assert angles_to(normal, result) == pytest.approx(min(tilt, gap), abs=1e-9)
    assert angles_to(goal, result) == pytest.approx(max(gap - tilt, 0.0), abs=1e-9)


def test_turning_toward_zero_opposite_equal_and_nan_goals() -> None:
    normals = np.tile([0.0, 0.0, 1.0], (4, 1))
    goals = np.array([[0.0, 0, 0], [0, 0, -2], [0, 0, 3], [math.nan, 0, 0]])
    result = turned(normals, goals, np.full(4, 0.5))
    np.testing.assert_array_equal(result[0], normals[0])
    assert angles_to(normals[1], result[1]) == pytest.approx(0.5)
    np.testing.assert_array_equal(result[2], normals[2])
    assert np.isnan(result[3]).all()


@pytest.mark.slow
@given(any_normals, any_normals, st.integers(1, 9))
def test_points_on_arcs_are_at_even_steps(
    first: np.ndarray, second: np.ndarray, steps: int
) -> None:
    arc = on_arcs(first, second, np.linspace(0.0, 1.0, steps + 1))
    width = angles_to(first, second)
    np.testing.assert_allclose(angles_to(first, arc[0]), 0.0, atol=1e-9)
    np.testing.assert_allclose(angles_to(second, arc[-1]), 0.0, atol=1e-9)
    for one, other in itertools.pairwise(arc):
        assert angles_to(one, other) == pytest.approx(width / steps, abs=1e-9)
    several = on_arcs(np.tile(first, (2, 3, 1)), np.tile(second, (2, 3, 1)), np.array([0.5]))
    assert several.shape == (2, 3, 1, 3)


@given(st.floats(0.0, 10.0), st.floats(0.0, 3.0))
def test_effective_friction_is_the_friction_angle_minus_the_tilt(
    friction: float, resolution: float
) -> None:
    effective = effective_friction(friction, resolution)
    assert 0.0 <= effective <= friction * (1.0 + 1e-14)
    expected = max(math.atan(friction) - resolution / 2.0, 0.0)
    assert math.atan(effective) == pytest.approx(expected, abs=1e-14)


def test_effective_friction_of_many_contacts_at_once() -> None:
    friction, resolution = np.array([[0.2], [1.0]]), np.array([0.0, 0.3, 2.0])
    found = effective_friction(friction, resolution)
    assert found.shape == (2, 3)
    for row, column in np.ndindex(2, 3):
        alone = effective_friction(friction[row, 0], resolution[column])
        assert np.shape(alone) == ()
        assert found[row, column] == alone
    assert effective_friction(1e-6, 1e-6) == pytest.approx(0.5e-6)
    assert effective_friction(10.0, 0.0) == pytest.approx(10.0)


@pytest.mark.parametrize(
    ("friction", "resolution", "message"),
    [
        (-0.1, 0.1, "friction must be finite and at least 0; got -0.1"),
        (math.nan, 0.1, "friction must be finite"),
        (0.5, -0.1, "sensor resolution must be finite and at least 0; got -0.1"),
        (0.5, math.nan, "sensor resolution must be finite"),
    ],
)
def test_effective_friction_refuses_invalid_values(
    friction: Any, resolution: Any, message: str
) -> None:
    with pytest.raises(SettingError, match=message):
        effective_friction(friction, resolution)
