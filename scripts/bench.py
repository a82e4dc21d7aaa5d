"""Time grasp3d beside alternatives, in the same run.

    python scripts/bench.py [label epsilon multifinger gripper hands validate batch]

The script prints one table: the time of each case, that of its reference, and the ratio of the
reference to the case, which holds on busy machines, too. The references are

* label: Embree, which traces 64 rays from every vertex to the first face;
* epsilon: Qhull's complete hull of the same wrenches, also as a geometric mean;
* multifinger: a linear program per candidate grasp, over cones of 8 edges;
* gripper: FCL's test of the same poses; labels without a gripper; jaws closed on a fixed object;
* hands: letters and reasons of poses without a load;
* validate: evaluating the same poses alone;
* batch: reading and labelling alone, and one worker instead of two.

Times are processor times where one thread works, otherwise wall times. `hands` and `validate` need
the hand and the grasps of `--shared`, a folder with `hands/` and `datasets/`.
"""

import argparse
import math
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import trimesh
from rich.console import Console
from rich.table import Table
from scipy.optimize import linprog
from scipy.spatial import ConvexHull
from scipy.spatial.transform import Rotation

sys.path.insert(0, str(Path(__file__).parents[1]))

import grasp3d
from grasp3d.arrays import Floats
from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.formats import GraspPoses
from grasp3d.hand.closing import close_jaws
from grasp3d.jobs.cluster_settings import ClusterSettings
from grasp3d.mesh.surface_points import FaceRays
from grasp3d.quality.wrenches import wrenches
from grasp3d.settings import search_cone
from grasp3d.surface.multifinger import search
from tests.helpers.random_grasps import SHAPES, random_contacts

ROOT = Path(__file__).resolve().parents[1]
LIBRARY = ROOT / "meshes"
MUG = LIBRARY / "mug.glb"
RAYS = 64
FEW = 60
"""Number of hulls, programs and the like that time a reference."""


class Row(NamedTuple):
    """A case: its time, and that of the reference for the same work [s]."""

    case: str
    seconds: float
    reference: float


def best_time(work: Callable[[], Any], runs: int = 3, clock: Any = time.process_time) -> float:
    """Shortest of a few runs [s], after a warm-up; other processes only lengthen times."""
    work()
    times = []
    for _ in range(runs):
        start = clock()
        work()
        times.append(clock() - start)
    return min(times)


def divided(path: Path, vertices: int) -> grasp3d.ObjectMesh:
    """Load a mesh and divide it until it has at least a number of vertices."""
    mesh = grasp3d.load_mesh(path)
    edge = mesh.size / 25.0 * (len(mesh.vertices) / vertices) ** 0.5
    while len(mesh.vertices) < vertices:
        mesh, edge = grasp3d.load_mesh(path, max_edge=edge), 0.95 * edge
    return mesh


def label() -> Iterator[Row]:
    """Label the mug."""
    for vertices in (5_000, 50_000):
        mesh = divided(MUG, vertices)
        cone = search_cone(grasp3d.GraspModel())
        seconds = best_time(lambda mesh=mesh: grasp3d.label_surface(mesh), 1)
        yield Row(f"{len(mesh.vertices):,} vertices", seconds, embree_seconds(mesh, cone))


def embree_seconds(mesh: grasp3d.ObjectMesh, cone: float) -> float:
    """Time Embree takes to trace rays from every vertex, spread over the search cone [s]."""
    normals, random = mesh.normals, np.random.default_rng(0)
    across = np.cross(normals, random.normal(size=normals.shape))
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    third = np.cross(normals, across)
    origins = (mesh.normalized + 1e-6 * normals).astype(np.float32)
    tracer, seconds = FaceRays(mesh.normalized, mesh.faces), 0.0
    for ray in range(RAYS):
        azimuth, cosine = 2.4 * ray, 1.0 - (1.0 - math.cos(cone)) * (ray + 0.5) / RAYS
        around = math.cos(azimuth) * across + math.sin(azimuth) * third
        directions = (cosine * normals + math.sqrt(1.0 - cosine**2) * around).astype(np.float32)
        start = time.process_time()
        tracer.hits(origins, directions)
        seconds += time.process_time() - start
    return seconds


def epsilon() -> Iterator[Row]:
    """Compute epsilon of force-closed grasps, and the geometric mean of the times."""
    rows = []
    for shape in SHAPES:
        contacts = random_contacts(shape, 4000, seed=0)
        closed = np.flatnonzero(grasp3d.force_closure(contacts, edges=shape.edges).closed)
        batch = contacts.take(closed)
        sets = wrenches(batch, edges=shape.edges)[:FEW]
        own = best_time(partial(grasp3d.epsilon, batch, edges=shape.edges), 5) / len(closed)
        other = best_time(lambda sets=sets: [ConvexHull(one) for one in sets]) / FEW
        rows.append(Row(str(shape), own, other))
        yield rows[-1]
    means = [math.exp(np.log([row[k] for row in rows]).mean()) for k in (1, 2)]
    yield Row("geometric mean", *means)


def multifinger() -> Iterator[Row]:
    """Evaluate candidate grasps of the mug, by the search and by linear programs."""
    mesh = grasp3d.load_mesh(MUG)
    for fingers in (3, 4):
        cone = search_cone(grasp3d.GraspModel(fingers=fingers))
        find = partial(search, mesh, fingers, grasp3d.Sampling(), cone)
        evaluated = find().evaluated
        contacts = random_contacts(SHAPES[fingers - 2], FEW, seed=0)
        columns = wrenches(contacts, edges=8)

        def programs(columns: Floats = columns) -> None:
            for one in columns:
                linprog(np.zeros(len(one)), A_eq=one.T, b_eq=np.zeros(6), bounds=(1.0, None))

        yield Row(
            f"candidate of {fingers} fingers", best_time(find, 1) / evaluated,
            best_time(programs) / FEW,
        )  # fmt: skip


def gripper() -> Iterator[Row]:
    """Test poses for collisions, label with a gripper, and close jaws."""
    mesh, hand = grasp3d.load_mesh(MUG), grasp3d.ParallelGripper.preset("franka")
    yield collisions(mesh)
    table = grasp3d.Table.below(mesh)
    without = best_time(lambda: grasp3d.label_surface(mesh), 1)
    reached = best_time(lambda: grasp3d.label_surface(mesh, hand=hand, table=table), 1)
    yield Row("labels of what is reached", reached, without)
    best = grasp3d.best_grasps(grasp3d.label_surface(mesh, hand=hand), 60).poses
    random = np.random.default_rng(0)
    poses = best[random.integers(len(best), size=2000)].copy()
    turns = Rotation.from_rotvec(random.normal(0.0, 0.15, (len(poses), 3))).as_matrix()
    poses[:, :3, :3] = poses[:, :3, :3] @ turns
    poses[:, :3, 3] += random.normal(0.0, 0.005, (len(poses), 3))
    free, fixed = (
        best_time(partial(close_jaws, mesh, poses, hand, object_motion=motion), 1) / len(poses)
        for motion in ("free", "fixed")
    )
    yield Row("jaws closed on a free object", free, fixed)


def collisions(mesh: grasp3d.ObjectMesh) -> Row:
    """Test random poses about a mesh, with the kernel and with FCL."""
    import fcl

    from grasp3d._kernels.jaws.gripper_parts import make_workspace
    from grasp3d._kernels.jaws.reaching import collide_poses
    from grasp3d.hand.reach import NormalizedScene
    from tests.helpers.collisions import swept_parts
    from tests.helpers.grippers import HAND, normalized_poses, random_poses

    poses, openings = random_poses(mesh, 3000, seed=1)
    poses, openings = normalized_poses(mesh, poses), openings / mesh.size
    scene = NormalizedScene.of(mesh, HAND, None, grasp3d.Approach())
    found, signs = np.zeros(len(poses), dtype=bool), np.ones(len(poses), dtype=np.int8)
    swept = True
    own = best_time(
        partial(
            collide_poses, poses, openings, signs, swept, -1, scene.shape, scene.limits, scene.tree,
            make_workspace(1), found,
        )
    )  # fmt: skip
    surface, model = mesh.contact_surface, fcl.BVHModel()
    model.beginModel(len(surface.faces), len(surface.points))
    model.addSubModel(surface.points, surface.faces)
    model.endModel()
    body = fcl.CollisionObject(model, fcl.Transform())
    parts = [
        [
            fcl.CollisionObject(
                shape, fcl.Transform(pose[:3, :3] @ turn, pose[:3, :3] @ where + pose[:3, 3])
            )
            for shape, turn, where in swept_parts(HAND, opening, 1.0 / mesh.size)
        ]
        for pose, opening in zip(poses, openings, strict=True)
    ]

    def by_fcl() -> None:
        for pose in parts:
            any(
                fcl.collide(one, body, fcl.CollisionRequest(), fcl.CollisionResult())
                for one in pose
            )

    return Row("pose tested", own / len(poses), best_time(by_fcl) / len(poses))


def hands(shared: Path) -> Iterator[Row]:
    """Evaluate random poses of a hand around a ball, with a load and without."""
    hand: Any = grasp3d.read_hand(shared / "hands/allegro/allegro.urdf")
    mesh = grasp3d.load_mesh(trimesh.creation.icosphere(4, radius=0.035), unit="m")
    random, count = np.random.default_rng(0), 300
    half = hand.preshapes["open"] + 0.9 * np.sign(hand.closing)
    posture = np.clip(half + random.normal(0.0, 0.1, (count, len(half))), *hand.limits_of_joints.T)
    (links,) = hand.link_poses(np.clip(half, *hand.limits_of_joints.T))
    tips = links[[hand.link_names.index(one) for one in hand.fingertips], :3, 3].mean(axis=0)
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, 3] = random.normal(0.0, 0.008, (count, 3)) - 0.6 * tips
    given = GraspPoses(poses=poses, posture=posture, unit="m")

    def letters() -> None:
        _ = grasp3d.evaluate_grasps(mesh, given, hand=hand).reason

    def payloads() -> None:
        found = grasp3d.evaluate_grasps(mesh, given, hand=hand, load=grasp3d.Load(mass=0.1))
        _ = found.reason
        _ = found.payload

    plain = best_time(letters, 1) / count
    yield Row("pose with its payload", best_time(payloads, 1) / count, plain)


def validate(shared: Path) -> Iterator[Row]:
    """Compare published grasps with their outcomes."""
    (file,) = (shared / "datasets/acronym").rglob("*.h5")
    (mesh,) = (path for path in (shared / "datasets").rglob("*.obj"))
    poses = grasp3d.read_grasps(file)
    body = grasp3d.load_mesh(mesh, unit="m")
    alone = partial(grasp3d.evaluate_grasps, body, poses, hand=poses.hand)
    whole = best_time(lambda: grasp3d.validate_grasps([file], mesh=mesh), 1, time.perf_counter)
    seconds = best_time(alone, 1, time.perf_counter)
    yield Row("published grasp", whole / poses.count, seconds / poses.count)


def batch() -> Iterator[Row]:
    """Label small convex meshes: cost of a batch beside labelling, and gain of a second worker."""
    random, count, times = np.random.default_rng(0), 200, dict[int, float]()
    settings = BatchSettings(mesh=grasp3d.MeshOptions(unit="cm", max_edge=10.0), best=3)
    with tempfile.TemporaryDirectory() as folder:
        inputs = Path(folder, "in")
        inputs.mkdir()
        for number in range(count):
            points = random.normal(size=(250, 3))
            points *= random.uniform(2.0, 8.0, 3) / np.linalg.norm(points, axis=1, keepdims=True)
            hull = trimesh.Trimesh(points, ConvexHull(points).simplices)
            hull.fix_normals()
            hull.export(inputs / f"{number:03d}.ply")
        for workers in (1, 2):
            start, cluster = time.perf_counter(), ClusterSettings(workers=workers)
            found = grasp3d.label_library(
                [inputs], Path(folder, str(workers)), settings, cluster=cluster, report=False
            )
            times[workers] = time.perf_counter() - start
        rows = found.rows(["seconds_reading", "seconds_labelling"])
    labelling = sum((one.seconds_reading or 0.0) + (one.seconds_labelling or 0.0) for one in rows)
    yield Row("mesh, two workers' time", 2.0 * times[2] / count, labelling / count)
    yield Row("library, two workers", times[2], times[1])


OWN: dict[str, Callable[[], Iterator[Row]]] = {
    "label": label, "epsilon": epsilon, "multifinger": multifinger, "gripper": gripper,
    "batch": batch,
}  # fmt: skip
OF_SHARED: dict[str, Callable[[Path], Iterator[Row]]] = {"hands": hands, "validate": validate}


def seconds_text(value: float) -> str:
    """Write a time with three digits."""
    unit, factor = next(
        (u, f) for u, f in (("µs", 1e6), ("ms", 1e3), ("s", 1.0)) if value < 1e3 / f
    )
    return f"{factor * value:.3g} {unit}"


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__.partition("\n")[0])
    parser.add_argument("names", nargs="*", metavar="NAME", default=[*OWN, *OF_SHARED])
    parser.add_argument("--shared", type=Path, default=ROOT.parent / "shared")
    options = parser.parse_args()
    table = Table("benchmark", "case", "time", "reference", "times as long")
    for name in options.names:
        if name in OF_SHARED and not options.shared.is_dir():
            print(f"{name}: left out, as there is no folder {options.shared}")
            continue
        rows = OWN[name]() if name in OWN else OF_SHARED[name](options.shared)
        for row in rows:
            print(f"{name}: {row.case}", flush=True)
            times = map(seconds_text, (row.seconds, row.reference))
            table.add_row(name, row.case, *times, f"{row.reference / row.seconds:.3g}")
    Console().print(table)


if __name__ == "__main__":
    with grasp3d.running(threads=1):
        main()
