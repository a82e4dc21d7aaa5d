"""Hold the closing of jaws against brute force.

    python scripts/validate_closing.py [--poses 500]

Rigid flat pads on a fixed object, where no finger starts in it: thin boxes are moved in steps of 1
um, tested against all faces by the Flexible Collision Library. A free object: at rest, no random
small motion closes the jaws by more than friction takes, where each motion closes them again. Poses
are random, on shipped meshes.
"""

import argparse
import math
from dataclasses import replace
from pathlib import Path

import fcl
import numpy as np
from scipy.spatial.transform import Rotation

import grasp3d
from grasp3d.arrays import Floats
from grasp3d.hand.closed_jaws import Closing
from grasp3d.hand.closing import close_jaws
from grasp3d.hand.jaws import metres_per_unit
from grasp3d.hand.parallel_gripper import ParallelGripper

MESHES = ("mug.glb", "spray.glb", "banana.ply", "knob.ply", "wrench.glb")
COARSE, FINE = 0.05, 0.001
"""Steps [mm]."""

FRICTION = 0.5
MOTIONS = 64
LARGEST = 0.05
"""Largest turn [rad], and shift in half diagonals of a pad, that is tried on an object at rest."""


def random_poses(mesh: grasp3d.ObjectMesh, count: int, seed: int) -> Floats:
    """Poses around random points of the surface, the closing axis near its normal."""
    random = np.random.default_rng(seed)
    rows = random.integers(len(mesh.vertices), size=count)
    poses = np.tile(np.eye(4), (count, 1, 1))
    for pose, row in zip(poses, rows, strict=True):
        turn, _ = Rotation.align_vectors([mesh.normals[row]], [[1.0, 0.0, 0.0]])
        about = Rotation.from_euler("x", random.uniform(0.0, 2.0 * math.pi))
        tilt = Rotation.from_rotvec(random.normal(0.0, 0.2, 3))
        pose[:3, :3] = (turn * about * tilt).as_matrix()
        depth = random.uniform(0.2, 0.8) * 0.05 / metres_per_unit(mesh)
        pose[:3, 3] = mesh.vertices[row] + depth * pose[:3, 0]
    return poses


def stepped(model: fcl.BVHModel, pose: Floats, side: float, hand: ParallelGripper) -> float | None:
    """Position at which a pad touches any face [mm], as x from its side; None: none, or inside."""
    thickness, most = 1.2 * COARSE, 0.5e3 * hand.max_opening
    box = fcl.Box(thickness, 1e3 * hand.pad_width, 1e3 * hand.pad_height)
    body, pad = fcl.CollisionObject(model), fcl.CollisionObject(box)
    pad.setRotation(pose[:3, :3])
    request = fcl.CollisionRequest()

    def meets(position: float) -> bool:
        x = side * (position - 0.5 * thickness)
        pad.setTranslation(pose[:3, 3] + x * pose[:3, 0])
        return bool(fcl.collide(pad, body, request, fcl.CollisionResult()))

    position = -most
    if meets(position):
        return None
    while not meets(position):
        position += COARSE
        if position > most:
            return None
    position -= COARSE
    while not meets(position):
        position += FINE
    return position


def fixed(hand: ParallelGripper, count: int) -> None:
    """Compare first touches of rigid pads with brute force."""
    rigid = replace(hand, compliance=0.0, inner_faces=(), tip_thickness=None)
    print("rigid pads on a fixed object, steps of 1 um")
    errors, compared, missed = [], 0, 0
    for seed, name in enumerate(MESHES):
        mesh = loaded(name)
        model = boundary(mesh)
        scale = 1e3 * metres_per_unit(mesh)
        poses = outside(mesh, random_poses(mesh, 4 * count // len(MESHES), seed), rigid)
        poses = poses[: count // len(MESHES)]
        compared += len(poses)
        found = close_jaws(mesh, poses, rigid)
        for pose, positions in zip(poses, found.positions * scale, strict=True):
            scaled = pose.copy()
            scaled[:3, 3] *= scale
            expected = [stepped(model, scaled, side, rigid) for side in (1.0, -1.0)]
            touched = np.array([one is not None for one in expected])
            missed += int((touched != np.isfinite(positions)).sum())
            for side, one, position in zip((1.0, -1.0), expected, positions, strict=True):
                if one is not None and math.isfinite(position):
                    errors.append(side * position - one)
    values = 1e3 * np.array(errors)
    print(f"{compared} poses, {len(values)} first touches: computed - stepped from "
          f"{values.min():+.2f} to {values.max():+.2f} um; touched by only one of both: {missed}"
          )  # fmt: skip


def boundary(mesh: grasp3d.ObjectMesh) -> fcl.BVHModel:
    """All faces of a mesh [mm]."""
    model = fcl.BVHModel()
    model.beginModel(len(mesh.vertices), len(mesh.faces))
    model.addSubModel(mesh.vertices * 1e3 * metres_per_unit(mesh), mesh.faces)
    model.endModel()
    return model


def outside(mesh: grasp3d.ObjectMesh, poses: Floats, hand: ParallelGripper) -> Floats:
    """The poses at which no finger starts in the object, shape (k, 4, 4)."""
    return poses[close_jaws(mesh, poses, hand).state != Closing.STARTS_INSIDE]


def free(hand: ParallelGripper, count: int) -> None:
    """Try motions of objects at rest."""
    rigid = replace(hand, compliance=0.0)
    print(f"free objects at rest, friction {FRICTION:g}: {MOTIONS} motions of each")
    total, best = 0, []
    for seed, name in enumerate(MESHES):
        mesh = loaded(name)
        poses = random_poses(mesh, count // len(MESHES), 100 + seed)
        found = close_jaws(mesh, poses, rigid, object_motion="free", friction=FRICTION)
        rows = np.flatnonzero(found.closed)
        total += len(rows)
        best += [
            gain_of_motions(mesh, found.poses[k], found.opening[k], rigid, int(k)) for k in rows
        ]
    values = 1e3 * np.array(best)
    print(f"{count} poses, {total} at rest: largest gain of closing over friction "
          f"{values.max():.2f} um, above 5 um: {(values > 5.0).sum()}")  # fmt: skip


def gain_of_motions(
    mesh: grasp3d.ObjectMesh, pose: Floats, width: float, hand: ParallelGripper, seed: int
) -> float:
    """Largest decrease of the opening minus what friction takes [mm], over random motions."""
    random = np.random.default_rng(seed)
    angles = random.uniform(0.0, 2.0 * math.pi, MOTIONS)
    across = np.stack([np.zeros(MOTIONS), np.cos(angles), np.sin(angles)], axis=1)
    sizes = random.uniform(0.0, LARGEST, MOTIONS)
    shifted = np.arange(MOTIONS) % 2 == 1  # the others turn
    pad = 0.5 * math.hypot(hand.pad_width, hand.pad_height) / metres_per_unit(mesh)
    moved = np.tile(pose, (MOTIONS, 1, 1))
    turns = np.where(shifted, 0.0, sizes)[:, None] * across
    moved[:, :3, :3] = pose[:3, :3] @ Rotation.from_rotvec(turns).as_matrix()
    moved[:, :3, 3] += np.where(shifted, pad * sizes, 0.0)[:, None] * (across @ pose[:3, :3].T)
    found = close_jaws(mesh, moved, hand)
    slip = np.where(shifted, 2.0 * pad, width) * sizes
    gain = width - found.opening - FRICTION * slip
    scale = 1e3 * metres_per_unit(mesh)
    return float(np.nanmax(gain, initial=-math.inf) * scale)


def loaded(name: str) -> grasp3d.ObjectMesh:
    """A shipped mesh; those without a unit are in metres."""
    path = Path(__file__).parents[1] / "meshes" / name
    mesh = grasp3d.load_mesh(path)
    return mesh if mesh.unit else grasp3d.load_mesh(path, unit="m")


def main() -> None:
    """Print both comparisons."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("--poses", type=int, default=500)
    count = parser.parse_args().poses
    hand = ParallelGripper.preset("franka")
    fixed(hand, count)
    free(hand, count)


if __name__ == "__main__":
    main()
