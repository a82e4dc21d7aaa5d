"""Labelling one mesh of a batch: its row and its files."""

import math
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import trimesh

from grasp3d import GraspModel, MeshOptions, Sampling, Table, best_grasps, label_surface, load_mesh
from grasp3d.batch import labelling
from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.inputs import MeshFile
from grasp3d.batch.labelling import Unchanged, label_job
from grasp3d.batch.limits import NeedsMemory
from grasp3d.batch.plan import Job
from grasp3d.batch.row import Outcome, Row
from grasp3d.batch.storage.folder import Folder
from grasp3d.describe import verdict_of
from grasp3d.errors import SettingError
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.settings.pose_error import PoseError
from grasp3d.surface.labels import SurfaceLabels
from tests.helpers import shapes
from tests.helpers.grippers import HAND
from tests.helpers.jobs import TIMINGS

SETTINGS = BatchSettings(
    GraspModel(friction=0.4),
    Sampling(rays=16),
    MeshOptions(unit="cm", max_edge="0.2cm"),
    best=2,
)


def job_of(source: Path, output: Path, *, known_content: str = "") -> Job:
    mesh = MeshFile(source.name, str(source), source.stat().st_size, "stamp")
    return Job(mesh, source.stem, Folder(str(output)), known_content)


def egg(folder: Path) -> Path:
    vertices, faces = shapes.sphere(2)
    mesh = trimesh.Trimesh(vertices * (1.0, 1.0, 1.6), faces, process=False)
    mesh.export(folder / "egg.ply")
    return folder / "egg.ply"


def row_of(job: Job, settings: BatchSettings = SETTINGS) -> Row:
    row = label_job(job, settings)
    assert isinstance(row, Row)
    return row


def labels_of(source: Path, settings: BatchSettings = SETTINGS) -> SurfaceLabels:
    mesh = load_mesh(source, unit="cm", max_edge="0.2cm")
    return label_surface(mesh, settings.model, sampling=settings.sampling)


@pytest.mark.slow
def test_threads_change_neither_row_nor_files(tmp_path: Path) -> None:
    job = job_of(egg(tmp_path), tmp_path / "one")
    other = replace(job, threads=3, output=Folder(str(tmp_path / "three")))
    one, three = (asdict(row_of(each)) for each in (job, other))
    assert {name for name in one if one[name] != three[name]} <= TIMINGS
    for name in (job.labels, job.fields, f"{job.page}.glb", f"{job.page}.webp"):
        assert job.output.read(name) == other.output.read(name)


@pytest.mark.slow
def test_a_row_has_the_values_of_labelling_the_file(tmp_path: Path) -> None:
    source = egg(tmp_path)
    row, labels = row_of(job_of(source, tmp_path / "out")), labels_of(source)
    assert (row.outcome, row.error, row.unit, row.closed) == ("labelled", "", "m", True)
    assert (row.stable, row.ambiguous, row.no_grasp_found) == tuple(labels.fractions().values())
    assert row.critical_angle_p25 == labels.quantiles("critical_angle", [0.25])[0]
    quantiles = (row.epsilon_p10, row.epsilon_p50, row.epsilon_p90)
    assert quantiles == tuple(labels.quantiles("epsilon", [0.1, 0.5, 0.9]))
    quantiles = (row.epsilon_min_p10, row.epsilon_min_p50, row.epsilon_min_p90)
    assert quantiles == tuple(labels.quantiles("epsilon_min", [0.1, 0.5, 0.9]))
    assert row.volume == pytest.approx(labels.mesh.volume)
    assert row.area == pytest.approx(1e-4 * trimesh.load_mesh(source).area, rel=0.01)
    assert row.torque_scale == labels.mesh.torque_scale
    assert row.vertices == len(labels.mesh.vertices)
    needed = labels.angle_distribution().required_resolution(0.8, friction=0.4)
    assert row.required_resolution_80 == pytest.approx(needed)
    assert row.search_angle == labels.search.cone
    assert 0.0 < row.seconds_labelling < row.seconds


@pytest.mark.slow
def test_the_files_contain_the_labels(tmp_path: Path) -> None:
    source = egg(tmp_path)
    row, labels = row_of(job_of(source, tmp_path / "out")), labels_of(source)
    made = {str(path.relative_to(tmp_path / "out")) for path in (tmp_path / "out").rglob("*.*")}
    assert made == set(row.files)
    written = trimesh.load_mesh(tmp_path / "out" / row.labels, process=False)
    raw = written.metadata["_ply_raw"]["vertex"]["data"]
    assert np.array_equal(raw["label"], labels.label)
    assert np.array_equal(raw["epsilon_min"], labels.epsilon_min)
    fields = pq.read_table(tmp_path / "out" / row.fields)
    assert fields.num_rows == row.vertices
    angles = fields.column("critical_angle").to_numpy()
    assert np.allclose(angles, labels.critical_angle, rtol=1e-6, equal_nan=True)


@pytest.mark.slow
def test_quantiles_and_required_resolutions_are_those_of_the_vertices(tmp_path: Path) -> None:
    source = egg(tmp_path)
    settings = replace(SETTINGS, model=replace(SETTINGS.model, location_error="0.5mm"), best=0)
    row, labels = row_of(job_of(source, tmp_path / "out"), settings), labels_of(source, settings)
    assert (row.friction_min, row.friction_max, row.location_error) == (0.4, 0.4, 0.0005)
    margins = (row.margin_p10, row.margin_p50, row.margin_p90)
    assert None not in margins
    assert sorted(margins) == list(margins)
    weights = labels.mesh.vertex_areas / labels.mesh.vertex_areas.sum()
    for values, median in (
        (labels.max_resolution, row.required_resolution_50),
        (labels.margin, row.margin_p50),
    ):
        assert median is not None
        assert weights[values > median + 1e-9].sum() <= 0.5 <= weights[values > median - 1e-9].sum()


def test_a_pose_error_is_of_the_best_grasps() -> None:
    reach = ReachSettings(hand=HAND, pose_error=PoseError.of("2mm"))
    assert BatchSettings(reach=reach, best=1).best == 1
    with pytest.raises(SettingError, match="a pose error tries wrong poses of the best grasps"):
        BatchSettings(reach=reach, best=0)


@pytest.mark.slow
def test_the_best_grasps_are_those_of_the_surface(tmp_path: Path) -> None:
    source = egg(tmp_path)
    row, best = row_of(job_of(source, tmp_path / "out")), best_grasps(labels_of(source), 2)
    assert len(row.grasps) == 2
    for number, grasp in enumerate(row.grasps):
        assert grasp.critical_angle == best.critical_angle[number]
        assert grasp.epsilon == pytest.approx(best.epsilon[number], rel=0.01)
        assert np.allclose(grasp.points, best.contacts.points[number])
        assert np.allclose(grasp.normals, -best.contacts.normals[number])
        across = np.subtract(*grasp.points)
        assert grasp.opening == pytest.approx(np.linalg.norm(across))
        assert np.dot(across, grasp.normals[0]) > 0.0  # outward


def held(source: Path, folder: Path, **changes: float) -> Row:
    """The row of a mesh on a table, beside a gripper."""
    reach = ReachSettings(replace(HAND, **changes), "as-is")
    return row_of(job_of(source, folder), replace(SETTINGS, reach=reach))


@pytest.mark.slow
def test_with_a_gripper_a_row_has_the_verdict_and_poses(tmp_path: Path) -> None:
    source = egg(tmp_path)
    row = held(source, tmp_path / "out")
    mesh = load_mesh(source, unit="cm", max_edge="0.2cm")
    labels = label_surface(
        mesh, SETTINGS.model, sampling=SETTINGS.sampling, hand=HAND, table=Table.below(mesh)
    )
    best = best_grasps(labels, 2)
    verdict = verdict_of(labels)
    assert (row.error, row.gripper) == ("", "hand")
    assert (row.verdict, row.verdict_text) == (verdict.word, str(verdict))
    assert (row.stable_grasps, row.spare_resolution) == (verdict.count, verdict.spare_resolution)
    assert row.stable == labels.fractions()["S"] < row_of(job_of(source, tmp_path / "no")).stable
    for number, grasp in enumerate(row.grasps):
        assert np.reshape(grasp.pose, (4, 4)) == pytest.approx(best.poses[number])
        assert grasp.approach_margin == best.approach_margin[number]
        assert grasp.score == best.score[number]
        assert grasp.label == "S"
    fields = pq.read_table(tmp_path / "out" / row.fields)
    margins = fields["approach_margin"].to_numpy()
    assert margins == pytest.approx(labels.reach.approach_margin, abs=1e-6, nan_ok=True)


def test_what_is_out_of_reach_has_a_row_that_says_why(tmp_path: Path) -> None:
    row = held(egg(tmp_path), tmp_path / "out", min_opening=0.07)
    assert (row.error, row.verdict, row.stable_grasps) == ("", "not", 0)
    assert (row.verdict_text or "").startswith(
        "Not held by hand: too wide or too narrow for the stro"
    )
    assert (row.causes or "").startswith("too wide or too narrow for the stroke (")
    assert row.grasps == ()
    assert row.spare_resolution is None


def test_a_surface_without_any_grasp_has_a_row_without_grasps(tmp_path: Path) -> None:
    trimesh.Trimesh([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]]).export(tmp_path / "one.ply")
    row = row_of(job_of(tmp_path / "one.ply", tmp_path / "out"))
    assert (row.outcome, row.grasps) == (Outcome.LABELLED, ())
    assert row.no_grasp_found == pytest.approx(1.0)
    assert (row.required_resolution_50, row.critical_angle_p50) == (0.0, math.inf)
    assert row.volume is None


@pytest.mark.slow
def test_a_result_that_cannot_be_written_is_lost_and_tried_again(tmp_path: Path) -> None:
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / "labels").touch()  # where a folder should be
    row = row_of(job_of(egg(tmp_path), tmp_path / "out"))
    assert row.outcome == Outcome.LOST
    assert "labels" in row.error


@pytest.mark.slow
def test_the_same_content_is_not_labelled_again(tmp_path: Path) -> None:
    source = egg(tmp_path)
    first = row_of(job_of(source, tmp_path / "out"))
    again = label_job(job_of(source, tmp_path / "out2", known_content=first.content), SETTINGS)
    assert again == Unchanged(job_of(source, tmp_path / "out2").mesh)
    assert not (tmp_path / "out2").exists()
    source.write_bytes(source.read_bytes() + b"\n")
    other = row_of(job_of(source, tmp_path / "out", known_content=first.content))
    assert other.content != first.content
    assert other.key != first.key


def test_a_mesh_that_needs_too_much_memory_raises(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(labelling, "allowed_memory", lambda: 0.1)
    with pytest.raises(NeedsMemory):
        label_job(job_of(egg(tmp_path), tmp_path / "out"), SETTINGS)
    assert not (tmp_path / "out").exists()
