"""Overhead of a batch besides labelling, time to resume it, and speed-up of a second worker.

The small meshes are random convex shapes. The labelling time is the time to read and label a mesh
within its process; the rest is overhead: processes, files, tables, thumbnails, the store.
"""

import argparse
import tempfile
import time
from pathlib import Path

import numpy as np
import psutil
import trimesh
from scipy.spatial import ConvexHull

from grasp3d import GraspModel, MeshOptions, Sampling
from grasp3d.batch.batch_settings import BatchSettings, ClusterSettings
from grasp3d.batch.library import (
    BatchProgress,
    LibraryLabels,
    ProgressCallback,
    ignore_progress,
    label_library,
)

SMALL = BatchSettings(
    GraspModel(), Sampling(rays=16), MeshOptions(max_edge=10.0, unit="cm"), best=3
)

FEWER = 1000
"""Most small meshes that are labelled with one worker and with two."""


class MemoryRecorder:
    """Records the memory of this process, which plans and stores the rows."""

    def __init__(self, every: int) -> None:
        self._process, self._every = psutil.Process(), every
        self.recorded: list[tuple[int, float]] = []

    def __call__(self, progress: BatchProgress) -> None:
        """Record the memory after every so many meshes."""
        done = progress.labelled + progress.failed
        if done % self._every == 0 and (not self.recorded or self.recorded[-1][0] != done):
            self.recorded.append((done, self._process.memory_info().rss / 1e6))


def make_meshes(folder: Path, count: int) -> None:
    """Write convex meshes of about 200 vertices, of random shape and proportions."""
    rng = np.random.default_rng(0)
    for number in range(count):
        points = rng.normal(size=(250, 3))
        points /= np.linalg.norm(points, axis=1, keepdims=True)
        points = np.sign(points) * np.abs(points) ** rng.uniform(0.5, 1.5)
        points *= rng.uniform(2.0, 8.0, size=3)
        hull = trimesh.Trimesh(points, ConvexHull(points).simplices)
        hull.fix_normals()
        hull.export(folder / f"blob_{number:05d}.ply")


def timed(
    inputs: Path,
    output: Path,
    settings: BatchSettings,
    workers: int,
    progress: ProgressCallback = ignore_progress,
) -> tuple[float, LibraryLabels]:
    """Label a library; returns the time [s] and the results."""
    begun = time.perf_counter()
    cluster = ClusterSettings(workers=workers)
    library = label_library([inputs], output, settings, cluster=cluster, progress=progress)
    return time.perf_counter() - begun, library


def bench_overhead(count: int, workers: int) -> None:
    """Measure many small meshes: overhead for each, memory of this process, time to resume."""
    with tempfile.TemporaryDirectory() as folder:
        inputs, output = Path(folder, "in"), Path(folder, "out")
        inputs.mkdir()
        make_meshes(inputs, count)
        recorder = MemoryRecorder(max(1, count // 10))
        used = time.process_time()
        seconds, library = timed(inputs, output, SMALL, workers, recorder)
        used = time.process_time() - used
        assert not library.failed, library.failed[0].error
        labelling = sum(
            (row.seconds_reading or 0) + (row.seconds_labelling or 0)
            for row in library.rows.values()
        )
        print(f"{count} small meshes, {workers} workers: {seconds:.1f} s")
        print(f"  reading and labelling: {1e3 * labelling / count:.1f} ms each")
        print(f"  overhead: {1e3 * (workers * seconds - labelling) / count:.1f} ms each")
        print(f"  processor time of this process: {1e3 * used / count:.1f} ms each")
        memories = ", ".join(f"{done}: {memory:.0f}" for done, memory in recorder.recorded)
        print(f"  memory of this process [MB] after so many meshes: {memories}")
        seconds, library = timed(inputs, output, SMALL, workers)
        assert library.finished == count
        print(f"  resume of the finished run: {seconds:.2f} s")


def bench_workers(inputs: Path, settings: BatchSettings) -> None:
    """Label a library with one worker and with two."""
    times = {}
    with tempfile.TemporaryDirectory() as folder:
        for workers in (1, 2):
            output = Path(folder, str(workers))
            times[workers], library = timed(inputs, output, settings, workers)
        print(f"{inputs.name}: {len(library.rows)} meshes, {len(library.failed)} failed")
    ratio = times[1] / times[2]
    print(f"  one worker {times[1]:.1f} s, two {times[2]:.1f} s: {ratio:.2f} times as fast")


def main() -> None:
    """Run all benchmarks."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("library", type=Path, nargs="?", default=Path("meshes"))
    parser.add_argument("--count", type=int, default=5000)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    if options.count:
        bench_overhead(options.count, options.workers)
        with tempfile.TemporaryDirectory() as folder:
            inputs = Path(folder, "small")
            inputs.mkdir()
            make_meshes(inputs, min(options.count, FEWER))
            bench_workers(inputs, SMALL)
    bench_workers(options.library, BatchSettings())


if __name__ == "__main__":
    main()
