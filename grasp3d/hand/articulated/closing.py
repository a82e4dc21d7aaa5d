"""Postures at which the links of a hand that closes touch an object."""

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.hand.articulated.hand_scene import OVERLAPS, HandScene
from grasp3d.hand.articulated.link_bodies import half_widths

TOUCHES = 5e-5
"""Gap, or depth, at which a link touches [m]."""

STEPS = 1000
"""Most steps of closing."""

LINKS_STEP = 2e-3
"""Step of a joint [rad or m] that is not halved further where links of the hand meet."""

SMALLEST_STEP, LARGEST_CLOSING_STEP = 1e-3, 0.03
"""Bounds of the steps of links while a hand closes, far from the object [m]."""


def close(scene: HandScene, poses: Floats, postures: Floats) -> Floats:
    """Close hands from postures until links touch (conservative advancement).

    A link that touches stops all joints that move it; others go on. Joints stop
    at their limits, and where two links of the hand meet those that move one of both alone.

    Args:
        scene: Hand and object.
        poses: Hand's frame to that of the mesh [m], shape (k, 4, 4).
        postures: From which they close, shape (k, p).

    Returns:
        Postures, shape (k, p).
    """
    hand = scene.hand
    speeds, limits = hand.closing, hand.limits_of_joints
    reach, most = reaches(scene), _largest_steps(scene)
    moves = reach > 0.0
    values = postures.copy()
    stopped = np.broadcast_to(speeds == 0.0, values.shape).copy()
    active = np.arange(len(poses))
    depths, first = scene.self_collisions(scene.frames(poses, values))
    first[depths <= OVERLAPS] = -1  # else these two may go deeper, on their way out for instance
    deepest, share = np.maximum(depths, OVERLAPS), np.ones(len(poses))
    for _ in range(STEPS):
        going = ~stopped[active].all(axis=1)
        active = active[going]
        if not len(active):
            break
        touches = scene.touch(
            scene.frames(poses[active], values[active]), contacts=False, search=most.max()
        )
        gaps = np.minimum(scene.link_gaps(touches), most)
        halted = stopped[active] | ((gaps <= TOUCHES)[:, :, None] & moves).any(axis=1)
        pace = np.where(halted, 0.0, np.abs(speeds))
        fastest = pace @ reach.T  # (k, L)
        with np.errstate(divide="ignore", invalid="ignore"):
            time = np.where(fastest > 0.0, np.maximum(gaps - 0.5 * TOUCHES, 0.0) / fastest, np.inf)
        steps = np.where(moves, time[:, :, None], np.inf).min(axis=1, initial=np.inf)
        steps = np.minimum(steps, LARGEST_CLOSING_STEP / np.maximum(np.abs(speeds), 1e-12))
        moved = values[active] + np.where(halted, 0.0, share[active, None] * steps * speeds)
        ended = (speeds > 0.0) & (moved >= limits[:, 1]) | (speeds < 0.0) & (moved <= limits[:, 0])
        moved = np.where(halted, values[active], np.clip(moved, limits[:, 0], limits[:, 1]))
        depths, pairs = scene.self_collisions(scene.frames(poses[active], moved))
        apart = (moves[pairs[:, 0]] != moves[pairs[:, 1]]) & ~halted
        known = (pairs == first[active]).all(axis=1)
        meets = (depths > deepest[active]) & ~known & apart.any(axis=1)
        short = np.abs(moved - values[active]).max(axis=1) <= LINKS_STEP
        ended = np.where(meets[:, None], apart & short[:, None], ended)
        values[active] = np.where(meets[:, None], values[active], moved)
        stopped[active] = halted | ended
        halved = np.where(short, 1.0, 0.5 * share[active])
        share[active] = np.where(meets, halved, np.minimum(1.0, 2.0 * share[active]))
    return values


def _largest_steps(scene: HandScene) -> Floats:
    """Steps of links with which no two pass through each other unseen [m], shape (L,).

    Of two alike `self_collisions` sees the way from touching to filling the same place, except its
    ends: both together move by three quarters of that. What is thinner than 3 mm, or than the
    thickest shape of its link, may pass.
    """
    steps = np.zeros(len(scene.hand.link_names))
    np.maximum.at(steps, scene.bodies.links, 0.75 * half_widths(scene.bodies))
    steps[steps == 0.0] = LARGEST_CLOSING_STEP
    return np.clip(steps, SMALLEST_STEP, LARGEST_CLOSING_STEP)


def reaches(scene: HandScene) -> Floats:
    """Largest distance of a link's points from each joint's axis, shape (L, p); 0: not moved."""
    hand, bodies, chain = scene.hand, scene.bodies, scene.hand.chain
    around = np.full(len(hand.link_names), -1.0)
    for body, link in enumerate(bodies.links):
        middle = bodies.poses[body, :, :3] @ bodies.boxes[body, :3] + bodies.poses[body, :, 3]
        around[link] = max(around[link], float(np.linalg.norm(middle)) + bodies.boxes[body, 6])
    reach = np.zeros((len(around), len(hand.joint_names)))
    for link, radius in enumerate(around):
        if radius < 0.0:
            continue
        length, at = radius, link
        while chain.parents[at] >= 0:
            column = chain.columns[at]
            arm = length + float(np.linalg.norm(chain.positions[at]))
            if column >= 0:
                sliding = hand.chain.kinds[at] == 1
                reach[link, column] += abs(chain.factors[at]) * (1.0 if sliding else arm)
            length += float(np.linalg.norm(chain.origins[at][:3, 3]))
            at = int(chain.parents[at])
    return reach
