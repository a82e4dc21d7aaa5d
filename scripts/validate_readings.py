"""Plant mistakes in files of poses, and count how often they are named: `validate_readings.py`.

Twelve kinds of mistakes in poses of six objects, 20 and 200 poses each, of grasps that were found
on the object and then moved and turned by a few millimetres and degrees; and the same poses without
mistake, good ones and ones of which many miss. For each object and number of poses it prints which
mistakes were named right (=), up to the symmetry of the gripper, and to half a pad for a distance
that no program has; not named (-, ? if several readings fit) or named wrong (X); then the alarms at
poses without mistake. Ends with 1 if one was named wrong, there was an alarm, or fewer than 90 %
were named of the uneven objects with 200 poses.

--noise 2 3    standard deviations of position [mm] and angle [deg] of the poses
"""

import argparse
import sys
import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

import grasp3d
from grasp3d.arrays import Floats
from grasp3d.grasps.pose_readings import suspected_reading
from grasp3d.grasps.poses import GraspPoses
from grasp3d.grasps.readings import PoseReading
from grasp3d.hand.frames import GripperFrame

MESHES = Path(__file__).parents[1] / "meshes"
FRANKA = grasp3d.ParallelGripper.preset("franka")
UNEVEN = ("mug", "spray", "banana")
COUNTS = 20, 200
GOOD, POOR = 17, 17
"""Files without mistake of each object and number of poses, with good poses and with poor ones."""


@dataclass(frozen=True)
class Mistake:
    """The frame in which a file has poses, the one in which it is read, and what else is wrong."""

    true: str
    stated: str
    change: Callable[[Floats], Floats] = np.asarray


def quaternions(*order: int) -> Callable[[Floats], Floats]:
    """Quaternions (x y z w) that are stored in another order."""

    def change(poses: Floats) -> Floats:
        changed = poses.copy()
        stored = Rotation.from_matrix(poses[:, :3, :3]).as_quat()[:, order]
        changed[:, :3, :3] = Rotation.from_quat(stored).as_matrix()
        return changed

    return change


def scaled(factor: float) -> Callable[[Floats], Floats]:
    """Lengths that are stored in another scale."""

    def change(poses: Floats) -> Floats:
        changed = poses.copy()
        changed[:, :3, 3] *= factor
        return changed

    return change


def transposed(poses: Floats) -> Floats:
    """Rotations that are stored column by column."""
    changed = poses.copy()
    changed[:, :3, :3] = poses[:, :3, :3].transpose(0, 2, 1)
    return changed


MISTAKES = {
    "closing x read as y": Mistake("graspgen", "hand"),
    "base read as TCP": Mistake("graspgen", "tcp"),
    "TCP read as base": Mistake("tcp", "graspgen"),
    "x approach, at depth": Mistake("graspnetapi", "tcp"),
    "x approach, at base": Mistake("approach=+x,closing=+y,tcp=base", "graspgen"),
    "y closing": Mistake("panda_hand_tcp", "tcp"),
    "approach back": Mistake("approach=-z,closing=+x,tcp=base", "acronym"),
    "origin 45 mm behind": Mistake("approach=+z,closing=+x,tcp=0.045", "tcp"),
    "millimetres": Mistake("hand", "hand", scaled(1000.0)),
    "scale": Mistake("graspgen", "graspgen", scaled(0.5)),
    "wxyz": Mistake("hand", "hand", quaternions(3, 0, 1, 2)),
    "transposed": Mistake("graspgen", "graspgen", transposed),
}


def _objects() -> dict[str, Any]:
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.025)
    return {
        "mug": MESHES / "mug.glb",
        "spray": MESHES / "spray.glb",
        "banana": MESHES / "banana.ply",
        "box": trimesh.creation.box([0.04, 0.06, 0.1]),
        "cylinder": trimesh.creation.cylinder(radius=0.03, height=0.1, sections=96),
        "ball": ball,
    }


def _found(mesh: grasp3d.ObjectMesh) -> GraspPoses:
    """Poses of grasps that the gripper reaches, of any label, in metres."""
    reach = grasp3d.label_surface(mesh, hand=FRANKA).grasps.reach
    assert reach is not None
    known = np.isfinite(reach.poses).all(axis=(1, 2))
    poses = GraspPoses(poses=reach.poses[known], unit=mesh.unit, hand=FRANKA)
    return poses.in_unit("m")


def _drawn(
    found: GraspPoses, count: int, rng: np.random.Generator, millimetres: float, degrees: float
) -> GraspPoses:
    """So many of the poses, moved and turned at random."""
    rows = rng.choice(found.count, count, replace=found.count < count)
    poses = found.poses[rows].copy()
    poses[:, :3, 3] += rng.normal(0.0, 0.001 * millimetres, (count, 3))
    turns = Rotation.from_rotvec(rng.normal(0.0, np.radians(degrees), (count, 3)))
    poses[:, :3, :3] = poses[:, :3, :3] @ turns.as_matrix()
    return replace(found.take(rows), poses=poses)


def misread(poses: GraspPoses, mistake: Mistake) -> GraspPoses:
    """The poses as they are read from a file with a mistake."""
    true, stated = (GripperFrame.of(one) for one in (mistake.true, mistake.stated))
    in_file = mistake.change(poses.poses @ np.linalg.inv(true.to_tcp(FRANKA)))
    return replace(poses, poses=in_file @ stated.to_tcp(FRANKA), gripper_frame=stated)


def _is_right(reading: PoseReading, wrong: GraspPoses, right: GraspPoses, name: str) -> bool:
    """Whether a reading gives the right poses, or those of the gripper turned by half a turn."""
    read = reading.applied(wrong).poses
    turn = np.diag([-1.0, -1.0, 1.0, 1.0])
    near = 0.5 * FRANKA.pad_height if "mm behind" in name else 1e-9
    return any(
        np.abs(read[:, :3, :3] - one[:, :3, :3]).max() < 1e-9
        and np.abs(read[:, :3, 3] - one[:, :3, 3]).max() < near
        for one in (right.poses, right.poses @ turn)
    )


def main() -> int:
    """Print the table, and return the exit code."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--noise", nargs=2, type=float, default=(2.0, 3.0))
    parser.add_argument("--objects", nargs="+", default=[*_objects()])
    parser.add_argument("--only", nargs="+", default=[*MISTAKES])
    args = parser.parse_args()
    rng = np.random.default_rng(0)
    named = wrong = possible = alarms = files = 0
    times = []
    print(f"{'object':9} {'poses':>5}  " + "  ".join(args.only))
    for name in args.objects:
        mesh = grasp3d.load_mesh(_objects()[name], unit="m")
        found = _found(mesh)
        for count in COUNTS:
            cells = []
            for what in args.only:
                right = _drawn(found, count, rng, *args.noise)
                poses = misread(right, MISTAKES[what])
                start = time.perf_counter()
                reading = suspected_reading(mesh, poses, FRANKA)
                times.append(time.perf_counter() - start)
                unnamed = "-" if reading is None else "?"
                good = reading and reading.frame and _is_right(reading, poses, right, what)
                cell = "=" if good else unnamed
                if reading and reading.frame and not good:
                    cell = "X"
                    print(f"  {name}, {count}, {what}: {reading}")
                cells.append(cell.center(len(what)))
                wrong += cell == "X"
                if name in UNEVEN and count == COUNTS[-1]:
                    possible, named = possible + 1, named + (cell == "=")
            print(f"{name:9} {count:5}  " + "  ".join(cells), flush=True)
            for k in range(GOOD + POOR):
                noise = args.noise if k < GOOD else (10.0 * rng.uniform(0.5, 2), 15.0)
                poses = _drawn(found, count, rng, *noise)
                reading = suspected_reading(mesh, poses, FRANKA)
                files, alarms = files + 1, alarms + (reading is not None)
                if reading is not None:
                    print(f"  {name}, {count}, no mistake: {reading}")
    print(f"named wrong {wrong}; alarms at {files} files without mistake {alarms}")
    print(f"named right with {COUNTS[-1]} poses of {', '.join(UNEVEN)}: {named} of {possible}")
    print(f"a file takes {np.mean(times):.2f} s, at most {np.max(times):.2f} s")
    return int(wrong > 0 or alarms > 0 or named < 0.9 * possible)


if __name__ == "__main__":
    sys.exit(main())
