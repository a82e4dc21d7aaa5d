"""Compare the time of `label_surface` with that of its ray tracing, and measure its peak memory.

For each size the mug of the library is divided until it has that many vertices and labelled in a
separate process; the time spent inside Embree for these rays is measured in the same run. `ratio`
is the whole time, tree building included, divided by that of Embree, both summed over the threads;
`rays` counts every ray, continued ones behind a crossing included. With more than one thread the
time of Embree includes waiting for the interpreter, so the ratio of one thread is the relevant one.

Optimisations, at 50,000 vertices, one thread: no rays whose angle to the normal alone is worse than
the grasp already found, 14.5 s to 4.9 s with identical labels; inlining the inner kernels
(`merged`) instead of passing 20 arrays to them, 380 ns to 210-270 ns a ray in
`evaluate_crossings`.

    python scripts/bench_label.py [--vertices 5000 50000 500000] [--threads 1 2] [--json FILE]
"""

import argparse
import json
import resource
import subprocess
import sys
import time
from pathlib import Path

from rich.console import Console
from rich.table import Table

MUG = Path(__file__).parents[1] / "meshes" / "mug.glb"


def measure(path: Path, vertices: int, threads: int) -> dict[str, float]:
    """Label one mesh and measure the times, in this process."""
    from grasp3d import GraspModel, label_surface, load_mesh
    from grasp3d.mesh.ray_tracing import SurfaceRays

    in_embree: list[float] = []
    original = SurfaceRays.hits

    def timed(self, origins, directions):  # noqa: ANN001, ANN202
        start = time.perf_counter()
        hits = original(self, origins, directions)
        in_embree.append(time.perf_counter() - start)
        return hits

    SurfaceRays.hits = timed
    coarse = load_mesh(path)
    label_surface(coarse, threads=threads)  # compile
    edge = coarse.size / 32.0 * 1.2 * (len(coarse.vertices) / vertices) ** 0.5
    mesh = load_mesh(path, max_edge=edge)
    while len(mesh.vertices) < vertices:
        edge *= 0.95
        mesh = load_mesh(path, max_edge=edge)
    in_embree.clear()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start = time.perf_counter()
    labels = label_surface(mesh, GraspModel(), threads=threads)
    whole = time.perf_counter() - start
    return {
        "vertices": len(mesh.vertices),
        "threads": threads,
        "rays": labels.search.rays,
        "seconds": whole,
        "embree_seconds": sum(in_embree) / threads,
        "ratio": whole * threads / sum(in_embree),
        "peak_mb": resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0,
        "mesh_mb": before / 1024.0,
    }


def main() -> None:
    """Measure every size and thread count in a fresh process and print the table."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mesh", type=Path, default=MUG)
    parser.add_argument("--vertices", type=int, nargs="+", default=[5_000, 50_000, 500_000])
    parser.add_argument("--threads", type=int, nargs="+", default=[1, 2])
    parser.add_argument("--json", type=Path)
    parser.add_argument("--one", action="store_true", help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.one:
        print(json.dumps(measure(options.mesh, options.vertices[0], options.threads[0])))
        return
    rows = []
    for vertices in options.vertices:
        for threads in options.threads:
            command = [
                sys.executable, __file__, "--one", "--mesh", str(options.mesh),
                "--vertices", str(vertices), "--threads", str(threads),
            ]  # fmt: skip
            output = subprocess.run(command, check=True, capture_output=True, text=True)  # noqa: S603
            rows.append(json.loads(output.stdout))
    table = Table("vertices", "threads", "M rays", "whole s", "Embree s", "ratio", "peak MB")
    for row in rows:
        table.add_row(
            str(row["vertices"]), str(row["threads"]), f"{row['rays'] / 1e6:.1f}",
            f"{row['seconds']:.2f}", f"{row['embree_seconds']:.2f}", f"{row['ratio']:.2f}",
            f"{row['peak_mb']:.0f}",
        )  # fmt: skip
    Console().print(table)
    if options.json:
        options.json.write_text(json.dumps(rows, indent=2) + "\n")


if __name__ == "__main__":
    main()
