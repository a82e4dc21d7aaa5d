"""Epsilon of two hard fingers with circular cones: time and agreement with the growing hull.

The first table has random pairs of six kinds, computed by the public function on one thread, and
the same pairs by the growing hull, which solves all other grasps; `disjoint` counts the pairs where
the two intervals have no common value. The second has the meshes of the library: seconds for the
labels of a mesh, for epsilon of all its vertices (nominal, minimum, bound), and for that by the
growing hull.

    python scripts/bench_pairs.py [--pairs 4000] [--hulls 200] [--kinds random ...] [--no-meshes]
"""

import argparse
import math
import time
from collections.abc import Callable
from pathlib import Path
from typing import get_args
from unittest.mock import patch

import numpy as np

import grasp3d
from grasp3d.quality.wrench_problem import WrenchProblem
from grasp3d.settings.grasp_model import Actuation

MESHES = Path(__file__).parents[1] / "meshes"

KINDS = {
    "antipodal": (0.0, 0.0),
    "nearly antipodal": (1e-3, 1e-3),
    "almost antipodal": (1e-6, 1e-6),
    "aligned, off centre": (0.5, 0.0),
    "centred, tilted": (0.0, 0.3),
    "random": (0.5, 0.3),
}
"""Standard deviations of the centre of mass from the line, and of the normals."""


def drawn(kind: str, count: int, seed: int = 0) -> grasp3d.Contacts:
    """Random force-closed pairs of a kind, friction 0.2 to 1."""
    rng, (shift, tilt) = np.random.default_rng(seed), KINDS[kind]
    found: list[grasp3d.Contacts] = []
    while sum(len(one.points) for one in found) < count:
        line = rng.normal(size=(count, 3))
        line /= np.linalg.norm(line, axis=1, keepdims=True)
        reach = line * rng.uniform(0.15, 1.25, size=(count, 1))
        center = shift * rng.normal(size=(count, 3))
        points = np.stack([center - reach, center + reach], axis=1)
        normals = np.stack([line, -line], axis=1) + tilt * rng.normal(size=(count, 2, 3))
        contacts = grasp3d.Contacts(points, normals, rng.uniform(0.2, 1.0, size=(count, 1)))
        closed = grasp3d.critical_friction_angle(contacts) < contacts.friction_angle[:, 0]
        found.append(contacts.take(np.flatnonzero(closed)))
    parts = ("points", "normals", "friction")
    return grasp3d.Contacts(
        *(np.concatenate([getattr(one, part) for one in found])[:count] for part in parts)
    )


def seconds(work: Callable[[], object], repeats: int = 3) -> float:
    """Shortest of a few runs, as other processes can only increase the time."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def by_growing_hull() -> object:
    """Solve pairs as all other grasps."""
    return patch.object(WrenchProblem, "is_pairs", return_value=False)


def compare(kind: str, actuation: Actuation, rtol: float, pairs: int, hulls: int) -> str:
    """A row of the first table."""
    contacts = drawn(kind, pairs)
    few = contacts.take(np.arange(min(hulls, pairs)))

    def run(chosen: grasp3d.Contacts) -> grasp3d.Epsilon:
        return grasp3d.epsilon(chosen, rtol=rtol, actuation=actuation)

    ours = run(few)
    time_of_pairs = seconds(lambda: run(contacts)) / pairs
    with by_growing_hull():
        theirs = run(few)
        time_of_hulls = seconds(lambda: run(few), 1) / len(few.points)
    disjoint = (ours.lower > theirs.upper) | (theirs.lower > ours.upper)
    return (
        f"{kind:22}{actuation:12}{rtol:8.0e}{1e6 * time_of_pairs:10.2f}{1e6 * time_of_hulls:10.0f}"
        f"{time_of_hulls / time_of_pairs:8.0f}{int(disjoint.sum()):10}"
    )


def labelled(path: Path) -> str:
    """A row of the second table."""
    mesh = grasp3d.load_mesh(path, max_edge=math.inf)

    def time_of_epsilon() -> float:
        labels = grasp3d.label_surface(mesh)
        return seconds(lambda: labels.epsilon_range, 1)

    time_of_labels = seconds(lambda: grasp3d.label_surface(mesh))
    time_of_pairs = min(time_of_epsilon() for _ in range(3))
    with by_growing_hull():
        time_of_hulls = time_of_epsilon()
    return (
        f"{path.stem:22}{len(mesh.vertices):10}{time_of_labels:10.3f}{time_of_pairs:10.3f}"
        f"{time_of_pairs / time_of_labels:8.2f}{time_of_hulls:10.3f}"
    )


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--pairs", type=int, default=4_000, help="pairs of each kind")
    parser.add_argument("--hulls", type=int, default=200, help="how many by the growing hull")
    parser.add_argument("--kinds", nargs="+", choices=KINDS, default=list(KINDS))
    parser.add_argument("--rtol", nargs="+", type=float, default=[1e-2, 1e-3])
    parser.add_argument("--no-meshes", action="store_true", help="only the first table")
    options = parser.parse_args()
    print(
        f"{'pairs':22}{'actuation':12}{'rtol':>8}"
        f"{'us':>10}{'hull us':>10}{'ratio':>8}{'disjoint':>10}"
    )
    for kind in options.kinds:
        for actuation in get_args(Actuation):
            for rtol in options.rtol:
                print(compare(kind, actuation, rtol, options.pairs, options.hulls), flush=True)
    if options.no_meshes:
        return
    print(f"\n{'mesh':22}{'vertices':>10}{'labels s':>10}{'eps s':>10}{'ratio':>8}{'hulls s':>10}")
    for path in sorted(MESHES.iterdir()):
        if path.suffix in {".ply", ".stl", ".obj", ".glb", ".off"}:
            print(labelled(path), flush=True)


if __name__ == "__main__":
    with grasp3d.running(threads=1):
        main()
