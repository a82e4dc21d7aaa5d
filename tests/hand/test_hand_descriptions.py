"""Descriptions of hands with joints: proposals, JSON files and hands that are known by name."""

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grasp3d import read_hand
from grasp3d.errors import SettingError
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand
from grasp3d.hand.articulated.hand_json import KEYS
from grasp3d.hand.articulated.plausible_numbers import implausible
from grasp3d.hand.articulated.presets import NAMES, content_of
from grasp3d.hand.articulated.proposal import articulated_hand_of
from grasp3d.hand.hand import Hand
from grasp3d.hand.hand_files import hand_line, hand_of_line, write_hand
from grasp3d.hand.robot_files import read_links
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
        "bend1 follows bend0, .*: take it out of closing and torques and the preshape open",
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


@pytest.mark.parametrize("name", HANDS)
def test_nothing_of_known_hands_is_unlikely(name: str) -> None:
    assert not [*implausible(read(hand_file(name)))]


def test_only_the_palm_is_named_beside_a_model(tmp_path: Path) -> None:
    path = three_fingers(tmp_path)
    assert read(path, palm="inner1").palm == "inner1"
    with pytest.raises(SettingError, match="tcp is for grippers of two fingers"):
        read_hand(path, tcp=0.1)
    with pytest.raises(SettingError, match="preset is for hands with joints"):
        read_hand(path, fingers=("outer0", "outer1"), preset="allegro")


def test_links_without_joints_are_no_hand(tmp_path: Path) -> None:
    path = tmp_path / "post.urdf"
    for links, words in (('<link name="a"/>', "no joint moves anything"), ("", "it has no links")):
        path.write_text(f'<robot name="p">{links}</robot>', encoding="utf-8")
        with pytest.raises(SettingError, match=words):
            read_hand(path)


def test_an_arm_with_a_gripper_needs_the_names_of_its_fingers(tmp_path: Path) -> None:
    path = urdf(tmp_path)
    arm = '<joint name="wrist" type="continuous">'
    text = path.read_text(encoding="utf-8").replace('<joint name="wrist" type="fixed">', arm)
    path.write_text(text, encoding="utf-8")
    with pytest.raises(SettingError, match="its fingers slide: name the links of its two fingers"):
        read_hand(path)


@pytest.mark.parametrize(
    "name", ["allegro", "barrett", *(pytest.param(n, marks=pytest.mark.slow) for n in HANDS[1:3])]
)
def test_known_hands_are_found_by_their_joints(name: str) -> None:
    found = read(hand_file(name))
    assert found.name == name
    assert f"it is the hand {name}, whose joints have the same names" in found.assumed
    named = read(hand_file(name), preset=name)
    assert named.assumed == tuple(one for one in found.assumed if "it is the hand" not in one)
    torques = {"allegro": 0.7, "leap": 0.93}.get(name, np.nan)
    np.testing.assert_array_equal(found.torques, np.full(len(found.joint_names), torques))
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
    tendons = content_of("shadow")["tendons"]
    assert tendons == [f"{f}J2 and {f}J1" for f in ["FF", "MF", "RF", "LF"]]


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


def test_names_of_known_hands_need_a_file(tmp_path: Path) -> None:
    for name in NAMES:
        with pytest.raises(SettingError, match=f"{name} is a hand with joints, known without"):
            read_hand(name)
        assert content_of(name)["source"]
    path = three_fingers(tmp_path)
    with pytest.raises(
        SettingError, match="it is no allegro as that is known: it has no base_link"
    ):
        read_hand(path, preset="allegro")
    with pytest.raises(SettingError, match=r"'alegro' \(did you mean allegro"):
        read_hand(path, preset="alegro")
