"""Files of local folders, in memory and on an object store."""

import pickle
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import fsspec
import pytest
import trimesh

from grasp3d import GraspModel
from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.checking import check_file
from grasp3d.batch.identity import content_hash
from grasp3d.batch.inputs import find_meshes
from grasp3d.batch.storage.files import list_entries, local_copy
from grasp3d.batch.storage.folder import Folder
from grasp3d.batch.store import Store, read_summary
from grasp3d.errors import MeshError
from grasp3d.system.files import TEMPORARY_PREFIX
from tests.batch.test_store import row_of, store_rows, summary_rows
from tests.helpers import shapes
from tests.helpers.buckets import bucket

SETTINGS = BatchSettings(GraspModel(friction=0.4))


@pytest.fixture(scope="module")
def s3() -> Iterator[str]:
    with bucket() as address:
        yield address


@pytest.fixture(params=["local", "file", "memory", "s3"])
def folder(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Folder]:
    """A folder on each kind of file system."""
    if request.param == "s3":
        yield Folder(f"{request.getfixturevalue('s3')}/{tmp_path.name}")
        return
    fsspec.filesystem("memory").store.clear()
    addresses = {
        "local": str(tmp_path / "out"),
        "file": f"file://{tmp_path}/out",
        "memory": "memory://out",
    }
    yield Folder(addresses[request.param])
    fsspec.filesystem("memory").store.clear()


@pytest.mark.slow
def test_files_are_written_listed_read_and_removed(folder: Folder) -> None:
    assert folder.is_local == (not folder.url.startswith(("memory", "s3")))
    assert folder.names() == []
    for name in ("a.txt", "deep/er/b c#1.txt", "deep/\u00fc.txt"):
        folder.write(name, b"first")
        folder.write(name, name.encode())
    assert folder.names() == ["a.txt", "deep/er/b c#1.txt", "deep/\u00fc.txt"]
    assert folder.names("deep") == folder.names("deep/") == folder.names()[1:]
    assert folder.names("dee") == []
    assert folder.read("deep/er/b c#1.txt") == b"deep/er/b c#1.txt"
    assert folder.read_all(["a.txt", "missing", "deep/\u00fc.txt"]) == {
        "a.txt": b"a.txt",
        "deep/\u00fc.txt": "deep/\u00fc.txt".encode(),
    }
    with pytest.raises(FileNotFoundError):
        folder.read("missing")
    with folder.atomic_write("new/put.bin") as temporary:
        temporary.write_bytes(b"put")
    assert (folder.read("new/put.bin"), temporary.exists()) == (b"put", False)
    before = folder.stamps()
    folder.write("a.txt", b"other")
    after = folder.stamps()
    assert {name for name in after if after[name] != before[name]} == {"a.txt"}
    folder.remove_all(["a.txt"])
    folder.remove_all(["a.txt"])
    folder.remove_all(["missing", *folder.names("deep")])
    assert folder.names() == ["new/put.bin"]
    assert pickle.loads(pickle.dumps(folder)) == folder  # noqa: S301


@pytest.mark.slow
def test_a_batch_store_works_on_every_file_system(folder: Folder) -> None:
    rows = [row_of("a"), row_of("b")]
    store_rows(folder, rows)
    kept = Store(folder, SETTINGS)
    mesh = find_meshes([folder.path("labels")])[0]
    assert mesh.name == "a.ply"
    assert kept.begin(["c"]) == 0
    kept.add(row_of("c"))
    kept.close()
    assert [row.mesh for row in read_summary(folder.url)] == ["a", "b", "c"]
    assert sorted(summary_rows(folder)) == ["a", "b", "c"]


def export(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    trimesh.Trimesh(*shapes.box((0.04, 0.06, 0.08)), process=False).export(path)
    return path


@pytest.mark.slow
def test_meshes_are_downloaded_from_every_file_system(folder: Folder, tmp_path: Path) -> None:
    export(tmp_path / "mesh" / "box.stl")
    scene = trimesh.Trimesh(*shapes.box((0.04, 0.06, 0.08)), process=False).scene()
    for name, data in trimesh.exchange.gltf.export_gltf(scene).items():
        (tmp_path / "mesh" / name.replace("model.gltf", "box.gltf")).write_bytes(data)
    (tmp_path / "mesh" / "bad.stl").write_bytes(b"no mesh at all")
    local = content_hash(tmp_path / "mesh" / "box.gltf")
    for path in sorted((tmp_path / "mesh").iterdir()):
        folder.write(f"lib/deep/{path.name}", path.read_bytes())
    folder.write("lib/list.txt", b"deep/*.stl  # two\n\n# none\ndeep/box.gltf\n")
    found = find_meshes([folder.path("lib")])
    assert [mesh.name for mesh in found] == ["deep/bad.stl", "deep/box.gltf", "deep/box.stl"]
    assert found == find_meshes([folder.path("lib/list.txt")])
    assert [mesh.name for mesh in find_meshes([folder.path("lib/**/b*.stl")])] == [
        "deep/bad.stl",
        "deep/box.stl",
    ]
    bad, gltf, box = found
    assert find_meshes([box.source])[0].name == "box.stl"
    assert (bool(box.stamp), gltf.stamp, box.size) == (True, "", 684)
    with local_copy(gltf.source) as copy:
        assert (copy.name, content_hash(copy)) == ("box.gltf", local)
    assert copy.exists() == folder.is_local
    checked = check_file(box, SETTINGS)
    assert (checked.refusal, checked.source) == ("", folder.path("lib/deep/box.stl"))
    refused = check_file(bad, SETTINGS)
    assert refused.refusal.startswith(f"{bad.source}: cannot be read as STL")
    with pytest.raises(MeshError, match="there is no such file or folder"):
        find_meshes([folder.path("nothing")])
    with pytest.raises(MeshError, match="no such"), local_copy(folder.path("nothing.stl")) as copy:
        content_hash(copy)


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


def test_new_files_are_listed_without_delay(s3: str) -> None:
    folder = Folder(f"{s3}/seen")
    assert (folder.names(), [entry.name for entry in listed(folder)]) == ([], [])
    other = fsspec.filesystem("s3", skip_instance_cache=True)
    other.pipe_file("bucket/seen/a.stl", b"mesh")
    assert folder.names() == ["a.stl"]
    assert [entry.name for entry in listed(folder)] == ["a.stl"]


def listed(folder: Folder) -> list[Any]:
    try:
        return list(list_entries(folder.url))
    except FileNotFoundError:
        return []


def test_what_killed_processes_left_is_removed_once_it_is_old(tmp_path: Path) -> None:
    folder, left = Folder(str(tmp_path)), tmp_path / f"{TEMPORARY_PREFIX}killed.part.ply"
    left.write_bytes(b"half")
    folder.remove_temporary_files(0.2)
    assert left.exists()  # it may still be written to
    folder.remove_temporary_files(0.2, wait=True)
    assert not left.exists()
