"""The drives of hands with joints, and labels that limits of torques do not change."""

import json
import math
from pathlib import Path

import numpy as np
import pytest

import grasp3d
from grasp3d.contact.contacts import Contacts
from grasp3d.hand.articulated.actuation import actuation_of, torques_of, unstated_torques
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand
from grasp3d.quality.hand_forces.critical_angle import hand_closes
from grasp3d.quality.hand_forces.hand_grasp import HandGrasp
from tests.helpers.hands import hand_file, three_fingers


def known(name: str) -> ArticulatedHand:
    """A hand of the shared folder, with its known numbers."""
    hand = grasp3d.read_hand(hand_file(name), preset=name)
    assert isinstance(hand, ArticulatedHand)
    return hand


def test_stated_torques_drive_every_joint_both_ways() -> None:
    hand = known("allegro")
    torques = torques_of(hand)
    assert torques is not None
    assert (torques == 0.7).all()
    middle = hand.limits_of_joints.mean(axis=1)
    drives = actuation_of(hand, middle, torques)
    assert drives.two_way
    assert drives.names == hand.joint_names
    stopped = actuation_of(hand, hand.limits_of_joints[:, 1], torques)
    assert stopped.names[16:] == tuple(f"{name} at its stop" for name in hand.joint_names)
    assert (stopped.columns[:, 16:] == -np.eye(16)).all()


def test_a_differential_drives_two_joints_by_one_tendon() -> None:
    hand = known("shadow")
    assert torques_of(hand) is None
    torques = torques_of(hand, 0.5)
    assert torques is not None
    drives = actuation_of(hand, hand.limits_of_joints.mean(axis=1), torques)
    assert not drives.two_way
    assert drives.columns.shape == (24, 20)
    tendon = drives.columns[:, drives.names.index("FFJ2 and FFJ1")]
    assert [hand.joint_names[k] for k in np.flatnonzero(tendon)] == ["FFJ2", "FFJ1"]


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
    assert unstated_torques(hand) == []
    for limit, most in ((None, 0.4), (0.7, 0.7)):
        torques = torques_of(hand, limit)
        np.testing.assert_array_equal(torques, [most, most, most, np.nan, most, most])
        assert torques is not None
        drives = actuation_of(hand, np.full(6, -0.2), torques)
        assert drives.names == tuple(name for name in names if name != "bend1")
        assert np.abs(drives.undriven[:, 0]).tolist() == [0, 0, 0, 1, 0, 0]
        assert not drives.two_way
    del stated["bend1"]  # left out: its motor is not known
    path.write_text(json.dumps({**content, "torques": stated}), encoding="utf-8")
    unknown = grasp3d.read_hand(path)
    assert isinstance(unknown, ArticulatedHand)
    assert unstated_torques(unknown) == ["bend1"]
    assert torques_of(unknown) is None


@pytest.mark.slow
@pytest.mark.parametrize("name", ["allegro", "leap"])
def test_limits_of_torques_change_no_letter_of_motors_in_each_joint(name: str) -> None:
    hand, count = known(name), 5000
    torques = torques_of(hand)
    assert torques is not None
    generator = np.random.default_rng(3)
    limits = hand.limits_of_joints
    postures = generator.uniform(limits[:, 0], limits[:, 1], size=(count, len(limits)))
    links = [hand.link_names.index(tip) for tip in hand.fingertips]
    poses = hand.link_poses(postures)
    points = poses[:, links][:, :, :3, 3] + 0.01 * generator.normal(size=(count, len(links), 3))
    centre = points.mean(axis=1, keepdims=True)
    normals = centre - points + 0.02 * generator.normal(size=points.shape)
    contacts = Contacts(points - centre, normals, 0.5)
    row = np.repeat(np.arange(count), len(links))
    jacobians = hand.jacobians(poses, row, np.tile(links, count), points.reshape(-1, 3))
    jacobians = jacobians.reshape(count, len(links), 3, -1)
    critical = grasp3d.critical_friction_angle(contacts, tolerance=1e-6)
    angles = math.atan(1.0) - np.where(np.arange(count) % 2, 0.15, 0.0)
    for g in np.flatnonzero(np.abs(critical - angles) > 1e-5):
        drives = actuation_of(hand, postures[g], torques)
        grasp = HandGrasp(contacts.take(np.array([g])).reshape(()), jacobians[g], drives)
        assert hand_closes(grasp, angles[g]) == (critical[g] < angles[g])
