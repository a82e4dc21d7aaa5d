"""Labels and scores of whole grippers against MuJoCo: `scripts/evidence_grippers.py -o FOLDER`.

For each object and gripper, random poses are proposed: pairs of opposite surface points, with the
closing axis up to 40 degrees off the normal, any approach around it, and the pair anywhere on the
pad from its root to past its end. Among those at which the gripper closes without a collision, an
equal number is chosen, as far as available, for each label, near the pad's end and further in, with
small and large areas. Each is simulated with a light and a heavy object, half of them as stated,
half at a true pose drawn within the pose error. A file for each object, gripper, load and error
holds poses, all evaluated columns, the drawn values and outcomes; `grasp3d validate` reads it.
Existing files are kept, so that a run can be continued, or split with --only. `all.parquet` has all
rows. The script needs the extra `physics`.

    python scripts/evidence_grippers.py -o FOLDER [--meshes FOLDER] [--count 36] [--only NAME ...]
"""

import argparse
import itertools
import math
import sys
import time
from collections.abc import Iterator
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd
import trimesh
from scipy.spatial import ConvexHull

import grasp3d
from grasp3d.arrays import Floats, Ints, unit_rows
from grasp3d.formats import GraspPoses, write_grasps
from grasp3d.jobs import ClusterSettings
from grasp3d.outcomes import SCORES, SimulationSettings
from grasp3d.outcomes.simulate import parts_of
from grasp3d.outcomes.success import success_rate
from grasp3d.outcomes.validation import roc_auc, scores_of

MESHES = Path(__file__).parents[1] / "meshes"
FOREIGN = {
    "ycb_003_cracker_box.obj": "m", "ycb_006_mustard_bottle.stl": "m", "ycb_025_mug.ply": "m",
    "ycb_042_adjustable_wrench.obj": "m", "ycb_048_hammer.obj": "m", "adv_bar_clamp.obj": "m",
    "adv_gearbox.obj": "m", "egad_G3.obj": "mm", "kit_Toothpaste_800.obj": "m",
    "cad_angle_block.STL": "in",
}  # fmt: skip
"""Published objects in a folder given by --meshes, and the units of their files."""

LOADS = {"light": grasp3d.Load(mass=0.1, grip_force=40.0),
         "heavy": grasp3d.Load(mass=0.4, grip_force=40.0)}  # fmt: skip
ERRORS = {"exact": "0deg", "wrong": "5mm,3deg"}
SETTINGS = SimulationSettings(pull_time=0.3, time_step=2e-3, give_way="1mm", seed=11)
PROPOSED, TILT, PAST = 3000, math.radians(40.0), 2e-3
"""Number of poses tried; tilt of the closing axis; how far contacts may be past the pad's end [m].
"""
PROBABILITIES = (0.0, 0.02, 0.1, 0.3, 0.5, 0.7, 0.8, 0.9, 0.95, 0.99, 1.0)
"""Limits of bins of the probability of success."""
NEAR, SMALL = 7e-3, 100e-6
"""Distance to the pad's end [m] and area [m^2] below which contacts count as near and small."""


class Case(NamedTuple):
    """What is simulated together."""

    name: str
    gripper: str
    load: str
    error: str

    @property
    def file(self) -> str:
        """Name of the case's file."""
        return f"{Path(self.name).stem}-{self.gripper}-{self.load}-{self.error}.parquet"


def read(path: Path) -> grasp3d.ObjectMesh:
    """Read an object and make sure that it is closed and has a unit."""
    unit = FOREIGN.get(path.name, "m")
    mesh = grasp3d.load_mesh(path)
    if mesh.unit is None or not mesh.report.closed:
        repair = "safe" if mesh.report.closed else "full"
        mesh = grasp3d.load_mesh(path, grasp3d.MeshOptions(unit=unit, repair=repair))
    return mesh


def pairs(mesh: grasp3d.ObjectMesh, random: np.random.Generator) -> tuple[Floats, Floats]:
    """Middles of pairs of opposite surface points, and the axes through them, shape (k, 3) each."""
    surface = trimesh.Trimesh(mesh.vertices, mesh.faces, process=False)
    points, faces = trimesh.sample.sample_surface(
        surface, 4 * PROPOSED, seed=int(random.integers(1 << 31))
    )
    inward = -surface.face_normals[faces]
    off = np.arccos(1.0 - random.random(len(points)) * (1.0 - math.cos(TILT)))
    across = unit_rows(np.cross(inward, random.standard_normal(inward.shape)))
    axes = np.cos(off)[:, None] * inward + np.sin(off)[:, None] * across
    start = points + 1e-6 * mesh.size * axes
    hits, rays, _ = surface.ray.intersects_location(start, axes, multiple_hits=True)
    depth = ((hits - start[rays]) * axes[rays]).sum(axis=1)
    order = np.lexsort((depth, rays))
    hits, rays = hits[order], rays[order]
    first = np.flatnonzero(np.diff(rays, prepend=-1))
    last = np.flatnonzero(np.diff(rays, append=len(points) + 1))
    chosen = np.where(random.random(len(first)) < 0.5, first, last)
    return 0.5 * (points[rays[chosen]] + hits[chosen]), axes[rays[chosen]]


def proposed(
    mesh: grasp3d.ObjectMesh, hand: grasp3d.ParallelGripper, random: np.random.Generator
) -> GraspPoses:
    """Propose random poses, with contacts anywhere on the pad."""
    middles, x = pairs(mesh, random)
    y = unit_rows(np.cross(random.standard_normal(x.shape), x))
    z = np.cross(x, y)
    half = 0.5 * hand.pad_height
    along = random.uniform(-half, half + PAST, (len(x), 1))
    poses = np.tile(np.eye(4), (len(x), 1, 1))
    poses[:, :3, :3] = np.stack([x, y, z], axis=2)
    poses[:, :3, 3] = middles - along * z
    return GraspPoses(poses=poses[:PROPOSED], unit=mesh.unit, hand=hand)


def chosen(strata: Ints, count: int, random: np.random.Generator) -> Ints:
    """Choose indices, in random order, with each stratum represented about equally."""
    shuffled = random.permutation(len(strata))
    turn = pd.Series(strata[shuffled]).groupby(strata[shuffled]).cumcount().to_numpy()
    return np.asarray(random.permutation(shuffled[np.argsort(turn, kind="stable")][:count]))


def poses_of(
    mesh: grasp3d.ObjectMesh, hand: grasp3d.ParallelGripper, count: int, seed: int
) -> GraspPoses:
    """Choose the poses to simulate, and note where their contacts are."""
    random = np.random.default_rng(seed)
    found = grasp3d.evaluate_grasps(mesh, proposed(mesh, hand, random), hand=hand)
    jaws = found.jaws
    from_tcp = jaws.points - jaws.poses[:, None, :3, 3]
    heights = (from_tcp * jaws.poses[:, None, :3, 2]).sum(axis=2)  # (k, 2)
    end = hand.end - heights.max(axis=1)
    area = jaws.area.min(axis=1)
    strata = 4 * found.label + 2 * (end < NEAR) + (area < SMALL)
    usable = np.flatnonzero(found.reachable)
    rows = usable[chosen(strata[usable], count, random)]
    hulls = [ConvexHull(part) for part in parts_of(mesh, SETTINGS, ClusterSettings(workers=0))]
    off = np.abs([depths(hulls, jaws.points[rows, jaw]) for jaw in range(2)]).max(axis=0)
    columns = {
        "end_distance_m": end[rows], "area_m2": area[rows], "settling_turn": jaws.turn[rows],
        "part_depth_m": off,
    }  # fmt: skip
    return replace(found.given.take(rows), columns=columns)


def depths(hulls: list[ConvexHull], points: Floats) -> Floats:
    """Depths of points (k, 3) below the surface of a union of convex parts, shape (k,)."""
    planes = [hull.equations for hull in hulls]
    return np.max([-(points @ one[:, :3].T + one[:, 3]).max(axis=1) for one in planes], axis=0)


def simulated(case: Case, mesh: grasp3d.ObjectMesh, poses: GraspPoses) -> GraspPoses:
    """Simulate every other pose of a case; return these poses with their outcomes."""
    first = list(ERRORS).index(case.error)
    hand = poses.hand
    assert isinstance(hand, grasp3d.ParallelGripper)
    load = LOADS[case.load]
    tried = grasp3d.simulate_grasps(
        mesh,
        poses.take(np.arange(first, poses.count, len(ERRORS))),
        hand=hand,
        simulation=replace(
            SETTINGS, object_mass=load.mass, grip_force=load.grip_force,
            pose_error=ERRORS[case.error],
        ),
        cluster=ClusterSettings(workers=0),
    )  # fmt: skip
    return replace(tried, object_file=case.name)


def cases(objects: dict[str, Path], grippers: list[str]) -> Iterator[Case]:
    """All cases."""
    for name, gripper in itertools.product(objects, grippers):
        yield from (Case(name, gripper, *both) for both in itertools.product(LOADS, ERRORS))


def work(path: Path, gripper: str, left: list[Case], output: Path, count: int) -> str:
    """Simulate the cases of an object and a gripper; return the text to print."""
    try:
        mesh, hand = read(path), grasp3d.ParallelGripper.preset(gripper)
        poses = poses_of(mesh, hand, count, sum(map(ord, path.name + gripper)))
        begun, done = time.perf_counter(), 0
        for case in left:
            tried = simulated(case, mesh, poses)
            write_grasps(output / case.file, tried)
            done += tried.count
    except grasp3d.GraspError as error:
        return f"{path.name}, {gripper}: {error}"
    spent = (time.perf_counter() - begun) / done
    return f"{path.name}, {gripper}: {done} grasps, {spent:.2f} s each"


def run(options: argparse.Namespace, objects: dict[str, Path]) -> None:
    """Simulate the cases that have no file yet."""
    grouped = itertools.groupby(cases(objects, options.grippers), lambda case: case[:2])
    with ProcessPoolExecutor(options.workers) as pool:
        jobs = []
        for (name, gripper), several in grouped:
            left = [case for case in several if not (options.output / case.file).exists()]
            if left:
                given = objects[name], gripper, left, options.output, options.count
                jobs.append(pool.submit(work, *given))
        for done in as_completed(jobs):
            print(done.result(), flush=True)


def evaluated(case: Case, path: Path, given: Path) -> pd.DataFrame:
    """Rows of a file, with the labels and scores of its poses for the stated error and load."""
    load, hand = LOADS[case.load], grasp3d.read_hand(case.gripper)
    poses = grasp3d.read_grasps(path)
    found = grasp3d.evaluate_grasps(
        read(given), poses, hand=hand, load=load, pose_error=ERRORS[case.error]
    )
    return pd.read_parquet(path).assign(
        object=case.name, gripper=case.gripper, load=case.load, errors=case.error,
        file=path.name, outcome=poses.outcome,
        sure=[grasp3d.Label(code).name for code in found.letter],
        **scores_of(found),
    )  # fmt: skip


def collected(options: argparse.Namespace, objects: dict[str, Path]) -> pd.DataFrame:
    """All rows, evaluated, in one table."""
    frames = []
    for case in cases(objects, options.grippers):
        path = options.output / case.file
        if path.exists():
            frames.append(evaluated(case, path, objects[case.name]))
    return pd.concat(frames, ignore_index=True)


def held_of(rows: pd.DataFrame) -> str:
    """Write the share of some grasps that held, with its 95 % confidence interval."""
    rate = success_rate("", rows.outcome.to_numpy() == 1.0)
    low, high = rate.interval
    return f"{rate.count} | {rate.rate:.3f} | {low:.3f} to {high:.3f}"


def report(rows: pd.DataFrame) -> None:
    """Print how many grasps of each kind held, and how well scores predict it."""
    rows = rows[rows.outcome.notna()]
    print(f"\n{len(rows)} grasps of {rows.object.nunique()} objects; fates:")
    print(pd.crosstab(rows.fate, [rows.sure]).to_string())
    rows = rows.assign(
        end=np.where(rows.end_distance_m < NEAR, "near end", "further in"),
        area=np.where(rows.area_m2 < SMALL, "small", "large"),
    )
    for by in (
        ["label"], ["sure"], ["sure", "errors"], ["sure", "load"], ["sure", "gripper"],
        ["sure", "end"], ["sure", "area"], ["sure", "end", "area", "load"],
        ["label", "end", "area", "load"],
    ):  # fmt: skip
        print("\n" + " | ".join([*by, "grasps", "held", "95 %"]))
        for key, of in rows.groupby(by, sort=True):
            print(" | ".join(map(str, key)) + f" | {held_of(of)}")
    print("\nobject | sure | held | 95 %")
    for name, of in rows[rows.sure == "S"].groupby("object"):
        print(f"{name} | {held_of(of)}")
    held = rows.outcome.to_numpy() == 1.0
    clusters = pd.factorize(rows.object)[0]
    print("\nscore | ROC-AUC | 95 %, for other objects")
    for score in SCORES:
        if score.name in rows:
            values = score.ranked(rows[score.name].to_numpy(float))
            area, low, high = roc_auc(held, values, clusters)
            print(f"{score.name} | {area:.3f} | {low:.3f} to {high:.3f}")


def main() -> None:
    """Run the command."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("-o", "--output", type=Path, required=True, help="folder of the results")
    parser.add_argument("--meshes", type=Path, help="folder of the published objects")
    parser.add_argument("--count", type=int, default=36, help="poses of an object and a gripper")
    parser.add_argument("--grippers", nargs="+", default=["franka", "wsg50"])
    parser.add_argument("--only", nargs="+", help="names of objects, without the suffix")
    parser.add_argument("--workers", type=int, default=2, help="processes")
    parser.add_argument("--report", action="store_true", help="only the tables of what there is")
    options = parser.parse_args()
    options.output.mkdir(parents=True, exist_ok=True)
    paths = [path for path in sorted(MESHES.iterdir()) if path.suffix not in {".md", ".png"}]
    for name in FOREIGN:
        if options.meshes is not None and (options.meshes / name).exists():
            paths.append(options.meshes / name)
        else:
            print(f"{name}: skipped, as it is in no folder (--meshes)", file=sys.stderr)
    objects = {path.name: path for path in paths if not options.only or path.stem in options.only}
    if not options.report:
        run(options, objects)
    rows = collected(options, objects)
    rows.to_parquet(options.output / "all.parquet")
    report(rows)


if __name__ == "__main__":
    main()
