"""`grasp3d evaluate` and `grasp3d label --best`, mostly in this process."""

import json
import math
import re
from pathlib import Path

import numpy as np
import pyarrow.csv as pc
import pyarrow.parquet as pq
import pytest
from PIL import Image

from grasp3d.pictures import opengl
from tests.helpers import shapes
from tests.helpers.commands import export, printed
from tests.helpers.commands import run_here as grasp3d
from tests.helpers.commands import run_process as real_grasp3d
from tests.pictures.test_opengl import needs_opengl

BOX = (1.0, 0.7, 0.5)
PAIR = [[0.5, 0.0, 0.0], [-0.5, 0.0, 0.0]]
THREE = [
    [[0.505, 0.1, 0.1], [-0.5, 0.1, 0.1], [0.0, 0.35, 0.1]],
    [[0.5, 0.1, 0.1], [0.5, -0.1, 0.1], [0.5, 0.0, -0.1]],
    [[0.5, 0.1, 0.1], [0.5, 0.1, 0.1], [0.5, 0.1, 0.1]],
]
TWO_FINGERS = ("--max-edge", "0.2")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    export(tmp_path / "my box.stl", shapes.box(BOX))
    (tmp_path / "three.json").write_text(json.dumps(THREE), encoding="utf-8")
    (tmp_path / "pair.json").write_text(json.dumps([PAIR]), encoding="utf-8")
    return tmp_path


@pytest.mark.slow
def test_labels_and_numbers_of_given_grasps(folder: Path) -> None:
    """In a process of its own."""
    run = real_grasp3d(
        "evaluate", "my box.stl", "three.json", "--unit", "m", "--friction", "1", cwd=folder
    )
    assert (run.returncode, run.stderr) == (0, "")
    assert "my box.stl: 3 grasps of 3 fingers; μ 1, α 22.6°" in run.stdout
    rows = pc.read_csv(folder / "my box_grasps.csv").to_pylist()
    assert [row["label"] for row in rows] == ["S", "U", "U"]
    for name, count in (("S +surely stable", 1), ("M .*", 0), ("U +surely unstable", 2)):
        assert re.search(rf"■ {name} +{count} +{100.0 * count / 3.0:.1f} %", run.stdout)
    assert rows[0]["x1"] == 0.5
    assert rows[0]["distance1"] == pytest.approx(0.005)
    assert "contacts at most 5 mm from the surface" in run.stdout
    first = next(line for line in run.stdout.splitlines() if re.match(r" +1 +■ S", line))
    assert first.split()[3] == f"{rows[0]['score']:.3f}"
    assert first.split()[4] == f"{math.degrees(rows[0]['critical_angle']):.1f}°"
    assert re.search(r"3 +■ U +[\d.]+ +– +0.0° +0.000", run.stdout)
    assert "written: my box_grasps.csv" in run.stdout
    assert len(list(folder.iterdir())) == 4


@pytest.mark.parametrize("name", ["out.csv", "out.parquet", "out.json"])
def test_results_are_written_in_every_format_without_output(folder: Path, name: str) -> None:
    arguments = ("my box.stl", "pair.json", "-o", name, "--sensor-resolution", "30", "-q")
    assert printed("evaluate", *arguments, cwd=folder) == ""
    path = folder / name
    if path.suffix == ".json":
        found = json.loads(path.read_text(encoding="utf-8"))
        assert found["grasp3d"]["sensor_resolution"] == pytest.approx(math.radians(30.0))
        row = found["grasps"][0]
    else:
        row = (pc.read_csv if path.suffix == ".csv" else pq.read_table)(path).to_pylist()[0]
    assert (row["label"], row["rank"]) == ("S", 5)
    assert row["max_resolution"] == pytest.approx(2.0 * math.atan(0.5))


@pytest.mark.parametrize("name", ["out.csv", "out.json"])
def test_metrics_are_printed_and_written(folder: Path, name: str) -> None:
    names = "min_weight,epsilon_linf"
    arguments = ("my box.stl", "pair.json", "-o", name, "--unit", "mm", "--metrics", names)
    text = printed("evaluate", *arguments, cwd=folder)
    assert "medians: min_weight 0.0625, epsilon_linf " in text
    path = folder / name
    if path.suffix == ".json":
        row = json.loads(path.read_text(encoding="utf-8"))["grasps"][0]
    else:
        row = pc.read_csv(path).to_pylist()[0]
    assert row["min_weight"] == pytest.approx(1.0 / 16.0)
    assert row["epsilon_linf"] > 0.0
    assert "grasp_isotropy" not in row


def test_of_many_grasps_only_the_first_are_printed(folder: Path) -> None:
    (folder / "many.json").write_text(json.dumps([PAIR] * 200), encoding="utf-8")
    text = printed("evaluate", "my box.stl", "many.json", "-o", "many.csv", cwd=folder)
    assert "the best 10 of 200" in text
    assert len(text.splitlines()) < 30
    assert pc.read_csv(folder / "many.csv").num_rows == 200


POSES = """px,py,pz,qx,qy,qz,qw,unit,outcome
0,0,10,1,0,0,0,mm,1
0,0.5,10,1,0,0,0,mm,1
0,200,10,1,0,0,0,mm,0
"""
"""From above: two on the box of `posed`, and one beside it."""


@pytest.fixture
def posed(tmp_path: Path) -> Path:
    export(tmp_path / "small.stl", shapes.box((60.0, 42.0, 30.0)))
    (tmp_path / "poses.csv").write_text(POSES, encoding="utf-8")
    return tmp_path


@pytest.mark.slow
def test_poses_of_a_gripper_are_evaluated(posed: Path) -> None:
    arguments = ("small.stl", "poses.csv", "--unit", "mm", "--hand", "franka")
    run = grasp3d("evaluate", *arguments, "-o", "out.csv", cwd=posed)
    assert (run.returncode, run.stderr) == (0, "")
    assert "small.stl: 3 poses of franka; μ 0.5" in run.stdout
    for text in (
        "■ S +surely stable +2 +66.7 %",
        "1 of 3: the jaws close on nothing",
        "held when tried: S 100.0 % of 2, U 0.0 % of 1",
        "3 +■ U +0.000 .*the jaws close on nothing",
        r"poses read in the gripper's frame 'tcp', as the file states none \(--frame\)",
    ):
        assert re.search(text, run.stdout), text
    rows = pc.read_csv(posed / "out.csv").to_pylist()
    assert [row["label"] for row in rows] == ["S", "S", "U"]
    assert [row["closing"] for row in rows] == ["closed", "closed", "nothing"]
    assert rows[0]["opening"] == pytest.approx(0.06)
    assert rows[2]["opening"] is None
    again = grasp3d("evaluate", "small.stl", "out.csv", *arguments[2:], "-q", cwd=posed)
    assert (again.returncode, again.stdout) == (0, "")
    rows_again = pc.read_csv(posed / "small_grasps.csv").to_pylist()
    assert [row["label"] for row in rows_again] == ["S", "S", "U"]


def printed_rows(text: str) -> list[list[str]]:
    """Words of the rows of the table of grasps."""
    return [line.split() for line in text.splitlines() if re.match(r" +\d+ +■ [SMU] ", line)]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("fingers", "options"),
    [(2, TWO_FINGERS), (3, ("--fingers", "3", "--max-edge", "0.3"))],
)
def test_the_best_grasps_evaluated_again_are_the_same(
    folder: Path, fingers: int, options: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(opengl, "can_render", lambda: False)
    (folder / "out").mkdir()
    output = ("-o", "out/labels.npz")
    text = printed("label", "my box.stl", *options, *output, "--best", "5", cwd=folder)
    assert "the 5 best distinct grasps" in text
    assert "no pictures: they need OpenGL" in text
    assert f"written: {Path('out/labels.npz')}, {Path('out/labels_grasps.json')}" in text
    assert {path.name for path in (folder / "out").iterdir()} == {
        "labels.npz",
        "labels_grasps.json",
    }
    best = json.loads((folder / "out" / "labels_grasps.json").read_text())["grasps"]
    assert [len(grasp["contacts"]) for grasp in best] == [fingers] * 5
    edge = options[-2:]
    run_again = grasp3d(
        "evaluate", "my box.stl", "out/labels_grasps.json", "-o", "again.json", *edge, cwd=folder
    )
    assert run_again.returncode == 0
    again = json.loads((folder / "again.json").read_text())["grasps"]
    for one, other in zip(best, again, strict=True):
        assert one["label"] == other["label"]
        for name in ("critical_angle", "critical_angle_best", "max_resolution", "opening"):
            assert other[name] == pytest.approx(one[name], abs=1e-6), name
        assert other["epsilon"] == pytest.approx(one["epsilon"], rel=0.02)
    # Without epsilon, which is known to 1 %.
    assert [row[:6] for row in printed_rows(text)] == [
        row[:6] for row in printed_rows(run_again.stdout)
    ]


def test_fewer_grasps_than_requested_are_reported(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(opengl, "can_render", lambda: False)
    text = printed("label", "my box.stl", *TWO_FINGERS, "--best", "5000", cwd=folder)
    count = len(json.loads((folder / "my box_grasps.json").read_text())["grasps"])
    assert f"the {count} best distinct grasps" in text
    assert "5000 were requested; all others that may hold are nearer than" in text
    few = ("--max-opening", "0.01", "--best", "3", "--overwrite")
    text = printed("label", "my box.stl", *TWO_FINGERS, *few, cwd=folder)
    assert "best grasps: none may hold" in text
    assert "OpenGL" not in text
    assert json.loads((folder / "my box_grasps.json").read_text())["grasps"] == []


@pytest.mark.slow
@needs_opengl
def test_the_best_grasps_are_drawn(folder: Path) -> None:
    text = printed("label", "my box.stl", *TWO_FINGERS, "--best", "2", cwd=folder)
    assert "written: my box_labeled.ply, my box_grasps.json, my box_grasps.png" in text
    with Image.open(folder / "my box_grasps.png") as image:
        pixels = np.asarray(image.convert("RGB"))
    assert (pixels == 255).all(axis=2).mean() > 0.3
    assert (pixels.max(axis=2) < 60).mean() > 0.003
    assert sorted(path.name for path in folder.glob("my box*")) == [
        "my box.stl",
        "my box_grasps.json",
        "my box_grasps.png",
        "my box_labeled.ply",
    ]
