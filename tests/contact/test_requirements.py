import dataclasses
import math

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

import grasp3d
from grasp3d.contact import CylinderTip, EllipsoidTip, FingerDesign, GraspSamples, JointEncoders
from grasp3d.errors import SettingError
from grasp3d.settings.uncertainty import Uncertainty
from grasp3d.stability import margin_budget

SENSOR = grasp3d.Sensor(receptive_field=2.0, fingertip_radius=10.0)
JOINTS = JointEncoders(4096, (60.0, 30.0))
OTHER = Uncertainty(normal_error=0.02, location_error=0.3)

designs = st.builds(
    FingerDesign,
    st.tuples(st.floats(0.2, 0.8), st.floats(0.8, 1.2)),
    st.sampled_from([None, SENSOR]),
    st.sampled_from([JOINTS, JointEncoders(512, (20.0,))]),
    st.sampled_from([Uncertainty(), OTHER]),
)
fractions = st.sampled_from([0.2, 0.5, 0.9, 1.0])


@st.composite
def samples(draw: st.DrawFn) -> GraspSamples:
    rng = np.random.default_rng(draw(st.integers(0, 10_000)))
    count = draw(st.integers(1, 8))
    critical = rng.uniform(0.0, 0.4, count)
    critical[rng.uniform(size=count) < 0.1] = math.inf
    return GraspSamples(critical, rng.uniform(5.0, 100.0, count), rng.uniform(0.1, 1.0, count))


@settings(max_examples=60, deadline=None)
@given(designs, samples(), fractions)
def test_a_fraction_is_s_above_the_required_friction_and_not_below(
    design: FingerDesign, grasps: GraspSamples, fraction: float
) -> None:
    needed = design.required_friction(grasps, fraction)
    for friction, holds in ((needed * 1.001 + 1e-6, True), (needed * 0.999 - 1e-6, False)):
        if 0.0 < friction < 1e6:
            changed = dataclasses.replace(design, friction=friction)
            assert (changed.stable_fraction(grasps) >= fraction - 1e-9) == holds
    if math.isinf(needed):
        changed = dataclasses.replace(design, friction=1e9)
        assert changed.stable_fraction(grasps) < fraction


@settings(max_examples=60, deadline=None)
@given(designs, samples(), fractions)
def test_a_fraction_is_s_from_the_required_counts_on_and_not_below(
    design: FingerDesign, grasps: GraspSamples, fraction: float
) -> None:
    counts = design.required_counts(grasps, fraction)
    assert design.encoders is not None
    if counts is None:
        assert dataclasses.replace(design, encoders=None).stable_fraction(grasps) < fraction
        return
    for used, holds in ((counts, True), (counts - 1, False)):
        if used:
            encoders = dataclasses.replace(design.encoders, counts=float(used))
            found = dataclasses.replace(design, encoders=encoders).stable_fraction(grasps)
            assert (found >= fraction - 1e-9) == holds


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(
    designs, samples(), fractions,
    st.sampled_from([10.0, math.inf, CylinderTip(8.0), EllipsoidTip((8.0, 10.0, 12.0))]),
)  # fmt: skip
def test_a_fraction_is_s_below_the_required_field_and_location_error_and_not_above(
    design: FingerDesign, grasps: GraspSamples, fraction: float, tip: float | EllipsoidTip
) -> None:
    def with_field(length: float) -> FingerDesign:
        sensor = grasp3d.Sensor(length, tip) if isinstance(tip, float) else tip.sensor(length)
        return dataclasses.replace(design, sensor=sensor)

    def with_location(length: float) -> FingerDesign:
        other = dataclasses.replace(design.other, location_error=length)
        return dataclasses.replace(design, other=other)

    for limit, change in (
        (design.required_field(grasps, fraction, tip=tip), with_field),
        (design.required_location(grasps, fraction), with_location),
    ):
        assert 0.0 <= limit < math.inf  # openings are finite, so something is too coarse
        if limit > 0.0:
            assert change(0.999 * limit).stable_fraction(grasps) >= fraction - 1e-9
        assert change(1.001 * limit + 1e-9).stable_fraction(grasps) < fraction - 1e-9


def test_counts_of_joints_that_only_tilt_are_those_of_the_formula() -> None:
    grasp = GraspSamples(critical_angle=0.05)  # an infinite opening: locations do not matter
    design = FingerDesign(0.5, SENSOR, JOINTS)
    left = math.atan(0.5) - SENSOR.tilt - 0.05
    assert design.required_counts(grasp) == math.floor(2 * math.pi / left) + 1
    assert math.isinf(design.required_location(grasp))
    assert math.isinf(design.required_field(grasp, tip=math.inf))
    assert design.required_field(grasp, tip=10.0) == pytest.approx(
        20.0 * (math.atan(0.5) - 0.05 - JOINTS.normal_error)
    )


def test_without_one_uncertainty_more_is_s() -> None:
    rng = np.random.default_rng(3)
    grasps = GraspSamples(rng.uniform(0.0, 0.4, 400), rng.uniform(5.0, 80.0, 400))
    coarse = JointEncoders(200, (60.0, 30.0))
    design = FingerDesign((0.4, 0.6), SENSOR, coarse, OTHER)
    budget = design.budget(grasps)
    for part, used in budget.parts.items():
        changed = design.without(part)
        assert changed.stable_fraction(grasps) > design.stable_fraction(grasps)
        left = changed.budget(grasps)
        assert not left.parts[part].any()
        if part not in {"location", "encoders"}:  # parts of one turn of the line
            np.testing.assert_allclose(left.margin, budget.margin + used, atol=1e-12)
        else:
            assert (left.margin >= budget.margin + used - 1e-12).all() or part == "encoders"
    with pytest.raises(
        SettingError, match="no uncertainty is called 'mass'; known: friction, sens"
    ):
        design.without("mass")


def test_the_uncertainty_of_a_design_is_that_of_its_parts() -> None:
    design = FingerDesign(0.5, SENSOR, JOINTS, OTHER)
    assert design.uncertainty == SENSOR.uncertainty + JOINTS.uncertainty + OTHER
    assert FingerDesign(0.5).uncertainty == Uncertainty()
    model = grasp3d.GraspModel().with_uncertainty(design.uncertainty)
    margin = design.budget(GraspSamples(0.1)).margin
    assert margin[0] == pytest.approx(model.effective_friction_angle - 0.1)


def test_the_margins_of_a_surface_are_those_of_the_design() -> None:
    design = FingerDesign((0.4, 0.6), SENSOR, JOINTS, OTHER)
    model = grasp3d.GraspModel(friction=(0.4, 0.6)).with_uncertainty(design.uncertainty)
    box = grasp3d.load_mesh(trimesh.creation.box([80.0, 50.0, 30.0]), max_edge=20.0)
    labels = grasp3d.label_surface(box, model)
    opening = np.where(np.isfinite(labels.critical_angle), labels.opening, np.inf)
    grasps = GraspSamples(labels.critical_angle, opening, box.vertex_areas)
    np.testing.assert_allclose(design.budget(grasps).margin, labels.margin, atol=1e-9)
    budget = margin_budget(labels.model, labels.critical_angle, labels.located_angles[0])
    np.testing.assert_allclose(budget.margin, labels.margin, atol=1e-9)
    assert design.stable_fraction(grasps) == pytest.approx(labels.fractions()["S"])
    assert 0.0 < labels.fractions()["S"] < 1.0


def test_of_several_grasps_at_a_contact_point_the_best_counts() -> None:
    critical = np.array([[0.0, 0.2], [0.1, 0.05], [math.inf, 0.1], [math.inf, math.inf]])
    opening = np.array([[4.0, 60.0], [50.0, 50.0], [10.0, 80.0], [10.0, 10.0]])
    both = GraspSamples(critical, opening, [1.0, 2.0, 3.0, 4.0])
    for design in (FingerDesign(0.5, SENSOR), FingerDesign(0.5, None, JOINTS, Uncertainty())):
        alone = [
            design.budget(GraspSamples(critical[:, column], opening[:, column])).margin
            for column in range(2)
        ]
        budget = design.budget(both)
        np.testing.assert_array_equal(budget.margin, np.maximum(*alone))
        expected = np.asarray(both.weights)[budget.margin > 0.0].sum() / 10.0
        assert design.stable_fraction(both) == pytest.approx(expected)
    assert FingerDesign(0.5, SENSOR).budget(both).critical_angle[0] == 0.2  # the wider grasp
    assert FingerDesign(0.5).budget(both).critical_angle[0] == 0.0


def test_bad_values_are_refused() -> None:
    grasp, design = GraspSamples(0.0, 50.0), FingerDesign(0.5)
    for fraction in (0.0, 1.1, math.nan):
        with pytest.raises(SettingError, match="fraction must be above 0 and at most 1"):
            design.required_friction(grasp, fraction)
        with pytest.raises(SettingError, match="fraction must be above 0 and at most 1"):
            design.required_location(grasp, fraction)
    with pytest.raises(SettingError, match="the design has no encoders"):
        design.required_counts(grasp)
    with pytest.raises(SettingError, match="friction must be a finite number above 0"):
        FingerDesign("-1..1")
    with pytest.raises(SettingError, match="there must be a grasp with a weight above 0"):
        GraspSamples([], [])
