"""Input meshes: folders, patterns and addresses; tables are tested with libraries."""

import os
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path
from typing import Any

import fsspec
import pytest
import trimesh

from grasp3d import open_library
from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.inputs import find_meshes, local_copy
from grasp3d.batch.labelling import content_hash
from grasp3d.batch.library import BatchProgress, label_library
from grasp3d.cli.check import check_file
from grasp3d.errors import MeshError
from grasp3d.jobs import ClusterSettings
from grasp3d.system.places import place, writing
from tests.helpers import shapes
from tests.helpers.buckets import bucket


def touch(folder: Path, *names: str) -> None:
    for name in names:
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(b"mesh")


def names_of(*inputs: Path | str, results: Path | None = None) -> list[str]:
    folder = None if results is None else str(results)
    return [mesh.name for mesh in find_meshes(map(str, inputs), results=folder)]


def test_a_folder_is_searched_and_each_real_file_counts_once(tmp_path: Path) -> None:
    touch(tmp_path, "lib/b.STL", "lib/deep/er/a.obj", "lib/notes.txt", "lib/._a.obj", "far/c.ply",
          "lib/old_labeled.ply", "lib/.git/d.off")  # fmt: skip
    lib = tmp_path / "lib"
    (lib / "folder.stl").mkdir()
    for name, target in {"link.ply": f"{tmp_path}/far/c.ply", "again.obj": "deep/er/a.obj",
                         "dead.stl": "nowhere", "around": str(lib)}.items():  # fmt: skip
        (lib / name).symlink_to(target)
    found = names_of(lib, lib / "b.STL", lib / "deep")
    first = [".git/d.off", "again.obj", "b.STL", "link.ply"]
    assert found in (first, sorted({*first, "deep/er/a.obj"} - {"again.obj"}))
    assert names_of(lib / "old_labeled.ply") == ["old_labeled.ply"]
    touch(tmp_path, "a/mug.stl", "b/mug.stl", "b/cup.stl")
    one, two = tmp_path / "a", tmp_path / "b"
    assert names_of(one, two) == [f"{one}/mug.stl", f"{two}/mug.stl", "cup.stl"]


def test_results_are_not_inputs(tmp_path: Path) -> None:
    touch(tmp_path, "lib/a.stl", "lib/out/surfaces/a.ply", "lib/surfaces/b.ply")
    lib = tmp_path / "lib"
    assert names_of(lib, results=lib / "out") == ["a.stl", "surfaces/b.ply"]
    assert names_of(lib / "**" / "*.ply", results=lib / "out") == ["surfaces/b.ply"]
    assert len(names_of(lib, results=lib)) == 3
    other = tmp_path / "other"
    touch(other, "a.stl", "out/surfaces/a.ply", "out/labels/all-0.parquet", "surfaces/b.ply")
    assert names_of(other) == ["a.stl", "surfaces/b.ply"]


def test_patterns_name_files_but_existing_files_take_precedence(tmp_path: Path) -> None:
    touch(tmp_path, "lib/a.stl", "lib/a.txt", "lib/x/b.stl", "lib/x/y/c.stl", "lib/x/[ab].stl",
          "lib/x/.d.stl")  # fmt: skip
    for pattern, names in {
        "lib/*.stl": ["a.stl"], "lib/*": ["a.stl"], "lib/*/?.stl": ["x/b.stl"],
        "lib/x/[ab].stl": ["[ab].stl"], "lib/x/[bc].stl": ["b.stl"],
        "l*/**/*.stl": ["lib/a.stl", "lib/x/[ab].stl", "lib/x/b.stl", "lib/x/y/c.stl"],
    }.items():  # fmt: skip
        assert names_of(tmp_path / pattern) == names
    (tmp_path / "void").mkdir()
    for name, message in {
        "lib/*.off": r"a pattern names mesh files, such as lib/\*\*/\*\.stl",
        "gone/*.off": "there is no such folder", "lib/a.txt/b.stl": "there is no such file",
        "void": r"void: no mesh in it; files named .*\.stl", "lib/a.csv": "there is no such file",
    }.items():  # fmt: skip
        with pytest.raises(MeshError, match=message):
            names_of(tmp_path / name)


def test_stamps_change_when_a_file_changes(tmp_path: Path) -> None:
    touch(tmp_path, "a.stl", "b.gltf")
    before = stl, gltf = find_meshes([str(tmp_path)])
    assert (stl.size, gltf.stamp, find_meshes([str(tmp_path)])) == (4, "", [*before])
    os.utime(tmp_path / "a.stl", ns=(1, 1))
    assert find_meshes([str(tmp_path)])[0].stamp not in {stl.stamp, ""}


@pytest.fixture(params=["local", "file", "memory", "s3"])
def folder(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[str]:
    """The address of a folder on each kind of file system."""
    if request.param == "s3":
        with bucket() as address:
            yield f"{address}/folder"
        return
    addresses = {"local": f"{tmp_path}/out", "file": f"file://{tmp_path}/out"}
    yield addresses.get(request.param, "memory://out")
    fsspec.filesystem("memory").store.clear()


@pytest.mark.slow
def test_every_file_system_has_meshes_and_results(folder: str, tmp_path: Path) -> None:
    box = trimesh.Trimesh(*shapes.box((0.04, 0.06, 0.08)), process=False)
    files: dict[str, Any] = {"box.stl": box.export(file_type="stl"), "bad.stl": b"no mesh at all",
             "list.csv": b"path,scale\ndeep/box.gltf,2\ndeep/box.stl,\n"}  # fmt: skip
    for name, data in trimesh.exchange.gltf.export_gltf(box.scene()).items():
        files[name.replace("model.gltf", "box.gltf")] = data
    for name, data in files.items():
        (tmp_path / name).write_bytes(data)
        for _ in "ab":  # replaced as well
            with writing(place(folder) / "lib" / ("" if "csv" in name else "deep") / name) as part:
                part.write_bytes(data)
    bad, gltf, stl = find_meshes([f"{folder}/lib"])
    assert [mesh.name for mesh in (bad, gltf, stl)] == ["deep/bad.stl", "deep/box.gltf",
                                                       "deep/box.stl"]  # fmt: skip
    assert names_of(f"{folder}/lib/**/b*.stl") == ["deep/bad.stl", "deep/box.stl"]
    assert names_of(stl.source) == ["box.stl"]
    assert (bool(stl.stamp), gltf.stamp, stl.size) == (True, "", 684)
    with local_copy(gltf.source) as copy:
        assert (copy.name, content_hash(copy)) == ("box.gltf", content_hash(tmp_path / "box.gltf"))
    assert copy.exists() == isinstance(place(folder), Path)
    assert check_file(stl, BatchSettings()).before.faces == 12
    with pytest.raises(MeshError) as caught:
        check_file(bad, BatchSettings())
    assert str(caught.value).startswith(f"{bad.source}: cannot be read as STL")
    settings = BatchSettings(mesh={"max_edge": 1.0}, best=0)  # type: ignore[arg-type]
    states: list[BatchProgress] = []
    for _ in "ab":  # labelled, and resumed
        done = label_library(
            [f"{folder}/lib/list.csv"], f"{folder}/out", settings, report=False, surfaces="tar",
            cluster=ClusterSettings(workers=0), progress=states.append, force=True,
        )  # fmt: skip
    assert [one.left for one in states] == [2, 1, 0, 0]
    assert done.rows() == open_library(f"{folder}/out").rows()
    sizes = [done.labels(name).mesh.size for name in ("deep/box.gltf", "deep/box.stl")]
    assert sizes[0] == pytest.approx(2.0 * sizes[1])
    with pytest.raises(MeshError, match="there is no such file or folder"):
        find_meshes([f"{folder}/nothing"])


def test_side_files_outside_the_folder_of_a_gltf_are_not_downloaded() -> None:
    system = fsspec.filesystem("memory")
    for name in ("secret.bin", "lib/own.bin", "lib/below/own.bin"):
        system.pipe_file(f"/{name}", b"data")
    uris = ("../secret.bin", "/secret.bin", "memory://secret.bin", "own.bin", "below/own.bin",
            "picture.png", "%2e%2e/secret.bin", "missing.bin", "mesh.gltf")  # fmt: skip
    text = '{"buffers": [' + ",".join(f'{{"uri": "{uri}"}}' for uri in uris) + "]}"
    system.pipe_file("/lib/mesh.gltf", text.encode())
    with local_copy("memory://lib/mesh.gltf") as copy:
        there = {path.relative_to(copy.parent).as_posix() for path in copy.parent.rglob("*.*")}
        assert there == {"mesh.gltf", "own.bin", "below/own.bin"}
        first = content_hash(copy)
        (copy.parent / "own.bin").write_bytes(b"changed")
        assert content_hash(copy) != first
    system.store.clear()


@pytest.mark.parametrize("base", ["{}", "memory://out"])
def test_a_write_is_whole_or_not_at_all(tmp_path: Path, base: str) -> None:
    target = place(base.format(tmp_path)) / "deep" / "a b#\u00fc.bin"
    for data in (b"first", b"second"):
        with suppress(KeyboardInterrupt), writing(target) as part:
            part.write_bytes(b"half")
            raise KeyboardInterrupt
        with writing(target) as part:
            part.write_bytes(data)
        assert target.read_bytes() == data
    assert len(list(target.parent.iterdir())) == 1
    target.unlink()
