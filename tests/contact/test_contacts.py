import itertools
import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from grasp3d import Contacts
from grasp3d.contact.contacts import (
    NEAR_X_AXIS,
    cone_edges,
    effective_friction,
    evenly_pressed_radius,
    on_arcs,
    tangents,
    tilted_normals,
    turned,
)
from grasp3d.errors import ContactError, SettingError

POINTS = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]
NORMALS = [[-2.0, 0.0, 0.0], [3.0, 0.0, 4.0]]
FOUR = np.array([[-1.0, 0, 0], [-1, 1, 0], [1, 0, 0], [1, 1, 0]])
"""Points of two fingers."""

vectors = hnp.arrays(np.float64, (4, 3), elements=st.floats(-1e3, 1e3)).filter(
    lambda v: bool((np.linalg.norm(v, axis=1) > 1e-6).all())
)


@given(vectors, st.floats(1e-3, 1e3))
def test_only_the_direction_of_a_normal_matters(normals: np.ndarray, factor: float) -> None:
    points = np.zeros_like(normals)
    once, again = Contacts(points, normals), Contacts(points, factor * normals)
    np.testing.assert_allclose(np.linalg.norm(once.normals, axis=1), 1.0, rtol=1e-14)
    np.testing.assert_allclose(once.normals, again.normals, atol=1e-14)
    assert (np.einsum("ij,ij->i", once.normals, normals) > 0.0).all()


@pytest.mark.parametrize("length", [5e-324, 1e-300, 1e-170, 1e170, 1e300])
def test_normals_of_any_length_are_normalised(length: float) -> None:
    normals = Contacts(POINTS, [[length, 0.0, 0.0], [0.0, -length, 0.0]]).normals
    assert normals.tolist() == [[1.0, 0.0, 0.0], [0.0, -1.0, 0.0]]


def test_arrays_are_copied_and_read_only() -> None:
    points, normals, friction = np.array(POINTS), np.array(NORMALS), np.array([0.1, 0.2])
    contacts = Contacts(points, normals, friction, 0.01)
    points += 5.0
    normals += 5.0
    friction += 5.0
    assert contacts.points.tolist() == POINTS
    np.testing.assert_allclose(contacts.normals, [[-1.0, 0.0, 0.0], [0.6, 0.0, 0.8]], rtol=1e-15)
    assert contacts.friction.tolist() == [0.1, 0.2]
    for name in ("points", "normals", "friction", "torsion_radius"):
        assert not getattr(contacts, name).flags.writeable


def test_leading_axes_are_a_batch_and_one_number_applies_to_all_contacts() -> None:
    one = Contacts(POINTS, NORMALS)
    assert (one.batch, one.count) == ((), 2)
    assert one.friction.tolist() == [0.5, 0.5]
    assert one.torsion_radius.tolist() == [0.0, 0.0]
    np.testing.assert_allclose(one.friction_angle, math.atan(0.5))
    many = Contacts([[POINTS] * 4] * 3, [[NORMALS] * 4] * 3, [0.3, 0.4], np.full((3, 4, 2), 0.1))
    assert (many.batch, many.count) == ((3, 4), 2)
    assert many.friction[2, 3].tolist() == [0.3, 0.4]
    assert Contacts(np.zeros((0, 3, 3)), np.zeros((0, 3, 3))).batch == (0,)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0.0, 0.0, 1.0], [0.0, 0.0, 1.0]), r"points must have shape .*n >= 1; got \(3,\)"),
        ((POINTS, NORMALS[:1]), r"normals must have the shape of points \(2, 3\); got \(1, 3\)"),
        ((POINTS, [[1, 0, 0], [0, 0, 0]]), r"the normal of contact \(1,\) has length 0"),
        ((POINTS, NORMALS, -0.1), "friction must be at least 0; got -0.1"),
        ((POINTS, NORMALS, 0.5, [0.0, -2.0]), "torsion_radius must be at least 0; got -2"),
        ((POINTS, NORMALS, [0.1, 0.2, 0.3]), r"friction must be one number .*\(2,\); got \(3,\)"),
        (([[0, 0, 0], [0, math.nan, 0]], NORMALS), r"points must be finite; nan at \(1, 1\)"),
        (("here", NORMALS), "points must be an array of numbers"),
        ((FOUR, FOUR, 0.5, 0.0, [0, 0, 1]), r"shape \(4,\)"),
        ((FOUR, FOUR, 0.5, 0.0, [0.0, 0.0, 1.0, 1.0]), "number of each contact's finger"),
        ((FOUR, FOUR, 0.5, 0.0, [0, 0, 2, 2]), "without a gap"),
        ((FOUR, FOUR, 0.5, 0.01, [0, 0, 1, 1]), "leave torsion_radius 0"),
    ],
)
def test_errors_name_the_invalid_argument(arguments: tuple[Any, ...], message: str) -> None:
    with pytest.raises(ContactError, match=message):
        Contacts(*arguments)


def test_soft_fingers_press_at_points_around_their_contacts() -> None:
    contacts = Contacts(POINTS, NORMALS, 0.5, 0.1)
    points = contacts.as_points()
    assert points.groups is not None
    arms = points.points - contacts.points[points.groups]
    assert np.linalg.norm(arms, axis=1) == pytest.approx(0.1 / 0.5)
    assert (arms * points.normals).sum(axis=1) == pytest.approx(0.0, abs=1e-15)
    assert np.bincount(points.groups).tolist() == [8, 8]
    assert not points.torsion_radius.any()


def test_reshape_and_take_keep_all_values_exactly() -> None:
    rng = np.random.default_rng(0)
    normals = rng.normal(size=(6, 3, 3))
    contacts = Contacts(rng.normal(size=(6, 3, 3)), normals, rng.random((6, 3)), rng.random((6, 3)))
    grid = contacts.reshape((2, -1))
    assert (grid.batch, grid.count) == ((2, 3), 3)
    assert contacts.take(slice(4, 5)).reshape(()).batch == ()
    for name in ("points", "normals", "friction", "torsion_radius"):
        values = getattr(contacts, name)
        assert np.array_equal(vars(grid)[name].reshape(values.shape), values)
        assert np.array_equal(vars(contacts.take(np.array([5, 0])))[name], values[[5, 0]])
        assert not vars(grid)[name].flags.writeable


def mean_distance(points: np.ndarray) -> float:
    return float(np.linalg.norm(points - points.mean(axis=0), axis=1).mean())


@pytest.fixture(scope="module")
def grid() -> np.ndarray:
    steps = (np.arange(1200) + 0.5) / 600.0 - 1.0
    return np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [1.0, 0.05])
def test_an_evenly_pressed_ellipse_resists_its_mean_distance(
    grid: np.ndarray, ratio: float
) -> None:
    found = evenly_pressed_radius(np.array([1.0, ratio]), np.array(math.pi * ratio))
    inside = (grid**2).sum(axis=1) < 1.0
    assert found == pytest.approx(mean_distance(grid[inside] * [1.0, ratio]), rel=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [1.0, 0.4, 1e-3])
def test_a_rectangle_resists_a_little_more_than_stated(grid: np.ndarray, ratio: float) -> None:
    found = evenly_pressed_radius(np.array([ratio, 1.0]), np.array(4.0 * ratio))
    exact = mean_distance(grid * [ratio, 1.0])
    assert 0.95 * exact < found < exact


@given(st.floats(1e-3, 1.0), st.floats(1e-3, 2.0))
def test_no_patch_resists_less_than_a_disc_of_its_area(ratio: float, area: float) -> None:
    found = evenly_pressed_radius(np.array([1.0, ratio]), np.array(area))
    assert found >= 2.0 / 3.0 * math.sqrt(area / math.pi) * (1.0 - 1e-12)


def test_points_and_lines_are_patches_too() -> None:
    extents = np.array([[0.0, 0.0], [0.0, 3.0], [2.0, 1e-15]])
    found = evenly_pressed_radius(extents, np.array([0.0, 1e-20, 1e-15]))
    assert found.tolist() == [0.0, 1.5, 1.0]


along = math.sqrt(1.0 - NEAR_X_AXIS**2)


coordinates = st.one_of(st.floats(-1.0, 1.0), st.sampled_from([-1.0, 0.0, 1.0, 1e-12, -1e-300]))
along = math.sqrt(1.0 - NEAR_X_AXIS**2)
any_normals = st.one_of(
    st.tuples(coordinates, coordinates, coordinates),
    # Where the reference axis of the tangents changes.
    st.tuples(st.sampled_from([-1.0, 1.0]), st.floats(0.0, 2.0 * math.pi)).map(
        lambda t: (t[0] * NEAR_X_AXIS, along * math.cos(t[1]), along * math.sin(t[1]))
    ),
).map(np.array).filter(lambda v: bool(np.linalg.norm(v) > 1e-3)).map(
    lambda v: v / np.linalg.norm(v)
)  # fmt: skip


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


@given(any_normals)
def test_tangents_make_a_right_handed_frame(normal: np.ndarray) -> None:
    first, second = tangents(normal)
    frame = np.stack([normal, first, second])
    np.testing.assert_allclose(frame @ frame.T, np.eye(3), atol=1e-14)
    assert np.linalg.det(frame) > 0.0


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


@given(any_normals, st.floats(0.0, math.pi / 2.0), st.integers(3, 9), st.integers(1, 4))
def test_rings_of_extreme_normals_are_at_even_steps(
    normal: np.ndarray, tilt: float, count: int, rings: int
) -> None:
    tilted = tilted_normals(normal, tilt, count=count, rings=rings)
    assert tilted.shape == (1 + rings * count, 3)
    np.testing.assert_array_equal(tilted[0], normal)
    np.testing.assert_allclose(np.linalg.norm(tilted, axis=1), 1.0, rtol=1e-14)
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
    assert np.shape(effective) == ()
    expected = max(math.atan(friction) - resolution / 2.0, 0.0)
    assert math.atan(effective) == pytest.approx(expected, abs=1e-14)


@pytest.mark.parametrize(
    ("friction", "resolution", "message"),
    [
        (-0.1, 0.1, "friction must be finite and at least 0; got -0.1"),
        (0.5, math.nan, "sensor resolution must be finite and at least 0; got nan"),
    ],
)
def test_effective_friction_refuses_invalid_values(
    friction: Any, resolution: Any, message: str
) -> None:
    with pytest.raises(SettingError, match=message):
        effective_friction(friction, resolution)
