"""Time of the search for grasps of three fingers and more.

    python scripts/bench_multifinger.py

First whole labellings, two threads, each in a separate process: the mug of the library with
increasing numbers of vertices and of candidates. `per vertex` is the time of both threads for a
vertex, `per candidate` that for each candidate grasp evaluated; `peak MB` is the process's largest
memory and `before MB` that before the labelling.

Then candidate grasps evaluated per second and core by the search: for three fingers all of the
search, for four and five the difference from the search with one finger less. A candidate is
evaluated by one test, most of three fingers by the angle of a normal to the plane of the contacts.

For comparison (a) the critical angle of each candidate and (b) force closure by a
linear program over cones of 8 edges at the largest critical angle searched for
(scipy.optimize.linprog), both for random candidate grasps of the same meshes in the same run. Times
are processor times, so that other processes hardly affect them.
"""

import math
import multiprocessing
import resource
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import NamedTuple

from grasp3d.system.context import running

LIBRARY = Path(__file__).parents[1] / "meshes"
MUG = "mug.glb"
MESHES = (MUG, "banana.ply", "wrench.glb", "knob.ply")
FINGERS = (3, 4, 5)
SIZES = (5_000, 10_000, 20_000, 40_000)
CANDIDATES = (16, 32, 128)
DEFAULT_CANDIDATES = 64
EDGES = 8
MANY, FEW = 2000, 100
RUNS = 3
"""Number of runs of a search; the fastest is reported."""
MIN_DIFFERENCE = 0.1
"""Fraction of a search's time below which the difference by one finger is not significant."""
MEGABYTE = 1024.0
"""Units of `ru_maxrss`, kilobytes, in a megabyte."""


class Labelling(NamedTuple):
    """One measurement of a whole labelling."""

    vertices: int
    candidates: int
    seconds: float
    evaluated: int
    before: float
    peak: float


def peak_memory() -> float:
    """Largest memory of this process so far [MB]."""
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / MEGABYTE


def labelled(vertices: int, candidates: int, fingers: int = 3, threads: int = 2) -> Labelling:
    """Label the mug with about so many vertices, after compilation, in this process."""
    from grasp3d import GraspModel, MultifingerSampling, label_surface, load_mesh

    path = LIBRARY / MUG
    model, sampling = GraspModel(fingers=fingers), MultifingerSampling(candidates=candidates)
    label_surface(
        load_mesh(LIBRARY / "sphere.stl"), model, sampling=MultifingerSampling(candidates=8)
    )
    mesh = load_mesh(path)
    edge = 4.0 * mesh.size / math.sqrt(vertices)
    while len(mesh.vertices) < vertices:
        mesh = load_mesh(path, max_edge=edge)
        edge *= 0.98
    before = peak_memory()
    start = time.perf_counter()
    with running(threads=threads):
        labels = label_surface(mesh, model, sampling=sampling)
    seconds = time.perf_counter() - start
    return Labelling(
        len(mesh.vertices), candidates, seconds, labels.search.evaluated, before, peak_memory()
    )


def in_own_process(vertices: int, candidates: int) -> Labelling:
    """Take one measurement in a new process, for its peak memory."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as executor:
        return executor.submit(labelled, vertices, candidates).result()


def whole_labellings() -> None:
    """Print a line per size and per number of candidates."""
    print("mug, 3 fingers, 2 threads")
    for vertices, candidates in [
        *((v, DEFAULT_CANDIDATES) for v in SIZES),
        *((SIZES[0], c) for c in CANDIDATES),
    ]:
        row = in_own_process(vertices, candidates)
        work = 2.0 * row.seconds
        print(
            f"{row.vertices:6} vertices, {row.candidates:3} candidates: {row.seconds:6.1f} s, "
            f"{1e3 * work / row.vertices:6.2f} ms per vertex, "
            f"{1e6 * work / row.evaluated:5.2f} us per candidate of {row.evaluated / 1e6:6.1f} M, "
            f"before {row.before:4.0f} MB, peak {row.peak:4.0f} MB"
        )


def processor_time(work: Callable[[], object]) -> float:
    """Processor time of a function in one thread [s]."""
    start = time.process_time()
    work()
    return time.process_time() - start


def of_mesh(name: str) -> None:
    """Print a line for each number of fingers on one mesh."""
    import grasp3d
    from grasp3d.settings import search_cone
    from grasp3d.surface.sampling.multifinger import search

    mesh = grasp3d.load_mesh(LIBRARY / name)
    before, seconds_before = 0, 0.0
    for fingers in FINGERS:
        cone = search_cone(grasp3d.GraspModel(fingers=fingers))
        find = partial(search, mesh, fingers, grasp3d.MultifingerSampling(), cone)
        evaluated = find().evaluated
        seconds = min(processor_time(find) for _ in range(RUNS))
        added, more = seconds - seconds_before, evaluated - before
        before, seconds_before = evaluated, seconds
        if added < MIN_DIFFERENCE * seconds:
            print(
                f"{name:12} {fingers} fingers: {more / 1e6:6.2f} M evaluated, in less than "
                f"{100.0 * MIN_DIFFERENCE:.0f} % of the search's {seconds:.1f} s: not significant"
            )
            continue
        each = added / more
        found, solved = reference_times(mesh, fingers, math.tan(cone))
        print(
            f"{name:12} {fingers} fingers: {more / 1e6:6.2f} M evaluated, "
            f"{1e-3 / each:6.0f} k per s and core; "
            f"its angle {1e6 * found:6.1f} us, {found / each:6.1f} x; "
            f"a linear program {1e6 * solved:6.0f} us, {solved / each:6.0f} x"
        )


def reference_times(mesh, fingers: int, friction: float) -> tuple[float, float]:  # noqa: ANN001
    """Time of one candidate [s]: of its critical angle, and of closure by a linear program."""
    from scipy.optimize import linprog

    import grasp3d
    from grasp3d.quality.wrenches import wrenches

    contacts = random_candidates(mesh, fingers, friction)
    angles = partial(grasp3d.critical_friction_angle, contacts)
    angles()
    rows = wrenches(contacts, edges=EDGES, torque_scale=mesh.torque_scale)[:FEW]
    count = rows.shape[1]

    def programs() -> None:
        for columns in rows:
            linprog([0.0] * count, A_eq=columns.T, b_eq=[0.0] * 6, bounds=(1.0, None))

    return processor_time(angles) / MANY, processor_time(programs) / FEW


def random_candidates(mesh, fingers: int, friction: float):  # noqa: ANN001, ANN201
    """Grasps with one finger at a random vertex and the others at random candidate points."""
    import numpy as np

    import grasp3d
    from grasp3d.mesh.surface_points import SurfacePoints
    from grasp3d.surface.contacts import SurfaceContacts, vertex_surface_points
    from grasp3d.surface.sampling.candidate_points import spread_points

    rng = np.random.default_rng(0)
    points = spread_points(mesh, DEFAULT_CANDIDATES)
    others = np.argsort(rng.random((MANY, DEFAULT_CANDIDATES)), axis=1)[:, : fingers - 1]
    smooth = np.flatnonzero(mesh.normal_sets.counts == 1)
    first = vertex_surface_points(mesh, rng.choice(smooth, MANY))
    found = SurfaceContacts(
        mesh,
        SurfacePoints(
            np.concatenate([first.faces[:, None], points.faces[others]], axis=1),
            np.concatenate([first.weights[:, None], points.weights[others]], axis=1),
        ),
    )
    return grasp3d.Contacts(found.points - mesh.center_mass, found.normals, friction)


def main() -> None:
    """Print all measurements, whole labellings first, while this process uses little memory."""
    whole_labellings()
    for name in MESHES:
        of_mesh(name)


if __name__ == "__main__":
    with running(threads=1):
        main()
