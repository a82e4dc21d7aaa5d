"""The circle and the square of Wan & Howe 2018 (Sec. III-B), with one finger fixed on them.

The second finger is scanned along the outline. Fractions of the perimeter are in closed form,
curves of epsilon come from planar wrench hulls. On the square the fixed finger is in the middle of
the bottom side. Lengths are in radii of the circle and in half sides of the square.
"""

import math
from abc import abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from grasp3d.arrays import ArrayLike, Bools, Bytes, Floats, locked, short_repr
from grasp3d.contact.contacts import effective_friction
from grasp3d.errors import SettingError
from grasp3d.quality.ferrari_canny import epsilon_of_wrenches
from grasp3d.settings import GraspModel, whole_number
from grasp3d.settings.checks import check_range
from grasp3d.stability.angle_distributions import AngleDistribution
from grasp3d.stability.label import Label, label_angles

TIE = 1e-10
"""Angles closer than this count as equal; a grasp at its critical angle is not force-closed [rad].
"""

TINY = 1e-12
"""Fraction of a perimeter within which a contact counts as at a corner."""

SAME = 1e-12
"""Normals closer than this count as the same [rad]."""

MOST_NORMALS = 64
"""Largest number of normals of one contact; each is combined with every normal of the other."""

RANK = 3
"""Dimensions of planar wrenches; a hull of lower rank is not force-closed."""

FEWEST_POINTS = 8
FEWEST_EDGES = 2

NormalChoice = Callable[[float], Floats]
"""Function from a contact's half-range of normals to angles about their middle to test [rad]."""


@dataclass(frozen=True, eq=False)
class OutlineContacts:
    """Contact points on an outline, and the inward normals that are possible there."""

    points: Floats
    """Positions relative to the centre of mass, shape (k, 2)."""
    middle: Floats
    """Polar angles of the normals; at a corner, halfway between those on both sides [rad], (k,)."""
    half_range: Floats
    """Angle from the middle to the normals on both sides [rad], shape (k,); 0 except at corners,
    where any normal between the two is possible."""

    __repr__ = short_repr


def turn_between(first: Floats, second: Floats) -> Floats:
    """Angle between directions given by their polar angles [rad], from 0 to pi."""
    return np.abs(np.remainder(first - second + math.pi, 2.0 * math.pi) - math.pi)


class Outline(AngleDistribution):
    """A closed counter-clockwise curve about its centre of mass, with one finger fixed on it.

    As a distribution it gives, in closed form, the fractions of the perimeter at which a second
    finger makes grasps up to a critical friction angle. Arc lengths begin at the fixed finger, the
    middle of the lowest points.
    """

    name: str
    """Name for titles."""
    perimeter: float
    """Length of the curve."""
    torque_scale: float
    """Largest distance of the curve from its centre of mass."""
    corner_positions: tuple[float, ...] = ()
    """Arc lengths of the corners, ascending."""

    @abstractmethod
    def contacts_at(self, positions: ArrayLike) -> OutlineContacts:
        """Return the contacts at positions along the perimeter.

        Args:
            positions: Arc lengths, shape (k,), taken modulo the perimeter.
        """

    def best_below(self, angles: ArrayLike) -> Floats:
        """See `AngleDistribution`; the fixed finger is at no corner, and corners have no length."""
        return self.worst_below(angles)


@dataclass(frozen=True)
class Circle(Outline):
    """The paper's circle, of radius 1.

    Example:
        >>> from grasp3d.planar import Circle
        >>> fractions = Circle().fractions(friction=1.0, sensor_resolution=0.5)
        >>> {name: round(fraction, 3) for name, fraction in fractions.items()}
        {'S': 0.341, 'M': 0.318, 'U': 0.341}
    """

    name: str = "circle"
    perimeter = 2.0 * math.pi
    torque_scale = 1.0

    def contacts_at(self, positions: ArrayLike) -> OutlineContacts:
        """See `Outline`."""
        turn = np.asarray(positions, dtype=np.float64) - math.pi / 2.0
        points = np.stack([np.cos(turn), np.sin(turn)], axis=-1)
        return OutlineContacts(locked(points), locked(turn + math.pi), locked(np.zeros_like(turn)))

    def worst_below(self, angles: ArrayLike) -> Floats:
        """See `AngleDistribution`; the value is 2 x / pi.

        The line through fingers an angle t apart about the centre is (pi - t) / 2 off both normals,
        for every position of the fixed finger.
        """
        angle = np.clip(np.asarray(angles, dtype=np.float64), 0.0, math.pi / 2.0)
        return angle * (2.0 / math.pi)

    def worst_quantile(self, fraction: float) -> float:
        """See `AngleDistribution`; the inverse of `worst_below`."""
        check_range("a fraction", fraction, 0.0, 1.0)
        return fraction * math.pi / 2.0


@dataclass(frozen=True)
class Square(Outline):
    """The paper's square, of half side 1, with the fixed finger in the middle of the bottom side.

    Example:
        >>> from grasp3d.planar import Square
        >>> fractions = Square().fractions(friction=1.0, sensor_resolution=0.4)
        >>> {name: round(fraction, 3) for name, fraction in fractions.items()}
        {'S': 0.25, 'M': 0.211, 'U': 0.539}
    """

    name: str = "square"
    perimeter = 8.0
    torque_scale = math.sqrt(2.0)
    corner_positions = (1.0, 3.0, 5.0, 7.0)

    def contacts_at(self, positions: ArrayLike) -> OutlineContacts:
        """See `Outline`."""
        along = np.remainder(np.asarray(positions, dtype=np.float64) + 1.0, 8.0)
        corner = np.round(along / 2.0)
        at_corner = np.abs(along - 2.0 * corner) <= TINY * self.perimeter
        side = np.where(at_corner, corner, along // 2.0)
        x = np.where(at_corner, -1.0, along - 2.0 * side - 1.0)
        sides = np.array([[1.0, 0.0], [0.0, 1.0], [-1.0, 0.0], [0.0, -1.0]])  # counter-clockwise
        number = side.astype(np.int64) % 4
        forward, inward = sides[number], sides[(number + 1) % 4]
        half_range = np.where(at_corner, math.pi / 4.0, 0.0)
        middle = (number + 1) * (math.pi / 2.0) - half_range
        points = x[:, None] * forward - inward
        return OutlineContacts(locked(points), locked(middle), locked(half_range))

    def worst_below(self, angles: ArrayLike) -> Floats:
        """See `AngleDistribution`.

        With the second finger on the top side, x from its middle, both angles are atan(x / 2); on
        the other sides, at height y, atan(y) and its complement; on the bottom side 90 degrees.
        """
        angle = np.asarray(angles, dtype=np.float64)
        theta = np.clip(angle, TIE, math.pi / 2.0 - TIE)
        top = np.minimum(2.0 * np.tan(theta), 1.0) / 4.0
        beside = np.maximum(np.minimum(np.tan(theta), 2.0) - 1.0 / np.tan(theta), 0.0) / 4.0
        below = np.where(angle > math.pi / 2.0 + TIE, 1.0, top + beside)
        return np.asarray(np.where(angle > TIE, below, 0.0))


def critical_angles(fixed: OutlineContacts, others: OutlineContacts) -> tuple[Floats, Floats]:
    """Worst and best critical friction angles of one finger with each of several others.

    In closed form, with d from the first to the second contact: the smaller over s = +1 (external
    grasp) and s = -1 (internal grasp) of max(angle(n1, s d), angle(n2, -s d)), as two planar
    contacts are force-closed when the line between them lies strictly inside both cones (Nguyen
    1988). At corners these are the largest and the smallest angle over the normals there. Up to
    pi/2, which is all that labels need, the worst angle is exact; above, it is an upper bound.

    Args:
        fixed: One contact, not at a corner.
        others: The others (k,).

    Returns:
        (worst, best) [rad], shape (k,); inf if both contacts are at the same point.
    """
    x, y = (others.points - fixed.points).T
    toward = np.arctan2(y, x)
    one, two = turn_between(toward, fixed.middle), turn_between(toward + math.pi, others.middle)

    def largest(half_range: Floats) -> Floats:
        external = np.maximum(one, two + half_range)
        return np.minimum(external, np.maximum(math.pi - one, math.pi - two + half_range))

    worst, best = np.minimum(largest(others.half_range), math.pi), largest(-others.half_range)
    same = np.hypot(x, y) == 0.0
    return np.where(same, math.inf, worst), np.where(same, math.inf, np.maximum(best, 0.0))


class EpsilonRange(NamedTuple):
    """Epsilon and force closure of contact pairs over several normals, each of shape (k,)."""

    lowest: Floats
    highest: Floats
    all_closed: Bools
    """Whether all combinations of normals are force-closed."""
    any_closed: Bools
    """Whether any combination of normals is force-closed."""

    @property
    def labels(self) -> Bytes:
        """`Label` codes."""
        codes = np.where(self.all_closed, Label.S, np.where(self.any_closed, Label.M, Label.U))
        return locked(codes.astype(np.uint8))


def face_normals(half_range: float) -> Floats:
    """Angles of the normals on both sides of a corner and of their bisector; elsewhere only 0."""
    return np.array([-half_range, 0.0, half_range]) if half_range > 0.0 else np.zeros(1)


def tested_normals(half_range: float, tilt: float, friction_angle: float) -> Floats:
    """Choose the normals to test among those that the sensor cannot distinguish.

    Wan & Howe 2018, Sec. III: the normals on both sides of the contact with their extreme tilts,
    and the bisector. Where these leave gaps, more are added between them, so that no possible
    normal is farther than the friction angle from a tested one.

    Args:
        half_range: Half-range of the contact's normals about their middle [rad].
        tilt: Largest tilt of each normal, alpha / 2 [rad].
        friction_angle: Half-angle of the friction cone, beta [rad].

    Returns:
        Angles about the middle [rad], ascending, shape (k,).

    Raises:
        SettingError: The gaps would need too many normals.
    """
    tilted = [side * half_range + turn for side in (-1, 1) for turn in (-tilt, 0.0, tilt)]
    normals: Floats = np.sort(np.array([*tilted, 0.0]))
    normals = normals[np.concatenate([[True], np.diff(normals) > SAME])]
    parts = np.ceil(np.diff(normals) / (2.0 * friction_angle) - SAME)
    needed = int(parts.sum()) + 1
    if needed > MOST_NORMALS:
        raise SettingError(
            f"to leave no gap between friction cones of {math.degrees(friction_angle):.3g} "
            f"degrees, {needed} normals of a contact would have to be tested, more than "
            f"{MOST_NORMALS}; use the exact label"
        )
    filled = [
        np.linspace(start, end, int(count), endpoint=False)
        for start, end, count in zip(normals, normals[1:], parts, strict=False)
    ]
    return np.concatenate([*filled, normals[-1:]])


@dataclass(frozen=True, eq=False)
class PlanarScan:
    """A finger fixed on an outline, and a second one at k points along it.

    The first row is the fixed finger's own point, which makes no grasp: U, epsilon 0, critical
    angle inf. Values from wrench hulls are computed when they are first used.
    """

    outline: Outline
    model: GraspModel
    edges: int
    """Number of forces of a planar cone, evenly spaced between its two edges."""
    position: Floats
    """Arc length from the fixed finger, rising from 0 to less than the perimeter."""
    weights: Floats
    """Fraction of the perimeter nearest to each point; 0 for corners and the fixed point.
    """
    contacts: OutlineContacts
    """Contacts at the points."""
    critical_angle: Floats
    """Critical friction angle over the worst normals, in closed form [rad]."""
    critical_angle_best: Floats
    """Critical friction angle over the best normals; smaller at corners."""
    label: Bytes
    """Exact `Label` codes, derived from the critical angles."""

    __repr__ = short_repr

    @cached_property
    def at_corner(self) -> Bools:
        """Whether a point is a corner, with a range of normals, shape (k,)."""
        return locked(self.contacts.half_range > 0.0)

    @cached_property
    def angle(self) -> Floats:
        """Angle about the centre of mass from the fixed finger, from 0 to 2 pi [rad]."""
        x, y = self.contacts.points.T
        turn = np.arctan2(y, x)
        return locked(np.remainder(turn - turn[0], 2.0 * math.pi))

    @cached_property
    def epsilon(self) -> Floats:
        """Epsilon at the perceived normals; at corners at their bisector."""
        return self._over(lambda _: np.zeros(1), self.model.friction_angle).lowest

    @cached_property
    def epsilon_extremes(self) -> Floats:
        """Epsilon of the four combinations of extreme normals, shape (4, k).

        Tilts of the fixed and the scanned finger, + counter-clockwise: ++, +-, -+, --. At corners
        the normals are the extremes of the whole range, exterior angle + alpha.
        """
        evaluated = self._evaluated(self._extreme, self.model.friction_angle)
        return locked(np.stack([np.broadcast_to(value, 4) for value, _ in evaluated], axis=1))

    @cached_property
    def epsilon_effective(self) -> Floats:
        """Epsilon at the effective friction; at corners the least over faces and bisector."""
        model = self.model
        beta = math.atan(effective_friction(model.nominal_friction, model.sensor_resolution))
        return self._over(face_normals, beta).lowest

    @property
    def epsilon_min(self) -> Floats:
        """Smallest epsilon over all tested normals.

        Raises:
            SettingError: Too many normals would have to be tested.
        """
        return self._tested.lowest

    @property
    def epsilon_max(self) -> Floats:
        """Largest epsilon over all tested normals; see `epsilon_min`."""
        return self._tested.highest

    @property
    def label_extremes(self) -> Bytes:
        """`Label` codes from force closure at the tested normals alone; see `epsilon_min`.

        They equal `label`, except within rounding of a threshold.
        """
        return self._tested.labels

    @cached_property
    def label_four(self) -> Bytes:
        """`Label` codes from the four combinations of extreme normals alone.

        They differ from the exact ones where alpha > 2 beta, as the extreme cones of a contact then
        leave a gap. If the line between the contacts lies in the gap, within alpha/2 - beta of a
        perceived normal, no combination is force-closed and the label is U, although it is M
        wherever the line is less than alpha/2 + beta off both normals. At corners there is a gap
        if the exterior angle + alpha exceeds 2 beta. If it exceeds 180 degrees, the label may even
        be S, due to extreme normals that point to the opposite side.
        """
        return self._over(self._extreme, self.model.friction_angle).labels

    def fractions(self, labels: Bytes | None = None) -> dict[str, float]:
        """Fractions of the perimeter that are S, M and U, by `weights`.

        Args:
            labels: Other labels of the points, such as `label_four`; None for `label`.
        """
        codes = self.label if labels is None else labels
        return {
            label.name: float(self.weights[codes == label].sum())
            for label in sorted(Label, reverse=True)
        }

    def _extreme(self, half_range: float) -> Floats:
        """The two normals that are farthest apart, the counter-clockwise one first."""
        return (half_range + self.model.tilt) * np.array([1.0, -1.0])

    @cached_property
    def _tested(self) -> EpsilonRange:
        tilt, beta = self.model.tilt, self.model.friction_angle
        return self._over(lambda half_range: tested_normals(half_range, tilt, beta), beta)

    def _over(self, choose: NormalChoice, friction_angle: float) -> EpsilonRange:
        """Evaluate all combinations of chosen normals, whose number may differ between contacts."""
        rows = [
            (value.min(), value.max(), closed.all(), closed.any())
            for value, closed in self._evaluated(choose, friction_angle)
        ]
        return EpsilonRange(*(locked(np.array(column)) for column in zip(*rows, strict=True)))

    def _evaluated(
        self, choose: NormalChoice, friction_angle: float
    ) -> Iterator[tuple[Floats, Bools]]:
        """Epsilon and closure of each contact, shape (combinations,); single for the fixed point.

        The scanned finger's normals vary fastest.
        """
        points = self.contacts.points
        first = self._wrenches(0, choose, friction_angle)  # (k1, e, 3)
        for row, point in enumerate(points):
            if (point == points[0]).all():
                yield np.zeros(1), np.zeros(1, dtype=np.bool_)
                continue
            second = self._wrenches(row, choose, friction_angle)  # (k2, e, 3)
            pairs = (np.repeat(first, len(second), axis=0), np.tile(second, (len(first), 1, 1)))
            result = epsilon_of_wrenches(np.concatenate(pairs, axis=1))
            closed = result.closed & (result.rank == RANK)
            yield np.where(closed, result.value, 0.0), closed

    def _wrenches(self, row: int, choose: NormalChoice, beta: float) -> Floats:
        """Wrenches (k, e, 3) of a contact for each chosen normal: force x, y, torque / scale."""
        contacts = self.contacts
        middles = contacts.middle[row] + choose(float(contacts.half_range[row]))
        turn = middles[:, None] + np.linspace(-beta, beta, self.edges)  # (k, e)
        force = np.cos(turn), np.sin(turn)
        x, y = contacts.points[row] / self.outline.torque_scale
        return np.stack([*force, x * force[1] - y * force[0]], axis=-1)


def scan(
    outline: Outline, model: GraspModel | None = None, *, points: int = 720, edges: int = 2
) -> PlanarScan:
    """Scan the second finger along an outline (Wan & Howe 2018, Sec. III-B).

    Args:
        outline: The circle or the square.
        model: Friction and sensor resolution; None for the defaults.
        points: Number of evenly spaced points, the fixed finger's first, at least 8; corners are
            added.
        edges: Number of unit forces of a planar friction cone, at least 2, evenly spaced from one
            edge to the other; 2 in the paper. More of them approximate the arc between the edges,
            which changes epsilon but not force closure.

    Raises:
        SettingError: A setting is out of range, or the model has more than these two settings.

    Example:
        >>> import grasp3d
        >>> scanned = grasp3d.planar.scan(grasp3d.planar.Circle(), grasp3d.GraspModel(friction=1.0))
        >>> {name: round(fraction, 2) for name, fraction in scanned.fractions().items()}
        {'S': 0.37, 'M': 0.25, 'U': 0.37}
    """
    settings = model or GraspModel()
    if settings != GraspModel(settings.friction, settings.sensor_resolution):
        raise SettingError("planar outlines take a friction and a sensor resolution, nothing else")
    count = whole_number("edges of a planar cone", edges, FEWEST_EDGES)
    position = _positions(outline, whole_number("points", points, FEWEST_POINTS))
    contacts = outline.contacts_at(position)
    worst, best = critical_angles(outline.contacts_at(position[:1]), contacts)
    return PlanarScan(
        outline=outline,
        model=settings,
        edges=count,
        position=locked(position),
        weights=locked(_weights(position, contacts, outline.perimeter)),
        contacts=contacts,
        critical_angle=locked(worst),
        critical_angle_best=locked(best),
        label=locked(label_angles(worst + TIE, best + TIE, settings)),
    )


def _positions(outline: Outline, points: int) -> Floats:
    """Arc lengths from the fixed finger, in order: evenly spaced ones and the corners."""
    even = np.linspace(0.0, outline.perimeter, points + 1)
    corners = np.array(outline.corner_positions)
    apart = np.abs(corners[:, None] - even).min(axis=1) > TINY * outline.perimeter
    return np.sort(np.concatenate([even[:-1], corners[apart]]))


def _weights(position: Floats, contacts: OutlineContacts, perimeter: float) -> Floats:
    """Fraction of the perimeter nearest to each point; 0 for corners and the fixed point."""
    weighted = contacts.half_range == 0.0
    weighted[0] = False
    smooth = np.flatnonzero(weighted)
    bounds = 0.5 * (position[smooth[:-1] + 1] + position[smooth[1:] - 1])
    weights = np.zeros(len(position))
    weights[smooth] = np.diff(np.concatenate([[0.0], bounds, [perimeter]])) / perimeter
    return weights
