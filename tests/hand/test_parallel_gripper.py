"""Descriptions of grippers: what is refused, and what follows from them."""

import math
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from grasp3d.errors import SettingError
from grasp3d.hand.choices import AXES
from grasp3d.hand.hand import touching
from grasp3d.hand.parallel_gripper import ALIASES, PRESETS, ParallelGripper
from grasp3d.settings import GraspModel

FLAT: dict[str, Any] = {
    "name": "flat",
    "max_opening": 0.08,
    "finger_thickness": 0.01,
    "finger_width": 0.02,
    "finger_length": 0.045,
    "pad_width": 0.015,
    "pad_height": 0.02,
    "palm_thickness": 0.1,
    "palm_width": 0.06,
    "palm_length": 0.05,
}
ROUND = FLAT | {"name": "round", "pad_width": 0.0, "pad_height": 0.0, "tip_radius": 0.01}


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"max_opening": 0.0}, "max_opening must be above 0"),
        ({"max_opening": 80.0}, "is it in millimetres"),
        ({"min_opening": 0.078}, "larger than the clearance on both sides"),
        ({"pad_width": 0.03}, "pad_width (0.03 m) must be at most finger_width (0.02 m)"),
        ({"palm_thickness": 0.07}, "must be at most palm_thickness (0.07 m)"),
        ({"tip_radius": 0.01}, "either flat pads"),
        ({"name": 3}, "name must be a text; got 3"),
        ({"pad_width": "2 cm"}, 'pad_width must be a number; got "2 cm"'),
        ({"inner_faces": 5}, "inner_faces must be a list of faces"),
        ({"max_force": 0.0}, "max_force must be a finite force above 0"),
        ({"joint_names": ("one",)}, "a number for each of the 1 joint_names"),
        ({"base_axes": ("x", "-x")}, "two axes at right angles"),
    ],
)
def test_impossible_grippers_are_refused(changed: dict[str, Any], words: str) -> None:
    with pytest.raises(SettingError, match=r"gripper ('flat'|3)|sensor resolution") as refused:
        ParallelGripper(**(FLAT | changed))
    assert words in str(refused.value)
    assert "\n" not in str(refused.value)


def test_fingers_thicker_than_their_round_tips_are_refused() -> None:
    with pytest.raises(SettingError, match=r"at most the diameter of the round tips, 0[.]018"):
        ParallelGripper(**(ROUND | {"tip_radius": 0.009, "finger_thickness": 0.019}))


def test_the_resolution_of_a_gripper_replaces_that_of_the_model() -> None:
    gripper = ParallelGripper(**ROUND, sensor_resolution=0.4)
    assert touching(gripper, GraspModel()).sensor_resolution == 0.4
    assert touching(ParallelGripper(**ROUND), GraspModel()) == GraspModel()


def test_the_torsion_radius_is_that_of_a_disc_of_the_area_of_the_pad() -> None:
    gripper = ParallelGripper(**FLAT)
    disc = math.sqrt(0.015 * 0.02 / math.pi)
    assert gripper.torsion_radius(0.5) == pytest.approx(2.0 / 3.0 * 0.5 * disc)
    assert ParallelGripper(**ROUND).torsion_radius(0.5) == 0.0


def test_fingers_end_at_the_pads_ends_or_the_centres_of_the_tips() -> None:
    assert ParallelGripper(**FLAT).end == 0.01
    assert ParallelGripper(**ROUND).end == 0.0


@given(st.sampled_from([(a, b) for a in AXES for b in AXES if a[-1] != b[-1]]), st.floats(0.0, 0.5))
def test_the_base_pose_takes_the_axes_of_the_hand_to_those_of_the_gripper(
    axes: tuple[str, str], length: float
) -> None:
    gripper = ParallelGripper(**FLAT, base_axes=axes, base_to_tcp=length)
    pose = gripper.base_pose
    assert np.linalg.det(pose[:3, :3]) == pytest.approx(1.0)
    closing, approach = (np.array([*AXES[name], 0.0]) for name in axes)
    assert (pose @ closing).tolist() == [1.0, 0.0, 0.0, 0.0]
    assert (pose @ approach).tolist() == [0.0, 0.0, 1.0, 0.0]
    tcp = length * np.array(AXES[axes[1]])
    assert np.allclose(pose @ [*tcp, 1.0], [0.0, 0.0, 0.0, 1.0])


PUBLISHED = {  # stroke [mm] and greatest force [N], from the data sheets
    "franka": (80, 70),
    "robotiq_2f85": (85, 235),
    "robotiq_2f140": (140, 125),
    "wsg50": (110, 80),
    "tactile": (100, 40),
}


@pytest.mark.parametrize("name", PRESETS)
def test_presets_have_the_published_stroke_and_force(name: str) -> None:
    gripper = ParallelGripper.preset(name)
    assert (round(1e3 * gripper.max_opening), gripper.max_force) == PUBLISHED[name]
    assert gripper.name == name
    assert gripper.source


@pytest.mark.parametrize("name", PRESETS)
def test_joints_close_and_open(name: str) -> None:
    """At most one metre or radian from closed to open, and the same for both fingers."""
    gripper = ParallelGripper.preset(name)
    values = [
        [closed + scale * opening for opening in (0.0, gripper.max_opening)]
        for closed, scale in zip(gripper.joint_closed, gripper.joint_scale, strict=True)
    ]
    changes = [abs(opened - closed) for closed, opened in values]
    assert all(0.0 < change < 1.0 for change in changes)
    assert np.ptp(changes or [0.0]) == pytest.approx(0.0)


def test_both_fingers_of_the_franka_hand_move_by_half_of_the_opening() -> None:
    gripper = ParallelGripper.preset("franka")
    assert gripper.joint_names == ("panda_finger_joint1", "panda_finger_joint2")
    assert gripper.joint_scale == (0.5, 0.5)
    assert gripper.base_to_tcp == 0.1034


def test_robotiq_joints_are_0_when_open() -> None:
    for name in ("robotiq_2f85", "robotiq_2f140"):
        gripper = ParallelGripper.preset(name)
        value = gripper.joint_closed[0] + gripper.joint_scale[0] * gripper.max_opening
        assert value == pytest.approx(0.0, abs=1e-12)


def test_the_tactile_gripper_has_the_tips_of_the_paper() -> None:
    gripper = ParallelGripper.preset("tactile")
    assert gripper.tip_radius == 0.01
    assert math.degrees(gripper.sensor_resolution) == pytest.approx(22.9, abs=0.05)


def test_aliases_are_other_names_of_presets() -> None:
    assert set(ALIASES.values()) <= set(PRESETS)
    assert not set(ALIASES) & set(PRESETS)
    assert ParallelGripper.preset("panda") is PRESETS["franka"]
