"""Labels and epsilon of a finger scanned along an outline (Wan & Howe 2018, Sec. III-B)."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property, partial
from typing import Literal, NamedTuple

import numpy as np

from grasp3d.arrays import Bools, Bytes, Floats, Ints, locked, short_repr
from grasp3d.contact.friction_cones import effective_friction
from grasp3d.errors import SettingError
from grasp3d.planar.contacts import (
    STRAIGHT,
    TIE,
    OutlineContacts,
    located_angles,
)
from grasp3d.planar.outlines import Outline
from grasp3d.planar.polylines import TINY
from grasp3d.quality.ferrari_canny import epsilon_of_wrenches
from grasp3d.settings import GraspModel, check_choice, whole_number
from grasp3d.settings.grasp_model import Actuation
from grasp3d.stability.angle_distributions import check_number
from grasp3d.stability.label import Label
from grasp3d.stability.thresholds import label_angles

MOST_NORMALS = 64
"""Largest number of normals of one contact, all combined with those of the other."""

PART = 1 << 16
"""Largest number of wrenches in memory at once."""

RANK = 3
"""Dimensions of planar wrenches; a hull of lower rank is not force-closed."""

SAME = 1e-12
"""Normals closer than this are one [rad]."""

NormalChoice = Callable[[float], Floats]
"""From the half-range of a contact's normals to the angles about their middle to evaluate [rad]."""


class EpsilonRange(NamedTuple):
    """Epsilon and force closure of contact pairs over several normals, each of shape (k,)."""

    lowest: Floats
    highest: Floats
    all_closed: Bools
    """Whether all combinations of normals are force-closed."""
    any_closed: Bools
    """Whether any combination is."""


@dataclass(frozen=True, eq=False)
class Pairs:
    """A fixed contact paired with each of several others, relative to the center of mass."""

    fixed: OutlineContacts
    """One contact."""
    others: OutlineContacts
    """The others (k,)."""
    torque_scale: float
    """Length that torques are divided by [unit]."""
    actuation: Actuation
    """Which sum of forces is at most 1; see `GraspModel`."""
    edges: int
    """Number of forces of a cone, evenly between its two edges."""

    def each_combination(self, choose: NormalChoice, friction_angle: float) -> Floats:
        """Epsilon, 0 where not force-closed, of every combination of chosen normals.

        Args:
            choose: The normals, equally many at every contact.
            friction_angle: Half-angle of the cones [rad].

        Returns:
            Shape (combinations, k), the scanned finger's normals running fastest.
        """
        values = np.zeros((len(choose(0.0)) ** 2, len(self.others.points)))
        for part, value, _ in self._evaluate(choose, friction_angle):
            values[:, part] = value.T
        return values

    def over_combinations(self, choose: NormalChoice, friction_angle: float) -> EpsilonRange:
        """Range over all combinations of chosen normals, whose number may differ by contact."""
        count = len(self.others.points)
        lowest, highest = np.zeros((2, count))
        all_closed, any_closed = np.zeros((2, count), dtype=np.bool_)
        for part, value, closed in self._evaluate(choose, friction_angle):
            lowest[part], highest[part] = value.min(axis=1), value.max(axis=1)
            all_closed[part], any_closed[part] = closed.all(axis=1), closed.any(axis=1)
        return EpsilonRange(locked(lowest), locked(highest), locked(all_closed), locked(any_closed))

    def _evaluate(
        self, choose: NormalChoice, friction_angle: float
    ) -> Iterator[tuple[Ints, Floats, Bools]]:
        """Rows (m,) of contacts off the fixed point; epsilon and closure, (m, combinations)."""
        index = np.flatnonzero((self.others.points != self.fixed.points).any(axis=1))
        first = self._wrenches(self.fixed, np.array([0]), choose, friction_angle)  # (1, k1, e, 3)
        rows = 2 * self.edges + (self.edges**2 if self.actuation == "per_finger" else 0)
        half_ranges = np.round(self.others.half_range[index], 12)  # groups of equal corners
        for half in np.unique(half_ranges):
            group = index[half_ranges == half]
            step = max(1, PART // (first.shape[1] * len(choose(float(half))) * rows))
            for start in range(0, len(group), step):
                part = group[start : start + step]
                second = self._wrenches(self.others, part, choose, friction_angle)  # (m, k2, e, 3)
                value, closed = self._epsilon(first[:, :, None], second[:, None])
                yield part, value.reshape(len(part), -1), closed.reshape(len(part), -1)

    def _wrenches(
        self, contacts: OutlineContacts, index: Ints, choose: NormalChoice, beta: float
    ) -> Floats:
        """Wrenches (m, k, e, 3) of contacts of one half-range: force x, y, torque / scale."""
        offsets = choose(float(contacts.half_range[index[0]]))
        spread = np.linspace(-beta, beta, self.edges)
        turn = (contacts.middle[index, None] + offsets)[..., None] + spread  # (m, k, e)
        force = np.stack([np.cos(turn), np.sin(turn)])
        x, y = contacts.points[index].T[..., None, None] / self.torque_scale
        return np.stack([*force, x * force[1] - y * force[0]], axis=-1)

    def _epsilon(self, first: Floats, second: Floats) -> tuple[Floats, Bools]:
        """Epsilon and closure of the wrenches of two fingers (..., e, 3), broadcast."""
        shape = np.broadcast_shapes(first.shape, second.shape)
        a, b = np.broadcast_to(first, shape), np.broadcast_to(second, shape)
        rows = [a, b]
        if self.actuation == "per_finger":
            sums = a[..., :, None, :] + b[..., None, :, :]
            rows.append(sums.reshape(*shape[:-2], -1, 3))
        result = epsilon_of_wrenches(np.concatenate(rows, axis=-2))
        closed = result.closed & (result.rank == RANK)
        return np.where(closed, result.value, 0.0), closed


def extreme_normals(half_range: float, tilt: float) -> Floats:
    """The two normals that are farthest apart, the counter-clockwise one first.

    Args:
        half_range: Half-range of the contact's normals about their middle [rad].
        tilt: Largest tilt of each normal, alpha / 2 [rad].

    Returns:
        Angles about the middle [rad], shape (2,).
    """
    return np.array([half_range + tilt, -half_range - tilt])


def face_normals(half_range: float) -> Floats:
    """The normals on both sides of a corner and the bisecting one; elsewhere the one normal."""
    return np.array([-half_range, 0.0, half_range]) if half_range > SAME else np.zeros(1)


def tested_normals(half_range: float, tilt: float, friction_angle: float, *, rings: bool) -> Floats:
    """Normals that are tested of those that the sensor cannot distinguish.

    Wan & Howe 2018, Sec. III: the normals on both sides of the contact with their extreme
    tilts, and the bisecting one. With rings there are more between them, so that no possible normal
    is farther than the friction angle from a tested one.

    Args:
        half_range: Half-range of the contact's normals about their middle [rad].
        tilt: Largest tilt of each normal, alpha / 2 [rad].
        friction_angle: Half-angle of the friction cone, beta [rad].
        rings: Whether gaps of more than 2 beta are filled.

    Returns:
        Angles about the middle [rad], ascending, shape (k,).

    Raises:
        SettingError: The rings would need too many normals.
    """
    tilted = [side * half_range + turn for side in (-1, 1) for turn in (-tilt, 0.0, tilt)]
    normals: Floats = np.sort(np.array([*tilted, 0.0]))
    normals = normals[np.concatenate([[True], np.diff(normals) > SAME])]
    if not rings:
        return normals
    parts = np.ceil(np.diff(normals) / (2.0 * friction_angle) - SAME)
    needed = int(parts.sum()) + 1
    if needed > MOST_NORMALS:
        raise SettingError(
            f"to leave no gap between friction cones of {math.degrees(friction_angle):.3g} "
            f"degrees, {needed} normals of a contact would have to be tested, more than "
            f"{MOST_NORMALS}; scan with rings=False, or use the exact label"
        )
    filled = [
        np.linspace(start, end, int(count), endpoint=False)
        for start, end, count in zip(normals, normals[1:], parts, strict=False)
    ]
    return np.concatenate([*filled, normals[-1:]])


Kind = Literal["exact", "extremes", "four"]

FEWEST_POINTS = 8
FEWEST_EDGES = 2


@dataclass(frozen=True, eq=False)
class PlanarScan:
    """A finger fixed on an outline and a second one at k points along it.

    The first row is the fixed finger's own point, which makes no grasp: U, epsilon 0, critical
    angle inf. What comes from wrench hulls is computed at first use, at the perceived locations;
    `label` and `located_angles` alone take uncertain locations into account.
    """

    outline: Outline
    model: GraspModel
    edges: int
    """Number of forces of a planar cone."""
    rings: bool
    """Whether normals between the extreme ones were added where these leave gaps."""
    position: Floats
    """Arc length [unit], rising from the fixed finger's to less than a perimeter beyond it."""
    weights: Floats
    """Fraction of the perimeter that is nearest to each point; 0 for corners and the fixed point.
    """
    contacts: OutlineContacts
    """Contacts at the points, relative to the center of mass."""
    critical_angle: Floats
    """Critical friction angle over the worst normals [rad], closed form."""
    critical_angle_best: Floats
    """The same over the best normals; smaller where either finger is at a corner."""
    located_angles: tuple[Floats, Floats]
    """Worst and best angles over the normals and all true locations [rad]: the critical angles,
    unless the model has a location error."""
    label: Bytes
    """Exact `Label` codes, from the located angles."""

    __repr__ = short_repr

    @property
    def margin(self) -> Floats:
        """Effective friction angle less the worst angle [rad]: S where it is above 0; shape (k,).

        -inf where there is no grasp.
        """
        return locked(self.model.effective_friction_angle - (self.located_angles[0] + TIE))

    @property
    def points(self) -> Floats:
        """The points in the outline's frame [unit], shape (k, 2)."""
        return locked(self.contacts.points + self.outline.center_mass)

    @cached_property
    def at_corner(self) -> Bools:
        """Whether a point is a corner, with a range of normals, shape (k,)."""
        return locked(self.contacts.half_range > STRAIGHT)

    @cached_property
    def angle(self) -> Floats:
        """Angle about the center of mass from the fixed finger, from 0 to 2 pi [rad]."""
        x, y = self.contacts.points.T
        turn = np.arctan2(y, x)
        return locked(np.remainder(turn - turn[0], 2.0 * math.pi))

    @cached_property
    def epsilon(self) -> Floats:
        """Epsilon at the perceived normals and nominal friction; at corners the bisecting ones."""
        beta = self.model.friction_angle
        return self._pairs.over_combinations(lambda _: np.zeros(1), beta).lowest

    @cached_property
    def epsilon_extremes(self) -> Floats:
        """Epsilon of the four combinations of extreme normals, shape (4, k), at nominal friction.

        Tilts of the fixed and the scanned finger, + counter-clockwise: ++, +-, -+, --. At corners
        the normals are the extreme ones of the whole range, exterior angle + alpha.
        """
        return locked(self._pairs.each_combination(self._extreme, self.model.friction_angle))

    @cached_property
    def epsilon_effective(self) -> Floats:
        """Epsilon at the effective friction; at corners the smallest over faces and bisector.

        The effective friction is that of the smallest friction and all errors of normals.
        """
        beta = math.atan(effective_friction(self.model.friction_interval[0], 2.0 * self.model.tilt))
        return self._pairs.over_combinations(face_normals, beta).lowest

    @property
    def epsilon_min(self) -> Floats:
        """Smallest epsilon over all tested normals, at the smallest friction.

        Raises:
            SettingError: The rings need too many normals.
        """
        return self._tested[0].lowest

    @property
    def epsilon_max(self) -> Floats:
        """Largest epsilon over all tested normals, at the largest friction; see `epsilon_min`."""
        return self._tested[1].highest

    @cached_property
    def label_extremes(self) -> Bytes:
        """`Label` codes from force closure at the tested normals alone; see `epsilon_min`.

        With rings the same as `label`, except within rounding of a threshold.

        Raises:
            SettingError: The rings need too many normals, or the model has a location error: hulls
                test normals and friction only.
        """
        self._check_located()
        return _labels(*self._tested)

    @cached_property
    def label_four(self) -> Bytes:
        """`Label` codes from the four combinations of extreme normals alone.

        They differ from the exact ones where alpha > 2 beta: the extreme cones of a contact then
        leave a gap between them. If the line between the contacts lies within alpha/2 - beta of a
        perceived normal, in the gap, no combination is force-closed and the label is U, although it
        is M wherever the line is less than alpha/2 + beta off both normals. At corners there is a
        gap where exterior angle + alpha exceed 2 beta; where they exceed 180 degrees the label may
        even be S, from extreme normals that point to the opposite side.

        Raises:
            SettingError: The model has a location error; see `label_extremes`.
        """
        self._check_located()
        return _labels(*self._over_frictions(lambda _: self._extreme))

    def fractions(self, *, of: Kind = "exact") -> dict[str, float]:
        """Fractions of the perimeter that are S, M and U, weighted with `weights`.

        Args:
            of: 'exact': `label`; 'extremes': `label_extremes`; 'four': `label_four`.

        Raises:
            SettingError: `of` is unknown, or the rings need too many normals.
        """
        check_choice("kind of labels", of, Kind)
        labels = getattr(self, "label" if of == "exact" else f"label_{of}")
        return {
            label.name: float(self.weights[labels == label].sum())
            for label in sorted(Label, reverse=True)
        }

    @cached_property
    def _pairs(self) -> Pairs:
        row = slice(0, 1)
        contacts = self.contacts
        fixed = OutlineContacts(contacts.points[row], contacts.first[row], contacts.last[row])
        scale, actuation = self.outline.torque_scale, self.model.actuation
        return Pairs(fixed, contacts, scale, actuation, self.edges)

    def _check_located(self) -> None:
        if self.model.location_error != 0.0:
            raise SettingError(
                "wrench hulls test normals and friction, not contact locations; set location_error "
                "to 0, or use the exact label"
            )

    @property
    def _extreme(self) -> NormalChoice:
        return partial(extreme_normals, tilt=self.model.tilt)

    @cached_property
    def _tested(self) -> tuple[EpsilonRange, EpsilonRange]:
        """Ranges over the tested normals at the smallest and at the largest friction."""
        tested = partial(tested_normals, tilt=self.model.tilt, rings=self.rings)
        return self._over_frictions(lambda beta: partial(tested, friction_angle=beta))

    def _over_frictions(
        self, choose: Callable[[float], NormalChoice]
    ) -> tuple[EpsilonRange, EpsilonRange]:
        """Ranges over normals at the smallest and the largest friction, which are chosen for it."""
        least, largest = map(math.atan, self.model.friction_interval)
        low = self._pairs.over_combinations(choose(least), least)
        same = largest == least
        return low, low if same else self._pairs.over_combinations(choose(largest), largest)


def _labels(least: EpsilonRange, largest: EpsilonRange) -> Bytes:
    """`Label` codes from closure at the smallest and at the largest friction."""
    codes = np.where(least.all_closed, Label.S, np.where(largest.any_closed, Label.M, Label.U))
    return locked(codes.astype(np.uint8))


def scan(
    outline: Outline,
    model: GraspModel | None = None,
    *,
    points: int = 720,
    edges: int = 2,
    rings: bool = True,
) -> PlanarScan:
    """Scan the second finger along an outline (Wan & Howe 2018, Sec. III-B).

    Args:
        outline: The curve, with the first finger fixed on it.
        model: Friction, sensor resolution, further uncertainties and actuation; None: the
            defaults. Lengths are numbers in the outline's unit. Its `edges` and `torsion_radius`
            have no effect in the plane.
        points: Number of evenly spaced points, the fixed finger's first, at least 8; corners are
            added. For fractions of the perimeter every edge should contain some.
        edges: Number of unit forces of a planar friction cone, at least 2, evenly spaced from one
            edge to the other; 2 in the paper. More approximate the arc between the edges: epsilon
            changes, force closure does not.
        rings: Whether to test more normals where the extreme, the perceived and the bisecting ones
            leave gaps of more than 2 beta.

    Raises:
        SettingError: A setting is outside its range, or all points are corners.

    Example:
        Contacts known to within a tenth of the circle's radius:

        >>> import grasp3d
        >>> model = grasp3d.GraspModel(friction=(0.9, 1.1), location_error=0.1)
        >>> scanned = grasp3d.planar.scan(grasp3d.planar.Circle(), model)
        >>> {name: round(fraction, 2) for name, fraction in scanned.fractions().items()}
        {'S': 0.27, 'M': 0.39, 'U': 0.34}
        >>> bool((scanned.located_angles[0] >= scanned.critical_angle).all())
        True
    """
    settings = GraspModel() if model is None else model
    check_number(settings.location_error)
    if settings.fingers != 2:
        raise SettingError(f"planar grasps have two fingers; got a model of {settings.fingers}")
    travel = _travel(outline, whole_number("points", points, FEWEST_POINTS))
    count = whole_number("edges of a planar cone", edges, FEWEST_EDGES)
    position = outline.fixed + travel
    contacts = outline.contacts_about_center(position)
    fixed = outline.contacts_about_center(position[:1])
    worst, best = located_angles(fixed, contacts)
    located = located_angles(fixed, contacts, 2.0 * settings.location_error)
    return PlanarScan(
        outline=outline,
        model=settings,
        edges=count,
        rings=rings,
        position=locked(position),
        weights=locked(_weights(travel, contacts, outline.perimeter)),
        contacts=contacts,
        critical_angle=locked(worst),
        critical_angle_best=locked(best),
        located_angles=(locked(located[0]), locked(located[1])),
        label=locked(label_angles(located[0] + TIE, located[1] + TIE, settings)),
    )


def _travel(outline: Outline, points: int) -> Floats:
    """Arc lengths from the fixed finger: evenly spaced ones and the corners, in order."""
    even = np.linspace(0.0, outline.perimeter, points + 1)
    corners = np.remainder(outline.corner_positions - outline.fixed, outline.perimeter)
    apart = np.abs(corners[:, None] - even).min(axis=1) > TINY * outline.perimeter
    return np.sort(np.concatenate([even[:-1], corners[apart]]))


def _weights(travel: Floats, contacts: OutlineContacts, perimeter: float) -> Floats:
    """Fraction of the perimeter nearest to each point, except to corners and the fixed point."""
    weighted = contacts.half_range <= STRAIGHT
    weighted[0] = False
    smooth = np.flatnonzero(weighted)
    if len(smooth) == 0:
        raise SettingError("every point is a corner of the outline; scan more points")
    bounds = 0.5 * (travel[smooth[:-1] + 1] + travel[smooth[1:] - 1])
    weights = np.zeros(len(travel))
    weights[smooth] = np.diff(np.concatenate([[0.0], bounds, [perimeter]])) / perimeter
    return weights
