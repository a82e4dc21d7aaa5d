"""`grasp3d check`, mostly in this process."""

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


def library(folder: Path) -> Path:
    """A folder with a sound mesh, an open one and a broken one."""
    library_folder = folder / "library"
    (library_folder / "below").mkdir(parents=True)
    export(library_folder / "box.stl", shapes.box((0.04, 0.06, 0.08)))
    vertices, faces = shapes.sphere(2, 0.05)
    export(library_folder / "below" / "open [red].ply", (vertices, faces[4:]))
    (library_folder / "broken.stl").write_bytes(b"no mesh at all")
    return library_folder


@pytest.mark.slow
def test_a_row_has_the_diagnosis_and_the_cost_of_labelling(folder: Path) -> None:
    """In a process of its own."""
    run = real_grasp3d("check", "box.stl", "--unit", "m", cwd=folder)
    assert run.returncode == 0, run.stderr
    row = re.escape("40 x 60 x 80") + r" +12 +1 +yes +0\.000192 +0 +0\.00° +[\d,]+ "
    assert re.search(rf"^box\.stl +yes +m +{row}", run.stdout, re.MULTILINE)
    assert "labels can be trusted: 1 yes, 0 with care, 0 no; 0 failed" in run.stdout
    assert run.stderr == ""


def test_warnings_and_repairs_are_printed(folder: Path) -> None:
    vertices, faces = shapes.sphere(2, 50.0)
    export(folder / "ball.ply", (vertices, faces[20:, ::-1]))
    run = grasp3d("check", "ball.ply", "--max-opening", "0.08", cwd=folder)
    assert run.returncode == 1
    assert "repaired: ball.ply: 300 faces turned: they were inside out" in run.stdout
    assert "ball.ply: unit not stated; largest extent 100: " in run.stdout
    assert "10 cm if mm" in run.stdout
    assert "labels can be trusted: 0 yes, 0 with care, 1 no" in run.stdout
    assert "no: ball.ply: max_opening is 0.08, 0.000756 times the size of ball.ply" in run.stdout
    assert "give --unit mm and --max-opening 0.08m" in run.stdout
    assert run.stderr == ""


@pytest.mark.slow
def test_a_folder_has_a_line_for_each_mesh_after_an_error_too(folder: Path) -> None:
    library(folder)
    run = real_grasp3d("check", "library", "-o", "report.json", cwd=folder)
    assert run.returncode == 1
    assert "Traceback" not in run.stderr
    assert re.search(r"failed: library/broken\.stl: cannot be read as STL", run.stdout)
    assert "below/open [red].ply: the surface is open" in run.stdout.replace("\n", " ")
    assert "labels can be trusted: 1 yes, 1 with care, 0 no; 1 failed" in run.stdout
    report = json.loads((folder / "report.json").read_text(encoding="utf-8"))
    assert [(mesh["mesh"], mesh["trust"]) for mesh in report["meshes"]] == [
        ("below/open [red].ply", "with care"),
        ("box.stl", "yes"),
        ("broken.stl", "no"),
    ]
    assert report["grasp3d"]["mesh"]["repair"] == "safe"
    opened, sound, broken = report["meshes"]
    assert broken["refusal"].startswith("library/broken.stl: ")
    assert opened["after"]["volume"] is None
    assert sound["after"]["volume"] == pytest.approx(0.04 * 0.06 * 0.08)
    assert sound["refusal"] is None


def test_strict_accepts_no_warnings(folder: Path) -> None:
    vertices, faces = shapes.sphere(2, 0.05)
    export(folder / "open.ply", (vertices, faces[1:]))
    export(folder / "pierced.ply", (vertices, faces[5:]))
    assert grasp3d("check", "box.stl", "--strict", cwd=folder).returncode == 0
    assert grasp3d("check", "pierced.ply", cwd=folder).returncode == 0
    assert grasp3d("check", "pierced.ply", "--strict", cwd=folder).returncode == 1


def test_a_table_states_scale_and_unit_of_each_mesh_and_units_are_guessed(folder: Path) -> None:
    text = "path,name,scale,unit\nbox.stl,large,2,cm\nbox.stl,small,1000,\ngone.stl,,,\n"
    (folder / "objects.csv").write_text(text, encoding="utf-8")
    words = ("check", "objects.csv", "--unit", "guess", "--workers", "1", "-o", "report.json")
    run = grasp3d(*words, cwd=folder)
    assert (run.returncode, "Traceback" in run.stderr) == (1, False)
    assert "failed: gone.stl: there is no such file" in run.stdout
    gone, large, small = json.loads((folder / "report.json").read_text("utf-8"))["meshes"]
    assert [one["mesh"] for one in (gone, large, small)] == ["gone.stl", "large", "small"]
    assert (large["unit"], large["file_unit"], small["file_unit"]) == ("m", "cm", "mm")
    assert large["extents"] == pytest.approx([0.0008, 0.0012, 0.0016])
    assert small["extents"] == pytest.approx([0.04, 0.06, 0.08])
    assert "its unit, mm, is a guess" in run.stdout.replace("\n", " ")
