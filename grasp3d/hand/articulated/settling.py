"""Postures changed until links touch: contacts that settle, and a hand that closes."""

from typing import Any, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from grasp3d._kernels.hands.settling import smallest_changes
from grasp3d._kernels.hands.touching import Touches, measure_points
from grasp3d.arrays import Floats, Ints
from grasp3d.hand.articulated.hand_scene import OVERLAPS, HandScene
from grasp3d.hand.articulated.link_bodies import half_widths

ROUNDS = 16
"""Most rounds of settling: half of disturbed Allegro and LEAP grasps end after 8, 96 % after 16."""

SETTLED = 5e-5
"""Gap, or depth, at which a link touches [m]."""

SHIFT = 0.05
"""Motion of the object that counts as much as 1 rad of a joint [m]."""

TOUCH_FORCE, PUSH_FORCE = 10.0, 1e3
"""How much change of joints it may cost to close a gap, or to leave the object [rad^2/m]: 10 turns
a finger of 50 mm by 0.5 rad."""

LARGEST_STEP = 0.15
"""Largest change of a joint in a round [rad]."""

SWEEPS = 100
"""Sweeps over the rows of a linear problem."""

BEYOND = 1.2
"""Largest gap that counts while contacts settle, in contact distances."""

RELEASES = {6: 1e-3, 9: 3e-4, 12: 1e-4}
"""Rounds from which on links that are still so far away need not touch [m]."""

MEMORY = 4
"""Rounds whose nearest points are looked at again: else corners of links take turns."""

STEPS = 1000
"""Most steps of closing."""

LINKS_STEP = 2e-3
"""Step of a joint [rad or m] that is not halved further where links of the hand meet."""

SMALLEST_STEP, LARGEST_CLOSING_STEP = 1e-3, 0.03
"""Bounds of the steps of links while a hand closes, far from the object [m]."""


def settle(
    scene: HandScene, poses: Floats, postures: Floats, *, free: bool
) -> tuple[Floats, Floats]:
    """Make the smallest change with which links near the object touch it and none penetrates.

    Each round solves a linear problem with the gaps and directions at the current posture. A link
    that cannot touch within limits, or not without another one that goes inside, remains away.

    Args:
        scene: Hand and object.
        poses: Hand's frame to that of the mesh [m], shape (k, 4, 4).
        postures: Values of the joints, shape (k, p).
        free: Whether the object moves too.

    Returns:
        Poses and postures after it.
    """
    settling = _Settling(scene, poses, postures, free=free)
    for number in range(ROUNDS + 1):
        touches = settling.look(number)
        if number == ROUNDS or not len(settling.active):
            break
        settling.change(touches)
    return settling.best_poses, settling.best


class _Witnesses(NamedTuple):
    """Points of links with their gaps."""

    pose: Ints
    """(c,)."""
    body: Ints
    """Shape, (c,); -1: of an earlier round."""
    link: Ints
    """(c,)."""
    gap: Floats
    """Signed distance from the object [m], (c,)."""
    along: Floats
    """Direction away from it (c, 3)."""
    at: Floats
    """Where [m], (c, 3)."""


class _Settling:
    """Poses that settle; k in all, of which a are active."""

    def __init__(self, scene: HandScene, poses: Floats, postures: Floats, *, free: bool) -> None:
        count, joints = postures.shape
        self.scene, self.start = scene, postures
        self.poses, self.values = poses.copy(), postures.copy()
        self.best_poses, self.best = poses.copy(), postures.copy()
        self.merits = np.full(count, np.inf)
        self.changes = np.zeros((count, joints + 6))
        self.limits = np.zeros((count, joints + 6, 2))
        self.limits[:, :joints] = scene.hand.limits_of_joints - postures[:, :, None]
        self.limits[:, joints:] += np.array([-np.inf, np.inf]) if free else 0.0
        self.near = np.zeros((count, len(scene.hand.link_names)), dtype=bool)
        self.forces = np.zeros((count, len(scene.bodies.kinds)))
        self.active, self.memory = np.arange(count), list[_Witnesses]()

    def look(self, number: int) -> Touches:
        """Measure gaps, keep what is better than before, and end what has settled."""
        scene, active = self.scene, self.active
        self.link_poses = scene.hand.link_poses(self.values[active])
        self.frames = np.ascontiguousarray(self.poses[active, None, :3] @ self.link_poses)
        touches = scene.touch(self.frames, contacts=False, search=BEYOND * scene.distance)
        gaps = scene.link_gaps(touches)
        if number == 0:
            self.near = gaps <= scene.distance
        if number in RELEASES:
            self.near[active] &= gaps <= RELEASES[number]
        near = self.near[active]
        missed = np.where(near, np.minimum(np.abs(gaps), BEYOND * scene.distance), 0.0)
        depth = np.maximum(-gaps, 0.0).max(axis=1)
        merit = 10.0 * depth + missed.mean(axis=1)
        better = merit < self.merits[active]
        best = active[better]
        self.merits[best] = merit[better]
        self.best_poses[best], self.best[best] = self.poses[best], self.values[best]
        going = np.maximum(missed.max(axis=1), depth) > SETTLED
        self.active = active[going]
        self.least = np.where(near, gaps, -np.inf)[going]
        self.link_poses, self.frames = self.link_poses[going], self.frames[going]
        return Touches(
            touches.gaps[going], touches.points[going], touches.directions[going],
            touches.counts, touches.contacts,
        )  # fmt: skip

    def change(self, touches: Touches) -> None:
        """Take the step that the linear problem proposes."""
        active, before = self.active, self.changes[self.active]
        every = self._witnesses(touches)
        rows = self._rows(every)
        targets = (rows * before[every.pose]).sum(axis=1) - every.gap
        new = every.body >= 0
        pulled = new & (every.gap <= self.least[every.pose, every.link] + SETTLED)
        bounds = np.stack([np.where(pulled, -TOUCH_FORCE, 0.0), np.full(len(new), PUSH_FORCE)], 1)
        first = np.concatenate([[0], np.cumsum(np.bincount(every.pose, minlength=len(active)))])
        after, pose = np.empty_like(before), active[every.pose]
        forces = np.where(new, self.forces[pose, every.body], 0.0)
        smallest_changes(first, rows, targets, bounds, forces, after, self.limits[active], SWEEPS)
        self.forces[pose[new], every.body[new]] = forces[new]
        step = after - before
        largest = np.abs(step).max(axis=1, initial=0.0)
        step *= np.minimum(1.0, LARGEST_STEP / np.maximum(largest, 1e-12))[:, None]
        joints = self.start.shape[1]
        self.changes[active] = before + step
        self.values[active] = self.start[active] + self.changes[active, :joints]
        self.poses[active] = _moved(self.poses[active], step[:, joints:], self.scene.center)

    def _witnesses(self, touches: Touches) -> _Witnesses:
        """The nearest point of each shape, and those of earlier rounds, by ascending pose."""
        pose, body = np.nonzero(np.isfinite(touches.gaps))
        gap, along = touches.gaps[pose, body], touches.directions[pose, body]
        link, at = self.scene.bodies.links[body], touches.points[pose, body] + gap[:, None] * along
        found = _Witnesses(pose, body, link, gap, along, at)
        old = [self._again(one) for one in self.memory]
        frame = self.frames[pose, link]
        local = np.einsum("cji,cj->ci", frame[:, :, :3], at - frame[:, :, 3])
        kept = found._replace(pose=self.active[pose], body=np.full(len(pose), -1), at=local)
        self.memory = [kept, *self.memory][:MEMORY]
        every: list[Any] = [np.concatenate(columns) for columns in zip(found, *old, strict=True)]
        order = np.argsort(every[0], kind="stable")
        return _Witnesses(*(column[order] for column in every))

    def _again(self, kept: _Witnesses) -> _Witnesses:
        """The gaps of points of an earlier round now."""
        place = np.full(len(self.start), -1)
        place[self.active] = np.arange(len(self.active))
        columns: tuple[Any, ...] = kept
        kept = _Witnesses(*(column[place[kept.pose] >= 0] for column in columns))
        pose = place[kept.pose]
        frame = self.frames[pose, kept.link]
        at = np.einsum("cij,cj->ci", frame[:, :, :3], kept.at) + frame[:, :, 3]
        gap, along = np.empty(len(at)), np.empty((len(at), 3))
        measure_points(at, self.scene.surface, gap, along)
        return kept._replace(pose=pose, gap=gap, along=along, at=at)

    def _rows(self, every: _Witnesses) -> Floats:
        """How gaps change with the joints and with the hand's motion, shape (c, p + 6)."""
        poses = self.poses[self.active][every.pose]
        in_hand = np.einsum("cji,cj->ci", poses[:, :3, :3], every.at - poses[:, :3, 3])
        jacobians = self.scene.hand.jacobians(self.link_poses, every.pose, every.link, in_hand)
        along = np.einsum("cji,cj->ci", poses[:, :3, :3], every.along)
        return np.hstack(
            [
                np.einsum("ci,cip->cp", along, jacobians),
                SHIFT * every.along,
                np.cross(every.at - self.scene.center, every.along),
            ]
        )


def _moved(poses: Floats, twists: Floats, center: Floats) -> Floats:
    """Hands moved by small motions about the object's middle."""
    turns = Rotation.from_rotvec(twists[:, 3:]).as_matrix()
    moved = poses.copy()
    moved[:, :3, :3] = turns @ poses[:, :3, :3]
    arms = poses[:, :3, 3] - center
    moved[:, :3, 3] = center + np.einsum("kij,kj->ki", turns, arms) + SHIFT * twists[:, :3]
    return moved


def motion_of_object(before: Floats, after: Floats, center: Floats) -> tuple[Floats, Floats]:
    """How far an object moved, (k,) [m], and turned, (k,) [rad], for hands at rest."""
    motion = before @ np.linalg.inv(after)
    shift = motion[:, :3, :3] @ center + motion[:, :3, 3] - center
    turn = np.asarray(Rotation.from_matrix(motion[:, :3, :3]).magnitude())
    return np.asarray(np.linalg.norm(shift, axis=1)), turn


def close(scene: HandScene, poses: Floats, postures: Floats) -> Floats:
    """Close hands from postures until links touch (conservative advancement).

    A link that touches stops all joints that move it; others go on, of a differential too. Joints
    stop at their limits, and where two links of the hand meet those that move one of both alone.

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
        halted = stopped[active] | ((gaps <= SETTLED)[:, :, None] & moves).any(axis=1)
        pace = np.where(halted, 0.0, np.abs(speeds))
        fastest = pace @ reach.T  # (k, L)
        with np.errstate(divide="ignore", invalid="ignore"):
            time = np.where(fastest > 0.0, np.maximum(gaps - 0.5 * SETTLED, 0.0) / fastest, np.inf)
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
