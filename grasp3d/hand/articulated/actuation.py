"""The actuation of a hand with joints in a posture: its motors, couplings, and joints at stops."""

import math

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.errors import SettingError
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand
from grasp3d.quality.hand_forces.actuation import Actuation

AT_STOP = 1e-3
"""Distance from its limit [rad or m] at which a joint is at its stop."""


def unstated_torques(hand: ArticulatedHand) -> list[str]:
    """Joints with a motor of their own whose greatest torque is not stated."""
    pulled = {
        name for one in hand.couplings if one.kind == "differential" for name in one.joints[1:]
    }
    torques = zip(hand.joint_names, hand.torques.tolist(), strict=True)
    return [name for name, torque in torques if math.isnan(torque) and name not in pulled]


def torques_of(
    hand: ArticulatedHand, torque_limit: float | None = None, unstated: float | None = None
) -> Floats | None:
    """Greatest torque of the motor of each joint [N m or N], (p,); None: one is not stated.

    It is nan where a joint has no motor, or a differential pulls it with that of another one.

    Args:
        hand: The hand.
        torque_limit: That of every motor, instead of the stated ones.
        unstated: That of those motors whose torque is not stated.
    """
    missing = np.isin(hand.joint_names, unstated_torques(hand))
    if torque_limit is None and unstated is None and missing.any():
        return None
    torques = np.where(hand.torques == 0.0, np.nan, torque_limit or hand.torques)
    return np.where(missing, unstated or torques, torques)


def actuation_of(hand: ArticulatedHand, posture: Floats, torques: Floats) -> Actuation:
    """The drives of a hand in a posture, whose own weight is neglected.

    Differentials have one actuator, whose torque on its first joint is that of its motor; rigid
    couplings are in the posture: a joint that follows another one has no torque of its own. A joint
    at its limit is also pushed back by the stop there.

    Args:
        hand: The hand.
        posture: Values of its joints (p,).
        torques: Greatest torques of their motors, as `torques_of` has them, shape (p,).

    Raises:
        SettingError: A differential pulls a joint that follows another one.
    """
    names = hand.joint_names
    arms, limits, actuators = [], [], []
    together: set[str] = set()
    for coupling in hand.couplings:
        if coupling.kind == "differential":
            unknown = [name for name in coupling.joints if name not in names]
            if unknown:
                raise SettingError(
                    f"{hand.name}: a differential pulls {unknown[0]}, which follows another joint"
                )
            row = np.zeros(len(names))
            columns = [names.index(name) for name in coupling.joints]
            row[columns] = np.array(coupling.ratios) / coupling.ratios[0]
            arms.append(row)
            limits.append(torques[columns[0]])
            actuators.append(" and ".join(coupling.joints))
            together |= set(coupling.joints)
    for column, name in enumerate(names):
        if name not in together and not math.isnan(torques[column]):
            arms.append(np.eye(len(names))[column])
            limits.append(torques[column])
            actuators.append(name)
    lower, upper = hand.limits_of_joints.T
    stops = (posture <= lower + AT_STOP).astype(float) - (posture >= upper - AT_STOP)
    return Actuation.of_hand(
        np.array(limits), joints=names, arms=np.reshape(arms, (-1, len(names))),
        names=tuple(actuators), stops=stops,
    )  # fmt: skip
