"""Labels that are read again are those that were written, as far as their format stores them."""

import zipfile
from collections.abc import Callable
from functools import cache
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import (
    GraspModel,
    Load,
    ParallelGripper,
    Sampling,
    SurfaceLabels,
    Table,
    label_surface,
    load_mesh,
    read_labels,
    scan_surface,
    write_glb,
)
from grasp3d.errors import GraspError, MeshError
from grasp3d.formats.surface_files import labels_in, writer_for
from grasp3d.mesh import ObjectMesh
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.surface.fields import Array, Field, present
from grasp3d.surface.vertex_fields import SURFACE, VERTICES
from tests.helpers import shapes

FORMATS = ("ply", "npz")
FRANKA = ParallelGripper.preset("franka")


@cache
def box() -> ObjectMesh:
    return load_mesh(shapes.box((4.0, 3.0, 2.0)), unit="cm", max_edge="1.5cm")


def cone() -> SurfaceLabels:
    """S, M and U, creases, and vertices without a grasp."""
    mesh = load_mesh(shapes.cone(0.35), unit="cm", max_edge="0.2cm")
    return label_surface(mesh, GraspModel(friction=0.75), sampling=Sampling(max_opening="3mm"))


def three_fingers() -> SurfaceLabels:
    mesh = load_mesh(shapes.sphere(1), max_edge=0.5)
    return label_surface(mesh, GraspModel(fingers=3), sampling=Sampling(candidates=16))


def gripper() -> SurfaceLabels:
    return label_surface(box(), hand=FRANKA, table=Table.below(box(), "z"), load=Load(mass="200 g"))


def welded() -> SurfaceLabels:
    """Vertices at one position, some of which belong to no face."""
    vertices, faces = shapes.box()
    twice = np.concatenate([vertices, vertices, [[9.0, 0.0, 0.0]]])
    mesh = load_mesh((twice, np.concatenate([faces[:6], faces[6:] + len(vertices)])), max_edge=0.5)
    return label_surface(mesh, GraspModel(torsion_radius=0.1))


CASES: dict[str, Callable[[], SurfaceLabels]] = {
    "cone": cone,
    "location error": lambda: label_surface(
        box(), GraspModel(friction=0.75, location_error="0.1mm")
    ).relabel(friction=(0.6, 0.7)),
    "extremes": lambda: label_surface(
        box(), GraspModel(method="extremes"), load=Load(density=900.0, grip_force="20 N")
    ),
    "three fingers": three_fingers,
    "gripper": gripper,
    "scan": lambda: scan_surface(box(), fixed=(0.0, 1.5, 0.0)),
    "welded": welded,
}


@cache
def labels_of(case: str) -> SurfaceLabels:
    return CASES[case]()


def values_of(labels: SurfaceLabels) -> dict[str, tuple[Field, Array]]:
    """Every declared field that labels have, by name."""
    found = [*present(VERTICES, labels), *present(SURFACE, labels.mesh)]
    return {field.name: (field, values) for field, values in found}


def bits(values: object) -> object:
    """Values that are equal only if they are so in every bit."""
    if isinstance(values, np.ndarray):
        return values.dtype, values.shape, values.tobytes()
    if isinstance(values, dict):
        return {name: bits(one) for name, one in values.items()}
    return repr(values)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", FORMATS)
@pytest.mark.parametrize("case", CASES)
def test_files_have_every_field_bit_for_bit(tmp_path: Path, suffix: str, case: str) -> None:
    labels, path = labels_of(case), tmp_path / f"labels.{suffix}"
    writer_for(path)(path, labels)
    found = read_labels(path)
    written, read = values_of(labels), values_of(found)
    assert written.keys() == read.keys()
    for name, (_, values) in written.items():
        assert bits(values) == bits(read[name][1]), name
    mesh, again = labels.mesh, found.mesh
    for name in ("center", "size", "center_mass", "volume", "torque_scale", "file_vertices"):
        assert bits(getattr(mesh, name)) == bits(getattr(again, name)), name
    for name, array in mesh.contact_normals._asdict().items():
        assert bits(array) == bits(getattr(again.contact_normals, name)), name
    assert (again.options, again.report) == (mesh.options, mesh.report)
    assert (found.model, found.sampling, found.mode) == (
        labels.model, labels.sampling, labels.mode,
    )  # fmt: skip
    assert (found.search, found.load) == (labels.search, labels.load)
    for one, other in zip(*map(scene_of, (labels, found)), strict=True):
        assert bits(one) == bits(other)
    if labels.load_result is not None:
        assert found.load_result is not None
        assert (found.load_result.how, found.load_result.case) == (
            labels.load_result.how,
            labels.load_case,
        )
    if labels.reach is not None:
        assert bits(vars(found.reach)) == bits(vars(labels.reach))
    assert found.to_table().schema.equals(labels.to_table().schema, check_metadata=True)
    assert repr(found) == repr(labels)


def scene_of(labels: SurfaceLabels) -> list[Any]:
    scene = labels.scene
    if scene is None:
        return []
    return [scene.hand, *map(vars, filter(None, (scene.table, scene.approach)))]


def test_a_written_file_may_be_written_again(tmp_path: Path) -> None:
    paths = [tmp_path / f"{number}.{suffix}" for number, suffix in enumerate(FORMATS * 2)]
    known = labels_of("gripper")
    writer_for(paths[0])(paths[0], known)
    for path, following in pairwise(paths):
        writer_for(following)(following, read_labels(path))
    last, first = (one.relabel(friction=0.4) for one in (read_labels(paths[-1]), known))
    for labels, expected in ((read_labels(paths[-1]), known), (last, first)):
        assert {name: bits(one) for name, (_, one) in values_of(labels).items()} == {
            name: bits(one) for name, (_, one) in values_of(expected).items()
        }


@pytest.mark.parametrize("suffix", FORMATS)
def test_labels_are_those_of_the_unit_that_is_stated_when_they_are_read(
    tmp_path: Path, suffix: str
) -> None:
    body = shapes.box((60.0, 40.0, 20.0))
    plain = label_surface(
        load_mesh(body, max_edge=20.0, center_of_mass=(5.0, 0.0, 0.0)),
        GraspModel(location_error=0.5), sampling=Sampling(max_opening=45.0),
    )  # fmt: skip
    in_mm = label_surface(
        load_mesh(body, unit="mm", max_edge="20mm", center_of_mass="5mm,0,0"),
        GraspModel(location_error="0.5mm"), sampling=Sampling(max_opening="45mm"),
    )  # fmt: skip
    path = tmp_path / f"box.{suffix}"
    writer_for(path)(path, plain)
    assert read_labels(path).mesh.file_unit is None
    found = read_labels(path, unit="mm")
    writer_for(path)(path, found)
    assert read_labels(path, unit="cm").mesh.file_unit == "mm"
    assert (found.model, found.sampling) == (in_mm.model, in_mm.sampling)
    assert found.mesh.options == in_mm.mesh.options
    assert found.label.tolist() == in_mm.label.tolist()
    for name in ("vertices", "file_points", "center_mass", "vertex_areas", "volume"):
        expected = getattr(in_mm.mesh, name)
        np.testing.assert_allclose(getattr(found.mesh, name), expected, rtol=1e-12, err_msg=name)
    for name in ("opening", "partner_points"):
        got, expected = (positions(getattr(one, name), one.mesh) for one in (found, in_mm))
        np.testing.assert_allclose(got, expected, rtol=1e-6, atol=1e-9, err_msg=name)


def positions(values: Any, mesh: ObjectMesh) -> Array:
    return values.positions(mesh) if isinstance(values, SurfacePoints) else np.asarray(values)


@pytest.mark.parametrize("suffix", FORMATS)
def test_other_files_give_a_sentence(tmp_path: Path, suffix: str) -> None:
    path = tmp_path / f"other.{suffix}"
    for content in (b"", b"junk", b"PK\x03\x04" + bytes(200), b"PAR1"):
        path.write_bytes(content)
        with pytest.raises(MeshError) as caught:
            read_labels(path)
        assert str(path) in str(caught.value)
        assert "\n" not in str(caught.value)
        assert "has labels" not in str(caught.value)
    np.savez(tmp_path / "other.npz", vertices=np.eye(3))
    trimesh.creation.box().export(tmp_path / "other.ply")
    with pytest.raises(MeshError, match=f"is not a {suffix.upper()} labelled by grasp3d; lab"):
        read_labels(path)
    assert labels_in(path) is None
    with pytest.raises(MeshError, match="no such file"):
        read_labels(tmp_path / f"nowhere.{suffix}")
    write_glb(tmp_path / "labels.glb", labels_of("cone"))
    with pytest.raises(MeshError, match=r"supported are \.npz \.ply"):
        read_labels(tmp_path / "labels.glb")


BAD_VALUES: dict[str, tuple[str, Callable[[Any], Any], str]] = {
    "reasons": (
        "reason",
        lambda values: np.full_like(values, 3),
        r"reason of vertex \d+ does not match",
    ),
    "angle": ("critical_angle", lambda _: -1.0, "has values that it cannot have"),
    "partner": ("partner_faces", lambda _: 10**6, "its partner_faces"),
    "missing": ("epsilon", lambda _: None, "there is no 'epsilon'"),
    "mesh": ("setting_surface", lambda _: np.array("{}"), "there is no 'center'"),
    "shape": ("epsilon", lambda values: values[1:], "the shape"),
    "text": ("vertices", lambda values: values.astype("U1"), "its vertices is <U1 of the shape"),
    "object": ("epsilon", lambda values: values.astype(object), "its arrays cannot be read"),
}


@pytest.mark.parametrize("case", BAD_VALUES)
def test_impossible_values_are_refused(tmp_path: Path, case: str) -> None:
    path, (name, change, message) = tmp_path / "labels.npz", BAD_VALUES[case]
    writer_for(path)(path, labels_of("cone"))
    with np.load(path) as stored:
        arrays = dict(stored)
    changed = change(arrays[name])
    if changed is None:
        del arrays[name]
    elif np.ndim(changed) == 0 and np.ndim(arrays[name]):
        arrays[name][0] = changed
    else:
        arrays[name] = changed
    np.savez_compressed(path, **arrays)
    with pytest.raises(MeshError, match=message):
        read_labels(path)


@pytest.mark.parametrize(
    ("old", "new"),
    [
        (b"'shape': ()", b"'shape': (("),  # NumPy reads the header as Python's own text
        (b"'<U", b"'>U"),  # letters beyond Unicode
    ],
)
def test_damaged_headers_and_texts_are_refused(tmp_path: Path, old: bytes, new: bytes) -> None:
    path = tmp_path / "f.npz"
    writer_for(path)(path, gripper())
    with zipfile.ZipFile(path) as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    with zipfile.ZipFile(path, "w") as archive:
        for name, content in members.items():
            archive.writestr(name, content.replace(old, new))
    with pytest.raises(MeshError, match="its arrays cannot be read"):
        read_labels(path)


@pytest.mark.slow
@pytest.mark.parametrize("suffix", FORMATS)
@given(data=st.data())
@settings(max_examples=60, deadline=None)
def test_any_damage_gives_a_one_line_error_or_labels(
    data: st.DataObject, tmp_path_factory: pytest.TempPathFactory, suffix: str
) -> None:
    path = tmp_path_factory.getbasetemp() / f"whole.{suffix}"
    if not path.exists():
        writer_for(path)(path, labels_of("gripper"))
    broken = bytearray(path.read_bytes())
    for _ in range(data.draw(st.integers(1, 4))):
        position = data.draw(st.integers(0, len(broken) - 1))
        broken[position] = data.draw(st.integers(0, 255))
    length = data.draw(st.just(len(broken)) | st.integers(1, len(broken)))
    path = path.with_stem("broken")
    path.write_bytes(bytes(broken[:length]))
    try:
        found = read_labels(path)
    except GraspError as error:
        assert "\n" not in str(error)  # noqa: PT017, it need not be raised
    else:
        assert len(found.label) == len(found.mesh.vertices)


def test_a_ply_that_another_program_wrote_again_is_refused(tmp_path: Path) -> None:
    """Its numbers could mean anything."""
    path = tmp_path / "cone.ply"
    writer_for(path)(path, labels_of("cone"))
    content = path.read_bytes()
    for old, new in (
        (b"binary_little_endian", b"binary_big_endian"),
        (b"property double epsilon\n", b"property double other\n"),
        (b"comment grasp3d packed ", b"comment grasp3d wrapped "),
        (b"property list uchar int vertex_indices", b"property list uchar int corners"),
    ):
        path.write_bytes(content.replace(old, new, 1))
        with pytest.raises(MeshError, match=r"cone\.ply: has labels, but .*; label the mesh again"):
            read_labels(path)
