"""Which existing files a command replaces."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from grasp3d import GraspModel, Sampling, label_surface, load_mesh, write_npz
from grasp3d.cli.existing_files import check_same_settings, is_result
from grasp3d.errors import OutputError
from grasp3d.export.stored import stored_settings
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.primitives import box_mesh
from grasp3d.surface.labelling import Labelling
from tests.helpers import shapes
from tests.helpers.commands import export, printed
from tests.helpers.commands import run_here as grasp3d

COARSE = ("--max-edge", "inf", "--unit", "m")


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    export(tmp_path / "box.stl", shapes.box((0.04, 0.06, 0.08)))
    export(tmp_path / "ball.stl", shapes.sphere(1, 0.03))
    return tmp_path


@pytest.mark.slow
@pytest.mark.parametrize("suffix", ["ply", "glb", "npz", "vtp", "parquet"])
def test_labels_made_with_other_settings_are_not_replaced(folder: Path, suffix: str) -> None:
    words, output = ("-o", f"out.{suffix}", *COARSE), folder / f"out.{suffix}"
    assert grasp3d("label", "box.stl", *words, cwd=folder).returncode == 0
    first = output.read_bytes()
    printed("label", "box.stl", *words, "--max-memory", "3", cwd=folder)
    first = output.read_bytes()
    for changed, reason in (
        (["box.stl", "--max-opening", "7cm"], "max_opening inf m, not 0.07 m"),
        (["box.stl", "--sensor-resolution", "30"], "sensor_resolution 22.6°, not 30°"),
        (["ball.stl"], "source box.stl, not ball.stl"),
    ):
        other = grasp3d("label", *changed, *words, cwd=folder)
        assert (other.returncode, other.stdout) == (2, "")
        assert f"exists with labels made otherwise ({reason})" in other.stderr
        assert output.read_bytes() == first
    assert grasp3d("label", "ball.stl", *words, "--overwrite", cwd=folder).returncode == 0
    assert output.read_bytes() != first


def task(mesh: ObjectMesh, sampling: Sampling) -> Labelling:
    return Labelling(mesh, GraspModel(), sampling, scene=None, load=None)


def test_labels_of_another_mesh_of_the_same_name_are_not_replaced(tmp_path: Path) -> None:
    path = tmp_path / "out.npz"
    boxes = (1.0, 1.0, 1.0), (2.0, 2.0, 2.0)
    small, large = (load_mesh(shapes.box(sides), max_edge=9.0) for sides in boxes)
    ball = load_mesh(shapes.sphere(1), max_edge=9.0)
    sampling = Sampling(rays=8, max_opening=80)
    write_npz(path, label_surface(small, sampling=sampling))
    same = replace(sampling, max_opening=80.0)
    check_same_settings(path, task(small, same), overwrite=False)
    check_same_settings(path, task(large, same), overwrite=True)
    for other in (large, ball):
        with pytest.raises(OutputError, match=r"\(of another mesh called arrays\); name another"):
            check_same_settings(path, task(other, same), overwrite=False)
    with pytest.raises(OutputError, match=r"\(rays 8, not 16\)"):
        check_same_settings(path, task(small, replace(same, rays=16)), overwrite=False)


@pytest.mark.slow
def test_results_replace_earlier_results_and_others_if_that_is_wanted(folder: Path) -> None:
    for suffix, figure in (("csv", "svg"), ("parquet", "png"), ("csv", "pdf")):
        words = ("sweep", "circle", "-o", f"out.{suffix}", "--figure", f"out.{figure}")
        for friction in ("0.5", "0.6"):
            assert grasp3d(*words, "--friction", friction, cwd=folder).returncode == 0
    (folder / "notes.csv").write_text("name,price\n", encoding="utf-8")
    printed("sweep", "circle", "-o", "notes.csv", "--overwrite", cwd=folder)
    assert is_result(folder / "notes.csv")
    for _ in range(2):
        for suffix in ("csv", "json"):
            assert grasp3d("check", "box.stl", "-o", f"check.{suffix}", cwd=folder).stderr == ""


def test_settings_are_not_read_from_damaged_files(tmp_path: Path) -> None:
    labels = label_surface(box_mesh(max_edge=9.0), sampling=Sampling(rays=8))
    write_npz(tmp_path / "whole.npz", labels)
    stored = stored_settings(tmp_path / "whole.npz")
    assert stored is not None
    assert stored["rays"] == "8"
    data = (tmp_path / "whole.npz").read_bytes()
    np.savez(tmp_path / "other.npz", vertices=np.zeros(3))
    for name in ("cut.npz", "cut.ply", "cut.glb", "cut.vtp", "cut.parquet", "cut.json"):
        (tmp_path / name).write_bytes(data[:200])
        assert stored_settings(tmp_path / name) is None
    assert stored_settings(tmp_path / "other.npz") is None
