"""What `grasp3d evaluate` and `grasp3d label --best` say of poses that are a little wrong."""

import re
from pathlib import Path

import numpy as np
import pyarrow.csv as pc
import pytest

from grasp3d.formats import write_grasps
from grasp3d.formats.poses import GraspPoses
from grasp3d.hand.hand_files import write_hand
from tests.helpers import shapes
from tests.helpers.commands import export, printed
from tests.helpers.grippers import HAND

BOX = (0.04, 0.06, 0.03)
"""Size [m]: 40 mm lie between the jaws."""

GIVEN = ("box.stl", "poses.csv", "--unit", "m", "--hand", "hand.json", "-o", "b.csv", "--overwrite")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A box, a gripper, and poses in its middle, at its end, with a finger in it, and beside it."""
    export(tmp_path / "box.stl", shapes.box(BOX))
    write_hand(tmp_path / "hand.json", HAND)
    poses = np.tile(np.eye(4), (4, 1, 1))
    poses[1, 1, 3] = 0.5 * BOX[1] + 0.008  # 1 mm of the pads
    poses[2, 0, 3] = 0.022  # a finger starts 2 mm in the object
    poses[3, 1, 3] = BOX[1]
    write_grasps(tmp_path / "poses.csv", GraspPoses(poses=poses, unit="m"))
    return tmp_path


def rows_of(text: str) -> list[str]:
    """The rows of the table of grasps."""
    return [line for line in text.splitlines() if re.match(r" +\d+ +■ [SMU] ", line)]


def test_tables_say_what_wrong_poses_make_of_grasps(folder: Path) -> None:
    text = printed("evaluate", *GIVEN, "--pose-error", "5mm,3deg", cwd=folder)
    found, rows = pc.read_csv(folder / "b.csv").to_pylist(), rows_of(text)
    assert 0.0 < found[1]["closing_share"] < 1.0
    for row, one in zip(rows, found, strict=True):
        assert f"■ {one['label']}  " in row
        assert f"  {one['score']:.3f}  " in row
        assert row.rstrip().endswith(one["reason"])
    assert [one["label"] for one in found] == ["S", "U", "M", "U"]
    assert found[2]["shift"] == pytest.approx(-0.00375)
    assert found[3]["reason"] == "the jaws close on nothing"
    assert "1 of 4: closes on nothing where the pose is wrong" in text


def test_without_an_error_reasons_say_what_is_wrong(folder: Path) -> None:
    text = printed("evaluate", *GIVEN, cwd=folder)
    heading = r"pose +label +score +β\* +α\* +ε +ε_min +mm +reason *$"
    assert re.search(heading, text, re.MULTILINE)
    found = pc.read_csv(folder / "b.csv").to_pylist()
    assert "closing_share" not in found[0]
    assert found[2]["reason"] == "finger 1 is 3 mm inside the object"
    assert "1 of 4: finger is inside the object" in text
    text = printed("evaluate", *GIVEN, "--mass", "0.1", "--grip-force", "20", cwd=folder)
    assert re.search(r"force +payload +opening *$", text, re.MULTILINE)


def test_the_best_grasps_say_it_too(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("grasp3d.pictures.opengl.can_render", lambda: False)
    options = ("--unit", "m", "--max-edge", "12mm", "--hand", "hand.json")
    text = printed("label", "box.stl", *options, "--best", "2", "--pose-error", "2mm", cwd=folder)
    assert len(rows_of(text)) == 2
    assert all("■ S  " in row for row in rows_of(text))


def test_an_error_that_no_grasp_survives_is_a_verdict_and_leaves_no_older_grasps(
    folder: Path,
) -> None:
    options = ("--unit", "m", "--max-edge", "12mm", "--hand", "hand.json", "--best", "2")
    printed("label", "box.stl", *options, "-q", cwd=folder)
    assert (folder / "box_grasps.json").exists()
    words = ("--pose-error", "60mm", "--overwrite")
    text = printed("label", "box.stl", *options, *words, cwd=folder)
    assert "best grasps: none may hold" in text
    assert "no grasp holds at all poses that the pose error allows" in text
    assert not list(folder.glob("*_grasps.*"))
