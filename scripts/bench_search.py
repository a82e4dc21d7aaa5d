"""How pessimistic the search is: default settings against 16 times as many rays.

The critical angle of a named grasp is exact, so a search can only stay behind the best there is.
For the meshes of the library (or those given) this prints the share of smooth vertices whose
critical angle is more than 0.1, 0.5 and 1 degree above that of a search with 1024 rays and a fifth
of the tolerance, and the mean difference; `missed` is the share for which the usual search found
nothing at all and the dense one did, `ahead` is the share where the dense search itself is
more than 0.1 degree behind.

    python scripts/bench_search.py [MESH ...]
"""

import argparse
import math
from pathlib import Path

import numpy as np
from rich.console import Console
from rich.table import Table

from grasp3d import GraspModel, Sampling, label_surface, load_mesh

LIBRARY = Path(__file__).parents[1] / "meshes"
DENSE = Sampling(rays=1024, tolerance=2e-4)
STEPS = (0.1, 0.5, 1.0)


def main() -> None:
    """Search each mesh twice and print the differences."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("meshes", nargs="*", type=Path)
    options = parser.parse_args()
    paths = options.meshes or sorted(
        p for p in LIBRARY.iterdir() if p.suffix not in {".md", ".png"}
    )
    table = Table("mesh", "vertices", "missed", *(f"> {s}°" for s in STEPS), "mean", "ahead")
    everything = []
    for path in paths:
        mesh = load_mesh(path)
        usual = label_surface(mesh, GraspModel()).critical_angle
        dense = label_surface(mesh, GraspModel(), sampling=DENSE).critical_angle
        smooth = (mesh.normal_sets.counts == 1) & np.isfinite(dense)
        behind = np.degrees(usual[smooth] - dense[smooth])
        everything.append(behind)
        add_row(table, path.name, behind)
    add_row(table, "all", np.concatenate(everything))
    Console().print(table)


def add_row(table: Table, name: str, behind: np.ndarray) -> None:
    """Add the shares of one mesh; where the usual search found nothing it is behind without end."""
    missed = np.isinf(behind)
    shares = [np.mean(missed), *(np.mean(behind > step) for step in STEPS)]
    ahead = f"{100.0 * np.mean(behind < -STEPS[0]):.2f} %"
    mean = math.fsum(np.maximum(behind[~missed], 0.0)) / len(behind)
    table.add_row(
        name,
        str(len(behind)),
        *(f"{100.0 * share:.2f} %" for share in shares),
        f"{mean:.3f}°",
        ahead,
    )


if __name__ == "__main__":
    main()
