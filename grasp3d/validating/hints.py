"""Likely causes of a disagreement between a label and an outcome, as plain sentences."""

import math
from collections.abc import Mapping

from grasp3d.hand.closed_jaws import MEANING as CLOSINGS
from grasp3d.hand.closed_jaws import Closing
from grasp3d.hand.parallel_gripper import ParallelGripper
from grasp3d.settings import GraspModel

SMALL_AREA = 0.05
"""Fraction of a pad's area below which a contact is small: its patch resists no rolling."""

FAR_ARM = 0.25
"""Distance of the centre of mass from the line of the contacts, in object sizes, that is far."""

TIGHT = 0.003
"""Clearance of each finger below which small errors of the pose push the object [m]."""

ROLLS = "small contact ({area}): the object can roll about it, which two points do not show"
EDGE = "small contact ({area}): an edge or corner, whose mean normal says little"
ARM = "the centre of mass is {arm} off the line of the contacts: the weight twists the object"
FORCE = "the load needs {needed} of each finger, and {available} are at hand"
CLEARANCE = (
    "the open gripper leaves {clearance} on each side: a small error of its pose pushes the object"
)
REACH = "the gripper collides, or the jaws are outside their stroke: it may not have been reached"
RESOLUTION = (
    "M, not U: at the perceived normals friction {friction} is enough; the sensor resolution takes "
    "up the margin"
)
FRICTION = "force-closed from a friction of {needed} on: the true one may be above {friction}"
CLOSING = "{closing}: pose, gripper or mesh differ from those of the attempt, or the object moved"
NONE = "no cause is visible in its numbers: dynamics, deformation, or a mesh that differs"


def failed_hints(
    scores: Mapping[str, float], hand: ParallelGripper, size: float, available: float | None
) -> tuple[str, ...]:
    """Why a grasp with a large margin may have failed.

    Args:
        scores: Its scores by name.
        hand: The gripper.
        size: Size of the object [m].
        available: Force at hand of each finger [N]; None: not known.
    """
    hints = []
    if is_small(scores["contact_area"], hand):
        hints.append(ROLLS.format(area=_area(scores["contact_area"])))
    if scores["center_of_mass_distance"] > FAR_ARM * size:
        arm = f"{1e3 * scores['center_of_mass_distance']:.3g} mm"
        hints.append(ARM.format(arm=arm))
    clearance = 0.5 * (hand.max_opening - scores["opening"])
    if clearance < TIGHT:
        hints.append(CLEARANCE.format(clearance=f"{1e3 * max(clearance, 0.0):.2g} mm"))
    needed = scores.get("grip_force", math.nan)
    if available is not None and needed > available:
        text = "no finite force" if math.isinf(needed) else f"{needed:.3g} N"
        hints.append(FORCE.format(needed=text, available=f"{available:.3g} N"))
    if not scores["reachable"]:
        hints.append(REACH)
    return tuple(hints) or (NONE,)


def held_hints(
    scores: Mapping[str, float], hand: ParallelGripper, model: GraspModel, state: Closing
) -> tuple[str, ...]:
    """Why a grasp with a small margin, or whose jaws do not close, may have held.

    Args:
        scores: Its scores by name.
        hand: The gripper.
        model: Friction and sensor resolution of the labels.
        state: What the jaws do.
    """
    if state != Closing.CLOSED:
        return (CLOSING.format(closing=CLOSINGS[state]),)
    hints = []
    if is_small(scores["contact_area"], hand):
        hints.append(EDGE.format(area=_area(scores["contact_area"])))
    angle, friction = scores["critical_angle"], f"{model.friction:.3g}"
    if angle < model.friction_angle:
        hints.append(RESOLUTION.format(friction=friction))
    elif angle < math.pi / 2.0:
        hints.append(FRICTION.format(needed=f"{math.tan(angle):.3g}", friction=friction))
    return tuple(hints) or (NONE,)


def is_small(area: float, hand: ParallelGripper) -> bool:
    """Whether a contact is small for the gripper.

    For a pad, or for the cap of a round tip that its compliance presses in.

    Args:
        area: The smaller touched patch [m^2].
        hand: The gripper.
    """
    if hand.round_tips:
        whole = 2.0 * math.pi * hand.tip_radius * hand.compliance
    else:
        whole = hand.pad_width * hand.pad_height
    return area < SMALL_AREA * whole


def _area(area: float) -> str:
    return f"{1e6 * area:.2g} mm²"
