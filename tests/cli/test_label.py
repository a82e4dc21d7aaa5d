"""`grasp3d label`, and errors of all commands, in a process of its own."""

import math
import re
import subprocess
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import pyvista
import trimesh

from grasp3d import GraspModel, Label, Sampling, label_surface, load_mesh, read_labels
from grasp3d.pictures.subject import subject_of
from grasp3d.viewer.inspection import inspect
from tests.helpers import shapes
from tests.helpers.commands import COMMAND, export, printed
from tests.helpers.commands import run_process as grasp3d


@pytest.mark.slow
def test_label_writes_the_ply_and_prints_the_fractions(tmp_path: Path) -> None:
    export(tmp_path / "in" / "my box.stl", shapes.box((0.06, 0.04, 0.1)))
    run = grasp3d("label", "in/my box.stl", "--unit", "m", "--friction", "1", cwd=tmp_path)
    assert (run.returncode, run.stderr) == (0, "")
    assert re.search(r"S +surely stable +9\d\.\d %", run.stdout)
    assert "no grasp found" in run.stdout
    mesh = trimesh.load_mesh(tmp_path / "my box_labeled.ply", process=False)
    labels = mesh.metadata["_ply_raw"]["vertex"]["data"]["label"]
    assert set(labels) == {1, 2}
    assert sorted(p.name for p in tmp_path.iterdir()) == ["in", "my box_labeled.ply"]


@pytest.mark.slow
def test_angles_are_degrees_on_the_command_line(tmp_path: Path) -> None:
    source = export(tmp_path / "ball.ply", shapes.sphere(2))
    arguments = ("--sensor-resolution", "30", "--friction", "0.2")
    printed("label", source, "-o", "out.npz", "--max-edge", "9", *arguments, cwd=tmp_path)
    with np.load(tmp_path / "out.npz") as data:
        assert float(str(data["setting_sensor_resolution"])) == pytest.approx(math.radians(30.0))
        assert set(data["label"]) == {1}  # 15 degrees of tilt against 11.3 of friction


OPTIONS: dict[str, tuple[list[str], dict[str, str]]] = {
    "usual": ([], {"epsilon_min": "exact", "epsilon_rank": "5"}),
    "soft": (
        ["--torsion-radius", "0.05"],
        {"torsion_radius": "0.05", "epsilon_min": "bound", "epsilon_rank": "6"},
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("name", OPTIONS)
def test_epsilon_is_written_and_printed_as_the_options_define(tmp_path: Path, name: str) -> None:
    source = export(tmp_path / "ball.ply", shapes.sphere(2))
    options, settings = OPTIONS[name]
    text = printed("label", source, "-o", "out.npz", "--max-edge", "9", *options, cwd=tmp_path)
    numbers = r"(\d\.\d{3}), (\d\.\d{3}), (\d\.\d{3})"
    shown = re.search(f"10/50/90 % of the area: .*; ε {numbers}; ε_min {numbers}", text)
    assert shown
    with np.load(tmp_path / "out.npz") as data:
        for key, value in settings.items():
            assert str(data[f"setting_{key}"]) == value
        assert (data["epsilon_min"] > 0.0).all()
        assert data["epsilon"].min() - 1e-3 <= float(shown[2]) <= data["epsilon"].max() + 1e-3
        assert float(shown[5]) < float(shown[2])


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["ply", "glb", "npz", "vtp", "parquet"])
def test_every_format_has_the_labels(tmp_path: Path, suffix: str) -> None:
    source, output = export(tmp_path / "cone.ply", shapes.cone(0.35)), tmp_path / f"out.{suffix}"
    words = ("--friction", "0.75", "--max-edge", "0.2", "--max-opening", "0.3", "-q")
    assert printed("label", source, "-o", output, *words, cwd=tmp_path) == ""
    mesh, model = load_mesh(source, max_edge=0.2), GraspModel(friction=0.75)
    expected = label_surface(mesh, model, sampling=Sampling(max_opening=0.3)).label
    assert set(expected) == {0, 1, 2}
    if suffix == "glb":  # the colours of the legend, linear
        colors = trimesh.load_scene(output, process=False).to_mesh().visual.vertex_colors
        shown = {(label, *color) for label, color in zip(expected, colors.tolist(), strict=True)}
        assert len(shown) == len({color[1:] for color in shown}) == 3
    elif suffix == "vtp":
        assert np.array_equal(pyvista.read(output).point_data["label"], expected)
    elif suffix == "parquet":
        letters = pq.read_table(output)["label"].to_pylist()
        assert letters == ["UMS"[code] for code in expected]
    else:
        assert np.array_equal(read_labels(output).label, expected)


def test_a_closed_output_pipe_is_not_an_error(tmp_path: Path) -> None:
    run = subprocess.run(  # noqa: S602
        f"'{COMMAND}' batch --help | head -n 1",
        check=False, capture_output=True, text=True, shell=True, cwd=tmp_path,
    )  # fmt: skip
    assert run.stdout.startswith("usage: grasp3d batch")
    assert run.stderr == ""


@pytest.mark.slow
def test_a_vertex_is_explained_as_in_the_viewer(tmp_path: Path) -> None:
    """On the side of a box, and at its corner on the table."""
    source = export(tmp_path / "box.stl", shapes.box((60.0, 40.0, 20.0)))
    at = ("--at", "0,2cm,0", "--at", "30mm,20mm,-10mm")
    options = ("--unit", "mm", "--max-edge", "10mm", "--hand", "franka", "--table", "as-is")
    text = printed("label", source, *options, *at, "-o", "out.npz", cwd=tmp_path)
    text = text[: text.index("written: ")]
    side, corner = text.split("at 0,2cm,0: ")[1].split("at 30mm,20mm,-10mm: ")
    labels = read_labels(tmp_path / "out.npz")
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
    answer = printed("label", source, *options, *at, "-q", "-o", "quiet.npz", cwd=tmp_path)
    assert answer == text[text.index("at 0,2cm,0") :]
