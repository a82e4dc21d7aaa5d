"""Every format of grasp poses: written and read, read from its documented layout, and damaged."""

import json
import math
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from scipy.spatial import cKDTree
from scipy.spatial.transform import Rotation

from grasp3d import load_mesh
from grasp3d.errors import ContactError, FileUnreadError, GraspError, OutputError
from grasp3d.formats import holds_poses, read_poses, write_grasps
from grasp3d.formats.checks import numbers
from grasp3d.formats.own import read_contacts
from grasp3d.formats.poses import GraspPoses
from grasp3d.hand.pose_checks import pose_warning
from grasp3d.settings.units import METRES, Unit
from grasp3d.system import limited_reading
from tests.helpers import grippers, shapes

h5py = shapes.reader("h5py")
yaml = shapes.reader("yaml")

HAND = replace(
    grippers.HAND,
    name="two_fingers",
    pad_height=0.016,
    base_to_tcp=0.1034,
    joint_names=("panda_finger_joint1", "panda_finger_joint2"),
    joint_scale=(0.5, 0.5),
    joint_closed=(0.0, 0.0),
    max_force=70.0,
)

NO_JOINTS = replace(HAND, joint_names=(), joint_scale=(), joint_closed=())

PANDA = replace(HAND, base_axes=("-y", "z"))
"""Fingers that move along y of the hand's own frame, as in its robot description."""

SUFFIX = {
    "json": "json", "csv": "csv", "parquet": "parquet", "isaac_grasp": "yaml", "acronym": "h5",
    "graspgen": "json", "graspnet": "npy", "moveit": "json",
}  # fmt: skip
OWN = ("json", "csv", "parquet")

FINITE = st.floats(-10.0, 10.0)
HALF_TURNS = [
    [1.0, 0.0, 0.0, 0.0], [0.0, 1.0, 0.0, 0.0], [0.0, 0.0, 1.0, 0.0], [0.0, 0.0, 0.0, 1.0],
    [math.sqrt(0.5), math.sqrt(0.5), 0.0, 0.0], [0.6, 0.0, 0.8, 0.0], [1.0, 0.0, 0.0, 1e-9],
]  # fmt: skip
"""No turn, and turns by 180 degrees, where quaternions have two signs."""


@st.composite
def quaternions(draw: st.DrawFn) -> list[float]:
    if draw(st.booleans()):
        return draw(st.sampled_from(HALF_TURNS))
    numbers = np.array(draw(st.lists(st.floats(-1.0, 1.0), min_size=4, max_size=4)))
    length = np.linalg.norm(numbers)
    return (numbers / length).tolist() if length > 0.1 else HALF_TURNS[0]


@st.composite
def some_poses(draw: st.DrawFn, *, known: bool = False) -> GraspPoses:
    """Poses of the hand; known: no number of them is nan."""
    count = draw(st.integers(1, 4))

    def each(values: st.SearchStrategy[float]) -> list[float]:
        either = values if known else values | st.just(math.nan)
        return draw(st.lists(either, min_size=count, max_size=count))

    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.from_quat([draw(quaternions()) for _ in range(count)]).as_matrix()
    poses[:, :3, 3] = [[draw(FINITE) for _ in range(3)] for _ in range(count)]
    words = st.text("abcXYZé_ -", min_size=1, max_size=6).map(lambda word: f"g{word}g")
    contacts = np.arange(6.0 * count).reshape(count, 2, 3)
    return GraspPoses(
        poses=poses,
        opening=each(st.floats(0.0, 0.08)),
        pregrasp_opening=each(st.floats(0.0, 0.08)),
        scores=each(st.floats(0.0, 1.0)),
        outcome=each(st.sampled_from([0.0, 1.0])),
        names=tuple(draw(st.lists(words, min_size=count, max_size=count, unique=True))),
        unit="m",
        hand=PANDA,
        columns={
            "label": np.array(["S", "M", "U", "S"])[:count],
            "critical_angle": np.linspace(0.1, 0.4, count),
            "contacts": contacts,
            "normals": contacts / 100.0 - 0.05,
        },
        settings={"friction": 0.5},
        object_file="cups/mug.obj",
        object_scale=draw(st.sampled_from([None, 0.002])),
    )


def there_and_back(folder: Path, poses: GraspPoses, name: Any) -> GraspPoses:
    path = folder / f"poses.{SUFFIX[name]}"
    write_grasps(path, poses, format=name)
    return read_poses(path, hand=None if name in OWN else poses.hand)


def equal(one: Any, other: Any, tolerance: float = 1e-9) -> None:
    np.testing.assert_allclose(one, other, rtol=0.0, atol=tolerance)


SHARED_FOLDER = settings(
    max_examples=25, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


FIELDS = ("poses", "opening", "pregrasp_opening", "scores", "outcome")
LOST = {
    "isaac_grasp": {"outcome"}, "moveit": {"outcome"}, "graspnet": {"outcome", "opening"},
    "graspgen": {"opening", "pregrasp_opening", "scores"},
    "acronym": {"opening", "pregrasp_opening", "scores"},
}  # fmt: skip
"""Numbers that a format does not have."""


@pytest.mark.slow
@pytest.mark.parametrize("name", list(SUFFIX))
@SHARED_FOLDER
@given(data=st.data())
def test_what_a_format_has_returns_in_any_unit_and_frame(
    name: str, data: st.DataObject, tmp_path: Path
) -> None:
    poses = data.draw(some_poses(known=name in {"graspgen", "graspnet"}))
    unit = data.draw(st.sampled_from(get_args(Unit)))
    axes = data.draw(st.sampled_from([("x", "z"), ("-y", "z"), ("z", "-x")]))
    poses = replace(poses, hand=replace(HAND, base_axes=axes))
    found = there_and_back(tmp_path, poses.in_unit(unit), name)
    assert found.unit == (unit if name in OWN else "m")
    assert found.hand == (None if name == "csv" else poses.hand)
    if name in {"graspnet", "graspgen", "acronym"}:
        assert found.names == tuple(f"grasp_{k + 1}" for k in range(poses.count))
    else:
        assert found.names == poses.names
    lost = LOST.get(name, set())
    found = found.in_unit("m")
    for field in FIELDS:
        expected = getattr(poses, field)
        if name == "moveit" and field == "scores":  # a plain number
            expected = np.nan_to_num(expected)
        equal(getattr(found, field), np.full(poses.count, np.nan) if field in lost else expected)
    if name in OWN:
        assert set(found.columns) == {"label", "critical_angle"}
        assert found.columns["label"].tolist() == poses.columns["label"].tolist()
        equal(found.columns["critical_angle"], poses.columns["critical_angle"])
    if name in {"json", "parquet", "acronym", "graspgen"}:
        assert found.object_file == "cups/mug.obj"
    if name in {"json", "parquet"}:
        assert found.settings == poses.settings
    if name in {"acronym", "graspgen", "isaac_grasp"}:  # else the numbers are those of the mesh
        assert found.object_scale == (poses.object_scale or METRES[unit])
    elif name in {"json", "parquet"}:
        assert found.object_scale == poses.object_scale


def one_pose(**fields: Any) -> GraspPoses:
    """TCP at (1, 2, 3) cm, approach along -y, closing along x."""
    pose = np.eye(4)
    pose[:3, :3] = np.column_stack([[1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, -1.0, 0.0]])
    pose[:3, 3] = [0.01, 0.02, 0.03]
    values = {"poses": pose, "opening": 0.03, "pregrasp_opening": 0.06, "unit": "m", "hand": HAND}
    return GraspPoses(**{**values, **fields})


BASE = [0.01, 0.02 + 0.1034, 0.03]
"""Where the hand's base of `one_pose` is."""


def test_poses_of_robots_are_those_of_the_frame_of_its_description(tmp_path: Path) -> None:
    """The fingers of the Franka hand move along y of its own frame; data sets turn it to x."""
    poses = one_pose(hand=PANDA, outcome=1.0)
    rotation = poses.poses[0, :3, :3]
    write_grasps(tmp_path / "one.yaml", poses)
    content = yaml.safe_load((tmp_path / "one.yaml").read_text())
    assert [content["format"], content["format_version"]] == ["isaac_grasp", 1.0]
    assert content["gripper_frame_link"] == "two_fingers"
    turn = content["grasps"]["grasp_1"]["orientation"]
    hand = Rotation.from_quat([*turn["xyz"], turn["w"]]).as_matrix()
    equal(hand[:, 1], -rotation[:, 0])
    equal(hand[:, 2], rotation[:, 2])
    write_grasps(tmp_path / "two.json", poses, format="graspgen")
    transform = json.loads((tmp_path / "two.json").read_text())["grasps"]["transforms"][0]
    equal(np.array(transform)[:3, :3], rotation)


ISAAC = """
format: isaac_grasp
format_version: 1.0
object_frame: /World/cup
gripper_frame: /World/hand
grasps:
  "first":
    confidence: 0.5
    position: [0.1, -0.2, 3e-1]
    orientation: {w: 0.70711, xyz: [0.70711, 0.0, 0.0]}
    cspace_position:
      panda_finger_joint1: 0.0125
    pregrasp_cspace_position:
      panda_finger_joint1: 4e-2
  "second":
    confidence: 1
    position: [0, 0, 0]
    orientation: {w: 0, xyz: [0, 1, 0]}
    cspace_position: {panda_finger_joint1: -0.0001}
"""


def test_isaac_grasp_is_read_from_its_documented_layout(tmp_path: Path) -> None:
    (tmp_path / "cup.yml").write_text(ISAAC)
    found = read_poses(tmp_path / "cup.yml", hand=HAND)
    assert found.names == ("first", "second")
    equal(found.scores, [0.5, 1.0])
    equal(found.opening, [0.025, 0.0])
    equal(found.pregrasp_opening, [0.08, math.nan])
    # Turned by 90 degrees about x: the approach, z, is along -y of the object.
    equal(found.poses[0, :3, 2], [0.0, -1.0, 0.0])
    equal(found.poses[0, :3, 3], [0.1, -0.2 - 0.1034, 0.3])
    # Turned by 180 degrees about y.
    equal(found.poses[1, :3, :3], np.diag([-1.0, 1.0, -1.0]))
    equal(found.poses[1, :3, 3], [0.0, 0.0, -0.1034])
    assert found.settings["object_frame_link"] == "/World/cup"


def test_isaac_grasp_of_programs_that_write_anchors_and_what_the_object_is(tmp_path: Path) -> None:
    opened = {"panda_finger_joint1": 0.04}
    grasp = {
        "position": [0.0, 0.0, 0.0], "orientation": {"w": 1.0, "xyz": [0.0, 0.0, 0.0]},
        "cspace_position": opened, "pregrasp_cspace_position": opened,
    }  # fmt: skip
    content = {
        "format": "isaac_grasp", "format_version": "1.0", "object_file": "mug.obj",
        "object_scale": 0.01, "grasps": {"a": grasp | {"confidence": math.nan}, 7: grasp},
    }  # fmt: skip
    (tmp_path / "cup.yaml").write_text(yaml.safe_dump(content))
    assert "&id" in (tmp_path / "cup.yaml").read_text()
    found = read_poses(tmp_path / "cup.yaml", hand=HAND)
    assert found.names == ("a", "7")
    equal(found.opening, [0.08, 0.08])
    assert (found.object_file, found.object_scale) == ("mug.obj", 0.01)


HUGE = object()
"""Stands for transforms of a declared shape that no memory holds."""


def write_acronym_by_hand(path: Path, **changes: Any) -> np.ndarray:
    """A file with the layout of the data set; returns the poses of the hand's base."""
    transforms = np.tile(np.eye(4), (3, 1, 1))
    transforms[1, :3, :3] = Rotation.from_rotvec([0.0, math.pi, 0.0]).as_matrix()
    transforms[2, :3, :3] = Rotation.from_rotvec([math.pi / 2.0, 0.0, 0.0]).as_matrix()
    transforms[:, :3, 3] = [[0.1, 0.2, 0.3], [0.0, 0.0, 0.0], [-0.1, 0.0, 0.5]]
    content = {
        "grasps/transforms": transforms,
        "grasps/qualities/flex/object_in_gripper": np.array([1, 0, 1]),
        "gripper/type": "panda",
        "object/com": np.array([0.0, 0.01, 0.02]),
        "object/file": "meshes/Mug/abc.obj",
        "object/friction": 1.0,
        "object/mass": 0.2,
        "object/scale": 0.00027,
        **changes,
    }
    with h5py.File(path, "w") as file:
        for name, value in content.items():
            if value is HUGE:
                file.create_dataset(name, (10**9, 4, 4), dtype="f8", chunks=(1, 4, 4))
            elif value is not None:
                file[name] = value
    return transforms


def test_acronym_is_read_from_its_documented_layout(tmp_path: Path) -> None:
    bases = write_acronym_by_hand(tmp_path / "mug.h5")
    found = read_poses(tmp_path / "mug.h5")
    equal(found.poses[:, :3, 3], bases[:, :3, 3] + 0.105 * bases[:, :3, 2])
    equal(found.poses[:, :3, :3], bases[:, :3, :3])
    assert found.outcome.tolist() == [1.0, 0.0, 1.0]
    assert (found.unit, found.object_file, found.object_scale) == (
        "m", "meshes/Mug/abc.obj", 0.00027,
    )  # fmt: skip
    assert found.settings["mass"] == 0.2
    assert found.settings["com"] == [0.0, 0.01, 0.02]
    assert found.hand == "panda"
    equal(
        read_poses(tmp_path / "mug.h5", hand=HAND).poses[:, :3, 3],
        bases[:, :3, 3] + 0.1034 * bases[:, :3, 2],
    )
    with h5py.File(tmp_path / "mug.h5", "a") as file:
        file["gripper/base_to_tcp"] = [0.1, 0.2]
    assert read_poses(tmp_path / "mug.h5", hand=HAND).count == 3  # where it is not needed
    with pytest.raises(ContactError, match=r"gripper/base_to_tcp must be a data set of shape \(\)"):
        read_poses(tmp_path / "mug.h5")


def test_a_published_file_of_acronym_is_read() -> None:
    (path,) = shapes.shared("datasets", "acronym").glob("Mug*.h5")
    found = read_poses(path)
    assert found.count == 2000
    assert found.outcome.mean() == pytest.approx(0.645, abs=5e-4)
    mesh = path.parent / "10f6e09036350e92b3f21f1137c3c347.obj"
    lines = [line.split() for line in mesh.read_text().splitlines() if line.startswith("v ")]
    vertices = np.array(lines)[:, 1:4].astype(float) * found.object_scale
    # The TCPs are at the surface, and the gripper is outside it and approach it.
    distances, _ = cKDTree(vertices).query(found.poses[:, :3, 3])
    assert np.median(distances) < 0.01
    assert distances.max() < 0.04
    surface = load_mesh(mesh, max_edge=1e9).scaled(found.object_scale)
    assert pose_warning(found.poses, surface) is None
    wrong = read_poses(path, hand=replace(HAND, base_to_tcp=0.0)).poses[:, :3, 3]
    assert cKDTree(vertices).query(wrong)[0].min() > 0.05


def test_graspgen_is_read_from_its_documented_layout(tmp_path: Path) -> None:
    content = {
        "object": {"file": "a/b.obj", "scale": 0.02},
        "grasps": {
            "transforms": [np.eye(4).tolist(), np.diag([1.0, -1.0, -1.0, 1.0]).tolist()],
            "object_in_gripper": [True, False],
        },
    }
    (tmp_path / "b.json").write_text(json.dumps(content))
    found = read_poses(tmp_path / "b.json", hand=HAND)
    equal(found.poses[:, :3, 3], [[0.0, 0.0, 0.1034], [0.0, 0.0, -0.1034]])
    assert found.outcome.tolist() == [1.0, 0.0]
    assert found.object_scale == 0.02
    content["grasps"]["object_in_gripper"] = [[True], [False]]  # also published as a column
    (tmp_path / "b.json").write_text(json.dumps(content))
    assert read_poses(tmp_path / "b.json", hand=HAND).outcome.tolist() == [1.0, 0.0]


def test_graspnet_is_read_from_its_documented_layout(tmp_path: Path) -> None:
    """Approach along x, fingers close along y, and their ends are at x = depth."""
    row = [0.7, 0.06, 0.02, 0.03, *np.eye(3).ravel(), 0.1, 0.2, 0.3, 5]
    np.save(tmp_path / "one.npy", np.array([row], dtype=np.float32))
    found = read_poses(tmp_path / "one.npy", hand=HAND)
    equal(found.poses[0, :3, 2], [1.0, 0.0, 0.0], 1e-6)  # approach
    equal(found.poses[0, :3, 0], [0.0, 1.0, 0.0], 1e-6)  # closing axis
    # The pads are 16 mm high, and the TCP is at their middle.
    equal(found.poses[0, :3, 3], [0.1 + 0.03 - 0.008, 0.2, 0.3], 1e-6)
    equal(found.pregrasp_opening, [0.06], 1e-6)
    equal(found.scores, [0.7], 1e-6)
    assert found.columns["object_id"].tolist() == [5.0]


def test_graspnet_scores_follow_from_critical_angles(tmp_path: Path) -> None:
    poses = one_pose(columns={"critical_angle": np.array([math.atan(0.3)])})
    write_grasps(tmp_path / "one.npy", poses)
    rows = np.load(tmp_path / "one.npy")
    assert rows.shape == (1, 17)
    equal(rows[0, :4], [1.1 - 0.3, 0.06, 0.02, 0.02])


def test_moveit_messages_have_every_field_of_the_definition(tmp_path: Path) -> None:
    write_grasps(tmp_path / "one.json", one_pose(names=("rim",)), format="moveit")
    text = (tmp_path / "one.json").read_text()
    (message,) = json.loads(text, parse_float=lambda number: round(float(number), 9))
    half, header = round(math.sqrt(0.5), 9), {"stamp": {"sec": 0, "nanosec": 0}}
    header |= {"frame_id": "object"}

    def posture(position: float) -> dict[str, Any]:
        point = {"positions": [position] * 2, "velocities": [], "accelerations": [], "effort": [],
                 "time_from_start": {"sec": 0, "nanosec": 0}}  # fmt: skip
        return {"header": header, "joint_names": list(HAND.joint_names), "points": [point]}

    def translation(y: float) -> dict[str, Any]:
        direction = {"header": header, "vector": {"x": 0.0, "y": y, "z": 0.0}}
        return {"direction": direction, "desired_distance": 0.1, "min_distance": 0.02}

    position = dict(zip("xyz", np.round(BASE, 9).tolist(), strict=True))
    turn = {"x": half, "y": 0.0, "z": 0.0, "w": half}
    assert message == {
        "id": "rim",
        "pre_grasp_posture": posture(0.03),
        "grasp_posture": posture(0.015),
        "grasp_pose": {"header": header, "pose": {"position": position, "orientation": turn}},
        "grasp_quality": 0.0,
        "pre_grasp_approach": translation(-1.0),
        "post_grasp_retreat": translation(1.0),
        "post_place_retreat": translation(1.0),
        "max_contact_force": 70.0,
        "allowed_touch_objects": [],
    }


def test_messages_of_ros_1_are_read_as_well(tmp_path: Path) -> None:
    header = {"seq": 0, "stamp": {"secs": 0, "nsecs": 0}, "frame_id": "cup"}
    pose = {
        "position": {"x": 1.0, "y": 0.0, "z": 0.0},
        "orientation": {"x": 0, "y": 0, "z": 0, "w": 1},
    }
    message = {"id": "a", "grasp_pose": {"header": header, "pose": pose}, "grasp_quality": 353.6}
    (tmp_path / "a.json").write_text(json.dumps(message))
    with pytest.raises(ContactError, match="in the frame 'cup', not in that of the object"):
        read_poses(tmp_path / "a.json", hand=HAND)
    found = read_poses(tmp_path / "a.json", hand=HAND, object_pose="0,0,0,0,cup")
    equal(found.poses[0, :3, 3], [1.0, 0.0, 0.1034])
    assert found.settings == {"frame_id": "cup"}
    assert np.isnan(found.opening).all()


@pytest.mark.parametrize("name", OWN)
def test_normals_point_outward_in_files_and_contacts_are_those_of_read_contacts(
    name: Any, tmp_path: Path
) -> None:
    contacts = np.array([[[0.0, 0.0, 0.1], [0.0, 0.0, -0.1]]])
    inward = np.array([[[0.0, 0.0, -1.0], [0.0, 0.0, 1.0]]])
    poses = one_pose(columns={"contacts": contacts, "normals": inward})
    path = tmp_path / f"one.{SUFFIX[name]}"
    write_grasps(path, poses, format=name)
    equal(read_contacts(path), contacts)
    if name == "json":
        content = json.loads(path.read_text())
        assert content["grasp3d"]["normals"] == "outward"
        assert content["grasp3d"]["unit"] == "m"
        assert content["grasp3d"]["frame"] == "object"
        assert content["grasps"][0]["contacts"][0]["normal"] == [0.0, 0.0, 1.0]
    else:
        from grasp3d.system.tables import read_columns

        assert read_columns(path)["nz1"].tolist() == [1.0]
    assert not read_poses(path).columns


def test_what_holds_no_poses_is_told_from_what_does(tmp_path: Path) -> None:
    (tmp_path / "points.json").write_text("[[[0, 0, 1], [0, 0, 0]]]")
    (tmp_path / "points.csv").write_text("x1,y1,z1,x2,y2,z2\n0,0,1,0,0,0\n")
    (tmp_path / "text.json").write_text("no JSON")
    (tmp_path / "folder.json").mkdir()
    for name in ("points.json", "points.csv", "text.json", "absent.json", "mesh.stl"):
        assert not holds_poses(tmp_path / name)
    for name, message in (("absent.json", "there is no such file"), ("folder.json", "is a folder")):
        with pytest.raises(ContactError, match=message):
            read_poses(tmp_path / name)


def test_the_unit_of_a_file_without_one_is_given_and_another_one_is_refused(tmp_path: Path) -> None:
    path = tmp_path / "poses.csv"
    path.write_text("px,py,pz,qx,qy,qz,qw\n0,0,60,0,0,0,1\n")
    assert read_poses(path).unit is None
    equal(read_poses(path, unit="mm").in_unit("m").poses[0, 2, 3], 0.06)
    write_grasps(path, one_pose())
    assert read_poses(path).unit == "m"
    with pytest.raises(ContactError, match="it states the unit m, not mm"):
        read_poses(path, unit="mm")
    write_grasps(tmp_path / "one.npy", one_pose())
    with pytest.raises(ContactError, match="files are in metres, not in mm"):
        read_poses(tmp_path / "one.npy", hand=HAND, unit="mm")


@pytest.mark.parametrize(
    ("file", "name", "fields", "message"),
    [
        ("one.txt", None, {}, r"unsupported pose format \.txt: supported are \.csv \.npy \.json"),
        ("one", None, {}, "has no suffix"),
        ("none.json", None, {"poses": np.zeros((0, 4, 4))}, "no poses to write"),
        ("twins.yaml", None, {"poses": [np.eye(4)] * 2, "names": ("a", "a")}, "two grasps are ca"),
        ("one.csv", "isaac_grasp", {}, r"unsupported isaac_grasp format \.csv: .* \.yaml \.yml"),
        ("one.yaml", None, {"hand": None}, "need the lengths of the gripper: give it"),
        ("one.h5", None, {"hand": "franka"}, "need the lengths of the gripper: give it"),
        ("one.npy", None, {"unit": None}, "the unit of the poses is not known: give it"),
        ("one.yaml", None, {"hand": NO_JOINTS}, "'two_fingers' has no joint_names"),
        ("one.yaml", None, {"scores": 353.0}, "must be from 0 to 1; grasp 1 has 353"),
        ("one.json", "graspgen", {}, "each outcome; that of grasp 1 is missing"),
        ("one.json", "moveit", {"scores": math.inf}, "scores .* must be finite"),
        ("one.json", None, {"settings": {"a": object()}}, "its settings are not JSON"),
        ("folder/one.json", None, {}, "cannot be written"),
    ],
)
def test_what_cannot_be_written_is_refused_and_leaves_no_file(
    file: str, name: Any, fields: dict[str, Any], message: str, tmp_path: Path
) -> None:
    with pytest.raises(OutputError, match=message):
        write_grasps(tmp_path / file, one_pose(**fields), format=name)
    assert not list(tmp_path.iterdir())


def test_a_missing_library_is_named_with_its_extra(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    write_acronym_by_hand(tmp_path / "mug.h5")
    (tmp_path / "cup.yaml").write_text(ISAAC)
    monkeypatch.setattr("grasp3d.formats.checks.find_spec", lambda _: None)
    for name in ("mug.h5", "cup.yaml"):
        with pytest.raises(OutputError, match=r"pip install 'grasp3d\[datasets\]'"):
            read_poses(tmp_path / name, hand=HAND)
        with pytest.raises(OutputError, match=r"pip install 'grasp3d\[datasets\]'"):
            write_grasps(tmp_path / name, one_pose())


def with_header(**header: Any) -> str:
    """A file of two grasps, of which the second has no pose unless there is a header."""
    pose = {"pose": np.eye(4).tolist()}
    return json.dumps({**header, "grasps": [pose, pose if header else {"opening": 1}]})


PLACED = ISAAC.replace("[0.1, -0.2, 3e-1]", "AT")
BOMB = "\n".join(
    ["l0: &l0 [0, 0, 0, 0, 0, 0, 0, 0, 0, 0]"]
    + [f"l{one}: &l{one} [{', '.join([f'*l{one - 1}'] * 10)}]" for one in range(1, 10)]
) + PLACED.replace("AT", "*l9")
"""Nine levels of ten references each would be a list of 10^9 numbers."""


@pytest.mark.parametrize(
    ("file", "content", "message"),
    [
        ("a.txt", "", r"unsupported pose format \.txt: supported are"),
        ("a.json", "", "is not valid JSON"),
        ("a.json", '{"grasps": []}', "there are no grasps in it"),
        ("a.json", "[[[0, 0, 1], [0, 0, 0]]]", "contains no poses: expected"),
        ("a.json", '{"grasps": [{"pose": 1}]}', "grasp 1: pose must be 4 x 4 numbers"),
        ("a.json", with_header(), "grasp 2: the key pose is missing"),
        ("a.json", with_header(grasp3d={"unit": "km"}), "the unit must be one of m, cm, mm, in; g"),
        ("a.json", with_header(grasp3d={"gripper": {"format": "grasp3d gripper"}}), "missing"),
        ("a.csv", "x1,y1\n1,2\n", "contains no poses: expected columns px py pz"),
        ("a.csv", "px,py,pz,qx,qy,qz,qw\n1,2,3,0,0,0,2\n", "must have length 1; got"),
        ("a.csv", "px,py,pz,qx,qy,qz,qw\n1,,3,0,0,0,1\n", "its position is not finite"),
        ("a.parquet", "PAR1", "a.parquet: "),
        ("a.yaml", "a: [", "is not valid YAML"),
        ("a.yaml", "format: isaac_grasp\nformat_version: 2.0\ngrasps: {}", "must be 1.0; got 2"),
        ("a.yaml", PLACED.replace("AT", "[0.1, .nan, 0]"), "position is not finite"),
        ("a.yaml", BOMB, "position must be a list of 3 numbers; got a list of"),
        ("a.yaml", PLACED.replace("AT", "&a [*a, *a, *a]"), "position must be a list of 3 numbers"),
        ("a.yaml", ISAAC.replace("panda_", "robotiq_"), "not those of gripper 'two_fingers'"),
        ("a.yaml", ISAAC.replace("-0.0001", "-0.02"), "opening of -0.04 m: are they those of"),
        (
            "a.yaml",
            "a: !!python/object/apply:os.system [echo]",
            "is not valid YAML: could not determine a constructor",
        ),
        ("a.npy", "no array", r"not a \.npy file"),
    ],
)
def test_what_holds_no_poses_is_refused_in_one_sentence(
    file: str, content: str, message: str, tmp_path: Path
) -> None:
    (tmp_path / file).write_text(content)
    hand = None if "grasp3d" in content else HAND  # a hand replaces the one that a file states
    with pytest.raises(ContactError, match=message) as caught:
        read_poses(tmp_path / file, hand=hand)
    assert "\n" not in str(caught.value)
    assert str(caught.value).startswith(str(tmp_path / file))


@pytest.mark.slow
def test_a_damaged_file_that_hdf5_reads_for_ever_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(limited_reading, "SECONDS", 4.0)
    path = tmp_path / "a.h5"
    write_grasps(path, one_pose(outcome=1.0))
    assert read_poses(path).count == 1
    content = bytearray(path.read_bytes())
    content[content.index(b"GCOL") + 24] = 238  # size of the first text in the heap of texts
    path.write_bytes(content)
    with (
        limited_reading.limited_reading(),
        pytest.raises(FileUnreadError, match=r"a\.h5: reading it takes more than 4 s"),
    ):
        read_poses(path)


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"grasps/transforms": None}, "the data set grasps/transforms is missing"),
        ({"grasps/transforms": HUGE}, r"k at most 1000000; got \(1000000000, 4, 4\)"),
        ({"grasps/transforms": h5py.SoftLink("/grasps/transforms")}, "is damaged, or not such"),
        (
            {"grasps/transforms/other": 1.0, "grasps/transforms": None},
            r"be \(k, 4, 4\), .*got \(\)",
        ),
        ({"grasps/transforms": np.zeros((3, 16))}, r"must be \(k, 4, 4\), .* got \(3, 16\)"),
        ({"grasps/transforms": np.zeros((0, 4, 4))}, "there are no grasps"),
        ({"grasps/transforms": np.full((3, 4, 4), b"a")}, "must be numbers of shape"),
        (
            {"grasps/qualities/flex/object_in_gripper": np.zeros(4)},
            r"object_in_gripper must be a data set of shape \(3,\); got .* shape \(4,\)",
        ),
        ({"object/scale": "large"}, r"object/scale must be numbers of shape \(\)"),
        ({"object/scale": -1.0}, "scale must be a finite number above 0"),
    ],
)
def test_wrong_data_sets_are_named(changes: dict[str, Any], message: str, tmp_path: Path) -> None:
    write_acronym_by_hand(tmp_path / "a.h5", **changes)
    with pytest.raises(ContactError, match=message):
        read_poses(tmp_path / "a.h5")


@pytest.mark.parametrize(
    ("array", "message"),
    [
        (
            np.zeros((3, 16)),
            r"an array with 17 numbers in each row .*got float64 of shape \(3, 16\)",
        ),
        (np.zeros((0, 17)), r"there are no grasps|not a \.npy file"),
        (np.full((2, 17), np.nan), "grasp 1 has numbers that are not finite"),
        (np.zeros((1, 17)), "one of its axes has the length 0"),
        (np.array(1.0), r"a\.npy: contains no poses"),
    ],
)
def test_wrong_arrays_are_refused(array: np.ndarray, message: str, tmp_path: Path) -> None:
    np.save(tmp_path / "a.npy", array)
    with pytest.raises(ContactError, match=message):
        read_poses(tmp_path / "a.npy", hand=HAND)


def test_arrays_of_huge_declared_size_are_refused(tmp_path: Path) -> None:
    with (tmp_path / "b.npy").open("wb") as stream:
        np.lib.format.write_array_header_1_0(
            stream, {"descr": "<f8", "fortran_order": False, "shape": (10**14, 17)}
        )
    with pytest.raises(ContactError, match=r"is not a \.npy file of numbers"):
        read_poses(tmp_path / "b.npy", hand=HAND)


WORDS = st.sampled_from([
    "grasps", "pose", "transforms", "grasp_pose", "format", "isaac_grasp", "position", "name",
    "orientation", "w", "xyz", "header", "contacts", "opening", "grasp3d", "gripper", "unit",
    "object", "scale", "object_in_gripper", "joint_names", "points", "grasp_posture", "normals",
])  # fmt: skip
PLAIN = (
    st.none()
    | st.booleans()
    | st.integers()
    | st.floats()
    | st.text(max_size=4)
    | WORDS
    | st.just(np.eye(4).tolist())
)
DOCUMENTS = (
    PLAIN
    | st.lists(PLAIN, max_size=4)
    | st.dictionaries(WORDS, PLAIN | st.lists(PLAIN, max_size=4), max_size=4)
)


def only_grasp_errors(path: Path) -> None:
    """Read a file, which may hold poses, but raises nothing else than GraspError."""
    holds_poses(path)
    try:
        read_poses(path, hand=HAND)
    except GraspError as error:
        assert "\n" not in str(error)  # noqa: PT017, it need not be raised


@pytest.mark.slow
@pytest.mark.parametrize("name", ["json", "graspgen", "moveit", "isaac_grasp"])
@SHARED_FOLDER
@given(data=st.data())
def test_documents_with_one_changed_value_are_read_or_refused(
    name: Any, data: st.DataObject, tmp_path: Path
) -> None:
    path = tmp_path / f"poses.{SUFFIX[name]}"
    write_grasps(path, one_pose(outcome=1.0, scores=0.5), format=name)
    load, dump = (yaml.safe_load, yaml.safe_dump) if path.suffix == ".yaml" else (
        json.loads, json.dumps
    )  # fmt: skip
    whole = {"": load(path.read_text())}
    inner: Any = whole
    while True:
        keys = list(inner) if isinstance(inner, dict) else list(range(len(inner)))
        key = data.draw(st.sampled_from(keys))
        deeper = isinstance(inner[key], dict | list) and inner[key]
        if not deeper or data.draw(st.integers(0, 3)) == 0:
            inner[key] = data.draw(DOCUMENTS)
            break
        inner = inner[key]
    path.write_text(dump(whole[""]))
    only_grasp_errors(path)


@pytest.mark.slow
@pytest.mark.parametrize("name", list(SUFFIX))
@SHARED_FOLDER
@given(data=st.data())
def test_damaged_bytes_are_read_or_refused(name: Any, data: st.DataObject, tmp_path: Path) -> None:
    """Not those within HDF5, whose library may read damaged ones for ever."""
    path = tmp_path / f"poses.{SUFFIX[name]}"
    write_grasps(path, one_pose(outcome=1.0, scores=0.5), format=name)
    content = bytearray(path.read_bytes())
    for _ in range(0 if path.suffix == ".h5" else data.draw(st.integers(0, 3))):
        content[data.draw(st.integers(0, len(content) - 1))] = data.draw(st.integers(0, 255))
    path.write_bytes(content[: data.draw(st.integers(0, len(content)))])
    only_grasp_errors(path)


def test_numbers_are_the_same_whether_all_are_plain_or_one_is_text() -> None:
    rows = [[[1, 2.5], [None, True]], [[-1e-300, 0], [3, 10**200]]]
    texts = [[["1", 2.5], [None, True]], *rows[1:]]
    expected = np.array([[[1.0, 2.5], [np.nan, 1.0]], [[-1e-300, 0.0], [3.0, 1e200]]])
    for values in (rows, texts):
        np.testing.assert_array_equal(numbers(values, (2, 2), "pose"), expected)
    for wrong in (10**400, "one", {}, [1.0], [[1.0, 2.0]]):
        for row in ([[1.0, wrong], [1.0, 1.0]], [wrong, [1.0, 1.0]]):
            with pytest.raises(ContactError, match="grasp 2: pose must be 2 x 2 numbers, in lists"):
                numbers([*rows[:1], row], (2, 2), "pose")


def test_texts_of_any_storage_are_read(tmp_path: Path) -> None:
    """As few bits of codes, as texts of a fixed length, and as dates, which CSV's reader makes."""
    columns: dict[str, Any] = {name: [0.0] * 3 for name in ("px", "py", "pz", "qx", "qy", "qz")}
    codes = pa.DictionaryArray.from_arrays(pa.array([0, 1, 0], pa.uint8()), ["a", "b"])
    pq.write_table(pa.table({**columns, "qw": [1.0] * 3, "tag": codes}), tmp_path / "a.parquet")
    assert read_poses(tmp_path / "a.parquet", unit="m").columns["tag"].tolist() == ["a", "b", "a"]
    path = tmp_path / "a.csv"
    path.write_text("px,py,pz,qx,qy,qz,qw,tag\n0,0,0,0,0,0,1,2020-01-01\n")
    assert read_poses(path, unit="m").columns["tag"].tolist() == ["2020-01-01"]
    with h5py.File(tmp_path / "a.h5", "w") as file:
        file["grasps/transforms"] = np.tile(np.eye(4), (3, 1, 1))
        file["object/file"], file["gripper/type"] = np.bytes_("mug.obj"), np.bytes_("panda")
    assert read_poses(tmp_path / "a.h5").object_file == "mug.obj"
