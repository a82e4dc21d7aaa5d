"""Epsilon over the tilts, and labels of any numbers of contacts; others are in test_exact."""

import math
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import Contacts, Label, classify, critical_friction_angle
from grasp3d.arrays import Floats, unit_rows
from grasp3d.errors import ContactError, SettingError
from grasp3d.quality.force_ranges import epsilon_range
from grasp3d.quality.wrenches import EpsilonOptions
from grasp3d.settings import MAX_FINGERS
from grasp3d.stability.classification import ContactSets, label_sets
from tests.helpers import grasps
from tests.helpers.grasps import with_options
from tests.helpers.tilts import mixed

RIGHT = math.pi / 2.0
RTOL = 1e-3
ROUNDING = 1e-9

seeds = st.integers(0, 100_000)
kinds = st.sampled_from(["total", "per_finger"])
few = settings(max_examples=15, deadline=None)

NUMBERS = ("critical_friction_angle", "margin", "epsilon", "epsilon_min", "epsilon_max")


@given(st.integers(2, 4), seeds, kinds)
@few
def test_epsilons_are_ordered_and_consistent_with_labels(
    fingers: int, seed: int, kind: Any
) -> None:
    contacts, resolution = mixed(fingers, 20, seed)
    found = classify(contacts, resolution, options=EpsilonOptions(actuation=kind))
    assert (found.epsilon_min <= found.epsilon).all()
    assert (found.epsilon <= found.epsilon_max).all()
    np.testing.assert_array_equal(found.epsilon_min > 0.0, found.label == Label.S)
    below = (contacts.friction_angle + resolution / 2.0 < RIGHT).all(axis=1)
    assert (found.epsilon_max[(found.label == Label.U) & below] <= 1e-9).all()


@pytest.mark.parametrize(
    "options",
    [{"actuation": "per_finger", "torque_scale": 2.0}, {"edges": 5, "actuation": "per_finger"}],
    ids=str,
)
def test_epsilons_are_those_of_the_range_over_tilts(options: dict[str, Any]) -> None:
    contacts, resolution = mixed(2, 15, 6)
    soft = grasps.changed(contacts, torsion_radius=0.2)
    found = classify(soft, resolution, **with_options(**options))
    expected = epsilon_range(soft, resolution / 2.0, **with_options(**options))
    assert found.epsilon == pytest.approx(expected.nominal, rel=ROUNDING)
    assert found.epsilon_min == pytest.approx(expected.minimum, rel=ROUNDING)
    assert found.epsilon_max == pytest.approx(expected.maximum, rel=ROUNDING)


@pytest.mark.slow
@pytest.mark.parametrize("fingers", [2, 3])
@pytest.mark.parametrize("method", ["exact", "extremes"])
def test_the_smallest_friction_decides_s_and_epsilon_min_and_the_largest_the_others(
    fingers: int, method: Any
) -> None:
    contacts, resolution = mixed(fingers, 60, 5)
    low, high = 0.8 * contacts.friction, 1.4 * contacts.friction
    options: dict[str, Any] = {"method": method, "extreme_normals": 4}
    found = classify(contacts, resolution, friction_interval=(low, high), **options)
    point = (contacts.friction, contacts.friction)
    plain = classify(contacts, resolution, friction_interval=point, **options)
    below = classify(grasps.changed(contacts, friction=low), resolution, **options)
    above = classify(grasps.changed(contacts, friction=high), resolution, **options)
    np.testing.assert_array_equal(found.label == Label.S, below.label == Label.S)
    np.testing.assert_array_equal(found.label == Label.U, above.label == Label.U)
    assert set(found.label) == {0, 1, 2}
    np.testing.assert_array_equal(plain.label, classify(contacts, resolution, **options).label)
    assert found.epsilon == pytest.approx(plain.epsilon)
    assert found.epsilon_min == pytest.approx(below.epsilon_min, rel=2.0 * RTOL)
    assert found.epsilon_max == pytest.approx(above.epsilon_max, rel=2.0 * RTOL)
    assert (found.epsilon_max > plain.epsilon_max).any()


@pytest.mark.slow
@pytest.mark.parametrize("fingers", [2, 3])
def test_results_of_method_extremes_lie_within_the_exact_range(fingers: int) -> None:
    contacts, resolution = mixed(fingers, 50, 8)
    exact = classify(contacts, resolution)
    found = classify(contacts, resolution, method="extremes", extreme_normals=6)
    assert (found.epsilon_min <= found.epsilon * (1.0 + RTOL)).all()
    assert (found.epsilon <= found.epsilon_max * (1.0 + RTOL)).all()
    assert (found.epsilon_max <= exact.epsilon_max * (1.0 + RTOL) + ROUNDING).all()
    assert (found.epsilon_min >= exact.epsilon_min * (1.0 - RTOL)).all()
    decided = exact.label != Label.M
    np.testing.assert_array_equal(found.label[decided], exact.label[decided])
    np.testing.assert_array_equal(found.epsilon_min > 1e-7, found.label == Label.S)
    np.testing.assert_array_equal(found.epsilon_max > 1e-7, found.label != Label.U)
    assert set(found.label) == {0, 1, 2}


@pytest.mark.parametrize("method", ["exact", "extremes"])
@pytest.mark.parametrize("fingers", [2, 3])
def test_a_batch_of_any_shape_equals_its_grasps_one_by_one(fingers: int, method: Any) -> None:
    contacts, resolution = mixed(fingers, 6, 10)
    options: dict[str, Any] = {"method": method, "extreme_normals": 3}
    found = classify(
        contacts.reshape((2, 1, 3)), resolution.reshape(2, 1, 3, fingers), **with_options(**options)
    )
    assert found.batch == (2, 1, 3)
    for g in range(6):
        alone = classify(grasps.one(contacts, g), resolution[g], **with_options(**options))
        for name in ("label", *NUMBERS):
            value = getattr(found, name)
            assert not value.flags.writeable
            # The last digit may differ between a single grasp and a batch.
            expected = pytest.approx(getattr(alone, name), rel=1e-6, abs=1e-9)
            assert value[0 if g < 3 else 1, 0, g % 3] == expected


def test_epsilon_is_computed_only_when_read(monkeypatch: pytest.MonkeyPatch) -> None:
    contacts, resolution = mixed(3, 5, 12)

    def refuse(*_: Any, **__: Any) -> None:
        raise AssertionError

    for name in ("epsilon_with", "epsilon_range", "extremes"):
        monkeypatch.setattr(f"grasp3d.stability.classification.{name}", refuse)
    found = classify(contacts, resolution)
    assert found.label.shape == (5,)
    with pytest.raises(AssertionError):
        _ = found.epsilon_min


PAIR = Contacts([[-1, 0, 0], [1, 0, 0]], [[1, 0, 0], [-1, 0, 0]])


@pytest.mark.parametrize("method", ["exact", "extremes"])
@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"sensor_resolution": -0.1}, r"sensor resolution must be at least 0 and below pi"),
        ({"sensor_resolution": math.pi}, r"below pi radians; got 3\.14"),
        ({"sensor_resolution": [0.1] * 3}, r"one number or have shape \(2,\); got \(3,\)"),
        ({"location_error": -1.0}, r"location error must be at least 0; got -1"),
        ({"friction_interval": (0.5, 0.4)}, r"friction_interval must be \(smallest, largest\)"),
        ({"friction_interval": (0.6, 0.7)}, r"with the contacts' friction between"),
        ({"extreme_normals": 2}, r"extreme normals must be a whole number of at least 3; got 2"),
        ({"actuation": "both"}, r"no actuation is called 'both'; known: total, per_finger"),
    ],
    ids=str,
)
def test_settings_out_of_range_are_refused_immediately(
    method: Any, options: dict[str, Any], message: str
) -> None:
    arguments = {"sensor_resolution": 0.2, "method": method, **options}
    with pytest.raises(SettingError, match=message):
        classify(PAIR, **with_options(**arguments))


def test_labels_are_those_of_single_points() -> None:
    points = [[-1.0, 0, 0], [-1, 1, 0], [1, 0, 0], [1, 1, 0]]
    normals = [[1.0, 0, 0], [1, 0, 0], [-1, 0, 0], [-1, 0, 0]]
    with pytest.raises(ContactError, match="single points"):
        classify(Contacts(points, normals, groups=[0, 0, 1, 1]), 0.1)


class Sets(NamedTuple):
    """Random grasps, and what is known about their normals."""

    sets: ContactSets
    tilt: Floats
    friction: float

    @property
    def angles(self) -> tuple[float, float]:
        """Friction angles, as `label_sets` takes them."""
        return math.atan(self.friction), math.atan(self.friction)


def random_sets(size: int, seed: int, *, alike: bool = False) -> Sets:
    """Contacts around a ball, 2 to 6 of each grasp."""
    rng = np.random.default_rng(seed)
    row = np.repeat(np.arange(size), rng.integers(2, 7, size=size))
    points = unit_rows(rng.normal(size=(len(row), 3)))
    second = np.flatnonzero(np.diff(row, prepend=-1) > 0) + 1
    points[second] = 0.2 * points[second] - points[second - 1]  # roughly opposite to the first one
    normals = unit_rows(-points + 0.3 * rng.normal(size=points.shape))
    friction = float(rng.uniform(0.4, 1.2))
    tilt = rng.uniform(0.0, 0.6 * math.atan(friction), size=1 if alike else len(row))
    tilt = np.broadcast_to(tilt, len(row)).copy()
    return Sets(ContactSets(size=size, row=row, points=points, normals=normals), tilt, friction)


def of_grasp(one: Sets, grasp: int) -> Contacts:
    mine = one.sets.row == grasp
    return Contacts(one.sets.points[mine], one.sets.normals[mine], one.friction)


def test_critical_angles_are_those_of_the_same_contacts() -> None:
    one = random_sets(60, 1)
    worst, best = one.sets.critical_angles
    assert worst.tolist() == best.tolist()
    for grasp in range(one.sets.size):
        expected = critical_friction_angle(of_grasp(one, grasp))
        assert worst[grasp] == pytest.approx(expected, abs=1e-12)


@pytest.mark.parametrize("alike", [True, False])
def test_labels_are_those_of_grasps(alike: bool) -> None:
    one = random_sets(200, 2, alike=alike)
    found = label_sets(one.sets, one.tilt, one.angles)
    assert len(np.unique(found.label)) == 3
    for grasp in range(one.sets.size):
        other = classify(of_grasp(one, grasp), 2.0 * one.tilt[one.sets.row == grasp])
        assert found.label[grasp] == other.label or abs(found.margin[grasp]) < 2e-3
        assert (found.margin[grasp] > 0.0) == (found.label[grasp] == Label.S)


def test_location_errors_are_those_of_grasps_whose_tilts_are_wider() -> None:
    one = random_sets(100, 4)
    turns = np.random.default_rng(5).uniform(0.0, 0.05, len(one.tilt))
    sets = replace(one.sets, location_error=0.02, turns=turns)
    found = label_sets(sets, one.tilt, one.angles)
    assert (found.label != label_sets(one.sets, one.tilt, one.angles).label).any()
    for grasp in range(sets.size):
        mine = sets.row == grasp
        wide = 2.0 * (one.tilt + turns)[mine]
        other = classify(of_grasp(one, grasp), wide, location_error=0.02)
        assert found.label[grasp] == other.label
        assert found.margin[grasp] == pytest.approx(other.margin, abs=1e-9)


def test_a_contact_that_raises_the_rank_may_make_an_s_ambiguous() -> None:
    """Two fingers hold a bar but for turns about their line, which a third one adds, unsurely."""
    points = np.array([[-1.0, 0, 0], [1, 0, 0], [0, 1, 0]])
    normals = np.array([[1.0, 0, 0], [-1, 0, 0], [0, -1, 0]])
    two = ContactSets(size=1, row=np.zeros(2, int), points=points[:2], normals=normals[:2])
    three = ContactSets(size=1, row=np.zeros(3, int), points=points, normals=normals)
    tilt, angles = np.array([0.1, 0.1, 0.6]), (0.5, 0.5)
    assert label_sets(two, tilt[:2], angles).label.tolist() == [Label.S]
    found = label_sets(three, tilt, angles)
    assert found.label.tolist() == [Label.M]
    assert found.margin[0] < 0.0
    assert (two.rank.tolist(), three.rank.tolist()) == ([5], [6])


def test_few_and_many_contacts_have_no_numbers() -> None:
    counts = np.array([0, 1, 2, MAX_FINGERS + 1])
    row = np.repeat(np.arange(4), counts)
    points = np.random.default_rng(0).normal(size=(len(row), 3))
    normals = -points / np.linalg.norm(points, axis=1, keepdims=True)
    sets = ContactSets(size=4, row=row, points=points, normals=normals)
    found = label_sets(sets, np.full(len(row), 0.1), (0.5, 0.5))
    assert found.label[[0, 1, 3]].tolist() == [Label.U, Label.U, Label.M]
    assert np.isnan(sets.critical_angles[0]).tolist() == [True, True, False, True]
    assert np.isnan(found.margin).tolist() == [True, True, False, True]
