"""`grasp3d simulate`."""

from pathlib import Path

import pytest
import trimesh

from grasp3d.system.tables import read_columns
from tests.helpers.commands import printed

QUICK = ("--unit", "cm", "--pull-time", "0.05", "--time-step", "0.002", "--workers", "0")

POSES = """name,px,py,pz,qx,qy,qz,qw,opening,unit
above,0,0,3,1,0,0,0,4,cm
beside,0,0,20,1,0,0,0,4,cm
"""


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    trimesh.creation.box([4.0, 6.0, 10.0]).export(tmp_path / "box.stl")
    (tmp_path / "poses.csv").write_text(POSES, encoding="utf-8")
    return tmp_path


def test_the_best_grasps_are_simulated(folder: Path) -> None:
    words = ("simulate", "box.stl", "--hand", "wsg50", "--count", "2", *QUICK)
    text = printed(*words, cwd=folder)
    assert "S surely stable       2  100 %  34 to 100 %" in text
    assert "2 held\n" in text
    rows = read_columns(folder / "box_simulation.csv")
    assert rows["fate"].tolist() == ["held", "held"]


def test_given_poses_are_simulated(folder: Path) -> None:
    words = ("--grasps", "poses.csv", "--hand", "franka", "-o", "tried.csv")
    text = printed("simulate", "box.stl", *words, *QUICK, cwd=folder)
    assert "S surely stable         1  100 %" in text
    assert "1 held, 1 missed\n" in text
    assert read_columns(folder / "tried.csv")["outcome"].tolist() == [1, 0]
