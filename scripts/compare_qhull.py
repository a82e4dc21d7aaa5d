"""Compare epsilon with Qhull on many grasps: `python scripts/compare_qhull.py --grasps 10000`.

Random grasps of every shape, and regular ones with noise from 1e-14 to 1e-3. Prints the largest
difference, the number of different results for force closure, and how often Qhull failed. Exits
with 1 if a difference exceeds 1e-9.
"""

import argparse
import sys
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from bench_epsilon import qhull

sys.path.insert(0, str(Path(__file__).parents[1]))

import grasp3d
from grasp3d.quality.wrenches import wrenches
from tests.helpers.random_grasps import REGULAR, SHAPES, random_contacts, regular_contacts

TOLERANCE = 1e-9
NOISES = (0.0, 1e-14, 1e-12, 1e-10, 1e-8, 1e-6, 1e-4, 1e-3)


def compare(
    name: str, contacts: grasp3d.Contacts, edges: int, executor: ProcessPoolExecutor
) -> bool:
    """Print one line; return whether all results agree."""
    result = grasp3d.epsilon(contacts, edges=edges)
    sign = grasp3d.force_closure(contacts, edges=edges)
    hulls = np.array(list(executor.map(qhull, wrenches(contacts, edges=edges), chunksize=50)))
    valid = ~np.isnan(hulls)
    difference = float(np.abs(result.value - hulls)[valid].max(initial=0.0))
    clear = valid & (hulls > TOLERANCE)
    wrong = int((clear & ~(result.closed & sign.closed)).sum())
    wrong += int((valid & (hulls == 0.0) & (result.value > TOLERANCE)).sum())
    print(
        f"{name:32} {len(hulls):6} grasps, {int(result.closed.sum()):6} closed, "
        f"largest difference {difference:.1e}, closure differs {wrong}, "
        f"Qhull failed {int((~valid).sum())}, not converged {int((result.status > 0).sum())}",
        flush=True,
    )
    return difference <= TOLERANCE and wrong == 0


def main() -> int:
    """Compare all shapes."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--grasps", type=int, default=10_000, help="random grasps of each shape")
    parser.add_argument("--seed", type=int, default=1)
    options = parser.parse_args()
    with ProcessPoolExecutor() as executor:
        agree = [
            compare(str(shape), random_contacts(shape, options.grasps, options.seed), shape.edges,
                    executor)
            for shape in SHAPES
        ]  # fmt: skip
        agree += [
            compare(
                f"{name} x {edges}, noise {noise:g}",
                regular_contacts(name, max(options.grasps // 100, 10), noise, options.seed),
                edges,
                executor,
            )
            for name in REGULAR
            for edges in (8, 16)
            for noise in NOISES
        ]
    return 0 if all(agree) else 1


if __name__ == "__main__":
    sys.exit(main())
