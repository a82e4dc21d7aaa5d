"""The one number of grasps: its bounds, and that lists and files are in its order."""

import math
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as arrays

from grasp3d import (
    GraspModel,
    Load,
    ParallelGripper,
    evaluate_grasps,
    label_surface,
    load_mesh,
    read_grasps,
    write_grasps,
)
from grasp3d.grasps import EvaluatedPoses
from grasp3d.grasps.best import pool_of
from grasp3d.grasps.evaluated_poses import ranked_rows
from grasp3d.surface.labelled_grasps import quality_of_contacts, written_scores
from tests.helpers import shapes
from tests.helpers.closing_jaws import random_poses
from tests.helpers.grippers import HAND

SIZE = 12
MODEL = GraspModel(friction=0.4, sensor_resolution=math.radians(15.0))


def several(values: st.SearchStrategy[Any], dtype: type = float) -> st.SearchStrategy[Any]:
    return arrays.arrays(dtype, SIZE, elements=values)


@given(several(st.integers(0, 2), np.uint8), several(st.floats(-1.0, 1.0)))
def test_a_better_letter_is_a_better_score_and_quality_decides_within_it(
    label: np.ndarray, quality: np.ndarray
) -> None:
    score = written_scores(label, quality)
    assert ((score >= label / 3.0 - 1e-12) & (score <= (label + 1.0) / 3.0 + 1e-12)).all()
    for letter in range(3):
        order = np.argsort(quality[label == letter])
        assert (np.diff(score[label == letter][order]) >= 0.0).all()


@given(several(st.floats(-4.0, 4.0)), several(st.floats(0.0, 1e6)))
def test_contacts_with_a_margin_are_above_those_without(
    margin: np.ndarray, held: np.ndarray
) -> None:
    quality = quality_of_contacts(margin, held)
    assert ((quality >= -1.0) & (quality <= 1.0)).all()
    assert (quality[margin > 0.0] >= 0.0).all()
    assert (quality[margin < -1e-300] < 0.0).all()


def poses(load: Load | None) -> EvaluatedPoses:
    vertices, faces = shapes.lopsided()
    mesh = load_mesh((0.025 * vertices, faces), unit="m", max_edge=1e3)
    return evaluate_grasps(mesh, random_poses(60, 0.01, seed=3), MODEL, hand=HAND, load=load)


@pytest.mark.parametrize("load", [None, Load(mass=0.3, grip_force=20.0)], ids=["no load", "load"])
def test_the_list_and_every_file_are_in_the_order_of_the_score(
    load: Load | None, tmp_path: Path
) -> None:
    found = poses(load)
    assert len(set(found.letter)) > 1
    rows = ranked_rows(found)
    assert sorted(rows.tolist()) == list(range(found.size))
    assert (np.diff(found.score[rows]) <= 0.0).all()
    assert (np.diff(found.letter[rows].astype(int)) <= 0).all()
    best = found.take(rows)
    for name in ("a.csv", "a.json", "a.parquet"):
        write_grasps(tmp_path / name, best)
        read = read_grasps(tmp_path / name, hand=HAND)
        np.testing.assert_array_equal(read.scores, best.score)


@pytest.mark.slow
def test_no_file_ranks_a_grasp_first_that_drops_the_object(tmp_path: Path) -> None:
    """A hammer that is too heavy for some: sorted by the scores in files, they come last."""
    mesh = load_mesh("meshes/hammer.ply", unit="m")
    hand, load = ParallelGripper.preset("franka"), Load(mass=0.67, grip_force=70.0)
    found = pool_of(label_surface(mesh, hand=hand, load=load))
    held = found.payload >= load.mass
    assert 0 < held.sum() < found.size
    for name, kind in {
        "a.yaml": None,
        "b.json": "moveit",
        "c.npy": None,
    }.items():
        if name == "a.yaml":
            shapes.reader("yaml")
        write_grasps(tmp_path / name, found, format=kind)
        scores = read_grasps(tmp_path / name, hand=hand).scores
        np.testing.assert_allclose(scores, found.score, atol=1e-6)
        first = int(np.argmax(scores))
        assert held[first]
