"""Speed of labels with uncertain friction, normals, contact locations and fingers.

Relabels a surface of about 100,000 vertices in every uncertainty, and compares the CPU time of the
search with and without a location error, of which the search takes account. Prints medians; all in
one run, on one thread.

    python scripts/bench_uncertainty.py [MESH ...]
"""

import argparse
import statistics
import time
from collections.abc import Callable
from functools import partial
from pathlib import Path

import trimesh
from rich.console import Console
from rich.table import Table

from grasp3d import GraspModel, Sampling, label_surface, load_mesh, running

REPEATS = 15
RELATIVE_ERROR = 0.01
"""Location error of the search, in object sizes."""

CHANGES: dict[str, dict[str, object]] = {
    "friction interval": {"friction": (0.35, 0.55)},
    "normal error": {"normal_error": 0.05},
    "location error": {"location_error": 0.01},
    "all three": {"friction": (0.35, 0.55), "normal_error": 0.05, "location_error": 0.01},
    "all, fingers differ": {
        "friction": (0.35, 0.55), "location_error": 0.01,
        "per_finger": "normal_error=3; location_error=0.005, friction=0.3..0.5",
    },
}  # fmt: skip
"""New values of each relabelling, of a ball of radius 1."""


def median_time(work: Callable[[], object], repeats: int) -> float:
    """Median CPU time of some work [s]."""
    times = []
    for _ in range(repeats):
        start = time.process_time()
        work()
        times.append(time.process_time() - start)
    return statistics.median(times)


def relabelling() -> Table:
    """Times of relabelling a bumpy ball."""
    ball = trimesh.creation.icosphere(subdivisions=7)
    ball.vertices *= 1.0 + 0.05 * trimesh.unitize(ball.vertices).prod(axis=1, keepdims=True)
    subdivided = load_mesh(ball, max_edge=9.0)
    labels = label_surface(subdivided, sampling=Sampling(search_angle=1.2))
    count = len(labels.mesh.vertices)
    table = Table("relabelled", f"{count:,} vertices", "100,000 vertices")
    for name, change in CHANGES.items():

        def work(change: dict[str, object] = change) -> None:
            labels.relabel(**change).label  # type: ignore[arg-type]  # noqa: B018

        work()  # lines of the grasps are computed once
        seconds = median_time(work, REPEATS)
        table.add_row(name, f"{1e3 * seconds:.1f} ms", f"{1e8 * seconds / count:.1f} ms")
    return table


def searching(paths: list[Path]) -> Table:
    """CPU times of the search with a location error, relative to those without."""
    table = Table("mesh", "known", "uncertain", "ratio")
    for path in paths:
        mesh = load_mesh(path)
        unsure = GraspModel(location_error=RELATIVE_ERROR * mesh.size)
        label_surface(mesh)
        times = [
            median_time(partial(label_surface, mesh, model), 3) for model in (GraspModel(), unsure)
        ]
        cells = (f"{seconds:.2f} s" for seconds in times)
        table.add_row(path.name, *cells, f"{times[1] / times[0]:.2f}")
    return table


def main() -> None:
    """Print both tables."""
    parser = argparse.ArgumentParser(description=__doc__.split("\n", maxsplit=1)[0])
    parser.add_argument("meshes", nargs="*", type=Path)
    folder = Path(__file__).parents[1] / "meshes"
    default = [folder / name for name in ("mug.glb", "wrench.glb", "sphere.stl", "banana.ply")]
    paths = parser.parse_args().meshes or default
    console = Console()
    console.print(relabelling())
    console.print(searching(paths))


if __name__ == "__main__":
    with running(threads=1):
        main()
