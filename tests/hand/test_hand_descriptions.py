"""Descriptions of hands with joints: proposals, JSON files and hands that are known by name."""

import json
import re
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

from grasp3d import read_hand
from grasp3d.errors import SettingError
from grasp3d.hand.articulated_hand import ArticulatedHand
from grasp3d.hand.hand import Hand
from grasp3d.hand.hand_files import hand_line, hand_of_line, write_hand
from grasp3d.hand.hand_json import KEYS
from grasp3d.hand.mujoco_model import read_links
from grasp3d.hand.parallel_gripper import PRESETS
from grasp3d.hand.proposal import articulated_hand_of, implausible
from grasp3d.hand.robot_files import NAMES
from tests.hand.test_robot_descriptions import urdf
from tests.helpers.hands import HANDS, hand_file, three_fingers


def read(path: Path, **options: Any) -> ArticulatedHand:
    hand = read_hand(path, **options)
    assert isinstance(hand, ArticulatedHand)
    assert isinstance(hand, Hand)
    return hand


def test_a_hand_is_proposed_from_its_links(tmp_path: Path) -> None:
    hand = read(three_fingers(tmp_path))
    assert hand.joint_names == ("knuckle0", "bend0", "knuckle1", "bend1", "knuckle2", "bend2")
    assert (hand.palm, hand.fingertips) == ("palm", ("outer0", "outer1", "outer2"))
    np.testing.assert_array_equal(hand.approach, [0.0, 0.0, 1.0])
    np.testing.assert_array_equal(hand.closing, -np.ones(6))
    np.testing.assert_array_equal(hand.preshapes["open"], np.zeros(6))
    np.testing.assert_array_equal(hand.torques, np.full(6, 0.5))
    assert hand.sensors == {}
    said = "\n".join(hand.assumed)
    for words in ("fingertips are", "the palm is palm", "joints close it", "open: ", "+z of palm",
                  "torques are the efforts"):  # fmt: skip
        assert words in said


@pytest.mark.slow
@pytest.mark.parametrize(("name", "base"), [("allegro", "joint_12.0"), ("leap", "12")])
def test_only_the_base_of_a_thumb_is_turned_in_the_open_preshape(name: str, base: str) -> None:
    """Fingers side by side spread to meet in one point, but stay straight in the preshape."""
    hand = articulated_hand_of(read_links(hand_file(name)))
    turned = np.abs(hand.preshapes["open"]) > 0.3
    assert [one for one, is_turned in zip(hand.joint_names, turned, strict=True) if is_turned] == [
        base
    ]


def test_a_camera_on_a_palm_that_turns_is_no_fingertip(tmp_path: Path) -> None:
    more = (
        '<link name="arm"/><joint name="wrist" type="continuous"><parent link="arm"/>'
        '<child link="palm"/></joint><link name="camera"><collision><geometry>'
        '<sphere radius="0.01"/></geometry></collision></link><joint name="mount" type="fixed">'
        '<parent link="palm"/><child link="camera"/></joint>'
    )
    hand = read(three_fingers(tmp_path, more=more))
    assert (hand.link_names[0], hand.palm) == ("arm", "palm")
    assert hand.fingertips == ("outer0", "outer1", "outer2")
    assert hand.joint_names[-1] == "wrist"
    assert hand.closing[-1] == 0.0
    assert "joints without limits: wrist" in hand.assumed


@pytest.mark.parametrize("effort", [0.0, 5.0, 10.0, 1000.0])
def test_efforts_that_no_finger_has_are_not_torques(tmp_path: Path, effort: float) -> None:
    hand = read(three_fingers(tmp_path, effort=effort))
    assert np.isnan(hand.torques).all()
    assert f"an effort of {effort:g} is not that of such a motor" in "\n".join(hand.assumed)


def test_json_gives_the_hand_again_from_any_folder(tmp_path: Path) -> None:
    (tmp_path / "models").mkdir()
    hand = read(three_fingers(tmp_path / "models"))
    path = tmp_path / "hand.json"
    write_hand(path, hand)
    content = json.loads(path.read_text(encoding="utf-8"))
    assert content["description"] == "models/three.urdf"
    assert {*content} == {*KEYS, "format", "version"} - {"notes"}
    for again in (read(path), hand_of_line(hand_line(read(path)))):
        stated, expected = dict(again.description()), dict(hand.description())
        assert Path(stated.pop("description")).samefile(expected.pop("description"))
        assert stated == expected


STATED: dict[str, Any] = {
    "palm": "inner0",
    "approach": [0.0, 2.0, 0.0],
    "fingertips": ["outer1"],
    "sensors": {"outer1": 0.3, "palm": 0.5},
    "torques": {"bend1": 1.5},
    "couplings": [
        {"joints": ["knuckle0", "bend0"], "ratios": [2.0, 1.0]},
    ],
    "preshapes": {"open": {"bend1": -0.1}, "wide": {"knuckle0": -0.2}},
    "closing": {"bend1": -2.0},
    "source": "a data sheet",
}


def test_what_a_description_states_is_so(tmp_path: Path) -> None:
    three_fingers(tmp_path)
    path = tmp_path / "hand.json"
    base = {"format": "grasp3d articulated hand", "version": 1, "description": "three.urdf"}
    path.write_text(json.dumps({**base, **STATED}), encoding="utf-8")
    hand = read(path)
    assert hand.joint_names == ("knuckle0", "knuckle1", "bend1", "knuckle2", "bend2")
    assert (hand.palm, hand.fingertips, hand.source) == ("inner0", ("outer1",), "a data sheet")
    assert hand.sensors == {"outer1": 0.3, "palm": 0.5}
    np.testing.assert_array_equal(hand.approach, [0.0, 1.0, 0.0])
    np.testing.assert_array_equal(hand.torques, [np.nan, np.nan, 1.5, np.nan, np.nan])
    np.testing.assert_array_equal(hand.closing, [0.0, 0.0, -2.0, 0.0, 0.0])
    np.testing.assert_array_equal(hand.preshapes["open"], [0.0, 0.0, -0.1, 0.0, 0.0])
    np.testing.assert_array_equal(hand.preshapes["wide"], [-0.2, 0.0, 0.0, 0.0, 0.0])
    assert [one.ratios for one in hand.couplings] == [(2.0, 1.0)]
    assert hand.assumed == ()


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "no file": ({"description": "other.urdf"}, r"other[.]urdf: there is no such file"),
    "a key": ({"fingertip": []}, r"no key is called 'fingertip' \(did you mean fingertips"),
    "a link": ({"fingertips": ["thumb"]}, "no link is called 'thumb'; known: palm, inner0"),
    "a joint": ({"closing": {"wrist": 1.0}}, "closing: 'wrist' is no joint of a posture; known"),
    "a joint that follows": (
        {
            "couplings": [{"joints": ["bend0", "bend1"], "ratios": [1, 1]}],
            "closing": {"bend0": 1, "bend1": 1},
            "torques": {"bend1": 1},
            "preshapes": {"open": {"bend0": 0, "bend1": 0}},
        },
        "bend1 follows bend0, and has no value of its own: take it out",
    ),
    "degrees": (
        {"preshapes": {"open": {"bend0": -20}}},
        r"preshape open: bend0 is at -20 rad \(-20° are -0.349 rad\), beyond the limits of bend0",
    ),
    "a circle": (
        {
            "couplings": [
                {"joints": ["bend0", "bend1"], "ratios": [1, 1]},
                {"joints": ["bend1", "bend0"], "ratios": [1, 1]},
            ]
        },
        "joint bend0 follows bend0, which it cannot",
    ),
    "one coupled joint": (
        {"couplings": [{"joints": ["bend0"], "ratios": [1]}]},
        "couplings must be a list of objects of",
    ),
    "a direction": ({"approach": [0, 0, 0]}, "approach must be a list of three numbers"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_descriptions_are_refused(tmp_path: Path, case: str) -> None:
    three_fingers(tmp_path)
    base = {"format": "grasp3d articulated hand", "version": 1, "description": "three.urdf"}
    changed, words = WRONG[case]
    path = tmp_path / "hand.json"
    path.write_text(json.dumps({**base, **changed}), encoding="utf-8")
    with pytest.raises(SettingError, match=rf"hand[.]json: .*{words}"):
        read_hand(path)


UNLIKELY: dict[str, tuple[dict[str, Any], str]] = {
    "torques": ({"torques": {"bend0": 200}}, "200 N m at bend0 .*in N mm, and 0.2 N m meant"),
    "resolution": ({"sensors": {"outer0": 2}}, "115°: it is stated in radians, and 2° are 0.0349"),
    "turns": (
        {"preshapes": {"open": {"knuckle0": -20}}},
        "-20 rad, more than a turn: -20° are -0.3",
    ),
}


@pytest.mark.parametrize("case", UNLIKELY)
def test_numbers_that_no_hand_has_are_named(tmp_path: Path, case: str) -> None:
    three_fingers(tmp_path, kind="continuous")
    base = {"format": "grasp3d articulated hand", "version": 1, "description": "three.urdf"}
    changed, words = UNLIKELY[case]
    path = tmp_path / "hand.json"
    path.write_text(json.dumps({**base, **changed}), encoding="utf-8")
    (said,) = implausible(read(path))
    assert re.search(words, said)
    path.write_text(json.dumps(base), encoding="utf-8")
    assert not [*implausible(read(path))]


def unlikely(path: Path) -> list[str]:
    return [*implausible(read(path))]


def test_limits_that_no_hand_has_are_named(tmp_path: Path) -> None:
    path = three_fingers(tmp_path)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace('lower="-1.5"', 'lower="-70"'), encoding="utf-8")
    (said,) = unlikely(path)
    assert said.startswith("limits from -70 to 0 rad of bend0, bend1, bend2 are more than a turn")
    follows = '<mimic joint="knuckle0" multiplier="-1"/>'
    limits = '<limit lower="-1.5" upper="0" effort="0.5"/>'
    for lower, what in (("0.1", "value"), ("0", "travel")):
        some = text.replace('lower="-1.2" upper="0.3"', f'lower="{lower}" upper="0.9"')
        other = limits.replace("-1.5", lower).replace('upper="0"', 'upper="0.9"')
        path.write_text(some.replace(limits, other + follows, 1), encoding="utf-8")
        (said,) = unlikely(path)
        assert f"bend0 follows knuckle0 times -1, and its limits, from {lower} to 0.9" in said
        assert f"leave knuckle0 no {what}" in said


def test_meshes_in_millimetres_are_named(tmp_path: Path) -> None:
    trimesh.creation.box([10.0, 10.0, 40.0]).export(tmp_path / "f.stl")
    (said,) = unlikely(three_fingers(tmp_path, shape='<mesh filename="f.stl" scale="0.1"/>'))[:1]
    assert said == "the mesh of inner0 is 4 m long: is it in mm (scale 0.001)?"


def test_flat_meshes_are_refused(tmp_path: Path) -> None:
    corners = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.1, 0.1, 0.0]]
    trimesh.Trimesh(corners, [[0, 1, 2], [1, 3, 2]]).export(tmp_path / "f.stl")
    with pytest.raises(SettingError, match="a collision mesh of inner0 is flat"):
        read(three_fingers(tmp_path, shape='<mesh filename="f.stl"/>'))


def test_links_that_are_only_seen_are_named(tmp_path: Path) -> None:
    ball = '<visual><geometry><sphere radius="0.01"/></geometry></visual>'
    path = three_fingers(tmp_path, more=f'<link name="tip">{ball}</link>' + FIXED)
    said = "\n".join(read(path).assumed)
    assert "are only seen, without collision geometry, touch nothing: tip" in said
    text = path.read_text(encoding="utf-8").replace("collision", "visual")
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SettingError, match=r"ends with a link .*; only seen are palm, inner0,"):
        read(path)


FIXED = '<joint name="end" type="fixed"><parent link="outer0"/><child link="tip"/></joint>'


@pytest.mark.parametrize("name", HANDS)
def test_nothing_of_known_hands_is_unlikely(name: str) -> None:
    assert not [*implausible(read(hand_file(name)))]


def test_only_the_palm_is_named_beside_a_model(tmp_path: Path) -> None:
    path = three_fingers(tmp_path)
    assert read(path, palm="inner1").palm == "inner1"
    with pytest.raises(SettingError, match="tcp is for grippers of two fingers"):
        read_hand(path, tcp=0.1)


def test_links_without_joints_are_no_hand(tmp_path: Path) -> None:
    path = tmp_path / "post.urdf"
    for links, words in (('<link name="a"/>', "no joint moves anything"), ("", "it has no links")):
        path.write_text(f'<robot name="p">{links}</robot>', encoding="utf-8")
        with pytest.raises(SettingError, match=words):
            read_hand(path)


def test_an_arm_with_a_gripper_is_the_gripper(tmp_path: Path) -> None:
    path = urdf(tmp_path)
    arm = '<joint name="wrist" type="continuous">'
    text = path.read_text(encoding="utf-8").replace('<joint name="wrist" type="fixed">', arm)
    path.write_text(text, encoding="utf-8")
    assert read_hand(path) == read_hand(path, fingers=("left", "right"))


def turning_fingers(folder: Path, upper: float) -> Path:
    """Two fingers that turn together, below a driver named as in descriptions of Robotiq's."""
    joint = (
        '<link name="{0}"/><joint name="{0}_joint" type="revolute"><parent link="base"/>'
        '<child link="{0}"/><axis xyz="1 0 0"/><limit lower="0" upper="{1}"/>{2}</joint>'
    )
    follows = '<mimic joint="gripper_finger_joint"/>'
    fingers = joint.format("gripper_finger", upper, "") + joint.format("other", upper, follows)
    path = folder / "turning.urdf"
    path.write_text(f'<robot name="r"><link name="base"/>{fingers}</robot>', encoding="utf-8")
    return path


@pytest.mark.parametrize(("upper", "name"), [(0.8, "robotiq_2f85"), (0.7, "robotiq_2f140")])
def test_parallel_fingers_that_turn_are_those_of_a_preset(
    tmp_path: Path, upper: float, name: str
) -> None:
    found = read_hand(turning_fingers(tmp_path, upper))
    assert found.description().pop("source") == (
        f"{PRESETS[name].source}; it is {name}, whose joint turning.urdf has"
    )
    assert replace(found, source=PRESETS[name].source) == PRESETS[name]
    with pytest.raises(SettingError, match="no finger ends with a link that has collision"):
        read_hand(turning_fingers(tmp_path, 1.3))


@pytest.mark.parametrize(
    "name", ["allegro", "barrett", *(pytest.param(n, marks=pytest.mark.slow) for n in HANDS[1:3])]
)
def test_known_hands_are_found_by_their_joints(name: str) -> None:
    found = read(hand_file(name))
    assert found.name == name
    assert f"it is the hand {name}, whose joints have the same names" in found.assumed
    torques = np.full(len(found.joint_names), {"allegro": 0.7, "leap": 0.93}.get(name, np.nan))
    if name == "shadow":  # of the last two joints of four fingers
        torques[[one[1:] in {"FJ1", "FJ2"} for one in found.joint_names]] = 0.0
    np.testing.assert_array_equal(found.torques, torques)
    np.testing.assert_allclose(
        found.approach, [0.0, 0.0, 1.0] if name == "barrett" else [1.0, 0.0, 0.0], atol=1e-5
    )
    # The fingertips come nearer to each other when it closes.
    apart = []
    for share in (0.0, 0.3):
        posture = found.preshapes["open"] + share * found.closing
        (poses,) = found.link_poses(posture)
        tips = [poses[found.link_names.index(tip)] for tip in found.fingertips]
        middles = [
            pose[:3, :3] @ found.tree.geometry(tip).reshape(-1, 3).mean(axis=0) + pose[:3, 3]
            for tip, pose in zip(found.fingertips, tips, strict=True)
        ]
        apart.append(np.linalg.norm(np.std(middles, axis=0)))
    assert apart[1] < apart[0] - 0.005


def test_couplings_of_known_hands() -> None:
    hand = read(hand_file("barrett"))
    assert hand.joint_names == (
        "finger_1_prox_joint", "finger_1_med_joint", "finger_2_med_joint", "finger_3_med_joint",
    )  # fmt: skip


def test_a_prefix_of_all_names_is_found(tmp_path: Path) -> None:
    text = hand_file("barrett").read_text(encoding="utf-8")
    for word in ("base_link", "finger_"):
        text = text.replace(f'"{word}', f'"rh_{word}')
    path = tmp_path / "hand.urdf"
    folder = hand_file("barrett").parent.as_posix()
    path.write_text(text.replace('filename="', f'filename="{folder}/'), encoding="utf-8")
    hand = read(path)
    assert (hand.name, hand.palm) == ("barrett", "rh_base_link")
    assert hand.joint_names[0] == "rh_finger_1_prox_joint"


@pytest.mark.slow
def test_a_prefix_does_not_change_keys_that_are_called_as_a_link(tmp_path: Path) -> None:
    text = hand_file("shadow").read_text(encoding="utf-8")
    text = re.sub(r'(?<!file)(name|link|joint)="', r'\1="rh_', text)
    path = tmp_path / "hand.urdf"
    folder = hand_file("shadow").parent.as_posix()
    path.write_text(text.replace('filename="', f'filename="{folder}/'), encoding="utf-8")
    hand = read(path)
    assert (hand.name, hand.palm) == ("shadow", "rh_palm")


def test_names_of_known_hands_need_a_file() -> None:
    for name in NAMES:
        with pytest.raises(SettingError, match=f"{name} is a hand with joints, known without"):
            read_hand(name)
