"""Results as tables of Arrow and pandas, as trimesh and as PyVista data: the same as in files."""

from pathlib import Path

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import pyvista

from grasp3d import (
    SurfaceLabels,
    best_grasps,
    label_surface,
    load_mesh,
    sweep,
    write_fields,
    write_grasps,
    write_npz,
    write_vtp,
)
from grasp3d.errors import OutputError, SettingError
from grasp3d.stability import COLORS, Label
from grasp3d.surface import GraspTable
from grasp3d.surface.vertex_fields import VERTICES
from grasp3d.viewer.collection import collection_of_grasps
from grasp3d.viewer.inspection import inspect_given
from tests.helpers import shapes


@pytest.fixture(scope="module")
def labels() -> SurfaceLabels:
    return label_surface(load_mesh(shapes.box((1.0, 0.7, 0.5)), unit="cm", max_edge="0.3cm"))


@pytest.fixture(scope="module")
def grasps(labels: SurfaceLabels) -> GraspTable:
    return best_grasps(labels, 3)


def test_the_table_of_labels_is_that_of_the_file(labels: SurfaceLabels, tmp_path: Path) -> None:
    write_fields(tmp_path / "fields.parquet", labels)
    table, written = labels.to_table(), pq.read_table(tmp_path / "fields.parquet")
    assert table.schema.equals(written.schema, check_metadata=True)
    assert table.drop_columns(floats(table)).equals(written.drop_columns(floats(written)))
    scale = dict.fromkeys("xyz", labels.mesh.file_scale)  # the file has its own coordinates
    for name in floats(table):  # nan is no equal of nan
        in_metres = scale.get(name, 1.0) * written[name].to_numpy()
        np.testing.assert_array_equal(table[name].to_numpy(), in_metres)
    assert table.num_rows == len(labels.mesh.vertices)


def floats(table: pa.Table) -> list[str]:
    return [field.name for field in table.schema if pa.types.is_floating(field.type)]


def test_the_data_frame_of_labels_has_categories(labels: SurfaceLabels) -> None:
    frame = labels.to_dataframe()
    assert list(frame.columns) == labels.to_table().column_names
    assert list(frame["label"].cat.categories) == ["U", "M", "S"]
    by_area = frame.groupby("label", observed=False)["area"].sum() / frame["area"].sum()
    assert by_area.to_dict() == pytest.approx(labels.fractions(), abs=1e-6)


def test_a_trimesh_of_labels_has_colours_unit_and_every_array(
    labels: SurfaceLabels, tmp_path: Path
) -> None:
    made = labels.to_trimesh()
    np.testing.assert_array_equal(made.vertices, labels.mesh.vertices)
    np.testing.assert_array_equal(made.faces, labels.mesh.faces)
    np.testing.assert_allclose(made.vertex_normals, -labels.mesh.normals)
    expected = [(*COLORS[Label(code)], 255) for code in labels.label.tolist()]
    np.testing.assert_array_equal(made.visual.vertex_colors, expected)
    write_npz(tmp_path / "labels.npz", labels)
    stored = np.load(tmp_path / "labels.npz")
    fields = {name: field for field in VERTICES for name in field.point_names(2)}
    for name, values in made.vertex_attributes.items():
        np.testing.assert_array_equal(values, stored[fields[name].name].reshape(values.shape))
    assert {fields[name].name for name in made.vertex_attributes} == {
        name for name in stored.files if name in {field.name for field in VERTICES}
    } - {"vertices", "color"}
    assert made.metadata["grasp3d"]["friction"] == 0.5
    again = load_mesh(made, max_edge=9.0)
    assert again.unit == made.units == "m"
    np.testing.assert_array_equal(again.vertices, labels.mesh.vertices)


def test_polydata_of_labels_is_that_of_the_file(labels: SurfaceLabels, tmp_path: Path) -> None:
    write_vtp(tmp_path / "labels.vtp", labels)
    made, written = labels.to_polydata(), pyvista.read(tmp_path / "labels.vtp")
    np.testing.assert_array_equal(made.points, labels.mesh.vertices)
    np.testing.assert_array_equal(written.points, labels.mesh.file_points)
    np.testing.assert_array_equal(made.faces, written.faces)
    assert made.point_data.keys() == written.point_data.keys()
    for name in made.point_data:
        np.testing.assert_array_equal(made.point_data[name], written.point_data[name])
    assert list(made.field_data["setting_unit"]) == ["cm"]


def test_a_mesh_becomes_a_trimesh_and_polydata(labels: SurfaceLabels) -> None:
    mesh = labels.mesh
    made, data = mesh.to_trimesh(), mesh.to_polydata()
    assert (made.is_volume, made.units) == (True, "m")
    assert made.volume == pytest.approx(mesh.volume)
    np.testing.assert_array_equal(data.points, mesh.vertices)
    np.testing.assert_array_equal(data["normal"], -mesh.normals)
    for other in (made, data):
        np.testing.assert_array_equal(load_mesh(other, max_edge=9.0).faces, mesh.faces)


def test_the_table_of_grasps_is_that_of_the_file(grasps: GraspTable, tmp_path: Path) -> None:
    write_grasps(tmp_path / "grasps.parquet", grasps)
    assert grasps.to_table().equals(pq.read_table(tmp_path / "grasps.parquet"), check_metadata=True)
    frame = grasps.to_dataframe()
    np.testing.assert_array_equal(frame[["x1", "y1", "z1"]], grasps.contacts.points[:, 0])


def test_without_pandas_a_sentence_names_the_extra(
    labels: SurfaceLabels, grasps: GraspTable, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("grasp3d.system.tables.find_spec", lambda _: None)
    found = sweep(labels.angle_distribution(), friction=0.5, sensor_resolution=0.1)
    for one in (labels, grasps, found):
        with pytest.raises(OutputError, match=r"pip install 'grasp3d\[pandas\]'"):
            one.to_dataframe()


def test_grasps_are_shown_one_at_a_time_with_their_own_numbers(grasps: GraspTable) -> None:
    collection = collection_of_grasps(grasps)
    assert [item.name for item in collection.items] == [f"arrays, grasp {n}" for n in (1, 2, 3)]
    subject = collection.items[1].open()
    assert subject.labels.mode == "scan"
    shown = inspect_given(subject, grasps.model)
    assert shown is not None
    assert shown.code == grasps.label[1]
    np.testing.assert_array_equal(shown.points, grasps.contacts.points[1])
    np.testing.assert_array_equal(shown.normals, grasps.contacts.normals[1])
    with pytest.raises(SettingError, match="no grasps to view"):
        collection_of_grasps(grasps.take(np.arange(0)))
