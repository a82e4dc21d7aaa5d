from functools import cache
from pathlib import Path

import numpy as np
import pyarrow.parquet as pq
import pytest
import pyvista

from grasp3d import MeshOptions, load_mesh
from grasp3d.cli.existing_files import is_result
from grasp3d.errors import OutputError
from grasp3d.export.stored import stored_settings
from grasp3d.system.tables import read_columns
from grasp3d.validating.perturbing import (
    NoiseSettings,
    Perturbation,
    perturb_surface,
    write_perturbation,
)
from tests.helpers import shapes


@cache
def found() -> Perturbation:
    ball = shapes.sphere(2)
    return perturb_surface(
        ball, noise=NoiseSettings(noise=0.02, copies=3), options=MeshOptions(max_edge=9.0)
    )


@pytest.mark.slow
@pytest.mark.parametrize("suffix", [".csv", ".parquet"])
def test_tables_have_a_row_for_each_vertex(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"noise{suffix}"
    write_perturbation(path, found())
    columns = read_columns(path)
    assert list(columns) == ["x", "y", "z", *found().columns()]
    np.testing.assert_allclose(columns["x"], found().mesh.vertices[:, 0])
    for name, values in found().columns().items():
        np.testing.assert_allclose(columns[name], values, err_msg=name)
    assert is_result(path)


def test_a_ply_is_an_ordinary_mesh_with_settings(tmp_path: Path) -> None:
    path = tmp_path / "noise.ply"
    write_perturbation(path, found())
    mesh = load_mesh(path, max_edge=9.0)
    np.testing.assert_array_equal(mesh.vertices, found().mesh.vertices)
    assert pyvista.read(path).n_points == len(mesh.vertices)
    header = path.read_bytes().partition(b"end_header")[0].decode()
    for name in found().columns():
        assert f"property float {name}\n" in header
    settings = stored_settings(path)
    assert settings is not None
    assert (settings["noise"], settings["copies"], settings["noise_from"]) == ("0.02", "3", "given")
    assert float(settings["advised_normal_error"]) == found().advice.normal_error


def test_parquet_has_the_settings(tmp_path: Path) -> None:
    write_perturbation(tmp_path / "a.parquet", found())
    assert b'"noise": 0.02' in pq.read_schema(tmp_path / "a.parquet").metadata[b"grasp3d"]


def test_other_formats_are_refused_and_nothing_is_left(tmp_path: Path) -> None:
    with pytest.raises(OutputError, match=r"supported are \.ply \.csv \.parquet"):
        write_perturbation(tmp_path / "noise.stl", found())
    with pytest.raises(OutputError):
        write_perturbation(tmp_path / "missing" / "noise.ply", found())
    assert not list(tmp_path.iterdir())
