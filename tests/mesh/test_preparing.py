import math

import numpy as np
import pytest
import trimesh

from grasp3d import ObjectMesh, load_mesh
from grasp3d.errors import MeshError
from grasp3d.mesh.measures import Triangles, has_area, paired_edges, rounding_of
from grasp3d.mesh.normals import corner_normals, crease_twins
from tests.helpers import oracles, shapes
from tests.helpers.repairs import joined
from tests.helpers.shapes import Surface


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


def test_far_from_the_origin_precision_is_kept() -> None:
    vertices, faces = shapes.sphere(3)
    near, far = load_mesh((vertices, faces)), load_mesh((vertices + 1e6, faces))
    assert far.volume == pytest.approx(near.volume, rel=1e-8)
    assert far.center_mass - 1e6 == pytest.approx(near.center_mass, abs=1e-8)
    assert far.size == pytest.approx(near.size, rel=1e-8)


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


def test_the_crease_angle_decides_what_is_smooth() -> None:
    prism = trimesh.creation.cylinder(0.5, 1.0, sections=8)  # edges of 45 degrees
    sharp = load_mesh((prism.vertices, prism.faces))
    smooth = load_mesh((prism.vertices, prism.faces), crease_angle=math.radians(50.0))
    for mesh, counts in ((sharp, {1, 2}), (smooth, {1})):
        side = np.abs(mesh.vertices[:, 2]) < 0.4
        assert set(mesh.contact_normals.counts[side]) == counts


def test_twins_are_across_each_crease() -> None:
    mesh = load_mesh(shapes.box(), max_edge=0.3)
    corners = mesh.corner_normals
    twins = crease_twins(mesh.faces, corners.corners)
    along = 0
    for face, across in zip(mesh.faces, twins, strict=True):
        for i in range(3):
            ends = face[[(i + 1) % 3, (i + 2) % 3]]
            on_box_edge = (np.abs(mesh.vertices[ends]) == 0.5).all(axis=0).sum() == 2
            assert (across[i] >= 0).all() == on_box_edge
            if on_box_edge:
                along += 1
                assert (corners.vertices[across[i]] == ends).all()
                own = oracles.angle(
                    corners.normals[across[i][0]],
                    np.cross(*(np.diff(mesh.vertices[face], axis=0)))[None].ravel() * -1.0,
                )
                assert own == pytest.approx(math.pi / 2.0)
    assert along > 20


def test_vertices_at_one_position_are_joined_and_keep_their_rows() -> None:
    vertices, faces = joined(shapes.box(), shapes.box())
    mesh = load_mesh((vertices, np.vstack([faces[:6], faces[18:]])))
    assert mesh.report.closed
    assert mesh.file_vertices == 16
    assert np.array_equal(mesh.vertices[:16], vertices)
    assert mesh.canonical[8:16].tolist() == list(range(8))
    assert mesh.on_surface.all()
    assert mesh.vertex_areas[8:16].sum() == 0.0
    assert "8 vertices joined" in str(mesh.report.repairs[0])


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
    flat = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 1e-18, 0.0]])
    thin = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.5, 1e-9, 0.0]])
    face = np.array([[0, 1, 2]])
    assert not has_area(flat, face, rounding_of(flat))[0]
    assert has_area(thin, face, rounding_of(thin + 0.1))[0]
    assert not has_area(thin, face, rounding_of(thin + 1e9))[0]
    assert not has_area(thin, face, rounding_of(np.float64(np.float32(thin + 0.1))))[0]


@pytest.mark.slow
@pytest.mark.parametrize("shape", [shapes.sphere(2), shapes.box(), shapes.tube(), shapes.torus()])
def test_an_inside_out_mesh_is_turned_and_reported(shape: Surface) -> None:
    vertices, faces = shape
    mesh = load_mesh((vertices, faces[:, ::-1]))
    good = load_mesh((vertices, faces))
    assert mesh.volume == pytest.approx(good.volume)
    assert f"{len(faces)} faces turned: they were inside out" in map(str, mesh.report.repairs)
    own = slice(0, len(vertices))
    assert mesh.normals[own] == pytest.approx(good.normals[own], abs=1e-9)


def test_mixed_winding_is_made_consistent() -> None:
    vertices, faces = shapes.sphere(2)
    mixed = faces.copy()
    mixed[::5] = mixed[::5, ::-1]
    mesh = load_mesh((vertices, mixed))
    assert mesh.report.closed
    assert mesh.volume == pytest.approx(load_mesh((vertices, faces)).volume)
    assert "turned to agree with neighbours" in " ".join(map(str, mesh.report.repairs))


def test_one_inside_out_body_beside_another_is_turned() -> None:
    vertices, faces = shapes.sphere(2)
    mesh = load_mesh(joined((vertices, faces), (vertices + [5.0, 0.0, 0.0], faces[:, ::-1])))
    assert mesh.report.bodies == 2
    assert mesh.volume == pytest.approx(2.0 * load_mesh((vertices, faces)).volume)


def ball_at(center: list[float], radius: float) -> Surface:
    vertices, faces = shapes.sphere(3)
    return vertices * radius + center, faces


def outward_fraction(mesh: ObjectMesh, first: int, middle: list[float]) -> float:
    own = slice(first, mesh.file_vertices)
    outward = -mesh.normals[own] * (mesh.vertices[own] - middle)
    return float((outward.sum(axis=1) > 0.0).mean())


@pytest.mark.slow
def test_an_inside_out_ball_in_the_hole_of_a_ring_is_no_cavity() -> None:
    ring = shapes.torus(1.0, 0.3)
    vertices, faces = ball_at([0.0, 0.0, 0.0], 0.2)
    mesh = load_mesh(joined(ring, (vertices, faces[:, ::-1])))
    assert outward_fraction(mesh, len(ring[0]), [0.0, 0.0, 0.0]) == 1.0
    good = load_mesh(joined(ring, (vertices, faces)))
    assert mesh.volume == pytest.approx(good.volume)


def test_a_closed_body_beside_an_open_one_is_oriented_by_itself() -> None:
    bowl, rim = shapes.sphere(3)
    rim = rim[bowl[rim].mean(axis=1)[:, 2] < 0.0]
    vertices, faces = ball_at([5.0, 0.0, 0.0], 1.0)
    mesh = load_mesh(joined((bowl, rim), (vertices, faces[:, ::-1])))
    assert not mesh.report.closed
    assert outward_fraction(mesh, len(bowl), [5.0, 0.0, 0.0]) == 1.0


def test_a_tray_is_not_closed_to_a_box() -> None:
    vertices, faces = shapes.box()
    top = (vertices[faces][:, :, 2] == 0.5).all(axis=1)
    mesh = load_mesh((vertices, faces[~top]))
    assert not mesh.report.closed
    assert mesh.report.repairs == ()
    assert "open" in mesh.report.warnings[0]


@pytest.mark.slow
def test_a_needle_in_a_flat_face_makes_no_crease() -> None:
    """Its third corner is moved off the line by the rounding of 32 bits only."""
    vertices, faces = shapes.box((0.1, 0.1, 0.1))
    a, b, c = faces[0]
    other = next(f for f in faces[1:] if {a, b, c} & set(f) and len({a, b, c} & set(f)) == 2)
    p, q = sorted({a, b, c} & set(other))
    middle = len(vertices)
    points = np.vstack([vertices, 0.3 * vertices[p] + 0.7 * vertices[q]])
    opposite = next(iter({a, b, c} - {p, q}))
    forward = any((faces[0][k], faces[0][(k + 1) % 3]) == (p, q) for k in range(3))
    first, last = (p, q) if forward else (q, p)
    cut = [[first, middle, opposite], [middle, last, opposite], [first, last, middle]]
    bent = np.vstack([faces[1:], cut])
    for seed in range(20):
        turned = np.float64(np.float32(points @ shapes.rotation(seed).T))
        mesh = load_mesh((turned, bent))
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


def test_a_cavity_stays_a_cavity() -> None:
    vertices, faces = shapes.sphere(3)
    both, wound = joined((vertices, faces), (0.5 * vertices, faces[:, ::-1]))
    full = load_mesh((vertices, faces)).volume
    for winding in (wound, wound[:, ::-1]):
        mesh = load_mesh((both, winding))
        assert mesh.volume == pytest.approx(full * 7.0 / 8.0)
        inner = np.linalg.norm(mesh.vertices, axis=1) < 0.6
        outward = np.einsum("ij,ij->i", -mesh.normals, mesh.vertices)
        assert (outward[inner] < 0.0).all()
        assert (outward[~inner] > 0.0).all()


def test_a_missing_triangle_is_filled_and_a_large_hole_is_reported() -> None:
    vertices, faces = shapes.sphere(2)
    repaired = load_mesh((vertices, faces[1:]))
    assert repaired.report.closed
    assert "1 face added to close holes" in " ".join(map(str, repaired.report.repairs))
    opened = load_mesh((vertices, faces[vertices[faces].mean(axis=1)[:, 2] < 0.5]))
    assert not opened.report.closed
    assert opened.report.center_mass_from == "surface"
    assert math.isnan(opened.volume)
    assert "the surface is open" in opened.report.warnings[0]


def test_an_open_mesh_inside_out_is_turned_by_its_outermost_faces() -> None:
    vertices, faces = shapes.sphere(3)
    opened = faces[vertices[faces].mean(axis=1)[:, 2] < 0.5]
    for winding in (opened, opened[:, ::-1]):
        mesh = load_mesh((vertices, winding))
        used = mesh.on_surface
        assert (np.einsum("ij,ij->i", mesh.normals[used], mesh.vertices[used]) < 0.0).all()


def test_edges_with_more_than_two_faces_are_not_paired() -> None:
    faces = np.array([[0, 1, 2], [1, 0, 3], [0, 1, 4]])
    assert len(paired_edges(faces)[0]) == 0


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


@pytest.mark.parametrize(
    ("vertices", "faces", "message"),
    [
        ([[0, 0, 0]], [[0, 0, 1]], "uses vertex 1, but there are 1 vertices"),
        ([[0, 0, 0], [1, 0, 0], [0, 1, math.nan]], [[0, 1, 2]], "vertex 2 has a coordinate"),
        ([[0, 0, 0], [1, 0, 0], [0, 0, 0]], [[0, 1, 2]], "two corners at one position"),
        ([[0, 0, 0], [1, 0, 0]], np.empty((0, 3), int), "holds no triangles"),
        (
            [[0, 0, 0], [1, 0, 0], [0, 1, 0]],
            [[0.9, 1.2, 2.7]],
            "faces must be whole numbers",
        ),
    ],
)
def test_arrays_that_are_no_surface_are_refused(
    vertices: list[list[float]], faces: list[list[int]], message: str
) -> None:
    with pytest.raises(MeshError, match=message):
        load_mesh((vertices, faces))


def test_a_max_edge_that_would_fill_the_memory_is_refused() -> None:
    with pytest.raises(MeshError, match="give a longer max_edge"):
        load_mesh(shapes.box(), max_edge=1e-5)


@pytest.mark.parametrize(("unit", "implausible"), [("m", True), ("mm", False), ("cm", False)])
def test_an_implausible_size_for_its_unit_gives_a_warning(unit: str, implausible: bool) -> None:
    vertices, faces = shapes.box((80.0, 60.0, 90.0))
    mesh = load_mesh((vertices, faces), unit=unit)  # type: ignore[arg-type]
    assert bool(mesh.report.warnings) == implausible
    assert mesh.file_size == pytest.approx(math.sqrt(80.0**2 + 60.0**2 + 90.0**2))


def test_a_unit_that_is_stated_later_is_as_if_it_were_stated_at_first() -> None:
    body = shapes.box((60.0, 40.0, 20.0))
    later = load_mesh(load_mesh(body, max_edge=20.0, center_of_mass=(5.0, 0.0, 0.0)), unit="mm")
    first = load_mesh(body, unit="mm", max_edge="20mm", center_of_mass="5mm,0,0")
    assert later.options == first.options
    assert (later.unit, later.file_unit) == ("m", "mm")
    for name in ("vertices", "file_points", "center_mass", "volume", "size", "torque_scale"):
        np.testing.assert_allclose(getattr(later, name), getattr(first, name), rtol=1e-12)


def test_what_is_no_surface_is_refused_before_its_unit_is_asked_for() -> None:
    with pytest.raises(MeshError, match="vertex 2"):
        load_mesh(([[0, 0, 0], [1, 0, 0], [0, math.nan, 1]], [[0, 1, 2]]), max_edge="1mm")
