"""Chunks: whatever is written, merged and killed, a library has the last row of each mesh."""

import json
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
from hypothesis import example, given, settings
from hypothesis import strategies as st
from upath import UPath

from grasp3d.batch import chunks, open_library
from grasp3d.batch.chunks import ChunkWriter, LabelledMesh
from grasp3d.batch.row import Outcome, Row
from grasp3d.errors import GraspError, OutputError
from grasp3d.system.places import place, writing

HEAD = {"version": "0.1.0", "settings": {}}
KINDS = {"ply": "surfaces/{}.ply", "tar": "{}.npz", "none": ""}


def labelled(mesh: str, version: int, kind: str) -> LabelledMesh:
    """All that is stored of a mesh; its row and its surface have the version."""
    row = Row(mesh, content=str(version), surface=KINDS[kind].format(mesh))
    vertices = {"label": np.arange(version), "margin": np.full(version, -np.inf)}
    surface = b"" if kind == "none" else f"{mesh} {version}".encode()
    return LabelledMesh(row, vertices, {f"report/{mesh}.html": b"page"}, surface)


class KilledError(BaseException):
    """The process is killed here."""


@contextmanager
def killed_after(changes: int) -> Iterator[None]:
    """Kill what runs inside after so many changes of files; 0: never."""
    left, kind = [changes], type(place("memory://"))
    unlink = kind.unlink

    def change() -> None:
        left[0] -= 1
        if left[0] == 0:
            raise KilledError

    @contextmanager
    def mortal_writing(target: UPath) -> Iterator[Path]:
        with writing(target) as part:
            yield part
        change()

    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(chunks, "writing", mortal_writing)
        patch.setattr(kind, "unlink", lambda path, **_: (unlink(path), change()))
        yield


STEPS = st.lists(st.sampled_from(["a", "b", "c", "d", "write", "merge"]), max_size=10)
RUNS = st.lists(st.tuples(STEPS, st.sampled_from(["all", "1of2"]), st.integers(0, 9)), max_size=4)


def opened(folder: str) -> dict[str, int]:
    """Versions of the meshes of a library, which has each of them once."""
    if not chunks.current(place(folder)).chunks:
        return {}
    table = open_library(folder).table(["mesh", "content", "vertex_label"]).to_pylist()
    found = {row["mesh"]: int(row["content"]) for row in table}
    assert [row["mesh"] for row in table] == sorted(found)
    assert all(len(row["vertex_label"]) == int(row["content"]) for row in table)
    return found


@pytest.mark.slow
@settings(max_examples=100, deadline=None)
@example(
    runs=[(["a", "write"], "all", 0), (["a", "write"], "1of2", 0),
          (["b", "write", "merge"], "all", 0)],
    kind="tar",
)  # fmt: skip
@given(runs=RUNS, kind=st.sampled_from(sorted(KINDS)))
def test_a_library_has_the_last_row_of_each_mesh_whatever_kills_its_runs(
    runs: list[tuple[list[str], str, int]], kind: str
) -> None:
    folder, version = "memory://library", 0
    place(folder).fs.store.clear()
    sure: dict[str, int] = {}
    for steps, prefix, changes in runs:
        waiting: dict[str, int] = {}
        with suppress(KilledError), killed_after(changes):
            writer = ChunkWriter(place(folder), prefix, HEAD, 3)
            for step in steps:
                version += 1
                if step == "merge" and not writer.waits:
                    writer.merge()
                elif step in {"write", "merge"} or step in waiting:
                    writer.write()
                else:
                    waiting[step] = version
                    writer.add(labelled(step, version, kind))
                if not writer.waits:
                    sure, waiting = sure | waiting, {}
        found = opened(folder)
        assert {*sure} <= {*found} <= {*sure, *waiting}
        assert all(found[mesh] in {sure.get(mesh), waiting.get(mesh)} for mesh in found)
        for mesh in found if kind != "none" else ():
            with pytest.MonkeyPatch.context() as patch:
                patch.setattr("grasp3d.formats.read_labels", lambda path, **_: path.read_bytes())
                surface: Any = open_library(folder).labels(mesh)
            name, there = surface.decode().split()
            assert name == mesh
            newer = kind == "ply" and int(there) > found[mesh]  # it is written before its row
            assert newer or int(there) == found[mesh]
        sure = found


def written(folder: Path, *meshes: str, kind: str = "tar", head: Any = HEAD) -> Path:
    """A folder with a chunk of some meshes."""
    writer = ChunkWriter(place(str(folder)), "all", head, 64)
    for number, mesh in enumerate(meshes):
        writer.add(labelled(mesh, number + 1, kind))
    writer.write()
    return folder


@settings(max_examples=60, deadline=None)
@given(data=st.data(), suffix=st.sampled_from([".parquet", ".tar"]))
def test_a_file_that_is_cut_anywhere_is_named(data: st.DataObject, suffix: str) -> None:
    with TemporaryDirectory() as folder:
        written(Path(folder), "a", "b")
        (file,) = Path(folder).rglob(f"*{suffix}")
        whole = file.read_bytes()
        content = whole.rstrip(b"\0")
        file.write_bytes(whole[: data.draw(st.integers(0, len(content) - 1))])
        with pytest.raises(GraspError, match=rf"all-00000{suffix}(: is damaged|$)"):
            open_library(folder).labels("b")


def test_rows_are_read_as_written(tmp_path: Path) -> None:
    row = replace(
        labelled("open.ply", 1, "tar").row, center_mass=(0.1, 0.2, 0.3), critical_angle_p90=np.inf,
        outcome=Outcome.REFUSED, holds=None, closed=True,
    )  # fmt: skip
    ChunkWriter(place(str(tmp_path)), "all", HEAD, 1).add(LabelledMesh(row, {}, {}))
    library = open_library(tmp_path)
    assert library.rows() == [row]
    assert library.rows(["mesh", "closed"]) == [Row("open.ply", closed=True)]
    none = open_library(written(tmp_path / "none", "a", kind="none"))
    for read, name, message in (
        (library.table, ["weight"], "has no column weight"),
        (library.labels, "other.ply", r"other\.ply is not in this library"),
        (library.labels, "open.ply", "its surface is missing from all-00000"),
        (none.labels, "a", "no surface here; label it with --surfaces ply"),
    ):
        with pytest.raises(GraspError, match=message):
            read(name)


def test_a_newer_format_and_other_files_are_refused(tmp_path: Path) -> None:
    written(tmp_path / "new", "a", head={**HEAD, "version": "9.9"})
    written(tmp_path / "mixed", "a")
    (tmp_path / "mixed" / "labels" / ".grasp3d-1.part.parquet").touch()  # a killed process left it
    assert [*open_library(tmp_path / "mixed").meshes] == ["a"]
    pq.write_table(pa.table({"a": [1]}), tmp_path / "mixed" / "labels" / "mine.parquet")
    for folder, message in {
        "new": r"by grasp3d 9\.9, which is newer than this one",
        "mixed": r"mine\.parquet: is damaged.*; remove it$",
        ".": "was not written by grasp3d batch; label the meshes",
    }.items():
        with pytest.raises(OutputError, match=message):
            open_library(tmp_path / folder)


def test_a_chunk_says_what_is_in_it(tmp_path: Path) -> None:
    schema = pq.read_schema(written(tmp_path, "a") / "labels" / "all-00000.parquet")
    assert json.loads(schema.metadata[b"grasp3d"])["version"] == HEAD["version"]
    assert {"mesh", "vertex_label", "vertex_margin", "vertex_critical_angle"} < {*schema.names}
    units = {"critical_angle_p10": b"rad", "payload_p50": b"kg", "held": b"",
             "area": "unit²".encode(), "vertex_margin": b"rad"}  # fmt: skip
    assert {name: schema.field(name).metadata[b"unit"] for name in units} == units
    for field in schema:
        assert field.metadata[b"meaning"]
