"""Grip force and payload of grasps on surfaces, under a load."""

import math
from dataclasses import replace
from functools import cache

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import (
    GraspModel,
    ObjectMesh,
    ParallelGripper,
    Sampling,
    SurfaceLabels,
    evaluate_grasps,
    grip_force,
    label_surface,
    load_mesh,
)
from grasp3d.errors import SettingError
from grasp3d.quality.grip_forces import Resistance
from grasp3d.quality.loads import Load, TaskText
from grasp3d.quality.tasks import STANDARD_GRAVITY
from grasp3d.settings.units import METRES, Unit
from grasp3d.stability.label import Label
from grasp3d.surface.fields import FORCES, columns_of
from grasp3d.surface.grasp_numbers import surface_load_result
from grasp3d.surface.load_case import FORCE_RTOL, HARD_FINGERS, LoadCase
from grasp3d.surface.vertex_fields import Reason
from tests.helpers import shapes

MASS, FRICTION, TORSION = 0.5, 0.4, 0.003
SOFT = GraspModel(friction=FRICTION, torsion_radius="3mm", sensor_resolution=0.0)
DOWN = Load(mass=MASS, grip_force=40.0, task="weight within 0 of -z")
WEIGHT = MASS * STANDARD_GRAVITY


@cache
def block(unit: Unit = "m", edge: float = 0.02) -> ObjectMesh:
    """A box of 80 x 50 x 30 mm about its centre of mass."""
    size = np.array([0.08, 0.05, 0.03]) / METRES[unit]
    return load_mesh(shapes.box(tuple(size)), unit=unit, max_edge=edge)


@cache
def labels(unit: Unit = "m") -> SurfaceLabels:
    model = replace(SOFT, sensor_resolution=0.2)
    return label_surface(block(unit), model, load=Load(mass=MASS, grip_force=40.0))


def sides(offset: float = 0.0) -> list[list[float]]:
    """Two fingers opposite to each other, beside the centre of mass [m]."""
    return [[offset, 0.025, 0.0], [offset, -0.025, 0.0]]


def force_of(offset: float) -> float:
    """Force that the two fingers need, with gravity across their line (closed form)."""
    return 0.5 * WEIGHT * math.hypot(1.0 / FRICTION, offset / TORSION)


@pytest.mark.parametrize("offset", [0.0, 0.004, 0.02])
def test_opposed_soft_fingers_have_the_closed_form(offset: float) -> None:
    load_result = evaluate_grasps(block(), sides(offset), SOFT, load=DOWN).load_result
    assert load_result is not None
    (force,), (payload,) = load_result.grip_force, load_result.payload
    assert force_of(offset) * (1.0 - 1e-9) <= force <= force_of(offset) / (1.0 - FORCE_RTOL)
    assert payload == pytest.approx(40.0 * MASS / force)
    assert load_result.how == "exact"
    assert load_result.grip_force_largest[0] == force
    assert force * (1.0 - FORCE_RTOL) <= load_result.grip_force_least[0] <= force_of(offset)


def test_forces_grow_with_the_mass_and_payloads_do_not() -> None:
    one, other = (
        evaluate_grasps(block(), sides(0.01), SOFT, load=replace(DOWN, mass=mass)).load_result
        for mass in (MASS, 3.0 * MASS)
    )
    assert one is not None
    assert other is not None
    assert other.grip_force == pytest.approx(3.0 * one.grip_force, rel=FORCE_RTOL)
    assert other.payload == pytest.approx(one.payload, rel=FORCE_RTOL)


def test_density_is_mass_over_volume() -> None:
    density = MASS / (0.08 * 0.05 * 0.03)
    by_density = replace(DOWN, mass=None, density=density)
    for unit in ("m", "mm"):
        case = LoadCase.of(by_density, block(unit), GraspModel())
        assert case.mass == pytest.approx(MASS)


@pytest.mark.slow
@pytest.mark.parametrize("unit", ["mm", "in"])
def test_newtons_and_kilograms_do_not_depend_on_the_unit(unit: Unit) -> None:
    metres, other = labels().load_result, labels(unit).load_result
    assert metres is not None
    assert other is not None
    for name in ("grip_force", "grip_force_largest", "payload"):
        expected, found = getattr(metres, name), getattr(other, name)
        np.testing.assert_array_equal(np.isfinite(found), np.isfinite(expected))
        known = np.isfinite(expected)
        np.testing.assert_allclose(found[known], expected[known], rtol=2.0 * FORCE_RTOL)


@settings(max_examples=40, deadline=None)
@given(low=st.floats(0.1, 500.0), more=st.floats(0.0, 500.0))
def test_more_force_never_makes_a_label_worse(low: float, more: float) -> None:
    load_result = labels().load_result
    assert load_result is not None

    def codes(force: float) -> np.ndarray:
        label = replace(load_result, case=replace(load_result.case, available=force)).label
        assert label is not None
        return label

    assert (codes(low + more) >= codes(low)).all()
    held = load_result.grip_force_largest <= low
    np.testing.assert_array_equal(codes(low) == Label.S, held)
    assert (load_result.grip_force_least[codes(low) == Label.M] <= low).all()


def test_forces_are_ordered_and_contain_the_nominal_one() -> None:
    load_result = labels().load_result
    assert load_result is not None
    assert load_result.how == "bound"
    assert (load_result.grip_force_least <= load_result.grip_force).all()
    assert (load_result.grip_force <= load_result.grip_force_largest).all()


def test_hard_fingers_off_the_line_hold_nothing_and_the_remedy_is_named() -> None:
    hard = replace(SOFT, torsion_radius=0.0)
    load_result = evaluate_grasps(block(), sides(0.01), hard, load=DOWN).load_result
    assert load_result is not None
    assert load_result.grip_force[0] == load_result.grip_force_largest[0] == math.inf
    assert load_result.resistance[0] == Resistance.NO_SUCH_WRENCH
    assert (load_result.payload[0], load_result.remedy) == (0.0, HARD_FINGERS)
    assert load_result.label is not None
    assert load_result.label[0] == Label.U
    soft = evaluate_grasps(block(), sides(0.01), SOFT, load=DOWN).load_result
    assert soft is not None
    assert soft.remedy == ""
    on_line = evaluate_grasps(block(), sides(), hard, load=DOWN).load_result
    assert on_line is not None
    assert on_line.remedy == ""
    assert on_line.grip_force[0] == pytest.approx(force_of(0.0), rel=FORCE_RTOL)


def test_a_gripper_brings_force_and_torsion() -> None:
    franka = ParallelGripper.preset("franka")
    case = LoadCase.of(Load(mass=MASS), block("mm"), GraspModel(), franka)
    assert case.available == franka.max_force == 70.0
    radius = math.sqrt(franka.pad_width * franka.pad_height / math.pi)
    assert case.torsion_radius == pytest.approx(2.0 / 3.0 * 0.5 * radius)
    given_both = Load(mass=MASS, grip_force="20N")
    case = LoadCase.of(given_both, block("mm"), GraspModel(torsion_radius="1.5mm"), franka)
    assert (case.available, case.torsion_radius) == (20.0, 0.0015)
    assert LoadCase.of(Load(), block(), GraspModel()).available is None


def test_a_label_needs_a_force_and_a_mass_that_matters() -> None:
    pushes = TaskText.of("wrench 0,0,-5,0,0,0")
    for load, columns in (
        (Load(mass=MASS), 3),
        (Load(grip_force=40.0), 4),
        (Load(mass=MASS, grip_force=40.0), 5),
        (Load(task=pushes), 3),
        (Load(task=pushes, grip_force=40.0), 4),
    ):
        found = columns_of(FORCES, evaluate_grasps(block(), sides(), SOFT, load=load))
        assert len(found) == columns
        assert ("payload" in found) == (load.grip_force is not None and load.task != pushes)


def test_per_kilogram_without_a_mass() -> None:
    unknown = evaluate_grasps(block(), sides(), SOFT, load=replace(DOWN, mass=None)).load_result
    assert unknown is not None
    assert unknown.mass is None
    assert unknown.label is None
    assert unknown.grip_force[0] == pytest.approx(force_of(0.0) / MASS, rel=FORCE_RTOL)


def test_payload_of_a_weight_and_a_push() -> None:
    """The push takes its part of the force, whatever the mass is."""
    load = replace(DOWN, task="weight within 0 of -z + wrench 0,0,-5,0,0,0")
    load_result = evaluate_grasps(block(), sides(), SOFT, load=load).load_result
    assert load_result is not None
    held = (40.0 * 2.0 * FRICTION - 5.0) / STANDARD_GRAVITY
    assert load_result.payload[0] == pytest.approx(held, rel=2.0 * FORCE_RTOL)
    weak = evaluate_grasps(block(), sides(), SOFT, load=replace(load, grip_force=5.0)).load_result
    assert weak is not None
    assert weak.payload[0] == 0.0


def test_on_creases_every_normal_of_the_set_counts() -> None:
    model = replace(SOFT, sensor_resolution=0.1)
    points = [[[0.0, 0.025, 0.015], [0.0, -0.025, 0.015]], sides(0.0)]
    grasps = evaluate_grasps(block(), points, model, load=DOWN)
    tilts = grasps.contacts.tilts(model)
    assert tilts == pytest.approx(np.array([[math.pi / 4.0 + 0.05] * 2, [0.05] * 2]))
    assert grasps.load_result is not None
    assert grasps.load_result.label is not None
    assert grasps.load_result.label[0] != Label.S
    assert grasps.load_result.label[1] == Label.S


def test_creases_whose_label_is_m_are_not_surely_unheld() -> None:
    """The nominal normals of edges resist nothing there, but those of the faces do."""
    load = Load(mass=MASS, grip_force=40.0)
    found = label_surface(block("m"), replace(SOFT, sensor_resolution=1.0), load=load)
    load_result, on_edge = found.load_result, block("m").contact_normals.counts == 2
    ambiguous = on_edge & (found.label == Label.M)
    assert load_result is not None
    assert load_result.label is not None
    assert np.isinf(load_result.grip_force[ambiguous]).any()
    assert (load_result.label[ambiguous] == Label.M).all()


def test_vertices_without_a_grasp_are_u_and_nan() -> None:
    load, narrow = Load(mass=MASS, grip_force=40.0), Sampling(max_opening="40mm")
    found = label_surface(block(), SOFT, sampling=narrow, load=load)
    none = found.reason != Reason.FOUND
    load_result = found.load_result
    assert none.any()
    assert load_result is not None
    assert np.isnan(load_result.grip_force[none]).all()
    assert np.isnan(load_result.payload[none]).all()
    assert load_result.label is not None
    assert (load_result.label[none] == Label.U).all()
    assert not np.isnan(load_result.grip_force[~none]).any()


def test_where_normals_cancel_out_nothing_is_known() -> None:
    grasps = evaluate_grasps(block(), sides(), SOFT).contacts
    vars(grasps)["sets"] = grasps.sets._replace(middles=np.zeros((1, 2, 3)))
    case = LoadCase.of(Load(mass=MASS, grip_force=40.0), block(), SOFT)
    load_result = surface_load_result(grasps, SOFT, case)
    assert math.isnan(load_result.grip_force[0])
    assert load_result.label is not None
    assert load_result.label[0] == Label.M
    assert load_result.payload[0] == 0.0


def test_labels_stay_the_same_and_relabelling_keeps_the_load() -> None:
    plain = label_surface(block(), labels().model)
    np.testing.assert_array_equal(plain.label, labels().label)
    assert plain.load_result is None
    assert plain.load is None
    slippery = labels().relabel(friction=0.36)
    assert slippery.load == labels().load
    one, other = slippery.load_result, labels().load_result
    assert one is not None
    assert other is not None
    known = np.isfinite(one.grip_force)
    assert (other.grip_force[known] <= one.grip_force[known] * (1.0 + FORCE_RTOL)).all()


def test_the_nominal_force_is_that_of_the_contacts() -> None:
    found, case = labels(), labels().load_case
    assert case is not None
    assert found.load_result is not None
    for vertex in (0, 40, 145):
        points = [block().vertices[vertex], found.partners[vertex, 0]]
        contacts = evaluate_grasps(block(), points, found.model).contacts.contacts(found.model)
        force = grip_force(contacts, case.task, rtol=1e-4)
        value = found.load_result.grip_force[vertex]
        assert value == pytest.approx(force.value[0], rel=FORCE_RTOL)


@pytest.mark.slow
def test_three_fingers_hold_with_hard_contacts() -> None:
    ball = load_mesh(shapes.sphere(2), unit="cm", max_edge="0.5cm")
    model = GraspModel(fingers=3, sensor_resolution=0.1)
    found = label_surface(ball, model, load=Load(mass=MASS, grip_force=40.0)).load_result
    assert found is not None
    assert found.how == "bound"
    assert found.remedy == ""
    assert np.isfinite(found.grip_force_largest).any()


def test_a_load_that_cannot_be_meant_is_refused_before_the_search() -> None:
    open_box = shapes.box((0.08, 0.05, 0.03))
    open_mesh = load_mesh((open_box[0], open_box[1][2:]), unit="m", repair="none")
    with pytest.raises(SettingError, match="centre of mass"):
        label_surface(open_mesh, load=Load(mass=MASS))
    unitless = load_mesh(open_box, max_edge=0.1)
    with pytest.raises(SettingError, match="unit"):
        label_surface(unitless, load=Load(task="wrench 0,0,0,0,0,1"))
    assert label_surface(unitless, load=Load(mass=MASS)).load is not None


def test_weight_in_any_direction_is_held_only_as_surely_as_points_close() -> None:
    anywhere = labels()
    held = anywhere.load_result
    assert held is not None
    assert held.label is not None
    assert (anywhere.letter == np.minimum(held.label, anywhere.label)).all()
    assert (held.label > anywhere.label).any()  # by torsion, or not known
    down = anywhere.using(load=DOWN)
    assert down.load_result is not None
    assert (down.letter == down.load_result.label).all()
