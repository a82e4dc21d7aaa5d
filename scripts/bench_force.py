"""Compare the time of grip forces: `python scripts/bench_force.py`.

All functions are public, compiled before they are timed, give their proofs, and run on one thread,
a batch at a time. Compared in the same run are

* one wrench for each grasp: with Clarabel, a solver of second-order cone programs, with and
  without the assembly of its matrices in Python;
* the weight in any direction: with epsilon of the same grasps (circular cones, the same bound and
  tolerance), and with Clarabel for 500 directions, of which it finds the worst only roughly.

Times are the shortest of a few runs [us per grasp].
"""

import argparse
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

import grasp3d
from grasp3d.quality import Weight
from tests.helpers.cone_programs import ConeProgram
from tests.helpers.random_grasps import Shape, random_contacts

REPEATS = 5
SIZE = 300
PROGRAMS = 40
DIRECTIONS = 500
WEIGHT = Weight(0.5)


def best_time(work: Callable[[], object], repeats: int = REPEATS) -> float:
    """Shortest of a few runs [s], as other processes can only increase the time."""
    times = []
    for _ in range(repeats):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def closed(count: int, *, soft: bool) -> grasp3d.Contacts:
    """Random force-closed grasps that resist all wrenches."""
    contacts = random_contacts(Shape(count, 8, soft=soft), 2 * SIZE, 3)
    found = np.flatnonzero(grasp3d.force_closure(contacts).closed)[:SIZE]
    return contacts.take(found)


def one(contacts: grasp3d.Contacts, g: int) -> grasp3d.Contacts:
    """One grasp of a batch."""
    return grasp3d.Contacts(
        contacts.points[g], contacts.normals[g], contacts.friction[g], contacts.torsion_radius[g]
    )


def row(name: str, contacts: grasp3d.Contacts, bound: str) -> list[float]:
    """Print one row of the table; returns its four ratios."""
    size = len(contacts.points)
    rng = np.random.default_rng(0)
    wrenches = rng.normal(size=(size, 6))

    def per_grasp(work: Callable[[], object]) -> float:
        work()
        return 1e6 * best_time(work) / size

    wrench = per_grasp(lambda: grasp3d.grip_force(contacts, wrenches, bound=bound))
    task = per_grasp(lambda: grasp3d.grip_force(contacts, WEIGHT, bound=bound))
    actuation = "total" if bound == "total" else "per_finger"
    bounded = "force" if bound == "norm" else "normal"
    epsilon = per_grasp(lambda: grasp3d.epsilon(contacts, actuation=actuation, bounded=bounded))
    grasps = [one(contacts, g) for g in range(min(PROGRAMS, size))]
    set_up = best_time(lambda: [ConeProgram(grasp, bound) for grasp in grasps]) / len(grasps)
    programs = [ConeProgram(grasp, bound) for grasp in grasps]
    solve = best_time(lambda: [p.force(w) for p, w in zip(programs, wrenches, strict=False)]) / len(
        grasps
    )
    solve, whole = 1e6 * solve, 1e6 * (solve + set_up)
    ratios = [solve / wrench, whole / wrench, task / epsilon, DIRECTIONS * solve / task]
    print(
        f"{name:<10} {bound:<7} {wrench:>8.1f} {solve:>9.0f} {ratios[0]:>6.0f} {ratios[1]:>7.0f}"
        f" {task:>10.0f} {epsilon:>9.0f} {ratios[2]:>7.2f} {ratios[3]:>9.0f}"
    )
    return ratios


def main() -> None:
    """Print the table and the geometric means of its ratios."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.parse_args()
    print(
        f"{'grasps':<10} {'bound':<7} {'wrench':>8} {'Clarabel':>9} {'ratio':>6} {'set up':>7}"
        f" {'any dir.':>10} {'epsilon':>9} {'ratio':>7} {'500 solves':>10}"
    )
    ratios: list[list[float]] = []
    for count in (2, 3, 4, 5):
        for soft in (False, True):
            if count == 2 and not soft:  # resist no torque about their line
                continue
            contacts = closed(count, soft=soft)
            name = f"{count} {'soft' if soft else 'hard'}"
            ratios += [row(name, contacts, bound) for bound in ("normal", "norm", "total")]
    means = [math.exp(float(np.log(values).mean())) for values in zip(*ratios, strict=True)]
    print(
        f"geometric means: one wrench {means[0]:.0f} times as fast as a solve alone, "
        f"{means[1]:.0f} with its set-up; any direction takes {means[2]:.2f} times as long as "
        f"epsilon, and is {means[3]:,.0f} times as fast as {DIRECTIONS} solves"
    )


if __name__ == "__main__":
    with grasp3d.running(threads=1):
        main()
