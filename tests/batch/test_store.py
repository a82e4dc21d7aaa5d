import json
import math
import os
import shutil
import subprocess
import sys
from collections.abc import Iterable, Iterator
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
from grasp3d.batch.store import Store, read_summary
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
    store = Store(output, settings)
    store.begin([row.mesh for row in rows])
    for row in rows:
        if row.labels:
            output.write(row.labels, b"ply")
        store.add(row)
    store.close()
    return store


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
    assert Store(output, SETTINGS).rows == {row.mesh: row for row in rows}
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
    kept = Store(memory, SETTINGS)
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
    other = Store(memory, OTHER)
    assert (other.finished(mesh_of(rows["same"])), other.known_content(mesh_of(rows["same"]))) == (
        None,
        "",
    )


def test_a_new_version_of_the_method_makes_all_rows_stale(
    memory: Folder, monkeypatch: pytest.MonkeyPatch
) -> None:
    store_rows(memory, [row_of("a")])
    monkeypatch.setattr("grasp3d.batch.identity.METHOD", METHOD + 1)
    assert Store(memory, SETTINGS).known_content(mesh_of(row_of("a"))) == ""


def test_rows_of_other_settings_are_removed_or_refused(memory: Folder) -> None:
    store_rows(memory, [row_of("a"), row_of("b"), Row("lost", outcome=Outcome.LOST)])
    kept = Store(memory, OTHER)
    with pytest.raises(OutputError, match=r"made with other settings.*\(1, such as b\)"):
        kept.begin(["a", "new"])
    assert sorted(summary_rows(memory)) == ["a", "b", "lost"]
    assert kept.begin(["a", "b"]) == 2
    assert summary_rows(memory) == ["lost"]
    assert memory.names("labels") == []
    store_rows(memory, [row_of("a", settings=OTHER), row_of("b", settings=OTHER)], OTHER)
    forced = Store(memory, SETTINGS, overwrite=True)
    assert forced.begin(["a"]) == 1
    assert set(forced.rows) == {"lost"}
    store_rows(memory, [row_of("a")])
    same = Store(memory, SETTINGS)
    assert same.begin(["c"]) == 0  # other inputs with the same settings: all rows stay
    assert set(same.rows) == {"a", "lost"}


def test_rows_of_the_same_content_stay_until_they_are_replaced(memory: Folder) -> None:
    first, second = row_of("a"), row_of("b")
    store_rows(memory, [first, second])
    kept = Store(memory, SETTINGS)
    kept.begin(["a", "b"])  # touched, so that a worker reads them
    assert sorted(summary_rows(memory)) == ["a", "b"]
    kept.add(replace(first, stamp="7-2"))
    kept.close()
    again = Store(memory, SETTINGS)
    assert dict(again.rows) == {"a": replace(first, stamp="7-2"), "b": second}
    assert summary_rows(memory) == ["a", "b"]


def test_rows_are_on_disk_after_some_seconds(
    memory: Folder, monkeypatch: pytest.MonkeyPatch
) -> None:
    kept = Store(memory, SETTINGS)
    kept.add(row_of("a"))
    assert summary_rows(memory) == []
    monkeypatch.setattr(store, "WRITE_SECONDS", 0.0)
    kept.add(row_of("b"))
    assert sorted(summary_rows(memory)) == ["a", "b"]


class DeathError(Exception):
    """The process dies here."""


class Mortal(Folder):
    """A folder whose writer dies after some changes."""

    changes_left: list[int]

    def _count_change(self) -> None:
        self.changes_left[0] -= 1
        if self.changes_left[0] < 0:
            raise DeathError

    def write(self, name: str, data: bytes) -> None:
        self._count_change()
        super().write(name, data)

    def remove_all(self, names: Iterable[str]) -> None:
        for name in list(names):
            self._count_change()
            super().remove_all([name])


def mortal(output: Folder, changes: int) -> Mortal:
    made = Mortal(output.url)
    object.__setattr__(made, "changes_left", [changes])
    return made


def test_a_death_at_any_change_loses_no_row_that_was_written(
    memory: Folder, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(store, "WRITE_SECONDS", 0.0)
    monkeypatch.setattr(store, "MAX_ROWS", 2)
    before = {name: replace(row_of(name), labels="") for name in ("a0", "a1", "b0", "b1", "lost")}
    stale = replace(row_of("old", settings=OTHER), labels="")
    dead, changes = True, 0
    while dead:
        fsspec.filesystem("memory").store.clear()
        store_rows(memory, [*before.values(), stale])
        added: list[Row] = []
        try:
            kept = Store(mortal(memory, changes), SETTINGS)
            kept.begin(["a0", "old", "c0", "c1", "c2"])
            for name in ("c0", "a0", "c1", "old", "c2"):
                added.append(replace(row_of(name), stamp="7-2", labels=""))
                kept.add(added[-1])
            kept.close()
            dead = False
        except DeathError:
            pass
        found = {row.mesh: row for row in read_summary(memory.url)}
        sure = {row.mesh: row for row in (added[:-1] if dead else added)}
        unsure = {row.mesh: row for row in added[-1:]}
        for name, row in (before | sure).items():
            assert found[name] in {row, unsure.get(name)}
        assert found.get("old") in {stale, None, sure.get("old"), unsure.get("old")}
        Store(memory, SETTINGS).begin(["old"])
        again = Store(memory, SETTINGS)
        again.close()
        assert sorted(summary_rows(memory)) == sorted(again.rows)  # each mesh once
        assert stale not in again.rows.values()
        changes += 1
    assert changes > 10


def test_many_small_files_are_joined(memory: Folder, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store, "WRITE_SECONDS", 0.0)
    monkeypatch.setattr(store, "MAX_ROWS", 4)
    kept, names = Store(memory, SETTINGS), [f"m{k:02d}" for k in range(20)]
    for name in names:
        kept.add(row_of(name))
    assert len(memory.names("summary")) == 21
    kept.close()
    assert len(memory.names("summary")) == 5
    assert sorted(Store(memory, SETTINGS).rows) == sorted(summary_rows(memory)) == names


@pytest.mark.parametrize("damage", ["cut", "zeros", "text", "empty", "bit"])
def test_damaged_files_are_refused_with_a_remedy(tmp_path: Path, damage: str) -> None:
    output = Folder(str(tmp_path))
    for mesh in "ab":
        store_rows(output, [row_of(mesh)])
    name = output.names("summary")[-1]
    data = output.read(name)
    middle, value = len(data) // 2, data.find(b"labels/")
    bad = {
        "cut": data[:middle], "zeros": bytes(len(data)), "text": b"prose", "empty": b"",
        "bit": data[:value] + bytes([data[value] ^ 255]) + data[value + 1 :],
    }[damage]  # fmt: skip
    (tmp_path / name).write_bytes(bad)
    for read in (lambda: Store(output, SETTINGS), lambda: read_summary(output.url)):
        with pytest.raises(OutputError, match=r"part-\d+.parquet: is damaged, .*; remove it"):
            read()
    (tmp_path / name).unlink()
    assert set(Store(output, SETTINGS).rows) == {"a"}


def test_folders_that_are_not_stores_are_refused(tmp_path: Path) -> None:
    output = Folder(str(tmp_path))
    with pytest.raises(OutputError, match="was not written by grasp3d batch"):
        read_summary(output.url)
    (tmp_path / "mug.stl").write_bytes(b"mesh")
    store_rows(output, [row_of("a")])
    for path in (tmp_path / "summary").iterdir():
        path.unlink()
    with pytest.raises(OutputError, match="contains a folder labels that grasp3d has not written"):
        Store(output, SETTINGS)
    shutil.rmtree(tmp_path / "labels")
    pl.DataFrame({"a": [1]}).write_parquet(tmp_path / "summary" / "part-00009.parquet")
    with pytest.raises(OutputError, match="not written by grasp3d batch"):
        Store(output, SETTINGS)
    assert (tmp_path / "mug.stl").read_bytes() == b"mesh"


LIMITED = """
import resource, sys
from dataclasses import replace
from tests.batch.test_store import *
store.WRITE_SECONDS = 0.0
kept = Store(Folder(sys.argv[1]), SETTINGS)
kept.begin([])
for number in range(40):
    kept.add(replace(row_of(f"m{number}"), labels=""))
resource.setrlimit(resource.RLIMIT_FSIZE, (9000, 9000))
try: kept.close()
except OutputError as error: print("error:", error)
"""


@pytest.mark.slow
def test_a_file_that_grows_too_large_is_an_error_without_losing_rows(tmp_path: Path) -> None:
    run = subprocess.run([sys.executable, "-c", LIMITED, tmp_path], check=False, text=True,
                         capture_output=True, cwd=Path(__file__).parents[2])  # fmt: skip
    assert "error: " in run.stdout, run.stderr
    assert "cannot be written (File too large)" in run.stdout
    assert len(Store(Folder(str(tmp_path)), SETTINGS).rows) == 40


def test_old_unfinished_files_are_removed(tmp_path: Path) -> None:
    old, young = tmp_path / ".grasp3d-old.part", tmp_path / ".grasp3d-young.part"
    for path in (old, young):
        path.write_bytes(b"half")
    os.utime(old, (1.0, 1.0))
    assert Folder(str(tmp_path)).names() == []
    Store(Folder(str(tmp_path)), SETTINGS)
    assert (old.exists(), young.exists()) == (False, True)


def test_a_folder_has_one_run_at_a_time(tmp_path: Path) -> None:
    running = Store(Folder(str(tmp_path)), SETTINGS)
    with pytest.raises(OutputError, match="another run is writing to it"):
        Store(Folder(str(tmp_path)), SETTINGS)
    running.close()
    Store(Folder(str(tmp_path)), SETTINGS).close()


def test_results_are_removed_with_their_rows(tmp_path: Path) -> None:
    output = Folder(str(tmp_path))
    store_rows(output, [row_of("a"), row_of("b")]).close()
    kept = Store(output, SETTINGS)
    kept.begin(["a"])
    kept.add(Row("a", outcome=Outcome.REFUSED, content="x", key=mesh_key("x", SETTINGS)))
    assert output.names("labels") == ["labels/b.ply"]
    kept.close()
    forced = Store(output, OTHER, overwrite=True)
    forced.begin(["a"])
    assert output.names("labels") == []
