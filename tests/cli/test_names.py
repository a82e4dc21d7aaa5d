"""Commands on files whose names are difficult for shells, terminals and file systems."""

import json
import os
import sys
from pathlib import Path

import pytest

from grasp3d import open_library
from grasp3d.pictures import opengl
from grasp3d.system.names import as_unicode, safe_stem, short_hash
from tests.helpers import shapes
from tests.helpers.commands import export
from tests.helpers.commands import run_here as grasp3d
from tests.helpers.commands import run_process as real_grasp3d

QUICK = ("--max-edge", "inf")
LONG = "é" * 123  # with its suffix 250 bytes
UNDECODABLE = os.fsdecode(b"mug\xff")
STEMS = (
    "ünï 物体 #1",
    "-rf",
    "a b",
    "[red]",
    "CON",
    LONG,
    "two\nlines",
    UNDECODABLE,
    ":apple: \\[b]",
)
pytestmark = pytest.mark.skipif(
    sys.platform != "linux", reason="other systems do not allow such names"
)


def result(stem: str) -> str:
    """Stem of the result of an input."""
    safe = STEMS[stem]
    return safe if safe == stem else f"{safe}-{short_hash(stem)}"


@pytest.mark.slow
def test_all_files_named_after_an_input_have_safe_names(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The contents of these files have the full name."""
    monkeypatch.setattr(opengl, "can_render", lambda: False)  # pictures are tested elsewhere
    source = export(tmp_path / "in" / "a\n$b$:c.stl", shapes.sphere(1))
    (tmp_path / "pair.json").write_text("[[[1, 0, 0], [-1, 0, 0]]]", encoding="utf-8")
    runs = [
        grasp3d("label", source, "--best", "1", *QUICK, cwd=tmp_path),
        grasp3d("evaluate", source, "pair.json", "--max-distance", "1", cwd=tmp_path),
        grasp3d("sweep", source, "--sensor-resolution", "20", *QUICK, cwd=tmp_path),
    ]
    assert [(run.returncode, run.stderr) for run in runs] == [(0, "")] * 3
    stem = safe_stem("a\n$b$:c")
    made = {path.name for path in tmp_path.iterdir()} - {"in", "pair.json"}
    assert made == {
        f"{stem}_{end}"
        for end in ("labeled.ply", "grasps.json", "grasps.csv", "sweep.csv", "sweep.svg")
    }
    data = json.loads((tmp_path / f"{stem}_grasps.json").read_text(encoding="utf-8"))
    assert "a\n$b$:c.stl" in json.dumps(data, ensure_ascii=False).replace("\\n", "\n")


@pytest.mark.slow
def test_a_batch_overwrites_no_mesh_and_no_result(tmp_path: Path) -> None:
    """Run as a command, with child processes."""
    meshes = [f"in/{stem}.stl" for stem in STEMS] + ["in/a/mug.stl", "in/b/mug.stl"]
    meshes += ["in/mug.stl", "in/mug.obj", "in/MUG.STL", "in/co:lon/x.ply", "far/mug.stl"]
    before = {}
    for name in meshes:
        before[name] = export(tmp_path / name, shapes.sphere(1)).read_bytes()
    (tmp_path / "in" / "bad\nfile.stl").touch()
    run = real_grasp3d(
        "batch", "in", "far", "-o", "in", "--workers", "1", "--unit", "m", *QUICK, cwd=tmp_path
    )
    assert (run.returncode, "Traceback" in run.stderr) == (1, False)
    assert f"{len(meshes)} labelled, 1 failed" in run.stdout
    assert {name: (tmp_path / name).read_bytes() for name in meshes} == before
    rows = open_library(tmp_path / "in").table().to_pylist()
    made = {row["surface"] for row in rows if not row["error"]}
    assert len({name.casefold() for name in made}) == len(made) == len(meshes)
    assert all((tmp_path / "in" / name).is_file() for name in made)
    assert {f"surfaces/{safe_stem(as_unicode(f'{stem}.stl'))}.ply" for stem in STEMS} <= made
    assert {f"surfaces/{name}.ply" for name in ("a/mug.stl", "b/mug.stl", "mug.obj")} <= made
    lines = run.stdout.splitlines()
    assert any(line.startswith("[red].stl ") for line in lines)
    assert any(line.startswith(":apple: \\[b].stl ") for line in lines)
    assert any(line.startswith("two\\nlines.stl ") for line in lines)
    assert "failed: in/bad\\nfile.stl: the file is empty; export the mesh again" in lines
