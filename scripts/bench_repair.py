"""Time of each step of repair and preparation on shapes that make it expensive, with its bound.

Every shape is made at two or three sizes. For each step that took time this prints the processor
time and the exponent of its growth with the size, 1 for linear; a shape that exceeds the bound of a
step is refused before the work, and the last column is its message.

    python scripts/bench_repair.py [SHAPE ...]
"""

import argparse
import math
import time
from collections.abc import Callable

import numpy as np
import numpy.typing as npt
import trimesh
from rich.console import Console
from rich.table import Table

from grasp3d.errors import MeshError
from grasp3d.mesh import preparing, work_bounds
from grasp3d.mesh.mesh_sources import read_source
from grasp3d.mesh.repair import work
from grasp3d.mesh.repair.work import Work
from grasp3d.settings import MeshOptions

Floats = npt.NDArray[np.float64]
Ints = npt.NDArray[np.int64]
Shape = tuple[Floats, Ints]

STEPS = (
    "__init__", "weld", "leave_out_repeated", "wind", "leave_out_needles", "fill",
    "leave_out_copies", "turn_outward", "fill_cavities", "unite", "leave_out_flat", "result",
)  # fmt: skip
SLOW = 0.1
"""Time below which a step is not printed [s]."""


def book(pages: int) -> Shape:
    """Faces that share one edge."""
    turn = np.linspace(0.0, 2.0 * np.pi, pages, endpoint=False)
    tips = np.stack([np.cos(turn), np.sin(turn), np.full(pages, 0.5)], axis=1)
    ends = np.array([[0.0, 0.0, 0.0], [0.0, 0.0, 1.0]])
    faces = np.column_stack([np.zeros(pages), np.ones(pages), 2 + np.arange(pages)])
    return np.vstack([ends, tips]), faces.astype(np.int64)


def separate(triangles: int) -> Shape:
    """Small faces that do not touch."""
    chance = np.random.default_rng(0)
    corners = chance.uniform(size=(triangles, 1, 3)) + chance.normal(0.0, 2e-3, (triangles, 3, 3))
    return corners.reshape(-1, 3), np.arange(3 * triangles).reshape(-1, 3)


def of_bodies(bodies: list[trimesh.Trimesh]) -> Shape:
    """Separate bodies in one surface."""
    starts = np.cumsum([0, *(len(body.vertices) for body in bodies)])
    faces = [body.faces + start for body, start in zip(bodies, starts, strict=False)]
    return np.vstack([body.vertices for body in bodies]), np.vstack(faces).astype(np.int64)


def rods(count: int) -> Shape:
    """Long boxes in random directions, most of which cross."""
    chance, made = np.random.default_rng(0), []
    for _ in range(count):
        rod = trimesh.creation.box([1.0, 0.01, 0.01])
        turn = trimesh.transformations.random_rotation_matrix(chance.random(3))
        made.append(rod.apply_transform(turn).apply_translation(chance.normal(0.0, 0.05, 3)))
    return of_bodies(made)


def bricks(count: int) -> Shape:
    """Boxes side by side."""
    side = max(1, round(count ** (1.0 / 3.0)))
    box = trimesh.creation.box([1.0] * 3)
    return of_bodies(
        [box.copy().apply_translation(corner) for corner in np.ndindex(side, side, side)]
    )


def nested(count: int) -> Shape:
    """Boxes within one another."""
    return of_bodies([trimesh.creation.box([side] * 3) for side in np.linspace(1.0, 2.0, count)])


def copies(count: int) -> Shape:
    """One box, many times."""
    return of_bodies([trimesh.creation.box([1.0] * 3)] * count)


def crowd(count: int) -> Shape:
    """Small faces within rounding of each other, and one far away."""
    vertices, faces = separate(count)
    near = ((vertices - 0.5) * 1e-6).astype(np.float32).astype(np.float64)
    return np.vstack([near, np.eye(3)]), np.vstack([faces, len(near) + np.array([[0, 1, 2]])])


def domes(count: int) -> Shape:
    """Pyramids without a base over one square."""
    square = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [1.0, 1.0, 0.0], [0.0, 1.0, 0.0]])
    tops = np.column_stack([np.full((count, 2), 0.5), 0.1 + np.arange(count) / count])
    ring = np.column_stack([np.arange(4), np.roll(np.arange(4), -1)])
    faces = [np.column_stack([ring, np.full(4, 4 + k)]) for k in range(count)]
    return np.vstack([square, tops]), np.vstack(faces)


def needle(count: int) -> Shape:
    """A cone with many sides: one vertex with many normals."""
    cone = trimesh.creation.cone(0.5, 1.0, sections=count)
    return np.array(cone.vertices), np.array(cone.faces, dtype=np.int64)


def punched(count: int) -> Shape:
    """Rings, each an open tube with two holes of 200 edges."""
    turn = np.linspace(0.0, 2.0 * np.pi, 200, endpoint=False)
    ring = np.column_stack([np.cos(turn), np.sin(turn), np.zeros(200)])
    lower, next_ = np.arange(200), np.roll(np.arange(200), -1)
    sides = np.vstack([
        np.column_stack([lower, next_, lower + 200]),
        np.column_stack([next_, next_ + 200, lower + 200]),
    ])  # fmt: skip
    tube = np.vstack([ring, ring + np.array([0.0, 0.0, 0.2])])
    shift = np.array([0.0, 0.0, 0.5])
    return (
        np.vstack([tube + k * shift for k in range(count)]),
        np.vstack([sides + 400 * k for k in range(count)]),
    )


SHAPES: dict[str, tuple[Callable[[int], Shape], tuple[int, ...]]] = {
    "book": (book, (12_500, 50_000)),
    "separate": (separate, (50_000, 200_000, 1_000_000)),
    "crowd": (crowd, (500, 2_000, 20_000)),
    "copies": (copies, (1_000, 2_000, 5_000)),
    "nested": (nested, (500, 1_000, 4_000)),
    "bricks": (bricks, (1_000, 8_000)),
    "rods": (rods, (100, 200, 1_000)),
    "domes": (domes, (5_000, 20_000)),
    "needle": (needle, (10_000, 40_000)),
    "punched": (punched, (50, 200)),
}
"""Shapes by name, and their sizes."""


def main() -> None:
    """Print the bounds, and the times of each shape."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("shapes", nargs="*", metavar="SHAPE")
    options = parser.parse_args()
    bounds = Table("step", "at most", "of")
    for bound in vars(work_bounds).values():
        if isinstance(bound, work_bounds.WorkBound):
            bounds.add_row(bound.step, f"{bound.most:,}", bound.things)
    console = Console()
    console.print(bounds)
    times: dict[str, float] = {}
    _measure_steps(times)
    table = Table("shape", "size", "step", "time [s]", "growth", "answer")
    for name in options.shapes or SHAPES:
        make, sizes = SHAPES[name]
        before: dict[str, float] = {}
        for size in sizes:
            answer = _prepared(make(size), times)
            total = {"all": sum(times.values())} | times
            for step, seconds in total.items():
                if seconds >= SLOW or step == "all":
                    growth = _growth(before.get(step), seconds, sizes, size)
                    last = answer if step == "all" else ""
                    table.add_row(name, f"{size:,}", step, f"{seconds:.2f}", growth, last)
            before = total
    console.print(table)


def _prepared(shape: Shape, times: dict[str, float]) -> str:
    """Prepare a shape, with the times of the steps in `times`; returns its error if refused."""
    times.clear()
    options = MeshOptions(max_edge=1e6, repair="full")
    try:
        given = read_source(shape)
        started = time.process_time()
        repaired = preparing.repair_given(given, options)
        times["checks"] = time.process_time() - started - sum(times.values())
        started = time.process_time()
        mesh = preparing.refined_mesh(given, repaired, options)
        times["normals and refinement"] = time.process_time() - started
    except MeshError as error:
        return str(error)
    return f"{len(mesh.faces):,} faces"


def _measure_steps(times: dict[str, float]) -> None:
    """Make each step of repair add its processor time to `times`."""

    class Timed(Work):
        pass

    for step in STEPS:
        setattr(Timed, step, _timed(getattr(Work, step), step, times))
    work.Work = Timed  # type: ignore[misc]


def _timed(
    method: Callable[..., object], step: str, times: dict[str, float]
) -> Callable[..., object]:
    def run(*arguments: object, **options: object) -> object:
        started = time.process_time()
        try:
            return method(*arguments, **options)
        finally:
            times[step] = times.get(step, 0.0) + time.process_time() - started

    return run


def _growth(before: float | None, seconds: float, sizes: tuple[int, ...], size: int) -> str:
    """Exponent of the time's growth since the size before."""
    if before is None or before < SLOW or seconds < SLOW:
        return ""
    return f"{math.log(seconds / before) / math.log(size / sizes[sizes.index(size) - 1]):.1f}"


if __name__ == "__main__":
    main()
