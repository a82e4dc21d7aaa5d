"""Other readings of poses of hands with joints: of the order of joints, frames, sides, sizes."""

import math
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from grasp3d.arrays import Bools, Floats
from grasp3d.grasps.poses import GraspPoses
from grasp3d.grasps.postures import ORDER, wrist_of
from grasp3d.grasps.readings import (
    FITTING,
    Alternative,
    Change,
    PoseReading,
    Trial,
    Tried,
    changed_readings,
    frame_key,
    framed,
    with_frame,
)
from grasp3d.hand.articulated.articulated_hand import BEYOND, ArticulatedHand
from grasp3d.hand.articulated.contacts import CONTACT_DISTANCE
from grasp3d.hand.articulated.hand_scene import HandScene
from grasp3d.hand.frames import GripperFrame
from grasp3d.hand.jaws import AXES, metres_per_unit
from grasp3d.hand.link_tree import Joint, LinkShape
from grasp3d.settings.lengths import METRES

DEEPEST = 0.015
"""Largest depth of a link in the object in poses that fit [m]: published ones have centimetres."""

LEAST_LINKS = 2
"""Links that touch in a pose that fits."""

SIZES = 0.01, 1.0
"""Sizes of objects that a hand holds [m]."""

TURN = 2.0 * math.pi
"""Angle beyond a limit that no angle in radians has."""

MIRRORS = {"x": 0, "y": 1, "z": 2}
"""Axes along which hands of the other side are mirrored."""


class JointTrial(Trial):
    """Readings of poses of hands with joints."""

    hand: ArticulatedHand
    fit = "at least two links touch the object, and none is deeper than 15 mm in it,"

    def alternatives(self, poses: GraspPoses, *, lengths: bool) -> Iterator[Alternative]:
        """See `Trial`."""
        hand, stated = self.hand, poses.gripper_frame
        known = {frame_key(stated.to_tcp(hand), hand)}
        for frame in _frames(stated, hand):
            key = frame_key(frame.to_tcp(hand), hand)
            if key not in known:
                known.add(key)
                yield framed(frame)
        yield from changed_readings(self.mesh, poses, hand, [stated], lengths=lengths)
        for words, change in _orders(hand) if ORDER in poses.settings else ():
            yield Alternative(with_frame(words, stated, poses), stated, posture=change)
        yield _in_degrees(poses, hand)

    def last_alternatives(self, poses: GraspPoses, *, lengths: bool) -> Iterator[Alternative]:
        """See `Trial`."""
        yield from _other_hands(self.hand, poses.gripper_frame)
        if lengths:
            yield from _other_sizes(self, poses)

    def of(self, readings: Sequence[Alternative], poses: GraspPoses) -> list[Tried]:
        """See `Trial`."""
        return [
            tried
            for reading in readings
            for tried in super(JointTrial, self._for(reading)).of([reading], poses)
        ]

    def _for(self, reading: Alternative) -> "JointTrial":
        """A trial with the hand and the object of a reading."""
        mesh = self.mesh if reading.size == 1.0 else self.mesh.scaled(reading.size)
        return replace(self, mesh=mesh, hand=reading.hand or self.hand)

    def fits(self, poses: Floats, posture: Floats) -> tuple[Bools, Floats, Floats]:
        """See `Trial`."""
        metres, distance = metres_per_unit(self.mesh), CONTACT_DISTANCE
        scene, placed = HandScene(self.mesh, self.hand, metres, distance), poses.copy()
        placed[:, :3, 3] *= metres
        frames = scene.frames(placed, self.hand.postures(posture))
        gaps = scene.link_gaps(scene.touch(frames, contacts=False, search=distance))
        touching = (gaps <= distance).sum(axis=1)
        depth = np.maximum(-gaps.min(axis=1), 0.0)
        fits = (touching >= LEAST_LINKS) & (depth <= DEEPEST)
        return fits, touching - depth / DEEPEST, np.full(len(poses), np.nan)


def reading_in_degrees(poses: GraspPoses, hand: ArticulatedHand) -> PoseReading | None:
    """The reading that joints are in degrees, where their limits leave no doubt; None: they do.

    At some pose a joint is more than a turn beyond its limits, at less than half of them all joints
    are within these, and in degrees at four fifths.

    Args:
        poses: The poses, with the joints of the hand.
        hand: The hand.
    """
    best, turning = (
        _in_degrees(poses, hand),
        [one for one in hand.ranges if one.name not in hand.slides],
    )
    excess = [
        np.max([one.excess(posture) for one in turning], axis=0, initial=-TURN)
        for posture in (poses.posture, best.posture(poses.posture))
    ]
    stated, fitting = (int((one <= BEYOND).sum()) for one in excess)
    if excess[0].max() < TURN or 2 * stated >= poses.count or fitting < FITTING * poses.count:
        return None
    return PoseReading(
        words=best.words, best=best, fit="all joints are within their limits", fitting=fitting,
        stated=stated, tried=poses.count, count=poses.count, stated_frame=best.frame, hand=hand,
    )  # fmt: skip


def _in_degrees(poses: GraspPoses, hand: ArticulatedHand) -> Alternative:
    """The reading that angles are in degrees; lengths of joints that slide are what they are."""
    turns, frame = [name not in hand.slides for name in hand.joint_names], poses.gripper_frame

    def change(posture: Floats) -> Floats:
        return np.where(turns, np.radians(posture), posture) if posture.size else posture

    words = with_frame("if their joints are in degrees", frame, poses)
    return Alternative(words, frame, posture=change)


def _frames(stated: GripperFrame, hand: ArticulatedHand) -> Iterator[GripperFrame]:
    """Links that may carry the pose, and the stated frame turned by right angles."""
    path = hand.tree.chain(hand.palm)
    fixed = [
        name for link in path for name in hand.tree.children(link)
        if hand.tree.joints[name].kind == "fixed"
    ]  # fmt: skip
    for link in dict.fromkeys([wrist_of(hand).beyond, *path, *fixed]):
        yield GripperFrame(link=link)
    for approach in AXES:
        for closing in AXES:
            if closing[-1] != approach[-1]:
                yield replace(stated, approach=approach, closing=closing, name="")


def _orders(hand: ArticulatedHand) -> Iterator[tuple[str, Change]]:
    """Orders in which programs have the joints of a hand, and what takes them to the hand's."""
    joints = hand.joint_names
    wrist = wrist_of(hand).joints
    fingers = [sorted(map(joints.index, finger)) for finger in _fingers(hand)]
    first = [joints.index(name) for name in wrist]
    deepest = max(map(len, fingers), default=0)
    orders = {
        "reversed": [*range(len(joints))][::-1],
        "those of each finger reversed": first + [k for one in fingers for k in one[::-1]],
        "that of the fingers reversed": first + [k for one in fingers[::-1] for k in one],
        "the last finger, the thumb, first": first + [
            k for one in (*fingers[-1:], *fingers[:-1]) for k in one
        ],
        "the first finger last": first + [k for one in (*fingers[1:], *fingers[:1]) for k in one],
        "the first joints of all fingers first": first + [
            one[depth] for depth in range(deepest) for one in fingers if depth < len(one)
        ],
        "that of their names": sorted(range(len(joints)), key=joints.__getitem__),
    }  # fmt: skip
    seen = {tuple(range(len(joints)))}
    for words, order in orders.items():
        if tuple(order) not in seen and len(order) == len(joints):
            seen.add(tuple(order))
            yield f"if the order of their joints is another one ({words})", _taken(order)


def _taken(order: Sequence[int]) -> Change:
    """From values in an order of a hand's joints to those in its own."""
    columns = np.argsort(order)
    return lambda posture: posture[:, columns] if posture.size else posture


def _fingers(hand: ArticulatedHand) -> list[list[str]]:
    """Joints of each finger."""
    root = wrist_of(hand).beyond
    found: dict[str, list[str]] = {}
    carrier: dict[str, str] = {}
    for link in hand.tree.branch(root).links[1:]:
        joint = hand.tree.joints[link]
        moves = joint.name in hand.joint_names
        finger = carrier.get(joint.parent, link if moves else "")
        if finger:
            carrier[link] = finger
            found.setdefault(finger, []).extend([joint.name] * moves)
    first = {finger: hand.joint_names.index(names[0]) for finger, names in found.items()}
    return [found[finger] for finger in sorted(found, key=first.__getitem__)]


def _other_hands(hand: ArticulatedHand, stated: GripperFrame) -> Iterator[Alternative]:
    """Hands of the other side: mirrored ones."""
    for axis, number in MIRRORS.items():
        for kept in (True, False):
            turned = "turn about the same axes" if kept else "turn the other way"
            words = f"of a hand of the other side, mirrored along {axis}, whose joints {turned},"
            yield Alternative(words, stated, hand=mirrored(hand, number, axes_kept=kept))


def _other_sizes(trial: JointTrial, poses: GraspPoses) -> Iterator[Alternative]:
    """Objects of other sizes, as their scale or unit may not have been applied."""
    metres = metres_per_unit(trial.mesh)
    of_units = {one / other for one in METRES.values() for other in METRES.values()}
    stated = {poses.object_scale / metres} if poses.object_scale else set()
    for factor in sorted(stated) + sorted(of_units - stated):
        size = trial.mesh.size * metres * factor
        if factor != 1.0 and SIZES[0] <= size <= SIZES[1]:
            why = ", the scale that they state," if factor in stated else ""
            words = f"on the object at {factor:.4g} times its size{why}"
            yield Alternative(words, poses.gripper_frame, size=factor)


def mirrored(hand: ArticulatedHand, axis: int, *, axes_kept: bool) -> ArticulatedHand:
    """The hand of the other side: all its links mirrored along an axis of their frames.

    Args:
        hand: The hand.
        axis: 0, 1 or 2.
        axes_kept: Whether its joints turn about the same axes, as far as mirroring does not move
            them; else they turn so that equal values give mirrored postures.
    """
    mirror = np.eye(4)
    mirror[axis, axis] = -1.0

    def joint_of(joint: Joint) -> Joint:
        turns = joint.kind == "turns"
        direction = mirror[:3, :3] @ joint.axis * (-1.0 if turns else 1.0)
        if axes_kept and turns and direction @ joint.axis < 0.0:
            direction = -direction
        return replace(
            joint,
            origin=mirror @ joint.origin @ mirror,
            axis=direction,
            position=mirror[:3, :3] @ joint.position,
        )

    def shapes(link: str) -> tuple[LinkShape, ...]:
        return tuple(
            replace(
                shape,
                pose=mirror @ shape.pose @ mirror,
                vertices=shape.vertices @ mirror[:3, :3],
                surface=(shape.surface @ mirror[:3, :3])[:, ::-1],
            )
            for shape in hand.tree.shapes(link)
        )

    joints = {link: joint_of(joint) for link, joint in hand.tree.joints.items()}
    return replace(hand, tree=replace(hand.tree, joints=joints, shapes=shapes))
