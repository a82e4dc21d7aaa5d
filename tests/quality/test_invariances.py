"""Neither the unit, the frame, the order of the contacts nor the batch matters to any quality."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import Contacts, critical_friction_angle, epsilon, force_closure, grip_force
from grasp3d.quality import EpsilonOptions, Weight, epsilon_range, metric_names, metrics
from tests.helpers import grasps, shapes
from tests.helpers.random_grasps import Shape, random_contacts

FINE = 1e-5
OF_AXES = {"grasp_isotropy", "smallest_singular_value"}
"""Measures of the grasp matrix; others depend on where the edges of the pyramids lie."""


class Quality(NamedTuple):
    """A number of a grasp, and what it does not depend on."""

    value: Callable[[Contacts, float], Any]
    """Of contacts, and a unit that torques are divided by."""
    rel: float = 3.0 * FINE
    rounding: float = 1e-6
    turns: bool = True
    """Whether a rotation changes nothing."""
    shifts: bool = False
    """Whether the centre of mass does not matter."""
    kinds: tuple[str, ...] = ("2", "2 soft", "3", "4 soft", "5")


def bounds(contacts: Contacts, unit: float, **options: Any) -> Any:
    return epsilon(contacts, torque_scale=unit, rtol=FINE, **options).upper


def of_range(contacts: Contacts, unit: float) -> Any:
    found = epsilon_range(contacts, 0.2, EpsilonOptions(torque_scale=unit, rtol=FINE))
    return [found.nominal, found.minimum, found.maximum]


def of_metric(name: str) -> Quality:
    def value(contacts: Contacts, unit: float) -> Any:
        return metrics(contacts, name, torque_scale=unit)[name]

    return Quality(
        value,
        rounding=2e-6,
        turns=name in OF_AXES,
        shifts=name == "min_weight",
    )


QUALITIES = {
    "epsilon": Quality(bounds),
    "epsilon per finger": Quality(lambda c, unit: bounds(c, unit, actuation="per_finger")),
    "epsilon of polygons": Quality(lambda c, unit: bounds(c, unit, edges=6), turns=False),
    "closure": Quality(lambda c, _: force_closure(c).closed, shifts=True),
    "rank": Quality(lambda c, _: force_closure(c).rank, shifts=True),
    "critical angle": Quality(
        lambda c, _: critical_friction_angle(c), rounding=2e-4, shifts=True
    ),
    "range over tilts": Quality(of_range, kinds=("2", "3")),
    # The ring of points of a soft finger starts at one of its tangents, which depend on the frame.
    "range of soft fingers": Quality(of_range, turns=False, kinds=("2 soft", "3 soft")),
    "grip force": Quality(lambda c, _: grip_force(c, Weight(1.0)).upper, rel=2e-3),
    **{name: of_metric(name) for name in metric_names()},
}  # fmt: skip


def random_grasp(kind: str, seed: int) -> Contacts:
    """A random grasp off the centre of mass."""
    count, _, detail = kind.partition(" ")
    contacts = random_contacts(Shape(int(count), 8, soft=detail == "soft"), 1, seed).reshape(())
    return grasps.changed(contacts, points=contacts.points + np.array([0.2, -0.1, 0.3]))


@pytest.mark.slow
@pytest.mark.parametrize("name", QUALITIES)
@given(st.data(), st.integers(0, 10_000), st.sampled_from([1e-6, 1e-3, 1.0, 25.4, 1e6]))
@settings(max_examples=40, deadline=None)
def test_another_unit_frame_and_order_change_nothing(
    name: str, data: st.DataObject, seed: int, unit: float
) -> None:
    quality = QUALITIES[name]
    contacts = random_grasp(data.draw(st.sampled_from(quality.kinds)), seed)
    rng = np.random.default_rng(seed)
    turn = shapes.rotation(seed) if quality.turns else np.eye(3)
    shift = 300.0 * rng.normal(size=3) if quality.shifts else np.zeros(3)
    order = rng.permutation(contacts.count)
    other = Contacts(
        unit * (contacts.points @ turn.T + shift)[order], (contacts.normals @ turn.T)[order],
        contacts.friction[order], unit * contacts.torsion_radius[order],
    )  # fmt: skip
    expected = quality.value(contacts, 1.0)
    value = quality.value(other, unit)
    np.testing.assert_allclose(np.asarray(value), expected, rtol=quality.rel, atol=quality.rounding)


@pytest.mark.parametrize("name", QUALITIES)
def test_a_batch_has_the_values_of_its_grasps(name: str) -> None:
    quality = QUALITIES[name]
    for kind in quality.kinds:
        single = [random_grasp(kind, seed) for seed in range(6)]
        batch = grasps.stacked(single)
        together = np.asarray(quality.value(batch.reshape((2, 3)), 1.0))
        assert together.shape[-2:] == (2, 3)
        for k, contacts in enumerate(single):
            alone = quality.value(contacts, 1.0)
            parts = alone if isinstance(alone, list) else [alone]
            assert not any(isinstance(part, np.ndarray) for part in parts)
            np.testing.assert_allclose(
                together[..., k // 3, k % 3], alone, rtol=quality.rel, atol=1e-8
            )
        none = quality.value(batch.take(slice(0, 0)), 1.0)
        assert np.asarray(none).shape[-1] == 0
