"""Compare the time of epsilon with Qhull: `python scripts/bench_epsilon.py -o epsilon.json`.

All functions are public and compiled before they are timed, and run on one thread, a batch at a
time; scipy's Qhull gets the same wrenches in the same run. Forces in equilibrium, which are
computed when they are first read, have a column of their own. The first two tables have
force-closed grasps only, the third grasps that are not, the fourth regular grasps, for which the
whole hull is needed, and the last critical angles of grasps of many contacts, with the ratio of the
time where they close without friction to that of the others.

History of optimisations, in microseconds per force-closed grasp (geometric mean of the seven
shapes, rows of wrenches, no certificates), each compared with the version before it in one run:

* pencils, neighbours, a heap of facets, flooding: 17.9
* loops over the rank unrolled by the compiler: 15.9
* neighbours of new facets linked only when the next vertex is added; all facets tested against a
  new vertex instead of flooding, while they are few: 14.0
* the first simplex by classical Gram-Schmidt, a second pass only after cancellation: 13.5
* no reference counting (and so no allocation): 12.7; the first simplex alone fell from 1.9 to 0.9,
  a closure test from 2.1 to 1.0
* planes with a row per coefficient, and the heap replaced by an unsorted list that is filtered and
  searched without branches: 12.1 to 8.6; the planes alone gave 11.9, the list alone 10.5
* new facets linked by words of bits, rows of planes whose distance is no power of two, planes
  combined in loops of which that with the roots vectorises: 1.35 times as fast; wrenches written by
  a kernel instead of NumPy, and forces in equilibrium only when they are read: 1.2 times
* no gain: neighbours linked through a table of hashed ridges instead of walking about faces;
  corners of new facets copied only when needed; loops unrolled for rank 5 as well
* worse: growing at the facet that the support function exceeds most, absolutely, relatively or
  among the nearest only: 1.2 to 2.1 times as many facets as growing at the nearest
"""

import argparse
import json
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from scipy.spatial import ConvexHull, QhullError

sys.path.insert(0, str(Path(__file__).parents[1]))

import grasp3d
from grasp3d.quality.wrenches import wrenches
from tests.helpers.random_grasps import REGULAR, SHAPES, Shape, random_contacts, regular_contacts

REPEATS = 5

MANY_CONTACTS = (8, 10, 12)
"""Numbers of contacts, of which some grasps close without friction."""


def best_time(work: Callable[[], object], repeats: int = REPEATS) -> float:
    """Shortest of a few runs [s], as other processes can only increase the time."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def qhull(rows: np.ndarray) -> float:
    """Epsilon from the complete hull; nan where Qhull fails."""
    try:
        return max(0.0, float(-ConvexHull(rows).equations[:, -1].max()))
    except QhullError:
        return math.nan


def chosen(contacts: grasp3d.Contacts, rows: np.ndarray) -> grasp3d.Contacts:
    """The chosen grasps of a batch."""
    return grasp3d.Contacts(
        contacts.points[rows],
        contacts.normals[rows],
        contacts.friction[rows],
        contacts.torsion_radius[rows],
    )


def compare(contacts: grasp3d.Contacts, edges: int, few: int) -> dict[str, float]:
    """Times per grasp [us]: epsilon for the whole batch, Qhull for its first few grasps."""
    count = len(contacts.points)
    rows = wrenches(contacts, edges=edges)
    hulls = np.array([qhull(row) for row in rows[:few]])
    result = grasp3d.epsilon(contacts, edges=edges)
    ours = best_time(lambda: grasp3d.epsilon(contacts, edges=edges)) / count
    theirs = best_time(lambda: [qhull(row) for row in rows[:few]], 3) / len(hulls)
    return {
        "grasps": count,
        "epsilon_us": 1e6 * ours,
        "qhull_us": 1e6 * theirs,
        "ratio": theirs / ours,
        "largest_difference": float(np.nanmax(np.abs(result.value[:few] - hulls))),
        "qhull_failures": int(np.isnan(hulls).sum()),
    }


def other_times(contacts: grasp3d.Contacts, edges: int) -> dict[str, float]:
    """Times per grasp [us] of the other computations with wrench hulls."""
    few = chosen(contacts, np.arange(min(len(contacts.points), 200)))
    one = best_time(lambda: grasp3d.epsilon(contacts, edges=edges))
    two = best_time(lambda: grasp3d.running(threads=2)(grasp3d.epsilon)(contacts, edges=edges))
    tasks: dict[str, tuple[grasp3d.Contacts, Callable[[grasp3d.Contacts], object]]] = {
        "sign_us": (contacts, lambda c: grasp3d.force_closure(c, edges=edges)),
        "per_finger_us": (
            few,
            lambda c: grasp3d.epsilon(c, edges=edges, actuation="per_finger"),
        ),
        "circular_1e-3_us": (few, lambda c: grasp3d.epsilon(c, rtol=1e-3)),
        "circular_1e-6_us": (
            chosen(few, np.arange(min(len(few.points), 20))),
            lambda c: grasp3d.epsilon(c, rtol=1e-6),
        ),
        "with_forces_us": (
            contacts,
            lambda c: grasp3d.epsilon(c, edges=edges).certificate.equilibrium,
        ),
        "critical_angle_us": (few, grasp3d.critical_friction_angle),
    }
    times = {
        name: 1e6 * best_time(lambda batch=batch, work=work: work(batch), 3) / len(batch.points)
        for name, (batch, work) in tasks.items()
    }
    return {**times, "two_threads": one / two}


def measure(shape: Shape, count: int, few: int) -> tuple[dict[str, float], dict[str, float]]:
    """The rows of one shape: force-closed grasps, and others."""
    contacts = random_contacts(shape, count, seed=0)
    closed = np.flatnonzero(grasp3d.force_closure(contacts, edges=shape.edges).closed)
    is_open = np.setdiff1d(np.arange(count), closed)
    batch = chosen(contacts, closed)
    good = {**compare(batch, shape.edges, few), **other_times(batch, shape.edges)}
    bad = compare(chosen(contacts, is_open), shape.edges, few) if len(is_open) else {}
    return good, bad


def critical_angles(count: int, fingers: int) -> dict[str, float]:
    """Times per grasp [ms] of critical angles: grasps that close without friction, and others.

    Such grasps have an angle of 0 or less, from a search over the directions of motion.
    """
    contacts = random_contacts(Shape(fingers, 8, soft=False), count, seed=0)
    closed = grasp3d.force_closure(contacts.with_friction(np.zeros(contacts.friction.shape)))
    rows = {
        "frictionless": np.flatnonzero(closed.closed)[:50],
        "other": np.flatnonzero(~closed.closed)[:50],
    }
    found: dict[str, float] = {}
    for name, chosen_rows in rows.items():
        grasps = [chosen(contacts, np.array([row])) for row in chosen_rows]
        times = [
            1e3 * best_time(lambda one=one: grasp3d.critical_friction_angle(one), 2)
            for one in grasps
        ]
        found[f"{name}_ms"] = float(np.median(times))
        found[f"{name}_max_ms"] = max(times)
    return {
        "grasps": len(rows["frictionless"]),
        **found,
        "ratio": found["frictionless_ms"] / found["other_ms"],
    }


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
    parser.add_argument("--hulls", type=int, default=60, help="number of them for Qhull")
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
    many = {f"{n} contacts": critical_angles(options.grasps * 10, n) for n in MANY_CONTACTS}
    columns = ["grasps", "epsilon_us", "qhull_us", "ratio", "largest_difference"]
    show("force-closed grasps", closed, columns)
    others = [column for column in next(iter(closed.values())) if column.endswith("_us")]
    show("force-closed grasps, other computations", closed, [*others[2:], "two_threads"])
    show("grasps that are not force-closed", is_open, columns)
    show("regular grasps", regular, columns)
    show("critical angles of many contacts", many, list(next(iter(many.values()))))
    ratios = [row["ratio"] for row in closed.values()]
    mean = math.exp(sum(map(math.log, ratios)) / len(ratios))
    print(f"\ngeometric mean of the ratios {mean:.0f}, smallest {min(ratios):.0f}")
    print(f"regular grasps, smallest ratio {min(r['ratio'] for r in regular.values()):.0f}")
    print(f"first call, compiling or loading: {first:.1f} s")
    if options.output:
        tables = {
            "closed": closed,
            "open": is_open,
            "regular": regular,
            "mean_ratio": mean,
            "many": many,
        }
        options.output.write_text(json.dumps(tables, indent=1))


if __name__ == "__main__":
    with grasp3d.running(threads=1):
        main()
