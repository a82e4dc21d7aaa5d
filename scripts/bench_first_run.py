"""Time of the first labels with nothing compiled, on one core, and of what is compiled for them.

For each number of fingers one fresh process labels a mesh with a copy of the package that has no
machine code, then computes epsilon of all vertices, and a second process does the same with what
the first one stored. Times count from the start of the interpreter; CPU times are the ones to
compare where other programs run meanwhile. Kernels that Python calls are listed with the CPU time
of their compilation, which includes what they call and is not compiled yet.

    python scripts/bench_first_run.py [--fingers 2 3] [--kernels 20] [--json FILE]
"""

import argparse
import json
import os
import shutil
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

ROOT = Path(__file__).resolve().parents[1]
MUG = ROOT / "meshes" / "mug.glb"

ONE_CORE = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}


def first_run(mesh: Path, fingers: int, begun: float) -> dict[str, Any]:
    """Label a mesh and compute epsilon in this process, whose interpreter was begun at a time."""
    from grasp3d import GraspModel, label_surface, load_mesh
    from grasp3d._kernels.compiling.numba_internals import listen

    kernels: list[tuple[str, float]] = []
    marks: dict[str, Any] = {}

    def end() -> None:
        name, start = kernels[-1]
        kernels[-1] = name, time.process_time() - start

    def mark(name: str) -> None:
        marks[name] = {"seconds": time.time() - begun, "cpu": time.process_time()}

    listen("grasp3d._kernels", lambda name: kernels.append((name, time.process_time())), end)
    labels = label_surface(load_mesh(mesh), GraspModel(fingers=fingers))
    mark("labels")
    labels.compute("epsilon_range")
    mark("epsilon")
    return marks | {"fingers": fingers, "kernels": kernels}


def measure(mesh: Path, fingers: int, folder: Path) -> dict[str, Any]:
    """Run `first_run` in a fresh process on one core, with the package in a folder."""
    words = [sys.executable, __file__, "--mesh", str(mesh), "--fingers", str(fingers)]
    done = subprocess.run(  # noqa: S603
        [*words, "--begun", str(time.time())],
        env={**os.environ, **ONE_CORE, "PYTHONPATH": str(folder), "XDG_CACHE_HOME": str(folder)},
        check=True, stdout=subprocess.PIPE, text=True,
    )  # fmt: skip
    return dict(json.loads(done.stdout))


def print_times(console: Console, runs: list[tuple[dict[str, Any], dict[str, Any]]]) -> None:
    """Print the times of the runs with an empty folder, and of those with a full one."""
    table = Table(title="seconds from the start of Python: wall clock (CPU)")
    columns = ("fingers", "labels", "and epsilon", "again: labels", "and epsilon", "compiled")
    for column in columns:
        table.add_column(column, justify="right")
    for first, later in runs:
        marks = [run[name] for run in (first, later) for name in ("labels", "epsilon")]
        cells = (f"{mark['seconds']:.1f} ({mark['cpu']:.1f})" for mark in marks)
        table.add_row(str(first["fingers"]), *cells, str(len(first["kernels"])))
    console.print(table)


def print_kernels(console: Console, run: dict[str, Any], count: int) -> None:
    """Print the kernels of a run that took longest, and the sum over all."""
    table = Table("kernel", title=f"{run['fingers']} fingers, by kernel: CPU seconds")
    table.add_column("compilation", justify="right")
    for name, seconds in sorted(run["kernels"], key=lambda row: -row[1])[:count]:
        table.add_row(name, f"{seconds:.2f}")
    table.add_section()
    table.add_row("all", f"{sum(seconds for _, seconds in run['kernels']):.1f}")
    console.print(table)


def main() -> None:
    """Measure each number of fingers and print the tables."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mesh", type=Path, default=MUG)
    parser.add_argument("--fingers", type=int, nargs="+", default=[2, 3])
    parser.add_argument("--kernels", type=int, default=20, help="rows of the table by kernel")
    parser.add_argument("--json", type=Path)
    parser.add_argument("--begun", type=float, help=argparse.SUPPRESS)
    options = parser.parse_args()
    if options.begun is not None:
        if hasattr(os, "sched_setaffinity"):
            os.sched_setaffinity(0, {max(os.sched_getaffinity(0))})
        print(json.dumps(first_run(options.mesh, options.fingers[0], options.begun)))
        return
    runs = []
    for fingers in options.fingers:
        with tempfile.TemporaryDirectory() as temporary:
            folder = Path(temporary)
            source = ROOT / "grasp3d"
            shutil.copytree(
                source, folder / "grasp3d", ignore=shutil.ignore_patterns("__pycache__")
            )
            first = measure(options.mesh, fingers, folder)
            runs.append((first, measure(options.mesh, fingers, folder)))
    console = Console()
    print_times(console, runs)
    for first, _ in runs:
        print_kernels(console, first, options.kernels)
    if options.json:
        options.json.write_text(json.dumps(runs, indent=2) + "\n")


if __name__ == "__main__":
    main()
