"""Grip force and payload of grasps on surfaces, pads with torsion, masses and their centres."""

import math
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import (
    GraspModel,
    Load,
    MeshOptions,
    ObjectMesh,
    ParallelGripper,
    Sampling,
    SurfaceLabels,
    check_mesh,
    evaluate_grasps,
    label_surface,
    load_mesh,
)
from grasp3d.arrays import Floats
from grasp3d.errors import SettingError
from grasp3d.formats.poses import GraspPoses
from grasp3d.quality.grip_forces import Resistance
from grasp3d.quality.loads import TaskText
from grasp3d.quality.tasks import STANDARD_GRAVITY
from grasp3d.settings.units import METRES, Unit
from grasp3d.stability.label import Label
from grasp3d.surface import mass_of
from grasp3d.surface.fields import FORCES, columns_of
from grasp3d.surface.grasp_numbers import surface_load_result
from grasp3d.surface.load_case import FORCE_RTOL, HARD_FINGERS, LoadCase, LoadResult
from grasp3d.surface.vertex_fields import Reason
from tests.helpers import shapes
from tests.helpers.closing_jaws import pads, pose

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
    (force,), (payload,) = load_result.grip_force, load_result.payload
    assert force_of(offset) * (1.0 - 1e-9) <= force <= force_of(offset) / (1.0 - FORCE_RTOL)
    assert payload == pytest.approx(40.0 * MASS / force)
    assert load_result.how == "exact"
    assert load_result.grip_force_largest[0] == force
    assert force * (1.0 - FORCE_RTOL) <= load_result.grip_force_least[0] <= force_of(offset)


@pytest.mark.slow
def test_newtons_and_kilograms_do_not_depend_on_the_unit() -> None:
    metres, other = labels().load_result, labels("in").load_result
    for name in ("grip_force", "grip_force_largest", "payload"):
        expected, found = getattr(metres, name), getattr(other, name)
        np.testing.assert_array_equal(np.isfinite(found), np.isfinite(expected))
        known = np.isfinite(expected)
        np.testing.assert_allclose(found[known], expected[known], rtol=2.0 * FORCE_RTOL)


@settings(max_examples=40, deadline=None)
@given(low=st.floats(0.1, 500.0), more=st.floats(0.0, 500.0))
def test_more_force_never_makes_a_label_worse(low: float, more: float) -> None:
    load_result = labels().load_result

    def codes(force: float) -> np.ndarray:
        return replace(load_result, case=replace(load_result.case, available=force)).label

    assert (codes(low + more) >= codes(low)).all()
    assert load_result.how == "bound"
    assert (load_result.grip_force_least <= load_result.grip_force).all()
    assert (load_result.grip_force <= load_result.grip_force_largest).all()
    held = load_result.grip_force_largest <= low
    np.testing.assert_array_equal(codes(low) == Label.S, held)
    assert (load_result.grip_force_least[codes(low) == Label.M] <= low).all()


def test_hard_fingers_off_the_line_hold_nothing_and_the_remedy_is_named() -> None:
    hard = replace(SOFT, torsion_radius=0.0)
    load_result = evaluate_grasps(block(), sides(0.01), hard, load=DOWN).load_result
    assert load_result.grip_force[0] == load_result.grip_force_largest[0] == math.inf
    assert load_result.resistance[0] == Resistance.NO_SUCH_WRENCH
    assert (load_result.payload[0], load_result.remedy) == (0.0, HARD_FINGERS)
    assert load_result.label[0] == Label.U
    soft = evaluate_grasps(block(), sides(0.01), SOFT, load=DOWN).load_result
    assert soft.remedy == ""
    on_line = evaluate_grasps(block(), sides(), hard, load=DOWN).load_result
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
    assert unknown.mass is None
    assert unknown.label is None
    assert unknown.grip_force[0] == pytest.approx(force_of(0.0) / MASS, rel=FORCE_RTOL)


def test_payload_of_a_weight_and_a_push() -> None:
    """The push takes its part of the force, whatever the mass is."""
    load = replace(DOWN, task="weight within 0 of -z + wrench 0,0,-5,0,0,0")
    load_result = evaluate_grasps(block(), sides(), SOFT, load=load).load_result
    held = (40.0 * 2.0 * FRICTION - 5.0) / STANDARD_GRAVITY
    assert load_result.payload[0] == pytest.approx(held, rel=2.0 * FORCE_RTOL)
    weak = evaluate_grasps(block(), sides(), SOFT, load=replace(load, grip_force=5.0)).load_result
    assert weak.payload[0] == 0.0


def test_on_creases_every_normal_of_the_set_counts() -> None:
    model = replace(SOFT, sensor_resolution=0.1)
    points = [[[0.0, 0.025, 0.015], [0.0, -0.025, 0.015]], sides(0.0)]
    grasps = evaluate_grasps(block(), points, model, load=DOWN)
    tilts = grasps.contacts.tilts(model)
    assert tilts == pytest.approx(np.array([[math.pi / 4.0 + 0.05] * 2, [0.05] * 2]))
    assert grasps.load_result.label is not None
    assert grasps.load_result.label[0] != Label.S
    assert grasps.load_result.label[1] == Label.S


def test_creases_whose_label_is_m_are_not_surely_unheld() -> None:
    """The nominal normals of edges resist nothing there, but those of the faces do."""
    load = Load(mass=MASS, grip_force=40.0)
    found = label_surface(block("m"), replace(SOFT, sensor_resolution=1.0), load=load)
    load_result, on_edge = found.load_result, block("m").contact_normals.counts == 2
    ambiguous = on_edge & (found.label == Label.M)
    assert np.isinf(load_result.grip_force[ambiguous]).any()
    assert (load_result.label[ambiguous] == Label.M).all()


def test_vertices_without_a_grasp_are_u_and_nan() -> None:
    load, narrow = Load(mass=MASS, grip_force=40.0), Sampling(max_opening="40mm")
    found = label_surface(block(), SOFT, sampling=narrow, load=load)
    none = found.reason != Reason.FOUND
    load_result = found.load_result
    assert none.any()
    assert np.isnan(load_result.grip_force[none]).all()
    assert np.isnan(load_result.payload[none]).all()
    assert (load_result.label[none] == Label.U).all()
    assert not np.isnan(load_result.grip_force[~none]).any()


def test_where_normals_cancel_out_nothing_is_known() -> None:
    grasps = evaluate_grasps(block(), sides(), SOFT).contacts
    vars(grasps)["sets"] = grasps.sets._replace(middles=np.zeros((1, 2, 3)))
    case = LoadCase.of(Load(mass=MASS, grip_force=40.0), block(), SOFT)
    load_result = surface_load_result(grasps, SOFT, case)
    assert math.isnan(load_result.grip_force[0])
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
    known = np.isfinite(one.grip_force)
    assert (other.grip_force[known] <= one.grip_force[known] * (1.0 + FORCE_RTOL)).all()


def test_a_load_that_cannot_be_meant_is_refused_before_the_search() -> None:
    unitless = load_mesh(shapes.box((0.08, 0.05, 0.03)), max_edge=0.1)
    with pytest.raises(SettingError, match="unit"):
        label_surface(unitless, load=Load(task="wrench 0,0,0,0,0,1"))
    assert label_surface(unitless, load=Load(mass=MASS)).load is not None


def test_weight_in_any_direction_is_held_only_as_surely_as_points_close() -> None:
    anywhere = labels()
    held = anywhere.load_result
    assert (anywhere.letter == np.minimum(held.label, anywhere.label)).all()
    assert (held.label > anywhere.label).any()  # by torsion, or not known
    down = anywhere.using(load=DOWN)
    assert (down.letter == down.load_result.label).all()


FORCE = 40.0
FRANKA = ParallelGripper.preset("franka")
INTERVAL, LOW, NOMINAL, HIGH = (0.3, 0.7), 0.3, 0.5, 0.7
OFFSETS = (0.0, 0.004, 0.02)


def held(load: Load = DOWN, *, tilt: float = 0.0, **changed: Any) -> LoadResult:
    """LoadResult of two fingers opposite to each other, at `OFFSETS` from the centre of mass."""
    model = GraspModel(sensor_resolution=2.0 * tilt, **changed)
    points = [[[x, side, 0.0] for side in (0.025, -0.025)] for x in OFFSETS]
    contacts = evaluate_grasps(block("mm"), points, model).contacts
    case = LoadCase.of(load, block("mm"), model, FRANKA)
    return surface_load_result(contacts, model, case)


def forces_at(friction: float, torsion_friction: float | None = None) -> Floats:
    """Forces of these grasps, with gravity across their line (closed form)."""
    torsion = FRANKA.torsion_radius(torsion_friction or friction)
    levers = np.array(OFFSETS) / torsion
    return np.asarray(0.5 * MASS * STANDARD_GRAVITY * np.hypot(1.0 / friction, levers))


def assert_forces(found: Floats, expected: Floats) -> None:
    """That upper bounds of forces are as close as is asked for."""
    assert (found >= expected * (1.0 - 1e-9)).all()
    assert (found <= expected / (1.0 - FORCE_RTOL)).all()


def test_each_friction_has_its_own_torsion_radius() -> None:
    found = held(friction=INTERVAL)
    assert found.grip_force_least == pytest.approx(forces_at(HIGH), rel=FORCE_RTOL)
    assert_forces(found.grip_force, forces_at(NOMINAL))
    assert_forces(found.grip_force_largest, forces_at(LOW))
    assert found.payload == pytest.approx(FORCE * MASS / found.grip_force_largest)
    stored = FRANKA.torsion_radius(NOMINAL)
    assert found.settings()["force_torsion_radius"] == pytest.approx(stored)


def test_a_given_torsion_radius_is_that_at_any_friction() -> None:
    given_radius = FRANKA.torsion_radius(NOMINAL)
    found = held(friction=INTERVAL, torsion_radius=given_radius)
    assert found.grip_force_least == pytest.approx(forces_at(HIGH, NOMINAL), rel=FORCE_RTOL)
    assert_forces(found.grip_force, forces_at(NOMINAL))
    assert_forces(found.grip_force_largest, forces_at(LOW, NOMINAL))
    assert found.settings()["force_torsion_radius"] == given_radius


@pytest.mark.slow
@settings(max_examples=6, deadline=None)
@given(low=st.floats(0.15, 0.9), width=st.floats(0.02, 0.6), part=st.floats(0.0, 1.0))
def test_an_interval_contains_the_forces_of_its_frictions(
    low: float, width: float, part: float
) -> None:
    tilt = 0.25 * math.atan(low)
    interval = held(friction=(low, low + width), tilt=tilt)
    one = held(friction=low + part * width, tilt=tilt)
    slack = 1.0 + 2.0 * FORCE_RTOL
    assert (interval.grip_force_largest * slack >= one.grip_force_largest).all()
    assert (interval.grip_force_least <= one.grip_force_least * slack).all()
    assert (interval.payload <= one.payload * slack).all()


@pytest.mark.slow
def test_given_poses_have_the_pads_torsion_at_each_friction() -> None:
    poses = GraspPoses(poses=np.array([pose((0.0, y, 0.0)) for y in (0.0, 0.004, 0.01)]), unit="m")
    mesh = load_mesh(shapes.box((0.06, 0.04, 0.02)), unit="m")

    def largest(friction: Any) -> Floats:
        model = GraspModel(friction=friction, sensor_resolution=0.05)
        return evaluate_grasps(mesh, poses, model, hand=pads(), load=DOWN).grip_force

    interval, low = largest(INTERVAL), largest(LOW)
    assert np.isfinite(low).all()
    np.testing.assert_allclose(interval, low, rtol=FORCE_RTOL)
    assert (low > largest(NOMINAL) * (1.0 + FORCE_RTOL)).all()


def solid_block(extents: tuple[float, float, float], middle: tuple[float, float, float]) -> Any:
    return trimesh.creation.box(extents).apply_translation(middle)


def mesh_of(*parts: trimesh.Trimesh, **options: Any) -> ObjectMesh:
    whole: Any = trimesh.util.concatenate(parts)
    return load_mesh(whole, MeshOptions(unit="mm", max_edge=math.inf), **options)


BASE = solid_block((50.0, 50.0, 10.0), (0.0, 0.0, -5.0))
FLAT = shapes.box((1.0, 1.0, 1.0))
OPEN = (FLAT[0], FLAT[1][:-2])


@pytest.mark.parametrize("unit", ["m", "mm", "in"])
def test_the_mass_is_density_times_volume_in_any_unit(unit: Any) -> None:
    size = 0.1 / METRES[unit]
    mesh = load_mesh(shapes.box((size, size, size)), unit=unit, max_edge=math.inf)
    assert mass_of(mesh, Load(density=1000.0)) == pytest.approx(1.0, rel=1e-12)
    assert mass_of(mesh, Load(mass=0.5)) == 0.5
    assert mass_of(mesh, Load()) is None


@pytest.mark.parametrize(
    ("mesh", "load", "words"),
    [
        (mesh_of(BASE, unit=None), Load(density=1.0), r"density is in kg/m\^3, but the unit of"),
        (load_mesh(OPEN, unit="m"), Load(mass=1.0), "is open, so its centre of mass is not known"),
        (load_mesh(OPEN, unit="m"), Load(grip_force=1.0), r"is open, .*--center-of-mass"),
        (
            load_mesh(OPEN, unit="m", center_of_mass=(0, 0, 0)),
            Load(density=1.0),
            r"is open, so a density gives no mass: give the mass \(--mass\)",
        ),
        (
            load_mesh((FLAT[0] * [1, 1, 0], FLAT[1]), repair="none"),
            Load(mass=1.0),
            "encloses no volume, so its centre of mass",
        ),
    ],
)
def test_what_a_load_needs_is_said_in_one_sentence(
    mesh: ObjectMesh, load: Load, words: str
) -> None:
    with pytest.raises(SettingError, match=words) as error:
        LoadCase.of(load, mesh, GraspModel())
    assert mesh.report.source in str(error.value)
    assert "\n" not in str(error.value)


def test_an_open_mesh_needs_mass_and_centre_of_mass() -> None:
    mesh = load_mesh(OPEN, unit="cm", center_of_mass="1mm,0,-2mm", max_edge=1.0)
    np.testing.assert_allclose(mesh.center_mass, [0.001, 0.0, -0.002], atol=1e-15)
    assert mesh.report.center_mass_from == "given"
    assert not any("centre of mass" in warning for warning in mesh.report.warnings)
    assert LoadCase.of(Load(mass=1.0), mesh, GraspModel()).mass == 1.0


def test_the_centre_is_in_the_frame_and_unit_of_the_mesh() -> None:
    box = shapes.box((40.0, 40.0, 40.0))
    mesh = load_mesh((box[0] + 100.0, box[1]), unit="mm", center_of_mass="10.1cm,0.1,99mm")
    np.testing.assert_allclose(mesh.center_mass, [0.101, 0.1, 0.099], atol=1e-15)
    assert mesh.options.center_of_mass == (0.101, 0.1, 0.099)
    assert mesh.torque_scale == pytest.approx(1e-3 * math.sqrt(21.0**2 + 20.0**2 + 21.0**2))
    with pytest.raises(SettingError, match=r"center_of_mass is 101 mm, but the unit .* not"):
        load_mesh(box, center_of_mass="10.1cm,100,99")


def test_a_centre_outside_the_object_is_warned_about_and_a_far_one_refused() -> None:
    box = shapes.box((40.0, 40.0, 40.0))
    inside = load_mesh(box, center_of_mass=(19.9, 0.0, 0.0))
    assert not inside.report.warnings
    outside = load_mesh(box, center_of_mass=(30.0, 0.0, 0.0))
    assert any("outside the object's bounding box" in one for one in outside.report.warnings)
    assert any("bounding box" in one.message for one in check_mesh(outside).warnings)
    with pytest.raises(SettingError, match=r"outside the object's bounding box by .* is it in"):
        load_mesh(box, center_of_mass=(1e6, 0.0, 0.0))


def test_a_surface_that_crosses_itself_may_have_its_centre_outside() -> None:
    vertices, faces = shapes.box((40.0, 20.0, 20.0))
    turned = np.where(vertices[:, :1] > 0.0, [1.0, -0.9, 1.0], 1.0)
    mesh = load_mesh((vertices * turned, faces))
    # Two wedges that meet at an edge; the smaller one is inside out:
    edge = 40.0 / 1.9
    areas = np.array([10.0 * edge, -9.0 * (40.0 - edge)])
    x = areas @ [edge / 3.0, 40.0 - (40.0 - edge) / 3.0] / areas.sum() - 20.0
    np.testing.assert_allclose(mesh.center_mass, [x, 0.0, 0.0], atol=1e-9)
    (warning,) = mesh.report.warnings
    beyond = (-20.0 - x) / mesh.size
    assert f"outside the object's bounding box by {beyond:.3g} of its size: the surface" in warning
