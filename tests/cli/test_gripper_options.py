"""`--hand`, `--table` and approach limits of label, batch, sweep and view."""

from pathlib import Path

import numpy as np
import pytest
import trimesh

from grasp3d import Sampling, Table, label_surface, load_mesh, open_library
from grasp3d.formats import holds_poses, read_poses
from grasp3d.hand.parallel_gripper import ParallelGripper
from tests.helpers import shapes
from tests.helpers.commands import printed, run_here

OPTIONS = ("--unit", "mm", "--max-edge", "10mm")
FRANKA = ("--hand", "franka", "--table", "as-is")


@pytest.fixture
def box(tmp_path: Path) -> Path:
    """A folder with a box of 60 x 40 x 20 mm."""
    trimesh.Trimesh(*shapes.box((60.0, 40.0, 20.0)), process=False).export(tmp_path / "box.stl")
    return tmp_path


@pytest.mark.slow
def test_label_prints_the_verdict_and_writes_poses(box: Path) -> None:
    text = printed("label", "box.stl", *OPTIONS, *FRANKA, "--best", "4", cwd=box)
    assert "Surely held by franka: " in text
    assert "franka" in text
    path = box / "box_grasps.json"
    assert holds_poses(path)
    poses = read_poses(path)
    assert poses.count == 4
    assert (poses.poses[:, 2, 2] < 1e-6).all()  # from above, or from the side
    labels = label_surface(
        load_mesh(box / "box.stl", unit="mm", max_edge="10mm"), sampling=Sampling(rays=8),
        hand=ParallelGripper.preset("franka"), table=Table(np.array([0.0, 0.0, 1.0]), -0.01),
    )  # fmt: skip
    written = trimesh.load(box / "box_labeled.ply", process=False)
    stored = written.metadata["_ply_raw"]["vertex"]["data"]
    np.testing.assert_array_equal(np.asarray(stored["label"]).ravel(), labels.label)
    reached = labels.reach.reached
    np.testing.assert_allclose(
        np.asarray(stored["approach_z"]).ravel()[reached], labels.reach.poses[reached, 2, 2],
        atol=1e-6,
    )  # fmt: skip


@pytest.mark.slow
def test_nothing_reached_is_a_verdict_and_no_error(tmp_path: Path) -> None:
    plate = trimesh.Trimesh(*shapes.box((120.0, 80.0, 3.0)), process=False)
    plate.export(tmp_path / "plate.stl")
    text = printed("label", "plate.stl", *OPTIONS, *FRANKA, "--best", "3", cwd=tmp_path)
    assert "Not held by franka: the table is in the way" in text
    assert "best grasps: none may hold" in text
    assert not (tmp_path / "plate_grasps.json").exists()


@pytest.mark.slow
def test_batches_have_verdicts_and_poses_and_resume(box: Path) -> None:
    (box / "in").mkdir()
    (box / "box.stl").rename(box / "in" / "box.stl")
    plate = trimesh.Trimesh(*shapes.box((120.0, 80.0, 3.0)), process=False)
    plate.export(box / "in" / "plate.stl")
    command = ("batch", "in", "-o", "out", "--workers", "0", "--best", "2", *OPTIONS)
    assert run_here(*command, *FRANKA, cwd=box).returncode == 0

    def rows() -> dict[str, dict]:
        return {row["mesh"]: row for row in open_library(box / "out").table().to_pylist()}

    before = rows()
    assert before["box.stl"]["verdict"] == "surely"
    assert before["box.stl"]["gripper"] == "franka"
    assert before["plate.stl"]["verdict_text"].startswith(
        "Not held by franka: the table is in the "
    )
    assert before["plate.stl"]["grasps"] == []
    poses = np.array([grasp["pose"] for grasp in before["box.stl"]["grasps"]]).reshape(-1, 4, 4)
    assert len(poses) == 2
    assert np.linalg.det(poses[:, :3, :3]) == pytest.approx(1.0)
    again = run_here(*command, *FRANKA, cwd=box)
    assert again.returncode == 0
    assert rows() == before  # also the times: nothing was labelled again
    other = run_here(*command, "--hand", "wsg50", "--table", "as-is", cwd=box)
    assert other.returncode == 2
    other = run_here(*command, "--hand", "wsg50", "--table", "as-is", "--overwrite", cwd=box)
    assert other.returncode == 0
    assert {row["gripper"] for row in rows().values()} == {"wsg50"}
    assert all(rows()[name]["key"] != before[name]["key"] for name in before)


def test_a_batch_without_units_has_a_row_with_the_reason(box: Path) -> None:
    run = run_here("batch", "box.stl", "-o", "out", "--workers", "0", "--hand", "franka", cwd=box)
    assert run.returncode == 1
    (row,) = open_library(box / "out").table().to_pylist()
    assert "is not known (largest extent 60: 60 m if m, 60 cm if cm, 6 cm if mm, " in row["error"]
    assert "): add --unit mm" in row["error"]
    assert (row["outcome"], row["verdict"]) == ("refused", None)
