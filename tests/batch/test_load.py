"""A load in a batch: rows, files, and the report."""

import math
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.parquet as pq
import pytest
import trimesh

from grasp3d import GraspModel, MeshOptions, SurfaceLabels, label_surface, load_mesh
from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.inputs import MeshFile
from grasp3d.batch.labelling import label_job
from grasp3d.batch.plan import Job
from grasp3d.batch.row import Outcome, Row
from grasp3d.batch.storage.folder import Folder
from grasp3d.quality.loads import Load
from grasp3d.surface.area_statistics import label_fractions, vertex_weights
from tests.helpers import shapes

LOAD = Load(mass=0.5, grip_force=40.0)
SETTINGS = BatchSettings(
    GraspModel(torsion_radius="3mm", sensor_resolution=0.2),
    mesh=MeshOptions(unit="m", max_edge=0.02),
    best=2,
    load=LOAD,
)


def block(folder: Path) -> Path:
    mesh = trimesh.Trimesh(*shapes.box((0.08, 0.05, 0.03)), process=False)
    mesh.export(folder / "block.ply")
    return folder / "block.ply"


@cache
def labels() -> SurfaceLabels:
    mesh = load_mesh(shapes.box((0.08, 0.05, 0.03)), SETTINGS.mesh)
    return label_surface(mesh, SETTINGS.model, load=LOAD)


def row_under(load: Load | None, folder: Path, **options: Any) -> Row:
    source = block(folder)
    mesh = MeshFile("block.ply", str(source), source.stat().st_size, "stamp")
    settings = replace(SETTINGS, load=load, mesh=replace(SETTINGS.mesh, **options))
    row = label_job(Job(mesh, "block", Folder(str(folder / "out")), ""), settings)
    assert isinstance(row, Row)
    return row


@pytest.mark.slow
def test_a_row_has_the_values_of_the_labels(tmp_path: Path) -> None:
    row = row_under(LOAD, tmp_path)
    assert row.outcome is Outcome.LABELLED, row.error
    load_result, payloads = labels().load_result, labels().quantiles("payload", [0.1, 0.5, 0.9])
    assert load_result is not None
    assert load_result.label is not None
    assert payloads is not None
    fractions = label_fractions(load_result.label, vertex_weights(labels().mesh, "area"))
    assert (row.mass, row.grip_force_at_hand, row.task) == (0.5, 40.0, "weight")
    assert row.holds
    assert "N of 40 N to hold 0.5 kg in any orientation" in (row.verdict_text or "")
    assert row.held == pytest.approx(fractions["S"])
    # Positions in the file have 32 bits.
    assert row.payload_best == pytest.approx(load_result.payload.max(), rel=0.02)
    assert row.grip_force_needed == pytest.approx(load_result.grip_force_largest.min(), rel=0.02)
    quantiles = (row.payload_p10, row.payload_p50, row.payload_p90)
    assert quantiles == pytest.approx(payloads.tolist(), rel=0.02)
    assert row.grasps[0].payload == pytest.approx(40.0 * 0.5 / (row.grasps[0].grip_force or 0.0))
    fields = pq.read_table(tmp_path / "out" / row.fields)
    np.testing.assert_allclose(fields["payload"].to_numpy(), load_result.payload, rtol=0.05)


def test_without_a_load_all_of_that_is_null(tmp_path: Path) -> None:
    row = row_under(None, tmp_path)
    names = ("task", "mass", "grip_force_at_hand", "holds", "held",
             "grip_force_needed", "payload_best", "payload_p50")  # fmt: skip
    assert all(getattr(row, name) is None for name in names)
    assert row.grasps[0].grip_force is None
    assert row.grasps[0].payload is None


@pytest.mark.slow
def test_values_that_are_not_known_are_null(tmp_path: Path) -> None:
    row = row_under(Load(density=1000.0), tmp_path)
    assert row.mass == pytest.approx(0.12)
    assert (row.grip_force_at_hand, row.holds, row.held, row.payload_p50) == (None,) * 4
    assert math.isfinite(row.grip_force_needed or math.nan)
