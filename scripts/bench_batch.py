"""What a batch costs besides labelling, what resuming takes, and what a second worker brings.

Small meshes: random convex blobs, each another one. Labelling itself is what reading a mesh and
labelling it takes within its process; everything else is overhead: processes, files, tables,
thumbnails, bookkeeping.
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
from grasp3d.batch.library import LibraryLabels, label_library
from grasp3d.batch.state import BatchState, Watch, unwatched

SMALL = BatchSettings(
    GraspModel(), Sampling(rays=16), MeshOptions(max_edge=10.0, unit="cm"), best=3
)


class Memory:
    """Watches the memory of this process, which plans and keeps the books."""

    def __init__(self, every: int) -> None:
        self._process, self._every = psutil.Process(), every
        self.seen: list[tuple[int, float]] = []

    def __call__(self, state: BatchState) -> None:
        """Look now and then."""
        done = state.labelled + state.failed
        if done % self._every == 0 and (not self.seen or self.seen[-1][0] != done):
            self.seen.append((done, self._process.memory_info().rss / 1e6))


def make_blobs(folder: Path, count: int) -> None:
    """Write convex blobs of some 200 vertices, of random shape and proportions."""
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
    inputs: Path, output: Path, settings: BatchSettings, workers: int, watch: Watch = unwatched
) -> tuple[float, LibraryLabels]:
    """Label a library; returns the time and what came of it."""
    begun = time.perf_counter()
    cluster = ClusterSettings(workers=workers)
    library = label_library([inputs], output, settings, cluster=cluster, watch=watch)
    return time.perf_counter() - begun, library


def bench_overhead(count: int, workers: int) -> None:
    """Many small meshes: overhead for each, memory of this process, time to resume."""
    with tempfile.TemporaryDirectory() as place:
        inputs, output = Path(place, "in"), Path(place, "out")
        inputs.mkdir()
        make_blobs(inputs, count)
        watch = Memory(max(1, count // 10))
        seconds, library = timed(inputs, output, SMALL, workers, watch)
        assert not library.failed, library.failed[0].error
        itself = sum(
            (row.seconds_reading or 0) + (row.seconds_labelling or 0)
            for row in library.rows.values()
        )
        print(f"{count} small meshes, {workers} workers: {seconds:.1f} s")
        print(f"  labelling itself: {1e3 * itself / count:.1f} ms each")
        print(f"  overhead: {1e3 * (workers * seconds - itself) / count:.1f} ms each")
        told = ", ".join(f"{done}: {memory:.0f}" for done, memory in watch.seen)
        print(f"  memory of the client [MB] after so many: {told}")
        seconds, library = timed(inputs, output, SMALL, workers)
        assert library.finished == count
        print(f"  resume of the finished run: {seconds:.2f} s")


def bench_workers(inputs: Path) -> None:
    """Label a real library with one worker and with two."""
    times = {}
    with tempfile.TemporaryDirectory() as place:
        for workers in (1, 2):
            output = Path(place, str(workers))
            times[workers], library = timed(inputs, output, BatchSettings(), workers)
        print(f"{inputs.name}: {len(library.rows)} meshes, {len(library.failed)} failed")
    ratio = times[1] / times[2]
    print(f"  one worker {times[1]:.1f} s, two {times[2]:.1f} s: {ratio:.2f} times as fast")


def main() -> None:
    """Run both."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("library", type=Path, nargs="?", default=Path("meshes"))
    parser.add_argument("--count", type=int, default=5000)
    parser.add_argument("--workers", type=int, default=2)
    options = parser.parse_args()
    if options.count:
        bench_overhead(options.count, options.workers)
    bench_workers(options.library)


if __name__ == "__main__":
    main()
