import os
from pathlib import Path

import pytest

from grasp3d.batch.inputs import find_meshes
from grasp3d.errors import MeshError


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
    (tmp_path / "lib" / "folder.stl").mkdir()
    (tmp_path / "lib" / "link.ply").symlink_to(tmp_path / "far" / "c.ply")
    (tmp_path / "lib" / "again.obj").symlink_to("deep/er/a.obj")
    (tmp_path / "lib" / "dead.stl").symlink_to("nowhere")
    (tmp_path / "lib" / "around").symlink_to(tmp_path / "lib")
    found = names_of(tmp_path / "lib", tmp_path / "lib" / "b.STL", tmp_path / "lib" / "deep")
    assert found in (
        [".git/d.off", "again.obj", "b.STL", "link.ply"],
        [".git/d.off", "b.STL", "deep/er/a.obj", "link.ply"],
    )
    assert names_of(tmp_path / "lib" / "old_labeled.ply") == ["old_labeled.ply"]


def test_results_are_not_inputs(tmp_path: Path) -> None:
    touch(tmp_path, "lib/a.stl", "lib/out/labels/a.ply", "lib/out/more.ply", "lib/labels/b.ply")
    assert names_of(tmp_path / "lib", results=tmp_path / "lib" / "out") == ["a.stl", "labels/b.ply"]
    assert names_of(tmp_path / "lib" / "**" / "*.ply", results=tmp_path / "lib" / "out") == [
        "labels/b.ply"
    ]
    assert len(names_of(tmp_path / "lib", results=tmp_path / "lib")) == 4
    touch(tmp_path, "lib/out/summary/part-00000.parquet")
    assert names_of(tmp_path / "lib") == ["a.stl", "labels/b.ply", "out/more.ply"]
    touch(tmp_path, "lib/summary/part-00012.parquet")
    assert names_of(tmp_path / "lib") == ["a.stl", "out/more.ply"]


def test_patterns_name_files_but_existing_files_take_precedence(tmp_path: Path) -> None:
    touch(tmp_path, "lib/a.stl", "lib/a.txt", "lib/x/b.stl", "lib/x/y/c.stl", "lib/x/[ab].stl",
          "lib/x/.d.stl")  # fmt: skip
    assert names_of(tmp_path / "lib/*.stl") == ["a.stl"]
    assert names_of(tmp_path / "lib/*") == ["a.stl"]
    assert names_of(tmp_path / "lib/*/?.stl") == ["x/b.stl"]
    assert names_of(tmp_path / "lib/x/[ab].stl") == ["[ab].stl"]
    assert names_of(tmp_path / "lib/x/[bc].stl") == ["b.stl"]
    assert names_of(tmp_path / "l*/**/*.stl") == [
        "lib/a.stl", "lib/x/[ab].stl", "lib/x/b.stl", "lib/x/y/c.stl",
    ]  # fmt: skip
    with pytest.raises(MeshError, match=r"a pattern names mesh files, as lib/\*\*/\*\.stl"):
        names_of(tmp_path / "lib" / "*.off")
    with pytest.raises(MeshError, match="there is no such folder"):
        names_of(tmp_path / "gone" / "*.off")


def test_a_list_names_inputs_relative_to_its_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    touch(tmp_path, "lists/m#1.stl", "lists/deep/m.stl", "other/m.stl", "lists/deep/er/n.ply")
    lines = ["# ours", "", "m#1.stl   # the first", "deep", "../other/m.stl", "deep/*.stl"]
    (tmp_path / "lists" / "all.txt").write_text("\r\n".join(lines), encoding="utf-8-sig")
    expected = ["deep/er/n.ply", "deep/m.stl", "m#1.stl", "m.stl"]
    assert names_of(tmp_path / "lists" / "all.txt") == expected
    monkeypatch.chdir(tmp_path / "lists")
    assert names_of("all.txt") == expected
    for line, message in (
        ("gone.stl", "gone.stl: there is no such file or folder"),
        ("deep/*.off", "a pattern names mesh files"),
        ("all.txt", "is a list within a list"),
    ):
        Path("bad.txt").write_text(f"# line 1\n\n{line}\n", encoding="utf-8")
        with pytest.raises(MeshError, match=r"^bad\.txt, line 3: .*") as caught:
            names_of("bad.txt")
        assert message in str(caught.value)


def test_meshes_with_equal_names_are_named_by_their_source(tmp_path: Path) -> None:
    touch(tmp_path, "a/mug.stl", "b/mug.stl", "b/cup.stl")
    one, two = tmp_path / "a", tmp_path / "b"
    assert names_of(one, two) == [f"{one}/mug.stl", f"{two}/mug.stl", "cup.stl"]


def test_stamps_change_when_a_file_changes(tmp_path: Path) -> None:
    touch(tmp_path, "a.stl", "b.gltf")
    stl, gltf = find_meshes([str(tmp_path)])
    assert (stl.size, gltf.stamp) == (4, "")
    assert find_meshes([str(tmp_path)]) == [stl, gltf]
    os.utime(tmp_path / "a.stl", ns=(1, 1))
    assert find_meshes([str(tmp_path)])[0].stamp not in {stl.stamp, ""}


def test_no_mesh_is_an_error_and_not_an_empty_result(tmp_path: Path) -> None:
    (tmp_path / "void").mkdir()
    (tmp_path / "void.txt").write_text("# nothing\n", encoding="ascii")
    for name in ("void", "void.txt"):
        with pytest.raises(MeshError, match=r"void.*: no mesh in it; files named .*\.stl"):
            find_meshes([str(tmp_path / name)])
    with pytest.raises(MeshError, match="there is no such file or folder"):
        find_meshes([str(tmp_path / "missing.stl")])
    with pytest.raises(MeshError, match="cannot be opened"):
        find_meshes([str(tmp_path / "void.txt" / "below.stl")])
