"""`grasp3d validate`."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh

from grasp3d import GraspModel, ParallelGripper, load_mesh
from grasp3d.grasps.evaluation import evaluate_grasps
from grasp3d.grasps.pose_files import read_poses, write_poses
from grasp3d.grasps.poses import GraspPoses
from grasp3d.plots.validations import FIGURES
from grasp3d.system.tables import read_columns
from grasp3d.validating.validation import TABLES
from tests.helpers import shapes
from tests.helpers.commands import printed
from tests.helpers.commands import run_here as grasp3d
from tests.helpers.tried_grasps import poses_on

FRANKA = ParallelGripper.preset("franka")
COUNT, HELD_FROM = 120, -0.1
QUICK = ("--resamples", "100", "--max-edge", "2cm", "--unit", "m")


@cache
def poses(count: int = COUNT) -> tuple[GraspPoses, np.ndarray]:
    """Poses on a smooth body, some of which miss it, and their margins."""
    points, faces = shapes.lopsided(3)
    mesh = load_mesh((0.025 * points, faces), unit="m", max_edge=0.02)
    given = poses_on(mesh, count, 0, 0.075).poses.copy()
    given[:6, :3, 3] += 0.2
    found = evaluate_grasps(mesh, GraspPoses(poses=given), GraspModel(), hand=FRANKA)
    return GraspPoses(poses=given, unit="m", hand="panda"), np.array(found.margin)


def tried(held: np.ndarray) -> GraspPoses:
    return replace(poses(len(held))[0], outcome=held.astype(float))


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with body.ply and log.csv; grasps held whose margin is above HELD_FROM."""
    points, faces = shapes.lopsided(3)
    trimesh.Trimesh(0.025 * points, faces, process=False).export(tmp_path / "body.ply")
    write_poses(tmp_path / "log.csv", tried(poses()[1] > HELD_FROM))
    return tmp_path


GIVEN = ("validate", "log.csv", "--mesh", "body.ply", "--hand", "franka", *QUICK)


@pytest.mark.slow
def test_it_prints_how_well_scores_predict(folder: Path) -> None:
    text = printed(*GIVEN, cwd=folder)
    held = int((poses()[1] > HELD_FROM).sum())
    assert f"120 grasps with an outcome on 1 object: {held} held" in text
    assert "gripper franka, as given; mass not known" in text
    assert "the jaws do not close on the mesh: labelled U, with the worst value" in text
    assert re.search(r"margin +larger +1\.000 1\.000-1\.000 +1\.000 1\.000-1\.000", text)
    assert "100 resamples (seed 0) of the grasps; they hold for this object" in text
    assert re.search(r"0\.5 +22\.6° +100\.0 % \d+-100 +\d+ ", text)
    assert "best threshold" in text
    assert {path.name for path in folder.iterdir()} == {"body.ply", "log.csv"}
    assert grasp3d(*GIVEN, cwd=folder).stdout == text
    narrow = grasp3d(*GIVEN, cwd=folder, columns=80).stdout
    assert "…" not in narrow


def test_options_choose_the_statistics_the_seed_and_the_model(folder: Path) -> None:
    words = ("--seed", "7", "--worst", "1", "--friction", "0.8", "--mass", "20g", "--bins", "4",
             "--target", "0.5")  # fmt: skip
    text = printed(*GIVEN, *words, cwd=folder)
    assert "labels, margins and forces at μ 0.8, α 22.6°" in text
    assert "seed 7" in text
    assert "grip force" in text
    assert "mass 20 g, as given" in text
    assert len(re.findall(r"^-?\d+\.\d° to", text, re.MULTILINE)) == 4
    assert "50 % of the accepted grasps held" in text


@pytest.mark.slow
def test_tables_and_figures_replace_no_files(folder: Path) -> None:
    assert printed(*GIVEN, "-o", "out", "-q", "--worst", "0", cwd=folder) == ""
    assert {path.name for path in (folder / "out").iterdir()} == {*FIGURES, *TABLES}
    table = read_columns(folder / "out" / "grasps.csv")
    np.testing.assert_array_equal(table["success"], poses()[1] > HELD_FROM)
    done = grasp3d(*GIVEN, "-o", "out", cwd=folder)
    assert done.returncode == 2
    assert "roc.svg: exists; name another file" in done.stderr


@pytest.mark.slow
def test_acronym_needs_no_options(tmp_path: Path) -> None:
    import h5py

    name = "Mug_10f6e09036350e92b3f21f1137c3c347_0.0002682457830986903.h5"
    mug = shapes.shared("datasets", "acronym", name)
    with h5py.File(mug) as file, h5py.File(tmp_path / "mug.h5", "w") as part:
        file.copy("object", part)
        file.copy("gripper", part)
        for field in ("grasps/transforms", "grasps/qualities/flex/object_in_gripper"):
            part[field] = file[field][:80]
    folder = ("--meshes", mug.parent)
    text = printed("validate", "mug.h5", *folder, "--resamples", "100", cwd=tmp_path)
    assert "80 grasps with an outcome on 1 object: " in text
    assert (
        "gripper franka, as the file states (panda); mass 13.1 g, as the file states; centre of "
        "mass as the file states"
    ) in text


def with_columns(folder: Path, **columns: np.ndarray) -> Path:
    """A log without outcomes of its own, with other columns."""
    given = replace(poses()[0], columns=columns)
    write_poses(folder / "other.csv", given)
    return folder / "other.csv"


@pytest.mark.slow
def test_outcomes_are_those_that_are_named(folder: Path) -> None:
    held = poses()[1] > HELD_FROM
    with_columns(folder, stayed=np.where(held, "True", "false"), fell=1.0 - held)
    given = ("validate", "other.csv", *GIVEN[2:])
    found = printed(*given, "--outcome", "stayed", cwd=folder)
    assert found.startswith("120 grasps with an outcome (stayed) on 1 object: ")
    own = printed(*GIVEN, cwd=folder)
    assert found.replace(" (stayed)", "").replace("other.csv", "log.csv") == own
    write = ("evaluate", "body.ply", "other.csv", "--hand", "franka", "--unit", "m", "-q")
    printed(*write, "--outcome", "fell", "-o", "out.csv", cwd=folder)
    np.testing.assert_array_equal(read_columns(folder / "out.csv")["outcome"], ~held)


def test_values_that_are_all_the_same_are_no_outcomes(folder: Path) -> None:
    """A file's own outcomes may be: then there is a warning."""
    path = with_columns(folder, fell=np.zeros(COUNT), stayed=np.ones(COUNT))
    given = ("validate", "other.csv", *GIVEN[2:])
    for name, became in (("fell", "failed"), ("stayed", "held")):
        done = grasp3d(*given, "--outcome", name, "-o", "out", cwd=folder)
        assert done.returncode == 2
        assert f"the outcome '{name}' all 120 grasps {became}, so no score" in done.stderr
        assert not (folder / "out").exists()
    write_poses(path, replace(read_poses(path), outcome=0.0))
    done = grasp3d(*given, cwd=folder)
    assert done.returncode == 0
    assert "other.csv: all 120 grasps failed, so no score can be ranked" in " ".join(
        (done.stdout + done.stderr).split()
    )
