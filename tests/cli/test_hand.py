"""`grasp3d hand`."""

import re
from collections.abc import Callable
from pathlib import Path

import pytest

from grasp3d.hand.hand_files import read_hand
from grasp3d.hand.parallel_gripper import PRESETS, ParallelGripper
from tests.hand.test_robot_descriptions import mjcf, urdf
from tests.helpers.commands import printed, refusal
from tests.helpers.commands import run_here as grasp3d


def test_without_a_gripper_the_presets_are_listed(tmp_path: Path) -> None:
    text = printed("hand", cwd=tmp_path, columns=80)
    for name in (*PRESETS, "(panda)"):
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


def test_json_and_picture_are_written_and_read_again(tmp_path: Path) -> None:
    run = grasp3d("hand", "panda", "-o", "g.json", "--picture", "g.png", cwd=tmp_path)
    assert run.stdout.endswith("written: g.json, g.png\n")
    assert read_hand(tmp_path / "g.json") == ParallelGripper.preset("franka")
    assert (tmp_path / "g.png").read_bytes().startswith(b"\x89PNG")
    # It may have been written by hand.
    assert "exists; name another file" in refusal("hand g.json -q -o g.json", tmp_path)
    assert printed("hand", "g.json", "-q", "-o", "g.json", "--overwrite", cwd=tmp_path) == ""


@pytest.mark.parametrize("kind", [urdf, mjcf])
def test_robots_are_read_by_their_finger_links(
    tmp_path: Path, kind: Callable[[Path], Path]
) -> None:
    path = kind(tmp_path)
    words = ("--fingers", "left", "right")
    printed("hand", path, *words, "--tcp", "9cm", "-o", "g.json", cwd=tmp_path)
    gripper = read_hand(tmp_path / "g.json")
    assert gripper == read_hand(path, fingers=("left", "right"), tcp=0.09)
    assert gripper.base_to_tcp == 0.09
    assert gripper.source.startswith(f"boxes around left, right and the palm of {path.name}; ")
    assert (
        "assumed: the inner sides are flat, and nothing else of a finger touches" in gripper.source
    )
    printed("hand", path, "-o", "found.json", cwd=tmp_path)  # the only two links that slide
    assert read_hand(tmp_path / "found.json") == read_hand(path, fingers=("left", "right"))
    assert "known: " in refusal(f"hand {path} --fingers left rihgt", tmp_path)
