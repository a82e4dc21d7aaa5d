"""Meshes that are scaled, and those whose unit is guessed."""

from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import MeshOptions, label_surface, load_mesh
from grasp3d.errors import SettingError
from grasp3d.formats import read_labels, write_npz, write_ply
from grasp3d.mesh import ObjectMesh
from tests.helpers import shapes
from tests.helpers.commands import export

POWERS = st.integers(-12, 12).map(lambda power: 2.0**power)


def assert_equal(one: ObjectMesh, two: ObjectMesh) -> None:
    assert (one.unit, one.file_unit) == (two.unit, two.file_unit)
    np.testing.assert_array_equal(one.faces, two.faces)
    for name in ("vertices", "center_mass", "size", "volume", "torque_scale"):
        np.testing.assert_allclose(getattr(one, name), getattr(two, name), rtol=1e-12, atol=1e-12)


@settings(max_examples=30, deadline=None)
@given(scale=POWERS, again=POWERS, unit=st.sampled_from(["m", "mm", None]))
def test_a_scaled_mesh_is_that_of_scaled_coordinates(
    scale: float, again: float, unit: str | None
) -> None:
    vertices, faces = shapes.lopsided()
    made = load_mesh((vertices, faces), scale=scale, unit=unit)
    assert_equal(made, load_mesh((scale * vertices, faces), unit=unit))
    assert_equal(load_mesh(made, crease_angle=0.5), load_mesh((scale * vertices, faces), unit=unit,
                                                              crease_angle=0.5))  # fmt: skip
    assert_equal(load_mesh(made, scale=again), load_mesh((again * vertices, faces), unit=unit))


@pytest.mark.parametrize("write", [write_ply, write_npz])
@pytest.mark.parametrize("unit", ["cm", None])
def test_files_keep_the_scale(tmp_path: Path, write: object, unit: str | None) -> None:
    vertices, faces = shapes.sphere(1)
    mesh = load_mesh((vertices, faces), scale=2.0, unit=unit, max_edge="inf" if unit else np.inf)
    labels = label_surface(mesh)
    path = tmp_path / f"labels.{write.__name__[6:]}"  # type: ignore[attr-defined]
    write(path, labels)  # type: ignore[operator]
    read = read_labels(path)
    assert read.mesh.options.scale == 2.0
    np.testing.assert_allclose(read.mesh.vertices, mesh.vertices, rtol=1e-6)
    assert read.mesh.size == pytest.approx(mesh.size)
    again = load_mesh(read.mesh, scale=3.0)
    assert again.size == pytest.approx(1.5 * mesh.size)
    assert load_mesh(read.mesh, repair="none").size == pytest.approx(mesh.size)


def test_a_box_is_of_the_scaled_mesh_and_paint_of_the_file(tmp_path: Path) -> None:
    vertices, faces = shapes.box((1.0, 1.0, 1.0))
    painted = trimesh.Trimesh(vertices, faces, process=False).subdivide().subdivide()
    painted.visual.vertex_colors = np.where(  # type: ignore[union-attr]
        painted.vertices[:, 2:] > 0.0, [255, 0, 0, 255], [255, 255, 255, 255]
    )
    painted.export(tmp_path / "mask.ply")
    regions = []
    for scale in (1.0, 2.0):
        for region in (f"box:-9,-9,{0.3 * scale},9,9,9", str(tmp_path / "mask.ply")):
            mesh = load_mesh((vertices, faces), scale=scale, max_edge=0.2 * scale, region=region)
            regions.append(mesh.region)
        write_ply(tmp_path / "labelled.ply", label_surface(mesh))  # in the file's coordinates
        assert np.array_equal(mesh.file_points[: len(vertices)], vertices)
        painting = f"{tmp_path / 'labelled.ply'}:label"
        assert load_mesh((vertices, faces), scale=scale, region=painting).region is not None
    np.testing.assert_array_equal(regions[:2], regions[2:])
    assert 0 < np.count_nonzero(regions[0]) < np.count_nonzero(regions[1]) < len(mesh.vertices)


@pytest.mark.parametrize(("size", "unit"), [(120.0, "mm"), (0.12, "m")])
def test_a_guessed_unit_is_used_and_named(tmp_path: Path, size: float, unit: str) -> None:
    source = export(tmp_path / "egg.ply", shapes.box((size, size / 2.0, size / 3.0)))
    guessed, stated = load_mesh(source, unit="guess"), load_mesh(source, unit=unit)
    assert_equal(guessed, stated)
    assert guessed.options == stated.options
    (text,) = set(guessed.report.warnings) - set(stated.report.warnings)
    assert text.startswith(f"its unit, {unit}, is a guess (largest extent {size:g}: ")
    assert load_mesh(guessed, max_edge="1m").unit == "m"
    assert load_mesh(source, unit="guess", scale=0.5).size == pytest.approx(stated.size / 2.0)


def test_a_unit_that_is_stated_is_no_guess_and_what_cannot_be_guessed_is_refused(
    tmp_path: Path,
) -> None:
    known = load_mesh(shapes.box((2.0, 1.0, 1.0)), unit="cm")
    for mesh in (load_mesh(known, unit="guess"), load_mesh(known.to_trimesh(), unit="guess")):
        assert mesh.size == pytest.approx(known.size)
        assert not any("guess" in text for text in mesh.report.warnings)
    source = export(tmp_path / "moon.ply", shapes.box((1e9, 1e9, 1e9)))
    with pytest.raises(SettingError, match=r"moon\.ply: its unit cannot be guessed .*; state it$"):
        load_mesh(source, unit="guess")
    for scale in (0.0, -1.0, np.inf, np.nan, "2"):
        with pytest.raises(SettingError, match="scale must be"):
            MeshOptions(scale=scale)  # type: ignore[arg-type]
