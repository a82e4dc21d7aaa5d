"""Draw hands with joints at grasps of the shipped mug, for the documentation.

    python scripts/draw_hands.py HANDS [NAME ...] [-o docs]

HANDS is a folder with NAME/NAME.urdf of the hands that are known by name. Palms are put around the
mug at random, the hands closed, and of the grasps the best one is drawn, the best one from another
side, one that is ambiguous, and one that is surely unstable.
"""

import argparse
from pathlib import Path

import numpy as np
from scipy.spatial.transform import Rotation

from grasp3d import ObjectMesh, evaluate_grasps, load_mesh, read_hand
from grasp3d.arrays import Floats
from grasp3d.grasps import EvaluatedHandGrasps, GraspPoses
from grasp3d.grasps.ranking import ranked_rows
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand
from grasp3d.hand.articulated.contacts import hand_contacts
from grasp3d.hand.articulated.presets import NAMES
from grasp3d.plots.figures import save_as
from grasp3d.plots.grasps import hand_grasp_figure
from grasp3d.stability.label import Label
from grasp3d.viewer.scene.sheets import draw_hand_grasps

ROOT = Path(__file__).parents[1]
CLEAR = 0.001
"""Least distance of the open hand from the mug [m]."""
NEAREST, FARTHEST = 0.01, 0.09
"""Distance of the mug's middle, or a point near it, from the palm's front [m]."""
SPREAD = np.array([0.025, 0.025, 0.03])
"""Standard deviations of that point [m]."""
OTHER_SIDE = np.cos(np.radians(60.0))


def random_poses(hand: ArticulatedHand, mesh: ObjectMesh, count: int, seed: int) -> Floats:
    """Palms in front of which is a random point near the object's middle, (k, 4, 4) [m]."""
    random = np.random.default_rng(seed)
    shape, approach = hand.shape(0.0), hand.approach
    palm = shape.vertices[shape.faces[shape.links == hand.link_names.index(hand.palm)]]
    (links,) = hand.link_poses(hand.preshapes["open"])
    tips = np.mean([links[hand.link_names.index(tip), :3, 3] for tip in hand.fingertips], axis=0)
    middle = palm.reshape(-1, 3).mean(axis=0)
    front = (palm.reshape(-1, 3) @ approach).max() - middle @ approach
    along = (tips - middle) - (tips - middle) @ approach * approach
    reach = front + random.uniform(NEAREST, FARTHEST, size=(count, 1))
    held = middle + reach * approach + random.uniform(0.0, 1.2, size=(count, 1)) * along
    poses = np.tile(np.eye(4), (count, 1, 1))
    poses[:, :3, :3] = Rotation.random(count, random_state=random).as_matrix()
    target = mesh.center + SPREAD * random.normal(size=(count, 3))
    poses[:, :3, 3] = target - np.einsum("kij,kj->ki", poses[:, :3, :3], held)
    return poses


def closed(hand: ArticulatedHand, mesh: ObjectMesh, poses: Floats) -> EvaluatedHandGrasps:
    """The grasps of palms at which the open hand is free."""
    opened = np.tile(hand.preshapes["open"], (len(poses), 1))
    free = hand_contacts(mesh, hand, poses, opened).gaps.min(axis=1) > CLEAR
    given = GraspPoses(poses=poses[free], posture=opened[free], unit="m")
    return evaluate_grasps(mesh, given, hand=hand, contact_rule="closed")


def chosen(grasps: EvaluatedHandGrasps) -> list[int]:
    """The best grasp, the best one from another side, and those of the other labels."""
    rows = [int(row) for row in ranked_rows(grasps) if grasps.reachable[row]]
    toward = grasps.contacts.poses[:, :3, :3] @ grasps.hand.approach
    stable = [row for row in rows if grasps.label[row] == Label.S]
    others = [row for row in stable if toward[row] @ toward[stable[0]] < OTHER_SIDE]
    found = [*stable[:1], *others[:1]]
    for label in (Label.M, Label.U):
        found += [row for row in rows if grasps.label[row] == label][:1]
    return found


def main() -> None:
    """Draw the hands."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawTextHelpFormatter
    )
    parser.add_argument("hands", type=Path, metavar="HANDS")
    parser.add_argument("names", nargs="*", metavar="NAME", help=", ".join(NAMES))
    parser.add_argument("-o", "--output", type=Path, default=ROOT / "docs")
    parser.add_argument("--count", type=int, default=4000, help="palms (default: 4000)")
    parser.add_argument("--seed", type=int, default=0)
    options = parser.parse_args()
    mesh = load_mesh(ROOT / "meshes" / "mug.glb", unit="m")
    for name in options.names or NAMES:
        hand = read_hand(options.hands / name / f"{name}.urdf", preset=name)
        grasps = closed(hand, mesh, random_poses(hand, mesh, options.count, options.seed))
        counts = np.bincount(grasps.label, minlength=len(Label))
        print(f"{name}: {grasps.size} of {options.count} palms are free; U, M, S: {counts}")
        shown = grasps.take(np.array(chosen(grasps)))
        path = options.output / f"hand_{name}.png"
        save_as(hand_grasp_figure(shown, draw_hand_grasps(shown)), path)
        print(f"written: {path}")


if __name__ == "__main__":
    main()
