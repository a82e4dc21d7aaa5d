"""What the motors of hands with joints hold at given poses."""

import math
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import grasp3d
from grasp3d import Label
from grasp3d.arrays import unit_rows
from grasp3d.describe.verdict import verdict_of
from grasp3d.errors import SettingError
from grasp3d.formats import GraspPoses
from grasp3d.grasps.link_grasps import LinkGrasps
from grasp3d.quality.tasks import STANDARD_GRAVITY
from tests.helpers import shapes, slider_hand
from tests.helpers.slider_hand import BOX, TOUCHING

ANGLE = math.radians(5.0)
FINE = grasp3d.GraspModel(sensor_resolution=2.0 * ANGLE)
DOWN = "weight within 0 of -z"


def evaluated(
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


def test_four_sliding_fingers_hold_a_box_by_friction_alone(tmp_path: Path) -> None:
    load_result = evaluated(tmp_path, grasp3d.Load(task=DOWN, torque_limits=10.0)).motors
    assert load_result is not None
    # Contacts are averaged over what is near, a little off the middle of the sides.
    sure = 4.0 * 10.0 * math.tan(math.atan(0.5) - ANGLE) / STANDARD_GRAVITY
    assert load_result.payload[0] == pytest.approx(sure, rel=0.04)
    assert np.isnan(load_result.payload).tolist() == [False, True]
    assert np.isnan(load_result.payload_most).all()  # it matters for a mass only
    assert load_result.limit[0] in {f"slide_{k}" for k in range(4)}
    assert np.isnan(load_result.load_fraction).all()
    heavy = evaluated(tmp_path, grasp3d.Load(mass=9.0, task=DOWN, torque_limits=10.0))
    assert heavy.motors is not None
    best = 4.0 * 10.0 * math.tan(math.atan(0.5) + ANGLE) / STANDARD_GRAVITY
    assert heavy.motors.payload_most[0] == pytest.approx(best, rel=0.04)
    assert heavy.label[0] == Label.U
    double = evaluated(tmp_path, grasp3d.Load(task=DOWN, torque_limits=20.0)).motors
    assert double is not None
    assert double.payload[0] == pytest.approx(2.0 * load_result.payload[0], rel=1e-6)


def test_every_pose_that_does_not_surely_hold_the_mass_says_so(tmp_path: Path) -> None:
    coarse = grasp3d.GraspModel(sensor_resolution=math.radians(60.0))
    found = evaluated(tmp_path, grasp3d.Load(task=DOWN, mass=0.1), coarse)
    assert found.label.tolist() == [Label.M, Label.U]
    assert found.reason.tolist() == [
        "surely holds 0 kg only", "no link within 5 mm of the object",
    ]  # fmt: skip


def test_torsion_is_no_part_of_what_motors_hold(tmp_path: Path) -> None:
    torsion = replace(FINE, torsion_radius=0.003)
    assert evaluated(tmp_path, None, torsion).label[0] == Label.S
    with pytest.raises(SettingError, match="takes no torsion_radius with a load"):
        evaluated(tmp_path, grasp3d.Load(task=DOWN), torsion)


def test_no_normals_that_may_be_true_hold_more_than_is_possible(tmp_path: Path) -> None:
    load = grasp3d.Load(mass=9.0, torque_limits=10.0)
    load_result = evaluated(tmp_path, load).motors
    assert load_result is not None
    random = np.random.default_rng(0)
    for _ in range(10):
        axes = ANGLE * random.random((4, 1)) * unit_rows(random.normal(size=(4, 3)))
        normals = Rotation.from_rotvec(axes).apply(load_result.sets.normals)
        tilted = replace(load_result, sets=replace(load_result.sets, normals=normals))
        held = tilted.held(tilted.sets.evaluated, np.arctan([0.5] * 4))[0].lower
        assert 0.99 * load_result.payload[0] <= held <= 1.01 * load_result.payload_most[0]


def test_sensors_too_coarse_for_the_friction_hold_nothing(tmp_path: Path) -> None:
    load_result = evaluated(tmp_path, grasp3d.Load(), replace(FINE, friction=0.05)).motors
    assert load_result is not None
    assert load_result.payload[0] == 0.0
    assert load_result.limit[0] == "what can be pressed at the contacts"


def test_numbers_of_another_load_do_not_stay_with_the_poses(tmp_path: Path) -> None:
    held = evaluated(tmp_path, grasp3d.Load(task=DOWN))
    poses = held.to_poses()
    poses = replace(poses, columns={**poses.columns, "gap_other": held.gap, "own": held.gap})
    again = grasp3d.evaluate_grasps(held.mesh, poses, FINE, hand=held.hand).to_poses()
    lost = poses.columns.keys() - again.columns.keys()
    assert {"payload", "limit", "gap_other"} <= lost
    assert "own" in again.columns


def test_torques_that_are_not_stated_are_asked_for(tmp_path: Path) -> None:
    unstated = {"torques": {"slide_0": 20.0}}
    with pytest.raises(SettingError, match="of the motor of slide_1, slide_2, slide_3: state it"):
        evaluated(tmp_path, grasp3d.Load(mass=1.0), **unstated)
    with pytest.raises(SettingError, match="of slide_0, slide_1, slide_2, slide_3: state it"):
        evaluated(tmp_path, grasp3d.Load(mass=1.0), torques={})
    found = evaluated(tmp_path, None, **unstated)
    assert found.label[0] == Label.S
    assert found.motors is None


def test_without_a_motor_no_limit_of_torques_is_taken(tmp_path: Path) -> None:
    idle = dict.fromkeys([f"slide_{k}" for k in range(4)], 0.0)
    with pytest.raises(SettingError, match="no motor that torque_limits could limit"):
        evaluated(tmp_path, grasp3d.Load(torque_limits=10.0), torques=idle)


def test_the_weight_of_links_takes_from_what_motors_hold(tmp_path: Path) -> None:
    fingers = [f"finger_{k}" for k in range(4)]
    heavy = {name: {"mass": 0.2} for name in fingers}
    down = grasp3d.Load(task="weight within 0 of -x", torque_limits=10.0)
    light = evaluated(tmp_path, down).motors
    found = evaluated(tmp_path, down, masses=heavy)
    assert light is not None
    assert found.motors is not None
    assert "is neglected: no masses" in light.link_weights
    assert found.motors.link_weights == ("the weight of the links that move, 0.8 kg, counts")
    assert found.motors.payload[0] < light.payload[0] - 0.01
    given = evaluated(tmp_path, grasp3d.Load(task="wrench 1,0,0,0,0,0"), masses=heavy)
    assert given.motors is not None
    assert "does not say where gravity acts" in given.motors.link_weights
    # A hand that is turned with the object holds what it held.
    free = evaluated(tmp_path, grasp3d.Load(torque_limits=10.0), masses=heavy).motors
    assert free is not None
    assert free.payload[0] <= found.motors.payload[0] * (1.0 + 1e-6)


@pytest.mark.parametrize("task", ["weight", "weight within 0 of -x"])
def test_motors_that_do_not_carry_the_links_are_said_to(tmp_path: Path, task: str) -> None:
    heavy = {f"finger_{k}": {"mass": 1.5} for k in range(4)}
    load = grasp3d.Load(mass=0.1, task=task, torque_limits=10.0)
    found = evaluated(tmp_path, load, masses=heavy)
    assert found.motors is not None
    assert found.motors.limit[0] == "the weight of the links"
    said = "the weight of the links alone is too much for the motors"
    assert found.reason[0].endswith(f": {said}")
    assert "its motors are too weak to hold 0.1 kg" in str(verdict_of(found))
    light = evaluated(tmp_path, load, masses={"finger_0": {"mass": 0.01}}).motors
    assert light is not None
    assert light.limit[0].startswith("slide_")


def test_two_point_contacts_are_said_to_leave_the_turn_about_their_line_free(
    tmp_path: Path,
) -> None:
    box = grasp3d.load_mesh(shapes.box(BOX), unit="m")
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
    said = "point contacts on one line leave the turn about it free"
    assert found.reason[0].endswith(f"holds 0 kg at most: {said}")
