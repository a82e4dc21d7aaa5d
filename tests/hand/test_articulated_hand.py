"""Hands with joints: their motions against MuJoCo, and Jacobians against differences."""

import importlib.util
import re
from functools import cache
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
import pytest

from grasp3d.arrays import Floats
from grasp3d.errors import SettingError
from grasp3d.hand.articulated_hand import ArticulatedHand, Coupling
from grasp3d.hand.mujoco_model import read_links
from grasp3d.hand.proposal import articulated_hand_of
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
    mujoco.set_mju_user_warning(lambda _: None)  # otherwise it writes a log into the working folder
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


@pytest.mark.slow
@pytest.mark.parametrize("name", [*HANDS, *MODELS])
def test_links_are_where_mujoco_has_them(name: str, tmp_path: Path) -> None:
    mujoco.set_mju_user_warning(lambda _: None)  # otherwise it writes a log
    hand, model = hand_of(name), model_of(name, tmp_path)
    data = mujoco.MjData(model)
    postures = random_postures(hand, 200)
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


MJCF = """<mujoco>
 <compiler angle="radian"/>
 <worldbody>
  <body name="hand" pos="1 2 3" euler="0.3 0.2 0.1">
   <geom type="box" size="0.03 0.06 0.03"/>
   <body name="one" pos="0 0.001 0.06" euler="0.1 0.2 0.3">
    <joint name="swing" type="hinge" axis="1 2 0" pos="0.01 0.02 0.03" ref="0.4" range="-1 1"
     limited="true"/>
    <joint name="slide" type="slide" axis="0 1 1" ref="0.02" range="0 0.03" limited="true"/>
    <joint name="bend" type="hinge" axis="0 0 1" pos="0 0.02 0" range="-1 1" limited="true"/>
    <geom type="capsule" size="0.01 0.02"/>
    <body name="tip" pos="0 0 0.05">
     <joint name="last" type="hinge" axis="1 0 0" ref="-0.3"/>
     <geom type="ellipsoid" size="0.01 0.02 0.03"/>
    </body>
   </body>
  </body>
 </worldbody>
 <equality><joint joint1="last" joint2="bend" polycoef="0.1 0.5 0 0 0"/></equality>
 {more}
</mujoco>"""


def mjcf(folder: Path, more: str = "") -> Path:
    path = folder / "hand.xml"
    path.write_text(MJCF.format(more=more), encoding="utf-8")
    return path


def test_bodies_with_several_joints_away_from_their_origin(tmp_path: Path) -> None:
    path = mjcf(tmp_path)
    hand = articulated_hand_of(read_links(path))
    assert hand.joint_names == ("swing", "slide", "bend")
    model = mujoco.MjModel.from_xml_path(str(path))
    data = mujoco.MjData(model)
    data.qpos[:] = 0.3, 0.01, 0.7, -0.3 + 0.1 + 0.5 * 0.7
    mujoco.mj_kinematics(model, data)
    (poses,) = hand.link_poses([0.3, 0.01, 0.7])
    for link in ("one", "tip"):
        found = poses[hand.link_names.index(link)]
        np.testing.assert_allclose(found[:3, 3], data.body(link).xpos, atol=1e-12)
        np.testing.assert_allclose(found[:3, :3].ravel(), data.body(link).xmat, atol=1e-12)


@pytest.mark.parametrize(
    ("constraint", "words"),
    [
        ('<connect name="rod" body1="tip" body2="hand" anchor="0 0 0"/>', "rod closes a loop"),
        ('<joint name="bent" joint1="swing" joint2="bend" polycoef="0 1 1 0 0"/>', "bent closes"),
    ],
)
def test_what_is_no_tree_is_refused(tmp_path: Path, constraint: str, words: str) -> None:
    path = mjcf(tmp_path, f"<equality>{constraint}</equality>")
    with pytest.raises(SettingError, match=words):
        articulated_hand_of(read_links(path))


@pytest.mark.parametrize("name", ["allegro", "barrett", "adroit", "shadow model"])
def test_jacobians_are_differences_of_points(name: str) -> None:
    hand = hand_of(name)
    rng = np.random.default_rng(3)
    posture = random_postures(hand, 40)
    poses = hand.link_poses(posture)
    row, link = np.arange(40), rng.integers(0, len(hand.link_names), 40)
    points = rng.normal(0.0, 0.1, (40, 3))
    found = hand.jacobians(poses, row, link, points)
    local = np.linalg.solve(poses[row, link], np.c_[points, np.ones(40)][..., None])
    step = 1e-5
    for joint in range(len(hand.joint_names)):
        ends = []
        for sign in (1.0, -1.0):
            moved = posture.copy()
            moved[:, joint] += sign * step
            ends.append((hand.link_poses(moved)[row, link] @ local)[:, :3, 0])
        np.testing.assert_allclose(found[..., joint], (ends[0] - ends[1]) / (2 * step), atol=1e-7)


def test_joints_that_follow_move_with_the_one_of_the_posture() -> None:
    path = hand_file("barrett")
    medial, distal = "finger_3_med_joint", "finger_3_dist_joint"
    coupled = Coupling((medial, distal), (3.0, 1.0))
    free, hand = (
        articulated_hand_of(read_links(path), {"couplings": one}) for one in ((), (coupled,))
    )
    assert {*free.joint_names} - {*hand.joint_names} == {distal}
    posture = np.linspace(-0.6, 0.0, len(hand.joint_names))
    values = dict(zip(hand.joint_names, posture, strict=True))
    values[distal] = values[medial] / 3.0
    expected = free.link_poses([values[name] for name in free.joint_names])
    np.testing.assert_allclose(hand.link_poses(posture), expected, atol=1e-12)


@pytest.mark.parametrize(
    ("values", "words"),
    [
        (np.zeros(24), "has 16 joints, and a posture has 24 values; the joints are joint_0.0"),
        (np.full(16, np.nan), "joint_0.0 of posture 0 is nan; values of joints must be finite"),
        (np.zeros((1, 2, 16)), "has 16 joints"),
    ],
)
def test_postures_of_other_sizes_are_refused(values: Floats, words: str) -> None:
    with pytest.raises(SettingError, match=words):
        hand_of("allegro").link_poses(values)


def test_the_base_of_a_scene_is_the_hand_in_it(tmp_path: Path) -> None:
    path = mjcf(tmp_path)
    flying = path.read_text(encoding="utf-8").replace(
        '<geom type="box" size="0.03 0.06 0.03"/>',
        '<freejoint/><geom type="box" size="0.03 0.06 0.03"/>',
    )
    ball = '<body name="ball"><freejoint/><geom type="sphere" size="0.1"/></body></worldbody>'
    path.write_text(flying.replace("</worldbody>", ball), encoding="utf-8")
    hand = articulated_hand_of(read_links(path))
    assert hand.link_names[0] == "hand"
    assert "the base is hand, with most joints below it" in hand.assumed
    with pytest.raises(SettingError, match="neither slides nor turns about an axis"):
        articulated_hand_of(read_links(path), {"base": "world"})
