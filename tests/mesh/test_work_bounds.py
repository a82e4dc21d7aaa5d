"""Repair and preparation take linear time, or are refused before the work."""

import time
from collections.abc import Callable

import numpy as np
import pytest
import trimesh

from grasp3d import load_mesh
from grasp3d.arrays import Floats
from grasp3d.errors import MeshError
from grasp3d.mesh import work_bounds
from grasp3d.mesh.repair import bodies
from grasp3d.mesh.repair.holes import close_hole, close_holes, fan_area
from grasp3d.mesh.repair.solids import estimated_overlaps, overlapping
from grasp3d.mesh.repair.work import repair_surface
from grasp3d.mesh.work_bounds import WorkBound, cell_counts, close_pairs, pairs_in_cells
from tests.helpers import shapes
from tests.helpers.repairs import joined
from tests.helpers.shapes import Surface

COARSE = 1e9


def book(pages: int) -> Surface:
    """Triangles that share one edge."""
    turn = np.linspace(0.0, 2.0 * np.pi, pages, endpoint=False)
    tips = np.stack([np.cos(turn), np.sin(turn), np.full(pages, 0.5)], axis=1)
    spine = np.broadcast_to([0, 1], (pages, 2))
    return (
        np.vstack([[[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]], tips]),
        np.column_stack([spine, 2 + np.arange(pages)]),
    )


def separate(triangles: int) -> Surface:
    """Small triangles that do not touch."""
    chance = np.random.default_rng(0)
    corners = chance.uniform(size=(triangles, 1, 3)) + chance.normal(0.0, 1e-3, (triangles, 3, 3))
    return corners.reshape(-1, 3), np.arange(3 * triangles).reshape(-1, 3)


def boxes(sides: Floats) -> Surface:
    """Boxes around the origin."""
    return joined(*(shapes.box((side, side, side)) for side in sides.tolist()))


def rods(count: int) -> Surface:
    """Long boxes in random directions, most of which cross."""
    rod, faces = shapes.box((1.0, 0.01, 0.01))
    return joined(*((rod @ shapes.rotation(seed).T, faces) for seed in range(count)))


def seconds(work: Callable[[], object]) -> float:
    """Processor time of this thread."""
    started = time.thread_time()
    work()
    return time.thread_time() - started


@pytest.mark.slow
def test_a_book_of_many_pages_takes_linear_time() -> None:
    load_mesh(book(10), max_edge=COARSE)  # compiles
    for pages in (5_000, 50_000):
        assert seconds(lambda pages=pages: load_mesh(book(pages), max_edge=COARSE)) < pages / 2_500


@pytest.mark.slow
def test_separate_vertices_within_rounding_are_not_refused_for_memory() -> None:
    """As in an STL that was written with errors of rounding: they are joined."""
    vertices, faces = shapes.sphere(6)
    noise = np.random.default_rng(1).uniform(-5e-8, 5e-8, (faces.size, 3))
    surface = vertices[faces.ravel()] + noise, np.arange(faces.size).reshape(-1, 3)
    mesh = load_mesh(surface, max_memory=0.5, max_edge=COARSE)
    assert mesh.report.closed


@pytest.mark.slow
@pytest.mark.parametrize(
    ("surface", "message"),
    [
        pytest.param(boxes(np.linspace(1.0, 2.0, 2000)), "bodies within others", id="nested"),
        pytest.param(boxes(np.full(4000, 1.0)), "copies of bodies would need", id="copies"),
        pytest.param(rods(900), "uniting bodies that overlap would need", id="rods"),
    ],
)
def test_bodies_whose_repair_grows_with_the_square_are_refused(
    surface: Surface, message: str
) -> None:
    started = time.thread_time()
    with pytest.raises(MeshError, match=f"^arrays: .*{message}.* at most .*computed; ") as caught:
        load_mesh(surface, max_edge=COARSE)
    assert time.thread_time() - started < 5.0
    assert str(caught.value).isprintable()
    mesh = load_mesh(surface, max_edge=COARSE, repair="none")
    assert "repair 'safe' would be refused" in mesh.report.warnings[0]


def test_points_within_rounding_of_each_other_are_refused() -> None:
    crowd = np.random.default_rng(0).uniform(0.0, 2e-7, (20_001, 3)).astype(np.float32)
    surface = np.vstack([shapes.box()[0], crowd]), np.arange(8, 20_009).reshape(-1, 3)
    far = np.vstack([surface[1], shapes.box()[1]])
    with pytest.raises(MeshError, match="vertices that differ by rounding would need"):
        load_mesh((surface[0].astype(np.float32), far), max_edge=COARSE)


def test_pairs_are_counted_in_cells_as_they_are() -> None:
    points = np.random.default_rng(2).uniform(size=(300, 3))
    assert cell_counts(points, 1e-9).tolist() == [1] * 300
    assert cell_counts(points, 2.0).tolist() == [300]
    assert pairs_in_cells(points, 2.0) == len(close_pairs(points, 2.0)) == 300 * 299 // 2
    cells = np.floor(points / 0.25).astype(int) @ (1, 100, 10_000)
    assert sorted(cell_counts(points, 0.25)) == sorted(np.unique(cells, return_counts=True)[1])


def test_overlaps_are_estimated_as_they_are_counted() -> None:
    chance = np.random.default_rng(3)
    lower = chance.uniform(size=(500, 3))
    upper = lower + chance.uniform(0.0, 0.3, (500, 3))
    counted = sum(len(one) for one, _ in overlapping(lower, upper))
    assert estimated_overlaps(lower, upper, np.arange(500)) == pytest.approx(counted)
    assert estimated_overlaps(lower, upper, np.zeros(500, dtype=np.int64)) == 0.0


@pytest.mark.parametrize("turned", [False, True])
def test_a_large_open_body_is_turned_by_its_extremes(
    monkeypatch: pytest.MonkeyPatch, *, turned: bool
) -> None:
    monkeypatch.setattr(bodies, "MOST_ON_HULL", 10)
    vertices, faces = shapes.sphere(3)
    faces = faces[20:, ::-1] if turned else faces[20:]
    found = repair_surface(vertices, faces, "safe", "test")
    steps = {step.name: step.count for step in found.steps}
    assert steps.get("inverted", 0) == (len(faces) if turned else 0)


@pytest.mark.slow
def test_many_long_holes_are_closed_in_linear_time(monkeypatch: pytest.MonkeyPatch) -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)
    ring = np.stack([np.cos(turn), np.sin(turn), 0.1 * np.sin(5.0 * turn)], axis=1)
    holes = [np.arange(200)] * 3
    least = close_hole(ring, holes[0])
    assert all(np.array_equal(lid, least) for lid in close_holes(ring, holes))
    monkeypatch.setattr("grasp3d.mesh.repair.holes.MOST_COMPARED", 1e6)
    for lid in close_holes(ring, holes):
        assert lid.shape == (198, 3)
        assert not np.array_equal(lid, least)
        area = trimesh.Trimesh(ring, lid, process=False).area
        assert area == pytest.approx(fan_area(ring, holes[0]), rel=0.1)


def test_a_bound_names_the_step_the_count_and_a_remedy() -> None:
    bounds = [one for one in vars(work_bounds).values() if isinstance(one, WorkBound)]
    assert len(bounds) >= 10
    for bound in bounds:
        bound.check(bound.most)
        with pytest.raises(MeshError) as caught:
            bound.check(2 * bound.most)
        text = str(caught.value)
        assert text.startswith(f"{bound.step} would need {2 * bound.most:,} {bound.things}")
        assert text.endswith(bound.remedy)
