import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import grasp3d
from grasp3d.contact import FingerDesign, GraspSamples, JointEncoders, MarginBudget
from grasp3d.contact.budget import PARTS
from grasp3d.errors import SettingError
from grasp3d.settings.uncertainty import Uncertainty

SENSOR = grasp3d.Sensor(receptive_field=4.0, fingertip_radius=10.0)
JOINTS = JointEncoders(4096, (60.0, 30.0))

frictions = st.tuples(st.floats(0.05, 2.0), st.floats(0.05, 2.0)).map(
    lambda two: tuple(sorted(two))
)
critical_angles = st.floats(0.0, 1.5)
openings = st.one_of(st.floats(0.0, 200.0), st.just(math.inf))
others = st.builds(
    Uncertainty,
    sensor_resolution=st.floats(0.0, 0.5),
    normal_error=st.floats(0.0, 0.5),
    location_error=st.floats(0.0, 5.0),
)


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(critical_angles, frictions, openings, others)
def test_the_parts_and_the_margin_add_up_to_the_friction_angle(
    critical: float, friction: tuple[float, float], opening: float, other: Uncertainty
) -> None:
    budget = MarginBudget.of(
        critical, friction=friction, sensor=SENSOR, encoders=JOINTS, other=other, opening=opening
    )
    assert float(budget.friction_angle) == pytest.approx(math.atan(sum(friction) / 2.0))
    assert sum(map(float, budget.stack.values())) == pytest.approx(float(budget.friction_angle))
    assert all(float(part) >= 0.0 for part in budget.parts.values())
    assert float(budget.uncertain) == pytest.approx(sum(map(float, budget.parts.values())))
    # S where beta* < beta_min - tilt - turn of the line.
    tilt = SENSOR.tilt + other.sensor_resolution / 2.0 + other.normal_error + JOINTS.normal_error
    location = 2.0 * (SENSOR.location_uncertainty + JOINTS.location_error + other.location_error)
    turn = math.asin(min(1.0, location / opening)) if opening > 0.0 else math.pi / 2.0
    expected = math.atan(friction[0]) - tilt - turn - critical
    assert float(budget.margin) == pytest.approx(expected, abs=1e-12)


@settings(max_examples=60, deadline=None)
@given(critical_angles, frictions, openings, others, st.floats(1.0, 3.0))
def test_more_uncertainty_never_leaves_more_margin(
    critical: float,
    friction: tuple[float, float],
    opening: float,
    other: Uncertainty,
    factor: float,
) -> None:
    def margin(**changes: object) -> float:
        given_values: dict[str, object] = {
            "friction": friction, "sensor": SENSOR, "encoders": JOINTS, "other": other,
            "opening": opening,
        }  # fmt: skip
        return float(MarginBudget.of(critical, **(given_values | changes)).margin)  # type: ignore[arg-type]

    middle = sum(friction) / 2.0
    narrower = (middle - (middle - friction[0]) / factor, middle + (friction[1] - middle) / factor)
    for better in (
        margin(friction=narrower),
        margin(sensor=grasp3d.Sensor(4.0 / factor, 10.0)),
        margin(encoders=JointEncoders(4096 * factor, (60.0, 30.0))),
        margin(opening=opening * factor),
        margin(other=Uncertainty()),
        margin(sensor=None),
        margin(encoders=None),
    ):
        assert better >= margin() - 1e-12


@settings(max_examples=50, deadline=None)
@given(st.floats(0.0, 0.6), st.floats(8.0, 200.0), st.integers(0, 10_000))
def test_no_tilt_and_shift_needs_more_friction_than_the_budget_and_one_needs_as_much(
    critical: float, opening: float, seed: int
) -> None:
    rng = np.random.default_rng(seed)
    tilt, shift = 0.2, 2.0
    line = np.array([1.0, 0.0, 0.0])
    points = np.array([-0.5, 0.5])[:, None] * opening * line
    normals = np.array(  # the first makes the larger angle with the line
        [
            Rotation.from_rotvec([0.0, 0.0, critical]).apply(line),
            -Rotation.from_rotvec(critical * rng.uniform() * rng.normal(size=3) / 3.0).apply(line),
        ]
    )
    contacts = grasp3d.Contacts(points, normals, friction=0.5)
    nominal = float(grasp3d.critical_friction_angle(contacts))
    other = Uncertainty(normal_error=tilt, location_error=shift)
    budget = MarginBudget.of(nominal, friction=0.5, other=other, opening=opening)
    needed = float(budget.critical_angle + budget.uncertain)

    directions = rng.normal(size=(50, 2, 3))
    directions /= np.linalg.norm(directions, axis=-1, keepdims=True)
    axes = np.cross(normals, rng.normal(size=(50, 2, 3)))
    axes *= tilt / np.linalg.norm(axes, axis=-1, keepdims=True)
    tilted = np.stack(
        [Rotation.from_rotvec(axes[:, k]).apply(normals[k]) for k in range(2)], axis=1
    )
    # The worst of all: the line turns away from the first normal, which tilts away from the line.
    turn = math.asin(2.0 * shift / opening)
    sine, cosine = math.sin(turn), math.cos(turn)
    directions[0] = [[sine, cosine, 0.0], [-sine, -cosine, 0.0]]
    tilted[0, 0] = Rotation.from_rotvec([0.0, 0.0, tilt]).apply(normals[0])
    moved = grasp3d.Contacts(points + shift * directions, tilted, friction=0.5)
    angles = np.asarray(grasp3d.critical_friction_angle(moved))
    assert angles.max() <= needed + 1e-9
    if nominal == pytest.approx(critical, abs=1e-12) and needed < math.pi / 2.0:
        assert angles[0] == pytest.approx(needed, abs=1e-9)


def test_locations_are_split_in_proportion_to_their_errors() -> None:
    other = Uncertainty(location_error=1.0)
    joints = JointEncoders(1000, (1000.0 / math.pi, 2000.0 / math.pi))  # 3 mm
    budget = MarginBudget.of(0.0, friction=0.5, encoders=joints, other=other, opening=20.0)
    moved = float(budget.encoders) - joints.normal_error
    assert moved == pytest.approx(3.0 * float(budget.location))
    assert moved + float(budget.location) == pytest.approx(math.asin(8.0 / 20.0))


def test_errors_along_the_closing_axis_are_errors_of_location_by_encoders() -> None:
    jaws = JointEncoders(500, (100.0,), "prismatic")  # 0.1 mm each
    other = Uncertainty(location_error=1.0)
    budget = MarginBudget.of(0.0, friction=0.5, encoders=jaws, other=other, opening=20.0)
    turn = math.asin(2.2 / 20.0)
    assert float(budget.encoders) == pytest.approx(turn * 0.1 / 1.1)
    assert float(budget.location) == pytest.approx(turn / 1.1)


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(
    frictions,
    st.floats(1.0, 100.0),
    st.sampled_from(["revolute", "prismatic"]),
    st.floats(10.0, 5000.0),
    st.floats(0.0, 0.6),
)
def test_the_margin_of_a_budget_is_that_of_a_label(
    friction: tuple[float, float], opening: float, kind: str, counts: float, off: float
) -> None:
    """With all errors of a sensor and of either kind of encoders."""
    encoders = JointEncoders(counts, (20.0, 5.0), kind)  # type: ignore[arg-type]
    design = FingerDesign(friction, SENSOR, encoders, Uncertainty(location_error=0.1))
    total = design.uncertainty
    toward = np.array([math.cos(off), math.sin(off), 0.0])
    contacts = grasp3d.Contacts(
        np.array([[0.0, 0.0, 0.0], [opening, 0.0, 0.0]]),
        np.array([toward, [-1.0, 0.0, 0.0]]),
        friction=friction[0],
    )
    label = grasp3d.classify(
        contacts,
        total.sensor_resolution,
        friction_interval=friction,
        normal_error=total.normal_error,
        location_error=total.location_error,
    )
    budget = design.budget(GraspSamples(off, opening))
    assert float(budget.margin[0]) == pytest.approx(float(label.margin), abs=1e-9)


def test_no_state_of_jaws_within_their_errors_is_worse_than_their_budget() -> None:
    """Jaws that are 2 mm nearer than reported, each, and contacts that are off as well."""
    jaws = JointEncoders(5, (20.0,), "prismatic")
    friction = math.tan(math.atan(0.5) - 0.03)
    near = 20.0 - 2.0 * jaws.closing_error
    turn, tilt = math.asin(4.0 / near), SENSOR.tilt
    moved = near * math.cos(turn) * np.array([math.cos(turn), math.sin(turn), 0.0])
    assert np.linalg.norm(moved - [near, 0.0, 0.0]) <= 4.0 + 1e-12  # 2 mm at either contact
    tilted = np.array([[math.cos(tilt), -math.sin(tilt), 0.0]])
    true = grasp3d.Contacts([np.zeros(3), moved], [tilted[0], -tilted[0]], friction)
    assert not grasp3d.force_closure(true).closed
    budget = MarginBudget.of(0.0, friction=friction, sensor=SENSOR, encoders=jaws, opening=20.0)
    assert float(budget.margin) < 0.0
    model = grasp3d.GraspModel(friction).with_uncertainty(SENSOR.uncertainty + jaws.uncertainty)
    perceived = grasp3d.Contacts(
        [[0.0, 0.0, 0.0], [20.0, 0.0, 0.0]], [[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]], friction
    )
    label = grasp3d.classify(
        perceived, model.sensor_resolution, location_error=model.location_error
    )
    assert int(label.label) == grasp3d.Label.M


def test_arrays_have_a_row_for_each_grasp_and_no_grasp_has_no_margin() -> None:
    critical = np.array([[0.0, 0.2], [0.3, math.inf]])
    opening = np.array([[50.0, 1.0], [0.0, math.inf]])
    budget = MarginBudget.of(critical, friction=(0.4, 0.6), sensor=SENSOR, opening=opening)
    for name in (*PARTS, "margin", "uncertain", "costliest"):
        assert getattr(budget, name).shape == (2, 2)
    assert budget.margin[1, 1] == -math.inf
    assert budget.costliest.tolist() == [
        ["sensor resolution", "location"],
        ["location", "sensor resolution"],
    ]
    one = budget.at((0, 0))
    assert float(one.margin) == budget.margin[0, 0]
    assert (one.costliest, one.line[:22]) == ("sensor resolution", "friction angle 26.57° ")


def test_the_mean_is_weighted_and_leaves_out_what_has_no_grasp() -> None:
    budget = MarginBudget.of([0.1, 0.3, math.inf], friction=0.5, sensor=SENSOR)
    assert float(budget.mean().critical_angle) == pytest.approx(0.2)
    mean = budget.mean([1.0, 3.0, 5.0])
    assert float(mean.critical_angle) == pytest.approx(0.25)
    assert float(mean.margin) == pytest.approx(math.atan(0.5) - 0.2 - 0.25)
    for nothing in (budget.at([2]), MarginBudget.of([], friction=0.5)):
        with pytest.raises(SettingError, match="no grasp whose margin could have a mean"):
            nothing.mean()
    with pytest.raises(SettingError, match="no grasp"):
        budget.mean([0.0, 0.0, 1.0])


def test_the_line_leaves_out_what_costs_nothing() -> None:
    exact = MarginBudget.of(0.0, friction=0.5)
    assert exact.line == "friction angle 26.57° = critical angle 0.00° + margin 26.57°"
    assert exact.costliest == ""
    everything = MarginBudget.of(
        0.5, friction="0.4..0.6", sensor=SENSOR, encoders=JOINTS, opening=50.0,
        other=Uncertainty(normal_error=0.01),
    )  # fmt: skip
    names = [term.rsplit(" ", 1)[0] for term in everything.line.split(" = ")[1].split(" + ")]
    assert names == ["critical angle", *PARTS.values(), "margin"]
    assert everything.line.endswith("margin -23.71°")
    for several in (
        MarginBudget.of([0.1, 0.2], friction=0.5),
        MarginBudget.of(math.inf, friction=1.0),
    ):
        with pytest.raises(SettingError, match="written as a line for one grasp"):
            _ = several.line


def test_friction_is_stated_once_and_lengths_have_no_unit_of_their_own() -> None:
    with_friction = Uncertainty(friction=(0.3, 0.5))
    assert float(MarginBudget.of(0.0, other=with_friction).friction_angle) == math.atan(0.4)
    for arguments in ({}, {"friction": 0.5, "other": with_friction}):
        with pytest.raises(SettingError, match="a budget needs one friction"):
            MarginBudget.of(0.0, **arguments)  # type: ignore[arg-type]
    with pytest.raises(SettingError, match="friction must be a finite number above 0"):
        MarginBudget.of(0.0, friction=0.0)
    with pytest.raises(SettingError, match="location error 2 mm has a unit: convert"):
        MarginBudget.of(0.0, friction=0.5, other=Uncertainty(location_error="2mm"))
