"""Two fingers on a circle or a sphere whose contact locations are uncertain, in closed form.

With radius R and beta* the critical friction angle, contacts are 2 R cos(beta*) apart. If the true
ones are within d1 and d2 of the perceived ones, their line turns by up to eta = asin((d1 + d2) /
(2 R cos(beta*))), and the worst line makes the angle beta* + eta with a normal. The normals of the
two contacts lie symmetrically about their line, so that no other line is nearer to both: the best
angle is beta*, whatever the location error is.
"""

import math

import numpy as np

from grasp3d.arrays import ArrayLike, Floats


def location_ratio(radius: float, first: float, second: float) -> float:
    """Largest shift of two contacts against each other, as a fraction of the diameter.

    Args:
        radius: Radius of the circle or sphere, above 0.
        first: Location error of the one contact, at least 0, in the same unit.
        second: That of the other.
    """
    return (first + second) / (2.0 * radius)


def worst_angle(critical_angle: ArrayLike, ratio: float) -> Floats:
    """Largest angle between a normal and the line of the contacts, over all true locations [rad].

    Args:
        critical_angle: Critical friction angle beta* at the perceived locations [rad], 0 to pi/2.
        ratio: See `location_ratio`.
    """
    angle = np.asarray(critical_angle, dtype=np.float64)
    opening = np.cos(angle)  # as a fraction of the diameter
    sine = np.divide(ratio, opening, out=np.ones_like(angle), where=opening > ratio)
    return np.asarray(angle + (np.arcsin(sine) if ratio > 0.0 else 0.0))


def critical_angle_below(worst: ArrayLike, ratio: float) -> Floats:
    """Inverse of `worst_angle`: the critical angle below which the worst angle is below `worst`.

    sin(worst - x) = ratio / cos(x) gives x = (worst + asin(sin(worst) - 2 ratio)) / 2.

    Args:
        worst: Angles [rad].
        ratio: See `location_ratio`.

    Returns:
        Critical angles [rad], from 0 (none) to pi/2 (all).
    """
    angle = np.clip(np.asarray(worst, dtype=np.float64), 0.0, math.pi)
    if ratio == 0.0:
        return np.minimum(angle, math.pi / 2.0)
    sine = np.sin(angle)
    within = 0.5 * (angle + np.arcsin(np.clip(sine - 2.0 * ratio, -1.0, 1.0)))
    beyond = np.maximum(angle - math.pi / 2.0, 0.0)  # contacts so near that any line is possible
    return np.clip(np.where(sine > ratio, within, beyond), 0.0, math.pi / 2.0)
