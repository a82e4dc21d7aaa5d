"""What poses of hands with joints cost: contacts as given, settled, and closed, on one core.

    python scripts/bench_hand_poses.py ../shared/hands/allegro/allegro.urdf --preset allegro

The object is a ball with 20,480 faces. Grasps are made by closing the hand from poses around it and
then shaken by millimetres, as published ones are. Times are of the processor, of all threads.
"""

import argparse
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import trimesh

import grasp3d
from grasp3d.arrays import Floats
from grasp3d.grasps import GraspPoses
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand
from grasp3d.hand.articulated.contacts import HandContacts, hand_contacts
from grasp3d.hand.articulated.hand_scene import HandScene
from grasp3d.mesh import ObjectMesh

TOUCHES = 1e-4
"""Gap, or depth, up to which a link touches and does not penetrate [m]."""


def around(hand: ArticulatedHand, count: int, rng: np.random.Generator) -> Floats:
    """Poses with the object between the half closed fingertips and the palm."""
    half = np.clip(hand.preshapes["open"] + 0.9 * np.sign(hand.closing), *hand.limits_of_joints.T)
    (links,) = hand.link_poses(half)
    tips = links[[hand.link_names.index(one) for one in hand.fingertips], :3, 3]
    palm = links[hand.link_names.index(hand.palm), :3, 3]
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, 3] = rng.normal(0.0, 0.008, (count, 3)) - 0.6 * tips.mean(axis=0) - 0.4 * palm
    return poses


def known_grasps(
    mesh: ObjectMesh, hand: ArticulatedHand, count: int, rng: np.random.Generator
) -> tuple[HandContacts, np.ndarray]:
    """Closed hands that do not penetrate; which links of them touch."""
    opened = np.tile(hand.preshapes["open"], (count, 1))
    poses = around(hand, count, rng)
    for _ in range(3):  # out of the palm, of which the frame may be at the wrist
        depth = np.maximum(-hand_contacts(mesh, hand, poses, opened).gaps.min(axis=1), 0.0)
        poses[:, :3, 3] -= 1.1 * depth[:, None] * hand.approach
    closed = hand_contacts(mesh, hand, poses, opened, rule="closed")
    return closed, closed.gaps.min(axis=1) > -TOUCHES


def timed(name: str, count: int, work: Callable[[], Any]) -> tuple[float, Any]:
    """Run work on poses, and print how many a second it did."""
    start = time.process_time()
    result = work()
    rate = count / (time.process_time() - start)
    print(f"{name:32s} {rate:9.0f} poses/s")
    return rate, result


def labelled(mesh: ObjectMesh, poses: GraspPoses, hand: ArticulatedHand) -> tuple[Any, ...]:
    """Everything that `evaluate_grasps` says of poses as they are given, but epsilon."""
    found = grasp3d.evaluate_grasps(mesh, poses, hand=hand)
    return found.label, found.label_fingertips, found.margin, found.reason


def main() -> None:
    """Measure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("hand", type=Path, help="URDF, MJCF or description of a hand with joints")
    parser.add_argument("--preset", help="numbers of a known hand")
    parser.add_argument("--radius", type=float, default=0.035, help="of the ball [m]")
    parser.add_argument("-n", type=int, default=1000, help="poses")
    options = parser.parse_args()
    hand: Any = grasp3d.read_hand(options.hand, preset=options.preset)
    ball = trimesh.creation.icosphere(5, radius=options.radius)
    mesh = grasp3d.load_mesh(ball, unit="m", max_edge=1e3)
    rng = np.random.default_rng(0)
    known_grasps(mesh, hand, 2, rng)  # compiles, and prepares hand and object
    _, (grasps, good) = timed("closed", 100, lambda: known_grasps(mesh, hand, 100, rng))
    if not good.any():
        parser.error("no closed hand is free of the object: try another --radius")
    rows = rng.choice(np.flatnonzero(good), options.n)
    shaken = rng.normal(0.0, 0.02, (options.n, len(hand.joint_names)))
    postures = np.clip(grasps.posture[rows] + shaken, *hand.limits_of_joints.T)
    poses = grasps.poses[rows].copy()
    poses[:, :3, 3] += rng.normal(0.0, 0.001, (options.n, 3))
    scene = HandScene(mesh, hand, 1.0, 0.005)
    frames = scene.frames(poses, postures)
    timed("kinematics", options.n, lambda: scene.frames(poses, postures))
    timed("gaps", options.n, lambda: scene.touch(frames, contacts=False))
    timed("overlaps of links", options.n, lambda: scene.self_collisions(frames))
    one, given = timed("as given", options.n, lambda: hand_contacts(mesh, hand, poses, postures))
    stated = GraspPoses(poses=poses, posture=postures, unit="m")
    labelled(mesh, stated.take(np.arange(options.n // 10)), hand)  # compiles
    timed("labels and reasons, as given", options.n, lambda: labelled(mesh, stated, hand))
    some = slice(options.n // 5)
    other, settled = timed(
        "settled", len(poses[some]),
        lambda: hand_contacts(mesh, hand, poses[some], postures[some], rule="settled"),
    )  # fmt: skip
    print(f"{'as given per settled':32s} {one / other:9.1f}")
    touched = np.abs(grasps.gaps[rows]) < TOUCHES
    print(f"contacts a pose, as given        {len(given.row) / options.n:9.2f}")
    print(f"links touching before            {touched.sum() / options.n:9.2f}")
    print(f"deepest as given, median [mm]    {-1e3 * np.median(given.gaps.min(axis=1)):9.2f}")
    again = np.abs(settled.gaps[touched[some]]) < TOUCHES
    print(f"of these touch again, settled    {again.mean():9.3f}")
    free = settled.gaps.min(axis=1) > -TOUCHES
    print(f"poses free of the object         {free.mean():9.3f}")
    print(f"change of joints, median [rad]   {np.median(settled.change):9.3f}")


if __name__ == "__main__":
    main()
