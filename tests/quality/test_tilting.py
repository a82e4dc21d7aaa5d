"""Tests of `epsilon_range`: random tilts stay within it, and closed forms."""

import math
from typing import Any

import numpy as np
import pytest

from grasp3d import Contacts, epsilon, force_closure
from grasp3d.errors import SettingError
from grasp3d.quality import force_ranges
from grasp3d.quality.force_ranges import epsilon_range
from grasp3d.quality.wrenches import EpsilonOptions
from grasp3d.system.context import running
from tests.helpers import oracles
from tests.helpers.grasps import changed, with_options
from tests.helpers.tilts import random_tilts, with_normals

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


def tilted(contacts: Contacts, tilt: float, rng: np.random.Generator) -> Contacts:
    normals = [
        [oracles.tilted(n, tilt, rng) for n in grasp]
        for grasp in contacts.normals.reshape(-1, contacts.count, 3)
    ]
    return Contacts(contacts.points, normals, contacts.friction, contacts.torsion_radius)


def opposite_poles(**properties: Any) -> Contacts:
    """Two fingers at the ends of a diameter of the unit ball."""
    return Contacts([[0, 0, -1], [0, 0, 1]], [[0, 0, 1], [0, 0, -1]], **properties)


SETTINGS = [
    {},
    {"edges": 6},
    {"actuation": "per_finger"},
    {"torsion_radius": 0.1},
    {"torsion_radius": 0.1, "actuation": "per_finger"},
    {"torsion_radius": 0.1, "edges": 6},
]


@pytest.mark.parametrize("actuation", ["total", "per_finger"])
@pytest.mark.parametrize("fingers", [2, 3])
def test_no_tilt_of_hard_fingers_is_below_the_minimum_and_one_attains_it(
    fingers: int, actuation: Any
) -> None:
    tilt = 0.15
    contacts = grasps(30, fingers)
    found = epsilon_range(contacts, tilt, options=EpsilonOptions(rtol=RTOL, actuation=actuation))
    rng = np.random.default_rng(2)
    for _ in range(10):
        other = epsilon(tilted(contacts, tilt, rng), rtol=RTOL, actuation=actuation)
        assert (other.upper >= found.minimum).all()
    narrow = epsilon(contacts, cone_offset=-tilt, rtol=RTOL, actuation=actuation)
    u = narrow.certificate.direction
    velocity = u[:, None, :3] + np.cross(u[:, None, 3:], contacts.points)
    worst = Contacts(contacts.points, turned_away(contacts.normals, velocity, tilt))
    attained = epsilon(worst, rtol=RTOL, actuation=actuation)
    assert (attained.lower <= narrow.upper + 1e-12).all()


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


@pytest.mark.parametrize("torsion", [0.0, 0.1])
def test_one_tilt_for_all_equals_an_array_of_equal_tilts(torsion: float) -> None:
    contacts = grasps(12, torsion_radius=torsion)
    one = epsilon_range(contacts, 0.2, COARSE)
    for tilt in (np.full(2, 0.2), np.full((12, 2), 0.2), np.full((12, 1), 0.2)):
        many = epsilon_range(contacts, tilt, COARSE)
        for name in ("nominal", "minimum", "maximum"):
            np.testing.assert_array_equal(getattr(many, name), getattr(one, name))


@pytest.mark.parametrize("torsion", [0.0, 0.1])
def test_each_grasp_of_a_batch_has_its_own_tilts(
    torsion: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    contacts = grasps(6, torsion_radius=torsion)
    tilt = np.random.default_rng(0).uniform(0.0, 0.4, size=(6, 2))
    tilt[2] = 0.0
    monkeypatch.setattr(force_ranges, "TILTED_AT_ONCE", 4)
    whole = epsilon_range(contacts, tilt, FINE)
    for b in range(6):
        alone = Contacts(contacts.points[b], contacts.normals[b], 0.5, torsion)
        one = epsilon_range(alone, tilt[b], FINE)
        for name in ("nominal", "minimum", "maximum"):
            assert getattr(one, name) == pytest.approx(getattr(whole, name)[b], rel=1e-9)


@pytest.mark.parametrize("fingers", [2, 3, 4])
def test_soft_fingers_have_at_least_the_epsilon_of_hard_ones(fingers: int) -> None:
    """Of three and more; two hard ones resist no torque about their line."""
    soft, tilt = grasps(10, fingers, torsion_radius=0.1), 0.15
    hard = epsilon_range(changed(soft, torsion_radius=0.0), tilt, FINE)
    found = epsilon_range(soft, tilt, FINE)
    if fingers > 2:
        assert (found.minimum >= (1.0 - FINE_RTOL) * hard.minimum).all()
    assert (found.minimum > 0.0).any()
    assert (found.maximum <= hard.maximum + 0.1 + 1e-12).all()
    tilts = np.array([[tilt] * fingers] * 9 + [[0.0] * fingers])
    with_known = epsilon_range(soft, tilts, FINE)
    assert with_known.minimum[-1] == with_known.nominal[-1]


@pytest.mark.parametrize("actuation", ["total", "per_finger"])
def test_no_tilt_of_the_points_of_soft_fingers_is_below_the_minimum(actuation: Any) -> None:
    """However each normal tilts, and the limit surfaces at the given normals are not either."""
    tilt, rng = 0.15, np.random.default_rng(4)
    soft = grasps(30, torsion_radius=0.1)
    found = epsilon_range(soft, tilt, options=EpsilonOptions(rtol=RTOL, actuation=actuation))
    points = soft.as_points()
    for _ in range(10):
        normals = random_tilts(points.normals, tilt, rng)
        other = epsilon(with_normals(points, normals), rtol=RTOL, actuation=actuation)
        assert (other.upper >= found.minimum).all()
    narrow = epsilon(points, cone_offset=-tilt, rtol=RTOL, actuation=actuation)
    u = narrow.certificate.direction[:, None]
    away = turned_away(points.normals, u[..., :3] + np.cross(u[..., 3:], points.points), tilt)
    attained = epsilon(with_normals(points, away), rtol=RTOL, actuation=actuation)
    assert (attained.lower <= narrow.upper + 1e-12).all()
    assert (found.minimum <= found.nominal).all()
    assert (found.minimum > 0.5 * found.nominal).any()


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


def test_hard_grasps_in_a_batch_with_soft_ones_keep_their_range() -> None:
    torsion = np.array([[0.1], [0.0], [0.0], [0.1]]) * np.ones(2)
    tilt = np.array([[0.1], [0.1], [0.0], [0.0]])
    batch = grasps(4, seed=3, torsion_radius=torsion)
    whole = epsilon_range(batch, tilt, FINE)
    assert (whole.minimum > 0.0).all()
    for b in range(4):
        one = epsilon_range(batch.take(slice(b, b + 1)), tilt[b : b + 1], FINE)
        for name in ("nominal", "minimum", "maximum"):
            alone, together = getattr(one, name)[0], getattr(whole, name)[b]
            assert together == pytest.approx(alone, rel=2.0 * FINE_RTOL)


def test_a_soft_finger_without_friction_is_no_disc() -> None:
    """Friction times the radius of its points would be its torsion: the minimum is 0."""
    soft = opposite_poles(friction=[0.5, 0.0], torsion_radius=[0.0, 0.1])
    found = epsilon_range(soft, [0.2, 0.0])
    assert found.minimum == 0.0 < found.nominal


def turned_away(normals: np.ndarray, goals: np.ndarray, tilt: float) -> np.ndarray:
    """Unit normals turned by `tilt` away from other vectors."""
    away = (goals * normals).sum(axis=-1, keepdims=True) * normals - goals
    away /= np.linalg.norm(away, axis=-1, keepdims=True)
    result: np.ndarray = math.cos(tilt) * normals + math.sin(tilt) * away
    return result


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


def test_polygons_approach_their_cones_from_below() -> None:
    """However many edges, they do not contain the cap between the rim and the unit ball."""
    contacts = grasps(30)
    circular = epsilon_range(contacts, 0.15, FINE)
    before = np.zeros(30)
    for edges in (4, 8, 64):
        found = epsilon_range(contacts, 0.15, options=EpsilonOptions(edges=edges, rtol=FINE_RTOL))
        assert (found.nominal <= (1.0 + 2.0 * FINE_RTOL) * circular.nominal).all()
        assert (found.nominal >= before).all()
        assert np.array_equal(found.maximum, circular.maximum)
        before = found.nominal
    assert (found.nominal >= 0.9 * circular.nominal).all()
    assert found.minimum == pytest.approx(circular.minimum, abs=5e-3)


@pytest.mark.parametrize("torsion", [0.0, 0.1])
def test_chunks_threads_and_batch_axes_do_not_change_results(
    torsion: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    contacts = grasps(12, torsion_radius=torsion)
    whole = epsilon_range(contacts, 0.2, COARSE)
    monkeypatch.setattr(force_ranges, "TILTED_AT_ONCE", 5)
    fractions: list[float] = []
    shaped = Contacts(
        contacts.points.reshape(3, 4, 2, 3), contacts.normals.reshape(3, 4, 2, 3), 0.5, torsion
    )
    with running(threads=2, progress=fractions.append):
        chunked = epsilon_range(shaped, 0.2, COARSE)
    assert fractions == sorted(fractions)
    assert fractions[-1] == 1.0
    for name in ("nominal", "minimum", "maximum"):
        np.testing.assert_allclose(getattr(chunked, name).ravel(), getattr(whole, name), rtol=1e-9)
        assert getattr(chunked, name).shape == (3, 4)


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
