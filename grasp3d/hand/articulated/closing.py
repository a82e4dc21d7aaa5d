"""Postures at which the links of a hand that closes touch an object."""

import numpy as np

from grasp3d._kernels.hands.closing import Closing, ClosingScratch, make_closing_scratch
from grasp3d._kernels.hands.closing import close as close_hands
from grasp3d._kernels.hands.touching import TouchScratch, make_touch_scratch
from grasp3d.arrays import Floats
from grasp3d.hand.articulated.hand_scene import CHUNK, HandScene
from grasp3d.system.context import in_threads

SMALLEST_STEP, LARGEST_STEP = 1e-3, 0.03
"""Bounds of the steps of links that may meet [m]."""


def close(scene: HandScene, poses: Floats, postures: Floats) -> Floats:
    """Close hands from postures until links touch (conservative advancement).

    All joints move at their speeds, together. A link that touches stops all joints that move it;
    others go on. Joints stop at their limits, and where two links of the hand meet those that move
    one of both alone.

    Args:
        scene: Hand and object.
        poses: Hand's frame to that of the mesh [m], shape (k, 4, 4).
        postures: From which they close, shape (k, p).

    Returns:
        Postures, shape (k, p).
    """
    hand, bodies, values = scene.hand, scene.bodies, postures.copy()
    speeds, limits, reach = hand.closing, hand.limits_of_joints, reaches(scene)
    moves = (reach > 0.0) & (speeds != 0.0)
    apart = scene.may_overlap[np.ix_(bodies.links, bodies.links)] == 0
    pairs = np.argwhere(np.triu(apart & (moves[:, None] != moves).any(axis=2))).copy(order="C")
    closing = Closing(speeds.copy(), limits.copy(), reach, _largest_steps(scene), pairs)
    matrices = np.array(poses, order="C")  # kernels are compiled for arrays that can be written to

    def run(rows: slice, scratch: tuple[ClosingScratch, TouchScratch]) -> None:
        close_hands(
            matrices, values, rows.start, rows.stop, closing, hand.chain, bodies, scene.surface,
            *scratch,
        )  # fmt: skip

    links = len(hand.link_names)

    def make_scratch() -> tuple[ClosingScratch, TouchScratch]:
        return make_closing_scratch(closing, links), make_touch_scratch(bodies)

    in_threads(run, len(poses), CHUNK, make_scratch)
    return values


def _largest_steps(scene: HandScene) -> Floats:
    """Steps of shapes with which no links pass through each other unseen [m], shape (m,).

    Of two alike `self_collisions` sees the way from touching to filling the same place, except its
    ends: both together move by three quarters of that. What is thinner than 3 mm, or than the
    thickest shape of its link, may pass.
    """
    steps = np.zeros(len(scene.hand.link_names))
    np.maximum.at(steps, scene.bodies.links, 0.75 * scene.hand.half_widths)
    return np.clip(steps[scene.bodies.links], SMALLEST_STEP, LARGEST_STEP)


def reaches(scene: HandScene) -> Floats:
    """Largest distance of a shape's points from each joint's axis, shape (m, p); 0: not moved."""
    hand, bodies, chain = scene.hand, scene.bodies, scene.hand.chain
    reach = np.zeros((len(bodies.links), len(hand.joint_names)))
    for body, link in enumerate(bodies.links):
        middle = bodies.poses[body, :, :3] @ bodies.boxes[body, :3] + bodies.poses[body, :, 3]
        length, at = float(np.linalg.norm(middle)) + bodies.boxes[body, 6], int(link)
        while chain.parents[at] >= 0:
            column = chain.columns[at]
            arm = length + float(np.linalg.norm(chain.positions[at]))
            if column >= 0:
                sliding = hand.chain.kinds[at] == 1
                reach[body, column] += abs(chain.factors[at]) * (1.0 if sliding else arm)
            length += float(np.linalg.norm(chain.origins[at][:3, 3]))
            at = int(chain.parents[at])
    return reach
