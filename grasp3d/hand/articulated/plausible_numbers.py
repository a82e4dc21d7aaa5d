"""Numbers of hands with joints that no hand has: mostly stated in other units than they must be."""

import math
from collections.abc import Iterator, Mapping

import numpy as np

from grasp3d.hand.articulated.articulated_hand import ArticulatedHand

TORQUE_OF_FINGER, TORQUE_ELSEWHERE = 5.0, 100.0
"""Torques from which on a finger's motor, or another one, is not believed [N m]; forces [N] are
believed up to 100 times that."""

COARSEST = 1.0
"""Sensor resolution from which on it is not believed [rad]."""

LARGEST_MESH = 2.0
"""Size of a link's mesh from which on it is not believed [m]."""

TURN = 2.0 * math.pi + 0.01
"""Limit of a joint that turns beyond which it is not believed [rad]."""

NO_TRAVEL = 1e-6
"""Travel of a joint that is none [rad or m]."""

LISTED = 4
"""Most joints that a sentence names."""


def largest_torque(hand: ArticulatedHand, joint: str) -> float:
    """Torque, or force, from which on that of a joint is not believed [N m or N]."""
    beyond = {hand.tree.joints[link].name for link in hand.beyond_palm}
    most = TORQUE_OF_FINGER if joint in beyond else TORQUE_ELSEWHERE
    return most * (100.0 if joint in hand.slides else 1.0)


def implausible(hand: ArticulatedHand) -> Iterator[str]:
    """What is known of a hand, but hardly true, one sentence each."""
    yield from _contradictions(hand)
    for name, shapes in zip(hand.link_names, hand.shapes, strict=True):
        meshes = [one.vertices for one in shapes if one.kind == "mesh"]
        size = max((float(np.ptp(one, axis=0).max()) for one in meshes), default=0.0)
        if size > LARGEST_MESH:
            yield f"the mesh of {name} is {size:.3g} m long: is it in mm (scale 0.001)?"
    yield from too_strong(hand, "torques", dict(zip(hand.joint_names, hand.torques, strict=True)))
    for shape, posture in hand.preshapes.items():
        for name, value in zip(hand.joint_names, posture.tolist(), strict=True):
            if abs(value) > 2.0 * math.pi and name not in hand.slides:
                yield (
                    f"preshape {shape}: {name} is at {value:g} rad, more than a turn: {value:g}° "
                    f"are {math.radians(value):.3g} rad"
                )
    for name, alpha in hand.sensors.items():
        if alpha >= COARSEST:
            yield (
                f"sensors: the resolution of {name} is {math.degrees(alpha):.0f}°: it is stated in "
                f"radians, and {alpha:g}° are {math.radians(alpha):.3g}"
            )


def _contradictions(hand: ArticulatedHand) -> Iterator[str]:
    """Limits of joints that are hardly true."""
    beyond: dict[tuple[float, float], list[str]] = {}
    for one in hand.ranges:
        low, high = one.limits
        if one.name not in hand.slides and TURN < max(-low, high) < math.inf:
            beyond.setdefault(one.limits, []).append(one.name)
        driver = hand.ranges[one.column]
        if one is not driver and one.factor:
            ends = sorted((end - one.offset) / one.factor for end in one.limits)
            left = min(ends[1], driver.limits[1]) - max(ends[0], driver.limits[0])
            if left <= NO_TRAVEL < driver.limits[1] - driver.limits[0]:
                yield (
                    f"{one.name} follows {driver.name} times {one.factor:g}, and its limits, from "
                    f"{low:g} to {high:g}, leave {driver.name} no "
                    f"{'value' if left < 0.0 else 'travel'}: has the multiplier the wrong sign?"
                )
    for (low, high), names in beyond.items():
        yield (
            f"limits from {low:g} to {high:g} rad of {_listed(names)} are more than a turn: are "
            f"they in degrees? {high:g}° are {math.radians(high):.3g} rad"
        )


def _listed(names: list[str]) -> str:
    return f"{', '.join(names[:LISTED])}{' ...' if len(names) > LISTED else ''}"


def too_strong(hand: ArticulatedHand, what: str, torques: Mapping[str, float]) -> Iterator[str]:
    """A sentence for each torque that is not believed.

    Args:
        hand: The hand.
        what: What has them.
        torques: Torques, or forces, of joints by their names [N m or N].
    """
    joints: dict[tuple[float, float, bool], list[str]] = {}
    for name, torque in torques.items():
        most = largest_torque(hand, name)
        if torque >= most:
            joints.setdefault((float(torque), most, name in hand.slides), []).append(name)
    for (torque, most, slides), names in joints.items():
        unit, small = ("N", "mN") if slides else ("N m", "N mm")
        yield (
            f"{what}: {torque:g} {unit} at {_listed(names)} is more than is "
            f"believed there, from {most:g} {unit} on: is it in {small}, and {torque / 1e3:g} "
            f"{unit} meant?"
        )
