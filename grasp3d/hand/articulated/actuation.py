"""The actuation of a hand with joints in a posture: its motors, couplings, and joints at stops."""

import math
from collections.abc import Iterator, Mapping

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.errors import SettingError
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand
from grasp3d.quality.hand_forces.actuation import Actuation

AT_STOP = 1e-3
"""Distance from its limit [rad or m] at which a joint is at its stop."""


def torques_of(hand: ArticulatedHand, torque_limits: float | None = None) -> Floats:
    """Greatest torque of the motor of each joint [N m or N], (p,).

    It is nan where a joint has no motor, or a differential pulls it with that of another one.

    Args:
        hand: The hand.
        torque_limits: That of every motor, instead of the stated ones.

    Raises:
        SettingError: What presses is not computed, or a torque is not stated.
    """
    if hand.tendons:
        raise SettingError(
            f"{hand.name} takes no load: what its tendons and springs press is not computed "
            f"({', '.join(hand.tendons)})"
        )
    pulled = {
        name for one in hand.couplings if one.kind == "differential" for name in one.joints[1:]
    }
    unstated = np.array(hand.joint_names)[np.isnan(hand.torques)].tolist()
    missing = [name for name in unstated if name not in pulled]
    if torque_limits is None and missing:
        raise SettingError(
            f"the description of {hand.name} states no torque of the motor of "
            f"{', '.join(missing)}: state it there, or give torque_limits, that of every motor"
        )
    torques = np.where(hand.torques == 0.0, np.nan, torque_limits or hand.torques)
    if torque_limits is not None and np.isnan(torques).all():
        raise SettingError(f"{hand.name} has no motor that torque_limits could limit")
    return torques


def actuation_of(
    hand: ArticulatedHand, posture: Floats, torques: Floats, links: Floats | None = None
) -> Actuation:
    """The drives of a hand in a posture.

    Differentials have one actuator, whose torque on its first joint is that of its motor; rigid
    couplings are in the posture: a joint that follows another one has no torque of its own. A joint
    at its limit is also pushed back by the stop there.

    Args:
        hand: The hand.
        posture: Values of its joints (p,).
        torques: Greatest torques of their motors, as `torques_of` has them, shape (p,).
        links: Torques that hold the links per acceleration of gravity, as in `Actuation`; None:
            their weight is neglected.

    Raises:
        SettingError: A differential pulls a joint that follows another one.
    """
    count, joints = len(hand.joint_names), {one.name: one for one in hand.ranges}
    drives = list(_drives(hand, torques))
    arms, limits = np.zeros((len(drives), count)), []
    for number, (_, pulled, most) in enumerate(drives):
        for name, arm in pulled.items():
            arms[number, joints[name].column] += arm * joints[name].factor
        size = float(np.abs(arms[number]).max()) or 1.0  # limits are torques, as those of motors
        arms[number] /= size
        limits.append(size * most)
    lower, upper = hand.limits_of_joints.T
    stops = (posture <= lower + AT_STOP).astype(float) - (posture >= upper - AT_STOP)
    names = tuple(name for name, *_ in drives)
    return Actuation(limits, arms=arms, names=names, stops=stops, links=links)


def _drives(
    hand: ArticulatedHand, torques: Floats
) -> Iterator[tuple[str, Mapping[str, float], float]]:
    """Names, moment arms by joints, and largest torques of all that drives joints."""
    names, together = hand.joint_names, set[str]()
    for coupling in hand.couplings:
        if coupling.kind == "differential":
            unknown = [name for name in coupling.joints if name not in names]
            if unknown:
                raise SettingError(
                    f"{hand.name}: a differential pulls {unknown[0]}, which follows another joint"
                )
            ratios = np.array(coupling.ratios) / coupling.ratios[0]
            arms = dict(zip(coupling.joints, ratios.tolist(), strict=True))
            most = float(torques[names.index(coupling.joints[0])])
            yield " and ".join(coupling.joints), arms, most
            together |= set(coupling.joints)
    for name, torque in zip(names, torques.tolist(), strict=True):
        if name not in together and not math.isnan(torque):
            yield name, {name: 1.0}, torque
