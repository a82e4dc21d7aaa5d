"""Grippers that are known by name."""

import math

import numpy as np
import pytest

from grasp3d.errors import SettingError
from grasp3d.hand.parallel_gripper import ALIASES, PRESETS, ParallelGripper, preset

PUBLISHED = {  # stroke [mm] and greatest force [N], from the data sheets
    "franka": (80, 70),
    "robotiq_2f85": (85, 235),
    "robotiq_2f140": (140, 125),
    "wsg50": (110, 80),
    "tactile": (100, 40),
}


@pytest.mark.parametrize("name", PRESETS)
def test_presets_have_the_published_stroke_and_force(name: str) -> None:
    gripper = preset(name)
    assert (round(1e3 * gripper.max_opening), gripper.max_force) == PUBLISHED[name]
    assert gripper.name == name
    assert gripper.source


@pytest.mark.parametrize("name", PRESETS)
def test_joints_close_and_open(name: str) -> None:
    """At most one metre or radian from closed to open, and the same for both fingers."""
    gripper = preset(name)
    values = [
        [closed + scale * opening for opening in (0.0, gripper.max_opening)]
        for closed, scale in zip(gripper.joint_closed, gripper.joint_scale, strict=True)
    ]
    changes = [abs(opened - closed) for closed, opened in values]
    assert all(0.0 < change < 1.0 for change in changes)
    assert np.ptp(changes or [0.0]) == pytest.approx(0.0)


def test_both_fingers_of_the_franka_hand_move_by_half_of_the_opening() -> None:
    gripper = preset("franka")
    assert gripper.joint_names == ("panda_finger_joint1", "panda_finger_joint2")
    assert gripper.joint_scale == (0.5, 0.5)
    assert gripper.base_to_tcp == 0.1034


def test_robotiq_joints_are_0_when_open() -> None:
    for name in ("robotiq_2f85", "robotiq_2f140"):
        gripper = preset(name)
        value = gripper.joint_closed[0] + gripper.joint_scale[0] * gripper.max_opening
        assert value == pytest.approx(0.0, abs=1e-12)


def test_the_tactile_gripper_has_the_tips_of_the_paper() -> None:
    gripper = preset("tactile")
    assert gripper.tip_radius == 0.01
    assert gripper.resolution is not None
    assert math.degrees(gripper.resolution) == pytest.approx(22.9, abs=0.05)


def test_unknown_presets_list_the_known_ones() -> None:
    known = "known: franka (panda), robotiq_2f85, robotiq_2f140, wsg50, tactile"
    with pytest.raises(SettingError) as refused:
        ParallelGripper.preset("nope")
    assert str(refused.value) == f"no gripper is called 'nope'; {known}"
    with pytest.raises(SettingError, match="did you mean robotiq_2f85"):
        preset("robotiq_2f86")


def test_aliases_are_other_names_of_presets() -> None:
    assert set(ALIASES.values()) <= set(PRESETS)
    assert not set(ALIASES) & set(PRESETS)
    assert preset("panda") is PRESETS["franka"]
