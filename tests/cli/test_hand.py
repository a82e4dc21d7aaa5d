"""`grasp3d hand`: grippers, and hands with joints."""

import re
from pathlib import Path

import pytest

from grasp3d.hand.hand_files import read_hand
from grasp3d.hand.parallel_gripper import PRESETS, ParallelGripper
from tests.helpers import slider_hand
from tests.helpers.commands import printed, refusal
from tests.helpers.hands import hand_file, three_fingers


def test_without_a_hand_those_that_are_known_are_listed(tmp_path: Path) -> None:
    text = printed("hand", cwd=tmp_path, columns=80)
    for name in (*PRESETS, "(panda)", "hands with joints: allegro, leap, shadow, barrett"):
        assert name in text
    assert max(map(len, text.splitlines())) <= 82


@pytest.mark.parametrize("name", PRESETS)
def test_lengths_frame_force_and_touch_are_printed(tmp_path: Path, name: str) -> None:
    gripper = ParallelGripper.preset(name)
    text = printed("hand", name, cwd=tmp_path, columns=200)
    lines = dict(re.findall(r"^(\w[\w ]*?)  +(\S.*?) *$", text, re.MULTILINE))
    for length in ("min_opening", "max_opening", "finger_thickness", "base_to_tcp"):
        assert lines[length.replace("_", " ")] == f"{1e3 * getattr(gripper, length):.4g}"
    assert lines["max force"] == f"{gripper.max_force:g} N"
    assert lines["sensor resolution"] == ("22.92°" if gripper.round_tips else "not stated")
    for joint in gripper.joint_names:
        assert joint in text


def test_a_gripper_is_written_drawn_and_read_again(tmp_path: Path) -> None:
    words = ("-o", "g.json", "--picture", "g.png", "--frames", "f.svg")
    text = printed("hand", "panda", *words, cwd=tmp_path)
    assert text.endswith("written: g.json, g.png, f.svg\n")
    assert read_hand(tmp_path / "g.json") == ParallelGripper.preset("franka")
    assert (tmp_path / "g.png").read_bytes().startswith(b"\x89PNG")
    drawn = (tmp_path / "f.svg").read_text(encoding="utf-8")
    for name in ("graspgen", "panda_link8", "dexnet"):
        assert name in drawn
    assert printed("hand", "g.json", "-q", "-o", "g.json", "--overwrite", cwd=tmp_path) == ""


def test_a_hand_with_joints_is_proposed_printed_and_drawn(tmp_path: Path) -> None:
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


def test_joints_without_limits_or_that_slide_sensors_and_couplings_are_said(
    tmp_path: Path,
) -> None:
    for made, lines in (
        (lambda: three_fingers(tmp_path, kind="continuous"), ["joints without limits: knuckle0"]),
        (
            lambda: slider_hand.write(tmp_path, sensors={"finger_1": 0.3}),
            ["finger_1 resolves 17.19°", "sliding in mm and N", "slide_0 finger_0 0 60 "],
        ),
        (lambda: hand_file("barrett"), ["coupling finger_1_med_joint : 3, finger_1_dist_joint"]),
    ):
        text = " ".join(printed("hand", made(), cwd=tmp_path, columns=200).split())
        assert [line for line in lines if line not in text] == []


BAD = {
    "links": ("three.urdf --palm thumb", "no link is called 'thumb'; known: palm, inner0"),
    "mesh": ("mesh.urdf", "there is no mesh tip.stl of link inner0; put it where the file says"),
    "frames": ("three.urdf --frames f.png", "--frames is for parallel grippers; 'three' is none"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_models_are_refused_in_a_sentence(tmp_path: Path, case: str) -> None:
    words, reason = BAD[case]
    three_fingers(tmp_path, shape='<mesh filename="tip.stl"/>').rename(tmp_path / "mesh.urdf")
    three_fingers(tmp_path)
    assert reason in refusal(f"hand {words} -o three.json", tmp_path)
