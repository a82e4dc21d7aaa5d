import os
import pickle
import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import fsspec
import pytest
import trimesh

from grasp3d import GraspModel
from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.checking import check_file
from grasp3d.batch.identity import content_of
from grasp3d.batch.inputs import find_meshes
from grasp3d.batch.store import Store, read_summary
from grasp3d.errors import MeshError, OutputError
from grasp3d.storage import Folder, entries, local_copy, look
from tests.helpers import shapes
from tests.helpers.buckets import bucket
from tests.test_store import keep, kill, row_of, summary_rows

SETTINGS = BatchSettings(GraspModel(friction=0.4))


@pytest.fixture(scope="module")
def s3() -> Iterator[str]:
    with bucket() as address:
        yield address


@pytest.fixture(params=["local", "file", "memory", "s3"])
def place(request: pytest.FixtureRequest, tmp_path: Path) -> Iterator[Folder]:
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


def test_files_are_written_listed_read_and_removed(place: Folder) -> None:
    assert place.is_local == (not place.url.startswith(("memory", "s3")))
    assert place.names() == []
    for name in ("a.txt", "deep/er/b c#1.txt", "deep/\u00fc.txt"):
        place.write(name, b"first")
        place.write(name, name.encode())
    assert place.names() == ["a.txt", "deep/er/b c#1.txt", "deep/\u00fc.txt"]
    assert place.names("deep") == place.names("deep/") == place.names()[1:]
    assert place.names("dee") == []
    assert place.read("deep/er/b c#1.txt") == b"deep/er/b c#1.txt"
    assert place.read_all(["a.txt", "missing", "deep/\u00fc.txt"]) == {
        "a.txt": b"a.txt",
        "deep/\u00fc.txt": "deep/\u00fc.txt".encode(),
    }
    with pytest.raises(FileNotFoundError):
        place.read("missing")
    with place.making("new/put.bin") as part:
        part.write_bytes(b"put")
    assert (place.read("new/put.bin"), part.exists()) == (b"put", False)
    before = place.stamps()
    place.write("a.txt", b"other")
    after = place.stamps()
    assert {name for name in after if after[name] != before[name]} == {"a.txt"}
    place.remove("a.txt")
    place.remove("a.txt")
    place.remove_all(["missing", *place.names("deep")])
    assert place.names() == ["new/put.bin"]
    assert pickle.loads(pickle.dumps(place)) == place  # noqa: S301


def test_a_store_may_be_anywhere(place: Folder) -> None:
    rows = [row_of("a"), row_of("b")]
    keep(place, rows)
    kept = Store.open(place, SETTINGS)
    mesh = find_meshes([place.path("labels")])[0]
    assert mesh.name == "a.ply"
    kept.begin(["c"])
    kept.add(row_of("c"))
    assert [row.mesh for row in read_summary(place.url)] == ["a", "b", "c"]
    kill(kept)
    assert sorted(Store.open(place, SETTINGS).rows) == ["a", "b", "c"]
    assert sorted(summary_rows(place)) == ["a", "b", "c"]
    assert place.names("journal") == []


def export(path: Path) -> Path:
    path.parent.mkdir(parents=True, exist_ok=True)
    trimesh.Trimesh(*shapes.box((0.04, 0.06, 0.08)), process=False).export(path)
    return path


def test_meshes_are_found_and_fetched_from_anywhere(place: Folder, tmp_path: Path) -> None:
    export(tmp_path / "mesh" / "box.stl")
    scene = trimesh.Trimesh(*shapes.box((0.04, 0.06, 0.08)), process=False).scene()
    for name, data in trimesh.exchange.gltf.export_gltf(scene).items():
        (tmp_path / "mesh" / name.replace("model.gltf", "box.gltf")).write_bytes(data)
    (tmp_path / "mesh" / "bad.stl").write_bytes(b"no mesh at all")
    local = content_of(tmp_path / "mesh" / "box.gltf")
    for path in sorted((tmp_path / "mesh").iterdir()):
        place.write(f"lib/deep/{path.name}", path.read_bytes())
    place.write("lib/list.txt", b"deep/*.stl  # two\n\n# none\ndeep/box.gltf\n")
    found = find_meshes([place.path("lib")])
    assert [mesh.name for mesh in found] == ["deep/bad.stl", "deep/box.gltf", "deep/box.stl"]
    assert found == find_meshes([place.path("lib/list.txt")])
    assert [mesh.name for mesh in find_meshes([place.path("lib/**/b*.stl")])] == [
        "deep/bad.stl",
        "deep/box.stl",
    ]
    bad, gltf, box = found
    assert find_meshes([box.source])[0].name == "box.stl"
    assert (bool(box.stamp), gltf.stamp, box.size) == (True, "", 684)
    with local_copy(gltf.source) as copy:
        assert (copy.name, content_of(copy)) == ("box.gltf", local)
    assert copy.exists() == place.is_local
    checked = check_file(box, SETTINGS)
    assert (checked.refusal, checked.source) == ("", place.path("lib/deep/box.stl"))
    refused = check_file(bad, SETTINGS)
    assert refused.refusal.startswith(f"{bad.source}: cannot be read as STL")
    with pytest.raises(MeshError, match="there is no such file or folder"):
        find_meshes([place.path("nothing")])
    with pytest.raises(MeshError, match="no such"), local_copy(place.path("nothing.stl")) as copy:
        content_of(copy)


def test_a_list_of_many_files_asks_once_for_each_folder(monkeypatch: pytest.MonkeyPatch) -> None:
    system = fsspec.filesystem("memory")
    for number in range(20):
        system.pipe_file(f"/lib/m{number:02d}.stl", b"mesh")
    system.pipe_file("/lib/far/a.stl", b"mesh")
    lines = [f"memory://lib/m{number:02d}.stl" for number in range(20)]
    system.pipe_file("/lib/list.txt", "\n".join([*lines, "far/a.stl"]).encode())
    asked = []
    known = type(system).info
    monkeypatch.setattr(type(system), "info", lambda self, path: asked.append(path)
                        or known(self, path))  # fmt: skip
    found = find_meshes(["memory://lib/list.txt"])
    assert [mesh.name for mesh in found][:2] == ["far/a.stl", "m00.stl"]
    assert all(mesh.stamp and mesh.size == 4 for mesh in found)
    assert [path for path in asked if path.endswith(".stl")] == ["/lib/far/a.stl"]
    system.pipe_file("/lib/list.txt", "\n".join([*lines, "memory://lib/no.stl"]).encode())
    with pytest.raises(MeshError, match=r"list\.txt, line 21: memory://lib/no\.stl: there is no"):
        find_meshes(["memory://lib/list.txt"])
    system.store.clear()


def test_a_gltf_that_asks_for_other_folders_fetches_none_of_it() -> None:
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
        first = content_of(copy)
        (copy.parent / "own.bin").write_bytes(b"changed")
        assert content_of(copy) != first
    system.store.clear()


def test_file_systems_tell_what_is_wrong_in_a_sentence(
    s3: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    with pytest.raises(OutputError, match=r"s3://none/out/a: cannot be written \(there is no such"):
        Folder("s3://none/out").write("a", b"")
    with pytest.raises(MeshError, match="there is no such file or folder"):
        find_meshes(["s3://none/lib"])
    with pytest.raises(MeshError, match="no file system is called nowhere://"):
        find_meshes(["nowhere://lib"])
    assert look(s3) is None

    def fails(error: Exception) -> Any:
        def raise_it(*_: object, **__: object) -> None:
            raise error

        return raise_it

    class NoCredentialsError(Exception):
        pass

    for error, told in (
        (ImportError("Install s3fs"), r'needs the package s3fs: pip install "grasp3d\[s3\]"'),
        (NoCredentialsError(), "there are no credentials: set AWS_ACCESS_KEY_ID"),
        (PermissionError("Forbidden"), "access is denied: check the credentials"),
        (OSError(28, "No space"), "no space left on this machine"),
        (OSError(5, "Input/output error"), r"cannot be opened \(Input/output error\)"),
        (RuntimeError("two\nlines"), r"\(two lines\)"),
    ):
        monkeypatch.setattr(fsspec.core, "url_to_fs", fails(error))
        with pytest.raises(MeshError, match=told):
            find_meshes([f"{s3}/lib"])
    monkeypatch.setattr(fsspec.core, "url_to_fs", fails(ImportError("Install paramiko")))
    with pytest.raises(MeshError, match=r"a package that is not installed \(Install paramiko\)"):
        look("sftp://host/lib")


def test_new_files_are_seen_at_once(s3: str) -> None:
    place = Folder(f"{s3}/seen")
    assert (place.names(), [entry.name for entry in entries_of(place)]) == ([], [])
    other = fsspec.filesystem("s3", skip_instance_cache=True)
    other.pipe_file("bucket/seen/a.stl", b"mesh")
    assert place.names() == ["a.stl"]
    assert [entry.name for entry in entries_of(place)] == ["a.stl"]


def entries_of(place: Folder) -> list[Any]:
    try:
        return list(entries(place.url))
    except FileNotFoundError:
        return []


def test_what_cannot_be_written_here_is_told(tmp_path: Path) -> None:
    (tmp_path / "file").write_bytes(b"")
    folder = Folder(str(tmp_path))
    for name in ("file/below", "file/below/it"):
        with pytest.raises(OutputError, match="cannot be"):
            folder.write(name, b"data")
    (tmp_path / "folder").mkdir()
    with pytest.raises(OutputError, match="is a folder; name a file"):
        folder.write("folder", b"data")
    with pytest.raises(OutputError, match="cannot be read"):
        folder.read("folder")
    with pytest.raises(OutputError, match="cannot be removed"):
        folder.remove("folder")
    said = re.escape(f"{tmp_path / 'new'}: is not to be made")
    with pytest.raises(OutputError, match=said), folder.making("new") as part:
        raise OutputError(f"{part}: is not to be made")
    assert folder.names() == ["file"]
    (tmp_path / "link").symlink_to(tmp_path / "link")
    assert folder.names() == ["file"]
    os.mkfifo(tmp_path / "pipe")
    assert folder.names() == ["file"]
