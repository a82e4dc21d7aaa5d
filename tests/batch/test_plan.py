import os
from collections.abc import Mapping
from pathlib import Path

from grasp3d.batch.inputs import MeshFile, find_meshes
from grasp3d.batch.plan import plan, use_all_processors
from grasp3d.batch.storage.folder import Folder
from grasp3d.system.names import name_key, safe_stem, short_hash
from tests.batch.test_inputs import touch

OUT = Folder("out")


def stems(meshes: list[MeshFile], out: Folder = OUT, taken: Mapping[str, str] | None = None
          ) -> dict[str, str]:  # fmt: skip
    """Stems of the results of meshes; they do not depend on the order of the meshes."""
    names = {job.mesh.name: job.stem for job in plan(meshes, out, taken)}
    assert {job.mesh.name: job.stem for job in plan(meshes[::-1], out, taken)} == names
    assert len({name_key(stem) for stem in names.values()}) == len(meshes)
    files = {name_key(stem) + ".ply" for stem in names.values()}
    folders = {name_key(str(f)) for stem in names.values() for f in Path(stem).parents}
    assert not files & folders
    return names


def meshes_of(*names: str) -> list[MeshFile]:
    return [MeshFile(name, f"in/{name}") for name in names]


def test_the_last_jobs_use_all_processors() -> None:
    """No processor waits while one of them is left, and all others have one thread."""
    jobs = plan(meshes_of(*(f"{number}.stl" for number in range(20))), OUT)
    threaded = use_all_processors(jobs, 8)
    assert [job.mesh for job in threaded] == [job.mesh for job in jobs]
    assert [job.threads for job in threaded] == [1] * 16 + [2, 2, 4, 8]
    assert [job.threads for job in use_all_processors(jobs[:2], 8)] == [4, 8]
    assert use_all_processors(jobs, 1) == jobs
    assert use_all_processors(jobs, 0) == jobs  # no child processes


def test_results_are_in_folders_by_kind() -> None:
    (job,) = plan(meshes_of("deep/mug.stl"), OUT)
    assert (job.labels, job.fields) == ("labels/deep/mug.ply", "fields/deep/mug.parquet")
    assert job.page == "report/objects/deep/mug"


def test_colliding_names_are_extended_by_their_source() -> None:
    assert stems(meshes_of("mug.stl", "mug.ply", "MUG.off", "deep/mug.stl", "a b.PLY")) == {
        "mug.stl": "mug_stl",
        "mug.ply": "mug_ply",
        "MUG.off": "MUG_off",
        "deep/mug.stl": "deep/mug",
        "a b.PLY": "a b",
    }
    twice = meshes_of("x.y.stl", "x_y.stl", "x_y.ply")
    assert stems(twice)["x_y.ply"] == "x_y_ply"
    two = [MeshFile(f"/lib/{k}/mug.stl", f"/lib/{k}/mug.stl") for k in "ab"]
    assert stems(two) == {mesh.name: f"mug_stl-{short_hash(mesh.source)}" for mesh in two}
    away = [MeshFile(name, name) for name in ("s3://a/mug.stl", "../mug.obj")]
    assert stems(away) == {"s3://a/mug.stl": "mug_stl", "../mug.obj": "mug_obj"}


def test_the_names_are_valid_on_every_file_system(tmp_path: Path) -> None:
    names = ["mug.stl", "mug.obj", "MUG.STL", "mug_stl.ply", "cafe\u0301.ply", "caf\u00e9.ply"]
    names += ["CON.stl", "con.stl", "a:b.stl", "a*b.stl", "a\nb.stl", "x" * 250 + ".stl"]
    names += ["x" * 249 + "y.stl", "..stl", "...stl", os.fsdecode(b"mug\xff.stl"), " .stl"]
    names += ["a:b/mug.stl", "A:b/mug.stl", "mug.ply/cup.stl"]
    touch(tmp_path, *names)
    made = stems(find_meshes([str(tmp_path)]))
    assert len(made) > 15
    for stem in made.values():
        assert all(safe_stem(part) == part for part in stem.split("/"))
        assert len(stem.encode()) < 310
    assert made["mug.obj"] == "mug_obj"


def test_a_folder_takes_precedence_over_a_file() -> None:
    made = stems(meshes_of("mug.ply/cup.stl", "mug.stl"))
    assert made == {"mug.ply/cup.stl": "mug.ply/cup", "mug.stl": "mug_stl"}


def test_no_result_replaces_an_input(tmp_path: Path) -> None:
    touch(tmp_path, "out/labels/mug.ply", "lib/mug.stl", "far/cup.ply", "lib/cup.stl")
    (tmp_path / "out/labels/cup.ply").symlink_to(tmp_path / "far/cup.ply")
    inputs = ("out/labels/mug.ply", "lib/mug.stl", "out/labels/cup.ply", "lib/cup.stl")
    found = find_meshes([str(tmp_path / name) for name in inputs])
    made = stems(found, Folder(str(tmp_path / "out")))
    assert sorted(made.values()) == ["cup_ply", "cup_stl", "mug_ply", "mug_stl"]
    alone = stems(find_meshes([str(tmp_path / "out/labels/mug.ply")]), Folder(f"{tmp_path}/out"))
    assert alone == {"mug.ply": "mug_ply"}
    there = [MeshFile("mug.ply", "s3://b/out/labels/mug.ply")]
    assert stems(there, Folder("s3://b/out/")) == {"mug.ply": "mug_ply"}


def test_finished_results_keep_their_names() -> None:
    taken = {"mug.stl": "mug", "gone.stl": "cup", "x.stl": "box.ply"}
    meshes = meshes_of("mug.stl", "mug.ply", "cup.obj", "box.ply/a.stl", "x.stl")
    made = stems(meshes, taken=taken)
    assert made["mug.stl"] == "mug"  # one new file renames none
    assert made["mug.ply"] == "mug_ply"
    assert made["cup.obj"] == "cup_obj"  # the stem cup is taken by a mesh that is not among these
    assert made["x.stl"] == "box.ply"
    file = plan(meshes_of("box.ply/a.stl"), OUT, {"x.stl": "box"})[0].stem
    assert file == short_hash("in/box.ply/a.stl", digits=64)  # where a folder is needed


def test_unsafe_stems_of_a_summary_are_not_kept() -> None:
    for stem in ("../../mug", "/mug", "a//b", "", "con", "a:b", "x" * 200, "mug-" + "0" * 65):
        kept = plan(meshes_of("mug.stl"), OUT, {"mug.stl": stem})[0].stem
        assert kept == ("mug" if stem != "mug-" + "0" * 65 else stem)
    full = short_hash("in/mug.stl", digits=64)
    for stem in (full, f"mug_stl-{full}"):
        assert plan(meshes_of("mug.stl"), OUT, {"mug.stl": stem})[0].stem == stem
    two = plan(meshes_of("a.stl", "b.stl"), OUT, {"a.stl": "same", "b.stl": "same"})
    assert [job.stem for job in two] == ["a", "b"]


def test_names_that_differ_by_joiners_only_are_told_apart() -> None:
    """Some file systems take them for the same."""
    found = stems(meshes_of("family.stl", "fam\u200dily.ply", "n\u200cim.stl"))
    assert found == {
        "family.stl": "family_stl",
        "fam\u200dily.ply": "fam\u200dily_ply",
        "n\u200cim.stl": "n\u200cim",
    }
