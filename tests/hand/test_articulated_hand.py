"""Hands with joints: their motions against MuJoCo, and Jacobians against differences."""

import importlib.util
import re
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grasp3d.arrays import Floats
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand
from grasp3d.hand.articulated.proposal import articulated_hand_of
from grasp3d.hand.robot_files import read_links
from tests.helpers.hands import HANDS, hand_file

MODELS = {"shadow model": "hand/reach.xml", "adroit": "adroit_hand/adroit_door.xml"}
"""MuJoCo models of gymnasium-robotics, below its folder of assets."""

BASES = {"adroit": "forearm (ARTz)"}
"""With the three joints that turn the forearm."""


def file_of(name: str) -> Path:
    if name in HANDS:
        return hand_file(name)
    found = importlib.util.find_spec("gymnasium_robotics")
    if found is None or found.submodule_search_locations is None:
        pytest.skip("gymnasium-robotics is not installed")
    return Path(found.submodule_search_locations[0]) / "envs/assets" / MODELS[name]


@cache
def hand_of(name: str) -> ArticulatedHand:
    """A hand with everything that moves in its file."""
    path = file_of(name)
    return articulated_hand_of(read_links(path), {"base": BASES[name]} if name in BASES else {})


def model_of(name: str, folder: Path) -> Any:
    """MuJoCo's own reading of the file."""
    mujoco = pytest.importorskip("mujoco")
    path = file_of(name)
    if name in MODELS:
        return mujoco.MjModel.from_xml_path(str(path))
    text, meshes = path.read_text(encoding="utf-8"), path.parent.as_posix()
    options = f'meshdir="{meshes}" strippath="false" balanceinertia="true" fusestatic="false"'
    changed = re.sub(r"(<robot[^>]*>)", rf"\1<mujoco><compiler {options}/></mujoco>", text, count=1)
    copy = folder / "hand.urdf"
    copy.write_text(changed, encoding="utf-8")
    return mujoco.MjModel.from_xml_path(str(copy))


def random_postures(hand: ArticulatedHand, count: int) -> Floats:
    low, high = np.clip(hand.limits_of_joints, -np.pi, np.pi).T
    return np.random.default_rng(5).uniform(low, high, (count, len(low)))


def compare_with_mujoco(name: str, folder: Path, count: int) -> None:
    mujoco = pytest.importorskip("mujoco")
    mujoco.set_mju_user_warning(lambda _: None)  # otherwise it writes a log
    hand, model = hand_of(name), model_of(name, folder)
    data = mujoco.MjData(model)
    postures = random_postures(hand, count)
    poses = hand.link_poses(postures)
    addresses = [model.joint(joint).qposadr[0] for joint in hand.joint_names]
    bodies = {model.body(number).name: number for number in range(model.nbody)}
    links = [n for n, link in enumerate(hand.link_names) if link in bodies]
    assert len(links) > 7
    numbers = [bodies[hand.link_names[link]] for link in links]
    mujoco.mj_kinematics(model, data)
    first = np.eye(4)
    first[:3, :3], first[:3, 3] = data.xmat[numbers[0]].reshape(3, 3), data.xpos[numbers[0]]
    (zero,) = hand.link_poses(np.zeros(len(hand.joint_names)))
    poses = first @ np.linalg.inv(zero[links[0]]) @ poses  # MuJoCo's are in the world's frame
    worst = 0.0
    for posture, found in zip(postures, poses, strict=True):
        data.qpos[addresses] = posture
        mujoco.mj_kinematics(model, data)
        worst = max(worst, np.abs(data.xpos[numbers] - found[links, :3, 3]).max())
        turns = data.xmat[numbers].reshape(-1, 3, 3)
        worst = max(worst, np.abs(turns - found[links, :3, :3]).max())
    assert worst < 1e-9


@pytest.mark.parametrize("name", [*HANDS, *MODELS])
def test_links_are_where_mujoco_has_them(name: str, tmp_path: Path) -> None:
    compare_with_mujoco(name, tmp_path, 20)
