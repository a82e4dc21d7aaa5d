"""Frames of grippers and robots: named ones, as text and matrices, and those that files state."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from field_tables import FRAME_SOURCES
from hypothesis import HealthCheck, assume, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import grasp3d
from grasp3d.errors import ContactError, GraspError, SettingError
from grasp3d.formats import read_poses, write_grasps
from grasp3d.formats.format import formats
from grasp3d.formats.frames import read_object_pose
from grasp3d.formats.poses import GraspPoses
from grasp3d.hand.frames import FRAMES, GripperFrame, ObjectPose
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.settings.units import METRES
from tests.formats.test_pose_files import OWN, SUFFIX, equal, quaternions, some_poses
from tests.hand.test_articulated_hand import hand_of
from tests.helpers import shapes

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
    assert PUBLISHED.keys() == FRAMES.keys() == FRAME_SOURCES.keys()


@pytest.mark.parametrize("name", PUBLISHED)
def test_every_format_is_written_and_read_in_every_frame(name: str, tmp_path: Path) -> None:
    matrix = np.array(PUBLISHED[name], dtype=float)
    same(matrix[:3, :3] @ matrix[:3, :3].T, np.eye(3))
    same(matrix @ FRAMES[name].to_tcp(FRANKA), TCP)
    for form in WRITTEN:
        path: Any = tmp_path / f"a{formats()[form].suffixes[0]}"
        write_grasps(path, poses(scores=0.5), format=form, frame=name)
        same(read_poses(path, hand=FRANKA, unit="m", frame=name).poses[0], TCP)
    write_grasps(tmp_path / "own.json", poses(), frame=name)
    same(read_poses(tmp_path / "own.json", hand=FRANKA, frame="tcp").poses[0], matrix)


def test_a_frame_needs_what_it_is_measured_with(tmp_path: Path) -> None:
    path = tmp_path / "a.csv"
    path.write_text("px,py,pz,qx,qy,qz,qw\n0,0,0,0,0,0,1\n")
    with pytest.raises(ContactError, match="'graspgen' need the lengths of a parallel gripper"):
        read_poses(path, unit="m", frame="graspgen")
    with pytest.raises(ContactError, match="in metres, but their unit is not known"):
        read_poses(path, hand=FRANKA, frame="graspgen")
    stated = path.with_name("b.csv")
    stated.write_text("px,py,pz,qx,qy,qz,qw,gripper_frame\n0,0,0,0,0,0,1,tool0\n")
    with pytest.raises(ContactError, match=r"b.csv: unknown gripper frame 'tool0'; known are tcp"):
        read_poses(stated, unit="m")
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
def test_own_files_state_their_frame_which_may_be_a_matrix(suffix: str, tmp_path: Path) -> None:
    flange = Rotation.from_euler("zy", [30, 40], degrees=True).as_matrix()
    matrix = np.block([[flange, np.array([[0.01], [0.02], [0.1]])], [np.eye(4)[3:]]])
    np.savetxt(tmp_path / "flange.txt", matrix)
    path = tmp_path / f"a.{suffix}"
    write_grasps(path, poses().in_unit("mm"), frame=tmp_path / "flange.txt")
    same(read_poses(path).in_unit("m").poses[0], TCP)
    same(read_poses(path, frame="tcp").in_unit("m").poses[0] @ matrix, TCP)
    write_grasps(path, poses().in_unit("mm"), frame="graspgen")
    found = read_poses(path, hand=FRANKA)
    same(found.in_unit("m").poses[0], TCP)
    assert str(found.gripper_frame) == "graspgen"
    write_grasps(path, found)
    assert str(read_poses(path).gripper_frame) == "tcp"


@pytest.mark.parametrize(
    ("value", "message"),
    [
        ("", "'' is not a frame itself"),
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


yaml = shapes.reader("yaml")

TEXT = "0.4,-0.05,0.1,90,base_link"
QUARTER = np.array(
    [[0.0, -1.0, 0.0, 0.4], [1.0, 0.0, 0.0, -0.05], [0.0, 0.0, 1.0, 0.1], [0.0, 0.0, 0.0, 1.0]]
)
"""The same as a matrix."""


@st.composite
def object_poses(draw: st.DrawFn) -> ObjectPose:
    x, y, z = (draw(st.floats(-3.0, 3.0)) for _ in range(3))
    return ObjectPose(
        (x, y, z), tuple(draw(quaternions())), draw(st.sampled_from(["robot", "a/b"]))
    )


@given(object_poses())
def test_the_text_of_a_pose_is_that_pose(pose: ObjectPose) -> None:
    again = ObjectPose.of(str(pose))
    equal(again.matrix, pose.matrix, 1e-14)
    assert (again.frame, ObjectPose.of(str(again))) == (pose.frame, again)
    equal(ObjectPose.of(pose.matrix).matrix, pose.matrix, 1e-14)


@given(st.floats(-180.0, 180.0))
def test_the_angle_of_a_text_turns_about_the_robots_z(yaw: float) -> None:
    expected = Rotation.from_rotvec([0.0, 0.0, math.radians(yaw)]).as_matrix()
    equal(ObjectPose.of(f"1,2,3,{yaw!r}").matrix[:3, :3], expected, 1e-12)


def test_files_of_one_pose(tmp_path: Path) -> None:
    texts = {
        "rows.txt": "\n".join(" ".join(map(repr, row)) for row in QUARTER.tolist()),
        "commas.txt": "\n".join(",".join(map(repr, row)) for row in QUARTER.tolist()) + "\n\n",
        "text.txt": f"{TEXT}\n",
        "text7.txt": f"0.4, -0.05, 0.1, 0, 0, {math.sqrt(0.5)}, {math.sqrt(0.5)}, base_link",
        "rows.json": json.dumps(QUARTER.tolist()),
        "text.json": json.dumps(TEXT),
        "rows.yaml": yaml.safe_dump(QUARTER.tolist()),
    }
    for name, text in texts.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    np.save(tmp_path / "rows.npy", QUARTER)
    for path in sorted(tmp_path.iterdir()):
        found = read_object_pose(path)
        equal(found.matrix, QUARTER, 1e-15)
        assert found.frame == ("base_link" if "text" in path.stem else "robot"), path.name
    (tmp_path / "pose.json").write_text(json.dumps({"position": [0.4, -0.05, 0.1]}))
    with pytest.raises(ContactError, match=r"pose\.json: must be a matrix of 4 rows; got an obj"):
        read_object_pose(tmp_path / "pose.json")


@pytest.mark.slow
@given(poses=some_poses(), pose=object_poses(), unit=st.sampled_from(["m", "mm", "in"]))
@settings(
    deadline=None, max_examples=25, suppress_health_check=[HealthCheck.function_scoped_fixture]
)
@pytest.mark.parametrize("name", OWN)
def test_own_formats_have_the_robots_frame_and_are_read_in_the_objects(
    tmp_path: Path, poses: GraspPoses, pose: ObjectPose, unit: Any, name: Any
) -> None:
    poses, path = poses.in_unit(unit), tmp_path / f"robot.{SUFFIX[name]}"
    write_grasps(path, poses, format=name, object_pose=pose)
    back = read_poses(path)
    size = max(1.0, float(np.abs(poses.poses).max()), 5.0 / METRES[unit])
    assert back.unit == unit
    assert back.object_pose is not None
    equal(back.object_pose.matrix, pose.matrix, 1e-14)
    equal(back.poses, poses.poses, 1e-12 * size)
    for field in ("opening", "pregrasp_opening", "scores"):
        equal(getattr(back, field), getattr(poses, field), 0.0)
    write_grasps(path, back, format=name)
    again = read_poses(path)
    equal(again.poses, poses.poses, 1e-12 * size)
    assert again.object_pose == back.object_pose


def test_moveit_has_the_robots_frame_by_name(tmp_path: Path) -> None:
    path, pose = tmp_path / "robot.json", ObjectPose.of(TEXT)
    write_grasps(path, poses(), format="moveit", object_pose=pose)
    message = json.loads(path.read_text(encoding="utf-8"))[0]["grasp_pose"]
    assert message["header"]["frame_id"] == "base_link"
    expected = (QUARTER @ TCP @ FRANKA.base_pose)[:3, 3]
    same([message["pose"]["position"][axis] for axis in "xyz"], expected)
    same(read_poses(path, hand=FRANKA, object_pose=pose).poses[0], TCP)
    with pytest.raises(ContactError, match="not in that of the object"):
        read_poses(path, hand=FRANKA)


@pytest.mark.slow
def test_contacts_in_the_robots_frame_are_where_the_box_stands(tmp_path: Path) -> None:
    mesh = grasp3d.load_mesh(shapes.box((80.0, 50.0, 30.0)), unit="mm", max_edge="20mm")
    grasps = grasp3d.best_grasps(grasp3d.label_surface(mesh, hand=FRANKA), 3)
    write_grasps(tmp_path / "box.json", grasps, object_pose=TEXT)
    document = json.loads((tmp_path / "box.json").read_text(encoding="utf-8"))
    assert document["grasp3d"]["object_pose"].endswith(",base_link")
    assert document["grasp3d"]["frame"] == "base_link"
    points = [[contact["point"] for contact in one["contacts"]] for one in document["grasps"]]
    normals = [[contact["normal"] for contact in one["contacts"]] for one in document["grasps"]]
    x, y, z = np.moveaxis(grasps.jaws.points, 2, 0)
    # A quarter turn about z, then to (0.4, -0.05, 0.1) m.
    equal(points, np.stack([0.4 - y, x - 0.05, z + 0.1], axis=2), 1e-13)
    nx, ny, nz = -np.moveaxis(grasps.jaws.normals, 2, 0)
    equal(normals, np.stack([-ny, nx, nz], axis=2), 1e-12)
    # The closing axis joins the contacts there, too.
    there = grasps.poses_in(TEXT)
    across = np.diff(np.array(points), axis=1)[:, 0]
    equal(across / np.linalg.norm(across, axis=1, keepdims=True), there[:, :3, 0], 1e-6)


@pytest.mark.parametrize(
    ("given_pose", "message"),
    [
        (np.diag([1.0, 1.0, -1.0, 1.0]), r"is left-handed \(determinant -1\): one axis"),
        (np.diag([1000.0] * 3 + [1.0]), "is a scale contained"),
        (np.eye(4) + 400.0 * np.eye(4, k=3), "400 m away from the robot, as if millimetres"),
        ("1,0,0,0,0,0,0", "a quaternion of length 1; got 0"),
    ],
)
def test_what_is_no_pose_is_refused(given_pose: Any, message: str) -> None:
    with pytest.raises(ContactError, match=message):
        ObjectPose.of(given_pose)
