"""What every reader does with numbers, names and paths that nothing can be made of."""

import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import pytest

import grasp3d
from grasp3d.errors import GraspError, SettingError
from grasp3d.formats import holds_poses, read_object_pose, read_poses
from grasp3d.hand.hand_files import hand_of_line, read_hand
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.outcomes.tried_grasps import MeshFolder
from grasp3d.system.documents import LONGEST_NUMBER, parse_json
from grasp3d.viewer.collection import open_collection
from tests.hand.test_robot_descriptions import URDF

POSE = "[[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]]"
ISAAC = (
    "format: isaac_grasp\nformat_version: 1.0\ngrasps:\n  a: {position: [0, 0, %s], "
    "orientation: {w: 0, xyz: [1, 0, 0]}, confidence: 1}\n"
)
HAND = json.dumps(ParallelGripper.preset("franka").description())


def gripper(name: str, value: str) -> str:
    """The Franka hand in JSON, with another value of a field."""
    return HAND.replace(json.dumps({name: json.loads(HAND)[name]})[1:-1], f'"{name}": {value}')


def fingers(path: Path) -> Any:
    """The gripper of a URDF, whose right finger has the shape in the file."""
    changed = {"kind": "prismatic", "axis": "0 1 0", "limit": '<limit lower="0" upper="0.03"/>'}
    shape = path.read_text(encoding="utf-8")
    path.write_text(URDF.format(right=shape, **changed), encoding="utf-8")
    return read_hand(path, fingers=("left", "right"))


Reader = Callable[[Path], Any]
NUMBERS: dict[str, tuple[str, Reader, str]] = {
    "gripper": ("g.json", read_hand, gripper("max_opening", "%s")),
    "opening": ("p.json", read_poses, f'{{"grasps": [{{"pose": {POSE}, "opening": %s}}]}}'),
    "isaac": ("p.yaml", partial(read_poses, hand=ParallelGripper.preset("franka")), ISAAC),
    "contacts": ("c.json", grasp3d.read_grasps, "[[[0, 0, %s], [0, 0, 1]]]"),
    "object's pose in YAML": ("o.yaml", read_object_pose, "[[%s, 0, 0, 0], [], [], []]"),
    "hand's box": ("h.urdf", fingers, '<box size="1 1 %s"/>'),
}
"""A file of each language with a number, and what reads it."""

BAD_NUMBERS = ("1" * 400, "1" * 5000, "-" + "9" * 310)


def refusal(path: Path, content: str, reader: Reader) -> str:
    """Why a file is refused: a GraspError of one line that begins with its name."""
    path.write_text(content, encoding="utf-8")
    with pytest.raises(GraspError) as refused:
        reader(path)
    text = str(refused.value)
    assert text.startswith(str(path))
    assert "\n" not in text
    return text.removeprefix(str(path))


@pytest.mark.parametrize("what", NUMBERS)
def test_numbers_that_are_too_large_are_refused_in_every_file(tmp_path: Path, what: str) -> None:
    name, reader, content = NUMBERS[what]
    for number in BAD_NUMBERS:
        text = refusal(tmp_path / name, content.replace("%s", number), reader)
        assert len(text) < 400


NEST = "[" * 100_000 + "]" * 100_000


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (r'["a\ud800b"]', r"has a text with half a character, '\ud800'"),
        (NEST, "nested too deeply"),
        ("1" * (LONGEST_NUMBER + 1), "a number has 301 digits"),
        ("{", "is not valid JSON: "),
    ],
)
def test_json_of_which_nothing_can_be_made_is_refused(
    tmp_path: Path, text: str, words: str
) -> None:
    """Half characters would fail later: when they are printed, written, or named in a message."""
    with pytest.raises(ValueError, match=re.escape(words)):
        parse_json(text)
    for reader in (read_hand, read_poses, read_object_pose, grasp3d.read_grasps):
        refusal(tmp_path / "f.json", text, reader)


def test_whole_characters_and_large_numbers_are_read() -> None:
    assert parse_json(r'{"\ud83d\ude00": "\\ud800"}') == {"\N{GRINNING FACE}": r"\ud800"}
    assert parse_json("9" * LONGEST_NUMBER) == 10**LONGEST_NUMBER - 1
    with pytest.raises(SettingError, match=r"its gripper has a text with half a character"):
        hand_of_line(gripper("name", r'"\udfff"'))


@pytest.mark.parametrize(
    "fields",
    [
        {"name": "\ud800"}, {"max_opening": 10**400}, {"source": "a\udcff"},
        {"joint_names": ("a\udcff", "b")},
    ],
)  # fmt: skip
def test_values_from_python_are_refused_too(fields: dict[str, Any]) -> None:
    with pytest.raises((GraspError, TypeError)):
        replace(ParallelGripper.preset("franka"), **fields)


LONG = "a" * 300


@pytest.mark.parametrize(
    "read",
    [
        lambda: read_hand(f"{LONG}.json"),
        lambda: read_hand(f"{LONG}.urdf", fingers=("left", "right")),
        lambda: read_hand("a\0b.json"),
        lambda: grasp3d.read_grasps(f"{LONG}.csv"),
        lambda: read_poses(f"{LONG}.json"),
        lambda: read_poses("a\0b.yaml"),
        lambda: read_object_pose(f"{LONG}.json"),
        lambda: grasp3d.load_mesh(f"{LONG}.stl"),
        lambda: grasp3d.read_labels(f"{LONG}.npz"),
        lambda: open_collection(Path(f"{LONG}.stl")),
        lambda: MeshFolder(Path(LONG)),
        lambda: MeshFolder().find(f"{LONG}.stl", Path("log.csv")),
    ],
)
def test_names_that_no_file_can_have_are_refused(read: Callable[[], object]) -> None:
    with pytest.raises(GraspError) as refused:
        read()
    assert str(refused.value).isprintable()
    assert not holds_poses(f"{LONG}.json")


ENDS = ("json", "csv", "parquet", "yaml", "h5", "npy")
SOURCES: dict[str, Reader] = {
    **{f"p.{end}": grasp3d.read_grasps for end in ENDS},
    **{f"o.{end}": read_object_pose for end in ("json", "txt", "npy")},
    **{f"g.{end}": partial(read_hand, fingers=("left", "right")) for end in ("urdf", "xml")},
    "g.json": read_hand,
    "m.stl": grasp3d.load_mesh,
    "m.ply": grasp3d.read_labels,
}


@pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="there are no pipes")
@pytest.mark.parametrize("name", SOURCES)
def test_pipes_and_devices_are_not_read(tmp_path: Path, name: str) -> None:
    """Reading them would wait, or never end."""
    for number, make in enumerate(
        (os.mkfifo, lambda path: path.symlink_to("/dev/zero"), Path.mkdir)
    ):
        path = tmp_path / f"{number}{name}"
        make(path)
        with pytest.raises(GraspError, match=r"is a pipe or a device|is not a file|is a folder"):
            SOURCES[name](path)


SEEDS = """
import grasp3d
try:
    grasp3d.read_hand("hand.json")
except grasp3d.GraspError as error:
    print(error)
"""


@pytest.mark.slow
def test_which_of_several_mistakes_is_named_does_not_depend_on_chance(tmp_path: Path) -> None:
    wrong = '{"nape": 1, "max_opening": 2, "min_openin": 3, "tip_radios": 4}'
    (tmp_path / "hand.json").write_text(wrong, encoding="utf-8")
    found = {
        subprocess.run(
            [sys.executable, "-c", SEEDS], capture_output=True, text=True, check=True,
            cwd=tmp_path, env={**os.environ, "PYTHONHASHSEED": seed},
        ).stdout
        for seed in "012"
    }  # fmt: skip
    assert len(found) == 1
    assert found.pop()
