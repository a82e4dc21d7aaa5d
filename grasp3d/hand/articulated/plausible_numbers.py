"""Numbers of hands with joints that no hand has: mostly stated in other units than they must be."""

import math
from collections.abc import Iterator, Mapping

from grasp3d.hand.articulated.articulated_hand import ArticulatedHand

TORQUE_OF_FINGER, TORQUE_ELSEWHERE = 5.0, 100.0
"""Torques from which on a finger's motor, or another one, is not believed [N m]; forces [N] are
believed up to 100 times that."""

BRAKE = 10.0
"""How much more than a motor a brake may hold."""

MASS_OF_FINGER, MASS_ELSEWHERE, FARTHEST = 2.0, 20.0, 1.0
"""Masses of links [kg], and distances of their centres [m], from which on they are not believed."""

COARSEST = 1.0
"""Sensor resolution from which on it is not believed [rad]."""

LISTED = 4
"""Most joints that a sentence names."""


def largest_torque(hand: ArticulatedHand, joint: str) -> float:
    """Torque, or force, from which on that of a joint is not believed [N m or N]."""
    beyond = {hand.tree.joints[link].name for link in hand.beyond_palm}
    most = TORQUE_OF_FINGER if joint in beyond else TORQUE_ELSEWHERE
    return most * (100.0 if joint in hand.slides else 1.0)


def implausible(hand: ArticulatedHand) -> Iterator[str]:
    """What is known of a hand, but hardly true, one sentence each."""
    yield from too_strong(hand, "torques", dict(zip(hand.joint_names, hand.torques, strict=True)))
    held = {name: torque for name, torque in hand.brakes.items() if math.isfinite(torque)}
    yield from too_strong(hand, "brakes", held)
    for tendon in hand.tendons:
        pulls = {name: abs(arm) * tendon.tension[1] for name, arm in tendon.arms.items()}
        asked = "are arms in m, and tensions in N?"
        yield from too_strong(hand, f"tendons: {tendon.name}", pulls, asked)
    yield from _of_springs(hand)
    for name in hand.beyond_base:
        if (one := hand.masses.get(name)) is not None:
            most = MASS_OF_FINGER if name in hand.beyond_palm else MASS_ELSEWHERE
            if one.mass >= most or math.hypot(*one.center) >= FARTHEST:
                x, y, z = one.center
                yield (
                    f"masses: {one.mass:g} kg at ({x:g}, {y:g}, {z:g}) m in {name} is hardly a "
                    "link of a hand: is its mass in kg, and its center in m?"
                )
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


def too_strong(
    hand: ArticulatedHand, what: str, torques: Mapping[str, float], units: str = ""
) -> Iterator[str]:
    """A sentence for each torque that is not believed.

    Args:
        hand: The hand.
        what: What has them.
        torques: Torques, or forces, of joints by their names [N m or N].
        units: The question how they are stated; empty: about torques.
    """
    joints: dict[tuple[float, float, bool], list[str]] = {}
    for name, torque in torques.items():
        most = largest_torque(hand, name) * (BRAKE if what == "brakes" else 1.0)
        if torque >= most:
            joints.setdefault((float(torque), most, name in hand.slides), []).append(name)
    for (torque, most, slides), names in joints.items():
        unit, small = ("N", "mN") if slides else ("N m", "N mm")
        asked = units or f"is it in {small}, and {torque / 1e3:g} {unit} meant?"
        more = " ..." if len(names) > LISTED else ""
        yield (
            f"{what}: {torque:g} {unit} at {', '.join(names[:LISTED])}{more} is more than is "
            f"believed there, from {most:g} {unit} on: {asked}"
        )


def _of_springs(hand: ArticulatedHand) -> Iterator[str]:
    """The same of springs, which press most at a limit of their joint."""
    ranges = {one.name: one.limits for one in hand.ranges}
    for name, spring in hand.springs.items():
        ends = [min(max(end, -math.pi), math.pi) for end in ranges[name]]
        far = not ends[0] - math.pi <= spring.rest <= ends[1] + math.pi
        units = ("N/m", "m", "N") if name in hand.slides else ("N m/rad", "rad", "N m")
        asked = "are stiffness in {}, rest in {} and torque in {}?".format(*units)
        if far and spring.stiffness:
            yield f"springs: {name} is at rest at {spring.rest:g}, far beyond its limits: {asked}"
        else:
            most = max(abs(spring.at(end)) for end in ends)
            yield from too_strong(hand, "springs", {name: most}, asked)
