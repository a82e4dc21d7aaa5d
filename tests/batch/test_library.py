"""A library of meshes from Python: labelled, resumed, and robust to failures."""

import os
from collections import Counter
from collections.abc import Iterable
from dataclasses import asdict, replace
from itertools import pairwise
from pathlib import Path

import pytest
import trimesh

from grasp3d import GraspModel, MeshOptions, Sampling
from grasp3d.batch import labelling, library, read_summary
from grasp3d.batch.batch_settings import BatchSettings, ClusterSettings
from grasp3d.batch.labelling import Unchanged, label_job
from grasp3d.batch.library import BatchProgress, LibraryLabels, label_library
from grasp3d.batch.plan import Job
from grasp3d.batch.row import Outcome, Row
from grasp3d.errors import FileUnreadError, OutputError
from tests.helpers import shapes
from tests.helpers.jobs import TIMINGS

QUICK = BatchSettings(GraspModel(), Sampling(rays=8), MeshOptions(max_edge=10.0), best=1)
HERE = ClusterSettings(workers=0)
LOCATIONS = frozenset({"source", "stamp", "error"})
"""Columns that depend on the location of a file."""


def mesh(path: Path, size: float = 1.0, subdivisions: int = 1) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    vertices, faces = shapes.sphere(subdivisions)
    trimesh.Trimesh(vertices * (size, 1.0, 1.5), faces, process=False).export(path)
    return path


def small_library(folder: Path) -> Path:
    for number, name in enumerate(("a.ply", "b.stl", "deep/c.obj", "d.ply"), 2):
        mesh(folder / name, number)
    (folder / "bad.stl").write_text("nonsense", encoding="ascii")
    return folder


def label(
    inputs: Path | str, output: Path | str, settings: BatchSettings = QUICK, **options: object
) -> tuple[LibraryLabels, list[str]]:
    """Label in this process; returns the result, and the meshes that were labelled, in order."""
    labelled: list[str] = []

    def record(progress: BatchProgress) -> None:
        if progress.row is not None:
            labelled.append(progress.row.mesh)

    options = {"cluster": HERE, "progress": record} | options
    return label_library([inputs], output, settings, **options), labelled  # type: ignore[arg-type]


def values(rows: Iterable[Row], besides: frozenset[str] = frozenset()) -> list[dict[str, str]]:
    """Values of rows, except those that differ between runs."""
    return [
        {key: str(value) for key, value in asdict(row).items() if key not in TIMINGS | besides}
        for row in sorted(rows, key=lambda row: row.mesh)
    ]


@pytest.mark.slow
def test_every_mesh_has_a_row_and_its_files(tmp_path: Path) -> None:
    done, labelled = label(small_library(tmp_path / "in"), tmp_path / "out")
    assert list(done.rows) == ["a.ply", "b.stl", "bad.stl", "d.ply", "deep/c.obj"]
    assert [row.mesh for row in done.failed] == ["bad.stl"]
    sizes = [(tmp_path / "in" / name).stat().st_size for name in labelled]
    assert sizes == sorted(sizes, reverse=True)  # the largest first
    for row in done.rows.values():
        for name in (row.labels, row.fields, row.thumbnail, row.page, row.model):
            assert bool(name) == (row.outcome == Outcome.LABELLED)
            assert not name or (tmp_path / "out" / name).stat().st_size > 0
    assert values(read_summary(tmp_path / "out")) == values(done.rows.values())
    assert done.summary.to_table()["mesh"].to_pylist() == list(done.rows)
    assert (tmp_path / "out" / "report" / "index.html").is_file()


@pytest.mark.slow
def test_only_new_changed_and_missing_meshes_are_labelled_again(
    tmp_path: Path,
) -> None:
    source, out = small_library(tmp_path / "in"), tmp_path / "out"
    first, _ = label(source, out)
    again, labelled = label(source, out)
    assert (labelled, again.finished) == ([], 5)  # refused meshes are finished as well
    assert values(again.rows.values()) == values(first.rows.values())
    (out / "labels" / "d.ply").unlink()
    assert label(source, out)[1] == ["d.ply"]
    assert (out / "labels" / "d.ply").is_file()
    mesh(source / "a.ply", 1.2)
    mesh(source / "new.ply", 1.3)
    more, labelled = label(source, out)
    assert sorted(labelled) == ["a.ply", "new.ply"]
    assert len(more.rows) == 6
    before, after = first.rows["a.ply"], more.rows["a.ply"]
    assert before.size != after.size
    rest = [row for row in more.rows.values() if row.mesh not in {"a.ply", "new.ply"}]
    assert values(rest) == values([row for row in first.rows.values() if row.mesh != "a.ply"])


def test_a_mesh_is_identified_by_its_content_not_by_its_date_or_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    results: list[object] = []

    def recorded(job: Job, settings: BatchSettings) -> Row | Unchanged:
        results.append(label_job(job, settings))
        return results[-1]  # type: ignore[return-value]

    source, out = small_library(tmp_path / "in"), tmp_path / "out"
    first, _ = label(source, out)
    moved = source.rename(tmp_path / "moved")
    for path in moved.rglob("*.*"):
        os.utime(path, (1, 1))
    monkeypatch.setattr(library, "label_job", recorded)
    again, _ = label(moved, out)
    assert [type(one) for one in results] == [Unchanged] * 5
    assert values(again.rows.values(), LOCATIONS) == values(first.rows.values(), LOCATIONS)
    results.clear()
    label(moved, out)
    assert results == []  # the new dates are stored


@pytest.mark.slow
def test_other_settings_and_force_label_again(tmp_path: Path) -> None:
    source, out = small_library(tmp_path / "in"), tmp_path / "out"
    label(source, out)
    assert len(label(source, out, overwrite=True)[1]) == 5
    other = replace(QUICK, model=GraspModel(friction=0.8))
    states: list[BatchProgress] = []
    done, _ = label(source, out, other, progress=states.append)
    assert sum(state.row is not None for state in states) == 5
    assert states[0].stale == 4  # the fifth was refused
    fresh, _ = label(source, tmp_path / "fresh", other)
    assert values(done.rows.values()) == values(fresh.rows.values())
    assert values(read_summary(out)) == values(fresh.rows.values())


def test_libraries_with_the_same_settings_grow_together_others_are_refused(tmp_path: Path) -> None:
    one, two, out = tmp_path / "one", tmp_path / "two", tmp_path / "out"
    mesh(one / "mug.ply")
    mesh(two / "cup.ply")
    label(one, out)
    done, _ = label(two, out)
    assert list(done.rows) == ["cup.ply"]
    assert [row.mesh for row in read_summary(out)] == ["cup.ply", "mug.ply"]
    other = replace(QUICK, best=0)
    with pytest.raises(OutputError, match="other settings"):
        label(two, out, other)
    assert [row.mesh for row in read_summary(out)] == ["cup.ply", "mug.ply"]
    label(two, out, other, overwrite=True)
    assert [row.mesh for row in read_summary(out)] == ["cup.ply"]


def test_a_file_has_one_row_however_it_is_named(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, out = small_library(tmp_path / "in"), tmp_path / "out"
    label(source, out)
    for inputs in (f"{source}/deep/*.obj", source / "deep", source / "deep" / "c.obj"):
        done, _ = label(inputs, out)
        assert (list(done.rows), done.finished) == (["deep/c.obj"], 1)
    monkeypatch.chdir(source)
    done, _ = label("deep", out)
    assert list(done.rows) == ["deep/c.obj"]
    assert len(read_summary(out)) == 5


def test_another_file_of_the_same_name_has_its_own_row(tmp_path: Path) -> None:
    one, two, out = tmp_path / "one", tmp_path / "two", tmp_path / "out"
    mesh(one / "mug.ply")
    other = mesh(two / "mug.ply", 2.0)
    first, _ = label(one, out)
    done, _ = label(two, out)
    assert list(done.rows) == [str(other)]
    rows = {row.mesh: row for row in read_summary(out)}
    assert rows["mug.ply"] == first.rows["mug.ply"]
    assert len({row.labels for row in rows.values()}) == 2
    both = label_library([one, two], out, QUICK, cluster=HERE)
    assert (len(both.rows), both.finished) == (2, 2)


def test_a_replaced_file_with_the_same_date_is_labelled_again(tmp_path: Path) -> None:
    source, out = tmp_path / "in", tmp_path / "out"
    for size in (1.0, 2.0):
        path = mesh(source / "a.stl", size)
        os.utime(path, ns=(10**18, 10**18))
        done, labelled = label(source, out)
        assert labelled == ["a.stl"]
    assert path.stat().st_size == done.rows["a.stl"].bytes


def test_temporary_failures_are_tried_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unread(path: Path) -> str:
        raise FileUnreadError(f"{path}: its reader was killed")

    source, out = small_library(tmp_path / "in"), tmp_path / "out"
    monkeypatch.setattr(labelling, "content_hash", unread)
    done, _ = label(source, out)
    assert {row.outcome for row in done.failed} == {Outcome.LOST}
    monkeypatch.undo()
    assert len(label(source, out)[1]) == 5


def test_results_of_another_run_are_not_inputs(tmp_path: Path) -> None:
    mesh(tmp_path / "mug.ply")
    label(tmp_path, tmp_path / "first")
    done, _ = label(tmp_path, tmp_path / "second")
    assert list(done.rows) == ["mug.ply"]


def test_the_progress_counts_all_meshes(tmp_path: Path) -> None:
    states: list[BatchProgress] = []
    source, out = small_library(tmp_path / "in"), tmp_path / "out"
    label(source, out, progress=states.append)
    assert (states[0].left, states[0].fraction, states[0].row) == (5, 0.0, None)
    assert (states[-1].left, states[-1].labelled, states[-1].failed) == (0, 4, 1)
    assert states[-1].fraction == pytest.approx(1.0)
    assert all(a.fraction <= b.fraction for a, b in pairwise(states))
    assert Counter(state.row.mesh for state in states if state.row).most_common(1)[0][1] == 1


# Faults: each of these runs in a process of its own.


@pytest.mark.slow
def test_the_number_of_processes_does_not_change_the_results(tmp_path: Path) -> None:
    source = small_library(tmp_path / "in")
    for vertices, faces in (shapes.box(), shapes.lopsided()):
        trimesh.Trimesh(vertices, faces).export(source / f"{len(vertices)}.ply")
    settings = replace(QUICK, sampling=Sampling(rays=16), mesh=MeshOptions(max_edge=0.3))
    rows = {}
    for workers in (0, 2):
        out, cluster = tmp_path / f"out{workers}", ClusterSettings(workers=workers)
        done, _ = label(source, out, settings, cluster=cluster)
        rows[workers] = values(done.rows.values())
        files = sorted(path for path in out.rglob("*.*") if path.parent.name != "summary")
        rows[f"files {workers}"] = {  # type: ignore[index]
            str(path.relative_to(out)): path.read_bytes()
            for path in files
            if path.is_file() and path.suffix in {".ply", ".parquet", ".webp", ".glb"}
        }
    assert rows[0] == rows[2]
    assert rows["files 0"] == rows["files 2"]  # type: ignore[index]
    assert len(rows["files 0"]) == 4 * 6  # type: ignore[index]
