"""Compare the time of `label_surface` with that of tracing rays, and measure its peak memory.

For each size the mug of the library is divided until it has that many vertices and labelled in a
separate process. `ratio` is the whole time, tree building included, divided by that in which Embree
traces 64 rays from every vertex to the first face that they meet, in the same run: a search by rays
would need those at least, through all crossings. Both are summed over the threads.

    python scripts/bench_label.py [--vertices 5000 50000 500000] [--threads 1 2] [--json FILE]
"""

import argparse
import json
import math
import resource
import subprocess
import sys
import time
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from rich.console import Console
from rich.table import Table

if TYPE_CHECKING:
    from grasp3d import ObjectMesh

RAYS = 64
MUG = Path(__file__).parents[1] / "meshes" / "mug.glb"


def embree_seconds(mesh: "ObjectMesh", cone: float) -> float:
    """Time in which Embree traces 64 rays from every vertex, spread over the search cone [s]."""
    from grasp3d.mesh.ray_tracing import FaceRays

    rng = np.random.default_rng(0)
    cosines = 1.0 - (1.0 - math.cos(cone)) * (np.arange(RAYS) + 0.5) / RAYS
    azimuths = math.pi * (1.0 + math.sqrt(5.0)) * np.arange(RAYS)
    normals = mesh.normals
    across = np.cross(normals, rng.normal(size=normals.shape))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    third = np.cross(normals, across)
    origins = (mesh.normalized + 1e-6 * normals).astype(np.float32)
    tracer, seconds = FaceRays(mesh.normalized, mesh.faces), 0.0
    for cosine, azimuth in zip(cosines, azimuths, strict=True):
        around = math.cos(azimuth) * across + math.sin(azimuth) * third
        directions = cosine * normals + math.sqrt(1.0 - cosine**2) * around
        start = time.process_time()
        tracer.hits(origins, directions.astype(np.float32))
        seconds += time.process_time() - start
    return seconds


def measure(path: Path, vertices: int, threads: int) -> dict[str, float]:
    """Label one mesh and measure the times, in this process."""
    from grasp3d import GraspModel, label_surface, load_mesh, running

    coarse = load_mesh(path)
    label_surface(coarse)  # compile
    edge = coarse.size / 32.0 * 1.2 * (len(coarse.vertices) / vertices) ** 0.5
    mesh = load_mesh(path, max_edge=edge)
    while len(mesh.vertices) < vertices:
        edge *= 0.95
        mesh = load_mesh(path, max_edge=edge)
    before = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    start, cpu = time.perf_counter(), time.process_time()
    with running(threads=threads):
        labels = label_surface(mesh, GraspModel())
    whole, cpu = time.perf_counter() - start, time.process_time() - cpu
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
    embree = embree_seconds(mesh, labels.search.cone)
    return {
        "vertices": len(mesh.vertices),
        "threads": threads,
        "seconds": whole,
        "cpu_seconds": cpu,
        "embree_seconds": embree,
        "ratio": cpu / embree,
        "peak_mb": peak / 1024.0,
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
    table = Table("vertices", "threads", "s", "CPU s", "Embree CPU s", "ratio", "peak MB")
    for row in rows:
        table.add_row(
            str(row["vertices"]), str(row["threads"]), f"{row['seconds']:.2f}",
            f"{row['cpu_seconds']:.2f}", f"{row['embree_seconds']:.2f}", f"{row['ratio']:.2f}",
            f"{row['peak_mb']:.0f}",
        )  # fmt: skip
    Console().print(table)
    if options.json:
        options.json.write_text(json.dumps(rows, indent=2) + "\n")


if __name__ == "__main__":
    main()
