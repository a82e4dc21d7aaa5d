import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp3d import SettingError
from grasp3d.cones import (
    STEEP,
    cone_edges,
    edge_angles,
    effective_friction,
    tangents,
    tilted_normals,
)

coordinates = st.one_of(st.floats(-1.0, 1.0), st.sampled_from([-1.0, 0.0, 1.0, 1e-12, -1e-300]))
normals = (
    st.tuples(coordinates, coordinates, coordinates)
    .map(np.array)
    .filter(lambda v: bool(np.linalg.norm(v) > 1e-3))
    .map(lambda v: v / np.linalg.norm(v))
)
# Where the tangents change over from one axis to the other.
steep_normals = st.tuples(st.sampled_from([-1.0, 1.0]), st.floats(0.0, 2.0 * math.pi)).map(
    lambda t: np.array(
        [
            t[0] * STEEP,
            math.sqrt(1.0 - STEEP**2) * math.cos(t[1]),
            math.sqrt(1.0 - STEEP**2) * math.sin(t[1]),
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
def test_edges_stand_evenly_about_the_normal(normal: np.ndarray, beta: float, edges: int) -> None:
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
def test_contacts_in_the_xy_plane_have_their_first_tangent_along_z(turn: float) -> None:
    first, _ = tangents([math.cos(turn), math.sin(turn), 0.0])
    assert abs(first[2]) == pytest.approx(1.0, abs=1e-15)


@given(any_normals, st.floats(0.1, 1.4), st.integers(3, 20))
def test_phase_counts_from_the_first_tangent(normal: np.ndarray, beta: float, edges: int) -> None:
    forces = cone_edges(normal, beta, edges=edges)
    first, second = tangents(normal)
    np.testing.assert_allclose(forces[0], math.cos(beta) * normal + math.sin(beta) * first)
    quarter = cone_edges(normal, beta, edges=edges, phase=math.pi / 2.0)
    np.testing.assert_allclose(
        quarter[0], math.cos(beta) * normal + math.sin(beta) * second, atol=1e-15
    )
    step = cone_edges(normal, beta, edges=edges, phase=2.0 * math.pi / edges)
    np.testing.assert_allclose(step, np.roll(forces, -1, axis=0), atol=1e-14)


def test_each_contact_has_its_own_angle() -> None:
    rng = np.random.default_rng(0)
    directions = rng.normal(size=(5, 4, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    betas = rng.uniform(0.0, 1.5, size=(5, 4))
    forces = cone_edges(directions, betas, edges=6)
    assert forces.shape == (5, 4, 6, 3)
    for index in np.ndindex(5, 4):
        alone = cone_edges(directions[index], betas[index], edges=6)
        np.testing.assert_array_equal(forces[index], alone)


@given(any_normals, st.floats(0.0, math.pi / 2.0), st.integers(3, 20))
def test_extreme_normals_lie_on_the_rim_and_the_given_one_comes_first(
    normal: np.ndarray, tilt: float, count: int
) -> None:
    tilted = tilted_normals(normal, tilt, count=count)
    assert tilted.shape == (count + 1, 3)
    np.testing.assert_array_equal(tilted[0], normal)
    np.testing.assert_allclose(np.linalg.norm(tilted, axis=1), 1.0, rtol=1e-14)
    np.testing.assert_allclose(angles_to(normal, tilted[1:]), tilt, atol=1e-14)


@given(st.floats(0.0, 10.0), st.floats(0.0, 3.0))
def test_effective_friction_is_what_no_tilt_takes_away(friction: float, resolution: float) -> None:
    effective = effective_friction(friction, resolution)
    assert 0.0 <= effective <= friction * (1.0 + 1e-14)
    left = math.atan(friction) - resolution / 2.0
    assert math.atan(effective) == pytest.approx(max(left, 0.0), abs=1e-14)


def test_known_effective_friction() -> None:
    assert effective_friction(1.0, 0.0) == pytest.approx(1.0)
    assert effective_friction(1.0, math.radians(30.0)) == pytest.approx(1.0 / math.sqrt(3.0))
    assert effective_friction(0.5, 2.0 * math.atan(0.5)) == pytest.approx(0.0, abs=1e-15)
    assert effective_friction(0.2, 3.0) == 0.0


@pytest.mark.parametrize("edges", [-1, 0, 1, 2, 2.9, 8.5, math.nan, math.inf])
def test_fewer_than_three_edges_or_part_of_one_are_refused(edges: Any) -> None:
    with pytest.raises(SettingError, match="at least 3 edges, a whole number; got"):
        edge_angles(edges)
    with pytest.raises(SettingError, match="at least 3 edges"):
        cone_edges([1.0, 0.0, 0.0], 0.3, edges=edges)


@pytest.mark.parametrize("phase", [math.nan, math.inf])
def test_a_phase_is_a_number(phase: float) -> None:
    with pytest.raises(SettingError, match="phase of the edges must be finite; got"):
        edge_angles(8, phase)


def test_two_extreme_normals_are_too_few() -> None:
    with pytest.raises(SettingError, match="at least 3"):
        tilted_normals([1.0, 0.0, 0.0], 0.1, count=2)


def test_whole_numbers_may_come_as_floats() -> None:
    np.testing.assert_allclose(
        edge_angles(4.0),
        [0.0, math.pi / 2.0, math.pi, 1.5 * math.pi],  # type: ignore[arg-type]
    )
