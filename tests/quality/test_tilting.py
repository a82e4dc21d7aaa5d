"""Epsilon over tilts and friction: no tilt leaves its range, and closed forms."""

import math
from typing import Any

import numpy as np
import pytest

from grasp3d import Contacts, epsilon, force_closure
from grasp3d.errors import SettingError
from grasp3d.quality import force_ranges
from grasp3d.quality.force_ranges import epsilon_range, uncertain_epsilon_range
from grasp3d.quality.wrenches import Actuation, EpsilonOptions
from grasp3d.system.context import running
from tests.helpers.grasps import changed, with_options
from tests.helpers.tilts import random_tilts, turned_away, with_normals

RTOL = 1e-2
BETA = math.atan(0.5)
FINE_RTOL = 1e-3
COARSE, FINE = EpsilonOptions(rtol=RTOL), EpsilonOptions(rtol=FINE_RTOL)


def grasps(count: int, fingers: int = 2, seed: int = 0, **properties: Any) -> Contacts:
    """Mostly force-closed grasps of a sphere off the centre of mass, with inexact normals."""
    rng = np.random.default_rng(seed)
    points = rng.normal(size=(count, fingers, 3))
    if fingers == 2:
        points[:, 1] = 0.3 * rng.normal(size=(count, 3)) - points[:, 0]
    points /= np.linalg.norm(points, axis=-1, keepdims=True)
    normals = 0.2 * rng.normal(size=points.shape) - points
    return Contacts(points + 0.3 * rng.normal(size=(count, 1, 3)), normals, **properties)


def opposite_poles(**properties: Any) -> Contacts:
    """Two fingers at the ends of a diameter of the unit ball."""
    return Contacts([[0, 0, -1], [0, 0, 1]], [[0, 0, 1], [0, 0, -1]], **properties)


def numbers(found: Any) -> np.ndarray:
    """Nominal, smallest and largest epsilon, in the first axis."""
    return np.stack([found.nominal, found.minimum, found.maximum])


@pytest.mark.parametrize("actuation", ["total", "per_finger"])
@pytest.mark.parametrize(("fingers", "torsion"), [(2, 0.0), (3, 0.0), (2, 0.1)])
def test_no_tilt_is_below_the_minimum_and_one_attains_that_of_points(
    fingers: int, torsion: float, actuation: Actuation
) -> None:
    """Soft fingers press at points whose normals tilt independently of each other."""
    tilt, rng = 0.15, np.random.default_rng(2)
    contacts = grasps(30, fingers, torsion_radius=torsion)
    options = EpsilonOptions(rtol=RTOL, actuation=actuation)
    found = epsilon_range(contacts, tilt, options=options)
    points = contacts.as_points() if torsion else contacts
    for _ in range(10):
        tilted = with_normals(points, random_tilts(points.normals, tilt, rng))
        other = epsilon(tilted, rtol=RTOL, actuation=actuation)
        assert (other.upper >= found.minimum).all()
    narrow = epsilon(points, cone_offset=-tilt, rtol=RTOL, actuation=actuation)
    worst = turned_away(points, narrow.certificate.direction, tilt)
    attained = epsilon(with_normals(points, worst), rtol=RTOL, actuation=actuation)
    assert (attained.lower <= narrow.upper + 1e-12).all()
    sure = found.minimum > 0.0  # of soft fingers 0 unless hard ones are closed at every tilt
    assert sure.any()
    least = np.minimum(narrow.lower, found.nominal)
    assert found.minimum[sure] == pytest.approx(least[sure], rel=RTOL)
    hard = changed(contacts, torsion_radius=0.0)
    twist = torsion if actuation == "total" else fingers * torsion
    widest = epsilon(hard, cone_offset=tilt, rtol=RTOL, actuation=actuation).upper
    assert found.maximum == pytest.approx(widest + twist, rel=1e-12)


SETTINGS = [
    {},
    {"edges": 6, "actuation": "per_finger"},
    {"torsion_radius": 0.1, "actuation": "per_finger"},
    {"torsion_radius": 0.1, "edges": 6},
]


@pytest.mark.slow
@pytest.mark.parametrize("fingers", [2, 3])
@pytest.mark.parametrize("settings", SETTINGS, ids=str)
def test_no_tilt_leaves_the_range_with_a_different_tilt_at_each_contact(
    settings: dict[str, Any], fingers: int
) -> None:
    options = dict(settings)
    rng = np.random.default_rng(3)
    friction = rng.uniform(0.3, 1.0, size=(30, fingers))
    contacts = grasps(
        30, fingers, friction=friction, torsion_radius=options.pop("torsion_radius", 0.0)
    )
    tilt = rng.uniform(0.0, 0.25, size=(30, fingers)) * (rng.random((30, fingers)) < 0.8)
    found = epsilon_range(contacts, tilt, **with_options(rtol=RTOL, **options))
    exact = "edges" not in options
    assert (found.minimum <= found.nominal).all()
    assert (found.nominal <= found.maximum).all()
    points = contacts.as_points()
    each = tilt.repeat(points.count // fingers, axis=1)
    for _ in range(20):
        other = epsilon(
            with_normals(contacts, random_tilts(contacts.normals, tilt, rng)), rtol=RTOL, **options
        )
        assert (other.lower <= found.maximum).all()
        pressed = with_normals(points, random_tilts(points.normals, each, rng))
        least = epsilon(pressed, rtol=RTOL, **options).upper if exact else math.inf
        assert (least >= found.minimum).all()
    assert (found.minimum < found.nominal).any()
    assert (found.minimum > 0.0).any()


@pytest.mark.parametrize("fingers", [2, 3])
def test_a_minimum_above_zero_proves_closure_with_every_tilt_of_limit_surfaces(
    fingers: int,
) -> None:
    """Whatever their size: the points of large pads also resist what no single contact does."""
    tilt, rng = 0.15, np.random.default_rng(5)
    soft = grasps(40, fingers, torsion_radius=0.3)
    found = epsilon_range(soft, tilt, COARSE)
    sure = found.minimum > 0.0
    assert sure.any()
    assert (epsilon(soft.as_points(), cone_offset=-tilt, rtol=RTOL).closed & ~sure).any()
    for _ in range(20):
        tilted = with_normals(soft, random_tilts(soft.normals, tilt, rng))
        assert force_closure(tilted).closed[sure].all()


def test_a_soft_finger_without_friction_is_no_disc() -> None:
    """Friction times the radius of its points would be its torsion: the minimum is 0."""
    soft = opposite_poles(friction=[0.5, 0.0], torsion_radius=[0.0, 0.1])
    found = epsilon_range(soft, [0.2, 0.0])
    assert found.minimum == 0.0 < found.nominal


def test_without_a_tilt_all_three_are_the_same() -> None:
    for torsion in (0.0, 0.1):
        found = epsilon_range(grasps(30, torsion_radius=torsion), 0.0, FINE)
        assert np.array_equal(found.minimum, found.nominal)
        assert found.maximum == pytest.approx(found.nominal, rel=2.0 * FINE_RTOL)


@pytest.mark.parametrize("tilt", [0.1, 0.3, 0.5])
def test_two_fingers_at_opposite_poles_have_a_closed_form(tilt: float) -> None:
    """Total: u = (s, t/2, t/2) in (normal, tangential force, torque) is hardest to resist."""

    def total(angle: float) -> float:
        tangential = math.sqrt(2.0) * math.tan(max(angle, 0.0) / 2.0)
        return tangential / math.hypot(1.0, tangential)

    def per_finger(angle: float) -> float:
        tangential = math.sin(max(angle, 0.0))
        return math.sqrt(2.0) * tangential / math.hypot(1.0, tangential)

    for actuation, value in (("total", total), ("per_finger", per_finger)):
        found = epsilon_range(
            opposite_poles(), tilt, options=EpsilonOptions(actuation=actuation, rtol=RTOL)
        )  # type: ignore[arg-type]
        assert found.nominal == pytest.approx(value(BETA), rel=RTOL)
        assert found.minimum == pytest.approx(value(BETA - tilt), rel=RTOL)
        assert found.maximum == pytest.approx(value(BETA + tilt), rel=RTOL)
        assert found.minimum <= value(BETA - tilt)
        assert found.maximum >= value(BETA + tilt)


def test_the_minimum_is_zero_from_a_tilt_of_the_friction_angle_on() -> None:
    for tilt in (BETA, BETA + 0.1, 1.2):
        assert (epsilon_range(grasps(20), tilt, COARSE).minimum == 0.0).all()


def test_chunks_threads_and_batch_axes_do_not_change_results(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Nor do other grasps of a batch, of which some are hard and some cannot tilt."""
    rng = np.random.default_rng(0)
    torsion = np.where(np.arange(12) % 3, 0.1, 0.0)[:, None] * np.ones(2)
    tilt = rng.uniform(0.0, 0.4, size=(12, 2)) * (np.arange(12) % 4 > 0)[:, None]
    batch = grasps(12, seed=3, torsion_radius=torsion)
    alone = [epsilon_range(batch.take(slice(b, b + 1)), tilt[b : b + 1], FINE) for b in range(12)]
    monkeypatch.setattr(force_ranges, "TILTED_AT_ONCE", 5)
    fractions: list[float] = []
    with running(threads=2, progress=fractions.append):
        found = epsilon_range(batch.reshape((3, 4)), tilt.reshape(3, 4, 2), FINE)
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    expected = np.concatenate([numbers(one) for one in alone], axis=1)
    assert numbers(found).reshape(3, 12) == pytest.approx(expected, rel=2.0 * FINE_RTOL)
    one, many = (epsilon_range(batch, each, FINE) for each in (0.2, np.full((12, 2), 0.2)))
    np.testing.assert_array_equal(numbers(one), numbers(many))


@pytest.mark.slow
@pytest.mark.parametrize("actuation", ["total", "per_finger"])
@pytest.mark.parametrize(("fingers", "torsion"), [(2, 0.0), (2, 0.1), (3, 0.0)])
def test_epsilon_stays_between_the_bounds_where_friction_is_uncertain(
    fingers: int, torsion: float, actuation: Actuation
) -> None:
    contacts, rng = grasps(40, fingers, torsion_radius=torsion), np.random.default_rng(0)
    contacts = contacts.with_friction(0.8)
    options = EpsilonOptions(None, actuation, torque_scale=1.3, rtol=1e-4)
    tilt = 0.05 if torsion == 0.0 else 0.0  # of soft fingers little is known of tilts
    found = uncertain_epsilon_range(contacts, tilt, (0.7, 0.9), options)
    assert (found.minimum > 0.0).mean() > 0.2
    assert (found.minimum <= found.nominal).all()
    assert (found.nominal <= found.maximum * (1.0 + 1e-2)).all()
    for _ in range(15):
        tilted = with_normals(contacts, random_tilts(contacts.normals, tilt, rng))
        moved = tilted.with_friction(rng.uniform(0.7, 0.9, size=contacts.friction.shape))
        true = epsilon(moved, actuation=actuation, torque_scale=1.3, rtol=1e-4)
        assert (true.upper >= found.minimum - 1e-12).all()
        assert (true.lower <= found.maximum + 1e-12).all()


@pytest.mark.parametrize(
    ("tilt", "message"),
    [
        (-0.1, "tilt must be from 0 to below pi/2"),
        (math.nan, "tilt must be finite"),
        ("steep", "tilt must be an array of numbers"),
        ([0.1, 0.2, 0.3], r"tilt must be one number or have shape \(2,\); got \(3,\)"),
    ],
)
def test_tilts_of_a_wrong_type_or_shape_are_refused(tilt: Any, message: str) -> None:
    with pytest.raises(SettingError, match=message):
        epsilon_range(opposite_poles(), tilt)


def test_friction_is_needed_only_where_normals_may_tilt() -> None:
    contacts = opposite_poles(friction=[0.5, 0.0])
    narrower = epsilon(contacts, cone_offset=[-0.2, 0.0])
    assert epsilon_range(contacts, [0.2, 0.0]).minimum == narrower.lower > 0.0
    with pytest.raises(SettingError, match="friction must be above 0 where normals may tilt"):
        epsilon_range(contacts, [0.2, 0.1])
