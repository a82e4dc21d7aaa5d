"""Patches of contacts: what `Contacts` takes, and the torsion of even pressure."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp3d import Contacts
from grasp3d.contact import disc
from grasp3d.contact.contacts import evenly_pressed_radius
from grasp3d.contact.friction_cones import cone_edges
from grasp3d.errors import ContactError

POINTS = [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
NORMALS = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]
FLAT = [[[0.0, 0.2, 0.0], [0.0, 0.0, 0.1]]] * 2


def mean_distance(inside: np.ndarray, points: np.ndarray) -> float:
    chosen = points[inside]
    return float(np.linalg.norm(chosen - chosen.mean(axis=0), axis=1).mean())


@pytest.fixture(scope="module")
def grid() -> np.ndarray:
    steps = (np.arange(1200) + 0.5) / 600.0 - 1.0
    return np.stack(np.meshgrid(steps, steps), axis=-1).reshape(-1, 2)


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [1.0, 0.5, 0.05])
def test_an_evenly_pressed_ellipse_resists_its_mean_distance(
    grid: np.ndarray, ratio: float
) -> None:
    found = evenly_pressed_radius(np.array([1.0, ratio]), np.array(math.pi * ratio))
    points = grid * [1.0, ratio]
    inside = (grid**2).sum(axis=1) < 1.0
    assert found == pytest.approx(mean_distance(inside, points), rel=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize("ratio", [1.0, 0.4, 0.02, 1e-3])
def test_a_rectangle_resists_a_little_more_than_stated(grid: np.ndarray, ratio: float) -> None:
    found = evenly_pressed_radius(np.array([ratio, 1.0]), np.array(4.0 * ratio))
    exact = mean_distance(np.ones(len(grid), dtype=bool), grid * [ratio, 1.0])
    assert 0.95 * exact < found < exact


@given(st.floats(1e-3, 1.0), st.floats(1e-3, 2.0))
def test_no_patch_resists_less_than_a_disc_of_its_area(ratio: float, area: float) -> None:
    found = evenly_pressed_radius(np.array([1.0, ratio]), np.array(area))
    assert found >= 2.0 / 3.0 * math.sqrt(area / math.pi) * (1.0 - 1e-12)


def test_points_and_lines_are_patches_too() -> None:
    extents = np.array([[0.0, 0.0], [0.0, 3.0], [2.0, 1e-15]])
    found = evenly_pressed_radius(extents, np.array([0.0, 1e-20, 1e-15]))
    assert found.tolist() == [0.0, 1.5, 1.0]


def test_a_disc_has_orthogonal_semi_axes_of_its_radius() -> None:
    normals = np.random.default_rng(0).normal(size=(20, 3))
    axes = disc(normals, 0.3)
    assert np.allclose(axes @ np.swapaxes(axes, 1, 2), 0.09 * np.eye(2), atol=1e-15)
    assert np.allclose((axes * normals[:, None]).sum(axis=-1), 0.0, atol=1e-15)
    with pytest.raises(ContactError, match="radius of a patch"):
        disc(normals, -0.1)


def test_patches_of_size_zero_are_points() -> None:
    assert Contacts(POINTS, NORMALS, patch=np.zeros((2, 2, 3))).patch is None
    mixed = Contacts(POINTS, NORMALS, patch=[FLAT[0], np.zeros((2, 3))])
    assert mixed.patch is not None
    assert not mixed.patch[1].any()


def test_patches_stay_with_their_contacts() -> None:
    contacts = Contacts([POINTS] * 3, [NORMALS] * 3, patch=[FLAT] * 3)
    assert np.array_equal(contacts.take(np.array([2])).patch, [FLAT])
    assert np.array_equal(contacts.reshape((3, 1)).patch, np.array([FLAT] * 3)[:, None])
    assert np.array_equal(contacts.with_friction(0.1).patch, contacts.patch)
    assert contacts.without_patches().patch is None
    half = contacts.of_size(contacts.points / 2.0, np.full(3, 2.0))
    assert np.array_equal(2.0 * half.patch, contacts.patch)
    assert not contacts.patch.flags.writeable


def test_patches_stay_where_they_are_at_other_normals() -> None:
    """A force in the tilted cone presses along the patch's normal by a sure part at least."""
    contacts = Contacts(POINTS, NORMALS, 0.5, 0.1, FLAT)
    normals = contacts.normals @ np.array([[0.8, 0.6, 0.0], [-0.6, 0.8, 0.0], [0.0, 0.0, 1.0]])
    tilted = contacts.with_normals(normals)
    assert np.array_equal(tilted.patch, FLAT)
    assert tilted.rolling_arms == pytest.approx((0.8 - 0.5 * 0.6) * contacts.rolling_arms)
    forces = cone_edges(normals, math.atan(0.5), edges=360)
    along = (forces * contacts.normals[:, None]).sum(axis=-1)
    pressing = (forces * normals[:, None]).sum(axis=-1)
    assert (along / pressing).min() == pytest.approx(0.8 - 0.5 * 0.6, rel=1e-3)
    same = contacts.with_normals(contacts.normals)
    assert same.rolling_arms == pytest.approx(contacts.rolling_arms)
    several = contacts.with_normals(np.stack([normals, contacts.normals]))
    assert several.batch == (2,)
    assert np.array_equal(several.take(slice(0, 1)).reshape(()).rolling_arms, tilted.rolling_arms)


@pytest.mark.parametrize(
    ("patch", "message"),
    [
        (0.1, r"patch must have shape \(2, 2, 3\), two semi-axes for each contact; got \(\)"),
        (FLAT[0], r"patch must have shape \(2, 2, 3\)"),
        ([[[0.2, 0.2, 0.0], [0.0, 0.0, 0.1]]] * 2, r"patch of contact \(0,\) must be orthogonal"),
        ([[[0.0, math.nan, 0.0], [0.0, 0.0, 0.1]]] * 2, "patch must be finite"),
        ([[[0.0, 1e101, 0.0], [0.0, 0.0, 0.1]]] * 2, "patch must not exceed"),
        ("wide", "patch must be an array of numbers"),
    ],
)
def test_bad_patches_are_refused(patch: object, message: str) -> None:
    with pytest.raises(ContactError, match=message):
        Contacts(POINTS, NORMALS, patch=patch)  # type: ignore[arg-type]
