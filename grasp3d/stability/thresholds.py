"""S, M or U: the thresholds on a grasp's critical friction angle.

A grasp is in force closure exactly when the friction angle exceeds its critical friction angle
beta*. Tilting each normal anywhere within a = alpha/2 can take away, or give, at most a: with
circular cones the worst tilt acts like the friction angle beta - a and the best like beta + a.
Hence S iff beta* < beta - a and U iff beta* >= beta + a, for every mu and alpha at once, where
Wan & Howe 2018 (Sec. III) sample extreme normals. Of three fingers and more none is called U where
beta + a reaches 90 degrees.
"""

import math

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Bytes, Floats
from grasp3d.settings import GraspModel
from grasp3d.stability.label import Label


def unstable_from(friction_angle: npt.ArrayLike, tilt: npt.ArrayLike, fingers: int) -> Floats:
    """Critical friction angle from which a grasp is U [rad]: beta + alpha/2; inf: none is.

    From 90 degrees on, three fingers and more are never surely unstable: such wide cones are not
    convex, and tilts that close may exist whatever the critical angle is.

    Args:
        friction_angle: Half-angles beta of the friction cones [rad].
        tilt: Halves of the resolutions alpha [rad]; both are broadcast together.
        fingers: Contacts of a grasp.
    """
    reach = np.asarray(friction_angle, np.float64) + np.asarray(tilt, np.float64)
    return np.where((fingers > 2) & (reach >= math.pi / 2.0), math.inf, reach)


def label_angles(worst: Floats, best: Floats, model: GraspModel) -> Bytes:
    """Label grasps by their critical friction angles.

    Args:
        worst: Critical angle over the normals that hurt most [rad], any shape; inf for no grasp.
        best: Critical angle over the normals that help most [rad]; equal to `worst` except at
            creases.
        model: Friction, sensor resolution and number of fingers.

    Returns:
        Label codes, uint8, same shape.
    """
    beta, tilt = model.friction_angle, model.tilt
    labels = np.full(np.shape(worst), Label.M, dtype=np.uint8)
    labels[best >= unstable_from(beta, tilt, model.fingers)] = Label.U
    labels[worst < beta - tilt] = Label.S
    return labels


def max_resolution(worst: Floats, model: GraspModel) -> Floats:
    """Coarsest sensor resolution below which the grasp is S [rad]: alpha* = 2 (beta - beta*).

    Args:
        worst: Critical angle over the normals that hurt most [rad], any shape.
        model: Friction; the resolution in it does not matter.

    Returns:
        Same shape; 0 where no sensor is fine enough.
    """
    return np.maximum(0.0, 2.0 * (model.friction_angle - worst))
