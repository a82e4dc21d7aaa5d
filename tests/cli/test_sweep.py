"""`grasp3d sweep`, its targets and its resolutions."""

import json
import math
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow.csv as pc
import pyarrow.parquet as pq
import pytest

from grasp3d import GraspModel, Sampling, label_surface, load_mesh
from grasp3d.cli.sweep import angles_in, find_targets, frictions_in
from grasp3d.errors import MeshError, SettingError
from tests.helpers import shapes
from tests.helpers.commands import export, printed
from tests.helpers.commands import run_process as real_grasp3d

QUICK = ("--max-edge", "inf")


def rows_of(path: Path) -> list[dict[str, Any]]:
    table = pc.read_csv(path) if path.suffix == ".csv" else pq.read_table(path)
    return list(table.to_pylist())


@pytest.mark.slow
def test_a_file_is_swept_into_a_table_and_a_figure(tmp_path: Path) -> None:
    source = export(tmp_path / "in" / "my blob.stl", shapes.lopsided())
    text = printed("sweep", "in/my blob.stl", "--unit", "cm", *QUICK, cwd=tmp_path)
    assert "U no grasp found" in text
    assert "surely unstable" not in text
    assert "written: my blob_sweep.csv, my blob_sweep.svg" in text
    model = GraspModel(friction=1.0, sensor_resolution=math.radians(60.0))
    mesh = load_mesh(source, unit="cm", max_edge=9.0)
    labels = label_surface(mesh, model, sampling=Sampling(rays=16))
    rows = rows_of(tmp_path / "my blob_sweep.csv")
    assert len(rows) == 3 * 62
    for row in rows:
        again = labels.relabel(
            friction=row["friction"], sensor_resolution=row["sensor_resolution"]
        ).fractions()
        fractions = (row["stable"], row["ambiguous"], row["unstable"])
        assert fractions == pytest.approx(tuple(again.values()), abs=1e-9)
        assert row["accuracy_ceiling"] == pytest.approx(1.0 - again["M"] / 2.0)
    required = rows[62]["required_resolution_50"]
    assert (rows[62]["friction"], rows[62]["name"]) == (0.5, "my blob.stl")
    assert f"{math.degrees(required):.1f}°" in text
    assert labels.relabel(friction=0.5, sensor_resolution=required - 1e-6).fractions()["S"] >= 0.5
    assert "</svg>" in (tmp_path / "my blob_sweep.svg").read_text(encoding="utf-8")


@pytest.mark.slow
def test_a_folder_with_a_broken_mesh_has_the_mean_of_the_others(tmp_path: Path) -> None:
    export(tmp_path / "in" / "ball.ply", shapes.sphere(2))
    export(tmp_path / "in" / "deep" / "box.stl", shapes.box())
    (tmp_path / "in" / "bad.obj").write_text("nonsense", encoding="ascii")
    words = ("-o", "out.parquet", "--workers", "1", "--friction", "0.5", "--sensor-resolution")
    done = real_grasp3d("sweep", "in", "in/ball.ply", *words, "0", "20", "60", *QUICK, cwd=tmp_path)
    assert (done.returncode, "Traceback" in done.stderr) == (1, False)
    assert "failed: in/bad.obj: " in done.stdout
    assert "2 swept, 1 failed" in done.stdout
    *swept, failed = sorted(rows_of(tmp_path / "out.parquet"), key=lambda row: row["error"] or "")
    names = ("ball.ply", "deep/box.stl", "mean of 2 meshes")
    assert [row["name"] for row in swept] == [name for name in names for _ in "abc"]
    ball, box, mean = (np.array([row["stable"] for row in swept[k : k + 3]]) for k in (0, 3, 6))
    assert mean == pytest.approx((ball + box) / 2.0)
    assert failed["name"] == "bad.obj"
    settings = json.loads(pq.read_schema(tmp_path / "out.parquet").metadata[b"grasp3d"])
    assert settings["friction"] == [0.5]
    assert (tmp_path / "out.svg").stat().st_size > 10_000


@pytest.mark.slow
def test_shapes_have_fractions_in_closed_form(tmp_path: Path) -> None:
    words = ("--friction", "0.1:1:0.1", "--fraction", "0.1")
    text = printed("sweep", "circle", "square", "sphere", *words, cwd=tmp_path)
    cells = {line.split()[1]: line.split() for line in text.splitlines() if "circle " in line}
    assert cells["0.1"][-1] == "–"  # 6.3 % of the circle are S with exact normals
    assert cells["0.2"][-1] == "4.6°"  # 2 atan(0.2) - pi / 10
    assert cells["0.1"][2] == "6/0/94"
    assert "U surely unstable" in text
    rows = rows_of(tmp_path / "sweep.csv")
    assert list(dict.fromkeys(row["name"] for row in rows)) == ["circle", "square", "sphere"]
    for row in rows:
        known = max(0.0, math.atan(row["friction"]) - row["sensor_resolution"] / 2.0)
        stable = {"circle": 2.0 * known / math.pi, "sphere": math.sin(known) ** 2}
        if row["name"] in stable:
            assert row["stable"] == pytest.approx(stable[row["name"]], abs=1e-12)
    assert {row["mode"] for row in rows} == {"scan"}


def test_resolutions_are_numbers_and_ranges_with_both_ends() -> None:
    degrees = [math.degrees(value) for value in angles_in(("22.6", "0:60:2.5", "5", "0:1:0.1"))]
    expected = sorted({22.6, *(2.5 * k for k in range(25)), *(0.1 * k for k in range(11))})
    assert degrees == pytest.approx(expected, abs=1e-9)
    assert angles_in(("7:7:1",)) == (math.radians(7.0),)
    assert angles_in(("0:10:4",)) == pytest.approx(np.radians([0.0, 4.0, 8.0]))
    assert frictions_in(("0.1", "0.1:0.3:0.1")) == pytest.approx((0.1, 0.2, 0.3))
    assert angles_in(("180", "0.3 RAD")) == (0.3, math.pi)
    for word in ("", "a", "1:2", "0:1:2:3", "3:1:1", "0:1:-1", "0:inf:1", "nan:1:1", "0:60:1e-6"):
        with pytest.raises(SettingError, match="FROM:TO:STEP"):
            angles_in((word,))


def test_shapes_are_found_before_files_and_meshes_once(tmp_path: Path) -> None:
    one = export(tmp_path / "one" / "mug.stl", shapes.sphere(0))
    two = export(tmp_path / "two" / "mug.stl", shapes.sphere(0))
    export(tmp_path / "two" / "cup.stl", shapes.sphere(0))
    folder = str(tmp_path / "two")
    found, meshes = find_targets([str(one), "circle", folder, str(two), "circle", f"{folder}/"])
    assert found == ["circle"]
    assert [mesh.name for mesh in meshes] == [str(one), str(two), "cup.stl"]
    assert find_targets(["square"]) == (["square"], [])
    with pytest.raises(MeshError, match="no such file"):
        find_targets([str(tmp_path / "square")])
