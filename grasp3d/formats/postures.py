"""Matching of postures to the joints of a hand by name, never by guessing."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from difflib import get_close_matches
from itertools import product
from typing import Any

import numpy as np

from grasp3d.errors import ContactError
from grasp3d.formats.poses import GraspPoses
from grasp3d.hand.articulated_hand import ArticulatedHand
from grasp3d.hand.hand import Hand
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.system.names import printable

MOST_LISTED = 8
"""Largest number of joints that an error message lists."""

PARALLEL = 0.98
"""Cosine from which two axes of joints count as the same."""

LOOSE = 0.02
"""Largest deviation of a joint that follows another one from the value implied [rad or m]."""

ORDER = "joint_order"
"""Setting that states the assumed order of joints, for files that do not name them."""

_X, _Y, _SLANTED = (1.0, 0.0, 0.0), (0.0, 1.0, 0.0), 0.5**0.5
SHADOW = {
    **{f"{finger}J{k}": _X for finger in ("FF", "MF", "RF", "LF") for k in range(3)},
    **{f"{finger}J3": _Y for finger in ("FF", "MF", "RF", "LF")},
    "LFJ4": (0.571, 0.0, 0.821),
    "THJ0": _Y, "THJ1": _Y,
    "THJ2": (_SLANTED, 0.0, -_SLANTED), "THJ3": (_SLANTED, 0.0, -_SLANTED),
    "THJ4": (-_SLANTED, 0.0, -_SLANTED),
}  # fmt: skip
"""Joint axes of the Shadow hand in the MuJoCo model that numbers joints from 0 (robot0:FFJ3 and so
on), in the palm's frame with all joints at 0. Descriptions for ROS number joints from 1, and some
of their axes are opposite."""

_MODEL = re.compile(r"robot0:([FMRLT][FH]J\d)")


@dataclass(frozen=True)
class Wrist:
    """Joints between a hand's base and its palm."""

    joints: tuple[str, ...]
    """Names of those that postures contain."""
    before: str
    """The link that carries the last of these joints; the base if there are none."""
    beyond: str
    """The link that the last of these joints moves; the base if there are none."""


def wrist_of(hand: ArticulatedHand) -> Wrist:
    """The joints between the base and the palm of a hand."""
    tree = hand.tree
    *path, base = tree.chain(hand.palm)
    moved = [link for link in path if tree.joints[link].name in hand.joint_names]
    names = tuple(tree.joints[link].name for link in reversed(moved))
    if not moved:
        return Wrist((), base, base)
    return Wrist(names, tree.joints[moved[0]].parent, moved[0])


def matched(poses: GraspPoses, hand: ArticulatedHand, *, wrist: Sequence[str] = ()) -> GraspPoses:
    """Match postures to the joints of a hand, and put them in its order.

    Joints are matched by name; all names may begin with a name of the robot, such as rh_. Those of
    the Shadow hand in DexGraspNet (robot0:FFJ3) match those of descriptions for ROS (FFJ4), with
    the signs of its axes. Values of following joints must agree with the joints that they follow.
    If the file does not name joints, it must have as many as the hand, with or without `wrist`, and
    the hand's order is assumed: the setting `joint_order` says so.

    Args:
        poses: Poses with postures.
        hand: The hand.
        wrist: Joints of the hand that the poses may lack; they are then at 0.

    Raises:
        ContactError: There are no postures, their number of joints is wrong, or joints are missing,
            unknown or contradict the joint that they follow.
    """
    names, count = poses.joint_names, poses.posture.shape[1]
    if not count:
        plain = [name for name in poses.columns if name in hand.joint_names]
        meant = f"tables have them in columns called joint:{hand.joint_names[0]}"
        if plain:
            meant = f"rename the column '{plain[0]}' to 'joint:{plain[0]}'"
        said = f"{hand.name} is a hand with joints, but the poses have no values of them"
        raise _refused(f"{said}: {meant}, and so on")
    if names == hand.joint_names:
        return poses if poses.hand is hand else replace(poses, hand=hand)
    settings = dict(poses.settings)
    if names:
        found = _named(names, hand, wrist)
        _check_followers(poses, found, hand)
    else:
        own = hand.joint_names
        joints = own if count == len(own) else [name for name in own if name not in wrist]
        if count != len(joints):
            said = f"the postures have {count} values without names"
            raise _refused(f"{said}, but {hand.name} has {len(own)} joints: {_listed(own)}")
        found = {name: (k, 1.0) for k, name in enumerate(joints)}
        settings[ORDER] = f"not stated: that of {hand.name} is assumed"
    columns = [found.get(name, (-1, 0.0)) for name in hand.joint_names]
    at, signs = (np.array(values) for values in zip(*columns, strict=True))
    staged = poses.of_stages("posture")
    postures: dict[str, Any] = {name: one[:, at] * signs for name, one in staged.items()}
    known = hand.joint_names if names else ()
    return replace(poses, hand=hand, joint_names=known, settings=settings, **postures)


def as_in_model(poses: GraspPoses, hand: ArticulatedHand) -> tuple[tuple[str, ...], GraspPoses]:
    """Convert joint names, poses and postures to those of DexGraspNet's model of the Shadow hand.

    Args:
        poses: Poses of the base in metres, with postures of the hand.
        hand: The hand; if it is no Shadow hand, nothing is changed.

    Returns:
        The names of the joints, and poses of the palm with postures of these joints.
    """
    found = {} if any(map(_MODEL.fullmatch, hand.joint_names)) else _of_shadow(hand)
    if len(found) < len(SHADOW):
        return hand.joint_names, poses
    columns = [hand.joint_names.index(joint) for joint, _ in found.values()]
    signs = np.array([sign for _, sign in found.values()])
    palm = hand.link_names.index(wrist_of(hand).beyond)
    palms = hand.link_poses(poses.posture)[:, palm]
    return tuple(found), GraspPoses(
        poses=poses.poses @ palms, posture=poses.posture[:, columns] * signs, unit=poses.unit
    )


Columns = Mapping[str, tuple[int, float]]
"""Column of each joint of a hand that is in a file, and the sign of its axis."""


def _named(names: tuple[str, ...], hand: ArticulatedHand, wrist: Sequence[str]) -> Columns:
    """Find the columns of a hand's joints by their names in a file. Raises ContactError."""
    followers = tuple(joint.name for joint in hand.tree.joints.values() if joint.follows)
    known = (*hand.joint_names, *followers)
    own = {name: (name, 1.0) for name in known}
    if not {*names} & own.keys():
        if any(map(_MODEL.fullmatch, names)):  # numbered otherwise: test before names are cut
            own = _of_shadow(hand)
        else:
            pairs = product((_short(names), names), (known, _short(known)))
            same = ((given, keys) for given, keys in pairs if {*given} & {*keys})
            names, keys = next(same, (names, known))
            own = {key: (joint, 1.0) for key, joint in zip(keys, known, strict=True)}
    columns = {name: k for k, name in enumerate(names)}
    found = {own[name][0]: (k, own[name][1]) for name, k in columns.items() if name in own}
    surplus = [name for name in names if name not in own]
    missing = [name for name in hand.joint_names if name not in found and name not in wrist]
    if surplus or missing:
        raise _refused(_difference(surplus, missing, hand.name))
    return found


def _check_followers(poses: GraspPoses, found: Columns, hand: ArticulatedHand) -> None:
    """Refuse values of joints that contradict the joint that they follow. Raises ContactError."""
    for joint in hand.tree.joints.values():
        if joint.follows is None or joint.name not in found:
            continue
        source, factor, offset = hand.tree.source_of(joint)
        (own, _), (at, sign) = found[joint.name], found.get(source, (-1, 0.0))
        for name, posture in poses.of_stages("posture").items():
            follows = factor * sign * posture[:, at] + offset
            if len(wrong := np.flatnonzero(np.abs(posture[:, own] - follows) > LOOSE)):
                value, says = posture[wrong[0], own], follows[wrong[0]]
                raise _refused(
                    f"grasp {wrong[0] + 1}: joint {joint.name} of its {name} is at {value:.4g}, "
                    f"but it follows {source}, which says {says:.4g}; so in {len(wrong)} of "
                    f"{poses.count} grasps: give their hand, or leave {joint.name} out"
                )


def refuse_joints(poses: GraspPoses, hand: Hand | None) -> None:
    """Refuse postures if the hand is a gripper of two jaws. Raises ContactError."""
    joints = poses.posture.shape[1]
    if joints and isinstance(hand, ParallelGripper):
        named = f" ({_listed(poses.joint_names)})" if poses.joint_names else ""
        said = f"the poses have values of {joints} joints{named}, but {hand.name} is a gripper"
        raise _refused(f"{said} of two jaws, which has none: give the hand that they are of")


def _short(names: Sequence[str]) -> tuple[str, ...]:
    """Strip a name of the robot, such as rh_, with which all names begin."""
    starts = {re.match(r"(?:[A-Za-z0-9]+[_:/])?", name).group() for name in names}  # type: ignore[union-attr]
    (start, *others) = starts
    return tuple(names) if others else tuple(name.removeprefix(start) for name in names)


def _of_shadow(hand: ArticulatedHand) -> dict[str, tuple[str, float]]:
    """Joints of a Shadow hand by their names in MuJoCo's model, with the signs of their axes."""
    names = hand.link_names
    (links,) = hand.link_poses(np.zeros((1, len(hand.joint_names))))
    to_palm = links[names.index(wrist_of(hand).beyond), :3, :3].T
    found: dict[str, tuple[str, float]] = {}
    short = dict(zip(hand.joint_names, _short(hand.joint_names), strict=True))
    for link, joint in hand.tree.joints.items():
        name = short.get(joint.name, "")
        model = f"{name[:-1]}{int(name[-1]) - 1}" if re.fullmatch(r"[A-Z]{2}J[1-5]", name) else ""
        if model in SHADOW:
            axis = to_palm @ links[names.index(link), :3, :3] @ joint.axis
            cosine = float(axis @ SHADOW[model])
            if abs(cosine) < PARALLEL:
                raise _refused(
                    f"joint {joint.name} of {hand.name} does not turn about the axis that "
                    f"robot0:{model} has in DexGraspNet: give a description of the Shadow hand"
                )
            found[f"robot0:{model}"] = (joint.name, float(np.sign(cosine)))
    return found


def _difference(surplus: Sequence[str], missing: Sequence[str], hand: str) -> str:
    """A sentence on joints that are unknown or missing."""
    are, is_ = ("is no joint" if len(surplus) == 1 else "are no joints",
                "is" if len(missing) == 1 else "are")  # fmt: skip
    parts = [f"{_listed(surplus)} {are} of {hand}"] * bool(surplus)
    parts += [f"{_listed(missing)} of {hand} {is_} missing"] * bool(missing)
    close = [f"{one} for {like}" for one in surplus for like in get_close_matches(one, missing, 1)]
    hint = f" (misspelt: {', '.join(close[:MOST_LISTED])}?)" if close else ""
    return f"joints of the postures: {', and '.join(parts)}{hint}"


def _refused(text: str) -> ContactError:
    """Make the error for postures; names of joints in its text may need escapes."""
    return ContactError(printable(text))


def _listed(names: Sequence[str]) -> str:
    more = f" and {len(names) - MOST_LISTED} more" if len(names) > MOST_LISTED else ""
    return ", ".join(names[:MOST_LISTED]) + more
