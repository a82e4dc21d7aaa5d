"""Time of `label_surface` against the bare ray tracing in it, and its peak memory.

For each size the mug of the library is divided until it has that many vertices, labelled in a
process of its own, and the time spent inside Embree for exactly these rays is taken in the same
run. `ratio` is the whole time, tree building and all else included, over that raw time, both summed
over the threads; `rays` counts every ray, those that go on behind a crossing included. With more
than one thread the raw time holds what a thread waits for the interpreter, so the honest ratio is
that of one thread.

What brought the time down, at 50,000 vertices, one thread: leaving out rays whose angle to the
normal alone is worse than what is found already, 14.5 s to 4.9 s with the same labels to the bit;
writing the inner kernels out where they are called (`inlined`) instead of handing them 20 arrays,
380 ns to 210-270 ns a ray in `settle`.

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
    """Label one mesh and take the times, in this process."""
    from grasp3d import GraspModel, label_surface, load_mesh
    from grasp3d.mesh.ray_tracing import SurfaceRays

    raw: list[float] = []
    bare = SurfaceRays.hits

    def timed(self, origins, directions):  # noqa: ANN001, ANN202
        begun = time.perf_counter()
        answer = bare(self, origins, directions)
        raw.append(time.perf_counter() - begun)
        return answer

    SurfaceRays.hits = timed
    coarse = load_mesh(path)
    label_surface(coarse, threads=threads)  # compile
    edge = coarse.size / 32.0 * 1.2 * (len(coarse.vertices) / vertices) ** 0.5
    mesh = load_mesh(path, max_edge=edge)
    while len(mesh.vertices) < vertices:
        edge *= 0.95
        mesh = load_mesh(path, max_edge=edge)
    raw.clear()
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    begun = time.perf_counter()
    labels = label_surface(mesh, GraspModel(), threads=threads)
    whole = time.perf_counter() - begun
    return {
        "vertices": len(mesh.vertices),
        "threads": threads,
        "rays": labels.search.rays,
        "seconds": whole,
        "embree_seconds": sum(raw) / threads,
        "ratio": whole * threads / sum(raw),
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
            answer = subprocess.run(command, check=True, capture_output=True, text=True)  # noqa: S603
            rows.append(json.loads(answer.stdout))
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
