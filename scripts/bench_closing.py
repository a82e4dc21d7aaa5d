"""Time the closing of jaws: `python scripts/bench_closing.py [--poses 10000]`.

Random poses near good grasps of shipped meshes, divided to about 10,000 faces, on one core; of a
fixed object, and of a free one that comes to rest.
"""

import argparse
import math
import time
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import grasp3d
from grasp3d.arrays import Floats
from grasp3d.grasps import poses_of
from grasp3d.hand.closed_jaws import Closing
from grasp3d.hand.closing import close_jaws
from grasp3d.hand.jaws import metres_per_unit

MESHES = ("mug.glb", "spray.glb", "bulb.glb")
FINENESS = 1.0 / 22.0
"""Longest edge as a fraction of the object's size: about 10,000 faces."""

TILT, SHIFT = 0.15, 0.005
"""Standard deviations of what is added to good poses [rad], [m]."""


def poses_near_grasps(
    mesh: grasp3d.ObjectMesh, hand: grasp3d.ParallelGripper, count: int
) -> Floats:
    """Poses near the best grasps of a mesh."""
    labels = grasp3d.label_surface(mesh, hand=hand)
    best, random = poses_of(grasp3d.best_grasps(labels, 60)).poses, np.random.default_rng(0)
    poses = best[random.integers(len(best), size=count)].copy()
    turns = Rotation.from_rotvec(random.normal(0.0, TILT, (count, 3))).as_matrix()
    poses[:, :3, :3] = poses[:, :3, :3] @ turns
    poses[:, :3, 3] += random.normal(0.0, SHIFT, (count, 3)) / metres_per_unit(mesh)
    return poses


def main() -> None:
    """Print a line for each mesh."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--poses", type=int, default=10_000)
    count = parser.parse_args().poses
    hand = grasp3d.ParallelGripper.preset("franka")
    for name in MESHES:
        path = Path(__file__).parents[1] / "meshes" / name
        size = grasp3d.load_mesh(path).size
        mesh = grasp3d.load_mesh(path, max_edge=FINENESS * size)
        poses, spent = poses_near_grasps(mesh, hand, count), {}
        for motion in ("fixed", "free"):
            close_jaws(mesh, poses[:10], hand, object_motion=motion)
            before = time.process_time()
            found = close_jaws(mesh, poses, hand, object_motion=motion)
            spent[motion] = time.process_time() - before
        closed = 100.0 * float((found.state == Closing.CLOSED).mean())
        print(
            f"{name}: {len(mesh.faces):,} faces, {count:,} poses, {closed:.0f} % close: fixed "
            f"{spent['fixed']:.1f} s, free {spent['free']:.1f} s "
            f"({spent['free'] / spent['fixed']:.1f} times), median turn "
            f"{math.degrees(float(np.median(found.turn[found.closed]))):.1f} degrees"
        )


if __name__ == "__main__":
    with grasp3d.running(threads=1):
        main()
