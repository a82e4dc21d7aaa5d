"""`grasp3d check`."""

import json
import re
from pathlib import Path

import pytest

from tests.helpers import shapes
from tests.helpers.commands import export
from tests.helpers.commands import run_here as grasp3d
from tests.helpers.commands import run_process as real_grasp3d


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    export(tmp_path / "box.stl", shapes.box((0.04, 0.06, 0.08)))
    return tmp_path


@pytest.mark.slow
def test_a_folder_has_a_line_for_each_mesh_after_an_error_too(folder: Path) -> None:
    vertices, faces = shapes.sphere(2, 0.05)
    export(folder / "below" / "open [red].ply", (vertices, faces[4:]))
    (folder / "broken.stl").write_bytes(b"no mesh at all")
    run = real_grasp3d("check", ".", "--unit", "m", "-o", "report.json", cwd=folder)
    assert (run.returncode, run.stderr) == (1, "")
    row = re.escape("40 x 60 x 80") + r" +12 +1 +yes +0\.000192 +0 +0\.00° +[\d,]+ "
    assert re.search(rf"^box\.stl +yes +m +{row}", run.stdout, re.MULTILINE)
    assert re.search(r"failed: \S*broken\.stl: cannot be read as STL", run.stdout)
    assert "below/open [red].ply: the surface is open" in run.stdout.replace("\n", " ")
    assert "labels can be trusted: 1 yes, 1 with care, 0 no; 1 failed" in run.stdout
    report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    assert report["grasp3d"]["mesh"]["repair"] == "safe"
    opened, sound, broken = report["meshes"]
    assert [(one["mesh"], one["trust"]) for one in (opened, sound, broken)] == [
        ("below/open [red].ply", "with care"),
        ("box.stl", "yes"),
        ("broken.stl", "no"),
    ]
    assert "broken.stl: " in broken["refusal"]
    assert (opened["after"]["volume"], sound["refusal"]) == (None, None)
    assert sound["after"]["volume"] == pytest.approx(0.04 * 0.06 * 0.08)


def test_strict_accepts_no_warnings(folder: Path) -> None:
    vertices, faces = shapes.sphere(2, 0.05)
    export(folder / "pierced.ply", (vertices, faces[5:]))
    for words, code in {"box.stl --strict": 0, "pierced.ply": 0, "pierced.ply --strict": 1}.items():
        assert grasp3d("check", *words.split(), cwd=folder).returncode == code


def test_a_table_states_scale_and_unit_of_each_mesh_and_units_are_guessed(folder: Path) -> None:
    text = "path,name,scale,unit\nbox.stl,large,2,cm\nbox.stl,small,1000,\ngone.stl,,,\n"
    (folder / "objects.csv").write_text(text, encoding="utf-8")
    words = ("check", "objects.csv", "--unit", "guess", "--workers", "1", "-o", "report.json")
    run = grasp3d(*words, cwd=folder)
    assert run.returncode == 1
    assert "failed: gone.stl: there is no such file" in run.stdout
    gone, large, small = json.loads((folder / "report.json").read_text("utf-8"))["meshes"]
    assert [one["mesh"] for one in (gone, large, small)] == ["gone.stl", "large", "small"]
    assert (large["unit"], large["file_unit"], small["file_unit"]) == ("m", "cm", "mm")
    assert large["extents"] == pytest.approx([0.0008, 0.0012, 0.0016])
    assert small["extents"] == pytest.approx([0.04, 0.06, 0.08])
    assert "its unit, mm, is a guess" in run.stdout.replace("\n", " ")
