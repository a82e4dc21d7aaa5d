"""The drives of hands with joints."""

import json
from pathlib import Path

import numpy as np
import pytest

import grasp3d
from grasp3d.errors import SettingError
from grasp3d.hand.articulated_hand import ArticulatedHand, actuation_of, torques_of
from tests.helpers.hands import hand_file, three_fingers


def known(name: str) -> ArticulatedHand:
    """A hand of the shared folder, with its known numbers."""
    hand = grasp3d.read_hand(hand_file(name))
    assert isinstance(hand, ArticulatedHand)
    return hand


def test_stated_torques_drive_every_joint_both_ways() -> None:
    hand = known("allegro")
    torques = torques_of(hand)
    assert (torques == 0.7).all()
    middle = hand.limits_of_joints.mean(axis=1)
    drives = actuation_of(hand, middle, torques)
    assert drives.names == hand.joint_names
    assert (drives.columns == np.eye(16)).all()
    assert (drives.limits == 0.7).all()
    stopped = actuation_of(hand, hand.limits_of_joints[:, 1], torques)
    assert (stopped.columns[:, 16:] == -np.eye(16)).all()


def test_joints_that_share_tendons_have_no_motor() -> None:
    hand = known("shadow")
    torques = torques_of(hand, 0.5)
    shared = {f"{finger}J{k}" for finger in ("FF", "MF", "RF", "LF") for k in (1, 2)}
    for name, torque in zip(hand.joint_names, torques, strict=True):
        assert np.isnan(torque) if name in shared else torque == 0.5


def test_a_joint_without_a_motor_is_driven_by_none(tmp_path: Path) -> None:
    three_fingers(tmp_path, effort=0.4)
    names = [f"{part}{n}" for n in range(3) for part in ("knuckle", "bend")]
    stated = {**dict.fromkeys(names, 0.4), "bend1": 0}
    content = {"format": "grasp3d articulated hand", "version": 1, "description": "three.urdf"}
    path = tmp_path / "passive.json"
    path.write_text(json.dumps({**content, "torques": stated}), encoding="utf-8")
    hand = grasp3d.read_hand(path)
    assert isinstance(hand, ArticulatedHand)
    assert hand.description()["torques"] == stated
    for limit, most in ((None, 0.4), (0.7, 0.7)):
        torques = torques_of(hand, limit)
        np.testing.assert_array_equal(torques, [most, most, most, np.nan, most, most])
        drives = actuation_of(hand, np.full(6, -0.2), torques)
        assert drives.names == tuple(name for name in names if name != "bend1")
        assert drives.columns.any(axis=1).tolist() == [True, True, True, False, True, True]
    del stated["bend1"]  # left out: its motor is not known
    path.write_text(json.dumps({**content, "torques": stated}), encoding="utf-8")
    unknown = grasp3d.read_hand(path)
    assert isinstance(unknown, ArticulatedHand)
    with pytest.raises(SettingError, match="no torque of the motor of bend1: state it there"):
        torques_of(unknown)
