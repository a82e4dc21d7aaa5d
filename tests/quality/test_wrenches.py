""""""

import math
from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import Contacts, critical_friction_angle, epsilon, force_closure, grip_force
from grasp3d.contact.contacts import cone_edges
from grasp3d.errors import SettingError
from grasp3d.quality import EpsilonOptions, Weight, epsilon_range, metric_names, metrics
from grasp3d.quality.wrenches import cone_parts, span, wrenches
from tests.helpers import grasps, shapes
from tests.helpers.random_grasps import Shape, random_contacts

seeds = st.integers(0, 100_000)


@given(seeds, st.integers(1, 5), st.integers(3, 12), st.floats(0.01, 100.0), st.floats(-4.0, 4.0))
@settings(max_examples=50, deadline=None)
def test_a_wrench_is_the_force_and_its_torque_divided_by_the_torque_scale(
    seed: int, fingers: int, edges: int, torque_scale: float, phase: float
) -> None:
    contacts = grasps.random_grasp(max(fingers, 2), seed)
    rows = wrenches(contacts, edges=edges, torque_scale=torque_scale, phase=phase)
    forces = cone_edges(contacts.normals, contacts.friction_angle, edges=edges, phase=phase)
    torques = np.cross(contacts.points[:, None], forces) / torque_scale
    expected = np.concatenate([forces, torques], axis=-1).reshape(-1, 6)
    np.testing.assert_allclose(rows, expected, atol=1e-13 * max(1.0, 1.0 / torque_scale))


@given(seeds)
@settings(max_examples=20, deadline=None)
def test_unit_normal_components_lengthen_the_edges(seed: int) -> None:
    contacts = grasps.random_grasp(3, seed)
    by_force = wrenches(contacts, edges=8).reshape(3, 8, 6)
    by_normal = wrenches(contacts, edges=8, bounded="normal").reshape(3, 8, 6)
    lengths = 1.0 / np.cos(contacts.friction_angle)
    np.testing.assert_allclose(by_normal, by_force * lengths[:, None, None], rtol=1e-13, atol=1e-14)
    components = np.einsum("nmk,nk->nm", by_normal[..., :3], contacts.normals)
    np.testing.assert_allclose(components, 1.0, rtol=1e-14)


def test_wrenches_equal_those_of_the_reference() -> None:
    for case in grasps.reference("epsilon.json"):
        rows = wrenches(
            grasps.of_case(case), edges=case["edges"], torque_scale=case["torque_scale"]
        )
        expected = np.concatenate([np.array(rows) for rows in case["wrenches"]])
        assert rows.shape == expected.shape, case["id"]
        np.testing.assert_allclose(rows, expected, rtol=0.0, atol=1e-15, err_msg=str(case["id"]))


def test_soft_fingers_add_torsion_in_both_senses() -> None:
    contacts = Contacts([[0.0, 0.0, -2.0]], [[0.0, 0.0, 1.0]], 0.5, 0.3)
    rows = wrenches(contacts, edges=4, torque_scale=2.0)
    assert rows.shape == (6, 6)
    np.testing.assert_allclose(rows[4], [0, 0, 1, 0, 0, 0.15])
    np.testing.assert_allclose(rows[5], [0, 0, 1, 0, 0, -0.15])
    hard = wrenches(grasps.changed(contacts, torsion_radius=0.0), edges=4, torque_scale=2.0)
    np.testing.assert_array_equal(rows[:4], hard)
    # A hard finger beside a soft one has as many rows.
    mixed = Contacts(grasps.PAIR, -grasps.PAIR, 0.5, [0.1, 0.0])
    of_hard = wrenches(mixed, edges=5).reshape(2, 7, 6)[1]
    np.testing.assert_array_equal(of_hard[5], of_hard[6])


TWO_SOFT = Contacts(grasps.PAIR, -grasps.PAIR, 0.5, 0.1)
RANKS = {
    "one contact": (Contacts([[1.0, 2.0, 3.0]], [[0, 0, 1]]), 3),
    "one soft contact": (Contacts([[1.0, 2.0, 3.0]], [[0, 0, 1]], 0.5, 0.1), 4),
    "all at one point": (Contacts([[1.0, 2.0, 3.0]] * 3, [[0, 0, 1], [0, 1, 0], [1, 1, 1]]), 3),
    "two hard": (grasps.random_grasp(2, 0), 5),
    "two hard, antipodal": (grasps.regular_on_ball("pair"), 5),
    "three on a line": (grasps.LINE, 5),
    "three on a line, equal normals": (grasps.changed(grasps.LINE, normals=[[0, 0, 1.0]] * 3), 5),
    "two soft": (TWO_SOFT, 6),
    "one soft, one hard": (grasps.changed(TWO_SOFT, torsion_radius=[0.1, 0.0]), 6),
    "three": (grasps.random_grasp(3, 0), 6),
    "three at 120 degrees": (grasps.regular_on_ball("triangle"), 6),
    "five": (grasps.random_grasp(5, 0), 6),
}


@pytest.mark.parametrize("unit", [1e-9, 1.0, 1e9])
@pytest.mark.parametrize("name", RANKS)
def test_ranks_of_known_grasps(name: str, unit: float) -> None:
    """Rounding errors add none."""
    contacts, rank = RANKS[name]
    scaled = grasps.changed(
        contacts, points=unit * contacts.points, torsion_radius=unit * contacts.torsion_radius
    )
    for torque_scale in (unit, 1.0):
        basis = span(wrenches(scaled, torque_scale=torque_scale))
        assert len(basis) == rank
        np.testing.assert_allclose(basis @ basis.T, np.eye(rank), atol=1e-12)
    rows, rng = wrenches(contacts), np.random.default_rng(0)
    for noise in [1e-16, 1e-14] * 5:
        assert len(span(rows + noise * rng.normal(size=rows.shape))) == rank


@given(seeds, st.integers(1, 6))
@settings(max_examples=60, deadline=None)
def test_the_basis_spans_the_rows(seed: int, rank: int) -> None:
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(rng.integers(rank, 20), rank)) @ rng.normal(size=(rank, 6))
    basis = span(rows)
    assert len(basis) == np.linalg.matrix_rank(rows, tol=1e-7 * np.abs(rows).max())
    np.testing.assert_allclose(rows @ basis.T @ basis, rows, atol=1e-9 * np.abs(rows).max())


def test_span_of_empty_zero_and_single_rows() -> None:
    assert span(np.zeros((4, 6))).shape == (0, 6)
    assert span(np.zeros((0, 6))).shape == (0, 6)
    only_torque = span([[0, 0, 0, 0, 0, 3.0]])
    np.testing.assert_allclose(np.abs(only_torque), [[0, 0, 0, 0, 0, 1.0]])


def test_a_triple_just_off_a_line_has_the_sixth_dimension() -> None:
    assert len(span(wrenches(grasps.just_off_a_line(1e-6)))) == 6
    assert len(span(wrenches(grasps.just_off_a_line(1e-13)))) == 5


def test_a_flat_cone_has_no_unit_normal_component() -> None:
    with pytest.raises(SettingError, match="friction cones must stay below 90 degrees"):
        cone_parts(np.array([0.3, math.pi / 2.0]), "normal")
    np.testing.assert_allclose(cone_parts(np.array([math.pi / 2.0])), [[0.0, 1.0]], atol=1e-15)


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

    return Quality(value, rounding=2e-6, turns=name in OF_AXES, shifts=name == "min_weight")


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
