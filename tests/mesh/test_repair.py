"""Repair of single surfaces: welding, winding, holes, seams, and limits of large ones."""

import math
import sys
import time
from collections.abc import Callable
from pathlib import Path

import manifold3d
import numpy as np
import pytest
import trimesh

from grasp3d import load_mesh
from grasp3d.arrays import Floats
from grasp3d.cli import main
from grasp3d.mesh import preparing
from grasp3d.mesh.cleaning import LONG, close_hole, disagreeing, holes_of
from grasp3d.mesh.measures import Triangles, edge_counts, face_areas, is_closed
from grasp3d.mesh.union import put_on_surface, without_slivers
from tests.helpers import shapes
from tests.helpers.commands import export
from tests.helpers.repairs import assert_whole, counts, joined, moved, repaired, used_by, volume_of
from tests.helpers.shapes import Surface

COARSE = 1e9


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


@pytest.mark.parametrize("seed", range(4))
def test_no_triangulation_of_a_hole_has_less_area(seed: int) -> None:
    points = np.random.default_rng(seed).normal(size=(6, 3))

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


def test_without_repair_the_surface_is_unchanged() -> None:
    vertices, faces = shapes.sphere(2)
    broken = joined(
        (vertices, np.vstack([faces[1:, ::-1], faces[5:6, ::-1]])),
        moved(shapes.box(), (5.0, 0.0, 0.0)),
    )
    surface = repaired(broken, "none")
    assert np.array_equal(surface.faces, broken[1])
    assert surface.steps == surface.warnings == ()


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


def test_a_lone_face_is_not_closed_by_its_reverse() -> None:
    vertices, faces = shapes.box()
    stray = np.array([[9.0, 9.0, 9.0], [9.1, 9.0, 9.0], [9.0, 9.1, 9.0]])
    found = repaired((np.concatenate([vertices, stray]), np.append(faces, [[8, 9, 10]], axis=0)))
    assert not found.closed
    assert found.steps == ()
    assert len(found.faces) == len(faces) + 1


def book(pages: int) -> Surface:
    """Triangles that share one edge."""
    turn = np.linspace(0.0, 2.0 * np.pi, pages, endpoint=False)
    tips = np.stack([np.cos(turn), np.sin(turn), np.full(pages, 0.5)], axis=1)
    spine = np.broadcast_to([0, 1], (pages, 2))
    return (
        np.vstack([[[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]], tips]),
        np.column_stack([spine, 2 + np.arange(pages)]),
    )


def boxes(sides: Floats) -> Surface:
    """Boxes around the origin."""
    return joined(*(shapes.box((side, side, side)) for side in sides.tolist()))


def seconds(work: Callable[[], object]) -> float:
    """Processor time of this thread."""
    started = time.thread_time()
    work()
    return time.thread_time() - started


@pytest.mark.slow
def test_a_book_of_many_pages_takes_linear_time() -> None:
    load_mesh(book(10), max_edge=COARSE)  # compiles
    few, many = (
        seconds(lambda pages=pages: load_mesh(book(pages), max_edge=COARSE))
        for pages in (5_000, 20_000)
    )
    assert many < 10.0 * few  # quadratic time would be 16 times as long


@pytest.mark.slow
def test_many_bodies_within_each_other_become_one() -> None:
    surface = repaired(boxes(np.linspace(1.0, 2.0, 1000)))
    assert volume_of(surface) == pytest.approx(8.0)
    assert len(surface.faces) == 12


@pytest.mark.slow
@pytest.mark.skipif(sys.platform != "linux", reason="limits of memory are Linux's")
@pytest.mark.parametrize(
    ("limit", "value", "message"),
    [("MEMORY", 1e6, "more than 0.001 GB"), ("SECONDS", 0.01, "more than 0.01 s")],
)
def test_repair_beyond_a_limit_is_an_error_in_a_command_and_not_in_python(
    limit: str, value: float, message: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    monkeypatch.setattr(preparing, limit, value)
    surface = boxes(np.full(1000, 1.0))  # 4 million pairs of vertices at one position
    path = export(tmp_path / "a.ply", surface)
    monkeypatch.chdir(tmp_path)
    assert main(["label", str(path), "--unit", "m", "--max-edge", "1m"]) == 2
    printed = capsys.readouterr().err
    assert f"{path}: repairing it " in printed
    assert message in printed
    assert "mend it in a CAD program, or give --repair none" in printed
    assert load_mesh(path, max_edge=COARSE).volume == pytest.approx(1.0)
