"""`--frame`: files with poses in the frames of other programs, written, read and doubted."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pyarrow.csv as pc
import pyarrow.parquet as pq
import pytest

from grasp3d import read_grasps, read_hand, write_grasps
from tests.helpers import shapes
from tests.helpers.commands import export, printed

GRASPS = ("box.stl", "--unit", "mm", "--hand", "franka")
WARNING = "as stated ('hand') jaws that are thin close on the object where it is"


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Grasps on a box as GraspGen states them, in a file whose format states otherwise."""
    folder = tmp_path_factory.mktemp("frames")
    export(folder / "box.stl", shapes.box((160.0, 50.0, 30.0)))
    printed("label", *GRASPS, "--max-edge", "20mm", "--best", "17", "--grasps", "g.yaml", "--frame",
            "graspgen", cwd=folder)  # fmt: skip
    return folder


@pytest.mark.slow
def test_a_file_in_another_frame_is_doubted_and_read_in_it(folder: Path) -> None:
    def evaluate(*options: str, output: str = "out.csv") -> str:
        return printed("evaluate", GRASPS[0], "g.yaml", *GRASPS[1:], "-o", output, "--overwrite",
                       *options, cwd=folder)  # fmt: skip

    stated = " ".join(evaluate().split())
    assert WARNING in stated
    assert "with --frame graspgen in" in stated
    assert "poses read in the gripper's frame 'hand', as the file states none (--frame)" in stated
    wrong = pc.read_csv(folder / "out.csv")
    right = evaluate("--frame", "graspgen", output="right.csv")
    assert "warning" not in right
    assert "poses read in the gripper's frame 'graspgen' (--frame)" in right
    assert "17  100.0 %" in right
    auto = " ".join(evaluate("--frame", "auto", output="auto.parquet").split())
    assert "--frame auto: as stated ('hand')" in auto
    named, found = pc.read_csv(folder / "right.csv"), pq.read_table(folder / "auto.parquet")
    for axis in ("px", "py", "pz"):
        np.testing.assert_allclose(found[axis].to_numpy(), named[axis].to_numpy(), atol=1e-9)
    assert not np.allclose(wrong["qx"].to_numpy(), named["qx"].to_numpy(), atol=1e-3)
    settings = json.loads(found.schema.metadata[b"grasp3d"])
    assert settings["pose_reading"].endswith("with --frame graspgen in 17")
    ahead = "1 0 0 0\n0 1 0 0\n0 0 1 0.1034\n0 0 0 1\n"
    (folder / "ahead.txt").write_text(ahead, encoding="utf-8")
    same = evaluate("--frame", "ahead.txt", output="axes.csv")
    assert "17  100.0 %" in same
    kept = evaluate("--frame", "auto", output="kept.csv").count("warning")
    assert kept == 0


@pytest.mark.slow
def test_poses_without_a_unit_are_in_that_of_the_mesh_in_every_frame(folder: Path) -> None:
    poses = read_grasps(folder / "g.yaml", hand=read_hand("franka"), frame="graspgen").in_unit("mm")
    write_grasps(folder / "unit.csv", replace(poses, columns={}), frame="gpd")
    table = pc.read_csv(folder / "unit.csv").drop_columns(["unit", "gripper_frame"])
    pc.write_csv(table, folder / "silent.csv")
    for frame, lines in {"gpd": "17  100.0 %", "auto": "--frame auto: as stated"}.items():
        text = printed("evaluate", "box.stl", "silent.csv", "--unit", "mm", "--hand", "franka",
                       "--overwrite", "--frame", frame, cwd=folder)  # fmt: skip
        assert lines in text


def test_frames_are_drawn(tmp_path: Path) -> None:
    text = printed("hand", "robotiq_2f85", "--frames", "f.svg", cwd=tmp_path)
    assert "written: f.svg" in text
    drawn = (tmp_path / "f.svg").read_text(encoding="utf-8")
    for name in ("graspgen", "panda_link8", "robotiq_arg2f_base_link", "dexnet"):
        assert name in drawn
