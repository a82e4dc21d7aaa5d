import math

import manifold3d
import numpy as np
import pytest
import trimesh
from scipy.spatial import ConvexHull

from grasp3d import ObjectMesh, Sampling, label_surface, load_mesh
from grasp3d.arrays import first_at_position
from grasp3d.mesh import repair
from grasp3d.mesh.cleaning import LONG, close_hole, disagreeing, holes_of, without_mirrored
from grasp3d.mesh.measures import Triangles, edge_counts, face_areas, is_closed
from grasp3d.mesh.repair import RepairedSurface
from grasp3d.mesh.union import put_on_surface, without_slivers
from grasp3d.settings.mesh_options import Repair
from grasp3d.surface.vertex_fields import Reason
from tests.helpers import shapes
from tests.helpers.repairs import counts, inward, joined, moved, repaired, used_by, volume_of
from tests.helpers.shapes import Surface

COARSE = 1e9


def prepared(surface: Surface, level: Repair = "safe") -> ObjectMesh:
    return load_mesh(surface, max_edge=COARSE, repair=level)


def rotated(surface: Surface, seed: int) -> Surface:
    return surface[0] @ shapes.rotation(seed).T, surface[1]


def grid_box(extents: tuple[float, float, float] = (1.0, 1.0, 1.0)) -> Surface:
    """A box with vertices within its faces."""
    return shapes.arrays(trimesh.creation.box(extents).subdivide().subdivide())


def area_of(surface: RepairedSurface) -> float:
    return float(face_areas(surface.vertices, surface.faces).sum())


def assert_whole(surface: RepairedSurface) -> None:
    """Check the properties of every united surface, and that Manifold accepts it as a solid."""
    assert surface.closed
    assert is_closed(surface.faces)
    assert np.array_equal(surface.canonical[surface.faces], surface.faces)
    assert np.array_equal(surface.canonical[surface.canonical], surface.canonical)
    size = np.ptp(surface.vertices, axis=0).max()
    solid = manifold3d.Manifold(
        manifold3d.Mesh64(surface.vertices / size, surface.faces.astype(np.uint64))
    )
    assert solid.status() == manifold3d.Error.NoError
    assert solid.volume() == pytest.approx(volume_of(surface) / size**3, rel=1e-9)


# Overlaps


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize(
    "shift", [(0.3, 0.4, 0.2), (0.3, 0.4, 0.0), (0.5, 0.0, 0.0), (0.25, 0.1, 0.0)]
)
def test_overlapping_boxes_have_the_volume_of_their_union(
    seed: int, shift: tuple[float, float, float]
) -> None:
    """Some of their faces are coplanar, and vertices of the one lie in those of the other."""
    box = grid_box()
    surface = rotated(joined(box, moved(box, shift)), seed)
    mesh = prepared(surface)
    both = float(np.prod(1.0 - np.abs(shift)))
    volume = 2.0 - both
    assert mesh.volume == pytest.approx(volume, rel=1e-8)
    assert counts(mesh)["united"] == 2
    middle = shapes.rotation(seed) @ (np.array(shift) * (1.0 - both / 2.0) / volume)
    assert mesh.center_mass == pytest.approx(middle, abs=1e-8)
    plain = np.concatenate([box[0], box[0] + shift])
    within = (np.abs(plain) < 0.5 - 1e-9).all(axis=1)
    within |= (np.abs(plain - shift) < 0.5 - 1e-9).all(axis=1)
    assert not mesh.on_surface[: len(plain)][within].any()
    assert mesh.on_surface[: len(plain)][~within].all()
    assert np.array_equal(mesh.vertices[: len(plain)], surface[0])
    x, y, z = 1.0 - np.abs(shift)  # of the boxes' intersection
    area = 12.0 - 2.0 * (x * y + y * z + z * x)
    assert mesh.vertex_areas.sum() == pytest.approx(area, rel=1e-8)


@pytest.mark.slow
@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("shift", [(1.0, 0.0, 0.0), (1.0, 0.3, 0.1), (1.0, 0.5, 0.0)])
def test_boxes_that_touch_lose_the_faces_between_them(
    seed: int, shift: tuple[float, float, float]
) -> None:
    box = grid_box()
    surface = repaired(rotated(joined(box, moved(box, shift)), seed))
    wall = (1.0 - abs(shift[1])) * (1.0 - abs(shift[2]))
    assert_whole(surface)
    assert area_of(surface) == pytest.approx(12.0 - 2.0 * wall, rel=1e-8)
    assert volume_of(surface) == pytest.approx(2.0, rel=1e-8)
    assert surface.bodies == 1
    assert counts(surface)["united"] == 2
    assert used_by(surface).sum() == len(surface.vertices) - enclosed_by_touch(shift)


def enclosed_by_touch(shift: tuple[float, float, float]) -> int:
    """Vertices of two grid boxes that lie within the wall between them."""
    wall = grid_box()[0]
    wall = wall[wall[:, 0] == 0.5][:, 1:]
    inside = [
        (np.abs(wall - np.array(shift[1:]) * sign) < 0.5 - 1e-9).all(axis=1) for sign in (1, -1)
    ]
    inside = [one & (np.abs(wall) < 0.5 - 1e-9).all(axis=1) for one in inside]
    return int(sum(one.sum() for one in inside))


@pytest.mark.parametrize("box", [shapes.box(), grid_box()])
@pytest.mark.parametrize("turn", [1, -1])
def test_boxes_that_share_the_vertices_of_a_wall_lose_it(box: Surface, turn: int) -> None:
    """Its two sides may be divided by other diagonals."""
    other = box[0] * [turn, 1.0, 1.0], box[1][:, ::turn]
    surface = repaired(over_positions(joined(box, moved(other, (1.0, 0.0, 0.0)))))
    wall = (box[0][box[1]][:, :, 0] == 0.5).all(axis=1).sum()
    assert counts(surface)["walls"] == 2 * wall
    assert_whole(surface)
    assert area_of(surface) == pytest.approx(10.0)


def over_positions(surface: Surface) -> Surface:
    """The surface over its positions, as in a file without indices."""
    return surface[0], first_at_position(surface[0])[surface[1]]


def test_a_fin_with_two_sides_is_kept() -> None:
    vertices, faces = shapes.box()
    edge = faces[0][:2]
    tip = 2.0 * vertices[edge].sum(axis=0)
    fin = np.array([[edge[0], edge[1], 8], [edge[1], edge[0], 8]])
    surface = repaired((np.vstack([vertices, tip]), np.vstack([faces, fin])))
    assert len(surface.faces) == 14
    assert surface.steps == ()


def test_boxes_with_one_edge_in_common_are_not_united() -> None:
    box = shapes.box()
    other = moved(box, (1.0, 1.0, 0.0))
    surface = repaired(joined(box, other))
    assert "united" not in counts(surface)
    assert surface.closed
    assert len(surface.faces) == 2 * len(box[1])
    assert volume_of(surface) == pytest.approx(2.0)
    turned = joined(box, inward(other))
    for each in (turned, over_positions(turned)):
        assert counts(repaired(each))["inverted"] == 12
        assert volume_of(repaired(each)) == pytest.approx(2.0)


def test_linked_rings_are_not_united() -> None:
    ring = shapes.arrays(trimesh.creation.torus(1.0, 0.2, major_sections=24, minor_sections=12))
    turn = np.array([[1.0, 0.0, 0.0], [0.0, 0.0, -1.0], [0.0, 1.0, 0.0]])
    both = joined(ring, (ring[0] @ turn.T + [1.0, 0.0, 0.0], ring[1]))
    surface = repaired(both)
    assert surface.steps == surface.warnings == ()
    assert np.array_equal(surface.faces, both[1])


@pytest.mark.slow
def test_three_overlapping_balls_have_the_volume_of_their_union() -> None:
    """Compared with random points counted in the hulls, which swallow vertices of the others."""
    centers = [(0.0, 0.0, 0.0), (0.9, 0.1, 0.2), (0.3, 0.8, -0.3)]
    balls = [moved(rotated(shapes.sphere(2), k), center) for k, center in enumerate(centers)]
    vertices, faces = joined(*balls)
    surface = repaired((vertices, faces))
    assert_whole(surface)
    assert counts(surface) == {"united": 3}
    points = np.random.default_rng(0).uniform(-1.5, 2.5, (50_000, 3))
    inside, swallowed = (np.zeros(len(x), dtype=bool) for x in (points, vertices))
    for ball, _ in balls:
        planes = ConvexHull(ball).equations
        inside |= (points @ planes[:, :3].T + planes[:, 3] < 0.0).all(axis=1)
        swallowed |= (vertices @ planes[:, :3].T + planes[:, 3] < -1e-9).all(axis=1)
    assert volume_of(surface) == pytest.approx(64.0 * inside.mean(), rel=0.02)
    assert np.array_equal(used_by(surface)[: len(vertices)], ~swallowed)
    assert swallowed.any()


def test_a_chain_of_boxes_is_one_bar_with_its_labels() -> None:
    boxes = [moved(shapes.box((1.2, 1.0, 1.0)), (float(k), 0.0, 0.0)) for k in range(5)]
    surface = joined(*boxes)
    mesh = load_mesh(surface)
    assert mesh.report.bodies == 1
    assert counts(mesh) == {"united": 5}
    assert mesh.volume == pytest.approx(5.2)
    assert mesh.center_mass == pytest.approx([2.0, 0.0, 0.0], abs=1e-8)
    labels = label_surface(mesh, sampling=Sampling(rays=16))
    bar = load_mesh(moved(shapes.box((5.2, 1.0, 1.0)), (2.0, 0.0, 0.0)))
    expected = label_surface(bar, sampling=Sampling(rays=16)).fractions()
    assert labels.fractions() == pytest.approx(expected, abs=0.05)


def test_an_enclosed_vertex_belongs_to_no_face() -> None:
    mesh = load_mesh(joined(shapes.box(), moved(shapes.box(), (0.4, 0.3, 0.2))))
    labels = label_surface(mesh, sampling=Sampling(rays=16))
    swallowed = labels.reason[:16] == Reason.OFF_SURFACE
    assert swallowed.sum() == 2
    assert (labels.label[:16][swallowed] == 0).all()
    assert len(mesh.vertices) > mesh.file_vertices == 16


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


def test_a_body_that_reaches_into_a_cavity_fills_part_of_it() -> None:
    """A bar through the wall of a hollow box, and a ball that lies loose in the cavity."""
    hollow = joined(shapes.box(), inward(shapes.box((0.6, 0.6, 0.6))))
    bar = moved(shapes.box((0.5, 0.1, 0.1)), (0.5, 0.0, 0.0))  # from 0.25 to 0.75
    ball = moved(shapes.sphere(1), (-0.1, 0.0, 0.0), 0.1)
    surface = repaired(joined(hollow, bar, ball))
    assert_whole(surface)
    expected = 1.0 - 0.6**3 + 0.01 * (0.05 + 0.25) + volume_of(repaired(ball))
    assert volume_of(surface) == pytest.approx(expected)
    assert counts(surface) == {"united": 2}
    assert surface.warnings == ()


def test_a_union_that_is_not_sound_is_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(repair, "union_of", lambda _: None)
    surface = repaired(joined(shapes.box(), moved(shapes.box(), (0.4, 0.3, 0.2))))
    assert len(surface.faces) == 24
    assert "2 bodies seem to overlap but could not be united" in surface.warnings[0]


# Copies


@pytest.mark.parametrize("turn", [1, -1])
def test_of_a_body_and_its_copy_one_remains(turn: int) -> None:
    box = shapes.box()
    other = box[0] + np.spacing(1.0), box[1][::-1, ::turn]
    surface = repaired(joined(box, moved(box, (3.0, 0.0, 0.0)), other))
    inverted = {"inverted": 12} if turn < 0 else {}
    assert counts(surface) == {**inverted, "united": 2}
    assert len(surface.faces) == 24
    assert volume_of(surface) == pytest.approx(2.0)
    assert surface.canonical[16:].tolist() == list(range(8))


def test_a_sheet_keeps_its_two_sides_and_a_body_does_not() -> None:
    _, faces = shapes.sphere(2)
    both = np.vstack([faces, faces[:, ::-1]])
    assert without_mirrored(both).sum() == len(faces)
    half = faces[: len(faces) // 2]
    assert without_mirrored(np.vstack([half, half[:, ::-1]])).all()


# Welding


def test_the_two_sides_of_a_thin_plate_are_not_joined() -> None:
    """Open at one side, and thinner than the largest distance of welding."""
    vertices, faces = shapes.box((1.0, 1.0, 5e-7))
    side = (vertices[faces][:, :, 0] == 0.5).all(axis=1)
    surface = repaired((vertices, faces[~side]))
    assert counts(surface) == {"filled": 2}
    assert volume_of(surface) == pytest.approx(5e-7)


def test_a_sliver_between_two_rounded_vertices_vanishes_when_they_are_joined() -> None:
    vertices, faces = shapes.box()
    soup = vertices[faces].reshape(-1, 3)
    soup[np.random.default_rng(0).random(len(soup)) < 0.5] += np.spacing(0.5)
    own = np.arange(len(soup)).reshape(-1, 3)
    twins = np.flatnonzero((np.abs(soup - soup[0]) < 1e-9).all(axis=1))
    other = next(k for k in twins if soup[k, 0] != soup[0, 0])
    surface = repaired((soup, np.vstack([own, [[0, other, 1]]])))
    assert counts(surface)["sunk"] == 1
    assert_whole(surface)
    assert volume_of(surface) == pytest.approx(1.0)
    assert used_by(surface).all()


def test_a_gap_wider_than_rounding_is_kept() -> None:
    vertices, faces = shapes.sphere(2)
    corners = vertices[faces]
    apart = (corners * (1.0 + 1e-4 * np.arange(len(faces))[:, None, None] % 3)).reshape(-1, 3)
    surface = repaired((apart, np.arange(len(apart)).reshape(-1, 3)))
    assert not surface.closed
    assert "joined" not in counts(surface)


# Winding


def test_a_strip_with_one_side_is_open_and_not_changed() -> None:
    turn = np.linspace(0.0, 2.0 * math.pi, 24, endpoint=False)
    across = np.array([-0.2, 0.2])[:, None]
    radius = 1.0 + across * np.cos(turn / 2.0)
    ring = np.stack([radius * np.cos(turn), radius * np.sin(turn), across * np.sin(turn / 2.0)], 2)
    low, high = np.arange(24), np.arange(24, 48)
    after, above = np.append(low[1:], 24), np.append(high[1:], 0)  # the ends meet upside down
    faces = np.concatenate(
        [np.stack([low, after, high], axis=1), np.stack([after, above, high], axis=1)]
    )
    assert not disagreeing(faces).any()
    surface = repaired((ring.reshape(-1, 3), faces))
    assert not surface.closed
    assert np.array_equal(surface.faces, faces)


def test_the_fewest_faces_are_flipped() -> None:
    _, faces = shapes.sphere(3)
    wrong = np.random.default_rng(1).random(len(faces)) < 0.4
    mixed = np.where(wrong[:, None], faces[:, ::-1], faces)
    assert np.array_equal(disagreeing(mixed), wrong)


def opened(surface: Surface, low: float) -> Surface:
    """Without the faces below a fraction of the height."""
    vertices, faces = surface
    height = vertices[faces].mean(axis=1)[:, 2]
    return vertices, faces[height > np.quantile(height, low)]


def thin_cup() -> Surface:
    """A cup with a wall of 1 % of its size: most normals of its inside point to the middle."""
    cup = manifold3d.Manifold.cylinder(1.0, 0.5, 0.5, 48) - (
        manifold3d.Manifold.cylinder(1.0, 0.49, 0.49, 48).translate((0.0, 0.0, 0.01))
    )
    mesh = cup.refine_to_length(0.1).to_mesh64()
    return np.array(mesh.vert_properties), np.array(mesh.tri_verts).astype(np.int64)


@pytest.mark.parametrize("turn", [1, -1])
@pytest.mark.parametrize(
    "body",
    [*(opened(shapes.sphere(3), part) for part in (0.02, 0.5, 0.8)), opened(thin_cup(), 0.1)],
)
def test_an_open_body_is_wound_outward(body: Surface, turn: int) -> None:
    vertices, faces = body
    surface = repaired((vertices, faces[:, ::turn]))
    assert not surface.closed
    assert np.array_equal(surface.faces, faces)
    assert counts(surface).get("inverted", 0) == (len(faces) if turn < 0 else 0)


def test_a_rough_sheet_is_not_turned() -> None:
    x, y = np.meshgrid(np.arange(20.0), np.arange(20.0))
    rough = 0.02 * np.random.default_rng(0).normal(size=x.size)
    points = np.stack([x.ravel(), y.ravel(), rough], axis=1)
    low = (np.arange(19)[:, None] * 20 + np.arange(19)).reshape(-1, 1)
    faces = np.concatenate([low + [0, 1, 20], low + [1, 21, 20]])
    assert repaired((points, faces)).steps == repaired((points, faces[:, ::-1])).steps == ()


# Holes


def test_holes_that_meet_at_a_vertex_are_two() -> None:
    _, faces = shapes.sphere(2)
    vertex = faces[0, 0]
    around = np.flatnonzero((faces == vertex).any(axis=1))
    neighbours = faces[around]
    far = next(
        k for k in range(1, len(around)) if len(set(neighbours[0]) & set(neighbours[k])) == 1
    )
    opened = np.delete(faces, around[[0, far]], axis=0)
    holes = holes_of(opened)
    assert sorted(map(len, holes)) == [3, 3]
    assert {frozenset(hole.tolist()) for hole in holes} == {
        frozenset(neighbours[0].tolist()),
        frozenset(neighbours[far].tolist()),
    }


@pytest.mark.parametrize("count", [3, 4, 5, 12, LONG + 44])
def test_a_hole_is_closed_by_faces_in_its_winding(count: int) -> None:
    angle = np.linspace(0.0, 2.0 * math.pi, count, endpoint=False)
    rng = np.random.default_rng(count)
    radius = 1.0 + 0.5 * rng.random(count)
    points = np.stack([radius * np.cos(angle), radius * np.sin(angle), 0.0 * angle], axis=1)
    points = points @ shapes.rotation(count).T
    added = close_hole(points, np.arange(count))
    star = 0.5 * (radius * np.roll(radius, -1)).sum() * math.sin(2.0 * math.pi / count)
    assert len(added) == count - 2
    assert face_areas(points, added).sum() == pytest.approx(star)  # no less, and no more if flat
    fan = np.array([[k, count, (k + 1) % count] for k in range(count)])
    assert is_closed(np.vstack([added, fan]))


def test_no_triangulation_of_a_hole_has_less_area() -> None:
    points = np.random.default_rng(4).normal(size=(6, 3))

    def least(first: int, last: int) -> float:
        if last - first < 2:
            return 0.0
        return min(
            least(first, k)
            + least(k, last)
            + float(face_areas(points, np.array([[first, k, last]]))[0])
            for k in range(first + 1, last)
        )

    added = close_hole(points, np.arange(6))
    assert face_areas(points, added).sum() == pytest.approx(least(0, 5))


@pytest.mark.parametrize("sections", [24, LONG + 44])
def test_full_repair_closes_every_hole_and_reports_it(sections: int) -> None:
    pipe = trimesh.creation.cylinder(0.5, 2.0, sections=sections)
    side = np.abs(pipe.vertices[pipe.faces][:, :, 2].sum(axis=1)) < 2.9
    opened = np.array(pipe.vertices), np.array(pipe.faces)[side]
    assert not repaired(opened).closed
    surface = repaired(opened, "full")
    assert_whole(surface)
    assert volume_of(surface) == pytest.approx(pipe.volume)
    assert counts(surface) == {"closed": 2}
    assert "2 holes closed by a guess that adds 2" in surface.warnings[0]


def test_open_shells_that_penetrate_are_closed_and_united() -> None:
    box = shapes.box()
    tray = box[0], box[1][~(box[0][box[1]][:, :, 2] == 0.5).all(axis=1)]
    surface = repaired(joined(tray, moved(tray, (0.5, 0.2, 0.1))), "full")
    assert_whole(surface)
    assert volume_of(surface) == pytest.approx(2.0 - 0.5 * 0.8 * 0.9)
    assert counts(surface) == {"closed": 2, "united": 2}


# Levels


def test_without_repair_the_surface_is_unchanged() -> None:
    vertices, faces = shapes.sphere(2)
    broken = joined(
        (vertices, np.vstack([faces[1:, ::-1], faces[5:6, ::-1]])),
        moved(shapes.box(), (5.0, 0.0, 0.0)),
    )
    surface = repaired(broken, "none")
    assert np.array_equal(surface.faces, broken[1])
    assert surface.steps == surface.warnings == ()


def test_without_repair_positions_are_joined_and_faces_without_area_left_out() -> None:
    vertices, faces = shapes.box()
    split = vertices[faces].reshape(-1, 3), np.arange(36).reshape(-1, 3)
    with_point = split[0], np.vstack([split[1], [[0, 0, 1]]])
    surface = repaired(with_point, "none")
    assert surface.closed
    assert counts(surface) == {"welded": 28, "collapsed": 1}
    assert surface.warnings == ()


# Seams


def test_a_loose_vertex_becomes_a_corner() -> None:
    vertices, faces = shapes.box()
    on_edge = vertices[faces[0][:2]].mean(axis=0)
    on_face = vertices[faces[3]].mean(axis=0)
    off = np.array([0.1, 0.2, 0.0])
    points = np.vstack([vertices, on_edge, on_face, off])
    divided = put_on_surface(points, faces, np.array([8, 9, 10]), 1e-9)
    assert is_closed(divided)
    assert len(divided) == 12 + 2 + 2
    assert {8, 9} < set(divided.ravel().tolist())
    assert 10 not in divided
    assert Triangles(points, divided).volumes.sum() == pytest.approx(1.0)
    assert face_areas(points, divided).sum() == pytest.approx(6.0)


def test_the_longest_edge_of_a_sliver_is_flipped() -> None:
    vertices, faces = shapes.box()
    a, b, c = faces[0]
    points = np.vstack([vertices, vertices[[a, b]].mean(axis=0)])
    cut = np.vstack([faces[1:], [[a, 8, c], [8, b, c], [a, b, 8]]])
    cleaned = without_slivers(points, cut, 1e-12)
    assert is_closed(cleaned)
    assert face_areas(points, cleaned).min() > 0.1
    assert face_areas(points, cleaned).sum() == pytest.approx(6.0)
    assert edge_counts(cleaned) == (0, 0)


def test_edges_are_counted_by_their_faces_and_directions() -> None:
    _, faces = shapes.box()
    assert is_closed(faces)
    assert not is_closed(faces[1:])
    assert not is_closed(np.vstack([faces[1:], faces[:1, ::-1]]))
    assert edge_counts(faces) == (0, 0)
    assert edge_counts(faces[1:]) == (3, 0)
    assert edge_counts(np.vstack([faces, [[*faces[0][:2], 8]]])) == (2, 1)


def test_a_lone_face_is_not_closed_by_its_reverse() -> None:
    vertices, faces = shapes.box()
    stray = np.array([[9.0, 9.0, 9.0], [9.1, 9.0, 9.0], [9.0, 9.1, 9.0]])
    found = repaired((np.concatenate([vertices, stray]), np.append(faces, [[8, 9, 10]], axis=0)))
    assert not found.closed
    assert found.steps == ()
    assert len(found.faces) == len(faces) + 1
