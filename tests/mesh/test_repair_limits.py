"""Repair and preparation of large and hostile surfaces: linear time, or an error from limits."""

import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import trimesh

from grasp3d import load_mesh
from grasp3d.arrays import Floats
from grasp3d.cli import main
from grasp3d.mesh import preparing
from tests.helpers import shapes
from tests.helpers.repairs import joined, repaired, volume_of
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
def test_many_bodies_within_each_other_become_one() -> None:
    surface = repaired(boxes(np.linspace(1.0, 2.0, 1000)))
    assert volume_of(surface) == pytest.approx(8.0)
    assert len(surface.faces) == 12


@pytest.mark.skipif(sys.platform != "linux", reason="limits of memory are Linux's")
@pytest.mark.parametrize(
    ("limit", "value", "message"),
    [("MEMORY", 1e6, "more than 0.001 GB"), ("SECONDS", 0.01, "more than 0.01 s")],
)
def test_repair_beyond_a_limit_is_an_error_in_a_command_and_not_in_python(
    limit: str,
    value: float,
    message: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    monkeypatch.setattr(preparing, limit, value)
    surface = boxes(np.full(1000, 1.0))  # 4 million pairs of vertices at one position
    path = tmp_path / "a.ply"
    trimesh.Trimesh(*surface, process=False).export(path)
    monkeypatch.chdir(tmp_path)
    assert main(["label", str(path), "--unit", "m", "--max-edge", "1m"]) == 2
    printed = capsys.readouterr().err
    assert f"{path}: repairing it " in printed
    assert message in printed
    assert "mend it in a CAD program, or give --repair none" in printed
    assert load_mesh(path, max_edge=COARSE).volume == pytest.approx(1.0)
