"""Planar wrench hulls: epsilon of two fingers over combinations of normals."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from grasp3d.arrays import Bools, Floats, Ints, locked
from grasp3d.errors import SettingError
from grasp3d.planar.contacts import OutlineContacts
from grasp3d.quality.ferrari_canny import epsilon_of_wrenches
from grasp3d.settings.grasp_model import Actuation

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

    def each_combination(self, choose: NormalChoice, friction_angle: float) -> tuple[Floats, Bools]:
        """Epsilon, 0 where not force-closed, and closure of every combination of chosen normals.

        Args:
            choose: The normals, equally many at every contact.
            friction_angle: Half-angle of the cones [rad].

        Returns:
            Shape (combinations, k), the scanned finger's normals running fastest.
        """
        count = len(choose(0.0)) ** 2
        values = np.zeros((count, len(self.others.points)))
        closed = np.zeros(values.shape, dtype=np.bool_)
        for part, value, part_closed in self._evaluate(choose, friction_angle):
            values[:, part], closed[:, part] = value.T, part_closed.T
        return values, closed

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
        found = epsilon_of_wrenches(np.concatenate(rows, axis=-2))
        closed = found.closed & (found.rank == RANK)
        return np.where(closed, found.value, 0.0), closed


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
