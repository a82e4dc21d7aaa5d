"""Files of postures: the same grasps through every format, and what is wrong in files by others."""

import json
import os
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.csv as pc
import pytest
from scipy.spatial.transform import Rotation

from grasp3d import load_mesh, read_hand
from grasp3d.errors import ContactError, OutputError
from grasp3d.formats import holds_poses, read_poses, write_grasps
from grasp3d.formats.poses import GraspPoses
from grasp3d.formats.postures import matched, wrist_of
from grasp3d.grasps.evaluation import evaluate_grasps
from grasp3d.hand.articulated_hand import ArticulatedHand
from grasp3d.hand.parallel_gripper import ParallelGripper
from tests.formats.test_poses import random_poses, with_joints
from tests.hand.test_articulated_hand import hand_of, random_postures
from tests.helpers import shapes
from tests.helpers.hands import HANDS, hand_file


def equal(one: Any, other: Any, tolerance: float = 1e-9) -> None:
    np.testing.assert_allclose(one, other, rtol=0.0, atol=tolerance)


def same_grasps(one: GraspPoses, other: GraspPoses, tolerance: float = 1e-9) -> None:
    assert one.joint_names == other.joint_names
    for name in ("poses", "posture", "pregrasp_posture", "squeeze_posture"):
        equal(getattr(one, name), getattr(other, name), tolerance)
    for name in ("pregrasp_poses", "squeeze_poses"):
        first, second = getattr(one, name), getattr(other, name)
        assert (first is None) == (second is None)
        if first is not None:
            equal(first, second, tolerance)


def test_own_files_have_joints_by_name(tmp_path: Path) -> None:
    write_grasps(tmp_path / "a.json", with_joints())
    content = json.loads((tmp_path / "a.json").read_text())
    assert content["grasps"][1]["posture"] == {"index": 2.0, "thumb": 3.0}
    assert content["grasps"][1]["pregrasp_posture"] == {"index": 0.3, "thumb": None}
    write_grasps(tmp_path / "a.csv", with_joints())
    columns = pc.read_csv(tmp_path / "a.csv").column_names
    assert {"joint:index", "pregrasp_joint:thumb", "squeeze_joint:thumb"} <= {*columns}
    assert {"pregrasp_px", "pregrasp_qw"} <= {*columns}
    assert "squeeze_px" not in columns
    rows = ["px,py,pz,qx,qy,qz,qw,unit,joint:a,joint:b,squeeze_joint:a", "0,0,0,0,0,0,1,m,1,2,3"]
    (tmp_path / "a.csv").write_text("\n".join(rows))
    with pytest.raises(ContactError, match="column squeeze_joint:b is missing"):
        read_poses(tmp_path / "a.csv")
    for entry in content["grasps"]:  # whatever their order is
        entry["squeeze_posture"] = dict(reversed([*entry["squeeze_posture"].items()]))
    (tmp_path / "a.json").write_text(json.dumps(content))
    same_grasps(read_poses(tmp_path / "a.json"), with_joints())


@pytest.mark.parametrize(
    ("change", "message"),
    [
        (
            {"posture": {"index": 1.0}},
            "grasp 2: posture must have the same joints in all, index thumb; 'thumb'",
        ),
        ({"posture": {"index": 1.0, "thumb": "x"}}, "2: posture thumb must be a number; got 'x'"),
        ({"posture": {"index": 1.0, "thumb": None}}, "grasp 2: value 2 of its posture must be fin"),
        ({"squeeze_posture": None}, "grasp 2: squeeze_posture must be an object of keys"),
    ],
)
def test_postures_that_are_none_are_refused_with_their_grasp(
    tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    write_grasps(tmp_path / "a.json", with_joints())
    content = json.loads((tmp_path / "a.json").read_text())
    content["grasps"][1] |= change
    (tmp_path / "a.json").write_text(json.dumps(content))
    with pytest.raises(ContactError, match=message):
        read_poses(tmp_path / "a.json")


# Hands with joints: the same grasps through every format.

FORMATS = {
    "json": ".json", "csv": ".csv", "parquet": ".parquet", "isaac_grasp": ".yaml",
    "dexgraspbench": ".npy", "dexgraspnet": ".npy",
}  # fmt: skip

SHADOW_JOINTS = ("FFJ4", "FFJ3", "THJ5", "THJ1", "LFJ5")
IN_MODEL = ("FFJ3", "FFJ2", "THJ4", "THJ0", "LFJ4")
"""The same joints as DexGraspNet's model calls them."""


def grasps_of(name: str | ArticulatedHand, count: int = 4) -> GraspPoses:
    hand = hand_of(name) if isinstance(name, str) else name
    posture = random_postures(hand, count)
    moved = random_poses(count)
    moved[:, 2, 3] += 0.02
    return GraspPoses(
        poses=random_poses(count),
        posture=posture,
        joint_names=hand.joint_names,
        pregrasp_posture=0.8 * posture,
        squeeze_posture=1.1 * posture,
        pregrasp_poses=moved,
        unit="m",
        hand=hand,
        object_scale=0.08,
        object_file="mug.obj",
    )


def palms(poses: GraspPoses) -> Any:
    """Where the links beyond the wrist are, shape (k, l, 4, 4)."""
    assert isinstance(poses.hand, ArticulatedHand)
    links = poses.hand.link_names
    beyond = links[links.index(wrist_of(poses.hand).beyond) :]
    chosen = [links.index(link) for link in beyond]
    return poses.poses[:, None] @ poses.hand.link_poses(poses.posture)[:, chosen]


@pytest.mark.parametrize("form", list(FORMATS))
@pytest.mark.parametrize("name", HANDS)
def test_every_format_has_the_same_grasps(tmp_path: Path, name: str, form: str) -> None:
    poses = grasps_of(name)
    path = tmp_path / f"a{FORMATS[form]}"
    write_grasps(path, poses, format=form)
    back = read_poses(path, hand=poses.hand)
    equal(palms(back), palms(poses))
    if form == "dexgraspnet" and name == "shadow":
        assert str(back.gripper_frame) == "palm"  # it has no wrist
        return
    equal(back.posture, poses.posture)
    equal(back.poses, poses.poses)
    assert back.joint_names == (() if form == "dexgraspbench" else poses.joint_names)
    if form == "dexgraspbench":
        assert back.settings["joint_order"] == f"not stated: that of {name} is assumed"
    if form not in {"dexgraspnet", "isaac_grasp"}:
        equal(back.squeeze_posture, poses.squeeze_posture)
        equal(back.pregrasp_poses, poses.pregrasp_poses)
    if form != "dexgraspnet":
        equal(back.pregrasp_posture, poses.pregrasp_posture)
    if form != "csv":
        assert back.object_scale == 0.08


def test_joints_of_dexgraspnet_are_those_of_the_shadow_hand_with_their_signs() -> None:
    """Fingertips are where the model of gymnasium-robotics has them, relative to the palm."""
    model, hand = hand_of("shadow model"), hand_of("shadow")
    postures = random_postures(model, 20)
    postures[:, [n for n, joint in enumerate(model.joint_names) if "WRJ" in joint]] = 0.0
    given = GraspPoses(
        poses=random_poses(20), posture=postures, joint_names=model.joint_names, unit="m"
    )
    of_model = replace(given, joint_names=(), hand=model)
    names = [n for n, joint in enumerate(model.joint_names) if "WRJ" not in joint]
    fingers = tuple(model.joint_names[n] for n in names)
    bare = replace(given, posture=postures[:, names], joint_names=fingers)
    found = matched(bare, hand, wrist=wrist_of(hand).joints)
    tips = {}
    for one in (of_model, found):
        assert isinstance(one.hand, ArticulatedHand)
        links = one.hand.link_poses(one.posture)
        short = [link.removeprefix("robot0:") for link in one.hand.link_names]
        palm = np.linalg.inv(links[:, short.index("palm")])
        tips[one.hand.name] = [
            (palm @ links[:, short.index(f"{finger}distal")])[:, :3, 3]
            for finger in ("ff", "mf", "rf", "lf", "th")
        ]
    first, second = tips.values()
    # The descriptions differ by up to 2 mm; a wrong sign moves tips by centimetres.
    equal(first, second, 0.004)


@pytest.mark.parametrize("given", [IN_MODEL, SHADOW_JOINTS])
def test_a_posture_of_one_numbering_is_never_taken_for_the_other(given: tuple[str, ...]) -> None:
    hand = hand_of("shadow")
    names = tuple(f"robot0:{name}" for name in given)
    poses = GraspPoses(poses=np.eye(4), posture=np.zeros((1, 5)), joint_names=names, unit="m")
    with pytest.raises(ContactError, match=r"of shadow are missing") as error:
        matched(poses, hand)
    assert ("FFJ4," in str(error.value)) == (given == SHADOW_JOINTS)


@pytest.mark.parametrize(
    ("last", "message"),
    [
        (("joint_3", "joint_7.0"), r"joint_3 is no joint .*joint_3.0 of allegro is missing \(miss"),
        ((), "joint_3.0, joint_7.0 of allegro are missing"),
    ],
)
def test_missing_and_misspelt_joints_are_named(last: tuple[str, ...], message: str) -> None:
    hand = hand_of("allegro")
    names = (*(one for one in hand.joint_names if one not in {"joint_3.0", "joint_7.0"}), *last)
    postures = np.zeros((1, len(names)))
    poses = GraspPoses(poses=np.eye(4), posture=postures, joint_names=names, unit="m")
    with pytest.raises(ContactError, match=message) as error:
        matched(poses, hand)
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("prefix", ["", "bh_"])
@pytest.mark.parametrize("stage", ["posture", "squeeze_posture"])
def test_joints_that_follow_others_must_not_contradict_them(prefix: str, stage: str) -> None:
    hand = read_hand(hand_file("barrett"))
    assert isinstance(hand, ArticulatedHand)
    poses = grasps_of(hand)
    followers = [joint for joint in hand.tree.joints.values() if joint.follows]
    assert followers

    def values(posture: Any) -> Any:
        """A posture with the joints that follow, each as the one that it follows says."""
        more = [hand.tree.source_of(joint) for joint in followers]
        at = [hand.joint_names.index(source) for source, _, _ in more]
        factors, offsets = (np.array([one[k] for one in more]) for k in (1, 2))
        return np.hstack([posture, factors * posture[:, at] + offsets])

    names = (*hand.joint_names, *(joint.name for joint in followers))
    order = np.random.default_rng(2).permutation(len(names))
    last = order == len(names) - 1
    names = tuple(names[k] for k in order)
    stages = {name: values(one)[:, order] for name, one in poses.of_stages("posture").items()}
    full = replace(poses, joint_names=tuple(prefix + name for name in names), **stages)
    same_grasps(matched(full, hand), poses)
    stages[stage] = stages[stage] + 0.01 * last
    matched(replace(full, **stages), hand)
    stages[stage] = stages[stage] + 0.05 * (np.arange(4) == 2)[:, None] * last
    words = (
        f"grasp 3: joint finger_3_dist_joint of its {stage} .* follows finger_3_med_joint, which"
    )
    with pytest.raises(ContactError, match=rf"{words} says .*; so in 1 of 4 grasps") as error:
        matched(replace(full, **stages), hand)
    assert "\n" not in str(error.value)


def save(path: Path, content: Any) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    np.save(path, content, allow_pickle=True)
    return path


def qpos(poses: Any, posture: Any) -> Any:
    wxyz = Rotation.from_matrix(poses[:, :3, :3]).as_quat(scalar_first=True)
    return np.hstack([poses[:, :3, 3], wxyz, posture]).astype(np.float32)


def bench(poses: GraspPoses, row: int, **changes: Any) -> dict[str, Any]:
    """One grasp of DexGraspBench; the object lies somewhere on a table."""
    at = random_poses(1, seed=row)[0]
    rows = qpos(at @ poses.poses, poses.posture)
    of_object = qpos(at[None], np.zeros((1, 0)))[0]
    return {
        "obj_pose": of_object, "obj_scale": np.float32(0.08), "obj_path": "assets/DGNObj/mug",
        "pregrasp_qpos": np.r_[rows[row, :7], 0.9 * rows[row, 7:]], "grasp_qpos": rows[row],
        "squeeze_qpos": rows[row],
        **changes,
    }  # fmt: skip


def test_a_folder_of_files_of_one_grasp_each(tmp_path: Path) -> None:
    poses = grasps_of("allegro")
    for row in range(4):
        save(tmp_path / "mug" / "scale008" / f"{row}.npy", bench(poses, row))
    back = read_poses(tmp_path / "mug", hand=poses.hand)
    equal(back.poses, poses.poses, 1e-6)
    equal(back.posture, poses.posture, 1e-6)
    assert back.names == tuple(f"scale008/{row}" for row in range(4))
    assert (back.object_file, back.object_scale) == ("assets/DGNObj/mug", pytest.approx(0.08))
    save(tmp_path / "mug" / "bad.npy", {"other": np.zeros(3)})
    with pytest.raises(ContactError, match="dictionaries with the key grasp_qpos"):
        read_poses(tmp_path / "mug", hand=poses.hand)
    save(tmp_path / "mug" / "bad.npy", bench(poses, 3, obj_path="assets/DGNObj/pot"))
    with pytest.raises(ContactError, match="pot: put the files of each"):
        read_poses(tmp_path / "mug", hand=poses.hand)


@pytest.mark.parametrize("names", [("allegro/1", "leap/1"), ("ball_Leap", "ball-allegro2")])
def test_a_folder_with_grasps_of_two_hands_is_refused(
    tmp_path: Path, names: tuple[str, str]
) -> None:
    hand = grasps_of("allegro").hand
    for row, name in enumerate(names):
        save(tmp_path / "ball" / f"{name}.npy", bench(grasps_of("allegro"), row))
    assert holds_poses(tmp_path / "ball")
    with pytest.raises(ContactError, match="has grasps of 2 hands, such as allegro and leap: put"):
        read_poses(tmp_path / "ball", hand=hand)


def test_a_pose_of_the_object_that_is_elsewhere_must_be_given(tmp_path: Path) -> None:
    poses = grasps_of("allegro")
    one = bench(poses, 2)
    del one["obj_pose"]
    for stated, words in (
        ({"scene_path": "scene/tabletop.npy"}, "of the scene scene/tabletop.npy"),
        ({"scene_cfg": {"scene": {}}}, "of the scene in its scene_cfg"),
    ):
        path = save(tmp_path / "a.npy", one | stated)
        with pytest.raises(ContactError, match=rf"in the frame '{words}'.*give"):
            read_poses(path, hand=poses.hand)
        given = read_poses(path, hand=poses.hand, object_pose=random_poses(1, seed=2)[0])
        equal(given.poses[0], poses.poses[2], 1e-6)


def net(poses: GraspPoses, scales: list[float]) -> list[dict[str, Any]]:
    angles = Rotation.from_matrix(poses.poses[:, :3, :3]).as_euler("xyz")
    keys = ["WRJTx", "WRJTy", "WRJTz", "WRJRx", "WRJRy", "WRJRz", *poses.joint_names]
    values = np.hstack([poses.poses[:, :3, 3], angles, poses.posture]).tolist()
    return [
        {"qpos": dict(zip(keys, row, strict=True)), "scale": scale}
        for row, scale in zip(values, scales, strict=True)
    ]


def test_angles_of_dexgraspnet_are_about_fixed_axes_in_turn(tmp_path: Path) -> None:
    entries = net(replace(grasps_of("allegro", 1), poses=np.eye(4)), [0.1])
    entries[0]["qpos"] |= {"WRJRx": 0.3, "WRJRy": -0.7, "WRJRz": 1.9}
    back = read_poses(save(tmp_path / "a.npy", entries), hand=hand_of("allegro"))
    about = [Rotation.from_rotvec(v).as_matrix() for v in ([0.3, 0, 0], [0, -0.7, 0], [0, 0, 1.9])]
    equal(back.poses[0, :3, :3], about[2] @ about[1] @ about[0])


def test_grasps_at_several_scales_need_the_one_that_is_meant(tmp_path: Path) -> None:
    poses = grasps_of("allegro")
    path = save(tmp_path / "mug.npy", net(poses, [0.06, 0.1, 0.06, 0.15]))
    with pytest.raises(ContactError, match=r"the object at 3 scales, 0.06, 0.1, 0.15: choose one"):
        read_poses(path, hand=poses.hand)
    back = read_poses(path, hand=poses.hand, object_scale=0.06)
    equal(back.poses, poses.poses[[0, 2]])
    assert back.object_scale == 0.06
    with pytest.raises(ContactError, match=r"no grasps of the object at the scale 0.08; known are"):
        read_poses(path, hand=poses.hand, object_scale=0.08)
    write_grasps(tmp_path / "a.json", poses)
    with pytest.raises(ContactError, match=r"states the object's scale 0.08, not 0.1: give"):
        read_poses(tmp_path / "a.json", object_scale=0.1)
    bare = bench(poses, 0)
    del bare["obj_scale"]
    path = save(tmp_path / "b.npy", bare)
    assert read_poses(path, hand=poses.hand).object_scale is None
    assert read_poses(path, hand=poses.hand, object_scale=0.1).object_scale == 0.1


def test_joints_of_another_hand_are_refused(tmp_path: Path) -> None:
    poses, franka = grasps_of("allegro"), ParallelGripper.preset("franka")
    write_grasps(tmp_path / "a.csv", poses)
    box = load_mesh(shapes.box((9.0, 9.0, 9.0)), unit="m")
    words = r"values of 16 joints \(joint_0.0, .* but franka is a gripper of two jaws, which"
    with pytest.raises(ContactError, match=words):
        read_poses(tmp_path / "a.csv", hand=franka)
    with pytest.raises(ContactError, match=words):
        evaluate_grasps(box, poses, hand=franka)
    unnamed = GraspPoses(poses=np.eye(4), posture=np.zeros((1, 22)), unit="m")
    with pytest.raises(ContactError, match="have 22 values without names, but shadow has 24 joint"):
        matched(unnamed, hand_of("shadow"))
    with pytest.raises(ContactError, match="allegro is a hand with joints, but the poses have no"):
        matched(GraspPoses(poses=np.eye(4), unit="m"), hand_of("allegro"))


CYCLE: list[Any] = []
CYCLE.append(CYCLE)


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"grasp_qpos": np.zeros(7)}, "grasp_qpos must have 7 numbers of a pose and those"),
        ({"grasp_qpos": CYCLE}, "grasp_qpos must be numbers; got a list of 1$"),
        ({"obj_scale": np.nan}, r"scale of the object must be one number above 0; got \[?nan"),
        ({"grasp_qpos": np.zeros(23)}, "quaternion"),
        ({"squeeze_qpos": np.zeros(22)}, "squeeze_qpos must have .*; got 22, in the first 23"),
        ({"grasp_qpos": "none"}, "grasp_qpos must be numbers; got"),
        ({"grasp_qpos": None}, "grasp_qpos must be numbers; got nothing"),
        ({"grasp_qpos": np.array(["1", "wide"])}, "numbers; got a list of 2 with 'wide'"),
        ({"grasp_qpos": np.array([])}, "grasp_qpos must be numbers; there are none"),
        ({"grasp_qpos": np.r_[np.zeros(3), 1, np.zeros(18), np.nan]}, "value 16 of its posture"),
        ({"obj_pose": np.zeros(6)}, "obj_pose must have 7 numbers; got 6"),
        ({"obj_scale": [1.0, 1.0, 2.0]}, "the scale of the object must be one number"),
    ],
)
def test_dictionaries_with_other_values_are_refused(
    tmp_path: Path, change: dict[str, Any], message: str
) -> None:
    one = bench(grasps_of("allegro"), 0) | change
    with pytest.raises(ContactError, match=message) as error:
        read_poses(save(tmp_path / "a.npy", one), hand=hand_of("allegro"))
    assert "\n" not in str(error.value)


def test_lists_with_another_dictionary_are_refused(tmp_path: Path) -> None:
    path = save(tmp_path / "a.npy", [bench(grasps_of("allegro"), 0), {"scale": 1.0}])
    with pytest.raises(ContactError, match="dictionary 2: the key grasp_qpos is missing"):
        read_poses(path, hand=hand_of("allegro"))


class Executes:
    """What calls a function when it is unpickled in the usual way."""

    def __reduce__(self) -> tuple[Any, ...]:
        return os.mkdir, ("executed",)


def test_a_file_that_calls_functions_is_refused_in_one_sentence(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    one = bench(grasps_of("allegro"), 0) | {"note": Executes()}
    save(tmp_path / "a.npy", one)
    with pytest.raises(ContactError, match=r"a\.npy: is a pickle that names posix\.mkdir") as error:
        read_poses("a.npy", hand=hand_of("allegro"))
    assert "\n" not in str(error.value)
    assert [path.name for path in tmp_path.iterdir()] == ["a.npy"]


def test_hands_without_joints_and_grasps_without_postures_are_refused(tmp_path: Path) -> None:
    poses = grasps_of("allegro")
    path = save(tmp_path / "a.npy", bench(poses, 0))
    with pytest.raises(ContactError, match="DexGraspBench files have postures of a hand with joi"):
        read_poses(path)
    with pytest.raises(ContactError, match="'franka' is none: give its description"):
        read_poses(path, hand=ParallelGripper.preset("franka"))
    bare = GraspPoses(poses=poses.poses, unit="m", hand=poses.hand)
    with pytest.raises(OutputError, match="the poses have no values of them"):
        write_grasps(path, bare, format="dexgraspnet")
    with pytest.raises(OutputError, match="joints of the postures have no names: give the hand"):
        write_grasps(tmp_path / "a.csv", replace(with_joints(), joint_names=()))
