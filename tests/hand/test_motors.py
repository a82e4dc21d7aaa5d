"""What drives the joints of hands: torques that are stated, and those of models."""

import json
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import grasp3d
from grasp3d.errors import SettingError
from grasp3d.hand.articulated_hand import ArticulatedHand, actuation_of, torques_of
from grasp3d.hand.link_tree import LinkMass
from tests.helpers.hands import hand_file, three_fingers


def read(path: Path) -> ArticulatedHand:
    hand = grasp3d.read_hand(path)
    assert isinstance(hand, ArticulatedHand)
    return hand


def stating(folder: Path, **stated: Any) -> ArticulatedHand:
    """The hand of three fingers, of which more is stated."""
    content = {"format": "grasp3d articulated hand", "version": 1, "description": "three.urdf"}
    (folder / "three.json").write_text(json.dumps({**content, **stated}), encoding="utf-8")
    return read(folder / "three.json")


def test_stated_torques_drive_every_joint_both_ways() -> None:
    hand = read(hand_file("allegro"))
    torques = torques_of(hand)
    assert (torques == 0.7).all()
    middle = hand.limits_of_joints.mean(axis=1)
    drives = actuation_of(hand, middle, torques)
    assert drives.names == hand.joint_names
    assert (drives.columns == np.eye(16)).all()
    assert (drives.limits == 0.7).all()
    stopped = actuation_of(hand, hand.limits_of_joints[:, 1], torques)
    assert (stopped.columns[:, 16:] == -np.eye(16)).all()


def test_a_joint_without_a_motor_is_driven_by_none(tmp_path: Path) -> None:
    three_fingers(tmp_path, effort=0.4)
    names = [f"{part}{n}" for n in range(3) for part in ("knuckle", "bend")]
    stated = {**dict.fromkeys(names, 0.4), "bend1": 0}
    hand = stating(tmp_path, torques=stated)
    assert hand.description()["torques"] == stated
    for limit, most in ((None, 0.4), (0.7, 0.7)):
        torques = torques_of(hand, limit)
        np.testing.assert_array_equal(torques, [most, most, most, np.nan, most, most])
        drives = actuation_of(hand, np.full(6, -0.2), torques)
        assert drives.names == tuple(name for name in names if name != "bend1")
        assert drives.columns.any(axis=1).tolist() == [True, True, True, False, True, True]
    del stated["bend1"]  # left out: its motor is not known
    with pytest.raises(SettingError, match="no torque of the motor of bend1: state it there"):
        torques_of(stating(tmp_path, torques=stated))


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


def test_limits_of_what_acts_on_a_joint_are_those_of_its_motor(tmp_path: Path) -> None:
    """Not those of springs, tendons, and motors that turn it one way; a range allows no control."""
    path = tmp_path / "finger.xml"

    def torques(old: str, new: str) -> list[float]:
        text = MODEL.replace('stiffness="0.2"', "")
        assert text.count(old) == 1
        path.write_text(text.replace(old, new), encoding="utf-8")
        return np.nan_to_num(read(path).torques, nan=-1.0).tolist()

    path.write_text(MODEL, encoding="utf-8")
    spring = read(path)
    np.testing.assert_array_equal(spring.torques, [np.nan, np.nan])
    with pytest.raises(SettingError, match="no torque of the motor of knuckle, bend: state it"):
        torques_of(spring)
    np.testing.assert_array_equal(torques_of(spring, 0.2), [0.2, 0.2])
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


INERTIAL = (
    '<inertial><origin xyz="0.001 0 0.02" rpy="0.3 0 0"/><mass value="{}"/>'
    '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
)


def hand_of(folder: Path, mass: str = "0.03", **stated: Any) -> ArticulatedHand:
    path = three_fingers(folder)
    text = path.read_text(encoding="utf-8")
    where = '<link name="outer0">'
    path.write_text(text.replace(where, where + INERTIAL.format(mass)), encoding="utf-8")
    return stating(folder, **stated) if stated else read(path)


def test_masses_are_those_of_the_file_or_stated_ones(tmp_path: Path) -> None:
    hand = hand_of(tmp_path)
    assert hand.masses == {"outer0": LinkMass(0.03, (0.001, 0.0, 0.02))}
    written = hand.description()["masses"]
    assert written == {"outer0": {"mass": 0.03, "center": (0.001, 0.0, 0.02)}}
    assert hand_of(tmp_path, masses=written).masses == hand.masses
    assert hand_of(tmp_path, masses={}).link_loads(np.zeros((1, 6)), np.zeros((1, 7, 4, 4))) is None
    for impossible in ("0", "-1", "nan", "inf", "heavy"):
        assert hand_of(tmp_path, impossible).masses == {}


def test_torques_that_hold_links_of_models_are_those_of_mujoco(tmp_path: Path) -> None:
    path = tmp_path / "arm.xml"
    path.write_text(
        """<mujoco><compiler angle="radian"/><option gravity="1 -2 -9"/><worldbody>
        <body name="palm"><geom type="sphere" size="0.03"/>
         <body name="one" pos="0 0 .03"><joint name="a" axis="0 1 0" range="-1 1"/>
          <geom type="box" size=".01 .01 .02" pos="0 .01 .02"/>
          <body name="two" pos="0 0 .04" euler="0.2 0 0"><joint name="b" axis="0 1 1" range="-1 1"/>
           <geom type="box" size=".01 .01 .02" pos=".01 0 .02"/></body></body></body>
        </worldbody></mujoco>""",
        encoding="utf-8",
    )
    hand = read(path)
    posture = np.array([[0.4, -0.7]])
    loads = hand.link_loads(posture, hand.link_poses(posture))
    assert loads is not None
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    data.qpos[:] = posture[0]
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(loads[0] @ [1.0, -2.0, -9.0], data.qfrc_bias, atol=1e-12)
