"""The actuation of a hand with joints in a posture: its motors, and joints at stops."""

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.errors import SettingError
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand
from grasp3d.quality.hand_forces.actuation import Actuation

AT_STOP = 1e-3
"""Distance from its limit [rad or m] at which a joint is at its stop."""


def torques_of(hand: ArticulatedHand, torque_limits: float | None = None) -> Floats:
    """Greatest torque of the motor of each joint [N m or N], (p,).

    It is nan where a joint has no motor.

    Args:
        hand: The hand.
        torque_limits: That of every motor, instead of the stated ones.

    Raises:
        SettingError: A torque is not stated.
    """
    missing = np.array(hand.joint_names)[np.isnan(hand.torques)].tolist()
    if torque_limits is None and missing:
        raise SettingError(
            f"the description of {hand.name} states no torque of the motor of "
            f"{', '.join(missing)}: state it there, or give that of "
            "every motor (--torque-limits, in Python torque_limits=...)"
        )
    torques = np.where(hand.torques == 0.0, np.nan, torque_limits or hand.torques)
    if torque_limits is not None and np.isnan(torques).all():
        raise SettingError(f"{hand.name} has no motor that torque_limits could limit")
    return torques


def actuation_of(
    hand: ArticulatedHand, posture: Floats, torques: Floats, links: Floats | None = None
) -> Actuation:
    """The drives of a hand in a posture.

    Couplings are in the posture: a joint that follows another one has no torque of its own. A joint
    at its limit is also pushed back by the stop there.

    Args:
        hand: The hand.
        posture: Values of its joints (p,).
        torques: Greatest torques of their motors, as `torques_of` has them, shape (p,).
        links: Torques that hold the links per acceleration of gravity, as in `Actuation`; None:
            their weight is neglected.
    """
    lower, upper = hand.limits_of_joints.T
    stops = (posture <= lower + AT_STOP).astype(float) - (posture >= upper - AT_STOP)
    limits = np.where(np.isnan(torques), 0.0, torques)
    return Actuation(limits, names=hand.joint_names, stops=stops, links=links)
