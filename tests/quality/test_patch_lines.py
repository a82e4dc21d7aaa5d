"""The critical friction angle of two patches."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d.arrays import angles_between
from grasp3d.quality.patch_lines import best_line_angles
from tests.helpers import patches
from tests.helpers.patches import Patches

TOLERANCE = 2e-5
NORMALS = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]
BOTH = np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
"""Directions across the normals."""


def beside(extents: tuple[float, float], normals: object = NORMALS, offset: float = 0.6) -> float:
    """The angle of two fingers that push along x, the second one beside the first's line."""
    points = [[[-1.0, 0.0, 0.0], [1.0, offset, 0.0]]]
    axes = np.array(extents)[:, None] * BOTH
    return float(Patches(np.array(points), np.array([normals]), np.array([[axes, axes]])).angles[0])


def oracle(found: Patches, g: int) -> float:
    """The better of squeezing and expanding, by cone programs."""
    first, second = found.normals[g, 0], -found.normals[g, 1]
    return min(
        patches.best_line(found.points[g], sign * first, sign * second, found.axes[g])[0]
        for sign in (1.0, -1.0)
    )


@pytest.mark.parametrize(("seed", "size"), [(0, 0.1), (1, 0.4), (2, 1.5)])
def test_the_best_line_is_that_of_a_cone_program(seed: int, size: float) -> None:
    contacts = patches.random_patches(60, seed, size=size)
    found = contacts.angles
    expected = np.array([oracle(contacts, g) for g in range(60)])
    assert (found < math.pi / 2).sum() > 40
    assert found == pytest.approx(np.minimum(expected, math.pi / 2), abs=TOLERANCE)


def test_no_sampled_line_is_better_and_some_are_nearly_as_good() -> None:
    contacts = patches.random_patches(10, 3)
    found = contacts.angles
    rng = np.random.default_rng(0)
    weights = rng.normal(size=(10, 2, 20_000, 2))  # mostly on the rims
    weights /= np.maximum(np.linalg.norm(weights, axis=-1, keepdims=True), 1.0)
    centres = contacts.points[:, :, None] + weights @ contacts.axes
    lines = centres[:, 1] - centres[:, 0]
    normals = contacts.normals[:, :, None]
    angles = np.maximum(angles_between(normals[:, 0], lines), angles_between(-normals[:, 1], lines))
    assert (angles.min(axis=1) >= found - 1e-9).all()
    assert angles.min(axis=1) == pytest.approx(found, abs=0.02)


@pytest.mark.parametrize(
    ("radius", "expected"),
    [(0.2, math.atan(0.1)), (0.3, 0.0), (0.5, 0.0), (1e-7, math.atan(0.3))],
)
def test_discs_bring_the_line_nearer_by_their_radii(radius: float, expected: float) -> None:
    assert beside((radius, radius)) == pytest.approx(expected, abs=TOLERANCE)


def test_only_the_extent_toward_the_line_helps() -> None:
    assert beside((0.2, 0.0)) == pytest.approx(math.atan(0.1), abs=TOLERANCE)
    assert beside((0.0, 0.2)) == pytest.approx(math.atan(0.3), abs=TOLERANCE)


def test_points_among_the_patches_keep_their_exact_angles() -> None:
    contacts = patches.random_patches(6, 4)
    mixed = contacts._replace(axes=contacts.axes * (np.arange(6) % 2)[:, None, None, None])
    points, found = contacts.point_angles, mixed.angles
    assert np.array_equal(found[::2], points[::2])
    assert (found <= points).all()
    assert (found[1::2] < points[1::2] - 1e-3).all()


@pytest.mark.slow
@settings(deadline=None, max_examples=30)
@given(st.integers(0, 100_000), st.floats(0.0, 1.0))
def test_larger_patches_never_need_more_friction(seed: int, factor: float) -> None:
    contacts = patches.random_patches(4, seed)
    small = contacts._replace(axes=factor * contacts.axes)
    assert (contacts.angles <= small.angles + TOLERANCE).all()


def test_fingers_inside_a_ring_push_apart() -> None:
    outward = [[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
    assert beside((0.2, 0.2), outward) == pytest.approx(math.atan(0.1), abs=TOLERANCE)


def test_where_no_line_helps_the_angle_is_a_right_angle() -> None:
    assert beside((0.1, 0.1), [[1.0, 0.0, 0.0]] * 2, offset=0.0) == math.pi / 2


@pytest.mark.slow
def test_the_worst_tilt_is_away_from_the_best_line() -> None:
    """Fact 1: patches stay and normals tilt by up to a: the angle rises by a, and no more."""
    tilt, rng = 0.2, np.random.default_rng(6)
    contacts = patches.random_patches(12, 6, size=0.15)
    found = contacts.angles
    rows = np.flatnonzero(found < 1.2)
    assert len(rows) > 8
    known = np.full(1, math.pi / 2)
    for g in rows:
        points, normals, axes = contacts.points[g], contacts.normals[g], contacts.axes[g]
        line = min(
            (patches.best_line(points, s * normals[0], -s * normals[1], axes) for s in (1, -1)),
            key=lambda one: one[0],
        )[1]
        sign = np.sign(line @ normals[0])
        toward = np.stack([sign * line, -sign * line])
        across = toward - (toward * normals).sum(axis=1)[:, None] * normals
        across /= np.maximum(np.linalg.norm(across, axis=1), 1e-12)[:, None]
        worst = math.cos(tilt) * normals - math.sin(tilt) * across
        angle = best_line_angles(points[None], worst[None], axes[None], known)[0]
        assert angle == pytest.approx(found[g] + tilt, abs=1e-4)
        for _ in range(10):
            away = np.cross(normals, rng.normal(size=(2, 3)))
            away /= np.linalg.norm(away, axis=1)[:, None]
            turned = math.cos(tilt) * normals + math.sin(tilt) * away
            other = best_line_angles(points[None], turned[None], axes[None], known)[0]
            assert found[g] - tilt - TOLERANCE <= other <= found[g] + tilt + TOLERANCE
