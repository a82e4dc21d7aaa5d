"""Time epsilon against a complete convex hull: `python scripts/bench_epsilon.py -o epsilon.json`.

Everything runs compiled and warm through the public functions, proofs included, on one thread, a
batch at a time; scipy's Qhull gets the same wrenches in the same run. The first table has closed
grasps only, the second open ones, the third regular grasps, for which the whole hull is needed.

What was tried, in microseconds per closed grasp (geometric mean of the seven shapes, rows of
wrenches, no proofs), each against the version before it in one run of a shared machine:

* pencils, neighbours, a heap of facets, flooding: 17.9
* loops over the rank laid out when compiled: 15.9 (11 % between versions of the end, too)
* neighbours of new facets linked when the next vertex comes, so those of the last never are; all
  facets tested against a new vertex instead of a flood, while they are few: 14.0
* the first simplex by classical Gram-Schmidt, a second pass only after cancellation: 13.5
* no counting of references (and so no allocation): 12.7; the first simplex alone fell from 1.9 to
  0.9, a closure test from 2.1 to 1.0
* planes with a row per number, and the heap replaced by an unsorted list that is filtered and
  searched without branches: 12.1 to 8.6; the planes alone gave 11.9, the list alone 10.5
* no gain: neighbours linked through a table of hashed ridges instead of walking about faces;
  corners of new facets copied only when needed; rank 5 laid out when compiled, too
* worse: growing where the support is farthest above a facet, absolutely, relatively or among the
  nearest only: 1.2 to 2.1 times as many facets as growing at the nearest
"""

import argparse
import json
import math
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from random_grasps import REGULAR, SHAPES, Shape, random_contacts, regular_contacts
from scipy.spatial import ConvexHull, QhullError

import grasp3d
from grasp3d.quality.wrenches import wrenches

REPEATS = 5


def best_time(work: Callable[[], object], repeats: int = REPEATS) -> float:
    """Shortest of a few runs [s]: other work on the machine only ever adds to it."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def qhull(rows: np.ndarray) -> float:
    """Epsilon from the complete hull; nan where Qhull gives up."""
    try:
        return max(0.0, float(-ConvexHull(rows).equations[:, -1].max()))
    except QhullError:
        return math.nan


def some(contacts: grasp3d.Contacts, rows: np.ndarray) -> grasp3d.Contacts:
    """Some grasps of a batch."""
    return grasp3d.Contacts(
        contacts.points[rows],
        contacts.normals[rows],
        contacts.friction[rows],
        contacts.torsion_radius[rows],
    )


def compare(contacts: grasp3d.Contacts, edges: int, few: int) -> dict[str, float]:
    """Times per grasp [us] of a batch: ours for all of it, Qhull's for its first few."""
    count = len(contacts.points)
    rows = wrenches(contacts, edges=edges)
    hulls = np.array([qhull(row) for row in rows[:few]])
    answer = grasp3d.epsilon(contacts, edges=edges)
    ours = best_time(lambda: grasp3d.epsilon(contacts, edges=edges)) / count
    theirs = best_time(lambda: [qhull(row) for row in rows[:few]], 3) / len(hulls)
    return {
        "grasps": count,
        "epsilon_us": 1e6 * ours,
        "qhull_us": 1e6 * theirs,
        "ratio": theirs / ours,
        "largest_difference": float(np.nanmax(np.abs(answer.value[:few] - hulls))),
        "qhull_failures": int(np.isnan(hulls).sum()),
    }


def more(contacts: grasp3d.Contacts, edges: int) -> dict[str, float]:
    """Times per grasp [us] of what else the engine does."""
    few = some(contacts, np.arange(min(len(contacts.points), 200)))
    one = best_time(lambda: grasp3d.epsilon(contacts, edges=edges, threads=1))
    two = best_time(lambda: grasp3d.epsilon(contacts, edges=edges, threads=2))
    tasks: dict[str, tuple[grasp3d.Contacts, Callable[[grasp3d.Contacts], object]]] = {
        "sign_us": (contacts, lambda c: grasp3d.force_closure(c, edges=edges)),
        "per_finger_us": (few, lambda c: grasp3d.epsilon(c, edges=edges, actuation="per_finger")),
        "circular_1e-3_us": (few, lambda c: grasp3d.epsilon(c, rtol=1e-3)),
        "circular_1e-6_us": (
            some(few, np.arange(min(len(few.points), 20))),
            lambda c: grasp3d.epsilon(c, rtol=1e-6),
        ),
        "critical_angle_us": (few, grasp3d.critical_friction_angle),
    }
    times = {
        name: 1e6 * best_time(lambda batch=batch, work=work: work(batch), 3) / len(batch.points)
        for name, (batch, work) in tasks.items()
    }
    return {**times, "two_threads": one / two}


def measure(shape: Shape, count: int, few: int) -> tuple[dict[str, float], dict[str, float]]:
    """The rows of one shape: closed grasps, open ones."""
    contacts = random_contacts(shape, count, seed=0)
    closed = np.flatnonzero(grasp3d.force_closure(contacts, edges=shape.edges).closed)
    is_open = np.setdiff1d(np.arange(count), closed)
    batch = some(contacts, closed)
    good = {**compare(batch, shape.edges, few), **more(batch, shape.edges)}
    bad = compare(some(contacts, is_open), shape.edges, few) if len(is_open) else {}
    return good, bad


def show(title: str, rows: dict[str, dict[str, float]], columns: list[str]) -> None:
    """Print a table."""
    print(f"\n{title}\n{'':24}" + "".join(f"{column:>20}" for column in columns))
    for name, row in rows.items():
        print(f"{name:24}" + "".join(f"{row.get(column, math.nan):20.4g}" for column in columns))


def main() -> None:
    """Measure and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, help="JSON file to write")
    parser.add_argument("--grasps", type=int, default=4000, help="random grasps of each shape")
    parser.add_argument("--hulls", type=int, default=60, help="how many of them Qhull gets")
    options = parser.parse_args()
    start = time.perf_counter()
    grasp3d.epsilon(random_contacts(SHAPES[0], 2, 0), edges=8)
    first = time.perf_counter() - start
    closed, is_open = {}, {}
    for shape in SHAPES:
        good, bad = measure(shape, options.grasps, options.hulls)
        closed[str(shape)] = good
        if bad:
            is_open[str(shape)] = bad
    regular = {
        f"{name}, noise {noise:g}": compare(
            regular_contacts(name, 500, noise, seed=0), 8, options.hulls
        )
        for name in REGULAR
        for noise in (0.0, 1e-3)
    }
    columns = ["grasps", "epsilon_us", "qhull_us", "ratio", "largest_difference"]
    show("closed grasps", closed, columns)
    others = [column for column in next(iter(closed.values())) if column.endswith("_us")]
    show("closed grasps, other questions", closed, [*others[2:], "two_threads"])
    show("open grasps", is_open, columns)
    show("regular grasps", regular, columns)
    ratios = [row["ratio"] for row in closed.values()]
    mean = math.exp(sum(map(math.log, ratios)) / len(ratios))
    print(f"\ngeometric mean of the ratios {mean:.0f}, smallest {min(ratios):.0f}")
    print(f"regular grasps, smallest ratio {min(r['ratio'] for r in regular.values()):.0f}")
    print(f"first call, compiling or loading: {first:.1f} s")
    if options.output:
        tables = {"closed": closed, "open": is_open, "regular": regular, "mean_ratio": mean}
        options.output.write_text(json.dumps(tables, indent=1))


if __name__ == "__main__":
    main()
