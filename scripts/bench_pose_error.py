"""What tried poses cost: grasps at 32 poses each, relative to one pose.

    python scripts/bench_pose_error.py [--mesh MESH] [--grasps N]

Labels a mesh for the Franka hand, takes its best grasps, and evaluates their poses exact and with a
pose error of 5 mm and 3 degrees, patch payloads and scores included. Prints both times and their
ratio, the best of several runs each.
"""

import argparse
import time
from collections.abc import Callable

import grasp3d
from grasp3d.grasps import GraspPoses
from grasp3d.grasps.evaluated_poses import EvaluatedPoses

RUNS = 3
ERROR = "5mm,3deg"


def best_time(work: Callable[[], object]) -> float:
    """Shortest time of several runs [s]."""
    times = []
    for _ in range(RUNS):
        start = time.perf_counter()
        work()
        times.append(time.perf_counter() - start)
    return min(times)


def main() -> None:
    """Measure, and print."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--mesh", default="meshes/spray.glb")
    parser.add_argument("--grasps", type=int, default=50)
    arguments = parser.parse_args()
    mesh, hand = grasp3d.load_mesh(arguments.mesh), grasp3d.read_hand("franka")
    load = grasp3d.Load(mass=0.2)
    labels = grasp3d.label_surface(mesh, hand=hand, load=load)
    found = grasp3d.best_grasps(labels, arguments.grasps, distance=mesh.size / 32.0)
    poses = GraspPoses(poses=found.poses, unit=mesh.unit)

    def evaluate(error: str | None) -> EvaluatedPoses:
        """Evaluate the poses, with everything that is in tables."""
        results = grasp3d.evaluate_grasps(mesh, poses, hand=hand, load=load, pose_error=error)
        results.compute("epsilon_range")
        results.compute("holding")
        results.compute("robustness")
        return results

    tried = evaluate(ERROR).robustness.tried
    one, many = (best_time(lambda error=error: evaluate(error)) for error in (None, ERROR))
    print(f"{found.size} grasps of {mesh.report.source}")
    print(f"one pose each       {one:8.3f} s")
    print(f"{tried} poses each       {many:8.3f} s, {many / one:.1f} x one")


if __name__ == "__main__":
    main()
