"""`grasp3d label`: the labelled file, its report, the best grasps, hands, loads and vertices."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pytest

from grasp3d import Label, Load, Table, label_surface, load_mesh, read_hand, read_labels
from grasp3d.formats import read_poses
from grasp3d.pictures import opengl
from grasp3d.pictures.subject import subject_of
from grasp3d.surface.load_case import HARD_FINGERS
from grasp3d.viewer.inspection import inspect
from tests.helpers import shapes
from tests.helpers.commands import export, printed
from tests.helpers.commands import run_process as real_grasp3d

TABLE_MM = ("--unit", "mm", "--max-edge", "10mm", "--hand", "franka", "--table", "as-is")


@pytest.fixture
def box(tmp_path: Path) -> Path:
    """A folder with a box of 60 x 40 x 20 and one of 1 x 0.7 x 0.5."""
    export(tmp_path / "box.stl", shapes.box((60.0, 40.0, 20.0)))
    export(tmp_path / "my box.stl", shapes.box((1.0, 0.7, 0.5)))
    return tmp_path


@pytest.mark.slow
def test_label_writes_the_ply_and_prints_the_fractions(tmp_path: Path) -> None:
    export(tmp_path / "in" / "my box.stl", shapes.box((60.0, 40.0, 100.0)))
    words = ("--unit", "mm", "--max-opening", "7cm", "--sensor-resolution", "14")
    errors = ("--friction", "0.8..1", "--location-error", "1mm")
    run = real_grasp3d("label", "in/my box.stl", *words, *errors, cwd=tmp_path)
    assert (run.returncode, run.stderr) == (0, "")
    first, *_ = run.stdout.splitlines()
    assert "μ 0.8 to 1, α 14°, locations ± 1 mm" in first
    assert "no grasp found" in run.stdout
    assert sorted(p.name for p in tmp_path.iterdir()) == ["in", "my box_labeled.ply"]
    labels = read_labels(tmp_path / "my box_labeled.ply")
    shown = dict(re.findall(r"■ ([SMU]) .*?([\d.]+) %", run.stdout))
    assert shown == {name: f"{100.0 * one:.1f}" for name, one in labels.fractions().items()}
    assert float(shown["S"]) > 50.0
    assert labels.model.sensor_resolution == pytest.approx(math.radians(14.0))
    assert labels.sampling.max_opening == 0.07


@pytest.mark.slow
def test_a_vertex_is_explained_as_in_the_viewer(box: Path) -> None:
    """On the side of a box, and at its corner on the table."""
    at = ("--at", "0,2cm,0", "--at", "30mm,20mm,-10mm")
    text = printed("label", "box.stl", *TABLE_MM, *at, "-o", "out.npz", cwd=box)
    text = text[: text.index("written: ")]
    side, corner = text.split("at 0,2cm,0: ")[1].split("at 30mm,20mm,-10mm: ")
    labels = read_labels(box / "out.npz")
    vertex = int(re.search(r"vertex +(\d+)", side)[1])  # type: ignore[index]
    assert labels.mesh.vertices[vertex] == pytest.approx([0.0, 0.02, 0.0], abs=0.006)
    assert side.startswith(f"{Label(labels.label[vertex]).name}: ")
    seen = inspect(subject_of(labels), vertex)
    assert " ".join(side.split("label")[0].split()) == seen.reason
    assert re.search(r"opposing contact +\(.*\) mm\n", side)
    approach = re.search(r"approach along +\((.*), (.*), (.*)\)", side)
    assert approach is not None
    assert float(approach[3]) < 0.0  # from above
    assert "U: there are grasps here, but franka reaches none of those tested: " in corner
    answer = printed("label", "box.stl", *TABLE_MM, *at, "-q", "-o", "quiet.npz", cwd=box)
    assert answer == text[text.index("at 0,2cm,0") :]


@pytest.mark.slow
@pytest.mark.parametrize("fingers", [2, 3])
def test_the_best_grasps_evaluated_again_are_the_same(
    box: Path, fingers: int, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(opengl, "can_render", lambda: False)
    (box / "out").mkdir()
    edge = ("--max-edge", "0.3" if fingers == 3 else "0.2")
    words = ("my box.stl", *edge, "--fingers", str(fingers), "-o", "out/labels.npz", "--best", "5")
    text = printed("label", *words, cwd=box)
    assert "the 5 best distinct grasps" in text
    assert "no pictures: they need OpenGL" in text
    assert {*(box / "out").iterdir()} == {box / "out/labels.npz", box / "out/labels_grasps.json"}
    words = ("my box.stl", "out/labels_grasps.json", "-o", "again.json", *edge)
    printed("evaluate", *words, cwd=box)
    best, again = (
        json.loads((box / name).read_text(encoding="utf-8"))["grasps"]
        for name in ("out/labels_grasps.json", "again.json")
    )
    assert [len(grasp["contacts"]) for grasp in best] == [fingers] * 5
    for one, other in zip(best, again, strict=True):
        assert one["label"] == other["label"]
        for name in ("critical_angle", "critical_angle_best", "max_resolution", "opening"):
            assert other[name] == pytest.approx(one[name], abs=1e-6), name
        assert other["epsilon"] == pytest.approx(one["epsilon"], rel=0.02)


def test_fewer_grasps_than_requested_are_reported(
    box: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(opengl, "can_render", lambda: False)
    text = printed("label", "my box.stl", "--max-edge", "0.2", "--best", "5000", cwd=box)
    count = len(json.loads((box / "my box_grasps.json").read_text())["grasps"])
    assert f"the {count} best distinct grasps" in text
    assert "5000 were requested; every other S or M grasp is nearer than" in text


@pytest.mark.slow
def test_a_gripper_has_a_verdict_and_poses(box: Path) -> None:
    text = printed("label", "box.stl", *TABLE_MM, "--best", "4", cwd=box)
    assert "Surely held by franka: " in text
    poses = read_poses(box / "box_grasps.json")
    assert poses.count == 4
    assert (poses.poses[:, 2, 2] < 1e-6).all()  # from above, or from the side
    labels = label_surface(
        load_mesh(box / "box.stl", unit="mm", max_edge="10mm"), hand=read_hand("franka"),
        table=Table(np.array([0.0, 0.0, 1.0]), -0.01),
    )  # fmt: skip
    np.testing.assert_array_equal(read_labels(box / "box_labeled.ply").label, labels.label)
    # What no pose error leaves is a verdict; older grasps are not left there.
    words = ("--best", "4", "--pose-error", "60mm", "--overwrite")
    text = printed("label", "box.stl", *TABLE_MM, *words, cwd=box)
    assert "best grasps: none, as no grasp is S or M" in text
    assert "no grasp holds at every pose within the pose error" in text
    assert not list(box.glob("box_grasps.*"))


@pytest.mark.slow
def test_a_load_is_printed_and_written(tmp_path: Path) -> None:
    export(tmp_path / "block.ply", shapes.box((0.08, 0.05, 0.03)))
    (tmp_path / "pushes.csv").write_text("fx,fy,fz,tx,ty,tz\n5,0,0,0,0,0.1\n")
    label = ("label", "block.ply", "--unit", "m", "--max-edge", "0.02", "--mass", "500 g")
    words = ("--torsion-radius", "3mm", "--grip-force", "40N", "--task", "weight + pushes.csv")
    grasps = ("-o", "held.ply", "--best", "2")
    text = printed(*label, *words, *grasps, "--center-of-mass", "1mm,0,0", cwd=tmp_path)
    task = "weight + wrench 5,0,0,0,0,0.1"
    assert f"load: 0.5 kg, {task}; available force: 40 N per finger" in text
    assert re.search(r"10/50/90 % quantiles by area: .*; force in N .*; payload in kg ", text)
    assert re.search(r"score +β\* +α\* +ε +ε_min +mm +N +kg", text)
    written = json.loads((tmp_path / "held_grasps.json").read_text())
    assert written["grasp3d"]["object_mass"] == 0.5
    assert {"grip_force", "payload"} < {*written["grasps"][0]}
    read = read_labels(tmp_path / "held.ply")
    assert read.load == Load(mass=0.5, grip_force=40.0, task=task)
    assert read.mesh.options.center_of_mass == (0.001, 0.0, 0.0)
    text = printed(*label, cwd=tmp_path)
    assert HARD_FINGERS in text
    assert "available force: none given" in text
