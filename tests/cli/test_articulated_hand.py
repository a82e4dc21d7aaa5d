"""`grasp3d hand` and other commands with hands with joints."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import trimesh

from grasp3d.cli.hand import print_hand
from grasp3d.cli.report import Report
from grasp3d.hand.articulated_hand import ArticulatedHand
from grasp3d.hand.hand_files import read_hand
from tests.helpers import slider_hand
from tests.helpers.commands import printed, refusal
from tests.helpers.hands import hand_file, three_fingers


def test_a_description_is_proposed_printed_and_drawn(tmp_path: Path) -> None:
    three_fingers(tmp_path, effort=10.0)
    words = ("hand", "three.urdf", "-o", "three.json", "--picture", "three.png")
    text = printed(*words, cwd=tmp_path, columns=200)
    assert text.endswith("written: three.json, three.png\n")
    for line in (
        r"knuckle0  inner0  -68.75  17.19      0      -1  not stated",
        r"fingertips  outer0, outer1, outer2",
        r"assumed an effort of 10 is not that of such a motor: the torque is not stated (knuckle0",
        r"approach   (0, 0, 1) in it, open",
    ):
        assert " ".join(line.split()) in " ".join(text.split())
    assert (tmp_path / "three.png").read_bytes().startswith(b"\x89PNG")
    again = printed("hand", "three.json", cwd=tmp_path, columns=200)
    assert text.startswith(again)
    assert read_hand(tmp_path / "three.json").name == "three"


def test_known_hands_are_listed_and_named(tmp_path: Path) -> None:
    text = printed("hand", cwd=tmp_path, columns=80)
    assert "hands with joints: allegro, leap, shadow, barrett" in text
    text = printed("hand", hand_file("barrett"), cwd=tmp_path, columns=200)
    assert "coupling    finger_1_med_joint : 3, finger_1_dist_joint : 1" in text


ROD = '<joint name="rod" type="fixed"><parent link="{}"/><child link="{}"/></joint>'
BAD = {
    "links": ({}, "--palm thumb", "no link is called 'thumb'; known: palm, inner0"),
    "loop": (
        {"more": ROD.format("outer0", "palm")},
        "",
        "MuJoCo cannot read it (XML Error: URDF body not found",
    ),
    "mesh": (
        {"shape": '<mesh filename="tip.stl"/>'},
        "",
        "there is no mesh tip.stl of link inner0; put it where the file says",
    ),
    "frames": ({}, "--frames f.png", "--frames is for parallel grippers; 'three' is none"),
}  # fmt: skip


@pytest.mark.parametrize("case", BAD)
def test_bad_models_are_refused_in_a_sentence(tmp_path: Path, case: str) -> None:
    options, words, reason = BAD[case]
    three_fingers(tmp_path, **options)
    said = refusal(f"hand three.urdf {words} -o three.json", tmp_path)
    assert reason in said


def test_joints_that_turn_without_end_are_said(tmp_path: Path) -> None:
    path = three_fingers(tmp_path, kind="continuous")
    assert "joints without limits: knuckle0" in printed("hand", path, cwd=tmp_path, columns=200)


def test_labels_of_a_surface_refuse_hands_with_joints(tmp_path: Path) -> None:
    three_fingers(tmp_path)
    description = {"format": "grasp3d articulated hand", "version": 1, "description": "three.urdf"}
    (tmp_path / "three.json").write_text(json.dumps(description), encoding="utf-8")
    trimesh.creation.box([0.05, 0.05, 0.05]).export(tmp_path / "box.glb")
    said = refusal("label box.glb -o out.ply --hand three.json", tmp_path)
    assert "three is a hand with joints: poses with values of its joints are evaluated" in said
    assert not list(tmp_path.glob("out*"))


def test_a_direction_is_printed_without_what_rounding_left(
    capsys: pytest.CaptureFixture[str],
) -> None:
    hand = read_hand(hand_file("allegro"))
    assert isinstance(hand, ArticulatedHand)
    print_hand(Report(), replace(hand, approach=np.array([1.0, -6.3e-6, -1e-9])))
    assert "(1, 0, 0) in it, open" in capsys.readouterr().out


def test_joints_that_slide_are_printed_in_their_units(tmp_path: Path) -> None:
    path = slider_hand.write(tmp_path, sensors={"finger_1": 0.3})
    text = printed("hand", path, cwd=tmp_path, columns=200)
    lines = [" ".join(line.split()) for line in text.splitlines()]
    assert "sensor finger_1 resolves 17.19°" in lines
    assert "sliding in mm and N\n" in text
