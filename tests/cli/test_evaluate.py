"""`grasp3d evaluate` and `grasp3d label --best`, mostly in this process."""

import json
import math
import re
from collections.abc import Callable
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.csv as pc
import pyarrow.parquet as pq
import pytest
from PIL import Image

from grasp3d.grasps import evaluated_parts, evaluation, grasp_files
from grasp3d.rendering import opengl
from grasp3d.surface.grasp_table import GraspTable
from grasp3d.system import tables
from tests.helpers import shapes
from tests.helpers.commands import export, printed
from tests.helpers.commands import run_here as grasp3d
from tests.helpers.commands import run_process as real_grasp3d
from tests.rendering.test_opengl import needs_opengl

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
    assert "my box.stl: 3 grasps of 3 fingers; friction 1, sensor resolution 22.6°" in run.stdout
    rows = pc.read_csv(folder / "my box_grasps.csv").to_pylist()
    assert [row["label"] for row in rows] == ["S", "U", "U"]
    for name, count in (("S +surely stable", 1), ("M .*", 0), ("U +surely unstable", 2)):
        assert re.search(rf"■ {name} +{count} +{100.0 * count / 3.0:.1f} %", run.stdout)
    assert rows[0]["x1"] == 0.5
    assert rows[0]["distance1"] == pytest.approx(0.005)
    assert "distance of the contacts from the surface: median 0, at most 0.005 m" in run.stdout
    first = next(line for line in run.stdout.splitlines() if re.match(r" +1 +■ S", line))
    assert first.split()[3] == f"{math.degrees(rows[0]['critical_angle']):.1f}°"
    assert first.split()[-1] == "0.005"
    assert re.search(r"3 +■ U +none +none +0.000", run.stdout)
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
    assert re.search(r"^min_weight +0.0625 +0.0625 +0.0625", text, re.MULTILINE)
    path = folder / name
    if path.suffix == ".json":
        row = json.loads(path.read_text(encoding="utf-8"))["grasps"][0]
    else:
        row = pc.read_csv(path).to_pylist()[0]
    assert row["min_weight"] == pytest.approx(1.0 / 16.0)
    assert row["epsilon_linf"] > 0.0
    assert "grasp_isotropy" not in row


def random_pairs(count: int) -> np.ndarray:
    """Contacts on sides of a box of 1 x 2 x 3, most of them opposite, shape (count, 2, 3)."""
    random, size, every = np.random.default_rng(0), np.array([0.5, 1.0, 1.5]), np.arange(count)
    points = random.uniform(-1.0, 1.0, (count, 2, 3)) * size
    sides_of = random.integers(3, size=(2, count))
    good = every % 4 > 0
    sides_of[1, good] = sides_of[0, good]
    points[good, 1] = points[good, 0] + random.uniform(-0.1, 0.1, (good.sum(), 3))
    points = np.clip(points, -size, size)
    for contact, sides in enumerate(sides_of):
        points[every, contact, sides] = (1 - 2 * contact) * size[sides]
    return points


def write_contacts(path: Path, points: np.ndarray) -> None:
    names = [f"{axis}{contact + 1}" for contact in range(2) for axis in "xyz"]
    columns = points.reshape(-1, 6).T
    tables.write_columns(path, dict(zip(names, columns, strict=True)), settings={})


@pytest.fixture
def in_parts(monkeypatch: pytest.MonkeyPatch) -> Callable[[], None]:
    """A function from whose call on tables of more than some ten grasps are large."""

    def begin() -> None:
        for module, name, value in (
            (tables, "PART_ROWS", 30), (tables, "ROWS", 20), (tables, "PART_BYTES", 3000),
            (grasp_files, "PART", 30),
        ):  # fmt: skip
            monkeypatch.setattr(module, name, value)

    return begin


@pytest.mark.slow
@pytest.mark.parametrize(
    ("given", "words"),
    [
        ("csv", ()),
        (
            "parquet",
            (
                "--friction",
                "0.3..0.6",
                "--region",
                "box:-1,-1,-1,1,1,0.7",
                "--location-error",
                "0.01",
            ),
        ),
        ("parquet", ("--mass", "0.5kg", "--grip-force", "2", "--torsion-radius", "2cm")),
    ],
)
def test_many_grasps_are_evaluated_in_parts_as_a_whole(
    tmp_path: Path, given: str, words: tuple[str, ...], in_parts: Callable[[], None]
) -> None:
    export(tmp_path / "box.stl", shapes.box((1.0, 2.0, 3.0)))
    points = random_pairs(100)
    write_contacts(tmp_path / "grasps.csv", points)
    write_contacts(tmp_path / "grasps.parquet", points)
    (tmp_path / "grasps.json").write_text(json.dumps(points.tolist()), encoding="utf-8")
    command = ("evaluate", "box.stl", f"grasps.{given}", "--unit", "m", "--force", "--overwrite")
    outputs = ("results.csv", "results.parquet", "results.json")
    whole, parts = {}, {}
    for results in (whole, parts):
        for name in outputs:
            text = printed(*command, *words, "-o", name, cwd=tmp_path)
            results[name] = text, (tmp_path / name).read_bytes()
        in_parts()
    assert len(list(grasp_files.contact_parts(tmp_path / f"grasps.{given}"))) > 2
    for name in outputs[::2]:
        assert whole[name] == parts[name]
    texts, files = zip(whole["results.parquet"], parts["results.parquet"], strict=True)
    one, other = (pq.read_table(BytesIO(file)) for file in files)
    assert texts[0] == texts[1]
    assert one.equals(other, check_metadata=True)
    assert other["grasp"].to_pylist() == list(range(1, 101))


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["csv", "parquet"])
def test_errors_in_a_later_part_name_the_grasp_and_leave_no_file(
    tmp_path: Path, suffix: str, in_parts: Callable[[], None]
) -> None:
    export(tmp_path / "box.stl", shapes.box((1.0, 2.0, 3.0)))
    points, given = random_pairs(100), tmp_path / f"grasps.{suffix}"
    in_parts()
    for value, message in ((9.0, "grasp 96, contact 2 at"), (math.nan, "grasp 96: y2 is empty")):
        points[95, 1, 1] = value
        write_contacts(given, points)
        failed = grasp3d("evaluate", "box.stl", given.name, "-o", "results.csv", cwd=tmp_path)
        assert failed.returncode == 2
        assert message in failed.stderr
        assert {path.name for path in tmp_path.iterdir()} == {"box.stl", given.name}


@pytest.mark.parametrize("suffix", ["csv", "parquet", "json"])
def test_an_interruption_between_parts_leaves_no_file(
    tmp_path: Path, suffix: str, in_parts: Callable[[], None], monkeypatch: pytest.MonkeyPatch
) -> None:
    export(tmp_path / "box.stl", shapes.box((1.0, 2.0, 3.0)))
    write_contacts(tmp_path / "grasps.csv", random_pairs(100))
    in_parts()
    written: list[int] = []

    def interrupted(*given: Any, first: int, **options: Any) -> GraspTable:
        written.append(first)
        if len(written) == 3:
            raise KeyboardInterrupt
        return evaluation.evaluate_contacts(*given, first=first, **options)

    monkeypatch.setattr(evaluated_parts, "evaluate_contacts", interrupted)
    words = ("evaluate", "box.stl", "grasps.csv", "-o", f"results.{suffix}")
    assert grasp3d(*words, cwd=tmp_path).returncode == 130
    assert len(written) == 3
    assert written[1] > 0
    assert {path.name for path in tmp_path.iterdir()} == {"box.stl", "grasps.csv"}


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
    assert "small.stl: 3 poses of gripper franka; friction 0.5" in run.stdout
    for text in (
        "■ S  surely stable +2 +66.7 %",
        "the jaws close on nothing +1 +33.3 %",
        "closed, but the gripper collides +0",
        "closed and reachable +2",
        "held when tried: S 100.0 % of 2, U 0.0 % of 1",
        "3 +■ U +none +none +none +none +-1.00 +nothing",
        "opening in mm",
    ):
        assert re.search(text, run.stdout), text
    rows = pc.read_csv(posed / "out.csv").to_pylist()
    assert [row["label"] for row in rows] == ["S", "S", "U"]
    assert [row["closing"] for row in rows] == ["closed", "closed", "nothing"]
    assert rows[0]["opening"] == pytest.approx(60.0)
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
    assert f"written: {Path('out/labels_grasps.json')}" in text
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
    assert [row[:7] for row in printed_rows(text)] == [
        row[:7] for row in printed_rows(run_again.stdout)
    ]


def test_fewer_grasps_than_requested_are_reported(
    folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(opengl, "can_render", lambda: False)
    text = printed("label", "my box.stl", *TWO_FINGERS, "--best", "5000", cwd=folder)
    count = len(json.loads((folder / "my box_grasps.json").read_text())["grasps"])
    assert f"the {count} best distinct grasps" in text
    assert "5000 were requested; all others are similar to one of these" in text
    few = ("--max-opening", "0.01", "--best", "3", "--overwrite")
    text = printed("label", "my box.stl", *TWO_FINGERS, *few, cwd=folder)
    assert "best grasps: none found" in text
    assert "OpenGL" not in text
    assert json.loads((folder / "my box_grasps.json").read_text())["grasps"] == []


@pytest.mark.slow
@needs_opengl
def test_the_best_grasps_are_drawn(folder: Path) -> None:
    text = printed("label", "my box.stl", *TWO_FINGERS, "--best", "2", cwd=folder)
    assert "written: my box_grasps.json, my box_grasps.png" in text
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
