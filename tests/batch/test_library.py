"""A library of meshes from Python: labelled, resumed, in parts, from tables, and after failures."""

import errno
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from grasp3d import GraspModel, MeshOptions, Sampling, load_mesh, open_library
from grasp3d.batch import Library, labelling
from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.library import BatchProgress, label_library
from grasp3d.batch.row import Outcome
from grasp3d.errors import FileUnreadError, MeshError, OutputError, SettingError
from grasp3d.hand.hand_files import write_hand
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.hand.reach_settings import ReachSettings
from grasp3d.jobs import ClusterSettings
from grasp3d.system import places
from grasp3d.system.files import atomic_write
from tests.helpers import shapes
from tests.helpers.commands import export
from tests.helpers.jobs import TIMINGS

QUICK = BatchSettings(GraspModel(), Sampling(rays=8), MeshOptions(max_edge=10.0), best=1)
HERE = ClusterSettings(workers=0)
NAMES = ["a.ply", "b.stl", "bad.stl", "d.ply", "deep/c.obj"]


def mesh(path: Path, size: float = 1.0) -> Path:
    vertices, faces = shapes.sphere(1)
    return export(path, (vertices * (size, 1.0, 1.5), faces))


def small_library(folder: Path) -> Path:
    for number, name in enumerate(name for name in NAMES if name != "bad.stl"):
        mesh(folder / name, 1.0 + number)
    (folder / "bad.stl").write_text("nonsense", encoding="ascii")
    return folder


def label(
    inputs: Path | str, output: Path | str, settings: BatchSettings = QUICK, **options: Any
) -> tuple[Library, list[str]]:
    """Label in this process, without a report; returns the meshes that were labelled too."""
    labelled: list[str] = []

    def record(progress: BatchProgress) -> None:
        labelled.extend([] if progress.row is None else [progress.row.mesh])

    options = {"cluster": HERE, "progress": record, "report": False, **options}
    return label_library([inputs], output, settings, **options), sorted(labelled)


def values(library: Library, *besides: str) -> list[dict[str, str]]:
    """Values of the rows, except those that differ between runs."""
    left_out, rows = {*TIMINGS, "source", "stamp", *besides}, map(asdict, library.rows())
    return [{key: str(row[key]) for key in row if key not in left_out} for row in rows]


@contextmanager
def unchanged(folder: Path) -> Iterator[None]:
    """Nothing inside changes a folder, but for locks."""

    def files() -> dict[Path, int]:
        found = (path for path in folder.rglob("*") if path.is_file() and "lock" not in path.name)
        return {path: path.stat().st_mtime_ns for path in found}

    before = files()
    yield
    assert files() == before


@pytest.mark.slow
def test_every_mesh_has_a_row_and_its_files_whatever_labels_it(tmp_path: Path) -> None:
    source, states = small_library(tmp_path / "in"), list[BatchProgress]()
    done, _ = label(source, tmp_path / "out", report=True, progress=states.append)
    assert list(done.meshes) == NAMES
    for row in done.rows():
        assert (row.outcome == Outcome.REFUSED) == bool(row.error) == (row.mesh == "bad.stl")
        for name in (row.surface, row.thumbnail, row.page):
            assert bool(name) == (row.outcome == Outcome.LABELLED)
            assert not name or (tmp_path / "out" / name).stat().st_size > 0
    assert (tmp_path / "out" / "report" / "index.html").is_file()
    assert done.settings["model"]["friction"] == QUICK.model.friction
    assert (states[0].left, states[0].fraction, states[0].row) == (5, 0.0, None)
    assert (states[-1].left, states[-1].labelled, states[-1].failed) == (0, 4, 1)
    assert states[-1].fraction == pytest.approx(1.0)
    assert all(a.fraction < b.fraction for a, b in pairwise(states))
    two, _ = label(source, tmp_path / "two", report=True, cluster=ClusterSettings(workers=2))
    assert values(two) == values(done)
    for path in (one for k in ("ply", "webp", "glb") for one in (tmp_path / "out").rglob(f"*.{k}")):
        other = tmp_path / "two" / path.relative_to(tmp_path / "out")
        assert other.read_bytes() == path.read_bytes()


def test_only_what_is_new_changed_or_lost_is_labelled(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def unread(path: Path) -> str:
        raise FileUnreadError(f"{path}: its reader was killed")

    source, out = small_library(tmp_path / "in"), tmp_path / "out"
    monkeypatch.setattr(labelling, "content_hash", unread)
    assert {row.outcome for row in label(source, out)[0].rows()} == {Outcome.LOST}
    monkeypatch.undo()
    assert label(source, out)[1] == NAMES
    assert label(source, out)[1] == []  # what was refused is finished as well
    moved = source.rename(tmp_path / "moved")
    for path in moved.rglob("*.*"):
        os.utime(path, (1, 1))
    assert label(moved, out)[1] == []  # the content counts
    date = (moved / "a.ply").stat().st_mtime_ns
    os.utime(mesh(moved / "a.ply", 1.2), ns=(date, date))  # whatever the date is
    mesh(moved / "new.ply", 1.3)
    assert label(f"{moved}/*.stl", out)[1] == []
    assert label(moved, out)[1] == ["a.ply", "new.ply"]
    fresh, _ = label(moved, tmp_path / "fresh")
    assert values(open_library(out), "error") == values(fresh, "error")


def test_other_settings_are_refused_unless_they_replace_all(tmp_path: Path) -> None:
    source, out = mesh(tmp_path / "in" / "a.ply").parent, tmp_path / "out"
    label(source, out)
    other = replace(QUICK, best=0)
    with unchanged(tmp_path):
        for options in ({"settings": other}, {"surfaces": "tar"}):
            with pytest.raises(OutputError, match=r"has results of .*replace them with --overwr"):
                label(source, out, **options)
        with pytest.raises(SettingError, match="no surfaces are called 'zip'"):
            label(source, out, surfaces="zip")
    mesh(tmp_path / "two" / "b.ply")
    done, labelled = label(tmp_path / "two", out, other, overwrite=True, surfaces="tar")
    assert labelled == list(open_library(out).meshes) == ["b.ply"]
    assert values(done) == values(label(tmp_path / "two", tmp_path / "c", other, surfaces="tar")[0])
    assert not list((out / "surfaces").rglob("*.ply"))


def test_parts_make_the_whole(tmp_path: Path) -> None:
    source, out = small_library(tmp_path / "in"), tmp_path / "out"
    one, first = label(source, out, part="1/2", surfaces="tar")
    assert list(one.meshes) == first == NAMES[::2]
    assert label(source, out, part="2/2")[1] == NAMES[1::2]
    whole, labelled = label(source, out)
    assert labelled == []
    assert values(whole) == values(label(source, tmp_path / "whole", surfaces="tar")[0])
    none, labelled = label(tmp_path / "in" / "a.ply", out, part="2/2")
    assert (none.rows(), none.meshes, labelled) == ([], {}, [])
    for part in ("0/2", "3/2", "1", "a/b", "1/2/3", "1/1"):
        with pytest.raises(SettingError, match=r"part must be I/N|a part overwrites nothing"):
            label(source, out, part=part, overwrite=True)


def test_surfaces_hold_the_same_labels_however_they_are_stored(tmp_path: Path) -> None:
    source = mesh(tmp_path / "in" / "deep" / "a.ply").parents[1]
    ply, tar, none = (label(source, tmp_path / k, surfaces=k)[0] for k in ("ply", "tar", "none"))
    one, two = ply.labels("deep/a.ply"), tar.labels("deep/a.ply")
    for name in ("label", "critical_angle", "margin", "partners"):
        np.testing.assert_array_equal(getattr(one, name), getattr(two, name))
    for library in (ply, tar, none):
        (row,) = library.table(["vertex_label", "vertex_margin"]).to_pylist()
        assert row["vertex_label"] == one.label.tolist()
        np.testing.assert_allclose(row["vertex_margin"], one.margin, rtol=1e-6)
    assert values(tar, "surface") == values(ply, "surface") == values(none, "surface")


TABLE = """\
path,name,scale,unit,mass,hand,table,up
egg.ply,,,,,,,
egg.ply,large,2,cm,,,,
egg.ply,held,,cm,0.5,franka,as-is,y
gone.ply,,,cm,,,,
"""


def test_a_table_has_settings_of_each_mesh(tmp_path: Path) -> None:
    path, out = mesh(tmp_path / "egg.ply", 2.0), tmp_path / "out"
    table = tmp_path / "objects.csv"
    table.write_text(TABLE, encoding="utf-8")
    done, labelled = label(table, out, force=True)
    rows = {row.mesh: row for row in done.rows()}
    assert labelled == sorted(rows) == ["egg.ply", "gone.ply", "held", "large"]
    assert rows["gone.ply"].outcome is Outcome.REFUSED
    assert "no such file" in rows["gone.ply"].error
    plain, large, held = (rows[name] for name in ("egg.ply", "large", "held"))
    assert (plain.unit, large.unit, large.file_unit) == (None, "m", "cm")
    assert (held.mass, held.gripper, plain.mass, plain.gripper) == (0.5, "franka", None, None)
    assert [one.size for one in (plain, large, held)] == pytest.approx([4.0, 0.08, 0.04])
    surface = load_mesh(path, scale=2.0, unit="cm", max_edge=10.0)
    scene = done.labels("held").scene
    assert scene is not None
    assert scene.table is not None
    np.testing.assert_allclose(scene.table.normal, [0.0, 1.0, 0.0], atol=1e-12)
    np.testing.assert_allclose(done.labels("large").mesh.vertices, surface.vertices, atol=1e-8)
    table.write_text(TABLE.replace("large,2", "large,3"), encoding="utf-8")
    mesh(tmp_path / "gone.ply")
    assert label(table, out, force=True)[1] == ["gone.ply", "large"]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("path,scale\nb.ply,1\negg.ply,0", "egg.ply: scale must be above 0; got 0"),
        ("path,unit\negg.ply,km", "egg.ply: no unit is called 'km'"),
        ("path\negg.ply\nb.ply\negg.ply", "row 3: names egg.ply a second time (first in row 1)"),
        ("path,name\negg.ply,b\nb.ply,b", "row 2: names b a second time"),
        ("path,weight\negg.ply,1", "no column is called 'weight'"),
        ("name\negg.ply", "has no column path"),
        ("path,name\negg.ply,a\n,b", "row 2: names no mesh file in its column path"),
        ("", "cannot be read"),
    ],
)
def test_a_bad_table_is_one_sentence(tmp_path: Path, text: str, message: str) -> None:
    mesh(tmp_path / "egg.ply")
    (tmp_path / "objects.csv").write_text(text, encoding="utf-8")
    with unchanged(tmp_path), pytest.raises(MeshError) as caught:
        label(tmp_path / "objects.csv", tmp_path / "out")
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_files_of_the_same_content_have_results_of_their_own(tmp_path: Path) -> None:
    for name, size in {"a": 1.7, "b": 1.7, "c": 1.8}.items():
        mesh(tmp_path / "in" / f"{name}.ply", size)
    done, _ = label(tmp_path / "in", tmp_path / "out", surfaces="tar")
    a, b, c = done.rows()
    assert (a.stable, a.content, a.size) == (b.stable, b.content, b.size)
    assert c.content != a.content
    assert done.labels("b.ply").mesh.size == a.size


def test_a_mesh_is_labelled_for_every_hand(tmp_path: Path) -> None:
    mesh(tmp_path / "in" / "egg.ply", 2.0)
    options, more = MeshOptions(unit="cm", max_edge=0.02), ParallelGripper.preset("wsg50")
    settings = [replace(QUICK, mesh=options, reach=ReachSettings(name, "as-is"))
                for name in ("franka", "wsg50")]  # fmt: skip
    both, _ = label(tmp_path / "in", tmp_path / "both", replace(settings[0], more_hands=(more,)))
    singles = [label(tmp_path / "in", tmp_path / str(number), one)[0]
               for number, one in enumerate(settings)]  # fmt: skip
    assert list(both.meshes) == ["franka/egg.ply", "wsg50/egg.ply"]
    apart = "mesh", "key", "surface"
    assert values(both, *apart) == [row for one in singles for row in values(one, *apart)]
    with pytest.raises(SettingError, match="further hands beside"):
        replace(QUICK, more_hands=(more,))
    table = tmp_path / "own.csv"
    table.write_text("path,hand\nin/egg.ply,franka", encoding="utf-8")
    with pytest.raises(MeshError, match="leave out more_hands"):
        label(table, tmp_path / "own", replace(settings[0], more_hands=(more,)))


def test_a_hand_whose_file_has_changed_is_another_hand(tmp_path: Path) -> None:
    mesh(tmp_path / "egg.ply", 2.0)
    file, table = tmp_path / "own.json", tmp_path / "objects.csv"
    table.write_text(f"path,unit,hand\negg.ply,cm,{file}", encoding="utf-8")
    for name, labelled in (("wsg50", ["egg.ply"]), ("wsg50", []), ("franka", ["egg.ply"])):
        write_hand(file, ParallelGripper.preset(name))
        assert label(table, tmp_path / "out")[1] == labelled


def test_a_file_of_the_same_name_from_another_folder_is_refused(tmp_path: Path) -> None:
    one = mesh(tmp_path / "one" / "mug.ply")
    two = mesh(tmp_path / "two" / "mug.ply", 2.0)
    label(one.parent, tmp_path / "out")
    with unchanged(tmp_path), pytest.raises(OutputError, match=r"has the name mug\.ply, by which"):
        label(two.parent, tmp_path / "out")
    both = label_library([one.parent, two.parent], tmp_path / "both", QUICK, cluster=HERE)
    assert list(both.meshes) == sorted(map(str, (one, two)))
    assert len({row.surface for row in both.rows()}) == 2


@pytest.mark.parametrize("whole", range(6))
def test_a_full_disk_is_one_sentence_and_is_resumed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, whole: int
) -> None:
    written = [0]

    def full(path: Path) -> Any:
        written[0] += 1
        if written[0] > whole:
            raise OSError(errno.ENOSPC, "No space left on device")
        return atomic_write(path)

    source, out = small_library(tmp_path / "in"), tmp_path / "out"
    monkeypatch.setattr(places, "atomic_write", full)
    with pytest.raises(OutputError, match=r"no space left; free some, or name another folder\)$"):
        label(source, out, surfaces="ply")
    monkeypatch.undo()
    label(source, out)
    assert values(open_library(out)) == values(label(source, tmp_path / "fresh")[0])


def test_damaged_chunks_are_labelled_again_but_not_those_that_cannot_be_read_now(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    source, out = small_library(tmp_path / "in"), tmp_path / "out"
    expected = values(label(source, out)[0])
    (chunk,) = (out / "labels").iterdir()
    data, opened = chunk.read_bytes(), Path.open

    def refused(path: Path, *arguments: Any, **options: Any) -> Any:
        if path.suffix == ".parquet":
            raise PermissionError(errno.EACCES, "Permission denied")
        return opened(path, *arguments, **options)

    with monkeypatch.context() as patch:
        patch.setattr(Path, "open", refused)
        with pytest.raises(OutputError, match=r"cannot be read \(Permission denied\)$"):
            label(source, out)
    assert chunk.read_bytes() == data
    for damaged in (data[: len(data) // 2], b"", bytes(len(data))):
        (chunk,) = (out / "labels").iterdir()
        chunk.write_bytes(damaged)
        with pytest.raises(OutputError, match=f"{chunk.name}: is damaged"):
            open_library(out)
        done, labelled = label(source, out)
        assert (labelled, values(done)) == (NAMES, expected)


def test_files_of_others_are_left_alone_and_results_are_no_inputs(tmp_path: Path) -> None:
    source = mesh(tmp_path / "in" / "a.ply").parent
    mine = mesh(tmp_path / "out" / "labels" / "mine.parquet.ply")
    with (
        unchanged(tmp_path),
        pytest.raises(OutputError, match="grasp3d batch did not write it; name an"),
    ):
        label(source, tmp_path / "out")
    label(source, tmp_path / "good")
    (tmp_path / "good" / "labels" / "all-mine.parquet").write_bytes(mine.read_bytes())
    with unchanged(tmp_path), pytest.raises(OutputError, match=r"all-mine\.parquet: is damaged"):
        label(source, tmp_path / "good")
    mesh(tmp_path / "mug.ply")
    label(tmp_path / "mug.ply", tmp_path / "first")
    with pytest.raises(MeshError, match=r"mug\.ply\.ply: is a result; it would be overwritten"):
        label(tmp_path / "first" / "surfaces" / "mug.ply.ply", tmp_path / "first")


def test_no_mesh_has_two_rows(tmp_path: Path) -> None:
    mesh(tmp_path / "egg.ply")
    (tmp_path / "t.csv").write_text("path\negg.ply\n", encoding="ascii")
    with pytest.raises(MeshError, match=r"egg\.ply: is given twice: in a table and by itself"):
        label_library([tmp_path / "t.csv", tmp_path / "egg.ply"], tmp_path / "both", QUICK)
