"""Time of the first labels with nothing compiled, on one core, and of what is compiled for them.

For each number of fingers one fresh process labels a mesh with an empty folder for machine code,
then computes epsilon of all vertices, and a second process does the same with what the first one
stored. Times count from the start of the interpreter; CPU times are the ones to compare where other
programs run meanwhile. By kernel, without those that it calls: how often Numba compiled it, once
for every combination of argument types, and the CPU time within LLVM (optimisation, machine code)
and outside it (typing, inlining, lowering).

    python scripts/bench_first_run.py [--fingers 2 3] [--kernels 20] [--json FILE]
"""

import argparse
import json
import os
import subprocess
import sys
import tempfile
import time
from collections import defaultdict
from pathlib import Path
from typing import Any

from rich.console import Console
from rich.table import Table

MUG = Path(__file__).parents[1] / "meshes" / "mug.glb"

ONE_CORE = {"OMP_NUM_THREADS": "1", "OPENBLAS_NUM_THREADS": "1", "NUMBA_NUM_THREADS": "1"}


class Compilations:
    """Times of what Numba compiles in this process, by kernel."""

    def __init__(self) -> None:
        self.kernels: dict[str, list[float]] = defaultdict(lambda: [0, 0.0, 0.0])
        """How often each was compiled, and CPU time outside and inside LLVM [s]."""
        self._stack: list[str] = []
        self._mark = time.process_time()
        self._locks = 0

    def register(self) -> None:
        """Listen to Numba's events."""
        from numba.core import event

        compilations = self

        class Compiles(event.Listener):
            def on_start(self, event: Any) -> None:
                compilations.begin(event.data["dispatcher"].py_func)

            def on_end(self, event: Any) -> None:  # noqa: ARG002
                compilations.end()

        class Locks(event.Listener):
            """LLVM is called with its lock held, which may be taken again meanwhile."""

            def on_start(self, event: Any) -> None:  # noqa: ARG002
                compilations.lock(1)

            def on_end(self, event: Any) -> None:  # noqa: ARG002
                compilations.lock(-1)

        event.register("numba:compile", Compiles())
        event.register("numba:llvm_lock", Locks())

    def begin(self, function: Any) -> None:
        """Note that a function begins to be compiled, perhaps for another that calls it."""
        self._charge()
        module = function.__module__.removeprefix("grasp3d._kernels.")
        self._stack.append(f"{module}.{function.__name__}")
        self.kernels[self._stack[-1]][0] += 1

    def end(self) -> None:
        """Note that the function begun last is compiled."""
        self._charge()
        self._stack.pop()

    def lock(self, step: int) -> None:
        """Note that LLVM is entered (1) or left (-1)."""
        self._charge()
        self._locks += step

    def _charge(self) -> None:
        """Add the time since the last event to the function that is being compiled."""
        now = time.process_time()
        if self._stack:
            self.kernels[self._stack[-1]][2 if self._locks else 1] += now - self._mark
        self._mark = now


def first_run(mesh: Path, fingers: int, begun: float) -> dict[str, Any]:
    """Label a mesh and compute epsilon in this process, whose interpreter was begun at a time."""
    from grasp3d import GraspModel, label_surface, load_mesh
    from grasp3d.system.progress import ignore

    compilations, marks = Compilations(), {}

    def mark(name: str) -> None:
        marks[name] = {"seconds": time.time() - begun, "cpu": time.process_time()}

    compilations.register()
    labels = label_surface(load_mesh(mesh), GraspModel(fingers=fingers), threads=1)
    mark("labels")
    labels.compute_epsilon(ignore)
    mark("epsilon")
    return marks | {"fingers": fingers, "kernels": compilations.kernels}


def measure(mesh: Path, fingers: int, cache: str) -> dict[str, Any]:
    """Run `first_run` in a fresh process on one core, with a folder for machine code."""
    words = [sys.executable, __file__, "--mesh", str(mesh), "--fingers", str(fingers)]
    done = subprocess.run(  # noqa: S603
        [*words, "--begun", str(time.time())],
        env={**os.environ, **ONE_CORE, "NUMBA_CACHE_DIR": cache},
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
        count = sum(row[0] for row in first["kernels"].values())
        table.add_row(str(first["fingers"]), *cells, str(count))
    console.print(table)


def print_kernels(console: Console, run: dict[str, Any], count: int) -> None:
    """Print the kernels of a run that took longest, and the sums over all."""
    title = f"{run['fingers']} fingers, by kernel: CPU seconds"
    table = Table("kernel", title=title)
    for column in ("times", "typing, lowering", "LLVM", "sum"):
        table.add_column(column, justify="right")
    rows = sorted(run["kernels"].items(), key=lambda item: -sum(item[1][1:]))
    for name, (times, numba, llvm) in rows[:count]:
        table.add_row(name, str(times), f"{numba:.2f}", f"{llvm:.2f}", f"{numba + llvm:.2f}")
    times, numba, llvm = (sum(row[column] for _, row in rows) for column in range(3))
    table.add_section()
    table.add_row("all", str(times), f"{numba:.1f}", f"{llvm:.1f}", f"{numba + llvm:.1f}")
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
        with tempfile.TemporaryDirectory() as cache:
            first = measure(options.mesh, fingers, cache)
            runs.append((first, measure(options.mesh, fingers, cache)))
    console = Console()
    print_times(console, runs)
    for first, _ in runs:
        print_kernels(console, first, options.kernels)
    if options.json:
        options.json.write_text(json.dumps(runs, indent=2) + "\n")


if __name__ == "__main__":
    main()
