import json
import math
import os
import signal
import socket
from contextlib import suppress
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import trimesh

from grasp3d import (
    GraspModel,
    MeshError,
    MeshOptions,
    OutputError,
    Sampling,
    label_surface,
    load_mesh,
)
from grasp3d.batch.job import BatchSettings, Job, Row, label_file, lost_row
from grasp3d.batch.plan import make_folders, plan
from grasp3d.batch.run import run
from grasp3d.batch.store import write_summary
from grasp3d.names import name_key, safe_stem, short_hash
from tests import shapes

SETTINGS = BatchSettings(
    GraspModel(friction=0.4, edges=8), Sampling(rays=16), MeshOptions(unit="cm")
)


def ball(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    vertices, faces = shapes.sphere(2)
    trimesh.Trimesh(vertices, faces, process=False).export(path)
    return path


def test_every_mesh_below_a_folder_gets_a_name_of_its_own(tmp_path: Path) -> None:
    library, out = tmp_path / "library", tmp_path / "library" / "out"
    for name in ("mug.stl", "mug.ply", "MUG.off", "deep/mug.stl", "a b.PLY", "out/mug_labeled.ply"):
        ball(library / name)
    (library / "notes.txt").write_text("no mesh", encoding="ascii")
    (library / "folder.stl").mkdir()
    jobs = plan([library, library / "mug.stl", library / "deep"], out)
    assert [job.name for job in jobs] == [
        "MUG.off",
        "a b.PLY",
        "deep/mug.stl",
        "mug.ply",
        "mug.stl",
    ]
    targets = [job.labeled for job in jobs]
    assert targets == [
        "MUG_off_labeled.ply",
        "a b_labeled.ply",
        "deep/mug_labeled.ply",
        "mug_ply_labeled.ply",
        "mug_stl_labeled.ply",
    ]
    assert len({target.casefold() for target in targets}) == len(targets)


def named(*sources: Path, out: Path) -> dict[Path, str]:
    """What the results of meshes are called, whatever their order."""
    names = {job.source: job.labeled for job in plan(sources, out)}
    assert {job.source: job.labeled for job in plan(sources[::-1], out)} == names
    keys = {name_key(str(out / name)) for name in names.values()}
    assert len(keys) == len(names) == len(sources)
    return names


def test_names_that_meet_all_the_same_say_which_file_they_are_of(tmp_path: Path) -> None:
    files = [ball(tmp_path / folder / "mug.stl") for folder in ("one", "two", "Three")]
    both = named(*files[:2], out=tmp_path)
    told = [short_hash(file.as_posix()) for file in files]
    assert both == {
        file: f"mug_stl-{words}_labeled.ply" for file, words in zip(files[:2], told, strict=False)
    }
    assert both.items() <= named(*files, out=tmp_path).items()  # one more renames none
    other = ball(tmp_path / "one" / "mug.obj")
    assert named(*files, other, out=tmp_path)[other] == "mug_obj_labeled.ply"


def test_no_two_results_have_one_name_on_any_file_system(tmp_path: Path) -> None:
    names = (
        "mug.stl",
        "mug.obj",
        "MUG.STL",
        "mug_stl.ply",
        "mug_stl_labeled.obj",
        "cafe\u0301.ply",
    )
    names += (
        "café.ply",
        "CON.stl",
        "con.stl",
        "a:b.stl",
        "a*b.stl",
        "a\nb.stl",
        "x" * 250 + ".stl",
    )
    names += ("x" * 249 + "y.stl", "..stl", "...stl", os.fsdecode(b"mug\xff.stl"), " .stl")
    for name in names:
        try:
            ball(tmp_path / "in" / name)
        except OSError:  # a file system that knows no such name has less to tell apart
            continue
    made = named(*sorted((tmp_path / "in").iterdir()), out=tmp_path / "out")
    assert len(made) > 10
    for name in made.values():
        assert name.endswith("_labeled.ply")
        stem = name.removesuffix("_labeled.ply").rsplit("-", 1)[0]
        assert safe_stem(stem) == stem
        assert len(name.encode()) < 200
    assert made[tmp_path / "in" / "mug.obj"] == "mug_obj_labeled.ply"


def test_folders_below_the_input_are_kept_under_safe_names(tmp_path: Path) -> None:
    for name in ("a:b/mug.stl", "A:b/mug.stl", "deep/down here/mug.stl", "mug_labeled.ply/mug.stl"):
        ball(tmp_path / "in" / name)
    ball(tmp_path / "in" / "mug.stl")
    made = [Path(job.labeled) for job in plan([tmp_path / "in"], tmp_path / "out")]
    assert Path("deep/down here/mug_labeled.ply") in made
    assert Path("mug_labeled.ply/mug_labeled.ply") in made
    assert Path("mug_stl_labeled.ply") in made  # a folder has the plain name
    assert {path.parent.name for path in made} >= {safe_stem("a:b"), safe_stem("A:b")}
    make_folders(plan([tmp_path / "in"], tmp_path / "out"))
    assert not any((tmp_path / "out" / path).exists() for path in made)


def test_no_result_replaces_a_mesh(tmp_path: Path) -> None:
    mug, given = ball(tmp_path / "mug.stl"), ball(tmp_path / "mug_labeled.ply")
    made = named(mug, given, out=tmp_path)
    assert made == {mug: "mug_stl_labeled.ply", given: "mug_labeled_labeled.ply"}
    link = tmp_path / "links" / "mug_labeled.ply"
    link.parent.mkdir()
    link.symlink_to(ball(tmp_path / "far" / "cup.ply"))
    assert named(mug, link, out=link.parent)[mug] == "mug_stl_labeled.ply"


def test_nothing_to_do_is_an_error_and_not_an_empty_result(tmp_path: Path) -> None:
    with pytest.raises(MeshError, match="no mesh in it"):
        plan([tmp_path], tmp_path / "out")
    with pytest.raises(MeshError, match="there is no such file or folder"):
        plan([tmp_path / "missing"], tmp_path / "out")


def test_one_job_is_what_labelling_the_file_gives(tmp_path: Path) -> None:
    source = ball(tmp_path / "ball.ply")
    row = label_file(Job("ball.ply", source, tmp_path, "out.ply"), SETTINGS)
    labels = label_surface(load_mesh(source, unit="cm"), SETTINGS.model, sampling=SETTINGS.sampling)
    assert (row.stable, row.ambiguous, row.no_grasp_found) == tuple(labels.fractions().values())
    assert row.critical_angle_p50 == labels.angle_quantiles([0.5])[0]
    quantiles = (row.epsilon_p10, row.epsilon_p50, row.epsilon_p90)
    assert quantiles == tuple(labels.epsilon_quantiles([0.1, 0.5, 0.9]))
    quantiles = (row.epsilon_min_p10, row.epsilon_min_p50, row.epsilon_min_p90)
    assert quantiles == tuple(labels.epsilon_quantiles([0.1, 0.5, 0.9], of="minimum"))
    assert row.torque_scale == labels.mesh.torque_scale
    assert (row.error, row.unit, row.closed, row.labeled) == ("", "cm", True, "out.ply")
    assert row.vertices == len(labels.mesh.vertices)
    assert row.seconds > 0.0
    written = trimesh.load_mesh(tmp_path / "out.ply", process=False)
    raw = written.metadata["_ply_raw"]["vertex"]["data"]
    assert np.array_equal(raw["label"], labels.label)
    assert np.array_equal(raw["epsilon_min"], np.float32(labels.epsilon_min))


def test_a_mesh_that_cannot_be_read_is_a_row_with_the_reason(tmp_path: Path) -> None:
    bad = tmp_path / "bad.stl"
    bad.write_text("not a mesh", encoding="ascii")
    row = label_file(Job("bad.stl", bad, tmp_path, "out.ply"), SETTINGS)
    assert "holds no triangles" in row.error
    assert row.stable is None
    assert not (tmp_path / "out.ply").exists()


def test_the_summary_keeps_every_field_and_the_settings(tmp_path: Path) -> None:
    rows = [Row("b", error="broken"), Row("a", stable=0.5, critical_angle_p90=math.inf)]
    write_summary(tmp_path / "summary.parquet", rows, SETTINGS)
    table = pq.read_table(tmp_path / "summary.parquet")
    assert table.column("mesh").to_pylist() == ["a", "b"]
    assert table.column("error").to_pylist() == ["", "broken"]
    assert table.column("critical_angle_p90").to_pylist() == [math.inf, None]
    assert set(table.column_names) == set(Row.__dataclass_fields__)
    settings = json.loads(table.schema.metadata[b"grasp3d"])
    assert settings["model"]["friction"] == 0.4
    assert settings["mesh"]["unit"] == "cm"
    assert (settings["epsilon_min"], settings["epsilon_rank"]) == ("effective_friction", 5)


def test_results_beside_the_meshes_are_not_labelled_again(tmp_path: Path) -> None:
    for name in ("mug.stl", "mug_labeled.ply", "._mug.stl"):
        ball(tmp_path / name)
    assert [job.name for job in plan([tmp_path], tmp_path)] == ["mug.stl"]
    make_folders(plan([tmp_path], tmp_path / "new" / "deep"))
    assert (tmp_path / "new" / "deep").is_dir()
    (tmp_path / "taken").touch()
    with pytest.raises(OutputError, match="cannot be made"):
        make_folders(plan([tmp_path], tmp_path / "taken"))


def test_names_that_are_no_unicode_are_written_out(tmp_path: Path) -> None:
    write_summary(tmp_path / "s.parquet", [Row(os.fsdecode(b"mug\xff.stl"))], SETTINGS)
    assert pq.read_table(tmp_path / "s.parquet").column("mesh").to_pylist() == ["mug\\xff.stl"]


def killed(job: Job, settings: BatchSettings) -> Row:
    """A job whose process dies on one mesh, and that fails strangely on another."""
    if "deadly" in job.name:
        os.kill(os.getpid(), signal.SIGKILL)
    if "strange" in job.name:
        raise ValueError("no one thought of this")
    return label_file(job, settings)


def test_a_run_beside_another_warns_of_nothing(tmp_path: Path) -> None:
    """Dask's usual port may be taken; warnings are errors here."""
    ball(tmp_path / "in" / "1.ply")
    jobs = plan([tmp_path / "in"], tmp_path / "out")
    make_folders(jobs)
    with socket.socket() as other:
        with suppress(OSError):  # taken already, which will do
            other.bind(("0.0.0.0", 8787))  # noqa: S104, where Dask would look
            other.listen()
        (row,) = run(label_file, jobs, SETTINGS, lost=lost_row, workers=1)
    assert row.error == ""


@pytest.mark.slow
def test_a_mesh_that_kills_its_process_harms_no_other(tmp_path: Path) -> None:
    for name in ("1.ply", "2_deadly.ply", "3.ply", "4_strange.ply", "5.ply", "6.ply"):
        ball(tmp_path / "in" / name)
    jobs = plan([tmp_path / "in"], tmp_path / "out")
    make_folders(jobs)
    done = run(killed, jobs, SETTINGS, lost=lost_row, workers=2)
    rows = {row.mesh: row for row in done}
    assert len(rows) == 6
    assert "died" in rows["2_deadly.ply"].error
    assert "unexpected ValueError: no one thought of this" in rows["4_strange.ply"].error
    assert [name for name, row in rows.items() if row.error] == [
        name for name in rows if "deadly" in name or "strange" in name
    ]
    assert len(list((tmp_path / "out").glob("*.ply"))) == 4


def test_lengths_in_another_unit_are_told_in_the_row(tmp_path: Path) -> None:
    trimesh.creation.box((0.04, 0.06, 0.08)).export(tmp_path / "box.stl")
    settings = BatchSettings(sampling=Sampling(rays=8, max_opening=80.0))
    row = label_file(Job("box.stl", tmp_path / "box.stl", tmp_path, "box.ply"), settings)
    assert "max_opening 80 is" in row.warnings
