"""Bodies of one surface: nesting, unions, copies; independent of the order of faces."""

import manifold3d
import numpy as np
import pytest
import trimesh
from hypothesis import example, given, settings
from hypothesis import strategies as st

from grasp3d import load_mesh
from grasp3d.mesh import repair
from grasp3d.mesh.cleaning import without_mirrored
from grasp3d.mesh.measures import face_areas
from grasp3d.mesh.union import bodies_of, orient, without_slits
from tests.helpers import shapes
from tests.helpers.repairs import (
    assert_whole,
    counts,
    inward,
    joined,
    moved,
    over_positions,
    repaired,
    used_by,
    volume_of,
)
from tests.helpers.shapes import Surface

ORDERS = range(3)

STEPS = [(1, 0, 0), (-1, 0, 0), (0, 1, 0), (0, -1, 0), (0, 0, 1), (0, 0, -1)]
"""To the cubes beside a cube."""

FINE = 1.0 / 3.0
"""Scale that makes positions need more than 32 bits, so that they count as exact."""


def surface_of(solid: manifold3d.Manifold) -> Surface:
    mesh = solid.to_mesh64()
    return np.array(mesh.vert_properties)[:, :3], np.array(mesh.tri_verts).astype(np.int64)


def in_order(surface: Surface, seed: int) -> Surface:
    """The same faces in another order, each beginning at another corner."""
    vertices, faces = surface
    rng = np.random.default_rng(seed)
    start = rng.integers(0, 3, len(faces))[:, None]
    turned = np.take_along_axis(faces, (np.arange(3) + start) % 3, axis=1)
    return vertices, turned[rng.permutation(len(faces))]


def owners_of(surface: Surface) -> list[tuple[int, int]]:
    """Rank of each body by its size, the largest 0, and that of the body that it is part of."""
    points, faces = surface
    body, volumes, _ = bodies_of(points, faces, 0.0)
    _, owner = orient(points, faces, np.arange(len(points)), body, volumes, 1e-10)
    rank = np.argsort(np.argsort(-np.abs(volumes)))
    return sorted(zip(rank.tolist(), rank[owner].tolist(), strict=True))


@pytest.mark.slow
@pytest.mark.parametrize(("width", "seed"), [(0.5, 0), (0.8, 1), (1.1, 2)])
def test_a_bar_through_a_hollow_ball_does_not_take_its_cavity(width: float, seed: int) -> None:
    """The bar crosses the cavity, and corners of the cavity lie in the bar."""
    ball, hollow = manifold3d.Manifold.sphere(1.0, 24), manifold3d.Manifold.sphere(0.6, 16)
    bar = manifold3d.Manifold.cube([width, width, 3.0], center=True).rotate([30.0, 40.0, 0.0])
    surface = joined(surface_of(ball), inward(surface_of(hollow)), surface_of(bar))
    found = repaired(in_order(surface, seed))
    assert volume_of(found) == pytest.approx(((ball - hollow) + bar).volume(), rel=1e-8)
    assert found.closed
    assert found.warnings == ()
    assert counts(found) == {"united": 2}


@pytest.mark.parametrize("seed", ORDERS)
def test_an_inward_ball_half_out_of_a_body_is_no_cavity(seed: int) -> None:
    """Its box lies within that of the cube."""
    cube = manifold3d.Manifold.cube([1.0, 1.0, 1.0], center=True).rotate([45.0, 35.264, 0.0])
    vertices, faces = surface_of(cube)
    middle = vertices[faces[0]].mean(axis=0)
    ball = manifold3d.Manifold.sphere(0.15, 24).translate(middle.tolist())
    found = repaired(in_order(joined((vertices, faces), inward(surface_of(ball))), seed))
    assert volume_of(found) == pytest.approx((cube + ball).volume(), rel=1e-8)
    assert counts(found) == {"inverted": ball.num_tri(), "united": 2}
    assert found.warnings == ()


@pytest.mark.parametrize("seed", ORDERS)
@pytest.mark.parametrize("depth", [-0.1, 0.0])
def test_a_body_that_touches_a_slanted_wall_from_inside_is_not_within(
    depth: float, seed: int
) -> None:
    """A box wound inward with a face in the wall, and one with a gap to the wall."""
    small = moved(shapes.box((0.5, 0.5, 0.5)), (0.25 + depth, 0.0, 0.0))
    vertices, faces = joined(shapes.box(), inward(small))
    turned = vertices @ shapes.rotation(seed).T, faces
    assert owners_of(in_order(turned, seed)) == [(0, 0), (1, 0 if depth < 0.0 else 1)]


@pytest.mark.slow
@pytest.mark.parametrize("seed", ORDERS)
def test_each_cavity_belongs_to_the_smallest_body_around_it(seed: int) -> None:
    """Nested shells, each slightly off the middle, and a bar through all walls."""
    radii = (1.0, 0.85, 0.7, 0.5)
    balls = [moved(shapes.sphere(2), (0.02 * k, 0.0, 0.0), r) for k, r in enumerate(radii)]
    shells = [inward(ball) if k % 2 else ball for k, ball in enumerate(balls)]
    assert owners_of(in_order(joined(*shells), seed)) == [(0, 0), (1, 0), (2, 2), (3, 2)]
    solids = [manifold3d.Manifold(manifold3d.Mesh64(v, f.astype(np.uint64))) for v, f in balls]
    bar = shapes.box((0.1, 0.1, 3.0))
    whole = (solids[0] - solids[1]) + (solids[2] - solids[3])
    whole += manifold3d.Manifold(manifold3d.Mesh64(bar[0], bar[1].astype(np.uint64)))
    found = repaired(in_order(joined(*shells, bar), seed))
    assert volume_of(found) == pytest.approx(whole.volume(), rel=1e-8)
    assert counts(found) == {"united": 3}


@settings(max_examples=25, deadline=None)
@given(st.integers(0, 1000), st.tuples(*[st.floats(-0.4, 0.4)] * 3), st.floats(0.05, 0.5))
def test_within_agrees_with_an_intersection(
    seed: int, shift: tuple[float, float, float], size: float
) -> None:
    """Compared with Manifold's intersection, which equals a body that lies within."""
    outer = shapes.sphere(1)
    inner = moved((shapes.box()[0] @ shapes.rotation(seed).T, shapes.box()[1]), shift, size)
    one, two = (
        manifold3d.Manifold(manifold3d.Mesh64(v, f.astype(np.uint64))) for v, f in (outer, inner)
    )
    outside = 1.0 - (one ^ two).volume() / two.volume()
    cavity = owners_of(in_order(joined(outer, inward(inner)), seed)) == [(0, 0), (1, 0)]
    assert cavity == (abs(outside) < 1e-9)


@settings(max_examples=25, deadline=None)
@given(
    st.sets(st.tuples(*[st.integers(0, 2)] * 3), min_size=1),
    st.integers(0, 1000),
    st.booleans(),
    st.booleans(),
)
def test_cubes_side_by_side_are_the_solid_that_they_tile(
    cells: set[tuple[int, int, int]], seed: int, welded: bool, turned: bool
) -> None:
    """They touch in faces, edges and corners, with vertices of their own or common ones."""
    surface = joined(*(moved(shapes.box(), (float(x), y, z)) for x, y, z in sorted(cells)))
    if welded:
        surface = over_positions(surface)
    if turned:
        surface = surface[0] @ shapes.rotation(seed).T, surface[1]
    found = repaired(in_order(surface, seed))
    steps = [(x + dx, y + dy, z + dz) for x, y, z in cells for dx, dy, dz in STEPS]
    assert found.closed
    assert found.warnings == ()
    assert volume_of(found) == pytest.approx(len(cells))
    exposed = sum(step not in cells for step in steps)
    assert face_areas(found.vertices, found.faces).sum() == pytest.approx(exposed)


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(
    st.lists(st.tuples(*[st.integers(0, 3)] * 3, *[st.integers(1, 4)] * 3), min_size=2, max_size=5),
    st.integers(0, 1000),
    st.sampled_from([0, 1]),
)
@example([(3, 3, 3, 3, 1, 2), (3, 1, 3, 1, 2, 4), (2, 3, 2, 1, 2, 3), (2, 3, 2, 2, 4, 2)], 41, 1)
@example(
    [(3, 1, 2, 2, 3, 3)] * 2 + [(0, 1, 3, 4, 2, 1), (3, 1, 1, 2, 3, 3), (0, 0, 2, 2, 1, 2)], 0, 0
)
def test_boxes_on_a_lattice_have_the_volume_and_area_of_their_union(
    boxes: list[tuple[int, ...]], seed: int, single: int
) -> None:
    """Many of their faces are coplanar, and vertices lie on edges and faces of others."""
    cells, parts = np.zeros((9, 9, 9), dtype=np.int64), []
    for box in boxes:
        low, size = np.array(box[:3]), np.array(box[3:])
        cells[tuple(slice(a + 1, a + b + 1) for a, b in zip(low, size, strict=True))] = 1
        parts.append(moved(shapes.box(tuple(size.tolist())), tuple((low + size / 2.0).tolist())))
    vertices, faces = in_order(joined(*parts), seed)
    turned = vertices @ shapes.rotation(seed).T
    found = repaired((turned.astype(np.float32).astype(np.float64) if single else turned, faces))
    area = sum(np.abs(np.diff(cells, axis=axis)).sum() for axis in range(3))
    assert found.closed
    assert volume_of(found) == pytest.approx(cells.sum(), rel=1e-5)
    assert face_areas(found.vertices, found.faces).sum() == pytest.approx(area, rel=1e-5)


@pytest.mark.parametrize("seed", ORDERS)
@pytest.mark.parametrize("turn", [1, -1])
def test_boxes_that_overlap_and_share_an_edge_are_united(seed: int, turn: int) -> None:
    """As in a file without indices, where vertices at one position are one."""
    long = moved(shapes.box((2.0, 0.5, 1.0)), (0.5, -0.25, 0.0))
    both = joined(shapes.box(), (long[0], long[1][:, ::turn]))
    surface = repaired(in_order(over_positions(both), seed))
    assert surface.closed
    assert volume_of(surface) == pytest.approx(1.5)
    assert counts(surface)["united"] == 2


@pytest.mark.parametrize("inside", [True, False])
def test_an_inward_body_at_a_corner_is_a_cavity_if_it_is_inside(*, inside: bool) -> None:
    """Scanners leave such pockets where a surface touches itself."""
    box, pocket = shapes.box(), moved(shapes.box(), (0.475 if inside else 0.525,) * 3, 0.05)
    vertices, faces = joined(box, inward(pocket))
    corner = np.flatnonzero((np.abs(vertices - 0.5) < 1e-9).all(axis=1))
    faces = np.where(faces == corner[1], corner[0], faces)
    surface = repaired((vertices, faces))
    assert counts(surface).get("inverted", 0) == (0 if inside else 12)
    assert surface.bodies == 1


@pytest.mark.slow
def test_many_pairs_are_each_united() -> None:
    """Vertices of distant groups are not confused."""
    pair = joined(shapes.box(), moved(shapes.box(), (0.5, 0.2, 0.1)))
    pairs = [moved(pair, (3.0 * k, 0.0, 0.0)) for k in range(30)]
    found = repaired(moved(joined(*pairs), (0.0, 0.0, 0.0), FINE))
    assert volume_of(found) == pytest.approx(30 * 1.64 * FINE**3, rel=1e-7)
    assert found.bodies == 30
    assert counts(found) == {"united": 60}
    assert np.abs(found.vertices - found.vertices[found.canonical]).max() < 1e-6


def test_opposite_faces_cancel() -> None:
    faces = np.array([[0, 1, 2], [3, 4, 5], [1, 3, 2], [2, 1, 0], [5, 4, 3], [6, 7, 8], [6, 6, 8]])
    assert without_slits(faces).tolist() == [[1, 3, 2], [6, 7, 8]]


def grid_box(extents: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Surface:
    """A box with vertices within its faces."""
    return shapes.arrays(trimesh.creation.box(extents).subdivide().subdivide())


@pytest.mark.parametrize("shift", [(0.3, 0.4, 0.2), (0.3, 0.4, 0.0), (0.5, 0.0, 0.0)])
def test_of_overlapping_boxes_the_vertices_within_are_off_the_surface(
    shift: tuple[float, float, float],
) -> None:
    """Some of their faces are coplanar, and vertices of the one lie in those of the other."""
    box, turn = grid_box(), shapes.rotation(3)
    vertices, faces = joined(box, moved(box, shift))
    mesh = load_mesh((vertices @ turn.T, faces), max_edge=1e9)
    both = float(np.prod(1.0 - np.abs(shift)))
    volume = 2.0 - both
    assert mesh.volume == pytest.approx(volume, rel=1e-8)
    middle = turn @ (np.array(shift) * (1.0 - both / 2.0) / volume)
    assert mesh.center_mass == pytest.approx(middle, abs=1e-8)
    within = (np.abs(vertices) < 0.5 - 1e-9).all(axis=1)
    within |= (np.abs(vertices - shift) < 0.5 - 1e-9).all(axis=1)
    assert np.array_equal(mesh.on_surface[: len(vertices)], ~within)


@pytest.mark.parametrize("box", [shapes.box(), grid_box()])
@pytest.mark.parametrize("turn", [1, -1])
def test_boxes_that_share_the_vertices_of_a_wall_lose_it(box: Surface, turn: int) -> None:
    """Its two sides may be divided by other diagonals."""
    other = box[0] * [turn, 1.0, 1.0], box[1][:, ::turn]
    surface = repaired(over_positions(joined(box, moved(other, (1.0, 0.0, 0.0)))))
    wall = (box[0][box[1]][:, :, 0] == 0.5).all(axis=1).sum()
    assert counts(surface)["walls"] == 2 * wall
    assert_whole(surface)
    assert face_areas(surface.vertices, surface.faces).sum() == pytest.approx(10.0)


def test_a_fin_with_two_sides_is_kept() -> None:
    vertices, faces = shapes.box()
    edge = faces[0][:2]
    tip = 2.0 * vertices[edge].sum(axis=0)
    fin = np.array([[edge[0], edge[1], 8], [edge[1], edge[0], 8]])
    surface = repaired((np.vstack([vertices, tip]), np.vstack([faces, fin])))
    assert len(surface.faces) == 14
    assert surface.steps == ()


def test_linked_rings_are_not_united() -> None:
    ring = shapes.arrays(trimesh.creation.torus(1.0, 0.2, major_sections=24, minor_sections=12))
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    both = joined(ring, (ring[0] @ turn.T + [1.0, 0.0, 0.0], ring[1]))
    surface = repaired(both)
    assert surface.steps == surface.warnings == ()
    assert np.array_equal(surface.faces, both[1])


def test_a_box_within_a_box_is_taken_as_part_of_it() -> None:
    surface = repaired(joined(shapes.box(), moved(shapes.box(), (0.1, 0.0, 0.0), 0.5)))
    assert volume_of(surface) == pytest.approx(1.0)
    assert used_by(surface).tolist() == [True] * 8 + [False] * 8
    assert "1 body within others" in surface.warnings[0]


def test_a_cavity_is_kept_and_filled_by_full_repair() -> None:
    ball = shapes.sphere(2)
    full = volume_of(repaired(ball))
    hollow = joined(ball, inward(moved(ball, (0.0, 0.0, 0.0), 0.5)))
    kept = repaired(hollow)
    assert volume_of(kept) == pytest.approx(full * 7.0 / 8.0)
    assert kept.steps == ()
    filled = repaired(hollow, "full")
    assert volume_of(filled) == pytest.approx(full)
    assert [str(step) for step in filled.steps] == ["1 sealed cavity filled"]


def test_a_union_that_is_not_sound_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(repair, "union_of", lambda _: None)
    surface = repaired(joined(shapes.box(), moved(shapes.box(), (0.4, 0.3, 0.2))))
    assert len(surface.faces) == 24
    assert "2 bodies seem to overlap but could not be united" in surface.warnings[0]


def test_open_shells_that_penetrate_are_closed_and_united() -> None:
    box = shapes.box()
    tray = box[0], box[1][~(box[0][box[1]][:, :, 2] == 0.5).all(axis=1)]
    surface = repaired(joined(tray, moved(tray, (0.5, 0.2, 0.1))), "full")
    assert_whole(surface)
    assert volume_of(surface) == pytest.approx(2.0 - 0.5 * 0.8 * 0.9)
    assert counts(surface) == {"closed": 2, "united": 2}


def test_a_sheet_keeps_its_two_sides_and_a_body_does_not() -> None:
    _, faces = shapes.sphere(2)
    both = np.vstack([faces, faces[:, ::-1]])
    assert without_mirrored(both).sum() == len(faces)
    half = faces[: len(faces) // 2]
    assert without_mirrored(np.vstack([half, half[:, ::-1]])).all()
