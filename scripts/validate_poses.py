"""Hold margins of poses against MuJoCo: `python scripts/validate_poses.py -o FOLDER [--count 60]`.

Random poses near good grasps of shipped meshes are closed on a free object and pulled, for two
grippers with flat pads; the pulls act at the centre of mass. Writes the poses with their outcomes,
for `grasp3d validate`, and prints how well the margin predicts them: of the contacts of an object
that gives way, and of one that is fixed. Needs the extra `physics`.
"""

import argparse
import math
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

import grasp3d
from grasp3d.grasps import GraspPoses, poses_of
from grasp3d.grasps.pose_files import write_poses
from grasp3d.hand.choices import ObjectMotion
from grasp3d.hand.jaws import metres_per_unit
from grasp3d.physics import simulate_poses
from grasp3d.validating import ValidationSettings

ROOT = Path(__file__).parents[1]
MESHES = ("mug.glb", "bulb.glb", "spray.glb", "banana.ply", "bottle.off", "knob.ply")
GRIPPERS = ("robotiq_2f85", "franka")
TILT, SHIFT = 0.2, 0.005
"""Standard deviations of what is added to good poses [rad], [m]."""


def flat(name: str) -> grasp3d.ParallelGripper:
    """A gripper as it is simulated, with its flat pads alone."""
    return replace(grasp3d.ParallelGripper.preset(name), inner_faces=(), tip_thickness=None)


def random_poses(mesh: grasp3d.ObjectMesh, hand: grasp3d.ParallelGripper, count: int) -> GraspPoses:
    """Poses near the best grasps of a mesh."""
    labels = grasp3d.label_surface(mesh, hand=hand)
    best = poses_of(grasp3d.best_grasps(labels, 40, distance=0.05 * mesh.size)).poses
    random = np.random.default_rng(5)
    poses = best[random.integers(len(best), size=count)].copy()
    turns = Rotation.from_rotvec(random.normal(0.0, TILT, (count, 3))).as_matrix()
    poses[:, :3, :3] = poses[:, :3, :3] @ turns
    poses[:, :3, 3] += random.normal(0.0, SHIFT, (count, 3)) / metres_per_unit(mesh)
    return GraspPoses(poses=poses, unit=mesh.unit, hand=hand)


def tried(name: str, hand: grasp3d.ParallelGripper, count: int) -> GraspPoses:
    """Simulated poses; those whose open tips touch the object have no outcome."""
    mesh = grasp3d.load_mesh(ROOT / "meshes" / name)
    if mesh.unit is None:
        mesh = grasp3d.load_mesh(ROOT / "meshes" / name, unit="m")
    poses = simulate_poses(mesh, random_poses(mesh, hand, count), hand=hand)
    outcome = np.where(poses.columns["fate"] == "blocked", math.nan, poses.outcome)
    return replace(poses, outcome=outcome, object_file=name)


def report(files: list[Path], motion: ObjectMotion) -> None:
    """Print how well the margin predicts the outcomes."""
    found = grasp3d.validate_grasps(
        files,
        meshes=ROOT / "meshes",
        options=grasp3d.MeshOptions(unit="m"),
        object_motion=motion,
        settings=ValidationSettings(frictions=(0.5,), sensor_resolutions=(math.radians(22.6),)),
    )
    quality, (labels,) = found.quality("margin"), found.labels
    rates = ", ".join(
        f"{name} {100.0 * labels.fraction(name):.0f} % of {labels.counts[grasp3d.Label[name]]}"
        for name in ("S", "M", "U")
    )
    low, high = quality.roc_auc_interval
    print(
        f"{motion} object: {found.grasps.size} poses, {100.0 * found.grasps.held.mean():.0f} % "
        f"held; ROC-AUC of the margin {quality.roc_auc:.3f} ({low:.3f} to "
        f"{high:.3f}); held: {rates}"
    )


def main() -> None:
    """Simulate, write and compare."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("-o", "--output", type=Path, default=None, help="folder of the poses")
    parser.add_argument("--count", type=int, default=60, help="poses of each mesh and gripper")
    given = parser.parse_args()
    with tempfile.TemporaryDirectory() as scratch:
        folder = given.output or Path(scratch)
        folder.mkdir(parents=True, exist_ok=True)
        files = []
        for hand in GRIPPERS:
            for name in MESHES:
                files.append(folder / f"{hand}_{Path(name).stem}.json")
                write_poses(files[-1], tried(name, flat(hand), given.count))
        motions: tuple[ObjectMotion, ...] = ("free", "fixed")
        for motion in motions:
            report(files, motion)


if __name__ == "__main__":
    main()
