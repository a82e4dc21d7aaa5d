"""Preparing a mesh: size, centre, normals, edges, units and scale."""

import math
from collections import defaultdict
from pathlib import Path

import numpy as np
import pytest
import trimesh
from hypothesis import given, settings
from hypothesis import strategies as st

from grasp3d import MeshOptions, ObjectMesh, label_surface, load_mesh
from grasp3d.errors import MeshError, SettingError
from grasp3d.formats import read_labels, write_npz, write_ply
from grasp3d.mesh.measures import (
    Triangles,
    crowded_edges,
    edge_counts,
    has_area,
    is_closed,
    paired_edges,
    rounding_of,
)
from grasp3d.mesh.normals import corner_normals, crease_twins
from tests.helpers import oracles, shapes
from tests.helpers.commands import export


def test_a_box_is_closed_with_a_volume_and_refined() -> None:
    vertices, faces = shapes.box((1.0, 2.0, 3.0))
    mesh = load_mesh((vertices + 10.0, faces), unit="cm")
    assert mesh.report.closed
    assert mesh.report.warnings == mesh.report.repairs == ()
    assert mesh.volume == pytest.approx(6e-6)
    assert mesh.center_mass == pytest.approx([0.1, 0.1, 0.1])
    assert mesh.torque_scale == pytest.approx(0.01 * math.sqrt(14.0) / 2.0)
    assert mesh.size == pytest.approx(0.01 * math.sqrt(14.0))
    assert mesh.vertex_areas.sum() == pytest.approx(22e-4)
    assert np.array_equal(mesh.file_points[:8], vertices + 10.0)
    assert np.array_equal(mesh.vertices, 0.01 * mesh.file_points)
    corners = mesh.vertices[mesh.faces]
    longest = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max()
    assert longest <= mesh.size / 32.0 * (1.0 + 1e-6)
    assert trimesh.Trimesh(mesh.vertices, mesh.faces, process=False).is_watertight


def test_the_volume_and_centre_of_mass_of_a_cone() -> None:
    mesh = load_mesh(shapes.cone(0.3, height=2.0, sections=256))
    radius = 2.0 * math.tan(0.3)
    assert mesh.volume == pytest.approx(math.pi * radius**2 * 2.0 / 3.0, rel=1e-3)
    assert mesh.center_mass == pytest.approx([0.0, 0.0, 0.5], abs=1e-9)


def test_smooth_normals_are_interpolated_and_creases_have_sets() -> None:
    mesh = load_mesh(shapes.sphere(3))
    assert (mesh.contact_normals.counts == 1).all()
    gap = [oracles.angle(n, -v) for n, v in zip(mesh.normals, mesh.vertices, strict=True)]
    assert max(gap) < math.radians(0.5)
    box = load_mesh(shapes.box())
    middle = np.abs(box.vertices).max(axis=1) == 0.5
    extreme = (np.abs(box.vertices) == 0.5).sum(axis=1)
    assert middle.all()
    assert box.contact_normals.counts.tolist() == extreme.tolist()


def test_a_coarse_round_surface_stays_round_when_refined() -> None:
    """Normals inside the long facets of a cylinder are continuous from facet to facet."""
    cylinder = trimesh.creation.cylinder(0.5, 2.0, sections=32)
    mesh = load_mesh((cylinder.vertices, cylinder.faces))
    side = np.abs(mesh.vertices[:, 2]) < 0.9
    radial = mesh.vertices[side] * (-1.0, -1.0, 0.0)
    gap = [oracles.angle(n, r) for n, r in zip(mesh.normals[side], radial, strict=True)]
    assert max(gap) < math.radians(0.5)  # a facet's own normal is off by up to 5.6 degrees
    assert (mesh.contact_normals.counts[side] == 1).all()


def test_the_tip_of_a_cone_has_many_normals() -> None:
    mesh = load_mesh(shapes.cone(0.3))
    tip = int(np.argmax(mesh.vertices[:, 2]))
    assert mesh.contact_normals.counts[tip] > 10
    assert mesh.normal_centres[tip] == pytest.approx([0.0, 0.0, -1.0], abs=1e-6)
    start = mesh.contact_normals.start[tip]
    around = mesh.contact_normals.normals[start : start + mesh.contact_normals.counts[tip]]
    assert np.arccos(-around[:, 2]) == pytest.approx(math.pi / 2.0 - 0.3, abs=0.01)


def test_twins_are_across_each_crease() -> None:
    mesh = load_mesh(shapes.box(), max_edge=0.3)
    corners = mesh.corner_normals
    twins = crease_twins(mesh.faces, corners.corners)  # (F, 3, 2)
    for face, rows, across in zip(mesh.faces, corners.corners, twins, strict=True):
        for i in range(3):
            ends = face[[(i + 1) % 3, (i + 2) % 3]]
            on_box_edge = (np.abs(mesh.vertices[ends]) == 0.5).all(axis=0).sum() == 2
            assert (across[i] >= 0).all() == on_box_edge
            if on_box_edge:
                assert (corners.vertices[across[i]] == ends).all()
                cosines = corners.normals[across[i]] @ corners.normals[rows[i]]
                assert cosines == pytest.approx(0.0)


def test_unused_vertices_stay_where_they_are() -> None:
    vertices, faces = shapes.box()
    mesh = load_mesh((np.insert(vertices, 3, [9.0, 9.0, 9.0], axis=0), faces + (faces >= 3)))
    assert not mesh.on_surface[3]
    assert mesh.on_surface.sum() == len(mesh.vertices) - 1
    assert mesh.size == pytest.approx(math.sqrt(3.0))


def test_degenerate_and_repeated_faces_are_left_out_and_counted() -> None:
    vertices, faces = shapes.box()
    middle = vertices[faces[0][:2]].mean(axis=0)
    vertices = np.vstack([vertices, middle])
    needle = [faces[0][0], 8, faces[0][1]]
    extra = [faces[3][[1, 2, 0]], [0, 0, 1], needle]
    mesh = load_mesh((vertices, np.vstack([faces, extra])))
    assert [step.count for step in mesh.report.repairs] == [1, 1, 1]
    assert mesh.vertex_areas.sum() == pytest.approx(6.0)


def test_faces_without_area_are_found_by_the_rounding_of_the_coordinates() -> None:
    flat = np.array([[0.0, 0.0, 0.0], [1000.0, 0.0, 0.0], [500.0, 5e-13, 0.0]])
    thin = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 1e-9, 0.0]])
    face = np.array([[0, 1, 2]])
    assert not has_area(flat, face, rounding_of(flat))[0]
    assert has_area(thin, face, rounding_of(thin + 0.1))[0]
    assert not has_area(thin, face, rounding_of(thin + 1e9))[0]
    assert not has_area(thin, face, rounding_of(np.float64(np.float32(thin + 0.1))))[0]


def test_a_needle_in_a_flat_face_makes_no_crease() -> None:
    """Its third corner is moved off the line by the rounding of 32 bits only."""
    vertices, faces = shapes.box((0.1, 0.1, 0.1))
    first, last, opposite = faces[0]
    points = np.vstack([vertices, 0.3 * vertices[first] + 0.7 * vertices[last]])
    cut = [[first, 8, opposite], [8, last, opposite], [first, last, 8]]
    bent = np.vstack([faces[1:], cut])
    for seed in range(20):
        mesh = load_mesh((np.float64(np.float32(points @ shapes.rotation(seed).T)), bent))
        sharp = mesh.contact_normals.counts >= 2
        back = np.abs(mesh.vertices @ shapes.rotation(seed))
        assert ((np.abs(back[sharp] - 0.05) < 1e-6).sum(axis=1) >= 2).all()


def test_a_sheet_with_two_sides_has_normals_whatever_the_crease_angle() -> None:
    vertices = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0]])
    mesh = load_mesh((vertices, [[0, 1, 2], [0, 2, 1]]), crease_angle=math.pi)
    assert np.linalg.norm(mesh.corner_normals.normals, axis=1) == pytest.approx(1.0)


@pytest.mark.parametrize("scale", [1e100, 1e-100])
def test_sizes_out_of_range_are_refused(scale: float) -> None:
    vertices, faces = shapes.box()
    with pytest.raises(MeshError, match=r"above 1e\+60|extent is only 1e-100; scale the mesh"):
        load_mesh((vertices * scale, faces))


def test_a_missing_triangle_is_filled_and_a_large_hole_is_reported() -> None:
    vertices, faces = shapes.sphere(2)
    repaired = load_mesh((vertices, faces[1:])).report
    assert repaired.closed
    assert "1 face added to close holes" in str(repaired.repairs[0])
    opened = load_mesh((vertices, faces[vertices[faces].mean(axis=1)[:, 2] < 0.5]))
    assert not opened.report.closed
    assert opened.report.center_mass_from == "surface"
    assert math.isnan(opened.volume)
    assert "the surface is open" in opened.report.warnings[0]


def test_normals_are_averaged_by_angle_for_any_tessellation() -> None:
    """A face at an edge that is cut in ten does not count ten times."""
    fan = [[math.cos(t), math.sin(t), 0.0] for t in np.linspace(0.0, math.pi, 11)]
    slope = [0.0, -math.cos(0.3), -math.sin(0.3)]
    vertices = np.array([[0.0, 0.0, 0.0], *fan, slope])
    faces = np.array([[0, i, i + 1] for i in range(1, 11)] + [[0, 11, 12], [0, 12, 1]])
    normals = corner_normals(Triangles(vertices, faces), math.radians(30.0))
    at_centre = normals.normals[normals.vertices == 0]
    assert len(at_centre) == 1
    assert oracles.angle(at_centre[0], np.array([0.0, 0.0, -1.0])) == pytest.approx(0.15, abs=0.01)


NONE = np.empty((0, 3), int)


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        ([[0, 0, 0]], [[0, 0, 1]], "uses vertex 1, but there are 1 vertices"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, math.nan]], [[0, 1, 2]], "vertex 2 has a coordinate"),
        ([[0, 0, 0], [1, 0, 0], [0, 0, 0]], [[0, 1, 2]], "two corners at one position"),
        ([[0, 0, 0], [1, 0, 0]], NONE, "holds no triangles"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0.9, 1.2, 2.7]], "faces must be whole numbers"),
    ],
)
def test_arrays_that_are_no_surface_are_refused(
    vertices: list[list[float]], faces: list[list[int]], message: str
) -> None:
    with pytest.raises(MeshError, match=message):
        load_mesh((vertices, faces))


def test_a_unit_that_is_stated_later_is_as_if_it_were_stated_at_first() -> None:
    body = shapes.box((60.0, 40.0, 20.0))
    later = load_mesh(load_mesh(body, max_edge=20.0, center_of_mass=(5.0, 0.0, 0.0)), unit="mm")
    first = load_mesh(body, unit="mm", max_edge="20mm", center_of_mass="5mm,0,0")
    assert later.options == first.options
    assert (later.unit, later.file_unit) == ("m", "mm")
    for name in ("vertices", "file_points", "center_mass", "volume", "size", "torque_scale"):
        np.testing.assert_allclose(getattr(later, name), getattr(first, name), rtol=1e-12)


def half_edges(faces: np.ndarray) -> dict[frozenset[int], list[int]]:
    """Half-edges 3 f + i, opposite to corner i of face f, of each edge in ascending order."""
    found = defaultdict(list)
    for f, face in enumerate(faces.tolist()):
        for i in range(3):
            found[frozenset((face[(i + 1) % 3], face[(i + 2) % 3]))].append(3 * f + i)
    return found


@pytest.mark.parametrize("vertices", [4, 12, 400])
def test_half_edges_are_paired_or_crowded_in_ascending_order(vertices: int) -> None:
    rng = np.random.default_rng(vertices)
    some = [rng.choice(vertices, 3, replace=False) for _ in range(60)]
    faces = np.array([*some, *some[:5], *(face[::-1] for face in some[5:9])])
    edges = half_edges(faces)
    one, two = paired_edges(faces)
    pairs = sorted(tuple(rows) for rows in edges.values() if len(rows) == 2)
    assert sorted(zip(one.tolist(), two.tolist(), strict=True)) == pairs
    crowds = sorted(row for rows in edges.values() if len(rows) > 2 for row in rows)
    assert sorted(crowded_edges(faces).tolist()) == crowds
    assert pairs or vertices == 4
    assert crowds or vertices == 400
    assert edge_counts(faces) == tuple(
        sum(fits(len(rows)) for rows in edges.values()) for fits in ((1).__eq__, (2).__lt__)
    )
    none = np.zeros((0, 3), dtype=np.int64)
    assert [len(rows) for rows in (*paired_edges(none), crowded_edges(none))] == [0, 0, 0]


def test_a_surface_is_closed_where_the_directions_of_each_edge_cancel() -> None:
    _, faces = shapes.box()
    assert is_closed(faces)
    assert is_closed(np.vstack([faces, faces[:1], faces[:1, ::-1]]))  # four faces at an edge
    assert not is_closed(faces[1:])
    assert not is_closed(np.vstack([faces[1:], faces[:1, ::-1]]))


POWERS = st.integers(-12, 12).map(lambda power: 2.0**power)


def assert_equal(one: ObjectMesh, two: ObjectMesh) -> None:
    assert (one.unit, one.file_unit) == (two.unit, two.file_unit)
    np.testing.assert_array_equal(one.faces, two.faces)
    for name in ("vertices", "center_mass", "size", "volume", "torque_scale"):
        np.testing.assert_allclose(getattr(one, name), getattr(two, name), rtol=1e-12, atol=1e-12)


@settings(max_examples=10, deadline=None)
@given(scale=POWERS, again=POWERS, unit=st.sampled_from(["m", "mm", None]))
def test_a_scaled_mesh_is_that_of_scaled_coordinates(
    scale: float, again: float, unit: str | None
) -> None:
    vertices, faces = shapes.lopsided(2)
    made = load_mesh((vertices, faces), scale=scale, unit=unit)
    assert_equal(made, load_mesh((scale * vertices, faces), unit=unit))
    stated = {"unit": unit, "crease_angle": 0.5}
    assert_equal(load_mesh(made, crease_angle=0.5), load_mesh((scale * vertices, faces), **stated))
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
    vertices, faces = shapes.box()
    painted = trimesh.Trimesh(vertices, faces, process=False).subdivide().subdivide()
    above = painted.vertices[:, 2:] > 0.0
    painted.visual.vertex_colors = np.where(above, [255, 0, 0, 255], [255, 255, 255, 255])
    painted.export(tmp_path / "mask.ply")
    for region in ("box:-9,-9,{},9,9,9", str(tmp_path / "mask.ply")):
        once, twice = (
            load_mesh(
                (vertices, faces), scale=scale, max_edge=0.2 * scale,
                region=region.format(0.3 * scale),
            ).region
            for scale in (1.0, 2.0)
        )  # fmt: skip
        np.testing.assert_array_equal(once, twice)
        assert 0 < np.count_nonzero(once) < len(once)
    labels = label_surface(load_mesh((vertices, faces), scale=2.0, region="box:-9,-9,0,9,9,9"))
    write_ply(tmp_path / "labelled.ply", labels)  # in the file's coordinates
    painting = f"{tmp_path / 'labelled.ply'}:label"
    painted = load_mesh((vertices, faces), scale=2.0, region=painting)
    assert 0 < np.count_nonzero(painted.region) < len(painted.region)


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
