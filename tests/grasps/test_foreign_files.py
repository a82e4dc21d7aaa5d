"""Files of simulators and data sets, laid out as their programs do: read, written, damaged."""

import json
import math
import os
import pickle
import warnings
import zipfile
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from scipy.spatial.transform import Rotation

from grasp3d.errors import ContactError, OutputError, SettingError
from grasp3d.grasps.grasp_files import read_grasps
from grasp3d.grasps.pose_files import data_sets, holds_poses, read_poses, write_poses
from grasp3d.grasps.pose_files.files import suffixes_of
from grasp3d.grasps.poses import GraspPoses
from grasp3d.hand.frames import FRAMES, GripperFrame
from grasp3d.hand.parallel_gripper import preset
from grasp3d.system import stored_arrays
from grasp3d.system.stored_arrays import RefusedError

FRANKA = preset("franka")

TCP = np.array([[0, 1, 0, 0.1], [1, 0, 0, 0.2], [0, 0, -1, 0.3], [0, 0, 0, 1]], dtype=float)
"""From above onto an object, the jaws along its y."""

BASE = [0.1, 0.2, 0.3 + 0.1034]
"""Where the hand then is; it is turned about the object's x by half a turn."""

W, XYZ = 0.0, [1.0, 0.0, 0.0]
JOINTS = {"panda_finger_joint1": 0.025, "panda_finger_joint2": 0.025}


def write(path: Path, content: Any) -> Path:
    """JSON is YAML, too."""
    path.write_text(json.dumps(content), encoding="utf-8")
    return path


def read(path: Path, **options: Any) -> GraspPoses:
    return read_poses(path, hand=FRANKA, **options)


def equal(one: Any, other: Any, tolerance: float = 1e-9) -> None:
    np.testing.assert_allclose(one, other, rtol=0.0, atol=tolerance)


# GraspDataGen: grasp_sim.py writes whether grasps held, grasp_guess.py whether they are free.


def datagen(created_with: str, confidences: list[Any]) -> dict[str, Any]:
    grasp = {
        "position": BASE,
        "orientation": {"w": W, "xyz": XYZ},
        "cspace_position": JOINTS,
        "bite_point": [0.0, 0.0, 0.1],
        "pregrasp_cspace_position": dict.fromkeys(JOINTS, 0.04),
        "pregrasp_bite_point": [0.0, 0.0, 0.1],
    }
    return {
        "format": "isaac_grasp",
        "format_version": "1.0",
        "created_with": created_with,
        "created_at": "2025-06-30 12:00:00",
        "object_file": "mug.obj",
        "object_scale": 0.01,
        "gripper_file": "franka.usd",
        "gripper_frame_link": "panda_hand",
        "open_limit": "upper",
        "finger_colliders": ["panda_leftfinger", "panda_rightfinger"],
        "base_length": 0.05,
        "approach_axis": 2,
        "bite_point": [0.0, 0.0, 0.1],
        "grasps": {f"grasp_{k}": {"confidence": c, **grasp} for k, c in enumerate(confidences)},
    }


def test_outcomes_of_graspdatagen_are_the_confidences_of_simulated_grasps(tmp_path: Path) -> None:
    found = read(write(tmp_path / "a.yaml", datagen("grasp_sim", [1.0, 0.0, None])))
    equal(found.poses, [TCP] * 3)
    equal(found.outcome, [1.0, 0.0, math.nan])
    assert np.isnan(found.scores).all()
    equal(found.opening, [0.05] * 3)
    equal(found.pregrasp_opening, [0.08] * 3)
    assert (found.object_file, found.object_scale) == ("mug.obj", 0.01)
    guessed = read(write(tmp_path / "b.yaml", datagen("grasp_guess", [1.0, 0.0])))
    assert np.isnan(guessed.outcome).all()
    equal(guessed.scores, [1.0, 0.0])
    other = read(write(tmp_path / "c.yaml", datagen("grasp_sim", [0.2])), outcome="confidence>=0.1")
    equal(other.outcome, [1.0])


def test_graspdatagen_is_written_with_every_outcome(tmp_path: Path) -> None:
    poses = GraspPoses(poses=[TCP, TCP], outcome=[1.0, 0.0], opening=0.05, unit="m", hand=FRANKA)
    write_poses(tmp_path / "a.yaml", poses, format="graspdatagen")
    document = yaml.safe_load((tmp_path / "a.yaml").read_text())
    assert (document["format"], document["created_with"]) == ("isaac_grasp", "grasp_sim")
    first, second = document["grasps"].values()
    assert (first["confidence"], second["confidence"]) == (1.0, 0.0)
    equal(first["position"], BASE)
    equal(read(tmp_path / "a.yaml").outcome, [1.0, 0.0])
    with pytest.raises(OutputError, match="outcome of grasp 1 is not known"):
        write_poses(tmp_path / "a.yaml", replace(poses, outcome=np.nan), format="graspdatagen")


# MultiGripperGrasp: lists of one value for each grasp; quaternions have w first.


def multigripper(**changes: Any) -> dict[str, Any]:
    pose = [*BASE, W, *XYZ]
    return {
        "gripper": "franka_panda",
        "object_id": "mug",
        "pose": [pose, pose, pose],
        "dofs": [[0.04, 0.04]] * 3,
        "final_dofs": [[0.025, 0.025]] * 3,
        "fall_time": [3.5, 0.7, -1],
        "slip_time": [-1, 0.2, -1],
        "test_type": "gravity",
        "test_duration": 3,
    } | changes


def test_multigrippergrasp_is_read_from_its_documented_layout(tmp_path: Path) -> None:
    found = read(write(tmp_path / "a.json", multigripper()))
    equal(found.poses, [TCP] * 3)
    equal(found.outcome, [1.0, 0.0, 0.0])
    equal(found.pregrasp_opening, [0.08] * 3)
    equal(found.opening, [0.05] * 3)
    equal(found.columns["fall_time"], [3.5, 0.7, -1])
    equal(found.columns["slip_time"], [-1, 0.2, -1])
    assert found.settings["object_id"] == "mug"
    stated = write(tmp_path / "b.json", multigripper(result=[0, 1, 1]))
    equal(read(stated).outcome, [0.0, 1.0, 1.0])
    equal(read(stated, outcome="slip_time>0").outcome, [0.0, 1.0, 0.0])
    undated = write(tmp_path / "c.json", multigripper(test_duration=None))
    assert np.isnan(read(undated).outcome).all()
    equal(read(undated, outcome="fall_time>=3").outcome, [1.0, 0.0, 0.0])


def test_joints_of_another_number_than_those_of_the_gripper_say_nothing(tmp_path: Path) -> None:
    found = read(write(tmp_path / "a.json", multigripper(dofs=[[0.1] * 6] * 3, final_dofs=None)))
    assert np.isnan(found.opening).all()
    assert np.isnan(found.pregrasp_opening).all()


def test_multigrippergrasp_is_written_as_documented(tmp_path: Path) -> None:
    poses = GraspPoses(
        poses=[TCP, TCP], outcome=[1.0, np.nan], opening=0.05, pregrasp_opening=[0.06, np.nan],
        unit="m", hand=FRANKA, settings={"object_id": "mug"},
    )  # fmt: skip
    write_poses(tmp_path / "a.json", poses, format="multigrippergrasp")
    document = json.loads((tmp_path / "a.json").read_text())
    assert (document["gripper"], document["object_id"]) == ("franka", "mug")
    equal(document["pose"], [[*BASE, W, *XYZ]] * 2)
    equal(document["dofs"], [[0.03, 0.03], [0.04, 0.04]])
    assert document["result"] == [1.0, None]
    back = read(tmp_path / "a.json")
    equal(back.outcome, poses.outcome)
    equal(back.opening, poses.opening)


# RoboTwin: x of the contact frame is free, -y approaches, z closes; in numbers of the mesh.


def test_robotwin_is_read_and_written_in_numbers_of_the_mesh(tmp_path: Path) -> None:
    contact = [[-1, 0, 0, 1.0], [0, 0, 1, 2.0], [0, 1, 0, 3.0], [0, 0, 0, 1]]
    content = {"scale": [0.1, 0.1, 0.1], "contact_points_pose": [contact], "target_pose": []}
    path = write(tmp_path / "model_data0.json", content)
    found = read_poses(path)
    equal(found.poses, [TCP])
    assert (found.unit, found.object_scale) == ("m", 0.1)
    write_poses(tmp_path / "b.json", replace(found, hand=FRANKA), format="robotwin")
    back = json.loads((tmp_path / "b.json").read_text())
    equal(back["contact_points_pose"], [contact])
    equal(back["scale"], [0.1] * 3)
    stretched = read_poses(write(path, content | {"scale": [0.1, 0.2, 0.1]}))
    equal(stretched.poses[0, :3, 3], [0.1, 0.4, 0.3])
    assert stretched.object_scale is None
    equal(read_poses(write(path, content | {"scale": 0.1})).poses, [TCP])
    equal(read_poses(write(path, {"contact_points_pose": [contact]})).poses[0, :3, 3], [1, 2, 3])


# Replicator: a configuration states the gripper's axes, a tried grasp is in the world's frame.


def configuration(**sampler: Any) -> dict[str, Any]:
    content: dict[str, Any] = {
        "gripper_path": "/World/panda_hand",
        "object_path": "/World/mug",
        "joint_pregrasp_states": {"panda_finger_joint1": 0.04},
        "grasp_poses": [{"position": BASE, "orientation": {"w": W, "xyz": XYZ}}],
    }
    return content | ({"sampler_config": sampler} if sampler else {})


def test_configurations_of_replicator_state_the_axes_of_the_gripper(tmp_path: Path) -> None:
    path = tmp_path / "a.yaml"
    equal(read(write(path, configuration())).poses, [TCP])
    axes = {"gripper_approach_direction": [0, 0, 1], "grasp_align_axis": [0, -1, 0]}
    # Its sampler's standoff fits no particular gripper: the TCP is where the gripper has it.
    for standoff in ({}, {"gripper_standoff_fingertips": 0.17}):
        equal(read(write(path, configuration(**axes, **standoff))).poses, [TCP])
    robotiq = preset("robotiq_2f85")
    lower = TCP.copy()
    lower[2, 3] = BASE[2] - robotiq.base_to_tcp
    equal(read_poses(path, hand=robotiq).poses, [lower])
    # A closing axis between two others: panda_link8 has it 45 degrees from the hand's.
    turned = axes | {"grasp_align_axis": [math.sqrt(0.5), -math.sqrt(0.5), 0]}
    found = read(write(path, configuration(**turned)))
    closing = np.diag([1.0, -1.0, -1.0]) @ turned["grasp_align_axis"]
    equal(found.poses[0, :3, 0], closing)
    equal(found.poses[0, :3, 2:], TCP[:3, 2:])


def test_configurations_of_replicator_are_written_with_the_axes(tmp_path: Path) -> None:
    poses = GraspPoses(poses=[TCP], unit="m", hand=FRANKA)
    write_poses(tmp_path / "a.yaml", poses, format="replicator")
    document = yaml.safe_load((tmp_path / "a.yaml").read_text())
    (grasp,) = document["grasp_poses"]
    equal(grasp["position"], BASE)
    equal(np.abs([grasp["orientation"]["w"], *grasp["orientation"]["xyz"]]), [W, *XYZ])
    sampler = document["sampler_config"]
    assert sampler["gripper_approach_direction"] == [0.0, 0.0, 1.0]
    assert sampler["grasp_align_axis"] == [0.0, -1.0, 0.0]
    equal(sampler["gripper_standoff_fingertips"], 0.1034)
    assert "gripper_frame" not in document
    equal(read(tmp_path / "a.yaml").poses, [TCP])


@pytest.mark.parametrize(
    "frame", [*FRAMES, "graspgen,tcp=base+0.02", "dexnet,turn=30deg", "burg,tcp=0.1034"]
)
def test_configurations_of_replicator_are_read_in_the_frame_they_have(
    frame: str, tmp_path: Path
) -> None:
    poses = GraspPoses(poses=[TCP], unit="m", hand=FRANKA)
    write_poses(tmp_path / "a.yaml", poses, format="replicator", frame=frame)
    equal(read(tmp_path / "a.yaml").poses, [TCP])
    document = yaml.safe_load((tmp_path / "a.yaml").read_text())
    of_base = GripperFrame.of(frame).distance(FRANKA) == FRANKA.base_to_tcp
    assert ("gripper_frame" in document) != of_base


def test_a_grasp_that_replicator_tried_needs_the_pose_of_the_object(tmp_path: Path) -> None:
    result = {
        "gripper_path": "/World/panda_hand",
        "object_path": "/World/mug",
        "gripper_location": [BASE[0] + 1.0, *BASE[1:]],
        "gripper_orientation": {"w": W, "xyz": XYZ},
        "joint_states": {"panda_finger_joint1": 0.02},
    }
    path = write(tmp_path / "capture_0.yaml", {"grasp_result": result})
    with pytest.raises(ContactError, match="in the frame 'world'"):
        read(path)
    equal(read(path, object_pose="x=1m").poses, [TCP])


# InternData: rows of graspnetAPI whose score is a coefficient of friction.


def test_scores_of_interndata_are_coefficients_of_friction(tmp_path: Path) -> None:
    poses = GraspPoses(poses=[TCP, TCP], scores=[0.9, 0.1], unit="m", hand=FRANKA)
    write_poses(tmp_path / "a.npy", poses, format="interndata")
    rows = np.load(tmp_path / "a.npy")
    equal(rows[:, 0], [0.2, 1.0])
    equal(read(tmp_path / "a.npy", format="interndata").scores, [0.9, 0.1])
    equal(read(tmp_path / "a.npy").scores, [0.2, 1.0])
    equal(read(tmp_path / "a.npy", format="interndata", outcome="score<=0.4").outcome, [1.0, 0.0])


# Labels of graspnetAPI: 300 views, 12 angles and 4 depths at each point.


def labels(count: int = 2) -> dict[str, np.ndarray]:
    """Arrays of an object of which no grasp holds yet."""
    random = np.random.default_rng(7)
    grid = count, 300, 12, 4
    offsets = np.empty((*grid, 3))
    offsets[..., 0] = np.arange(12)[None, None, :, None] * np.pi / 12
    offsets[..., 1] = np.array([0.01, 0.02, 0.03, 0.04])
    offsets[..., 2] = random.uniform(0.01, 0.08, grid)
    return {
        "points": random.uniform(-0.05, 0.05, (count, 3)).astype(np.float32),
        "offsets": offsets.astype(np.float32),
        "scores": np.full(grid, -1.0, dtype=np.float32),
        "collision": np.zeros(grid, dtype=bool),
    }


def save(path: Path, *, compressed: bool = False, **arrays: Any) -> Path:
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        (np.savez_compressed if compressed else np.savez)(path, **arrays)
    return path


def write_pickle(archive: zipfile.ZipFile, name: str, content: bytes) -> None:
    with archive.open(f"{name}.npy", "w") as stream:
        np.lib.format.write_array_header_1_0(  # type: ignore[attr-defined]
            stream, {"descr": "|O", "fortran_order": False, "shape": ()}
        )
        stream.write(content)


def view(number: int) -> np.ndarray:
    """The direction of a view, as graspnetAPI's generate_views makes it."""
    phi = (math.sqrt(5) - 1) / 2
    z = (2 * number + 1) / 300 - 1
    radius = math.sqrt(1 - z * z)
    turn = 2 * number * math.pi * phi
    return np.array([radius * math.cos(turn), radius * math.sin(turn), z])


def frame(towards: np.ndarray, angle: float) -> np.ndarray:
    """Rotation of a grasp, as graspnetAPI's viewpoint_params_to_matrix makes it."""
    axis_x = towards / np.linalg.norm(towards)
    axis_y = np.array([-towards[1], towards[0], 0.0])
    axis_y /= np.linalg.norm(axis_y)
    unturned = np.stack([axis_x, axis_y, np.cross(axis_x, axis_y)], axis=1)
    return np.asarray(unturned @ Rotation.from_rotvec([angle, 0, 0]).as_matrix())


def test_labels_of_graspnetapi_that_hold_become_poses(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(data_sets, "POINTS", 2)
    arrays = labels(5)
    held = [(0, 3, 5, 1), (2, 0, 0, 0), (2, 299, 11, 3), (4, 150, 7, 2)]
    for number, place in enumerate(held):
        arrays["scores"][place] = 0.1 * (number + 1)
    arrays["scores"][1, 1, 1, 1], arrays["collision"][1, 1, 1, 1] = 0.1, True
    arrays["scores"][3, 2, 2, 2] = 0.0
    found = read(save(tmp_path / "000_labels.npz", **arrays))
    assert found.names == ("0_3_5_1", "2_0_0_0", "2_299_11_3", "4_150_7_2")
    equal(found.scores, [1.0, 0.9, 0.8, 0.7], 1e-6)
    equal(found.pregrasp_opening, [arrays["offsets"][place][2] for place in held])
    assert np.isnan(found.outcome).all()
    for pose, place in zip(found.poses, held, strict=True):
        turned = frame(-view(place[1]), float(arrays["offsets"][place][0]))
        equal(pose[:3, 2], turned[:, 0], 1e-6)  # x approaches
        equal(pose[:3, 0], turned[:, 1], 1e-6)  # y closes
        ends = arrays["points"][place[0]] + arrays["offsets"][place][1] * turned[:, 0]
        equal(pose[:3, 3], ends - 0.5 * FRANKA.pad_height * turned[:, 0], 1e-6)
    some = read(tmp_path / "000_labels.npz", outcome="scores<=0.25")
    equal(some.outcome, [1.0, 1.0, 0.0, 0.0])


def test_of_many_labels_as_many_are_read_evenly_spread(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arrays = labels(1)
    arrays["scores"][0, :, 0, 0] = 0.5
    path = save(tmp_path / "a.npz", **arrays)
    assert "grasps_in_file" not in read(path).settings
    monkeypatch.setattr(data_sets, "MOST_LABELS", 3)
    found = read(path)
    assert found.names == ("0_0_0_0", "0_150_0_0", "0_299_0_0")
    assert found.settings["grasps_in_file"] == 300
    equal(found.pregrasp_opening, arrays["offsets"][0, [0, 150, 299], 0, 0, 2])


# Contact-GraspNet: dictionaries of segments, in the camera's frame.


def predictions() -> dict[str, Any]:
    pose = np.array([[0, 1, 0, 0.1], [1, 0, 0, 0.2], [0, 0, -1, BASE[2]], [0, 0, 0, 1]])
    return {
        "pred_grasps_cam": {1: np.stack([pose, pose]), 3: np.array([]), 5: pose[None]},
        "scores": {1: np.array([0.9, 0.8], dtype=np.float32), 3: [], 5: np.array([0.7])},
        "contact_pts": {1: np.zeros((2, 3)), 3: np.array([]), 5: np.zeros((1, 3))},
        "pc_full": np.zeros((5, 3)),
        "pc_colors": None,
    }


def test_predictions_of_contact_graspnet_are_in_the_frame_of_the_camera(tmp_path: Path) -> None:
    path = save(tmp_path / "predictions_7.npz", **predictions())
    with pytest.raises(ContactError, match="in the frame 'camera'"):
        read(path)
    found = read(path, object_pose="z=0.5m")
    lower = TCP.copy()
    lower[2, 3] -= 0.5
    equal(found.poses, [lower] * 3)
    equal(found.scores, [0.9, 0.8, 0.7], 1e-6)
    equal(found.columns["segment"], [1, 1, 5])
    assert found.names == ("1_1", "1_2", "5_1")
    one = predictions() | {"pred_grasps_cam": predictions()["pred_grasps_cam"][1], "scores": [1, 2]}
    of_all = read(save(tmp_path / "b.npz", **one), object_pose="z=0.5m")
    equal(of_all.columns["segment"], [-1, -1])


def test_numbers_of_segments_may_be_floats(tmp_path: Path) -> None:
    one = {key: {2.0: predictions()[key][1]} for key in ("pred_grasps_cam", "scores")}
    found = read(save(tmp_path / "a.npz", **one), object_pose="z=0.5m")
    assert found.names == ("2_1", "2_2")
    equal(found.columns["segment"], [2, 2])


def test_grasps_of_all_segments_are_counted_before_they_are_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(data_sets, "MOST_PREDICTED", 2)
    path = save(tmp_path / "a.npz", **predictions())
    with pytest.raises(ContactError, match="more than 2 grasps"):
        data_sets.read_segments(path, None)


@pytest.mark.slow
def test_predictions_are_read_in_a_process_with_limits(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("grasp3d.grasps.pose_files.documents.SECONDS", 4.0)
    # Keys with the same hash: the time grows with the square of their number.
    numbers = b"".join(
        b"\x8a\x0b" + (k * (2**61 - 1)).to_bytes(11, "little") + b"K\x00" for k in range(100_000)
    )
    path = tmp_path / "a.npz"
    with zipfile.ZipFile(path, "w") as archive:
        for name in ("pred_grasps_cam", "scores"):
            write_pickle(archive, name, b"\x80\x02}(" + numbers + b"u.")
    with pytest.raises(ContactError, match="the process that reads it"):
        read(path, object_pose="x=0m")


# Which format it is, and what is refused.


def test_formats_are_recognized_by_their_content(tmp_path: Path) -> None:
    for name, content in {
        "a.yaml": datagen("grasp_sim", [1.0]), "b.yaml": configuration(),
        "c.json": multigripper(), "d.json": {"contact_points_pose": [np.eye(4).tolist()]},
    }.items():  # fmt: skip
        assert holds_poses(write(tmp_path / name, content)), name
    assert holds_poses(save(tmp_path / "e.npz", **predictions()))
    (tmp_path / "e.npz").write_bytes(b"PK")
    with pytest.raises(ContactError, match="damaged"):
        read_grasps(tmp_path / "e.npz", hand=FRANKA)


@pytest.mark.parametrize("name", ["graspnet_labels", "contact_graspnet"])
def test_archives_are_only_read(name: Any, tmp_path: Path) -> None:
    poses = GraspPoses(poses=[TCP], unit="m", hand=FRANKA)
    with pytest.raises(SettingError, match=f"{name} files are only read"):
        write_poses(tmp_path / "a.npz", poses, format=name)
    with pytest.raises(SettingError, match=f"{name} files are only read"):
        suffixes_of(name)
    with pytest.raises(OutputError, match=r"\.npz"):
        write_poses(tmp_path / "a.npz", poses)
    assert not list(tmp_path.iterdir())


def changed(arrays: dict[str, Any], **changes: Any) -> dict[str, Any]:
    return {name: value for name, value in (arrays | changes).items() if value is not None}


class Executes:
    """What calls a function when it is unpickled in the usual way."""

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, ("executed",)


NAN = float("nan")
AXES = {"gripper_approach_direction": [0, 0, 1], "grasp_align_axis": [0, 1, 0]}
BAD_DOCUMENTS: dict[str, tuple[str, Any, str]] = {
    "no grasps": ("yaml", datagen("grasp_sim", []), "no grasps in it"),
    "no outcome": ("yaml", datagen("grasp_sim", [0.5]), "confidence must be 1"),
    "empty list": ("yaml", configuration() | {"grasp_poses": []}, "no grasps in it"),
    "no list": ("yaml", configuration() | {"grasp_poses": {}}, "grasp_poses must be a list"),
    "no position": ("yaml", {"grasp_poses": [{}]}, "the key position is missing"),
    "no result": ("yaml", {"grasp_result": {}}, "grasp_result: the key gripper_location"),
    "nan": (
        "yaml",
        {"grasp_poses": [{"position": [NAN, 0, 0], "orientation": {"w": 1, "xyz": [0, 0, 0]}}]},
        "position",
    ),
    "diagonal": (
        "yaml",
        configuration(**AXES | {"gripper_approach_direction": [0, 0.6, 0.8]},
                      gripper_standoff_fingertips=0.1),
        "must be an axis",
    ),
    "parallel": (
        "yaml",
        configuration(**AXES | {"grasp_align_axis": [0, 0, 1]}, gripper_standoff_fingertips=0.1),
        "right angle",
    ),
    "far": ("yaml", configuration() | {"gripper_frame": "burg,tcp=170"}, "at most 1 m"),
    "unknown": ("yaml", configuration() | {"gripper_frame": "tool0"}, "unknown gripper frame"),
    "no text": ("yaml", configuration() | {"gripper_frame": 3}, "gripper_frame must be text"),
    "six numbers": ("json", multigripper(pose=[[0] * 6] * 3), "list of 7 numbers"),
    "no turn": ("json", multigripper(pose=[[0] * 7] * 3), "quaternion"),
    "pose nan": ("json", multigripper(pose=[[NAN, 0, 0, 1, 0, 0, 0]] * 3), "not finite"),
    "no poses": ("json", multigripper(pose=[]), "no grasps in it"),
    "too few": ("json", multigripper(fall_time=[1.0]), "fall_time must have 3 values"),
    "too few joints": ("json", multigripper(dofs=[[0.04, 0.04]]), "dofs must have 3 values"),
    "a word": ("json", multigripper(result=["?"] * 3), "result must be 1"),
    "an id": ("json", multigripper(object_id=3), "object_id must be text"),
    "a time": ("json", multigripper(test_duration="x"), "test_duration must be a finite number"),
    "no contacts": ("json", {"contact_points_pose": []}, "no grasps in it"),
    "3 x 4": ("json", {"contact_points_pose": [np.eye(4)[:3].tolist()]}, "4 x 4 numbers"),
    "mirrored": (
        "json", {"contact_points_pose": [np.diag([1, 1, -1, 1]).tolist()]}, "left-handed",
    ),
    "scale": ("json", {"contact_points_pose": [np.eye(4).tolist()], "scale": 0}, "above 0"),
    "scale of 2": (
        "json", {"contact_points_pose": [np.eye(4).tolist()], "scale": [1, 1]}, "scale must be",
    ),
}  # fmt: skip


@pytest.mark.parametrize("name", list(BAD_DOCUMENTS))
def test_wrong_documents_are_refused_in_one_sentence(name: str, tmp_path: Path) -> None:
    suffix, content, message = BAD_DOCUMENTS[name]
    with pytest.raises(ContactError, match=message) as error:
        read(write(tmp_path / f"a.{suffix}", content))
    assert "\n" not in str(error.value)


LABELS, PREDICTED = labels(1), predictions()
LABELS["scores"][0, 0, 0, 0] = 0.5
NOT_A_NUMBER = labels(1)
NOT_A_NUMBER["scores"][0, 0, 0, 0], NOT_A_NUMBER["offsets"][0, 0, 0, 0] = 0.5, np.nan
ONE = np.eye(4)[None]
BAD_ARCHIVES: dict[str, tuple[dict[str, Any], str]] = {
    "nothing": ({}, "contains no poses"),
    "other": ({"points": np.zeros(3)}, "contains no poses"),
    "no grasps": (labels(1), "no grasps in it that hold"),
    "no points": (labels(0), "must have the shape"),
    "views": (changed(LABELS, scores=np.ones((1, 299, 12, 4))), "scores must have the shape"),
    "points": (changed(LABELS, points=np.zeros((2, 3))), "the same number of points"),
    "columns": (changed(labels(2), points=np.zeros((3, 2)).T), "row by row"),
    "text": (changed(LABELS, points=np.array([["a"] * 3])), "points must be numbers"),
    "label objects": (changed(LABELS, points=np.array([[None] * 3])), "points must be numbers"),
    "nan": (NOT_A_NUMBER, "finite"),
    "no scores": (changed(PREDICTED, scores=None), "the array scores is missing"),
    "no segments": (changed(PREDICTED, pred_grasps_cam={}), "no grasps in it"),
    **{
        f"segment {key}": (changed(PREDICTED, pred_grasps_cam={key: ONE}), "whole numbers")
        for key in (True, 1.7, NAN, math.inf, 2**60, b"a")
    },
    "words": (changed(PREDICTED, pred_grasps_cam={"a": ONE}), "dictionary of segments"),
    "list": (changed(PREDICTED, pred_grasps_cam=np.array([None, 1])), "dictionary of segments"),
    "too few": (changed(PREDICTED, scores={1: [0.5]}), "as many scores"),
    "3 x 4": (changed(PREDICTED, pred_grasps_cam={1: ONE[:, :3]}), "as many scores"),
    "no numbers": (changed(PREDICTED, pred_grasps_cam={1: {2: 3}}), "must be numbers"),
    "function": (changed(PREDICTED, scores={1: Executes()}), "names .*mkdir"),
    "class": (changed(PREDICTED, pred_grasps_cam={1: Path("a")}), "names .*Path"),
}


@pytest.mark.parametrize("name", list(BAD_ARCHIVES))
def test_wrong_archives_are_refused_in_one_sentence(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    arrays, message = BAD_ARCHIVES[name]
    monkeypatch.chdir(tmp_path)
    path = save(tmp_path / "a.npz", **arrays)
    with pytest.raises(ContactError, match=message) as error:
        read(path, object_pose="x=0m")
    assert "\n" not in str(error.value)
    assert [entry.name for entry in tmp_path.iterdir()] == ["a.npz"]


def test_archives_that_would_fill_the_memory_are_refused_by_their_directory(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stored_arrays, "LARGEST", 2**20)
    monkeypatch.setattr(stored_arrays, "LARGEST_IN_PARTS", 2**20)
    large = np.zeros(2**19)
    path = save(tmp_path / "a.npz", compressed=True, **changed(LABELS, points=large))
    with pytest.raises(ContactError, match="has 4 MB, more than the 1 MB that are read"):
        read(path)
    path = save(tmp_path / "b.npz", compressed=True, **changed(PREDICTED, pred_grasps_cam=large))
    assert path.stat().st_size < 2**20
    with pytest.raises(RefusedError, match="has 4 MB, more than the 1 MB that are read"):
        data_sets.read_segments(path, None)


def test_a_directory_that_understates_an_array_is_refused(tmp_path: Path) -> None:
    arrays = changed(PREDICTED, pred_grasps_cam=np.zeros((1000, 4, 4)))
    data = bytearray(save(tmp_path / "a.npz", compressed=True, **arrays).read_bytes())
    at = data.rindex(b"PK\x01\x02", 0, data.rindex(b"pred_grasps_cam.npy"))
    data[at + 24 : at + 28] = (1000).to_bytes(4, "little")
    (tmp_path / "a.npz").write_bytes(data)
    with pytest.raises(ContactError, match=r"not an array of its size|damaged"):
        read(tmp_path / "a.npz", object_pose="x=0m")


@pytest.mark.parametrize("cut", [0, 1, 30, 200, -1, -30])
def test_cut_archives_are_refused(cut: int, tmp_path: Path) -> None:
    path = save(tmp_path / "a.npz", **predictions())
    path.write_bytes(path.read_bytes()[:cut])
    with pytest.raises(ContactError, match=r"damaged|no \.npz"):
        read(path, object_pose="x=0m")


def test_files_of_pickles_that_call_functions_execute_nothing(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for protocol in range(6):
        path = tmp_path / "a.npz"
        with zipfile.ZipFile(path, "w") as archive:
            for name in ("pred_grasps_cam", "scores"):
                write_pickle(archive, name, pickle.dumps(Executes(), protocol=protocol))
        with pytest.raises(ContactError, match="nothing is executed"):
            read(path, object_pose="x=0m")
        assert not Path("executed").exists()
