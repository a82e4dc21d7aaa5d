"""Time collision tests of a gripper: `python scripts/bench_reach.py`; needs python-fcl and coal.

A pose is the swept boxes of two fingers and a palm at one approach angle; every library stops at
the first box that collides. Two kinds of poses: random ones about the object, and those of grasps,
opposed contacts at 32 angles each. Beside it the time per whole grasp, all angles and depths, as
searches test it. One thread; geometries and transforms of FCL and coal are made ahead, and
their contact requests are off. All verdicts are compared;
coal misses a collision now and then.
"""

import argparse
import math
import sys
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import coal
import fcl
import numpy as np

sys.path.insert(0, str(Path(__file__).parents[1]))

from grasp3d import ObjectMesh, load_mesh
from grasp3d._kernels.jaws.gripper_parts import RESULTS, make_workspace
from grasp3d._kernels.jaws.reaching import collide_poses, reach_pairs
from grasp3d.hand.jaw_reach import NormalizedScene
from grasp3d.hand.table import Approach, Table
from tests.helpers.collisions import FAR
from tests.helpers.grippers import HAND, TIPS, normalized_poses, opposed, random_poses

ROOT = Path(__file__).parents[1]
MESHES = ("torus.glb", "banana.ply", "mug.glb")
ANGLES = 32


def boxes(opening: float, scale: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Sizes and centres of the hand's swept boxes, in object sizes."""
    g = HAND
    back = g.end - g.finger_length
    low, high = 0.5 * opening + g.compliance, 0.5 * opening + g.finger_thickness + g.clearance
    result = []
    for x, dx, dy, top in (
        (-0.5 * (low + high), high - low, g.finger_width, g.end),
        (0.5 * (low + high), high - low, g.finger_width, g.end),
        (0.0, g.palm_thickness, g.palm_width, back),
    ):
        far = FAR / scale
        sizes = np.array([dx, dy, top + far])
        result.append((sizes * scale, np.array([x, 0.0, 0.5 * (top - far)]) * scale))
    return result


def by_fcl(mesh: ObjectMesh, poses: np.ndarray, openings: np.ndarray) -> Callable[[], list[bool]]:
    """FCL's tests of all poses, ready to run."""
    surface = mesh.contact_surface
    model = fcl.BVHModel()
    model.beginModel(len(surface.faces), len(surface.points))
    model.addSubModel(surface.points, surface.faces)
    model.endModel()
    body, request = fcl.CollisionObject(model, fcl.Transform()), fcl.CollisionRequest()
    parts = [
        [
            fcl.CollisionObject(
                fcl.Box(*sizes), fcl.Transform(pose[:3, :3], pose[:3, :3] @ centre + pose[:3, 3])
            )
            for sizes, centre in boxes(opening, 1.0 / mesh.size)
        ]
        for pose, opening in zip(poses, openings, strict=True)
    ]
    return lambda: [
        any(fcl.collide(part, body, request, fcl.CollisionResult()) for part in three)
        for three in parts
    ]


def by_coal(mesh: ObjectMesh, poses: np.ndarray, openings: np.ndarray) -> Callable[[], list[bool]]:
    """Tests of all poses by coal, ready to run."""
    surface = mesh.contact_surface
    model = coal.BVHModelOBBRSS()
    model.beginModel(len(surface.faces), len(surface.points))
    points, faces = coal.StdVec_Vec3s(), coal.StdVec_Triangle()
    points.extend(list(surface.points))
    faces.extend([coal.Triangle(*map(int, face)) for face in surface.faces])
    model.addSubModel(points, faces)
    model.endModel()
    still, request = coal.Transform3s.Identity(), coal.CollisionRequest()
    request.enable_contact = False
    # A temporary in a call to coal would end the process: everything is kept.
    parts = [
        [
            (
                coal.Box(*sizes),
                coal.Transform3s(pose[:3, :3].copy(), pose[:3, :3] @ centre + pose[:3, 3]),
                coal.CollisionResult(),
            )
            for sizes, centre in boxes(opening, 1.0 / mesh.size)
        ]
        for pose, opening in zip(poses, openings, strict=True)
    ]

    def run() -> list[bool]:
        verdicts = []
        for three in parts:
            hit = False
            for box, where, result in three:
                result.clear()
                if coal.collide(model, still, box, where, request, result):
                    hit = True
                    break
            verdicts.append(hit)
        return verdicts

    return run


def best_time(run: Callable[[], Any], rounds: int = 3) -> tuple[float, Any]:
    """(shortest processor time [s], result) of a few runs."""
    times, result = [], None
    for _ in range(rounds):
        start = time.process_time()
        result = run()
        times.append(time.process_time() - start)
    return min(times), result


def grasp_poses(points: np.ndarray) -> np.ndarray:
    """Poses of grasps at all angles, contacts at the pads' centres (b * ANGLES, 4, 4)."""
    x = points[:, 1] - points[:, 0]
    x /= np.linalg.norm(x, axis=1, keepdims=True)
    z = np.cross(x, np.eye(3)[np.abs(x).argmin(axis=1)])
    z /= np.linalg.norm(z, axis=1, keepdims=True)
    y = np.cross(z, x)
    turns = 2.0 * np.pi * np.arange(ANGLES) / ANGLES
    c, s = np.cos(turns)[:, None], np.sin(turns)[:, None]
    poses = np.tile(np.eye(4), (len(points), ANGLES, 1, 1))
    poses[..., :3, 0] = x[:, None]
    poses[..., :3, 1] = c * y[:, None] + s * z[:, None]
    poses[..., :3, 2] = c * z[:, None] - s * y[:, None]
    poses[..., :3, 3] = points.mean(axis=1)[:, None]
    return poses.reshape(-1, 4, 4)


def compare(kind: str, mesh: ObjectMesh, poses: np.ndarray, openings: np.ndarray) -> int:
    """Print a row of times per pose; returns the verdicts that differ from FCL's."""
    scene = NormalizedScene.of(mesh, HAND, None, Approach())
    found, signs = np.zeros(len(poses), dtype=bool), np.ones(len(poses), dtype=np.int8)
    workspace, scaled, swept = make_workspace(1), openings / mesh.size, True

    def own() -> np.ndarray:
        collide_poses(
            poses, scaled, signs, swept, scene.shape, scene.limits, scene.tree, workspace, found
        )
        return found

    own()
    times = [best_time(own)]
    times += [best_time(library(mesh, poses, openings)) for library in (by_fcl, by_coal)]
    micro = [1e6 * seconds / len(poses) for seconds, _ in times]
    differ = [int((np.array(result) != found).sum()) for _, result in times[1:]]
    print(
        f"  {kind:14}{micro[0]:8.1f}{micro[1]:8.1f}{micro[2]:8.1f}{min(micro[1:]) / micro[0]:8.1f}"
        f"{found.mean():10.2f}{differ[0]:9}{differ[1]:9}",
        flush=True,
    )
    return differ[0]


def grasp_times(mesh: ObjectMesh, points: np.ndarray, normals: np.ndarray) -> None:
    """Print the time per whole grasp."""
    count = len(points)
    inner = np.ascontiguousarray((points - mesh.center) / mesh.size)
    for hand in (HAND, TIPS):
        for table in (None, Table.below(mesh)):
            scene = NormalizedScene.of(mesh, hand, table, Approach())
            codes, free = np.zeros(count, dtype=np.uint8), np.zeros(count, dtype=np.uint64)
            found, workspace = np.full((count, RESULTS), math.nan), make_workspace(ANGLES)
            arguments = (
                inner, normals, np.ones(count, dtype=np.int8), scene.shape, scene.limits, False,
                scene.tree, workspace, codes, free, found,
            )  # fmt: skip
            reach_pairs(*arguments)
            seconds, _ = best_time(lambda a=arguments: reach_pairs(*a))
            print(
                f"  grasp, {hand.name}, {'table' if table else 'no table':9}"
                f"{1e6 * seconds / count:7.1f} us, reached {np.mean(codes == 0):.2f}"
            )


def main() -> int:
    """Print the times; 1 where a verdict differs from FCL's."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--poses", type=int, default=3000)
    parser.add_argument("meshes", nargs="*", default=[ROOT / "meshes" / name for name in MESHES])
    options = parser.parse_args()
    differ = 0
    for path in options.meshes:
        stated = Path(path).suffix in {".glb", ".gltf", ".3mf"}
        mesh = load_mesh(path, unit=None if stated else "m")
        print(f"{Path(path).name}, {len(mesh.faces)} faces, size {mesh.size:.3g} {mesh.unit}")
        print("  us per pose       own     fcl    coal   ratio  collide  not fcl not coal")
        poses, openings = random_poses(mesh, options.poses, seed=1)
        differ += compare("random", mesh, normalized_poses(mesh, poses), openings)
        points, normals = opposed(mesh, 600, seed=1)
        widths = np.linalg.norm(points[:, 1] - points[:, 0], axis=1)
        fits = widths < HAND.limits[1]
        points, normals, widths = points[fits], normals[fits], widths[fits]
        few = max(options.poses // ANGLES, 1)
        poses = grasp_poses(points[:few])
        differ += compare(
            "of grasps", mesh, normalized_poses(mesh, poses), np.repeat(widths[:few], ANGLES)
        )
        grasp_times(mesh, points, normals)
    return int(differ > 0)


if __name__ == "__main__":
    sys.exit(main())
