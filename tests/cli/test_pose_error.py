"""What `grasp3d evaluate` and `grasp3d label --best` say of poses that are a little wrong."""

import re
from pathlib import Path

import numpy as np
import pyarrow.csv as pc
import pytest

from grasp3d.grasps.pose_files import write_poses
from grasp3d.grasps.poses import GraspPoses
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
    write_poses(tmp_path / "poses.csv", GraspPoses(poses=poses, unit="m"))
    return tmp_path


def rows_of(text: str) -> list[str]:
    """The rows of the table of grasps."""
    return [line for line in text.splitlines() if re.match(r" +\d+ +■ [SMU] ", line)]


def test_tables_say_what_wrong_poses_and_patches_make_of_grasps(folder: Path) -> None:
    text = printed("evaluate", *GIVEN, "--pose-error", "5mm,3deg", cwd=folder)
    found, rows = pc.read_csv(folder / "b.csv").to_pylist(), rows_of(text)
    assert found[0]["label_tried"] == "S"
    assert 0.0 < found[1]["closing_share"] < 1.0
    for row, one in zip(rows, found, strict=True):
        share = round(100.0 * one["closing_share"])
        tried = " of 32" if share == 100 else f", {share} % close"
        assert f"■ {one['label_tried']}{tried}  " in row
        assert f"  {one['robust_score']:.2f}  " in row
    assert "  closed, gave way 3.8 mm" in rows[2]  # so that the way is free, with its clearance
    assert found[2]["shift"] == pytest.approx(-0.00375)
    assert "tried: the worst label of 32 poses that are wrong by at most 5 mm and 3 deg" in text
    assert text.count("robust scores are per newton of grip: no mass is given") == 1


def test_without_an_error_there_is_a_score_alone(folder: Path) -> None:
    text = printed("evaluate", *GIVEN, cwd=folder)
    assert re.search(r"area +score +jaws$", text, re.MULTILINE)
    assert "tried" not in text
    assert [row.endswith("starts inside") for row in rows_of(text)] == [False, False, True, False]
    with_mass = printed("evaluate", *GIVEN, "--mass", "0.1", "--grip-force", "20", cwd=folder)
    assert "-1 to 1, from 0.5 on they hold the load" in with_mass
    assert "per newton" not in with_mass
    assert "no force is given" in printed("evaluate", *GIVEN, "--mass", "0.1", cwd=folder)


def test_the_best_grasps_say_it_too(folder: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr("grasp3d.rendering.opengl.can_render", lambda: False)
    options = ("--unit", "m", "--max-edge", "12mm", "--hand", "hand.json")
    text = printed("label", "box.stl", *options, "--best", "2", "--pose-error", "2mm", cwd=folder)
    assert re.search(r"closed +tried +score$", text, re.MULTILINE)
    count = re.search(r"worst label of (\d+) poses that are wrong by at most 2 mm, ", text)
    assert count
    assert all(f"■ S of {count[1]} " in row for row in rows_of(text))
