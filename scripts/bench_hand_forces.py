"""Time what a hand's motors hold, beside the solver alone: `python scripts/bench_hand_forces.py`.

Grasps of four fingers with four joints each, and random hands (coupled, one-way, at stops).
Compared in the same run is Clarabel alone: the same cone programs, with their matrices made
already. Times are CPU times on one thread, medians and the worst of ten [ms per grasp].
"""

import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

import grasp3d
from grasp3d.arrays import Floats
from grasp3d.quality import Actuation, HandGrasp, Weight, hand_critical_angle, hand_payload
from grasp3d.quality.hand_forces.cone_program import ConeProgram
from tests.helpers.random_hands import random_hand

SIZE = 60


def four_fingers(generator: np.random.Generator, *, one_way: bool) -> HandGrasp:
    """Four contacts about a ball, each on a finger of four joints."""
    directions = generator.normal(size=(4, 3))
    directions -= directions.mean(axis=0)
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    normals = -directions + 0.2 * generator.normal(size=(4, 3))
    jacobian = np.zeros((4, 3, 16))
    for finger in range(4):
        block = slice(4 * finger, 4 * finger + 4)
        jacobian[finger, :, block] = 0.05 * generator.normal(size=(3, 4))
    limits = np.tile([0.0 if one_way else -0.7, 0.7], (16, 1))
    actuation = Actuation.of_hand(limits, joints=16)
    return HandGrasp(grasp3d.Contacts(0.03 * directions, normals, 0.8), jacobian, actuation)


def fresh(grasp: HandGrasp) -> HandGrasp:
    """The same, with nothing computed."""
    old = grasp.actuation
    drives = Actuation(old.columns, old.lower, old.upper, old.offset, old.names)
    return HandGrasp(grasp.contacts, grasp.jacobian, drives)


@contextmanager
def solver_time() -> Iterator[list[float]]:
    """Times of the solver within the block [s]."""
    times: list[float] = []
    solver = ConeProgram.make_solver

    class Timed:
        def __init__(self, kept: object) -> None:
            self.kept = kept

        def update(self, **values: object) -> None:
            self.kept.update(**values)  # type: ignore[attr-defined]

        def solve(self) -> object:
            start = time.process_time()
            found = self.kept.solve()  # type: ignore[attr-defined]
            times.append(time.process_time() - start)
            return found

    def timed(program: ConeProgram, cost: Floats, *, retry: bool) -> Timed:
        return Timed(solver(program, cost, retry=retry))

    ConeProgram.make_solver = timed  # type: ignore[assignment, method-assign]
    try:
        yield times
    finally:
        ConeProgram.make_solver = solver  # type: ignore[method-assign]


def row(name: str, grasps: list[HandGrasp], work: Callable[[HandGrasp], object]) -> None:
    """Print the times of some work."""
    work(fresh(grasps[0]))
    whole, alone, programs = [], [], []
    with solver_time() as times:
        for grasp in grasps:
            again = fresh(grasp)
            del times[:]
            start = time.process_time()
            work(again)
            whole.append(time.process_time() - start)
            alone.append(sum(times))
            programs.append(len(times))
    found = 1e3 * np.array([np.median(whole), np.quantile(whole, 0.9), np.median(alone)])
    print(f"{name:40s} {found[0]:8.2f} {found[1]:8.2f} {found[2]:8.2f} {np.median(programs):6.0f}")


def main() -> None:
    """Print the table."""
    generator = np.random.default_rng(0)
    one_way = [four_fingers(generator, one_way=True) for _ in range(SIZE)]
    motors = [four_fingers(generator, one_way=False) for _ in range(SIZE)]
    mixed = [one for one in map(random_hand, [generator] * 3 * SIZE) if not one.actuation.two_way]
    print(f"{'':40s} {'median':>8s} {'9 in 10':>8s} {'solver':>8s} {'calls':>6s}")
    down, tip, ball = Weight(direction=(0, 0, -1)), Weight(), Weight(center_radius=0.003)
    tipped = Weight(direction=(0, 0, -1), within=0.5)
    row("critical angle, 16 one-way tendons", one_way, hand_critical_angle)
    row("critical angle, random hands", mixed[:SIZE], hand_critical_angle)
    for name, grasps in (("16 motors", motors), ("random hands", mixed[:SIZE])):
        row(f"payload of one wrench, {name}", grasps, lambda one: hand_payload(one, down))
        row(f"  polished, {name}", grasps, lambda one: hand_payload(one, down, polish=True))
        row(f"payload within 29 degrees, {name}", grasps, lambda one: hand_payload(one, tipped))
        row(f"payload in any direction, {name}", grasps, lambda one: hand_payload(one, tip))
        row(
            f"  with a ball of centres, {name}", grasps,
            lambda one: hand_payload(one, ball, rtol=1e-2),
        )  # fmt: skip


if __name__ == "__main__":
    main()
