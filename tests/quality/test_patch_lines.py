"""The critical friction angle of two contacts with patches."""

import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import Contacts, Label, classify, epsilon
from grasp3d.arrays import angles_between
from grasp3d.contact import disc
from grasp3d.errors import SettingError
from grasp3d.quality import critical_friction_angle
from grasp3d.quality.patch_lines import best_line_angles
from tests.helpers import patches

TOLERANCE = 2e-5
NORMALS = [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]]


def beside(offset: float, radius: float, **arguments: float) -> Contacts:
    """Two fingers that push toward each other along x, the second one beside the first's line."""
    points = [[-1.0, 0.0, 0.0], [1.0, offset, 0.0]]
    return Contacts(points, NORMALS, patch=disc(NORMALS, radius), **arguments)


def oracle(contacts: Contacts, g: int) -> float:
    """The better of squeezing and expanding, by cone programs."""
    assert contacts.patch is not None
    first, second = contacts.normals[g, 0], -contacts.normals[g, 1]
    return min(
        patches.best_line(contacts.points[g], sign * first, sign * second, contacts.patch[g])[0]
        for sign in (1.0, -1.0)
    )


@pytest.mark.parametrize(("seed", "size"), [(0, 0.1), (1, 0.4), (2, 1.5)])
def test_the_best_line_is_that_of_a_cone_program(seed: int, size: float) -> None:
    contacts = patches.random_patches(60, 2, seed, size=size)
    found = critical_friction_angle(contacts)
    expected = np.array([oracle(contacts, g) for g in range(60)])
    assert (found < math.pi / 2).sum() > 40
    assert found == pytest.approx(np.minimum(expected, math.pi / 2), abs=TOLERANCE)


def test_no_sampled_line_is_better_and_some_are_nearly_as_good() -> None:
    contacts = patches.random_patches(10, 2, 3)
    found = critical_friction_angle(contacts)
    rng = np.random.default_rng(0)
    weights = rng.normal(size=(10, 2, 20_000, 2))  # mostly on the rims
    weights /= np.maximum(np.linalg.norm(weights, axis=-1, keepdims=True), 1.0)
    centres = contacts.points[:, :, None] + weights @ contacts.patch
    lines = centres[:, 1] - centres[:, 0]
    normals = contacts.normals[:, :, None]
    angles = np.maximum(angles_between(normals[:, 0], lines), angles_between(-normals[:, 1], lines))
    assert (angles.min(axis=1) >= found - 1e-9).all()
    assert angles.min(axis=1) == pytest.approx(found, abs=0.02)


@pytest.mark.parametrize(
    ("offset", "radius", "expected"),
    [(0.6, 0.2, math.atan(0.1)), (0.6, 0.3, 0.0), (0.6, 0.5, 0.0), (0.6, 1e-7, math.atan(0.3))],
)
def test_discs_bring_the_line_nearer_by_their_radii(
    offset: float, radius: float, expected: float
) -> None:
    assert critical_friction_angle(beside(offset, radius)) == pytest.approx(expected, abs=TOLERANCE)


def test_only_the_extent_toward_the_line_helps() -> None:
    points = [[-1.0, 0.0, 0.0], [1.0, 0.6, 0.0]]
    for axes, expected in (([0.2, 0.0], math.atan(0.1)), ([0.0, 0.2], math.atan(0.3))):
        patch = [[[0.0, axes[0], 0.0], [0.0, 0.0, axes[1]]]] * 2
        found = critical_friction_angle(Contacts(points, NORMALS, patch=patch))
        assert found == pytest.approx(expected, abs=TOLERANCE)


def test_points_among_the_grasps_keep_their_exact_angles() -> None:
    contacts = patches.random_patches(6, 2, 4)
    assert contacts.patch is not None
    axes = contacts.patch * (np.arange(6) % 2)[:, None, None, None]
    mixed = Contacts(contacts.points, contacts.normals, patch=axes)
    points = critical_friction_angle(contacts.without_patches())
    found = critical_friction_angle(mixed)
    assert np.array_equal(found[::2], critical_friction_angle(mixed.without_patches())[::2])
    assert (found <= points + 1e-12).all()
    assert (found[1::2] < points[1::2] - 1e-3).all()


@pytest.mark.slow
@settings(deadline=None, max_examples=30)
@given(st.integers(0, 100_000), st.floats(0.0, 1.0))
def test_larger_patches_never_need_more_friction(seed: int, factor: float) -> None:
    contacts = patches.random_patches(4, 2, seed)
    small = critical_friction_angle(patches.resized(contacts, factor))
    assert (critical_friction_angle(contacts) <= small + TOLERANCE).all()


def test_fingers_inside_a_ring_push_apart() -> None:
    normals = np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    contacts = Contacts([[-1, 0, 0], [1, 0.6, 0]], normals, patch=disc(normals, 0.2))
    assert critical_friction_angle(contacts) == pytest.approx(math.atan(0.1), abs=TOLERANCE)


def test_where_no_line_helps_the_angle_is_a_right_angle() -> None:
    normals = [[1.0, 0.0, 0.0], [1.0, 0.0, 0.0]]
    contacts = Contacts([[-1, 0, 0], [1, 0, 0]], normals, patch=disc(normals, 0.1))
    assert critical_friction_angle(contacts) == math.pi / 2
    assert classify(contacts, 0.2).label == Label.U
    # Cones wider than a right angle might: nothing is proved.
    assert classify(contacts.with_friction(20.0), 0.4).label == Label.M


@pytest.mark.slow
def test_the_worst_tilt_is_away_from_the_best_line() -> None:
    """Fact 1: patches stay and normals tilt by up to a: the angle rises by a, and no more."""
    tilt, rng = 0.2, np.random.default_rng(6)
    contacts = patches.random_patches(12, 2, 6, size=0.15)
    found = critical_friction_angle(contacts)
    rows = np.flatnonzero(found < 1.2)
    assert len(rows) > 8
    known = np.full(1, math.pi / 2)
    for g in rows:
        points, normals, patch = contacts.points[g], contacts.normals[g], contacts.patch[g]
        line = min(
            (patches.best_line(points, s * normals[0], -s * normals[1], patch) for s in (1, -1)),
            key=lambda one: one[0],
        )[1]
        sign = np.sign(line @ normals[0])
        toward = np.stack([sign * line, -sign * line])
        across = toward - (toward * normals).sum(axis=1)[:, None] * normals
        across /= np.maximum(np.linalg.norm(across, axis=1), 1e-12)[:, None]
        worst = math.cos(tilt) * normals - math.sin(tilt) * across
        angle = best_line_angles(points[None], worst[None], patch[None], known)[0]
        assert angle == pytest.approx(found[g] + tilt, abs=1e-4)
        for _ in range(10):
            away = np.cross(normals, rng.normal(size=(2, 3)))
            away /= np.linalg.norm(away, axis=1)[:, None]
            turned = math.cos(tilt) * normals + math.sin(tilt) * away
            other = best_line_angles(points[None], turned[None], patch[None], known)[0]
            assert found[g] - tilt - TOLERANCE <= other <= found[g] + tilt + TOLERANCE


def test_labels_are_thresholds_on_the_angle() -> None:
    beta, alpha = math.atan(0.5), 0.2
    offsets = 0.4 + 2.0 * np.tan(np.linspace(0.0, beta + alpha, 30))
    points = np.stack([[[-1.0, 0.0, 0.0], [1.0, offset, 0.0]] for offset in offsets])
    normals = np.broadcast_to(NORMALS, points.shape)
    contacts = Contacts(points, normals, 0.5, patch=disc(normals, 0.2))
    found = classify(contacts, alpha)
    angles = np.arctan((offsets - 0.4) / 2.0)
    assert (found.label == Label.S).tolist() == (angles < beta - alpha / 2).tolist()
    assert (found.label == Label.U).tolist() == (angles >= beta + alpha / 2).tolist()
    assert found.margin == pytest.approx(beta - alpha / 2 - angles, abs=TOLERANCE)
    assert (classify(contacts.without_patches(), alpha).label <= found.label).all()
    # Friction that is uncertain: S by the smallest, U by the largest.
    wide = classify(contacts, alpha, friction_interval=(0.4, 0.6))
    assert (wide.label == Label.S).sum() < (found.label == Label.S).sum()
    assert (wide.label == Label.U).sum() < (found.label == Label.U).sum()


def test_worst_normals_attain_the_smallest_epsilon() -> None:
    """In the direction that is hardest to resist the tilted cones reach no farther."""
    contacts = beside(0.6, 0.1, friction=0.35)
    found = classify(contacts, 0.2)
    direction = epsilon(contacts, cone_offset=-0.1).certificate.direction
    tilted = patches.tilted_wrenches(contacts, found.worst_normals, edges=720, corners=360)
    assert (tilted @ direction).max() == pytest.approx(found.epsilon_min, rel=2e-3)
    assert found.epsilon_min < 0.95 * found.epsilon


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"method": "extremes"}, "got method extremes"),
        ({"location_error": 0.1}, "got a location_error"),
        ({"creases": {0: [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0]]}}, "got creases"),
    ],
)
def test_what_labels_do_not_take_is_refused(arguments: dict, message: str) -> None:
    with pytest.raises(SettingError, match=rf"{message}: give contacts\.without_patches"):
        classify(beside(0.1, 0.2), 0.1, **arguments)


def test_three_contacts_and_proofs_of_patches_are_refused() -> None:
    three = patches.random_patches(1, 3, 7)
    with pytest.raises(SettingError, match="critical friction angle of 3 contacts is that of poin"):
        critical_friction_angle(three)
    with pytest.raises(SettingError, match="got 3 contacts"):
        classify(three, 0.1)
    found = classify(beside(0.1, 0.2), 0.1)
    for name in ("worst", "best", "best_normals"):
        with pytest.raises(SettingError, match="known of point contacts only"):
            getattr(found, name)
