"""Check the order of the best grasps of meshes: with grippers, and with masses to be held.

For every mesh, gripper and mass it counts pairs of listed grasps of which the one above has the
worse label, pairs of which the one below is as good in everything and better in one, and whether
the first grasp has no approach margin although another one with its label has some, and no less of
any other margin.

    python scripts/validate_ranking.py [MESH ...]
"""

import sys
from pathlib import Path

import numpy as np

import grasp3d
from grasp3d.grasps import margins_in_units, ranked_rows, stated_label
from grasp3d.surface import GraspTable, SurfaceLabels
from grasp3d.surface.closed_grasps import ClosedGrasps

ROOT = Path(__file__).resolve().parents[1]
GRIPPERS, MASSES = ("franka", "robotiq_2f85"), (0.1, 0.5)
ALL = 10_000


def counts(grasps: GraspTable, rows: np.ndarray, closed: ClosedGrasps | None) -> tuple[int, ...]:
    """Numbers of pairs with labels, and with everything, in the wrong order; whether 1 is poor."""
    codes = stated_label(grasps, closed)[rows]
    named = margins_in_units(grasps, closed)
    margins = np.stack(list(named.values()), axis=1)[rows]
    values = np.column_stack([codes, margins, np.nan_to_num(grasps.epsilon)[rows]])
    inverted = above = 0
    for place in range(len(rows)):
        below, own = values[place + 1 :], values[place]
        inverted += int((below[:, 0] > own[0]).sum())
        above += int(((below >= own).all(axis=1) & (below > own).any(axis=1)).sum())
    approach = list(named).index("approach")
    better = (margins[1:] >= margins[:1]).all(axis=1) & (codes[1:] == codes[:1])
    poor = len(rows) > 0 and margins[0, approach] == 0.0
    return inverted, above, int(poor and (better & (margins[1:, approach] > 0.0)).any())


def checked(labels: SurfaceLabels) -> list[int]:
    """The counts of the list of best grasps, and of all grasps of the surface."""
    best = grasp3d.best_grasps(labels, ALL)
    surface = ranked_rows(labels.grasps)
    codes = stated_label(best, best.closed)
    listed = np.bincount(codes, minlength=3)[::-1]
    first = {
        name: f"{values[0]:.2f}" for name, values in margins_in_units(best, best.closed).items()
    } if best.size else {}  # fmt: skip
    print(f"    S/M/U {'/'.join(map(str, listed))}; first: {first}")
    return [
        *counts(best, np.arange(best.size), best.closed),
        *counts(labels.grasps, surface[:2000], None),
    ]


def main() -> None:
    """Check all combinations and print the sums."""
    paths = [Path(name) for name in sys.argv[1:]] or sorted((ROOT / "meshes").iterdir())
    paths = [path for path in paths if path.suffix in {".glb", ".obj", ".off", ".ply", ".stl"}]
    total, cases = np.zeros(6, dtype=int), 0
    for path in paths:
        mesh = grasp3d.load_mesh(path)
        if mesh.unit is None:
            mesh = grasp3d.load_mesh(path, unit="m")
        for name in GRIPPERS:
            labels = grasp3d.label_surface(mesh, hand=grasp3d.read_hand(name))
            for mass in MASSES:
                print(f"{path.name}, {name}, {mass:g} kg", flush=True)
                numbers = checked(labels.using(load=grasp3d.Load(mass=mass)))
                total, cases = total + numbers, cases + 1
                if any(numbers):
                    print(f"    {numbers}")
    print(
        f"{cases} cases; of listed grasps and of all of a surface: worse label above "
        f"{total[0]}, {total[3]}; worse in everything above {total[1]}, {total[4]}; "
        f"first without approach margin {total[2]}, {total[5]}"
    )


if __name__ == "__main__":
    main()
