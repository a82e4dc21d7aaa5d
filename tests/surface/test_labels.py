"""Labels as tables, meshes and pickles, the same as in files, and those of known values."""

import pickle
from dataclasses import fields, replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
import pyarrow.parquet as pq
import pytest
import pyvista

from grasp3d import (
    GraspModel,
    Load,
    Sampling,
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
from grasp3d.hand.scene import Scene
from grasp3d.stability import COLORS, Label
from grasp3d.surface import GraspTable, LoadResult, Reason
from grasp3d.surface.vertex_fields import VERTICES
from tests.helpers import shapes
from tests.helpers.grippers import HAND, SLIM
from tests.helpers.vertex_labels import with_arrays, with_known


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
    fields = {name: field.name for field in VERTICES for name in field.point_names(2)}
    for name, values in made.vertex_attributes.items():
        np.testing.assert_array_equal(values, stored[fields[name]].reshape(values.shape))
    kept = {fields[name] for name in made.vertex_attributes} | {"vertices", "color"}
    assert kept >= set(stored.files) & {field.name for field in VERTICES}
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


ARRAYS = (
    "critical_angle", "critical_angle_best", "label", "max_resolution", "margin", "epsilon",
    "epsilon_min", "epsilon_max", "opening", "grip", "reason", "partners", "partner_normals",
)  # fmt: skip


@cache
def wedge(**model: Any) -> SurfaceLabels:
    """A wedge with creases, a vertex twice and one on no face."""
    corners, faces = shapes.box((40.0, 30.0, 20.0))
    corners = corners * [[1.0, 1.0 + 0.2 * (corner[2] > 0), 1.0] for corner in corners]
    vertices = np.vstack([corners, corners[:2], [[90.0, 0.0, 0.0]]])
    mesh = load_mesh((vertices, faces), unit="mm", max_edge="12mm")
    load = Load(mass=0.1, grip_force=20.0)
    return label_surface(
        mesh, GraspModel(torsion_radius="2mm", sensor_resolution=0.3, **model), hand=SLIM, load=load
    )


@cache
def tripod() -> SurfaceLabels:
    mesh = load_mesh(shapes.box((1.0, 1.4, 2.0)), max_edge=0.7)
    return label_surface(mesh, GraspModel(fingers=3), sampling=Sampling(candidates=16))


LABELS = {
    "exact": wedge,
    "location error": lambda: wedge(location_error="1mm"),
    "three fingers": tripod,
}


def test_another_scene_needs_another_search() -> None:
    labels = wedge()
    other = Scene(HAND)
    for found in (labels, labels.take(labels.distinct)):
        with pytest.raises(SettingError, match="for its own scene only"):
            found.using(scene=other)
        assert found.using(scene=labels.scene).reach is found.reach
    assert tripod().using(scene=other).scene is other


def known(labels: SurfaceLabels) -> SurfaceLabels:
    """The same labels, made from what is known of them."""
    names = ("label", "epsilon_range", "load_result")
    return with_known(with_arrays(labels), **{name: getattr(labels, name) for name in names})


def assert_equal(one: SurfaceLabels, other: SurfaceLabels) -> None:
    for name in ARRAYS:
        np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    assert (one.load_result is None) == (other.load_result is None)
    if one.load_result is not None and other.load_result is not None:
        for field in fields(LoadResult):
            values = getattr(one.load_result, field.name), getattr(other.load_result, field.name)
            if isinstance(values[0], np.ndarray):
                np.testing.assert_array_equal(*values, err_msg=field.name)


@pytest.mark.slow
@pytest.mark.parametrize("name", LABELS)
def test_vertices_at_one_position_share_a_grasp(name: str) -> None:
    labels = LABELS[name]()
    grasps, vertices = labels.take(labels.distinct), labels.distinct
    assert len(vertices) == grasps.size <= np.count_nonzero(labels.reason == Reason.FOUND)
    for attribute in ("label", "critical_angle", "margin", "epsilon", "opening", "max_resolution"):
        rows, places = getattr(grasps, attribute), getattr(labels, attribute)
        np.testing.assert_array_equal(places[vertices], rows, err_msg=attribute)
        np.testing.assert_array_equal(places, places[labels.mesh.canonical], err_msg=attribute)
    missing = labels.reason != Reason.FOUND
    assert np.isinf(labels.critical_angle[missing]).all()
    assert (labels.label[missing] == 0).all()
    assert np.isnan(labels.epsilon[missing]).all()


@pytest.mark.slow
@pytest.mark.parametrize("name", LABELS)
def test_labels_of_known_values_are_the_same(name: str) -> None:
    labels = LABELS[name]()
    found = known(labels)
    assert found.computed("epsilon_range") is labels.epsilon_range
    assert_equal(labels, found)
    np.testing.assert_array_equal(found.partner_points.faces, labels.partner_points.faces)
    assert_equal(labels.relabel(friction=0.4), found.relabel(friction=0.4))
    assert repr(found) == repr(labels)


def test_known_values_belong_to_the_settings() -> None:
    """Those of another friction are computed again."""
    labels = known(wedge())
    model = replace(labels.model, friction=0.2)
    for other in (replace(labels, model=model), labels.using(model=model)):
        assert other.computed("epsilon_range") is None
        np.testing.assert_array_equal(other.label, labels.relabel(friction=0.2).label)
    assert not np.array_equal(other.label, labels.label)


def test_known_labels_are_pickled() -> None:
    labels = known(wedge())
    copy = pickle.loads(pickle.dumps(labels))  # noqa: S301
    assert copy.computed("epsilon_range") is not None
    assert_equal(labels, copy)
