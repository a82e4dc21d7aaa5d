"""Labels S, M and U of grasps, their colours and meanings, and the thresholds that make them.

A grasp is force-closed exactly when the friction angle exceeds its critical friction angle beta*.
Tilting each normal by up to a = alpha/2 changes the friction angle by at most a: with circular
cones the worst tilt is equivalent to the friction angle beta - a and the best to beta + a. Hence S
iff beta* < beta - a and U iff beta* >= beta + a, for any mu and alpha, where Wan & Howe 2018
(Sec. III) sample extreme normals. No grasp of three fingers or more is labelled U where beta + a
reaches 90 degrees.

The margin of a grasp is the distance of beta* below the threshold of S.
"""

import math
from collections.abc import Iterable
from enum import IntEnum
from typing import Literal, NamedTuple

import numpy as np

from grasp3d.arrays import ArrayLike, Bytes, Floats
from grasp3d.settings import GraspModel


class Label(IntEnum):
    """Reliability of a grasp, in ascending order; the letters are those of Wan & Howe 2018."""

    U = 0
    """Surely unstable; on a labelled surface: no grasp found."""
    M = 1
    """Ambiguous: stable at some normals within the sensor's resolution, unstable at others."""
    S = 2
    """Surely stable: whatever the true normals within the sensor's resolution."""


COLORS: dict[Label, tuple[int, int, int]] = {
    Label.U: (0xD5, 0x5E, 0x00),
    Label.M: (0xF0, 0xE4, 0x42),
    Label.S: (0x00, 0x9E, 0x73),
}
"""Red, green, blue (0-255); colour-blind readers can distinguish them as well."""


def hex_color(color: Iterable[int]) -> str:
    """Red, green and blue (0-255) as #RRGGBB."""
    return "#{:02X}{:02X}{:02X}".format(*color)


GREY = (0x9A, 0xA0, 0xA6)
"""Grey: where no contact may be, and what is not known."""

Mode = Literal["label", "scan"]
"""Whether the grasps on a surface were searched for, or are given, as in a scan."""

_IN_BOTH_MODES = {Label.S: "surely stable", Label.M: "ambiguous"}
MEANING: dict[Mode, dict[Label, str]] = {
    "label": {**_IN_BOTH_MODES, Label.U: "no grasp found"},
    "scan": {**_IN_BOTH_MODES, Label.U: "surely unstable"},
}
"""Meaning of each label in either mode, as shown to users."""


def unstable_from(friction_angle: ArrayLike, tilt: ArrayLike, fingers: int) -> Floats:
    """`GraspModel.unstable_from` for arrays [rad]: beta + alpha/2; inf: no grasp is U.

    From 90 degrees on, grasps of three fingers and more are never surely unstable: such wide cones
    are not convex, and some tilts may be force-closed whatever the critical angle is.

    Args:
        friction_angle: Half-angles beta of the friction cones [rad].
        tilt: Halves of the resolutions alpha [rad]; both are broadcast together.
        fingers: Contacts of a grasp.
    """
    widest = np.asarray(friction_angle, np.float64) + np.asarray(tilt, np.float64)
    return np.where((fingers > 2) & (widest >= math.pi / 2.0), math.inf, widest)


class Thresholds(NamedTuple):
    """Thresholds of grasps whose contacts differ, shape (b,) each."""

    sure_angle: Floats
    """A grasp is S if its critical angle over the worst normals is below this angle [rad]."""
    unstable_from: Floats
    """A grasp is U if its critical angle over the best normals is at least this angle [rad]."""


def label_angles(worst: Floats, best: Floats, model: GraspModel | Thresholds) -> Bytes:
    """Label grasps by their critical friction angles.

    Args:
        worst: Critical angle over the worst normals [rad], any shape; inf for no grasp. An upper
            bound where contact locations are uncertain; see `classification.uncertain_angles`.
        best: Critical angle over the best normals [rad]; equal to `worst` except at creases, and
            where locations are uncertain.
        model: Friction, sensor resolution and number of fingers; or the thresholds.

    Returns:
        Label codes, uint8, same shape.
    """
    labels = np.full(np.shape(worst), Label.M, dtype=np.uint8)
    labels[best >= model.unstable_from] = Label.U
    labels[worst < model.sure_angle] = Label.S
    return labels


def max_resolution(worst: Floats, model: GraspModel) -> Floats:
    """Coarsest sensor resolution below which the grasp is S [rad]: alpha* = 2 (beta - beta*).

    If friction is an interval, its smallest value counts.

    Args:
        worst: Critical angle over the worst normals [rad], any shape; as in `label_angles`.
        model: Friction; its sensor resolution does not matter.

    Returns:
        Same shape; 0 where no sensor is fine enough.
    """
    return np.maximum(0.0, 2.0 * (math.atan(model.friction_interval[0]) - worst))
