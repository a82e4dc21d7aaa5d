"""Frames of grippers: named conventions, frames as text, and poses that files have in them."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from field_tables import FRAME_SOURCES
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from grasp3d.errors import ContactError, GraspError, SettingError
from grasp3d.formats import read_poses, write_grasps
from grasp3d.formats.format import formats
from grasp3d.formats.poses import GraspPoses
from grasp3d.hand.frames import FRAMES, GripperFrame
from grasp3d.hand.parallel_gripper import ParallelGripper
from tests.hand.test_articulated_hand import hand_of

FRANKA = ParallelGripper.preset("franka")
WRITTEN = [name for name, form in formats().items() if form.hands != ("articulated",)]

TCP = [[0, 1, 0, 0.1], [1, 0, 0, 0.2], [0, 0, -1, 0.3], [0, 0, 0, 1]]
"""From above onto an object, the jaws along its y: the pose that all of these files have."""

BASE, ENDS, HALF = 0.3 + 0.1034, 0.3 - 0.0088, math.sqrt(0.5)
"""Heights of the hand's base and of the fingers' ends there; cosine of 45 degrees."""

Z_X = [[0, 1, 0, 0.1], [1, 0, 0, 0.2], [0, 0, -1, BASE], [0, 0, 0, 1]]
Z_Y = [[1, 0, 0, 0.1], [0, -1, 0, 0.2], [0, 0, -1, BASE], [0, 0, 0, 1]]
PUBLISHED: dict[str, list[list[float]]] = {
    "tcp": TCP,
    # x and z of GraspGen's and ACRONYM's frame close and approach.
    "graspgen": Z_X,
    "acronym": Z_X,
    "robotiq_85_base_link": Z_X,
    # Franka's fingers open along y of its hand.
    "hand": Z_Y,
    "isaac": Z_Y,
    "moveit": Z_Y,
    "panda_hand": Z_Y,
    "panda_hand_tcp": [[1, 0, 0, 0.1], [0, -1, 0, 0.2], [0, 0, -1, 0.3], [0, 0, 0, 1]],
    # The hand is turned by -45 degrees about the flange's z.
    "panda_link8": [
        [HALF, -HALF, 0, 0.1], [-HALF, -HALF, 0, 0.2], [0, 0, -1, BASE], [0, 0, 0, 1],
    ],
    # x approaches, y closes.
    "graspnetapi": [[0, 0, 1, 0.1], [0, 1, 0, 0.2], [-1, 0, 0, ENDS + 0.02], [0, 0, 0, 1]],
    "dexnet": [[0, 0, 1, 0.1], [0, 1, 0, 0.2], [-1, 0, 0, 0.3], [0, 0, 0, 1]],
    "gpd": [[0, 0, 1, 0.1], [0, 1, 0, 0.2], [-1, 0, 0, ENDS + 0.06], [0, 0, 0, 1]],
    # Approached from the side that z points to.
    "burg": [[0, -1, 0, 0.1], [1, 0, 0, 0.2], [0, 0, 1, ENDS], [0, 0, 0, 1]],
    "robotiq_arg2f_base_link": [
        [-1, 0, 0, 0.1], [0, 1, 0, 0.2], [0, 0, -1, BASE], [0, 0, 0, 1],
    ],
}  # fmt: skip
"""Poses of the Franka hand by hand, from what each program's documentation says of its frame."""


def same(one: Any, other: Any) -> None:
    np.testing.assert_allclose(one, other, rtol=0.0, atol=1e-12)


def poses(matrix: Any = TCP, **values: Any) -> GraspPoses:
    return GraspPoses(poses=matrix, unit="m", hand=FRANKA, outcome=1.0, **values)


def test_every_named_frame_is_published() -> None:
    assert PUBLISHED.keys() == FRAMES.keys()
    assert FRAME_SOURCES.keys() == FRAMES.keys()
    assert all(used_by and source for used_by, source in FRAME_SOURCES.values())


@pytest.mark.parametrize("name", PUBLISHED)
def test_a_pose_in_every_named_frame_is_the_same_pose(name: str, tmp_path: Path) -> None:
    matrix = np.array(PUBLISHED[name], dtype=float)
    same(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3))
    same(matrix @ FRAMES[name].to_tcp(FRANKA), TCP)
    write_grasps(tmp_path / "own.json", poses(matrix))  # as if it were the TCP's
    same(read_poses(tmp_path / "own.json", frame=name).poses[0], TCP)


@pytest.mark.parametrize("format_name", WRITTEN)
@pytest.mark.parametrize("name", PUBLISHED)
def test_every_writer_has_every_frame(name: str, format_name: Any, tmp_path: Path) -> None:
    path = tmp_path / f"a{formats()[format_name].suffixes[0]}"
    write_grasps(path, poses(scores=0.5), format=format_name, frame=name)
    found = read_poses(path, hand=FRANKA, unit="m", frame=name)
    same(found.poses[0], TCP)
    if format_name == "json":
        as_written = read_poses(path, hand=FRANKA, frame="tcp").poses[0]
        same(as_written, PUBLISHED[name])


@pytest.mark.parametrize("suffix", ["json", "csv", "parquet"])
def test_own_files_state_their_frame(suffix: str, tmp_path: Path) -> None:
    path = tmp_path / f"a.{suffix}"
    write_grasps(path, poses().in_unit("mm"), frame="graspgen")
    found = read_poses(path, hand=FRANKA)
    same(found.in_unit("m").poses[0], TCP)
    assert str(found.gripper_frame) == "graspgen"
    write_grasps(path, found)
    assert str(read_poses(path).gripper_frame) == "tcp"


def test_own_files_name_an_unknown_frame(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    rows = "px,py,pz,qx,qy,qz,qw,gripper_frame\n0,0,0,0,0,0,1,tool0\n"
    path.write_text(rows)
    with pytest.raises(ContactError, match=r"a.csv: unknown gripper frame 'tool0'; known are tcp"):
        read_poses(path, unit="m")
    same(read_poses(path, unit="m", frame="dexnet").poses[0, :3, 2], [1, 0, 0])


def test_a_frame_needs_what_it_is_measured_with(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("px,py,pz,qx,qy,qz,qw\n0,0,0,0,0,0,1\n")
    with pytest.raises(ContactError, match="'graspgen' need the lengths of a parallel gripper"):
        read_poses(path, unit="m", frame="graspgen")
    with pytest.raises(ContactError, match="in metres, but their unit is not known"):
        read_poses(path, hand=FRANKA, frame="graspgen")
    ahead = [[0, 0, 1, 0.02], [0, 1, 0, 0], [-1, 0, 0, 0], [0, 0, 0, 1]]
    found = read_poses(path, unit="mm", frame=ahead)
    same(found.poses[0, :3], [[0, 0, 1, 20], [0, 1, 0, 0], [-1, 0, 0, 0]])


@given(st.tuples(*[st.floats(-1.0, 1.0)] * 4), st.tuples(*[st.floats(-0.5, 0.5)] * 3))
def test_a_frame_is_read_from_its_own_text(
    quaternion: tuple[float, ...], place: tuple[float, ...]
) -> None:
    assume(np.linalg.norm(quaternion) > 0.1)
    matrix = np.eye(4)
    matrix[:3, :3] = Rotation.from_quat(quaternion).as_matrix()
    matrix[:3, 3] = place
    frame = GripperFrame.of(matrix)
    assert GripperFrame.of(str(frame)) == frame
    same(frame.to_tcp(None), matrix)


@pytest.mark.parametrize("suffix", ["json", "csv", "parquet"])
def test_own_files_have_a_frame_that_is_a_matrix(suffix: str, tmp_path: Path) -> None:
    flange = Rotation.from_euler("zy", [30, 40], degrees=True).as_matrix()
    matrix = np.block([[flange, np.array([[0.01], [0.02], [0.1]])], [np.eye(4)[3:]]])
    np.savetxt(tmp_path / "flange.txt", matrix)
    path = tmp_path / f"a.{suffix}"
    write_grasps(path, poses().in_unit("mm"), frame=tmp_path / "flange.txt")
    same(read_poses(path).in_unit("m").poses[0], TCP)
    in_file = read_poses(path, frame="tcp").in_unit("m")
    same(in_file.poses[0] @ matrix, TCP)
    write_grasps(path, in_file)
    same(read_poses(path, frame=matrix).in_unit("m").poses[0], TCP)


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("", "'' is no frame of its own"),
        (np.diag([1.0, 1.0, -1.0, 1.0]), "left-handed"),
        (np.eye(4) + 103.4 * np.eye(4, k=3), "at most 1 m from the origin .* is in metres"),
    ],
)
def test_what_is_no_frame_is_refused(value: Any, message: str) -> None:
    with pytest.raises((GraspError, ValueError), match=message):
        GripperFrame.of(value)


def test_links_of_hands_with_joints_are_frames() -> None:
    shadow = hand_of("shadow")
    frame = GripperFrame.of("palm")
    assert str(frame) == "palm"
    (links,) = shadow.link_poses(np.zeros((1, 24)))
    same(np.linalg.inv(frame.to_tcp(shadow)), links[shadow.link_names.index("palm")])
    same(GripperFrame.of("hand").to_tcp(shadow), np.eye(4))
    for hand, known in ((None, "robotiq_85_base_link; or a file"), (shadow, "the links of shadow")):
        with pytest.raises(SettingError, match=f"unknown gripper frame 'pam'; known .*{known}"):
            GripperFrame.of("pam").to_tcp(hand)
