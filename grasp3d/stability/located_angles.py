"""Critical friction angles that include uncertain contact locations, and contacts that differ.

With them every label is the same threshold as without: S iff the worst one is below beta - alpha/2,
U iff the best one is at least beta + alpha/2, M otherwise. For two contacts they are exact: the
line between the contacts turns by up to eta = asin((d1 + d2) / opening), d1 and d2 the location
errors, so that the worst is beta* + eta; the best is the minimum over the cap of lines. For three
and more they are safe: every S and U is correct.
"""

import math
from dataclasses import dataclass, replace

import numpy as np

from grasp3d._kernels.search.pair_lines import locate_pairs, pair_angles
from grasp3d.arrays import RIGHT_ANGLE, Bools, Floats, Ints, angles_between
from grasp3d.contact.contacts import Contacts
from grasp3d.quality.closure import force_closure
from grasp3d.quality.tilting import location_tolerance
from grasp3d.settings import GraspModel

TOLERANCE = 1e-3
"""Three contacts and more: accuracy of the angles [rad]."""

PROVING = (1.0, 0.99, 0.97, 0.93, 0.85, 0.7, 0.5)
"""Three contacts and more: fractions of the critical angle at which directions are computed that
separate the grasp; the fraction that proves the most is taken."""


@dataclass(frozen=True, eq=False)
class ContactLimits:
    """What is known about the contacts of grasps, relative to thresholds that all have in common.

    Arrays have one row for all grasps, or a row for each.
    """

    inner: Floats
    """Smallest friction angle minus tilt of each contact, minus that of the worst one; at least 0
    [rad], shape (b or 1, n)."""
    outer: Floats
    """Largest friction angle plus tilt of the best contact, minus that of each; at least 0 [rad],
    shape (b or 1, n)."""
    location: Floats
    """Location error of each contact, in the unit of the points, shape (b or 1, n)."""

    @classmethod
    def of(cls, model: GraspModel) -> "ContactLimits":
        """The limits of a model, one row for all grasps; lengths in the unit of the points."""
        same = np.zeros((1, model.fingers))
        return cls(inner=same, outer=same, location=same + model.location_error)

    @classmethod
    def of_angles(cls, narrowest: Floats, widest: Floats, location: Floats) -> "ContactLimits":
        """From the narrowest and the widest friction angles of contacts [rad], (b or 1, n)."""
        return cls(
            inner=narrowest - narrowest.min(axis=1, keepdims=True),
            outer=widest.max(axis=1, keepdims=True) - widest,
            location=location,
        )

    @property
    def uniform(self) -> bool:
        """Whether nothing is added to critical angles."""
        return not (self.inner.any() or self.outer.any() or self.location.any())

    def take(self, rows: Ints) -> "ContactLimits":
        """The limits of chosen grasps."""
        return self if len(self.inner) == 1 else ContactLimits(
            self.inner[rows], self.outer[rows], self.location[rows]
        )  # fmt: skip


@dataclass(frozen=True, eq=False)
class PairLines:
    """Lines between the two contacts of grasps, and their angles to the normals there."""

    openings: Floats
    """Distance between the contacts of the grasps with the worst normals, shape (b,)."""
    openings_best: Floats
    """The same of the grasps with the best normals, which may be others on creases, shape (b,)."""
    angles: Floats
    """Largest and smallest angles of the first contact's normals to the line from the first to the
    second, and of the second one's to the opposite [rad], shape (2, b, 2)."""
    angles_best: Floats
    """The same of the grasps with the best normals, shape (2, b, 2)."""
    lines: Floats
    """Unit vectors from the first to the second contact of the latter, shape (b, 3)."""
    normals: Floats
    """First normal and reversed second one of the latter, shape (b, 2, 3)."""
    single: Bools
    """Whether both of the latter's contacts have these normals alone, shape (b,)."""

    @classmethod
    def of_contacts(cls, contacts: Contacts) -> "PairLines":
        """The lines of grasps with one normal at each contact, shape (b, 2)."""
        rows = np.arange(2 * len(contacts.points))
        return cls.of_sets(
            contacts.points, rows, np.ones_like(rows), contacts.normals.reshape(-1, 3),
            contacts.normals,
        )  # fmt: skip

    @classmethod
    def of_sets(
        cls, points: Floats, start: Ints, counts: Ints, set_normals: Floats, normals: Floats
    ) -> "PairLines":
        """The lines of grasps with sets of normals.

        Args:
            points: Contacts (b, 2, 3).
            start: First row of each contact's set in `set_normals` (2 b,).
            counts: Number of its normals, 0: every direction (2 b,).
            set_normals: Inward unit normals (K, 3).
            normals: The middle of each set (b, 2, 3).
        """
        angles = np.empty((2, len(points), 2))
        lines, openings = np.empty((len(points), 3)), np.empty(len(points))
        pair_angles(
            np.array(points), np.array(start), np.array(counts), np.array(set_normals), angles[0],
            angles[1], lines, openings,
        )  # fmt: skip
        return cls(
            openings=openings,
            openings_best=openings,
            angles=angles,
            angles_best=angles,
            lines=lines,
            normals=normals * np.array([1.0, -1.0])[:, None],
            single=np.asarray((counts == 1).reshape(-1, 2).all(axis=1)),
        )

    def with_best_at(self, rows: Ints, best: "PairLines") -> "PairLines":
        """These lines, of grasps with the worst normals, where others have the best normals.

        Args:
            rows: Grasps for which others are best over the best normals, shape (c,).
            best: The lines of these, shape (c,).
        """
        changed = {name: getattr(self, name).copy() for name in _OF_BEST}
        changed["angles_best"][:, rows] = best.angles_best
        for name in _OF_BEST[1:]:
            changed[name][rows] = getattr(best, name)
        return replace(self, **changed)


_OF_BEST = ("angles_best", "openings_best", "lines", "normals", "single")


def located_pairs(
    critical: Floats, critical_best: Floats, lines: PairLines, limits: ContactLimits
) -> tuple[Floats, Floats]:
    """(worst, best) located angles of grasps with two contacts [rad], shape (b,) each.

    Args:
        critical: Critical angles over the worst normals [rad], inf: no grasp, shape (b,).
        critical_best: The same over the best normals, shape (b,).
        lines: Of the same grasps.
        limits: What is known about the contacts.
    """
    angles = np.empty((2, len(critical)))
    # The worse a contact is known, the more is added to its angle.
    worst_extras = limits.inner.max(axis=1, keepdims=True) - limits.inner
    lift = limits.inner.max(axis=1)
    locate_pairs(
        # Copies: read-only arrays would be compiled for once more.
        np.array(critical), np.array(critical_best), lines.openings,
        lines.openings_best, lines.angles, lines.angles_best, lines.lines, lines.normals,
        lines.single, np.ascontiguousarray(limits.location.sum(axis=1)), worst_extras,
        np.ascontiguousarray(limits.outer), angles[0], angles[1],
    )  # fmt: skip
    angles[0] -= lift
    return angles[0], angles[1]


def located_contacts(
    contacts: Contacts, critical: Floats, limits: ContactLimits
) -> tuple[Floats, Floats]:
    """(worst, best) located angles of grasps with one normal at each contact, shape (b,) each.

    Args:
        contacts: The contacts, shape (b, n).
        critical: Their critical friction angles [rad], shape (b,).
        limits: What is known about the contacts.
    """
    if contacts.count == 2:
        return located_pairs(critical, critical, PairLines.of_contacts(contacts), limits)
    return located_grasps(contacts, critical, limits)


def located_grasps(
    contacts: Contacts, critical: Floats, limits: ContactLimits
) -> tuple[Floats, Floats]:
    """(worst, best) located angles of grasps of three contacts and more [rad], shape (b,) each.

    Args:
        contacts: The contacts, shape (b, n), with one normal each.
        critical: Their critical friction angles [rad], shape (b,).
        limits: What is known about the contacts.
    """
    if limits.uniform:
        return critical, critical
    problem = Contacts(contacts.points, contacts.normals, friction=0.0), critical, limits
    return _smallest_sure(*problem), _largest_excluded(*problem)


def _smallest_sure(contacts: Contacts, critical: Floats, limits: ContactLimits) -> Floats:
    """Smallest friction angles from which grasps are surely force-closed, by bisection."""
    low = np.clip(critical - limits.inner.max(axis=1), 0.0, RIGHT_ANGLE)
    high = np.full(len(critical), RIGHT_ANGLE)
    while (active := np.flatnonzero(high - low > TOLERANCE)).size:
        middle = 0.5 * (low[active] + high[active])
        sure = _surely_closed(contacts.take(active), middle, limits.take(active))
        high[active] = np.where(sure, middle, high[active])
        low[active] = np.where(sure, low[active], middle)
    return high


def _surely_closed(contacts: Contacts, angles: Floats, limits: ContactLimits) -> Bools:
    """Whether grasps are force-closed at all positions, cones of `angles` plus `inner`."""
    offsets = np.minimum(angles[:, None] + limits.inner, RIGHT_ANGLE - TOLERANCE)
    errors = np.broadcast_to(limits.location, offsets.shape)
    largest = errors.max(axis=1)
    if not largest.any():
        return np.asarray(force_closure(contacts, cone_offset=offsets).closed)
    relative = np.where(largest[:, None] > 0.0, errors / np.maximum(largest, 1e-300)[:, None], 1.0)
    allowed = location_tolerance(contacts, relative_errors=relative, cone_offset=offsets)
    return np.asarray(allowed > largest)


def _largest_excluded(contacts: Contacts, critical: Floats, limits: ContactLimits) -> Floats:
    """Largest friction angles at which grasps are surely not force-closed.

    A direction u that separates the perceived grasp also separates those with other locations while
    the angles between u's velocities and the normals stay large enough: the velocity at a contact
    changes by at most the location error times the angular velocity.
    """
    proven = np.zeros(len(critical))
    open_ = np.flatnonzero(critical > TOLERANCE)
    for fraction in PROVING:
        angles = np.minimum(fraction * critical[open_], RIGHT_ANGLE) - 0.1 * TOLERANCE
        offsets = np.broadcast_to(angles[:, None], (len(open_), contacts.count))
        grasps = contacts.take(open_)
        closure = force_closure(grasps, cone_offset=offsets)
        u = closure.certificate.direction
        separated = _separated(grasps, u, limits.take(open_))
        proven[open_] = np.maximum(proven[open_], np.where(closure.closed, 0.0, separated))
    return np.clip(proven, 0.0, None)


def _separated(contacts: Contacts, directions: Floats, limits: ContactLimits) -> Floats:
    """Friction angles up to which directions (b, 6) separate grasps at all positions."""
    turning = directions[:, None, 3:]
    velocities = directions[:, None, :3] + np.cross(turning, contacts.points)  # (b, n, 3)
    speeds = np.linalg.norm(velocities, axis=2)
    change = limits.location * np.linalg.norm(turning, axis=2)
    with np.errstate(divide="ignore", invalid="ignore"):
        turned = np.arcsin(np.minimum(change / speeds, 1.0))
    # A velocity that may vanish or point anywhere separates nothing.
    turned = np.where(change < speeds, turned, math.pi)
    angles = angles_between(velocities, contacts.normals) - turned + limits.outer
    return np.asarray(angles.min(axis=1) - RIGHT_ANGLE)
