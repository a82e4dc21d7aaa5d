import math
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import pyvista
import trimesh

from grasp3d import (
    GraspModel,
    Label,
    Load,
    ParallelGripper,
    Sampling,
    SurfaceLabels,
    label_surface,
    load_mesh,
    scan_surface,
    write_npz,
    write_ply,
    write_vtp,
)
from grasp3d.formats.surface_files import WRITERS, settings_of_header
from grasp3d.stability import COLORS
from tests.helpers import shapes, viewing

FIELDS = (
    "x", "y", "z", "nx", "ny", "nz", "red", "green", "blue",
    "label", "critical_angle", "critical_angle_best", "max_resolution", "margin",
    "epsilon", "epsilon_min", "epsilon_max", "opening", "reason",
    "partner_2_x", "partner_2_y", "partner_2_z",
)  # fmt: skip


@cache
def labels() -> SurfaceLabels:
    """S, M and U, creases, and vertices without any grasp."""
    mesh = load_mesh(shapes.cone(0.35), unit="cm", max_edge="0.05cm")
    found = label_surface(mesh, GraspModel(friction=0.75), sampling=Sampling(max_opening="3mm"))
    assert set(found.label) == {0, 1, 2}
    assert np.isinf(found.critical_angle).any()
    return found


@pytest.mark.slow
def test_ply_contains_exactly_the_documented_properties(tmp_path: Path) -> None:
    plyfile = shapes.reader("plyfile")
    write_ply(tmp_path / "out.ply", labels())
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
    for label in Label:
        assert (colors[vertex["label"] == label] == COLORS[label]).all()


@pytest.mark.slow
def test_ply_comments_contain_the_settings(tmp_path: Path) -> None:
    write_ply(tmp_path / "out.ply", labels())
    header = (tmp_path / "out.ply").read_bytes().split(b"end_header")[0].decode()
    assert "comment grasp3d friction 0.75\n" in header
    assert f"comment grasp3d sensor_resolution {GraspModel().sensor_resolution}\n" in header
    for line in (
        "unit cm",
        "lengths m",
        "max_opening 0.003",
        "min_opening 0.0",
        "rays 64",
        "grip squeeze",
    ):
        assert f"comment grasp3d {line}\n" in header
    assert f"comment grasp3d rays_traced {labels().search.rays}\n" in header
    assert "comment grasp3d crease_angle 0.52" in header
    for line in (
        "torsion_radius 0.0", "epsilon_rank 5",
        "epsilon_rtol 0.01", "epsilon_min exact", "epsilon_max upper_bound",
        f"torque_scale {labels().mesh.torque_scale}",
    ):  # fmt: skip
        assert f"comment grasp3d {line}\n" in header
    assert "0=U(no_grasp_found)" in header
    scan = scan_surface(labels().mesh, fixed=(0.0, 0.0, 0.0))
    write_ply(tmp_path / "scan.ply", scan)
    assert b"0=U(surely_unstable)" in (tmp_path / "scan.ply").read_bytes()


@pytest.mark.slow
def test_files_state_how_the_minimum_over_the_tilts_is_computed(tmp_path: Path) -> None:
    soft = GraspModel(torsion_radius=0.1)
    mesh = load_mesh(shapes.sphere(2), max_edge=9.0)
    write_ply(tmp_path / "out.ply", label_surface(mesh, soft))
    header = (tmp_path / "out.ply").read_bytes().split(b"end_header")[0].decode()
    for line in ("torsion_radius 0.1", "epsilon_rank 6", "epsilon_min bound"):
        assert f"comment grasp3d {line}\n" in header


def test_trimesh_reads_the_ply(tmp_path: Path) -> None:
    write_ply(tmp_path / "out.ply", labels())
    mesh = trimesh.load_mesh(tmp_path / "out.ply", process=False)
    assert np.array_equal(mesh.faces, labels().mesh.faces)
    raw = mesh.metadata["_ply_raw"]["vertex"]["data"]
    assert np.array_equal(raw["label"], labels().label)
    assert np.array_equal(raw["critical_angle"], labels().critical_angle)


@pytest.mark.slow
def test_open3d_reads_the_ply_with_its_fields(tmp_path: Path) -> None:
    open3d = shapes.reader("open3d")
    write_ply(tmp_path / "out.ply", labels())
    cloud = open3d.t.io.read_point_cloud(str(tmp_path / "out.ply"))
    assert np.array_equal(cloud.point["label"].numpy().ravel(), labels().label)
    angles = cloud.point["critical_angle"].numpy().ravel()
    assert np.array_equal(angles, labels().critical_angle)
    mesh = open3d.io.read_triangle_mesh(str(tmp_path / "out.ply"))
    assert len(mesh.triangles) == len(labels().mesh.faces)
    assert mesh.has_vertex_colors()


def test_meshlab_reads_surface_and_colours_of_the_ply(tmp_path: Path) -> None:
    """MeshLab's reader ignores properties that are unknown to it."""
    pymeshlab = shapes.reader("pymeshlab")
    write_ply(tmp_path / "out.ply", labels())
    meshes = pymeshlab.MeshSet()
    meshes.load_new_mesh(str(tmp_path / "out.ply"))
    mesh = meshes.current_mesh()
    assert mesh.vertex_matrix() == pytest.approx(labels().mesh.file_points)
    assert np.array_equal(mesh.face_matrix(), labels().mesh.faces)
    colors = np.round(mesh.vertex_color_matrix()[:, :3] * 255.0)
    assert (colors[labels().label == Label.S] == COLORS[Label.S]).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", ["open3d", "pymeshlab", "pyvista", "trimesh", "meshio"])
def test_other_programs_read_the_ply_of_a_gripper(tmp_path: Path, name: str) -> None:
    """Its settings are longer than the lines that they read: MeshLab's 512, Open3D's 1,024."""
    reader = shapes.reader(name)
    mesh = load_mesh(shapes.box((4.0, 3.0, 2.0)), unit="cm", max_edge="1.5cm")
    hand = ParallelGripper.preset("franka")
    path = str(tmp_path / "held.ply")
    write_ply(path, label_surface(mesh, hand=hand, load=Load(mass="0.2 kg")))
    header = Path(path).read_bytes().partition(b"end_header")[0]
    lines = header.split(b"\n")
    assert max(map(len, lines)) < 250
    stripped = b"\n".join(line.strip() for line in lines)  # as plyfile does
    assert settings_of_header(stripped) == settings_of_header(header)
    if name == "open3d":
        faces = np.asarray(reader.io.read_triangle_mesh(path).triangles)
    elif name == "pymeshlab":
        meshes = reader.MeshSet()
        meshes.load_new_mesh(path)
        faces = meshes.current_mesh().face_matrix()
    elif name == "pyvista":
        faces = reader.read(path).regular_faces
    elif name == "trimesh":
        faces = reader.load_mesh(path, process=False).faces
    else:
        faces = reader.read(path).cells_dict["triangle"]
    assert np.array_equal(faces, mesh.faces)


def test_vtk_reads_surface_and_colours_of_the_ply_and_everything_of_the_vtp(tmp_path: Path) -> None:
    write_ply(tmp_path / "out.ply", labels())
    mesh = pyvista.read(tmp_path / "out.ply")
    assert mesh.n_points == len(labels().mesh.vertices)
    assert np.array_equal(mesh.regular_faces, labels().mesh.faces)
    assert (mesh.point_data["RGB"][labels().label == Label.S] == COLORS[Label.S]).all()
    write_vtp(tmp_path / "out.vtp", labels())
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
    found = label_surface(load_mesh(tmp_path / name, max_edge=9.0))
    for suffix, write in WRITERS.items():
        write(tmp_path / f"out{suffix}", found)
    data = plyfile.PlyData.read(tmp_path / "out.ply")
    assert f"grasp3d source {name.encode('unicode_escape').decode()}" in data.comments
    assert pyvista.read(tmp_path / "out.vtp").n_points == len(found.label)


def test_npz_contains_every_array(tmp_path: Path) -> None:
    write_npz(tmp_path / "out.npz", labels())
    with np.load(tmp_path / "out.npz") as data:
        for name in (
            "label", "critical_angle", "partners", "opening", "grip", "reason",
            "epsilon", "epsilon_min", "epsilon_max",
        ):  # fmt: skip
            assert np.array_equal(data[name], getattr(labels(), name), equal_nan=True)
        assert np.array_equal(data["faces"], labels().mesh.faces)
        assert str(data["setting_friction"]) == "0.75"
        assert str(data["setting_epsilon_min"]) == "exact"


@pytest.mark.slow
def test_coordinates_far_from_the_origin_keep_their_digits(tmp_path: Path) -> None:
    vertices, faces = shapes.sphere(2)
    far = label_surface(load_mesh((vertices + 1e6, faces), max_edge=9.0))
    write_ply(tmp_path / "far.ply", far)
    mesh = trimesh.load_mesh(tmp_path / "far.ply", process=False)
    assert np.array_equal(mesh.vertices[: len(vertices)], vertices + 1e6)


def test_an_interrupted_writing_leaves_the_old_file(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    path = tmp_path / "out.npz"
    path.write_text("old", encoding="ascii")

    def interrupted(stream: Any, **_: Any) -> None:
        stream.write(b"half a file")
        raise KeyboardInterrupt

    monkeypatch.setattr(np, "savez_compressed", interrupted)
    with pytest.raises(KeyboardInterrupt):
        write_npz(path, labels())
    assert path.read_text(encoding="ascii") == "old"
    assert list(tmp_path.iterdir()) == [path]


@pytest.mark.parametrize("location_error", [0.0, 1e-4])
def test_margins_decide_the_labels_of_every_file(tmp_path: Path, location_error: float) -> None:
    found = viewing.located(location_error).relabel(friction=(0.65, 0.75))
    write_npz(tmp_path / "out.npz", found)
    with np.load(tmp_path / "out.npz") as data:
        arrays = {name: data[name] for name in data.files}
    assert ((arrays["margin"] > 0.0) == (arrays["label"] == 2)).all()
    assert ((arrays["margin"] == -math.inf) == np.isinf(arrays["critical_angle"])).all()
    alpha = found.model.sensor_resolution
    coarsest = np.maximum(alpha + 2.0 * arrays["margin"], 0.0)
    assert np.allclose(arrays["max_resolution"], coarsest, atol=1e-12)
    assert np.allclose(arrays["margin"], found.model.sure_angle - arrays["critical_angle"])
    assert str(arrays["setting_friction"]) == "0.65..0.75"
