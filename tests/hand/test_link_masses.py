"""Masses of links, and the torques that hold them."""

import json
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

import grasp3d
from grasp3d.errors import SettingError
from grasp3d.hand.articulated_hand import ArticulatedHand
from grasp3d.hand.link_tree import LinkMass
from tests.helpers.hands import three_fingers

INERTIAL = (
    '<inertial><origin xyz="0.001 0 0.02" rpy="0.3 0 0"/><mass value="{}"/>'
    '<inertia ixx="1" ixy="0" ixz="0" iyy="1" iyz="0" izz="1"/></inertial>'
)


def hand_of(folder: Path, mass: str = "0.03", **stated: Any) -> ArticulatedHand:
    """The hand of three fingers, whose first finger has a mass."""
    path = three_fingers(folder)
    text = path.read_text(encoding="utf-8")
    where = '<link name="outer0">'
    path.write_text(text.replace(where, where + INERTIAL.format(mass)), encoding="utf-8")
    if stated:
        content = {"format": "grasp3d articulated hand", "version": 1, "description": "three.urdf"}
        path = folder / "three.json"
        path.write_text(json.dumps({**content, **stated}), encoding="utf-8")
    hand = grasp3d.read_hand(path)
    assert isinstance(hand, ArticulatedHand)
    return hand


def test_masses_are_those_of_the_file_or_stated_ones(tmp_path: Path) -> None:
    hand = hand_of(tmp_path)
    assert hand.masses == {"outer0": LinkMass(0.03, (0.001, 0.0, 0.02))}
    written = hand.description()["masses"]
    assert written == {"outer0": {"mass": 0.03, "center": (0.001, 0.0, 0.02)}}
    assert hand_of(tmp_path, masses=written).masses == hand.masses
    assert hand_of(tmp_path, masses={}).link_loads(np.zeros((1, 6)), np.zeros((1, 7, 4, 4))) is None
    for impossible in ("0", "-1", "nan", "inf", "heavy"):
        assert hand_of(tmp_path, impossible).masses == {}


def test_torques_that_hold_links_are_changes_of_their_energy(tmp_path: Path) -> None:
    masses = {
        name: {"mass": 0.02 + 0.01 * k, "center": [0.0, 0.002 * k, 0.02]}
        for k, name in enumerate(["palm", "inner0", "outer0", "inner1", "outer2"])
    }
    hand = hand_of(tmp_path, masses=masses)
    gravity, step = np.array([3.0, -2.0, -9.0]), 1e-6

    def energy(posture: np.ndarray) -> float:
        (poses,) = hand.link_poses(posture)
        return -sum(
            one["mass"] * gravity @ (poses[hand.link_names.index(name)] @ [*one["center"], 1.0])[:3]
            for name, one in masses.items()
        )

    posture = np.random.default_rng(1).uniform(-1.0, 0.0, (2, 6))
    loads = hand.link_loads(posture, hand.link_poses(posture))
    assert loads is not None
    for row, values in enumerate(posture):
        for joint, change in enumerate(step * np.eye(6)):
            slope = (energy(values + change) - energy(values - change)) / (2.0 * step)
            assert loads[row, joint] @ gravity == pytest.approx(slope, abs=1e-7)


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
    hand = grasp3d.read_hand(path)
    assert isinstance(hand, ArticulatedHand)
    posture = np.array([[0.4, -0.7]])
    loads = hand.link_loads(posture, hand.link_poses(posture))
    assert loads is not None
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    data.qpos[:] = posture[0]
    mujoco.mj_forward(model, data)
    np.testing.assert_allclose(loads[0] @ [1.0, -2.0, -9.0], data.qfrc_bias, atol=1e-12)


@pytest.mark.parametrize(
    ("masses", "words"),
    [
        ({"outer0": {"mass": 0.0}}, "masses must be an object"),
        ({"outer0": {"mass": 0.1, "center": [0.0, 0.0]}}, "masses must be an object"),
        ({"outer0": {"mass": 0.1, "com": [0, 0, 0]}}, "masses must be an object"),
        ({"outer7": {"mass": 0.1}}, "no link is called 'outer7'"),
    ],
)
def test_impossible_masses_are_refused(tmp_path: Path, masses: Any, words: str) -> None:
    with pytest.raises(SettingError, match=words):
        hand_of(tmp_path, masses=masses)
