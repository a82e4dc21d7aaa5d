"""Tests of sets of normals: their corners, the angles to them, and the caps about them."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import Contacts
from grasp3d._kernels.surface.surface_contacts import largest_angle, smallest_angle
from grasp3d.errors import ContactError
from grasp3d.stability.normal_sets import NormalSets, face_normals
from tests.helpers import oracles
from tests.helpers.tilts import angle_to_set, angles, within_sets

few = settings(max_examples=15, deadline=None)
seeds = st.integers(0, 100_000)

PAIR = Contacts([[-1, 0, 0], [1, 0, 0]], [[1, 0, 0], [-1, 0, 0]])
CUBE_CORNER = -np.eye(3)


def angles_to_set(normals: np.ndarray, directions: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """(smallest, largest) angle between directions (b, 3) and convex sets (b, k, 3) [rad]."""
    counts = (normals == normals[:, -1:]).all(axis=2).argmax(axis=1) + 1  # the last may be repeated
    sets = list(zip(normals, counts, directions, strict=True))
    smallest, largest = (
        np.array([angle(rows, 0, count, *direction) for rows, count, direction in sets])
        for angle in (smallest_angle, largest_angle)
    )
    return smallest, largest


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


# Laws


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


@given(st.integers(2, 5), st.floats(0.05, 1.2), seeds)
@few
def test_angles_to_a_set_are_those_of_dense_samples(
    corners: int, half_width: float, seed: int
) -> None:
    faces = batch_of(random_set(corners, half_width, seed))
    rng = np.random.default_rng(seed)
    direction = rng.normal(size=3)
    direction /= np.linalg.norm(direction)
    smallest, largest = angles_to_set(faces, direction[None])
    inside = np.concatenate([faces[0], *(within_sets(faces, rng) for _ in range(999))])
    found = angles(inside, direction)
    assert smallest[0] <= found.min() + 1e-9
    assert largest[0] >= found.max() - 1e-9
    assert smallest[0] == pytest.approx(angle_to_set(faces[0], direction), abs=1e-7)
    opposite = angle_to_set(faces[0], -direction)
    assert largest[0] == pytest.approx(math.pi - opposite, abs=1e-7)


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


# Known sets


def test_normals_inside_the_others_are_omitted_and_the_last_corner_is_repeated() -> None:
    inner = np.array([-1.0, -1.0, -1.0])
    faces = batch_of(np.vstack([CUBE_CORNER, inner]))[0]
    assert faces.shape == (4, 3)
    np.testing.assert_array_equal(faces[3], faces[2])
    found = {tuple(row) for row in faces}
    assert found == {tuple(row) for row in CUBE_CORNER}
    flat = batch_of(np.array([[1.0, 0, 0], [1, 1, 0], [0, 1, 0]]))[0]
    assert {tuple(row) for row in flat} == {(1.0, 0.0, 0.0), (0.0, 1.0, 0.0)}


def test_a_set_of_two_equal_normals_is_smooth() -> None:
    faces = batch_of(np.array([[0.0, 0, 1], [0, 0, 2]]))
    np.testing.assert_array_equal(faces, np.broadcast_to([0.0, 0, 1], (1, 2, 3)))
    smallest, largest = angles_to_set(faces, np.array([[1.0, 0.0, 0.0]]))
    assert smallest[0] == largest[0] == pytest.approx(math.pi / 2.0)


def test_the_corner_of_a_cube() -> None:
    faces = batch_of(CUBE_CORNER)
    diagonal = np.full((1, 3), -1.0) / math.sqrt(3.0)
    smallest, largest = angles_to_set(faces, diagonal)
    assert smallest[0] == 0.0
    assert largest[0] == pytest.approx(math.acos(1.0 / math.sqrt(3.0)))
    corner = NormalSets.of_contacts(PAIR.reshape((1,)), {0: faces})
    assert corner.radii[0, 0] == pytest.approx(math.acos(1.0 / math.sqrt(3.0)))
    smallest, largest = angles_to_set(faces, -diagonal)
    assert largest[0] == pytest.approx(math.pi)
    assert smallest[0] == pytest.approx(math.pi - math.acos(1.0 / math.sqrt(3.0)))


def test_a_batch_may_have_one_set_for_all_or_one_for_each_grasp() -> None:
    many = Contacts(np.tile(PAIR.points, (2, 3, 1, 1)), np.tile(PAIR.normals, (2, 3, 1, 1)))
    faces = face_normals({1: CUBE_CORNER[:2]}, many)
    assert list(faces) == [1]
    assert faces[1].shape == (6, 2, 3)
    own = np.random.default_rng(0).normal(size=(2, 3, 1, 3)) + [[0.0, 0, 5], [0, 3, 5]]
    faces_of_each = face_normals({0: own}, many)[0]
    expected = own / np.linalg.norm(own, axis=-1, keepdims=True)
    found = angles(expected.reshape(6, 2, 1, 3), faces_of_each[:, None]).min(axis=2)
    assert found.max() <= 1e-12
    none = Contacts(np.zeros((0, 2, 3)), np.zeros((0, 2, 3)))
    empty = NormalSets.of_contacts(none, face_normals({1: CUBE_CORNER}, none))
    assert empty.radii.shape == (0, 2)
    assert face_normals({}, many) == {}


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
