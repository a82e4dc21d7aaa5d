"""Poses of hands with joints: labels, numbers and reasons of known grasps; what motors hold."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from numpy.typing import NDArray

import grasp3d
from grasp3d import Label
from grasp3d.describe.verdict import verdict_of
from grasp3d.errors import ContactError, SettingError
from grasp3d.formats import GraspPoses
from grasp3d.grasps.link_grasps import LinkGrasps, MotorLoads
from grasp3d.hand.articulated_hand import ArticulatedHand
from grasp3d.hand.table import Approach, Table
from grasp3d.mesh import ObjectMesh
from grasp3d.quality.tasks import STANDARD_GRAVITY
from grasp3d.surface.fields import HAND_GRASPS
from tests.helpers import shapes, slider_hand
from tests.helpers.slider_hand import BOX, TOUCHING

Floats = NDArray[np.float64]
SAMPLED = math.radians(1.0)
FINE = grasp3d.GraspModel(sensor_resolution=math.radians(10.0))


@pytest.fixture(scope="module")
def box() -> ObjectMesh:
    return grasp3d.load_mesh(shapes.box(BOX), unit="m")


def given(*postures: Any, shift: Floats | None = None, **options: Any) -> GraspPoses:
    """The hand's axis through the middle of the box, or shifted; the joints' values."""
    poses = np.tile(np.eye(4), (len(postures), 1, 1))
    if shift is not None:
        poses[:, :3, 3] = shift
    values = [np.broadcast_to(posture, 4) for posture in postures]
    return GraspPoses(poses=poses, posture=np.array(values), unit="m", **options)


def evaluated(box: ObjectMesh, folder: Path, *postures: Any, **options: Any) -> LinkGrasps:
    found = grasp3d.evaluate_grasps(
        box, given(*postures), FINE, hand=slider_hand.hand(folder, **options)
    )
    assert isinstance(found, LinkGrasps)
    return found


def test_poses_are_written_where_the_contacts_are(box: ObjectMesh, tmp_path: Path) -> None:
    hand = slider_hand.hand(tmp_path)
    poses = given(TOUCHING - 2e-3, joint_names=hand.joint_names)
    found = grasp3d.evaluate_grasps(box, poses, FINE, hand=hand, contact_rule="closed")
    assert np.abs(found.to_poses().posture - poses.posture).max() > 1e-3
    path = tmp_path / "found.csv"
    grasp3d.write_grasps(path, found)
    back = grasp3d.evaluate_grasps(
        box, grasp3d.read_grasps(path, hand=hand), FINE, hand=hand, contact_distance="0.2mm"
    )
    assert back.links.tolist() == found.links.tolist() != [""]
    np.testing.assert_allclose(back.margin, found.margin, atol=SAMPLED)


def test_four_fingers_on_a_box(box: ObjectMesh, tmp_path: Path) -> None:
    found = evaluated(box, tmp_path, TOUCHING)
    assert found.label.tolist() == [Label.S]
    assert found.links.tolist() == ["finger_0 finger_1 finger_2 finger_3"]
    # Points near the surface are averaged, which leaves contacts off the middle a little.
    assert found.critical_angle[0] == pytest.approx(0.0, abs=SAMPLED)
    assert found.margin[0] == pytest.approx(math.atan(0.5) - math.radians(5.0), abs=SAMPLED)
    assert found.max_resolution[0] == pytest.approx(2.0 * math.atan(0.5), abs=2.0 * SAMPLED)
    assert (found.reason.tolist(), found.reachable.tolist()) == ([""], [True])
    assert found.rank.tolist() == [6]


def test_a_location_error_costs_a_hand_what_the_surface_turns_and_torques_need(
    box: ObjectMesh, tmp_path: Path
) -> None:
    """In the middle of flat sides nothing turns; an error that reaches an edge leaves no S."""
    exact = evaluated(box, tmp_path, TOUCHING)
    hand, poses = slider_hand.hand(tmp_path), given(TOUCHING)
    margins = [float(exact.margin[0])]
    for error in (1e-3, 2e-3, 0.04):
        model = replace(FINE, location_error=error)
        found = grasp3d.evaluate_grasps(box, poses, model, hand=hand)
        assert isinstance(found, LinkGrasps)
        margins.append(float(found.margin[0]))
        assert found.critical_angle_best.tolist() == [0.0]
        assert (found.label[0] == Label.S) == (margins[-1] > 0.0)
    assert margins == sorted(margins, reverse=True)
    assert margins[0] > margins[1] > 0.0 > margins[3]


def test_links_have_the_resolution_that_they_state(box: ObjectMesh, tmp_path: Path) -> None:
    for degrees, number, label in ((30.0, 4, Label.S), (80.0, 2, Label.M)):  # tilts beyond friction
        stated = {f"finger_{k}": math.radians(degrees) for k in range(number)}
        found = evaluated(box, tmp_path, TOUCHING, sensors=stated)
        expected = math.atan(0.5) - math.radians(0.5 * degrees)
        assert found.margin[0] == pytest.approx(expected, abs=SAMPLED)
        assert found.label.tolist() == [label]


@pytest.mark.parametrize(
    ("posture", "label", "reason"),
    [
        ([TOUCHING, TOUCHING, TOUCHING, -0.02], Label.U,
         "joint 4 (slide_3) is 20 mm beyond its limit"),
        ([TOUCHING + 0.014, TOUCHING, TOUCHING, TOUCHING], Label.U,
         "finger_0 14 mm inside the object"),
        (0.01, Label.U, "no link within 5 mm of the object"),
        ([TOUCHING, 0, 0, 0], Label.U, "touches with one link only, finger_0"),
    ],
)  # fmt: skip
def test_reasons(box: ObjectMesh, tmp_path: Path, posture: Any, label: Label, reason: str) -> None:
    found = evaluated(box, tmp_path, posture)
    assert (found.reason.tolist(), found.label.tolist()) == ([reason], [label])
    inside = "limit" in reason or "inside" in reason
    assert found.reachable.tolist() == [not inside]
    if not inside:
        assert np.isnan([found.critical_angle[0], found.epsilon[0], found.margin[0]]).all()


def test_joints_that_follow_have_limits_of_their_own(box: ObjectMesh, tmp_path: Path) -> None:
    coupled = {"joints": ["slide_0", "slide_1"], "ratios": [1, 2]}
    hand = grasp3d.read_hand(slider_hand.write(tmp_path, couplings=[coupled]))
    assert isinstance(hand, ArticulatedHand)
    np.testing.assert_allclose(hand.limits_of_joints, [[0.0, 0.03], [0.0, 0.06], [0.0, 0.06]])
    postures = np.array([[0.04, 0.0, 0.0], [0.03, 0.0, 0.0], [0.04, 0.0, 0.09]])
    poses = GraspPoses(poses=np.tile(np.eye(4), (3, 1, 1)), posture=postures, unit="m")
    found = grasp3d.evaluate_grasps(box, poses, FINE, hand=hand)
    first, second, third = found.reason.tolist()
    assert first == "joint slide_1 is 20 mm beyond its limit"
    assert "limit" not in second
    assert third == "joint 3 (slide_3) is 30 mm beyond its limit"


def test_reasons_of_collisions_and_of_the_region(box: ObjectMesh, tmp_path: Path) -> None:
    found = evaluated(box, tmp_path, TOUCHING)
    contacts = replace(
        found.contacts, self_collision=np.array([[0, 2]]), self_depth=np.array([0.007])
    )
    overlapping = replace(found, contacts=contacts)
    assert overlapping.reason.tolist() == ["palm and finger_1 overlap by 7 mm"]
    below = replace(found, contacts=replace(found.contacts, table_depth=np.array([0.02])))
    assert below.reason.tolist() == ["20 mm below the table"]
    assert overlapping.reachable.tolist() == below.reachable.tolist() == [False]
    part = grasp3d.load_mesh(shapes.box(BOX), unit="m", region="box:0,-1,-1,1,1,1")
    outside = evaluated(part, tmp_path, TOUCHING)
    assert outside.reason.tolist() == ["touches outside --region"]
    assert outside.label.tolist() == [Label.U]


def test_table_and_approach(box: ObjectMesh, tmp_path: Path) -> None:
    hand = slider_hand.hand(tmp_path)
    found = grasp3d.evaluate_grasps(
        box, given(TOUCHING), FINE, hand=hand, table=Table.below(box),
        approach=Approach(np.array([0.0, 0, -1]), within=1.0),
    )  # fmt: skip
    assert found.reason.tolist() == ["42 mm below the table"]  # the palm
    found = grasp3d.evaluate_grasps(
        box, given(TOUCHING), FINE, hand=hand, approach=Approach(np.array([0.0, 0, -1]), within=1.0)
    )
    assert found.reason.tolist() == ["comes 180° from the approach direction, more than 57°"]


def test_joints_are_matched_by_name(box: ObjectMesh, tmp_path: Path) -> None:
    hand = slider_hand.hand(tmp_path)
    values = np.array([TOUCHING, 0.01, 0.02, 0.03])
    poses = given(values[::-1], joint_names=tuple(reversed(hand.joint_names)))
    found = grasp3d.evaluate_grasps(box, poses, hand=hand)
    assert found.given.posture.tolist() == [values.tolist()]
    assert found.given.joint_names == hand.joint_names
    assert found.links.tolist() == ["finger_0"]
    unnamed = grasp3d.evaluate_grasps(box, given(values), hand=hand)
    assert unnamed.links.tolist() == ["finger_0"]
    order = "the order of the joints is not stated: that of sliders is assumed"
    assert order in unnamed.warnings
    beyond = np.full((10, 4), TOUCHING)
    beyond[:2, 2] = 0.1
    (said,) = grasp3d.evaluate_grasps(box, given(*beyond), hand=hand).warnings
    assert "beyond their limits in 2 of 10 poses: are these of another hand" in said
    with pytest.raises(ContactError, match=r"no values of them: .* columns called joint:"):
        grasp3d.evaluate_grasps(box, np.eye(4)[None], hand=hand)
    extremes = grasp3d.GraspModel(method="extremes")
    with pytest.raises(SettingError, match="takes no method extremes"):
        grasp3d.evaluate_grasps(box, given(values), extremes, hand=hand)
    with pytest.raises(SettingError, match="max_distance applies to contacts"):
        grasp3d.evaluate_grasps(box, given(values), hand=hand, max_distance=0.1)


def test_chosen_poses_and_tables(box: ObjectMesh, tmp_path: Path) -> None:
    found = evaluated(box, tmp_path, 0.01, TOUCHING, TOUCHING - 0.003)
    chosen = found.take(np.array([2, 0]))
    for name in ("label", "critical_angle", "epsilon", "gap", "rank", "reason"):
        np.testing.assert_array_equal(getattr(chosen, name), getattr(found, name)[[2, 0]])
    frame = found.to_dataframe()
    assert frame["label"].tolist() == ["U", "S", "S"]
    assert frame["reason"].tolist()[1:] == ["", ""]
    assert frame["gap_finger_0"].round(6).tolist()[1:] == [0.0, 0.003]
    poses = found.to_poses()
    columns = {name for name in poses.columns if not name.startswith("gap_")}
    assert columns == {field.name for field in HAND_GRASPS if field.when == "always"} - {"score"}
    assert poses.in_unit("mm").columns["gap"][2] == pytest.approx(3.0)
    assert grasp3d.grasps.ranked_rows(found).tolist() == [1, 2, 0]


ANGLE = math.radians(5.0)
DOWN = "weight within 0 of -z"


def loaded(
    folder: Path, load: grasp3d.Load | None, model: grasp3d.GraspModel = FINE, **stated: Any
) -> LinkGrasps:
    """The slider hand around a box, at a pose that touches its four sides and at one that none."""
    box = grasp3d.load_mesh(shapes.box(BOX), unit="m")
    posture = np.array([[TOUCHING] * 4, [0.0] * 4])
    poses = GraspPoses(poses=np.tile(np.eye(4), (2, 1, 1)), posture=posture, unit="m")
    hand = grasp3d.read_hand(slider_hand.write(folder, **stated))
    found = grasp3d.evaluate_grasps(box, poses, model, hand=hand, load=load)
    assert isinstance(found, LinkGrasps)
    return found


def held(*given: Any, **stated: Any) -> MotorLoads:
    """What the motors of the same hand hold."""
    found = loaded(*given, **stated).motors
    assert found is not None
    return found


def test_four_sliding_fingers_hold_a_box_by_friction_alone(tmp_path: Path) -> None:
    load_result = held(tmp_path, grasp3d.Load(task=DOWN, torque_limits=10.0))
    # Contacts are averaged over what is near, a little off the middle of the sides.
    sure = 4.0 * 10.0 * math.tan(math.atan(0.5) - ANGLE) / STANDARD_GRAVITY
    assert load_result.payload[0] == pytest.approx(sure, rel=0.04)
    assert np.isnan(load_result.payload).tolist() == [False, True]
    assert np.isnan(load_result.payload_most).all()  # it matters for a mass only
    assert load_result.limit[0] in {f"slide_{k}" for k in range(4)}
    nine = grasp3d.Load(mass=9.0, task=DOWN, torque_limits=10.0)
    best = 4.0 * 10.0 * math.tan(math.atan(0.5) + ANGLE) / STANDARD_GRAVITY
    assert held(tmp_path, nine).payload_most[0] == pytest.approx(best, rel=0.04)
    assert loaded(tmp_path, nine).label[0] == Label.U
    double = held(tmp_path, grasp3d.Load(task=DOWN, torque_limits=20.0))
    assert double.payload[0] == pytest.approx(2.0 * load_result.payload[0], rel=1e-6)


def test_every_pose_that_does_not_surely_hold_the_mass_says_so(tmp_path: Path) -> None:
    coarse = grasp3d.GraspModel(sensor_resolution=math.radians(60.0))
    found = loaded(tmp_path, grasp3d.Load(task=DOWN, mass=0.1), coarse)
    assert found.label.tolist() == [Label.M, Label.U]
    assert found.reason.tolist() == [
        "surely holds 0 kg only", "no link within 5 mm of the object",
    ]  # fmt: skip
    slippery = held(tmp_path, grasp3d.Load(), replace(FINE, friction=0.05))
    assert (slippery.payload[0], slippery.limit[0]) == (0.0, "what can be pressed at the contacts")


def test_numbers_of_another_load_do_not_stay_with_the_poses(tmp_path: Path) -> None:
    held = loaded(tmp_path, grasp3d.Load(task=DOWN))
    poses = held.to_poses()
    poses = replace(poses, columns={**poses.columns, "gap_other": held.gap, "own": held.gap})
    again = grasp3d.evaluate_grasps(held.mesh, poses, FINE, hand=held.hand).to_poses()
    lost = poses.columns.keys() - again.columns.keys()
    assert {"payload", "limit", "gap_other"} <= lost
    assert "own" in again.columns


def test_torques_that_are_not_stated_are_asked_for(tmp_path: Path) -> None:
    unstated = {"torques": {"slide_0": 20.0}}
    with pytest.raises(SettingError, match="of the motor of slide_1, slide_2, slide_3: state it"):
        loaded(tmp_path, grasp3d.Load(mass=1.0), **unstated)
    with pytest.raises(SettingError, match="of slide_0, slide_1, slide_2, slide_3: state it"):
        loaded(tmp_path, grasp3d.Load(mass=1.0), torques={})
    found = loaded(tmp_path, None, **unstated)
    assert (found.label[0], found.motors) == (Label.S, None)
    idle = dict.fromkeys([f"slide_{k}" for k in range(4)], 0.0)
    with pytest.raises(SettingError, match="no motor that torque_limits could limit"):
        loaded(tmp_path, grasp3d.Load(torque_limits=10.0), torques=idle)
    with pytest.raises(SettingError, match="takes no torsion_radius with a load"):
        loaded(tmp_path, grasp3d.Load(task=DOWN), replace(FINE, torsion_radius=0.003))


def test_the_weight_of_links_takes_from_what_motors_hold(tmp_path: Path) -> None:
    heavy = {f"finger_{k}": {"mass": 0.2} for k in range(4)}
    down = grasp3d.Load(task="weight within 0 of -x", torque_limits=10.0)
    light, found = held(tmp_path, down), held(tmp_path, down, masses=heavy)
    assert "is neglected: no masses" in light.link_weights
    assert found.link_weights == ("the weight of the links that move, 0.8 kg, counts")
    assert found.payload[0] < light.payload[0] - 0.01


@pytest.mark.parametrize("task", ["weight", "weight within 0 of -x"])
def test_motors_that_do_not_carry_the_links_are_said_to(tmp_path: Path, task: str) -> None:
    heavy = {f"finger_{k}": {"mass": 1.5} for k in range(4)}
    load = grasp3d.Load(mass=0.1, task=task, torque_limits=10.0)
    found = loaded(tmp_path, load, masses=heavy)
    assert found.motors is not None
    assert found.motors.limit[0] == "the weight of the links"
    said = "the weight of the links alone is too much for the motors"
    assert found.reason[0].endswith(f": {said}")
    assert "its motors are too weak to hold 0.1 kg" in str(verdict_of(found))
    light = held(tmp_path, load, masses={"finger_0": {"mass": 0.01}})
    assert light.limit[0].startswith("slide_")


def test_two_point_contacts_are_said_to_leave_the_turn_about_their_line_free(
    box: ObjectMesh, tmp_path: Path
) -> None:
    hand = grasp3d.read_hand(slider_hand.write(tmp_path, 2))
    pose = np.eye(4)
    pose[1, 3] = 0.002
    poses = GraspPoses(poses=pose, posture=np.full((1, 2), TOUCHING), unit="m")
    load = grasp3d.Load(mass=0.01, torque_limits=10.0)
    found = grasp3d.evaluate_grasps(box, poses, FINE, hand=hand, load=load)
    assert isinstance(found, LinkGrasps)
    assert found.motors is not None
    assert found.motors.payload[0] == 0.0
    assert found.motors.limit[0] == "the turn about the line of the contacts"
    said = "point contacts on one line resist no torque about it"
    assert found.reason[0].endswith(f"holds 0 kg at most: {said}")
