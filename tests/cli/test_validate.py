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
from tests.helpers.tried_grasps import poses_on

COUNT, HELD_FROM = 120, -0.1
GIVEN = ("--mesh", "body.ply", "--hand", "franka", "--max-edge", "2cm", "--unit", "m")


@cache
def tried() -> GraspPoses:
    """Poses on a smooth body, some of which miss it; those above a margin have held."""
    points, faces = shapes.lopsided(3)
    mesh = load_mesh((0.025 * points, faces), unit="m", max_edge=0.02)
    given = poses_on(mesh, COUNT, 0, 0.075).poses.copy()
    given[:6, :3, 3] += 0.2
    franka = ParallelGripper.preset("franka")
    found = evaluate_grasps(mesh, GraspPoses(poses=given), GraspModel(), hand=franka)
    held = (np.array(found.margin) > HELD_FROM).astype(float)
    return GraspPoses(poses=given, unit="m", hand="panda", outcome=held)


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    """A folder with body.ply and log.csv."""
    points, faces = shapes.lopsided(3)
    trimesh.Trimesh(0.025 * points, faces, process=False).export(tmp_path / "body.ply")
    write_grasps(tmp_path / "log.csv", tried())
    return tmp_path


def test_it_prints_how_well_scores_predict_and_writes_a_table_and_a_figure(folder: Path) -> None:
    text = printed("validate", "log.csv", *GIVEN, cwd=folder)
    held = int(tried().outcome.sum())
    start = f"120 grasps with an outcome on 1 object: {held} held ({100.0 * held / COUNT:.1f} %)"
    assert text.startswith(start)
    for line in (
        "labels, margins and forces for μ 0.5, α 22.6°",
        "gripper franka, as given; mass not known, so no grip force",
        "the hand does not close on the mesh: U, with the worst value",
        "95 % intervals, for this object",
    ):
        assert line in text
    assert re.search(r"^■ S surely stable +\d+ +100 % +\d+ to 100 %$", text, re.MULTILINE)
    assert re.search(r"margin +larger +1\.000 +1\.000 +1\.000", text)
    assert re.search(r"^wrong labels: 0 S that failed, \d+ U that held$", text, re.MULTILINE)
    assert {path.name for path in folder.iterdir()} == {"body.ply", "log.csv"}
    words = ("-o", "out.csv", "--friction", "0.8", "--mass", "20g")
    text = printed("validate", "log.csv", *GIVEN, *words, cwd=folder)
    assert "labels, margins and forces for μ 0.8, α 22.6°" in text
    assert "mass 0.02 kg, as given" in text
    assert "written: out.csv, out.svg" in text
    found = read_columns(folder / "out.csv")
    np.testing.assert_array_equal(found["outcome"], tried().outcome)
    write_grasps(folder / "closed.csv", tried().take(np.flatnonzero(found["closing"] == "closed")))
    text = printed("validate", "closed.csv", *GIVEN, "--friction", "0.8", cwd=folder)
    assert "does not close" not in text


def test_outcomes_are_those_that_are_named_and_equal_ones_rank_nothing(folder: Path) -> None:
    columns = {"stayed": tried().outcome.astype(int), "fell": np.zeros(COUNT)}
    poses = replace(tried(), outcome=np.full(COUNT, np.nan), columns=columns)
    write_grasps(folder / "other.csv", poses)
    text = printed("validate", "other.csv", *GIVEN, "--outcome", "stayed", cwd=folder)
    held = int(tried().outcome.sum())
    assert text.startswith(f"120 grasps with an outcome (stayed) on 1 object: {held} held")
    text = printed("validate", "other.csv", *GIVEN, "--outcome", "fell", cwd=folder)
    assert "all grasps failed, so no score can be ranked" in text
    assert re.search(r"margin +larger +– +– +–", text)
