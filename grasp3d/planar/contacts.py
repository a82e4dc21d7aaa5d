"""Contacts in the plane, and the critical friction angle of two of them."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from grasp3d.arrays import Floats, locked, short_repr

TIE = 1e-10
"""Angles closer than this count as equal; a grasp at its critical angle is not force-closed [rad].
"""

STRAIGHT = 1e-9
"""Half-range of normals up to which a point is not a corner [rad]."""


@dataclass(frozen=True, eq=False)
class OutlineContacts:
    """Contact points on an outline and the inward normals possible there."""

    points: Floats
    """Shape (k, 2)."""
    first: Floats
    """Unit normals of the outline just before the point, shape (k, 2)."""
    last: Floats
    """Unit normals just behind it, shape (k, 2); different from `first` at corners only, where any
    normal between the two is possible."""

    __repr__ = short_repr

    @cached_property
    def middle(self) -> Floats:
        """Polar angles of the normals halfway between first and last [rad], shape (k,)."""
        between = self.first + self.last
        return locked(np.arctan2(between[:, 1], between[:, 0]))

    @cached_property
    def half_range(self) -> Floats:
        """Angle from the middle to first and to last [rad], shape (k,); below pi/2."""
        across = self.first[:, 0] * self.last[:, 1] - self.first[:, 1] * self.last[:, 0]
        along = (self.first * self.last).sum(axis=1)
        return locked(0.5 * np.arctan2(np.abs(across), along))


def turn_between(first: Floats, second: Floats) -> Floats:
    """Angle between directions given by their polar angles [rad], from 0 to pi."""
    return np.abs(np.remainder(first - second + math.pi, 2.0 * math.pi) - math.pi)


def critical_angles(fixed: OutlineContacts, others: OutlineContacts) -> tuple[Floats, Floats]:
    """Critical friction angles of one finger with each of several others, in closed form.

    With d from the first to the second contact, the smaller over s = +1 (external grasp) and s = -1
    (internal grasp) of max(angle(n1, s d), angle(n2, -s d)): two planar contacts are force-closed
    when the line between them lies strictly inside both cones (Nguyen 1988).

    Args:
        fixed: One contact.
        others: The others (k,).

    Returns:
        (worst, best) [rad], shape (k,), inf where both contacts are at one point. At corners these
        are the largest and the smallest angle over the normals there. Up to pi/2, which is all that
        labels need, the first is the exact maximum over the normals; above it is an upper bound.
    """
    apart = others.points - fixed.points
    toward = np.arctan2(apart[:, 1], apart[:, 0])
    off_first = turn_between(toward, fixed.middle)
    off_second = turn_between(toward + math.pi, others.middle)
    worst, best = (
        np.minimum(
            np.maximum(off_first + range_first, off_second + range_second),
            np.maximum(math.pi - off_first + range_first, math.pi - off_second + range_second),
        )
        for range_first, range_second in (
            (fixed.half_range, others.half_range),
            (-fixed.half_range, -others.half_range),
        )
    )
    same_point = (apart == 0.0).all(axis=1)
    return (
        np.where(same_point, math.inf, np.minimum(worst, math.pi)),
        np.where(same_point, math.inf, np.maximum(best, 0.0)),
    )
