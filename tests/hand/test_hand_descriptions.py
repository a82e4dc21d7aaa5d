"""Descriptions of hands with joints: proposals, JSON files and hands that are known by name."""

import itertools
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
from grasp3d.hand.parallel_gripper import PRESETS
from grasp3d.hand.proposal import implausible
from grasp3d.hand.robot_files import NAMES
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
    for words in ("fingertips are", "the palm is palm", "joints that close it", "open: ",
                  "+z of palm", "torques are the efforts"):  # fmt: skip
        assert words in said


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
    assert (hand.joint_names[-1], hand.closing[-1]) == ("wrist", 0.0)


@pytest.mark.parametrize("effort", [0.0, 5.0, 1000.0])
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


BASE = {"format": "grasp3d articulated hand", "version": 1, "description": "three.urdf"}
STATED: dict[str, Any] = {
    "palm": "inner0",
    "approach": [0.0, 2.0, 0.0],
    "fingertips": ["outer1"],
    "sensors": {"outer1": 0.3, "palm": 0.5},
    "torques": {"bend1": 1.5},
    "couplings": [{"joints": ["knuckle0", "bend0"], "ratios": [2.0, 1.0]}],
    "preshapes": {"open": {"bend1": -0.1}, "wide": {"knuckle0": -0.2}},
    "closing": {"bend1": -2.0},
    "source": "a data sheet",
}


def test_what_a_description_states_is_so(tmp_path: Path) -> None:
    three_fingers(tmp_path)
    path = tmp_path / "hand.json"
    path.write_text(json.dumps({**BASE, **STATED}), encoding="utf-8")
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


def coupled(*joints: str) -> dict[str, Any]:
    pairs = itertools.pairwise(joints)
    return {"couplings": [{"joints": pair, "ratios": [1, 1]} for pair in pairs]}


WRONG: dict[str, tuple[dict[str, Any], str]] = {
    "no file": ({"description": "other.urdf"}, r"other[.]urdf: there is no such file"),
    "a key": ({"fingertip": []}, r"no key is called 'fingertip' \(did you mean fingertips"),
    "a link": ({"fingertips": ["thumb"]}, "no link is called 'thumb'; known: palm, inner0"),
    "a joint": ({"closing": {"wrist": 1.0}}, "closing: 'wrist' is no joint of a posture; known"),
    "a joint that follows": (
        {**coupled("bend0", "bend1"), "closing": {"bend0": 1, "bend1": 1}},
        "bend1 follows bend0, and has no value of its own: leave it out",
    ),
    "degrees": (
        {"preshapes": {"open": {"bend0": -20}}},
        r"preshape open: bend0 is at -20 rad \(-20° are -0.349 rad\), beyond the limits of bend0",
    ),
    "a circle": (coupled("bend0", "bend1", "bend0"), "joint bend0 follows bend0, which it cannot"),
    "one coupled joint": (
        {"couplings": [{"joints": ["bend0"], "ratios": [1]}]},
        "couplings must be a list of objects of",
    ),
    "a direction": ({"approach": [0, 0, 0]}, "approach must be a list of three numbers"),
    "a mass of 0": ({"masses": {"outer0": {"mass": 0.0}}}, "masses must be an object"),
    "a flat centre": ({"masses": {"outer0": {"mass": 1, "center": [0, 0]}}}, "masses must be an"),
    "a link with a mass": ({"masses": {"outer7": {"mass": 0.1}}}, "no link is called 'outer7'"),
}


@pytest.mark.parametrize("case", WRONG)
def test_wrong_descriptions_are_refused(tmp_path: Path, case: str) -> None:
    three_fingers(tmp_path)
    changed, words = WRONG[case]
    path = tmp_path / "hand.json"
    path.write_text(json.dumps({**BASE, **changed}), encoding="utf-8")
    with pytest.raises(SettingError, match=rf"hand[.]json: .*{words}"):
        read_hand(path)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"torques": {"bend0": 200}}, "200 N m at bend0 .*in N mm, and 0.2 N m meant"),
        ({"sensors": {"outer0": 2}}, "115°: it is stated in radians, and 2° are 0.0349"),
        ({"preshapes": {"open": {"knuckle0": -20}}}, "-20 rad, more than a turn: -20° are -0.3"),
    ],
)
def test_numbers_that_no_hand_has_are_named(
    tmp_path: Path, changed: dict[str, Any], words: str
) -> None:
    three_fingers(tmp_path, kind="continuous")
    path = tmp_path / "hand.json"
    path.write_text(json.dumps({**BASE, **changed}), encoding="utf-8")
    (said,) = implausible(read(path))
    assert re.search(words, said)


def test_limits_that_no_hand_has_are_named(tmp_path: Path) -> None:
    path = three_fingers(tmp_path)
    text = path.read_text(encoding="utf-8")
    path.write_text(text.replace('lower="-1.5"', 'lower="-70"'), encoding="utf-8")
    (said,) = implausible(read(path))
    assert said.startswith("limits from -70 to 0 rad of bend0, bend1, bend2 are more than a turn")
    follows = '<mimic joint="knuckle0" multiplier="-1"/>'
    limits = '<limit lower="-1.5" upper="0" effort="0.5"/>'
    for lower, what in (("0.1", "value"), ("0", "travel")):
        some = text.replace('lower="-1.2" upper="0.3"', f'lower="{lower}" upper="0.9"')
        other = limits.replace("-1.5", lower).replace('upper="0"', 'upper="0.9"')
        path.write_text(some.replace(limits, other + follows, 1), encoding="utf-8")
        (said,) = implausible(read(path))
        assert f"bend0 follows knuckle0 times -1, and its limits, from {lower} to 0.9" in said
        assert f"leave knuckle0 no {what}" in said


def test_links_that_are_only_seen_and_odd_meshes_are_named(tmp_path: Path) -> None:
    ball = '<visual><geometry><sphere radius="0.01"/></geometry></visual>'
    fixed = '<joint name="end" type="fixed"><parent link="outer0"/><child link="tip"/></joint>'
    path = three_fingers(tmp_path, more=f'<link name="tip">{ball}</link>{fixed}')
    said = "\n".join(read(path).assumed)
    assert "without collision geometry, which are only seen, touch nothing: tip" in said
    text = path.read_text(encoding="utf-8").replace("collision", "visual")
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SettingError, match=r"ends with a link .*; only seen are palm, inner0,"):
        read(path)
    with pytest.raises(SettingError, match="tcp is for grippers of two fingers"):
        read_hand(three_fingers(tmp_path), tcp=0.1)
    assert read(three_fingers(tmp_path), palm="inner1").palm == "inner1"
    trimesh.creation.box([10.0, 10.0, 40.0]).export(tmp_path / "f.stl")
    long = three_fingers(tmp_path, shape='<mesh filename="f.stl" scale="0.1"/>')
    assert "the mesh of inner0 is 4 m long: is it in mm (scale 0.001)?" in implausible(read(long))
    corners = [[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [0.0, 0.1, 0.0], [0.1, 0.1, 0.0]]
    trimesh.Trimesh(corners, [[0, 1, 2], [1, 3, 2]]).export(tmp_path / "f.stl")
    with pytest.raises(SettingError, match="a collision mesh of inner0 is flat"):
        read(three_fingers(tmp_path, shape='<mesh filename="f.stl"/>'))


def test_links_without_joints_are_no_hand(tmp_path: Path) -> None:
    path = tmp_path / "post.urdf"
    for links, words in (('<link name="a"/>', "no joint moves anything"), ("", "it has no links")):
        path.write_text(f'<robot name="p">{links}</robot>', encoding="utf-8")
        with pytest.raises(SettingError, match=words):
            read_hand(path)


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
    assert not [*implausible(found)]
    assert f"it is the hand {name}, whose joints have the same names" in found.assumed
    torques = np.full(len(found.joint_names), {"allegro": 0.7, "leap": 0.93}.get(name, np.nan))
    if name == "shadow":  # of the last two joints of four fingers
        torques[[one[1:] in {"FJ1", "FJ2"} for one in found.joint_names]] = 0.0
    np.testing.assert_array_equal(found.torques, torques)
    np.testing.assert_allclose(
        found.approach, [0.0, 0.0, 1.0] if name == "barrett" else [1.0, 0.0, 0.0], atol=1e-5
    )
    # Fingers side by side spread to meet in one point, but stay straight in the preshape.
    turned = np.flatnonzero(np.abs(found.preshapes["open"]) > 0.3)
    if name in {"allegro", "leap"}:
        assert [found.joint_names[one] for one in turned] == [
            {"allegro": "joint_12.0", "leap": "12"}[name]
        ]
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


def test_a_prefix_of_all_names_is_found(tmp_path: Path) -> None:
    text = hand_file("barrett").read_text(encoding="utf-8")
    for word in ("base_link", "finger_"):
        text = text.replace(f'"{word}', f'"rh_{word}')
    path = tmp_path / "hand.urdf"
    folder = hand_file("barrett").parent.as_posix()
    path.write_text(text.replace('filename="', f'filename="{folder}/'), encoding="utf-8")
    hand = read(path)
    assert (hand.name, hand.palm) == ("barrett", "rh_base_link")
    names = ("finger_1_prox", "finger_1_med", "finger_2_med", "finger_3_med")
    assert hand.joint_names == tuple(f"rh_{one}_joint" for one in names)


def test_names_of_known_hands_need_a_file() -> None:
    for name in NAMES:
        with pytest.raises(SettingError, match=f"{name} is a hand with joints, whose links are"):
            read_hand(name)
