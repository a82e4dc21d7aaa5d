"""Results besides the labels: certificates, epsilon over the tilts, and the normals that attain it.

The labels are tested in test_exact.
"""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import (
    Contacts,
    Label,
    Stability,
    classify,
    critical_friction_angle,
    epsilon,
    force_closure,
)
from grasp3d.contact import effective_friction
from grasp3d.errors import ContactError, SettingError
from grasp3d.quality.force_ranges import epsilon_range
from grasp3d.quality.wrenches import EpsilonOptions
from tests.helpers import grasps
from tests.helpers.grasps import with_options
from tests.helpers.random_grasps import random_grasps
from tests.helpers.tilts import adversarial_epsilons, angles, mixed, random_tilts

RIGHT = math.pi / 2.0
RTOL = 1e-3
ROUNDING = 1e-9

seeds = st.integers(0, 100_000)
kinds = st.sampled_from(["total", "per_finger"])
few = settings(max_examples=15, deadline=None)

NUMBERS = ("critical_friction_angle", "margin", "epsilon", "epsilon_min", "epsilon_max")


# Certificates, verified by linear algebra


@pytest.mark.parametrize("fingers", [2, 3, 4])
def test_forces_inside_the_cones_of_every_tilt_prove_an_s(fingers: int) -> None:
    contacts, resolution = mixed(fingers, 100, 1)
    found = classify(contacts, resolution)
    stable = found.label == Label.S
    assert stable.sum() > 10
    worst = force_closure(contacts, cone_offset=-resolution / 2.0)
    assert worst.closed[stable].all()
    forces = worst.certificate.equilibrium[stable]
    pushes, points = forces[..., :3], contacts.points[stable]
    assert (np.linalg.norm(pushes, axis=-1) > 0.0).all()
    assert np.abs(pushes.sum(axis=1)).max() <= 1e-8
    assert np.abs(np.cross(points, pushes).sum(axis=1)).max() <= 1e-8
    assert (forces[..., 3] == 0.0).all()
    to_normals = angles(pushes, contacts.normals[stable])
    assert (to_normals < (contacts.friction_angle - resolution / 2.0)[stable]).all()
    # Hence they lie inside the cones at any tilt.
    rng = np.random.default_rng(0)
    for _ in range(10):
        tilted = random_tilts(contacts.normals[stable], (resolution / 2.0)[stable], rng)
        assert (angles(pushes, tilted) < contacts.friction_angle[stable]).all()


@pytest.mark.parametrize("fingers", [2, 3, 4])
def test_a_separating_direction_for_every_tilt_proves_a_u(fingers: int) -> None:
    contacts, resolution = mixed(fingers, 100, 2)
    found = classify(contacts, resolution)
    below = (contacts.friction_angle + resolution / 2.0 < RIGHT).all(axis=1)
    unstable = (found.label == Label.U) & below
    assert unstable.sum() > 5
    best = force_closure(contacts, cone_offset=resolution / 2.0)
    assert not best.closed[unstable].any()
    u = best.certificate.direction[unstable][:, None]
    np.testing.assert_allclose(np.linalg.norm(u, axis=-1), 1.0)
    points, normals = contacts.points[unstable], contacts.normals[unstable]
    velocity = u[..., :3] + np.cross(u[..., 3:], points)
    beta, tilt = contacts.friction_angle[unstable], (resolution / 2.0)[unstable]
    lengths = np.linalg.norm(velocity, axis=-1)
    for normal in (normals, random_tilts(normals, tilt, np.random.default_rng(0))):
        to_normals = angles(velocity, normal)
        assert (lengths * np.cos(np.maximum(to_normals - beta, 0.0)) <= ROUNDING).all()
    assert (
        lengths * np.cos(np.maximum(angles(velocity, normals) - beta - tilt, 0.0)) <= ROUNDING
    ).all()


# Epsilon over all tilts


@pytest.mark.slow
@pytest.mark.parametrize("actuation", ["total", "per_finger"])
@pytest.mark.parametrize(("fingers", "size"), [(2, 35), (3, 35), (4, 40)])
def test_an_adversarial_search_attains_epsilon_min_and_nothing_below(
    fingers: int, size: int, actuation: Any
) -> None:
    contacts, _ = random_grasps(fingers, 3 * size, 4)
    margin = contacts.friction_angle[:, 0] - critical_friction_angle(contacts)
    contacts = grasps.one(contacts, np.flatnonzero(margin > 0.0)[:size])
    rng = np.random.default_rng(fingers)
    tilt = (margin[margin > 0.0][:size] * rng.uniform(0.1, 1.05, size=size))[:, None]
    fine = 2e-4
    found = classify(contacts, 2.0 * tilt, options=EpsilonOptions(actuation=actuation, rtol=fine))
    expected = epsilon(
        grasps.changed(contacts, friction=effective_friction(contacts.friction, 2.0 * tilt)),
        actuation=actuation, rtol=fine,
    )  # fmt: skip
    assert found.epsilon_min == pytest.approx(expected.lower, rel=fine)
    closed = expected.closed
    assert len(closed) == size
    assert 0.8 < closed.mean() < 1.0
    smallest = np.full(size, math.inf)
    for lower, upper in adversarial_epsilons(contacts, tilt, actuation, rng, rtol=fine):
        assert (upper >= expected.lower * (1.0 - ROUNDING)).all()
        smallest = np.minimum(smallest, lower)
    assert (smallest <= expected.upper * (1.0 + RTOL)).all()
    assert (smallest[~closed] == 0.0).all()


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
    [
        {"edges": 6},
        {"actuation": "per_finger", "torque_scale": 2.0},
        {"edges": 5, "actuation": "per_finger"},
    ],
    ids=str,
)
@pytest.mark.parametrize("torsion", [0.0, 0.2])
def test_epsilons_are_those_of_the_range_over_tilts(
    options: dict[str, Any], torsion: float
) -> None:
    contacts, resolution = mixed(2, 15, 6)
    soft = grasps.changed(contacts, torsion_radius=torsion)
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


# The method extremes


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


def test_creases_affect_epsilon_of_method_extremes() -> None:
    contacts = Contacts([[-1, 0, 0], [1, 0, 0]], [[1, 0, 0], [-1, 0, 0]], 0.8)
    faces = np.array([[math.cos(t), math.sin(t), 0.0] for t in (-0.5, 0.5)])
    options: dict[str, Any] = {"method": "extremes", "extreme_normals": 4}
    plain = classify(contacts, 0.1, **with_options(**options))
    found = classify(contacts, 0.1, creases={0: faces}, **with_options(**options))
    assert found.epsilon_min < plain.epsilon_min
    assert found.epsilon_max == pytest.approx(plain.epsilon_max, rel=RTOL)


# Batches and deferred computations


@pytest.mark.parametrize("method", ["exact", "extremes"])
@pytest.mark.parametrize("fingers", [2, 3])
def test_a_batch_of_any_shape_equals_its_grasps_one_by_one(fingers: int, method: Any) -> None:
    contacts, resolution = mixed(fingers, 6, 10)
    options: dict[str, Any] = {"method": method, "extreme_normals": 3}
    flat = classify(contacts, resolution, **with_options(**options))
    shape = (2, 1, 3)
    shaped = Contacts(
        contacts.points.reshape(*shape, fingers, 3),
        contacts.normals.reshape(*shape, fingers, 3),
        contacts.friction.reshape(*shape, fingers),
    )
    found = classify(shaped, resolution.reshape(*shape, fingers), **with_options(**options))
    assert found.batch == shape
    for name in ("label", *NUMBERS):
        values = getattr(found, name)
        assert values.shape[:3] == shape
        expected = getattr(flat, name).reshape(values.shape)
        np.testing.assert_allclose(values, expected, rtol=1e-6, atol=1e-9)
        assert not values.flags.writeable
    for g in range(6):
        alone = classify(grasps.one(contacts, g), resolution[g], **with_options(**options))
        assert alone.label == flat.label[g]
        for name in ("label", *NUMBERS):
            assert np.shape(getattr(alone, name)) == ()
            # The last digit may differ between a single grasp and a batch.
            value = getattr(alone, name)
            assert value == pytest.approx(getattr(flat, name)[g], rel=1e-6, abs=1e-9)


def test_epsilon_is_computed_only_when_read(monkeypatch: pytest.MonkeyPatch) -> None:
    contacts, resolution = mixed(3, 5, 12)
    found = {
        method: classify(contacts, resolution, method=method, extreme_normals=3)  # type: ignore[arg-type]
        for method in ("exact", "extremes")
    }

    def refuse(*_: Any, **__: Any) -> None:
        raise AssertionError

    for name in ("epsilon_with", "epsilon_range", "extremes"):
        monkeypatch.setattr(f"grasp3d.stability.classification.{name}", refuse)
    for result in found.values():
        assert isinstance(result, Stability)
        assert result.label.shape == (5,)
        with pytest.raises(AssertionError):
            _ = result.epsilon_min


# Settings


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


def test_closed_forms_of_two_opposing_contacts() -> None:
    """Opposite poles of a ball: epsilon in closed form at beta, beta - a and beta + a."""

    def closed_form(angle: float) -> float:
        tangential = math.sqrt(2.0) * math.tan(angle / 2.0)
        return tangential / math.hypot(1.0, tangential)

    found = classify(PAIR, 0.3)
    beta = math.atan(0.5)
    assert found.label == Label.S
    assert found.critical_friction_angle == pytest.approx(0.0, abs=1e-12)
    assert found.epsilon == pytest.approx(closed_form(beta), rel=RTOL)
    assert found.epsilon_min == pytest.approx(closed_form(beta - 0.15), rel=RTOL)
    assert found.epsilon_max == pytest.approx(closed_form(beta + 0.15), rel=RTOL)
