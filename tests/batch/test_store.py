import json
import math
import os
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import replace
from pathlib import Path

import fsspec
import polars as pl
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from grasp3d import GraspModel
from grasp3d.batch import store
from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.identity import METHOD, mesh_key
from grasp3d.batch.inputs import MeshFile
from grasp3d.batch.row import BestGrasp, Outcome, Row
from grasp3d.batch.storage.folder import Folder
from grasp3d.batch.store import FORMAT, Store, read_summary
from grasp3d.errors import OutputError

SETTINGS = BatchSettings(GraspModel(friction=0.4))
OTHER = BatchSettings(GraspModel(friction=0.5))


@pytest.fixture
def memory() -> Iterator[Folder]:
    system = fsspec.filesystem("memory")
    system.store.clear()
    system.pseudo_dirs[:] = [""]
    yield Folder("memory://out")
    system.store.clear()


def row_of(name: str, *, settings: BatchSettings = SETTINGS, content: str = "c") -> Row:
    number = sum(map(ord, name)) % 97 / 97.0
    pair = ((number, 0.5, -1e-30), (1.0, 2.0, 3.0))
    return Row(
        name, f"in/{name}", Outcome.LABELLED, bytes=7, stamp="7-1", content=content,
        key=mesh_key(content, settings), labels=f"labels/{name}.ply", vertices=12,
        center_mass=None if "open" in name else (0.1, 0.2, 0.3), stable=number, closed=True,
        critical_angle_p90=math.inf,
        grasps=(BestGrasp(0.1, 0.2, number, 4.0, pair, pair),) * int(10 * number), method=1,
    )  # fmt: skip


def mesh_of(row: Row) -> MeshFile:
    return MeshFile(row.mesh, row.source, 7, row.stamp)


def store_rows(output: Folder, rows: list[Row], settings: BatchSettings = SETTINGS) -> Store:
    """Run a batch that labels these meshes and ends."""
    store = Store.open(output, settings)
    store.begin([row.mesh for row in rows])
    for row in rows:
        if row.labels:
            output.write(row.labels, b"ply")
        store.add(row)
    store.close()
    return store


def kill(store: Store) -> None:
    """Release the lock of a store, as the system does when a process dies."""
    vars(store)["_lock"].close()


def summary_rows(output: Folder) -> list[str]:
    """All meshes in the summary, repeated if they have several rows."""
    return [
        mesh
        for name in output.names("summary")
        for mesh in pq.read_table(pa.BufferReader(output.read(name)), columns=["mesh"])[
            0
        ].to_pylist()
    ]


def test_rows_are_read_as_written(tmp_path: Path) -> None:
    output = Folder(str(tmp_path / "deep" / "out"))
    rows = [row_of(name) for name in ("b.stl", "a/open.obj", "c.ply")]
    rows.append(Row("lost.ply", outcome=Outcome.LOST, error="died"))
    store_rows(output, rows)
    read = read_summary(output.url)
    assert read == sorted(rows, key=lambda row: row.mesh)
    assert read.to_table()["mesh"].to_pylist() == [row.mesh for row in read]
    assert Store.open(output, SETTINGS).rows == {row.mesh: row for row in rows}
    assert output.names("journal") == []
    marker = json.loads(output.read("grasp3d.json"))
    assert (marker["format"], marker["settings"]["model"]["friction"]) == (FORMAT, 0.4)
    metadata = json.loads(pq.read_schema(tmp_path / "deep/out" / output.names("summary")[0])
                          .metadata[b"grasp3d"])  # fmt: skip
    assert metadata["model"]["friction"] == 0.4
    assert (metadata["epsilon_min"], metadata["epsilon_rank"]) == ("exact", 5)


def test_meshes_are_finished_where_nothing_has_changed(memory: Folder) -> None:
    names = ("same", "stamp", "source", "file", "empty", "lost", "settings", "none")
    rows = {name: row_of(name) for name in names}
    rows["lost"] = replace(rows["lost"], outcome=Outcome.LOST)
    rows["none"] = replace(rows["none"], stamp="")
    kept = store_rows(memory, list(rows.values()))
    memory.remove_all(["labels/file.ply"])
    memory.write("labels/empty.ply", b"")
    kept = Store.open(memory, SETTINGS)
    assert kept.finished(mesh_of(rows["same"])) == rows["same"]
    assert kept.known_content(mesh_of(rows["same"])) == "c"
    touched = replace(mesh_of(rows["stamp"]), stamp="7-2")
    moved = replace(mesh_of(rows["source"]), source="elsewhere")
    for mesh in (touched, moved, mesh_of(rows["none"])):
        assert (kept.finished(mesh), kept.known_content(mesh)) == (None, "c")
    for name in ("file", "empty", "lost"):
        assert (kept.finished(mesh_of(rows[name])), kept.known_content(mesh_of(rows[name]))) == (
            None,
            "",
        )
    assert kept.finished(MeshFile("new", "in/new", 7, "7-1")) is None
    other = Store.open(memory, OTHER)
    assert (other.finished(mesh_of(rows["same"])), other.known_content(mesh_of(rows["same"]))) == (
        None,
        "",
    )


def test_a_new_version_of_the_method_makes_all_rows_stale(
    memory: Folder, monkeypatch: pytest.MonkeyPatch
) -> None:
    store_rows(memory, [row_of("a")])
    monkeypatch.setattr("grasp3d.batch.identity.METHOD", METHOD + 1)
    assert Store.open(memory, SETTINGS).known_content(mesh_of(row_of("a"))) == ""


def test_rows_of_other_settings_are_labelled_again_or_refused(memory: Folder) -> None:
    store_rows(memory, [row_of("a"), row_of("b"), Row("lost", outcome=Outcome.LOST)])
    kept = Store.open(memory, OTHER)
    with pytest.raises(OutputError, match=r"made with other settings.*\(1, such as b\)"):
        kept.begin(["a", "new"])
    assert json.loads(memory.read("grasp3d.json"))["settings"]["model"]["friction"] == 0.4
    assert sorted(summary_rows(memory)) == ["a", "b", "lost"]
    kept.begin(["a", "b"])
    assert sorted(summary_rows(memory)) == ["a", "b", "lost"]  # until they are replaced
    assert kept.is_stale("a")
    assert json.loads(memory.read("grasp3d.json"))["settings"]["model"]["friction"] == 0.5
    kept.close()
    store_rows(memory, [row_of("a", settings=OTHER), row_of("b", settings=OTHER)], OTHER)
    forced = Store.open(memory, SETTINGS, overwrite=True)
    forced.begin(["a"])
    assert set(forced.rows) == {"a", "lost"}
    same = Store.open(memory, OTHER)
    same.begin(["c"])  # other inputs with the same settings: all rows stay
    assert set(same.rows) == {"a", "lost"}


def test_rows_of_the_same_content_stay_until_they_are_replaced(memory: Folder) -> None:
    first, second = row_of("a"), row_of("b")
    store_rows(memory, [first, second])
    kept = Store.open(memory, SETTINGS)
    kept.begin(["a", "b"])  # touched, so that a worker reads them
    assert sorted(summary_rows(memory)) == ["a", "b"]
    kept.add(replace(first, stamp="7-2"))
    memory.write(second.labels, b"another content, but its row was never added")
    again = Store.open(memory, SETTINGS)
    assert dict(again.rows) == {"a": replace(first, stamp="7-2")}
    assert summary_rows(memory) == ["a"]
    assert memory.names("journal") == []


class DeathError(Exception):
    """The process dies here."""


class Mortal(Folder):
    """A folder whose writer dies after some changes, and that checks the summary."""

    changes_left: list[int]

    def _count_change(self) -> None:
        self.changes_left[0] -= 1
        if self.changes_left[0] < 0:
            raise DeathError

    def write(self, name: str, data: bytes) -> None:
        self._count_change()
        super().write(name, data)
        meshes = summary_rows(self)
        assert len(set(meshes)) == len(meshes)

    def remove_all(self, names: Iterable[str]) -> None:
        for name in list(names):
            self._count_change()
            super().remove_all([name])


def mortal(output: Folder, changes: int) -> Mortal:
    made = Mortal(output.url)
    object.__setattr__(made, "changes_left", [changes])
    return made


def run_again(output: Folder, added: list[Row]) -> None:
    """A second run: a row of the same content, one to be labelled again, and three new ones."""
    kept = Store.open(output, SETTINGS)
    kept.begin(["a0", "b0", "c0", "c1", "c2"])
    for name in ("c0", "a0", "b0", "c1", "c2"):
        row = replace(row_of(name, content="new" if name == "b0" else "c"), stamp="7-2", labels="")
        added.append(row)
        kept.add(row)
    kept.close()


@pytest.mark.slow
def test_a_death_at_any_change_neither_loses_nor_duplicates_rows(
    memory: Folder, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store, "MERGE_ROWS", 2)
    monkeypatch.setattr(store, "MAX_ROWS", 2)
    names = ("a0", "a1", "b0", "b1", "lost")
    before = {name: replace(row_of(name), labels="") for name in names}
    before["b0"] = replace(before["b0"], outcome=Outcome.LOST)
    dead, changes = True, 0
    while dead:
        fsspec.filesystem("memory").store.clear()
        store_rows(memory, list(before.values()))
        added: list[Row] = []
        try:
            run_again(mortal(memory, changes), added)
            dead = False
        except DeathError:
            pass
        for more in range(changes % 5):  # recovery dies as well
            with suppress(DeathError):
                Store.open(mortal(memory, more), SETTINGS)
        kept = Store.open(memory, SETTINGS)
        sure = {row.mesh: row for row in (added[:-1] if dead else added)}
        unsure = {row.mesh: row for row in added[-1:]}
        for name, row in (before | sure).items():
            if name not in {"b0", *unsure}:
                assert kept.rows[name] == row
        for name, row in unsure.items():
            assert kept.rows.get(name) in {row, before.get(name)}
        assert kept.rows.get("b0") in {None, before["b0"], sure.get("b0"), unsure.get("b0")}
        assert sorted(summary_rows(memory)) == sorted(kept.rows)
        assert (kept.warnings, memory.names("journal")) == ([], [])
        changes += 1
    assert changes > 15


@pytest.mark.slow
def test_small_shards_are_merged(memory: Folder) -> None:
    names = [f"m{k:02d}" for k in range(store.MAX_SMALL + 1)]
    for name in names:
        store_rows(memory, [replace(row_of(name), labels="")])
    assert len(memory.names("summary")) == len(names)
    assert sorted(Store.open(memory, SETTINGS).rows) == names
    assert len(memory.names("summary")) == 1
    assert sorted(summary_rows(memory)) == names


def test_rows_of_two_runs_at_once_are_unique_after_the_next_run(memory: Folder) -> None:
    one, two = (Store.open(memory, SETTINGS) for _ in "ab")
    for kept, stamp in ((one, "7-1"), (two, "7-2")):
        kept.begin(["a", "b"])
        kept.add(replace(row_of("a"), stamp=stamp))
        kept.add(row_of(f"b{stamp}"))
    one.close()
    two.close()
    assert sorted(summary_rows(memory)).count("a") == 2
    again = Store.open(memory, SETTINGS)
    assert sorted(summary_rows(memory)) == sorted(again.rows) == ["a", "b7-1", "b7-2"]


@pytest.mark.parametrize("damage", ["cut", "zeros", "text", "other", "empty", "bit"])
def test_damaged_files_are_moved_with_a_warning(tmp_path: Path, damage: str) -> None:
    output = Folder(str(tmp_path))
    store_rows(output, [row_of("a")])
    running = Store.open(output, SETTINGS)
    running.begin(["b", "c"])
    running.add(row_of("b"))
    running.add(row_of("c"))
    entry, summary = output.names("journal")[0], output.names("summary")[0]
    for name in (entry, summary, "grasp3d.json"):
        data = output.read(name)
        middle, value = len(data) // 2, data.find(b"labels/")
        bad = {
            "cut": data[:middle], "zeros": bytes(len(data)), "text": b"prose", "other": b"[]",
            "empty": b"", "bit": data[:value] + bytes([data[value] ^ 255]) + data[value + 1 :],
        }[damage]  # fmt: skip
        (tmp_path / name).write_bytes(bad)
        if name == "grasp3d.json" and damage == "bit":
            (tmp_path / name).write_bytes(data)
    kill(running)
    kept = Store.open(output, SETTINGS)
    assert len(kept.warnings) == 3 - (damage == "bit")
    assert all("is damaged, moved to damaged/" in warning for warning in kept.warnings)
    assert len(output.names("damaged")) == len(kept.warnings)
    assert set(kept.rows) == {"c"}
    assert kept.finished(mesh_of(row_of("a"))) is None
    kill(kept)
    assert Store.open(output, SETTINGS).warnings == []


def test_folders_that_are_not_stores_are_refused(tmp_path: Path) -> None:
    output = Folder(str(tmp_path))
    with pytest.raises(OutputError, match="is not a folder that grasp3d batch wrote"):
        read_summary(output.url)
    (tmp_path / "mug.stl").write_bytes(b"mesh")
    store_rows(output, [row_of("a")])
    (tmp_path / "grasp3d.json").unlink()
    assert set(Store.open(output, SETTINGS).rows) == {"a"}  # the summary was written by grasp3d
    for number, age in ((FORMAT - 1, "an older"), (FORMAT + 1, "a newer")):
        marker = json.dumps({"format": number, "version": "9.9"})
        (tmp_path / "grasp3d.json").write_text(marker, encoding="ascii")
        with pytest.raises(OutputError, match=rf"a store of {age} version of grasp3d \(9.9\)"):
            Store.open(output, SETTINGS)
    (tmp_path / "grasp3d.json").unlink()
    pl.DataFrame({"a": [1]}).write_parquet(tmp_path / "summary" / "part-00009.parquet")
    shutil.rmtree(tmp_path / "labels")
    with pytest.raises(OutputError, match="contains a folder summary that grasp3d has not written"):
        Store.open(output, SETTINGS)
    assert (tmp_path / "mug.stl").read_bytes() == b"mesh"


LIMITED = """
import resource, sys
from dataclasses import replace
from tests.batch.test_store import *
kept = Store.open(Folder(sys.argv[1]), SETTINGS)
resource.setrlimit(resource.RLIMIT_FSIZE, (9000, 9000))
kept.begin([])
for number in range(40):
    kept.add(replace(row_of(f"m{number}"), labels=""))
try: kept.close()
except OutputError as error: print("error:", error)
"""


@pytest.mark.slow
def test_a_file_that_grows_too_large_is_an_error_without_losing_rows(tmp_path: Path) -> None:
    run = subprocess.run([sys.executable, "-c", LIMITED, tmp_path], check=False, text=True,
                         capture_output=True, cwd=Path(__file__).parents[2])  # fmt: skip
    assert "error: " in run.stdout, run.stderr
    assert "cannot be written (File too large)" in run.stdout
    assert len(Store.open(Folder(str(tmp_path)), SETTINGS).rows) == 40


def test_old_unfinished_files_are_removed(tmp_path: Path) -> None:
    old, young = tmp_path / ".grasp3d-old.part", tmp_path / ".grasp3d-young.part"
    for path in (old, young):
        path.write_bytes(b"half")
    os.utime(old, (1.0, 1.0))
    assert Folder(str(tmp_path)).names() == []
    Store.open(Folder(str(tmp_path)), SETTINGS)
    assert (old.exists(), young.exists()) == (False, True)


def test_a_folder_has_one_run_at_a_time(tmp_path: Path) -> None:
    running = Store.open(Folder(str(tmp_path)), SETTINGS)
    with pytest.raises(OutputError, match="another run is writing to it"):
        Store.open(Folder(str(tmp_path)), SETTINGS)
    running.close()
    Store.open(Folder(str(tmp_path)), SETTINGS).close()


def test_an_interruption_while_overwriting_removes_the_old_row(tmp_path: Path) -> None:
    output = Folder(str(tmp_path))
    store_rows(output, [row_of("a"), row_of("b")])
    kept = Store.open(output, SETTINGS)
    kept.begin(["a", "b"])  # touched, their content may be the same
    output.write(row_of("a").labels, b"labels of another a")
    kept.close()  # without a row for either
    assert set(Store.open(output, SETTINGS).rows) == {"b"}
    assert output.names("labels") == ["labels/b.ply"]


def test_results_are_removed_with_their_rows(tmp_path: Path) -> None:
    output = Folder(str(tmp_path))
    store_rows(output, [row_of("a"), row_of("b")]).close()
    kept = Store.open(output, SETTINGS)
    kept.begin(["a"])
    kept.add(Row("a", outcome=Outcome.REFUSED, content="x", key=mesh_key("x", SETTINGS)))
    assert output.names("labels") == ["labels/b.ply"]
    kept.close()
    forced = Store.open(output, OTHER, overwrite=True)
    forced.begin(["a"])
    assert output.names("labels") == []


@pytest.mark.slow
def test_a_new_row_survives_two_deaths_while_small_shards_are_merged(
    memory: Folder, monkeypatch: pytest.MonkeyPatch
) -> None:
    for run in range(17):
        store_rows(memory, [row_of(f"m{run}")])
    kept = Store.open(memory, SETTINGS)
    kept.begin(["m0"])
    kept.add(replace(row_of("m0"), stable=0.123))
    for _ in range(2):  # dies after writing its journal entry
        with monkeypatch.context() as patched:
            patched.setattr(Store, "_merge_journal", lambda _: 1 / 0)
            with pytest.raises(ZeroDivisionError):
                Store.open(memory, SETTINGS)
        assert {row.mesh: row.stable for row in read_summary(memory.url)}["m0"] == 0.123
    assert Store.open(memory, SETTINGS).rows["m0"].stable == 0.123
