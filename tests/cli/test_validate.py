"""`grasp3d validate`."""

import re
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
import trimesh

from grasp3d import GraspModel, ParallelGripper, load_mesh
from grasp3d.formats import write_grasps
from grasp3d.formats.poses import GraspPoses
from grasp3d.grasps.evaluation import evaluate_grasps
from grasp3d.system.tables import read_columns
from tests.helpers import shapes
from tests.helpers.commands import printed
from tests.helpers.commands import run_here as grasp3d
from tests.helpers.tried_grasps import poses_on

FRANKA = ParallelGripper.preset("franka")
COUNT, HELD_FROM = 120, -0.1
MESH = ("--max-edge", "2cm", "--unit", "m")


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
    write_grasps(tmp_path / "log.csv", tried(poses()[1] > HELD_FROM))
    return tmp_path


GIVEN = ("validate", "log.csv", "--mesh", "body.ply", "--hand", "franka", *MESH)


def test_it_prints_how_well_scores_predict(folder: Path) -> None:
    text = printed(*GIVEN, cwd=folder)
    held = int((poses()[1] > HELD_FROM).sum())
    assert f"120 grasps with an outcome on 1 object: {held} held" in text
    assert "labels, margins and forces at μ 0.5, α 22.6°" in text
    assert "gripper franka, as given; mass not known, so no grip force" in text
    assert "the hand does not close on the mesh: U, with the worst value" in text
    assert re.search(r"^■ S surely stable +\d+ +100 % +\d+ to 100 %$", text, re.MULTILINE)
    assert re.search(r"margin +larger +1\.000 +1\.000 +1\.000", text)
    assert "intervals at 95 %, for this object" in text
    assert re.search(r"^wrong: 0 S that failed, \d+ U that held$", text, re.MULTILINE)
    assert {path.name for path in folder.iterdir()} == {"body.ply", "log.csv"}
    narrow = grasp3d(*GIVEN, cwd=folder, columns=80).stdout
    assert "…" not in narrow


def test_wrong_labels_are_listed(folder: Path) -> None:
    """Outcomes the other way round: what was S failed, and where the jaws do not close it held."""
    write_grasps(folder / "log.csv", tried(~(poses()[1] > HELD_FROM)))
    text = printed(*GIVEN, cwd=folder)
    (counts,) = re.findall(r"^wrong: (\d+) S that failed, (\d+) U that held$", text, re.MULTILINE)
    failed, held = map(int, counts)
    rows = re.findall(r"^ *(\d+) +log\.csv +■ ([SU]) +(\d\.\d{3})(.*)$", text, re.MULTILINE)
    assert [letter for _, letter, _, _ in rows] == ["S"] * min(failed, 10) + ["U"] * min(held, 10)
    scores = [float(score) for _, letter, score, _ in rows if letter == "S"]
    assert scores == sorted(scores, reverse=True)
    assert "the jaws close on nothing" in text


def test_options_choose_the_model(folder: Path) -> None:
    text = printed(*GIVEN, "--friction", "0.8", "--mass", "20g", cwd=folder)
    assert "labels, margins and forces at μ 0.8, α 22.6°" in text
    assert "grip force" in text
    assert "mass 0.02 kg, as given" in text


def test_table_and_figure_replace_no_files(folder: Path) -> None:
    assert printed(*GIVEN, "-o", "out.csv", "-q", cwd=folder) == ""
    table = read_columns(folder / "out.csv")
    np.testing.assert_array_equal(table["outcome"] == 1.0, poses()[1] > HELD_FROM)
    (folder / "out.csv").unlink()
    done = grasp3d(*GIVEN, "-o", "out.csv", cwd=folder)
    assert done.returncode == 2
    assert "out.svg: exists; name another file" in done.stderr
    text = printed(*GIVEN, "-o", "out.csv", "--overwrite", cwd=folder)
    assert "written: out.csv, out.svg" in text


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
    text = printed("validate", "mug.h5", *folder, cwd=tmp_path)
    assert "80 grasps with an outcome on 1 object: " in text
    assert (
        "gripper franka, as the file states (panda); mass 0.0131 kg, as the file states; centre of "
        "mass as the file states"
    ) in text


def with_columns(folder: Path, **columns: np.ndarray) -> Path:
    """A log without outcomes of its own, with other columns."""
    given = replace(poses()[0], columns=columns)
    write_grasps(folder / "other.csv", given)
    return folder / "other.csv"


@pytest.mark.slow
def test_outcomes_are_those_that_are_named(folder: Path) -> None:
    held = poses()[1] > HELD_FROM
    with_columns(folder, stayed=np.where(held, "True", "false"), fell=1.0 - held)
    given = ("validate", "other.csv", *GIVEN[2:])
    found = printed(*given, "--outcome", "stayed", cwd=folder)
    assert found.startswith("120 grasps with an outcome (stayed) on 1 object: ")
    own = printed(*GIVEN, cwd=folder)
    assert found.replace(" (stayed)", "").split("wrong:")[0] == own.split("wrong:")[0]
    write = ("evaluate", "body.ply", "other.csv", "--hand", "franka", "--unit", "m", "-q")
    printed(*write, "--outcome", "fell", "-o", "out.csv", cwd=folder)
    np.testing.assert_array_equal(read_columns(folder / "out.csv")["outcome"], ~held)


def test_values_that_are_all_the_same_rank_nothing(folder: Path) -> None:
    with_columns(folder, fell=np.zeros(COUNT))
    text = printed("validate", "other.csv", *GIVEN[2:], "--outcome", "fell", cwd=folder)
    assert "all grasps failed, so no score can be ranked" in text
    assert re.search(r"margin +larger +– +– +–", text)
