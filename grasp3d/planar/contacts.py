"""Contacts in the plane, and the angles between the normals of two of them and their line.

Where locations are uncertain, the true contacts lie within discs about the perceived ones, so that
their line has any direction within asin((d1 + d2) / opening) of the perceived one; the normals stay
as they are. A grasp is S if the worst of these lines lies inside all possible cones, U if the best
lies outside some.
"""

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


@dataclass(frozen=True, eq=False)
class Lines:
    """Lines from one contact to others, and the angles between them and the middle normals.

    All arrays broadcast against each other.
    """

    toward: Floats
    """Polar angle of the direction to the other contact [rad]."""
    opening: Floats
    """Distance between the contacts [unit]."""
    first: Floats | float
    """Polar angle of the middle normal of the first contact [rad]."""
    second: Floats
    """The same of the other."""

    @classmethod
    def between(cls, fixed: OutlineContacts, others: OutlineContacts) -> "Lines":
        """The lines of one contact with each of several others (k,)."""
        apart = others.points - fixed.points
        return cls.of(apart, fixed.middle[0], others.middle)

    @classmethod
    def of(cls, apart: Floats, first: Floats | float, second: Floats) -> "Lines":
        """The lines of contacts that are apart by vectors (..., 2), with their middle normals."""
        x, y = apart[..., 0], apart[..., 1]
        return cls(np.arctan2(y, x), np.hypot(x, y), first, second)

    def checked(self, worst: Floats, best: Floats) -> tuple[Floats, Floats]:
        """Angles of grasps; inf where both contacts are at one point."""
        none = self.opening == 0.0
        return np.where(none, math.inf, worst), np.where(none, math.inf, best)

    def turn(self, location: float) -> Floats:
        """Largest angle by which the true lines differ from the perceived ones [rad].

        Args:
            location: Sum of the two location errors [unit].
        """
        inside = self.opening > location
        sine = np.divide(location, self.opening, out=np.ones_like(self.opening), where=inside)
        return np.asarray(np.arcsin(sine) if location > 0.0 else np.zeros_like(self.opening))

    def worst(self, ranges: tuple[Floats, Floats], location: float) -> Floats:
        """Largest angle over all true lines and normals [rad]; exact up to pi/2, else a bound.

        Args:
            ranges: Half-ranges of the normals of the two contacts [rad].
            location: Sum of the two location errors [unit].
        """
        off_first, off_second = self.off()
        external = np.maximum(off_first + ranges[0], off_second + ranges[1])
        internal = np.maximum(math.pi - off_first + ranges[0], math.pi - off_second + ranges[1])
        return np.asarray(np.minimum(external, internal) + self.turn(location))

    def best(self, ranges: tuple[Floats, Floats], location: float) -> Floats:
        """Smallest angle over all true lines and normals [rad].

        Over the directions of the line, the larger of two angles is smallest at an end of the
        directions, along a normal, or where the two are equal.

        Args:
            ranges: As in `worst`.
            location: As in `worst`.
        """
        if location == 0.0:
            return np.maximum(self.worst((-ranges[0], -ranges[1]), location), 0.0)
        turn = self.turn(location)
        first, second = self.first - self.toward, self.second + math.pi - self.toward
        middle, skew = 0.5 * (first + second), 0.5 * (ranges[0] - ranges[1])
        turned = [first, second, middle + skew, middle - skew]
        turned += [one + math.pi for one in turned]  # equal on the far side; internal grasps
        least = np.full(np.broadcast_shapes(*(one.shape for one in turned)), math.inf)
        for one in (-turn, turn, *turned):
            line = np.clip(_wrapped(one), -turn, turn)
            for sign in (0.0, math.pi):
                larger = np.maximum(
                    turn_between(line + sign, first) - ranges[0],
                    turn_between(line + sign, second) - ranges[1],
                )
                least = np.minimum(least, larger)
        return np.asarray(np.maximum(least, 0.0))

    def off(self) -> tuple[Floats, Floats]:
        """Angles between the perceived line and the middle normals, for an external grasp."""
        toward = self.toward
        return turn_between(toward, np.asarray(self.first)), turn_between(
            toward + math.pi, self.second
        )


def located_angles(
    fixed: OutlineContacts, others: OutlineContacts, location: float = 0.0
) -> tuple[Floats, Floats]:
    """Worst and best angles of one finger with each of several others, over all true locations.

    Without errors they are critical friction angles, in closed form. With d from the first to the
    second contact: the smaller over s = +1 (external grasp) and s = -1 (internal grasp) of
    max(angle(n1, s d), angle(n2, -s d)), as two planar contacts are force-closed when the line
    between them lies strictly inside both cones (Nguyen 1988). At corners these are the largest and
    the smallest angle over the normals there. Up to pi/2, which is all that labels need, the first
    is the exact maximum over the normals; above it is an upper bound.

    Args:
        fixed: One contact.
        others: The others (k,).
        location: Sum of the two location errors [unit].

    Returns:
        (worst, best) [rad], shape (k,), inf where both contacts are at one point: a grasp is S if
        worst < the smallest effective friction angle, U if best >= the widest one.
    """
    lines = Lines.between(fixed, others)
    halves = fixed.half_range[0], others.half_range
    return lines.checked(
        np.minimum(lines.worst(halves, location), math.pi), lines.best(halves, location)
    )


def _wrapped(angle: Floats) -> Floats:
    """The same direction from -pi to pi."""
    return np.asarray(np.remainder(angle + math.pi, 2.0 * math.pi) - math.pi)
