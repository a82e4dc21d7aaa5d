"""CPU time of labelling with a gripper against that without, and of epsilon of the same grasps.

    python scripts/bench_gripper_labels.py [MESH ...]

One thread, 32 approach angles, a table below the object; the meshes that are shipped by default.
Prints a row for each mesh: seconds without and with the gripper, their ratio, and the ratio of the
whole command, which measures epsilon too.
"""

import sys
import time
from collections.abc import Callable
from pathlib import Path

import grasp3d

MESHES = Path(__file__).parents[1] / "meshes"
REPEATS = 2
"""Runs, of which the fastest counts."""


def seconds(run: Callable[[], object]) -> float:
    """Least CPU time of some runs."""
    times = []
    for _ in range(REPEATS):
        begun = time.process_time()
        run()
        times.append(time.process_time() - begun)
    return min(times)


def compare(path: Path) -> str:
    """The row of one mesh."""
    mesh = grasp3d.load_mesh(path)
    if mesh.unit is None:
        mesh = grasp3d.load_mesh(path, unit="m")
    gripper, table = grasp3d.ParallelGripper.preset("franka"), grasp3d.Table.below(mesh)
    options = ({}, {"hand": gripper, "table": table})
    searching, whole = [], []
    for keywords in options:

        def label(keywords: dict[str, object] = keywords) -> grasp3d.SurfaceLabels:
            return grasp3d.label_surface(mesh, **keywords)

        searching.append(seconds(label))
        labels = label()
        begun = time.process_time()
        labels.compute("epsilon_range")
        whole.append(searching[-1] + time.process_time() - begun)
    reached = labels.reach.reached.mean()
    return (
        f"{path.name:18} {len(mesh.vertices):7,} {searching[0]:6.2f} {searching[1]:6.2f} "
        f"{searching[1] / searching[0]:6.1f} {whole[1] / whole[0]:6.2f} {100.0 * reached:6.0f} %"
    )


def main() -> None:
    """Compare the meshes."""
    grasp3d.warmup()
    given = [Path(name) for name in sys.argv[1:]]
    suffixes = {".ply", ".off", ".obj", ".glb", ".stl"}
    paths = given or sorted(path for path in MESHES.iterdir() if path.suffix in suffixes)
    print("mesh              vertices without   with  ratio  whole reached")
    for path in paths:
        print(compare(path), flush=True)


if __name__ == "__main__":
    with grasp3d.running(threads=1):
        main()
