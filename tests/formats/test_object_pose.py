"""Poses in the frame of a robot: as text, matrix and file; written, read, and checked by hand."""

import json
import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.csv as pc
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

import grasp3d
from grasp3d.errors import ContactError
from grasp3d.formats import read_grasps, read_poses, write_grasps
from grasp3d.formats.frames import read_object_pose
from grasp3d.formats.poses import GraspPoses
from grasp3d.grasps.evaluated_poses import EvaluatedPoses
from grasp3d.hand.frames import ObjectPose
from grasp3d.settings.units import METRES
from grasp3d.surface.grasp_table import GraspTable
from tests.formats.test_pose_files import OWN, SUFFIX, equal, quaternions, some_poses
from tests.helpers import shapes

yaml = shapes.reader("yaml")

TEXT = "0.4,-0.05,0.1,90,base_link"
QUARTER = np.array(
    [[0.0, -1.0, 0.0, 0.4], [1.0, 0.0, 0.0, -0.05], [0.0, 0.0, 1.0, 0.1], [0.0, 0.0, 0.0, 1.0]]
)
"""The same as a matrix."""

FRANKA = grasp3d.read_hand("franka")


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


def test_texts_of_one_pose() -> None:
    half = math.sqrt(0.5)
    for text in (TEXT, f"0.4, -0.05, 0.1, 0, 0, {half!r}, {half!r}, base_link"):
        equal(ObjectPose.of(text).matrix, QUARTER, 1e-15)
        assert ObjectPose.of(text).frame == "base_link"
    equal(ObjectPose.of("0,0,0,0").matrix, np.eye(4), 0.0)


def test_files_of_one_pose(tmp_path: Path) -> None:
    texts = {
        "rows.txt": "\n".join(" ".join(map(repr, row)) for row in QUARTER.tolist()),
        "commas.txt": "\n".join(",".join(map(repr, row)) for row in QUARTER.tolist()) + "\n\n",
        "text.txt": f"{TEXT}\n",
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
        assert found.frame == ("base_link" if path.stem == "text" else "robot"), path.name
    (tmp_path / "pose.json").write_text(json.dumps({"position": [0.4, -0.05, 0.1]}))
    with pytest.raises(ContactError, match=r"pose\.json: must be a matrix of 4 rows; got an obj"):
        read_object_pose(tmp_path / "pose.json")


@pytest.mark.slow
@given(poses=some_poses(), pose=object_poses(), unit=st.sampled_from(["m", "mm", "in"]))
@settings(deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])
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
    # What stands in the file are other poses: those of the robot.
    plain = tmp_path / f"plain.{SUFFIX[name]}"
    write_grasps(plain, replace(back, object_pose=None), format=name)
    write_grasps(path, back, format=name)
    again = read_poses(path)
    equal(again.poses, read_poses(plain).poses, 1e-12 * size)
    assert again.object_pose == back.object_pose


@given(poses=some_poses(), pose=object_poses())
@settings(
    deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture], max_examples=25
)
def test_moveit_has_the_robots_frame_by_name(
    tmp_path: Path, poses: GraspPoses, pose: ObjectPose
) -> None:
    path = tmp_path / "robot.json"
    write_grasps(path, poses, format="moveit", object_pose=pose)
    message = json.loads(path.read_text(encoding="utf-8"))[0]["grasp_pose"]
    assert message["header"]["frame_id"] == pose.frame
    expected = (pose.matrix @ poses.poses @ poses.hand.base_pose)[0, :3, 3]  # type: ignore[union-attr]
    equal([message["pose"]["position"][axis] for axis in "xyz"], expected, 1e-12)
    back = read_poses(path, hand=poses.hand, object_pose=pose)  # type: ignore[arg-type]
    equal(back.poses, poses.poses, 1e-10)
    with pytest.raises(ContactError, match="not in that of the object"):
        read_poses(path, hand=poses.hand)  # type: ignore[arg-type]


@cache
def box() -> GraspTable:
    """Grasps of a box of 80 x 50 x 30 mm, in millimetres."""
    mesh = grasp3d.load_mesh(shapes.box((80.0, 50.0, 30.0)), unit="mm", max_edge="20mm")
    return grasp3d.best_grasps(grasp3d.label_surface(mesh, hand=FRANKA), 3)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["json", "csv"])
def test_contacts_in_the_robots_frame_are_where_the_box_stands(tmp_path: Path, suffix: str) -> None:
    grasps, path = box(), tmp_path / f"box.{suffix}"
    write_grasps(path, grasps, object_pose=TEXT)
    if suffix == "json":
        document = json.loads(path.read_text(encoding="utf-8"))
        assert document["grasp3d"]["object_pose"].endswith(",base_link")
        assert document["grasp3d"]["frame"] == "base_link"
        points = [[contact["point"] for contact in one["contacts"]] for one in document["grasps"]]
        normals = [[contact["normal"] for contact in one["contacts"]] for one in document["grasps"]]
    else:
        table = pc.read_csv(path).to_pandas()
        assert table["object_pose"].str.endswith(",base_link").all()
        each = [[f"{axis}{number}" for axis in "xyz"] for number in (1, 2)]
        points = np.stack([table[names] for names in each], axis=1)
        normals = np.stack([table[[f"n{name}" for name in names]] for names in each], axis=1)
    x, y, z = np.moveaxis(grasps.jaws.points, 2, 0)
    # A quarter turn about z, then to (0.4, -0.05, 0.1) m.
    equal(points, np.stack([0.4 - y, x - 0.05, z + 0.1], axis=2), 1e-13)
    nx, ny, nz = -np.moveaxis(grasps.jaws.normals, 2, 0)
    equal(normals, np.stack([-ny, nx, nz], axis=2), 1e-12)
    # The closing axis joins the contacts there, too.
    poses = grasps.poses_in(TEXT)
    across = np.diff(np.array(points), axis=1)[:, 0]
    equal(across / np.linalg.norm(across, axis=1, keepdims=True), poses[:, :3, 0], 1e-6)


@pytest.mark.slow
def test_poses_in_are_in_metres_whatever_the_unit(tmp_path: Path) -> None:
    grasps = box()
    in_metres = grasps.to_poses().in_unit("m").poses
    for given_pose in (TEXT, QUARTER, ObjectPose.of(TEXT)):
        equal(grasps.poses_in(given_pose), QUARTER @ in_metres, 1e-15)
        equal(grasps.to_poses().poses_in(given_pose), QUARTER @ in_metres, 1e-15)
    write_grasps(tmp_path / "box.json", grasps, object_pose=QUARTER)
    results = grasp3d.evaluate_grasps(grasps.mesh, grasps.to_poses(), hand=FRANKA)
    read = grasp3d.evaluate_grasps(grasps.mesh, read_grasps(tmp_path / "box.json"), hand=FRANKA)
    assert isinstance(read, EvaluatedPoses)
    equal(results.poses_in(TEXT), QUARTER @ in_metres, 1e-14)
    assert np.array_equal(read.label, results.label)
    equal(read.critical_angle, results.critical_angle, 1e-6)
    write_grasps(tmp_path / "results.json", read)  # in the frame that the poses were read in
    stated = json.loads((tmp_path / "results.json").read_text(encoding="utf-8"))["grasps"][0]
    equal(np.array(stated["pose"])[:3, 3], grasps.poses_in(TEXT)[0, :3, 3], 1e-12)


@pytest.mark.parametrize(
    ("matrix", "message"),
    [
        (np.diag([1.0, 1.0, -1.0, 1.0]), r"is left-handed \(determinant -1\): one axis"),
        (np.diag([1000.0] * 3 + [1.0]), "is a scale contained"),
        (np.eye(4) + 400.0 * np.eye(4, k=3), "400 m away from the robot, as if millimetres"),
    ],
)
def test_matrices_that_are_no_pose_are_refused(matrix: np.ndarray, message: str) -> None:
    with pytest.raises(ContactError, match=message):
        ObjectPose.of(matrix)


def test_a_quaternion_of_zeros_is_no_rotation() -> None:
    with pytest.raises(ContactError, match="a quaternion of length 1; got 0"):
        ObjectPose.of("1,0,0,0,0,0,0")
