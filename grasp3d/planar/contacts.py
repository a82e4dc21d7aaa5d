"""Contacts in the plane, and the critical friction angle of two of them."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from grasp3d.arrays import Floats, locked

TIE = 1e-10
"""Angles closer than this count as equal, and a grasp at its critical angle as not closed [rad]."""

STRAIGHT = 1e-9
"""Where normals lie this near their middle there is no corner [rad]."""


@dataclass(frozen=True, eq=False)
class Places:
    """Places on an outline and the inward normals that a finger may meet there."""

    points: Floats
    """Shape (k, 2)."""
    first: Floats
    """Unit normals where the outline arrives at the place, shape (k, 2)."""
    last: Floats
    """Unit normals where it leaves; another than `first` at corners only, where any normal between
    the two may be met. Shape (k, 2)."""

    @cached_property
    def middle(self) -> Floats:
        """Polar angles of the normals halfway between first and last [rad], shape (k,)."""
        between = self.first + self.last
        return locked(np.arctan2(between[:, 1], between[:, 0]))

    @cached_property
    def half_range(self) -> Floats:
        """How far first and last lie from the middle [rad], shape (k,); below pi/2."""
        across = self.first[:, 0] * self.last[:, 1] - self.first[:, 1] * self.last[:, 0]
        along = (self.first * self.last).sum(axis=1)
        return locked(0.5 * np.arctan2(np.abs(across), along))


def turn_between(first: Floats, second: Floats) -> Floats:
    """Angle between directions given by their polar angles [rad], from 0 to pi."""
    return np.abs(np.remainder(first - second + math.pi, 2.0 * math.pi) - math.pi)


def critical_angles(fixed: Places, places: Places) -> tuple[Floats, Floats]:
    """Critical friction angles of one finger and each of others, in closed form.

    With d from the first to the second contact, the smaller over s = +1 (squeezing) and s = -1
    (expanding) of max(angle(n1, s d), angle(n2, -s d)): two planar cones close when both hold the
    line between the contacts strictly inside (Nguyen 1988).

    Args:
        fixed: One place.
        places: The others (k,).

    Returns:
        (worst, best) [rad], shape (k,), inf where both fingers stand at one place. At corners each
        angle is the largest, and the smallest, over the normals there. Up to pi/2, which is all
        that labels ask, the first is the largest critical angle of any normals; beyond, a bound.
    """
    apart = places.points - fixed.points
    toward = np.arctan2(apart[:, 1], apart[:, 0])
    off_first = turn_between(toward, fixed.middle)
    off_second = turn_between(toward + math.pi, places.middle)
    worst, best = (
        np.minimum(
            np.maximum(off_first + wide_first, off_second + wide_second),
            np.maximum(math.pi - off_first + wide_first, math.pi - off_second + wide_second),
        )
        for wide_first, wide_second in (
            (fixed.half_range, places.half_range),
            (-fixed.half_range, -places.half_range),
        )
    )
    nowhere = (apart == 0.0).all(axis=1)
    return (
        np.where(nowhere, math.inf, np.minimum(worst, math.pi)),
        np.where(nowhere, math.inf, np.maximum(best, 0.0)),
    )
