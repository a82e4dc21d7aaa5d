import json
from functools import cache
from pathlib import Path
from typing import Any

import duckdb
import numpy as np
import pandas as pd
import polars as pl
import pyarrow.parquet as pq
import pytest
import pyvista
import trimesh

import grasp3d
from grasp3d.formats import write_fields
from grasp3d.formats.surface_files import WRITERS, settings_of_header
from grasp3d.stability import COLORS
from grasp3d.surface.vertex_fields import Reason
from tests.helpers import shapes

FIELDS = (
    "x", "y", "z", "nx", "ny", "nz", "red", "green", "blue",
    "label", "critical_angle", "critical_angle_best", "max_resolution", "margin",
    "epsilon", "epsilon_min", "epsilon_max", "opening", "reason",
    "partner_2_x", "partner_2_y", "partner_2_z",
)  # fmt: skip


@cache
def labels() -> grasp3d.SurfaceLabels:
    """S, M and U, creases, and vertices without any grasp."""
    mesh = grasp3d.load_mesh(shapes.cone(0.35), unit="cm", max_edge="0.1cm")
    found = grasp3d.label_surface(
        mesh, grasp3d.GraspModel(friction=0.75), sampling=grasp3d.Sampling(max_opening="3mm")
    )
    assert set(found.label) == {0, 1, 2}
    assert np.isinf(found.critical_angle).any()
    return found


@pytest.mark.slow
def test_ply_contains_exactly_the_documented_properties(tmp_path: Path) -> None:
    plyfile = shapes.reader("plyfile")
    grasp3d.write_ply(tmp_path / "out.ply", labels())
    data = plyfile.PlyData.read(tmp_path / "out.ply")
    vertex = data["vertex"].data
    assert vertex.dtype.names == FIELDS
    assert data.byte_order == "<"
    mesh = labels().mesh
    for k, name in enumerate("xyz"):
        assert np.array_equal(vertex[name], mesh.file_points[:, k])
        assert vertex[f"n{name}"] == pytest.approx(-mesh.normals[:, k], abs=1e-6)
    assert vertex["label"].dtype == np.uint8
    assert np.array_equal(vertex["label"], labels().label)
    for name in FIELDS[FIELDS.index("label") : FIELDS.index("partner_2_x")]:
        values = getattr(labels(), name)
        if name in {"max_resolution", "margin", "opening"}:  # which follow from others
            values = np.float32(values)
        assert vertex[name].dtype == values.dtype
        assert np.array_equal(vertex[name], values, equal_nan=values.dtype.kind == "f")
    assert np.array_equal(np.isnan(vertex["epsilon"]), labels().grip == 0)
    assert np.array_equal(np.vstack(data["face"]["vertex_indices"]), mesh.faces)
    colors = np.stack([vertex[name] for name in ("red", "green", "blue")], axis=1)
    for label in grasp3d.Label:
        assert (colors[vertex["label"] == label] == COLORS[label]).all()


@pytest.mark.slow
def test_ply_comments_say_what_letters_and_lengths_are(tmp_path: Path) -> None:
    scan = grasp3d.scan_surface(labels().mesh, fixed=(0.0, 0.0, 0.0))
    for found, none in ((labels(), "no_grasp_found"), (scan, "surely_unstable")):
        grasp3d.write_ply(tmp_path / "out.ply", found)
        header = (tmp_path / "out.ply").read_bytes().split(b"end_header")[0].decode()
        assert f"0=U({none})" in header
        for line in ("unit cm", "lengths m", "epsilon_rank 5", f"friction {found.model.friction}"):
            assert f"comment grasp3d {line}\n" in header


@pytest.mark.slow
@pytest.mark.parametrize("name", ["open3d", "pymeshlab", "pyvista", "trimesh", "meshio"])
def test_other_programs_read_the_ply_of_a_gripper(tmp_path: Path, name: str) -> None:
    """Its settings are longer than the lines that they read: MeshLab's 512, Open3D's 1,024."""
    reader = shapes.reader(name)
    mesh = grasp3d.load_mesh(shapes.box((4.0, 3.0, 2.0)), unit="cm", max_edge="1.5cm")
    hand = grasp3d.ParallelGripper.preset("franka")
    path = str(tmp_path / "held.ply")
    found = grasp3d.label_surface(mesh, hand=hand, load=grasp3d.Load(mass="0.2 kg"))
    grasp3d.write_ply(path, found)
    header = Path(path).read_bytes().partition(b"end_header")[0]
    lines = header.split(b"\n")
    assert max(map(len, lines)) < 250
    stripped = b"\n".join(line.strip() for line in lines)  # as plyfile does
    assert settings_of_header(stripped) == settings_of_header(header)
    codes: Any = None
    if name == "open3d":
        faces = np.asarray(reader.io.read_triangle_mesh(path).triangles)
        codes = reader.t.io.read_point_cloud(path).point["label"].numpy().ravel()
    elif name == "pymeshlab":
        meshes = reader.MeshSet()
        meshes.load_new_mesh(path)
        faces = meshes.current_mesh().face_matrix()
        colors = np.round(meshes.current_mesh().vertex_color_matrix()[:, :3] * 255.0)
        codes = np.argmax(
            [(colors == COLORS[label]).all(axis=1) for label in grasp3d.Label], axis=0
        )
    elif name == "pyvista":
        faces = reader.read(path).regular_faces
    elif name == "trimesh":
        read = reader.load_mesh(path, process=False)
        faces, codes = read.faces, read.metadata["_ply_raw"]["vertex"]["data"]["label"]
    else:
        faces = reader.read(path).cells_dict["triangle"]
    assert np.array_equal(faces, mesh.faces)
    assert codes is None or np.array_equal(codes, found.label)


def test_vtk_reads_surface_and_colours_of_the_ply_and_everything_of_the_vtp(tmp_path: Path) -> None:
    grasp3d.write_ply(tmp_path / "out.ply", labels())
    mesh = pyvista.read(tmp_path / "out.ply")
    assert mesh.n_points == len(labels().mesh.vertices)
    assert np.array_equal(mesh.regular_faces, labels().mesh.faces)
    assert (
        mesh.point_data["RGB"][labels().label == grasp3d.Label.S] == COLORS[grasp3d.Label.S]
    ).all()
    grasp3d.write_vtp(tmp_path / "out.vtp", labels())
    full = pyvista.read(tmp_path / "out.vtp")
    assert np.array_equal(full.points, labels().mesh.file_points)
    assert np.array_equal(full.point_data["label"], labels().label)
    found = np.isfinite(labels().critical_angle)
    assert np.array_equal(full.point_data["critical_angle"][found], labels().critical_angle[found])
    assert np.isnan(full.point_data["critical_angle"][~found]).all()
    for name in ("epsilon", "epsilon_min", "epsilon_max"):
        assert np.array_equal(full.point_data[name], getattr(labels(), name), equal_nan=True)
    assert full.field_data["setting_epsilon_min"][0] == "exact"
    assert full.point_data["partner_2"].shape == (mesh.n_points, 3)
    assert full.field_data["setting_friction"][0] == "0.75"


@pytest.mark.slow
@pytest.mark.parametrize("name", ["tasse\u00e9 \u7269.ply", "two\nlines.ply"])
def test_names_with_odd_characters_break_no_header(tmp_path: Path, name: str) -> None:
    plyfile = shapes.reader("plyfile")
    trimesh.creation.icosphere(2).export(tmp_path / name)
    found = grasp3d.label_surface(grasp3d.load_mesh(tmp_path / name, max_edge=9.0))
    for suffix, write in WRITERS.items():
        write(tmp_path / f"out{suffix}", found)
    data = plyfile.PlyData.read(tmp_path / "out.ply")
    assert f"grasp3d source {name.encode('unicode_escape').decode()}" in data.comments
    assert pyvista.read(tmp_path / "out.vtp").n_points == len(found.label)


NUMBERS = (
    "critical_angle", "critical_angle_best", "max_resolution", "margin", "epsilon", "epsilon_min",
    "epsilon_max", "opening", "grip",
)  # fmt: skip


@pytest.mark.slow
def test_other_libraries_read_a_row_for_each_vertex(tmp_path: Path) -> None:
    path = tmp_path / "out.parquet"
    write_fields(path, labels())
    mesh = labels().mesh
    table = duckdb.read_parquet(str(path))
    for read in (pd.read_parquet(path), pl.read_parquet(path), table.df()):
        for k, axis in enumerate("xyz"):
            assert np.array_equal(np.asarray(read[axis]), mesh.file_points[:, k])
            assert np.asarray(read[f"n{axis}"]) == pytest.approx(-mesh.normals[:, k], abs=1e-6)
            partner = np.asarray(read[f"partner_2_{axis}"])
            assert np.array_equal(partner, labels().partners[:, 0, k], equal_nan=True)
            normal = np.asarray(read[f"partner_2_n{axis}"])
            known = -labels().partner_normals[:, 0, k]
            assert np.array_equal(normal, known, equal_nan=True)
        assert np.asarray(read["area"]).sum() == pytest.approx(mesh.vertex_areas.sum())
        for name in NUMBERS:
            known = getattr(labels(), name)
            assert np.array_equal(np.asarray(read[name]), known, equal_nan=True)
        codes = [{"U": 0, "M": 1, "S": 2}[label] for label in read["label"]]
        assert np.array_equal(codes, labels().label)
        reasons = [Reason[reason.upper()] for reason in read["reason"]]
        assert np.array_equal(reasons, labels().reason)


@pytest.mark.slow
def test_the_schema_has_small_codes_all_digits_and_the_settings(tmp_path: Path) -> None:
    write_fields(tmp_path / "out.parquet", labels())
    file = pq.ParquetFile(tmp_path / "out.parquet")
    kinds = {field.name: str(field.type) for field in file.schema_arrow}
    assert list(kinds)[:8] == ["x", "y", "z", "nx", "ny", "nz", "area", "label"]
    assert (kinds["x"], kinds["epsilon"], kinds["grip"]) == ("double", "double", "int8")
    assert kinds["label"].startswith("dictionary<values=string")
    assert file.metadata.row_group(0).column(0).compression == "ZSTD"
    written = json.loads(file.schema_arrow.metadata[b"grasp3d"])
    assert (written["friction"], written["unit"], written["max_opening"]) == (0.75, "cm", 0.003)
    assert sum(file.read().column(name).null_count for name in kinds) == 0
