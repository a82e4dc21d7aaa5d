import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from grasp3d import Contacts
from grasp3d.errors import ContactError

POINTS = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]
NORMALS = [[-2.0, 0.0, 0.0], [3.0, 0.0, 4.0]]

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
        with pytest.raises(ValueError, match="read-only"):
            getattr(contacts, name)[...] = 0.0
    with pytest.raises(AttributeError):
        contacts.points = points  # type: ignore[misc]


def test_one_number_applies_to_all_contacts() -> None:
    contacts = Contacts(POINTS, NORMALS)
    assert contacts.friction.tolist() == [0.5, 0.5]
    assert contacts.torsion_radius.tolist() == [0.0, 0.0]
    np.testing.assert_allclose(contacts.friction_angle, math.atan(0.5))
    many = Contacts([[POINTS] * 4] * 3, [[NORMALS] * 4] * 3, [0.3, 0.4], np.full((3, 4, 2), 0.1))
    assert many.friction.shape == many.torsion_radius.shape == (3, 4, 2)
    assert many.friction[2, 3].tolist() == [0.3, 0.4]


def test_leading_axes_are_a_batch() -> None:
    assert Contacts(POINTS, NORMALS).batch == ()
    assert Contacts(POINTS, NORMALS).count == 2
    many = Contacts(np.zeros((4, 5, 3, 3)), np.ones((4, 5, 3, 3)))
    assert many.batch == (4, 5)
    assert many.count == 3
    assert Contacts(np.zeros((0, 3, 3)), np.zeros((0, 3, 3))).batch == (0,)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (([0.0, 0.0, 1.0], [0.0, 0.0, 1.0]), r"points must have shape .*n >= 1; got \(3,\)"),
        ((POINTS, NORMALS[:1]), r"normals must have the shape of points \(2, 3\); got \(1, 3\)"),
        ((POINTS, [[1, 0, 0], [0, 0, 0]]), r"the normal of contact \(1,\) has no direction"),
        ((POINTS, NORMALS, -0.1), "friction must be at least 0; got -0.1"),
        ((POINTS, NORMALS, 0.5, [0.0, -2.0]), "torsion_radius must be at least 0; got -2"),
        ((POINTS, NORMALS, [0.1, 0.2, 0.3]), r"friction must be one number .*\(2,\); got \(3,\)"),
        (([[0, 0, 0], [0, math.nan, 0]], NORMALS), r"points must be finite; nan at \(1, 1\)"),
        (("here", NORMALS), "points must be an array of numbers"),
    ],
)
def test_errors_name_the_invalid_argument(arguments: tuple[Any, ...], message: str) -> None:
    with pytest.raises(ContactError, match=message):
        Contacts(*arguments)


@pytest.mark.parametrize(
    ("groups", "torsion", "message"),
    [
        ([0, 0, 1], 0.0, r"shape \(4,\)"),
        ([0.0, 0.0, 1.0, 1.0], 0.0, "number of each contact's finger"),
        ([0, 0, 2, 2], 0.0, "without a gap"),
        ([0, 0, 1, 1], 0.01, "leave torsion_radius 0"),
    ],
)
def test_groups_number_the_fingers_of_hard_contacts(
    groups: list[float], torsion: float, message: str
) -> None:
    four = np.array([[-1.0, 0, 0], [-1, 1, 0], [1, 0, 0], [1, 1, 0]])
    with pytest.raises(ContactError, match=message):
        Contacts(four, four * [-1, 0, 0], torsion_radius=torsion, groups=groups)


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
    assert grid.reshape((-1,)).batch == (6,)
    assert contacts.take(slice(4, 5)).reshape(()).batch == ()
    for name in ("points", "normals", "friction", "torsion_radius"):
        values = getattr(contacts, name)
        assert np.array_equal(vars(grid)[name].reshape(values.shape), values)
        assert np.array_equal(vars(contacts.take(np.array([5, 0])))[name], values[[5, 0]])
        assert not vars(grid)[name].flags.writeable
