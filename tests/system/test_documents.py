"""What every reader does with numbers, names and paths that nothing can be made of."""

import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh

import grasp3d
from grasp3d.errors import GraspError, SettingError
from grasp3d.formats import holds_poses, read_object_pose, read_poses
from grasp3d.hand.hand_files import hand_of_line, read_hand
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.outcomes.tried_grasps import MeshFolder
from grasp3d.system.documents import LONGEST_NUMBER, parse_json
from grasp3d.viewer.collection import open_collection
from tests.hand.test_robot_descriptions import BOX, URDF

POSE = "[[1, 0, 0, 0], [0, -1, 0, 0], [0, 0, -1, 0], [0, 0, 0, 1]]"
MESSAGE = (
    '{"id": %s, "grasp_pose": {"pose": {"position": {"x": %s, "y": 0, "z": 0}, '
    '"orientation": {"x": 1, "y": 0, "z": 0, "w": 0}}}}'
)
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
    "joint of a gripper": ("g.json", read_hand, gripper("joint_scale", "[%s, 1]")),
    "pose": ("p.json", read_poses, '{"grasps": [{"pose": [[%s, 0, 0, 0], [], [], []]}]}'),
    "opening": ("p.json", read_poses, f'{{"grasps": [{{"pose": {POSE}, "opening": %s}}]}}'),
    "outcome": ("p.json", read_poses, f'{{"grasps": [{{"pose": {POSE}, "outcome": %s}}]}}'),
    "success": ("p.json", read_poses, f'{{"grasps": [{{"pose": {POSE}, "success": %s}}]}}'),
    "scale": (
        "p.json",
        read_poses,
        f'{{"grasp3d": {{"object_scale": %s}}, "grasps": [{{"pose": {POSE}}}]}}',
    ),
    "GraspGen": (
        "p.json",
        lambda path: read_poses(path, hand=ParallelGripper.preset("franka")),
        f'{{"grasps": {{"transforms": [{POSE}], "object_in_gripper": [%s]}}}}',
    ),
    "moveit": (
        "p.json",
        lambda path: read_poses(path, hand=ParallelGripper.preset("franka")),
        MESSAGE.replace("%s", '"a"', 1),
    ),
    "isaac": (
        "p.yaml",
        lambda path: read_poses(path, hand=ParallelGripper.preset("franka")),
        ISAAC,
    ),
    "contacts": ("c.json", grasp3d.read_grasps, "[[[0, 0, %s], [0, 0, 1]]]"),
    "object's pose": ("o.json", read_object_pose, "[[%s, 0, 0, 0], [], [], []]"),
    "object's pose in YAML": ("o.yaml", read_object_pose, "[[%s, 0, 0, 0], [], [], []]"),
    "hand's box": ("h.urdf", fingers, '<box size="1 1 %s"/>'),
}
"""Files with a number, and what reads them."""

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


JSON_FILES: dict[str, tuple[Reader, str]] = {
    "gripper": (read_hand, gripper("name", "%s")),
    "joint's name": (read_hand, gripper("joint_names", "[%s, 1]")),
    "notes": (read_hand, HAND[:-1] + ', "notes": %s}'),
    "version": (read_hand, gripper("version", "%s")),
    "pose's name": (read_poses, f'{{"grasps": [{{"pose": {POSE}, "name": %s}}]}}'),
    "column": (read_poses, f'{{"grasps": [{{"pose": {POSE}, "other": %s}}]}}'),
    "header": (read_poses, f'{{"grasp3d": {{"other": %s}}, "grasps": [{{"pose": {POSE}}}]}}'),
    "contacts": (grasp3d.read_grasps, "[[[0, 0, %s], [0, 0, 1]]]"),
    "object's pose": (read_object_pose, '{"header": {"frame_id": %s}}'),
}


@pytest.mark.parametrize("what", JSON_FILES)
def test_texts_of_half_characters_and_deep_nests_are_refused_in_every_file(
    tmp_path: Path, what: str
) -> None:
    """They would fail later: when they are printed, written, or named in a message."""
    reader, content = JSON_FILES[what]
    half = refusal(tmp_path / "f.json", content.replace("%s", r'"a\ud800b"'), reader)
    assert r"has a text with half a character, '\ud800'" in half
    nest = "[" * 100_000 + "]" * 100_000
    text = refusal(tmp_path / "f.json", content.replace("%s", nest), reader)
    assert "nested too deeply" in text


def test_whole_characters_and_large_numbers_are_read() -> None:
    assert parse_json(r'{"\ud83d\ude00": "\\ud800"}') == {"\N{GRINNING FACE}": r"\ud800"}
    assert parse_json("9" * LONGEST_NUMBER) == 10**LONGEST_NUMBER - 1
    with pytest.raises(SettingError, match=r"its gripper has a text with half a character"):
        hand_of_line(gripper("name", r'"\udfff"'))


@pytest.mark.parametrize(
    "make",
    [
        lambda: grasp3d.ParallelGripper(**json.loads(HAND) | {"name": "\ud800"}),
        lambda: ParallelGripper.preset("franka").__class__(**fields(max_opening=10**400)),
        lambda: ParallelGripper.preset("franka").__class__(**fields(source="a\udcff")),
        lambda: ParallelGripper.preset("franka").__class__(**fields(joint_names=("a\udcff", "b"))),
        lambda: grasp3d.GraspModel(friction=(1, 10**400)),
    ],
)
def test_values_from_python_are_refused_too(make: Callable[[], object]) -> None:
    with pytest.raises((GraspError, TypeError)):
        make()


def fields(**values: Any) -> dict[str, Any]:
    """Fields of the Franka hand with other values."""
    own = {
        name: getattr(ParallelGripper.preset("franka"), name)
        for name in ParallelGripper.preset("franka").__dataclass_fields__
    }
    return own | values


LONG = "a" * 300


@pytest.mark.parametrize(
    "read",
    [
        lambda: read_hand(LONG),
        lambda: read_hand(f"{LONG}.json"),
        lambda: read_hand(f"{LONG}.urdf", fingers=("left", "right")),
        lambda: read_hand("a\0b.json"),
        lambda: grasp3d.read_grasps(f"{LONG}.csv"),
        lambda: read_poses(f"{LONG}.json"),
        lambda: read_poses(LONG),
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


def test_meshes_with_names_that_no_file_can_have_are_missing(tmp_path: Path) -> None:
    mesh = f'<mesh filename="{LONG}.stl"/>'
    assert "there is no mesh aaa" in refusal(tmp_path / "h.urdf", mesh, fingers)


SOURCES: dict[str, Reader] = {
    **dict.fromkeys(
        ("p.json", "p.csv", "p.parquet", "p.yaml", "p.h5", "p.npy"), grasp3d.read_grasps
    ),
    "g.json": read_hand,
    "g.urdf": lambda path: read_hand(path, fingers=("left", "right")),
    "g.xml": lambda path: read_hand(path, fingers=("left", "right")),
    "o.json": read_object_pose,
    "o.txt": read_object_pose,
    "o.npy": read_object_pose,
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
from pathlib import Path
from grasp3d.formats import read_poses
from grasp3d.hand.hand_files import hand_of_line
for act in (
    lambda: read_poses("p.csv"),
    lambda: hand_of_line('{"nape": 1, "max_opening": 2, "min_openin": 3, "tip_radios": 4}'),
):
    try:
        act()
    except Exception as error:
        print(error)
"""


@pytest.mark.slow
def test_which_of_several_mistakes_is_named_does_not_depend_on_chance(tmp_path: Path) -> None:
    rows = ['0,0,0,1,0,0,0,m,a,"1,0,0,0"', '0,0,0,1,0,0,0,cm,b,"2,0,0,0"']
    head = "px,py,pz,qx,qy,qz,qw,unit,frame,object_pose"
    (tmp_path / "p.csv").write_text("\n".join([head, *rows]), encoding="utf-8")
    found = {
        subprocess.run(
            [sys.executable, "-c", SEEDS],
            capture_output=True,
            text=True,
            check=True,
            cwd=tmp_path,
            env={**os.environ, "PYTHONHASHSEED": str(seed)},
        ).stdout
        for seed in range(4)
    }
    assert len(found) == 1
    assert len(found.pop().splitlines()) == 2


AT = f"{BOX}</geometry></collision><collision><origin {{}}/><geometry>{BOX}"
"""A finger with another origin."""


@pytest.mark.parametrize(
    ("shape", "words"),
    [
        ('<box size="1 2"/>', "attribute 'size' does not have enough data Element 'box', line 10"),
        ('<box size="1 2 3 4"/>', "attribute 'size' has too much data Element 'box'"),
        ("<box/>", "required attribute missing: 'size' Element 'box'"),
        ('<sphere radius="nan"/>', "nan size in geom Element name 'right 0'"),
        ('<cylinder radius="1"/>', "required attribute missing: 'length' Element 'cylinder'"),
        (AT.format('xyz="0 0"'), "attribute 'xyz' does not have enough data Element 'origin'"),
        (AT.format('xyz="0 0 0 1"'), "attribute 'xyz' has too much data Element 'origin'"),
        (AT.format('rpy="0"'), "attribute 'rpy' does not have enough data Element 'origin'"),
        ('<box size="1e300 1 1"/>', "link right or its geometry is more than 1,000 m large"),
    ],
)
def test_numbers_of_a_urdf_are_as_many_as_it_needs(tmp_path: Path, shape: str, words: str) -> None:
    assert words in refusal(tmp_path / "h.urdf", shape, fingers)


def test_a_mesh_of_a_urdf_may_have_one_scale(tmp_path: Path) -> None:
    trimesh.creation.box([20.0, 10.0, 40.0]).export(tmp_path / "f.stl")
    found = []
    for number, scale in enumerate(("0.001", "0.001 0.001 0.001")):
        path = tmp_path / f"{number}.urdf"
        path.write_text(f'<mesh filename="f.stl" scale="{scale}"/>', encoding="utf-8")
        found.append(fingers(path).finger_width)
    assert found == pytest.approx([0.02, 0.02])
    assert np.isfinite(found).all()
