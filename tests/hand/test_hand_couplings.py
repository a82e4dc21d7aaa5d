"""Couplings of joints, and what moves joints in models: motors, tendons and springs."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from scipy.optimize import linprog

import grasp3d
from grasp3d.arrays import Floats
from grasp3d.errors import SettingError
from grasp3d.hand.articulated_hand import ArticulatedHand, actuation_of, torques_of
from grasp3d.quality import Actuation
from tests.helpers.hands import FINGER

HEAD = {"format": "grasp3d articulated hand", "version": 1, "description": "two.urdf"}
POSTURE = np.array([-0.1, -0.2] * 2)


def hand_of(folder: Path, **stated: Any) -> ArticulatedHand:
    """Two opposite fingers of two parallel joints each, with what a description states."""
    box = '<box size="0.01 0.01 0.04"/>'
    fingers = [
        FINGER.format(n=n, x=x, y=0.0, yaw=yaw, shape=box, kind="revolute", effort=0.4)
        for n, (x, yaw) in enumerate([(0.03, 0.0), (-0.03, math.pi)])
    ]
    palm = '<link name="palm"><collision><geometry><sphere radius="0.01"/></geometry></collision>'
    text = f'<robot name="two">{palm}</link>{"".join(fingers)}</robot>'
    (folder / "two.urdf").write_text(text, encoding="utf-8")
    path = folder / "two.json"
    path.write_text(json.dumps({**HEAD, **stated}), encoding="utf-8")
    hand = grasp3d.read_hand(path)
    assert isinstance(hand, ArticulatedHand)
    return hand


def drives_of(hand: ArticulatedHand, posture: Floats = POSTURE) -> Actuation:
    """Its drives in a posture."""
    return actuation_of(hand, posture, torques_of(hand))


def tip_of(hand: ArticulatedHand, finger: int) -> tuple[Floats, Floats]:
    """Where a fingertip is, and its Jacobian (3, p)."""
    posture = POSTURE[: len(hand.joint_names)]
    poses = hand.link_poses(posture)
    link = hand.link_names.index(f"outer{finger}")
    tip = poses[0, link, :3, 3] + 0.03 * poses[0, link, :3, 2]
    return tip, hand.jacobians(poses, np.array([0]), np.array([link]), tip)[0]


def presses(hand: ArticulatedHand, force: Floats) -> bool:
    """Whether the drives press a force with the first fingertip, and nothing with the other."""
    drives = drives_of(hand, POSTURE[: len(hand.joint_names)])
    torques = tip_of(hand, 0)[1].T @ force
    limits = [(-most, most) for most in drives.limits.tolist()]
    none = np.zeros(len(limits))
    found = linprog(none, A_eq=drives.columns, b_eq=torques, bounds=limits)
    return found.status == 0


def test_structure_carries_what_the_motor_of_coupled_joints_does_not(tmp_path: Path) -> None:
    """A coupled pair presses anywhere; without its motor the second joint bears nothing."""
    pair = {"joints": ["knuckle0", "bend0"], "ratios": [1, 1]}
    coupled = hand_of(tmp_path, couplings=[pair])
    torques = {"knuckle0": 0.4, "bend0": 0.0, "knuckle1": 0.4, "bend1": 0.4}
    passive = hand_of(tmp_path, torques=torques)
    (poses,) = passive.link_poses(POSTURE)
    inner, outer = (poses[passive.link_names.index(name), :3, 3] for name in ("inner0", "outer0"))
    along = (outer - inner) / np.linalg.norm(outer - inner)
    across = np.cross(along, [0.0, 1.0, 0.0])
    for force in (along, across, -across, np.array([0.0, 1.0, 0.0])):
        assert presses(coupled, force)
    assert presses(passive, np.array([0.0, 1.0, 0.0]))
    assert not presses(passive, across)


MODEL = """<mujoco model="finger"><compiler angle="radian"/><worldbody>
 <body name="palm"><geom type="sphere" size="0.01"/>
  <body name="inner"><joint name="knuckle" axis="0 1 0" range="-1 1" stiffness="0.2"
    springref="0.3"/><geom type="box" size=".005 .005 .02" pos="0 0 .02"/>
   <site name="a"/><body name="outer" pos="0 0 .04"><site name="b" pos="0 0 .03"/>
    <joint name="bend" axis="0 1 0" range="-1 1" frictionloss="1"/>
    <geom type="box" size=".005 .005 .015" pos="0 0 .015"/></body></body></body></worldbody>
 <tendon><fixed name="t"><joint joint="knuckle" coef="-0.01"/><joint joint="bend" coef="-0.006"/>
  </fixed><spatial name="s"><site site="a"/><site site="b"/></spatial></tendon>
 <actuator><motor name="flexor" tendon="t" gear="2" ctrlrange="-15 0" ctrllimited="true"/>
  <motor name="extensor" joint="bend" gear="0.5" forcerange="0.1 0.4" forcelimited="true"/>
  <motor name="along sites" tendon="s"/>
  <motor name="both" joint="knuckle" forcerange="-0.3 0.3" forcelimited="true"/></actuator>
</mujoco>"""


def test_torques_of_springs_tendons_and_motors_of_one_way_are_not_stated(tmp_path: Path) -> None:
    path = tmp_path / "finger.xml"
    path.write_text(MODEL, encoding="utf-8")
    hand = grasp3d.read_hand(path)
    assert isinstance(hand, ArticulatedHand)
    np.testing.assert_array_equal(hand.torques, [np.nan, np.nan])
    with pytest.raises(SettingError, match="no torque of the motor of knuckle, bend: state it"):
        torques_of(hand)
    np.testing.assert_array_equal(torques_of(hand, 0.2), [0.2, 0.2])


def test_limits_of_what_acts_on_a_joint_are_those_of_its_motor(tmp_path: Path) -> None:
    """But not where the motor turns it one way only; a range of forces allows no control."""
    path = tmp_path / "finger.xml"

    def torques(old: str, new: str) -> list[float]:
        text = MODEL.replace('stiffness="0.2"', "")
        assert text.count(old) == 1
        path.write_text(text.replace(old, new), encoding="utf-8")
        hand = grasp3d.read_hand(path)
        assert isinstance(hand, ArticulatedHand)
        return np.nan_to_num(hand.torques, nan=-1.0).tolist()

    limit = 'actuatorfrcrange="-0.4 0.4" actuatorfrclimited="true" name='
    assert torques('name="bend"', limit + '"bend"') == [0.3, -1.0]
    assert torques('name="knuckle"', limit + '"knuckle"') == [0.4, -1.0]
    one_way = 'forcerange="0.1 0.4" forcelimited="true"'
    assert torques(one_way, 'forcerange="-0.1 0.4" forcelimited="true"') == [0.3, 0.2]
    control = 'ctrlrange="0 1" ctrllimited="true"'
    assert torques(one_way, f'{control} forcerange="-1 1" forcelimited="true"') == [0.3, -1.0]
    both = 'joint="knuckle" forcerange="-0.3 0.3"'
    small = both + ' ctrlrange="-0.2 0.1" ctrllimited="true"'
    assert torques(both, small) == [0.2, -1.0]
