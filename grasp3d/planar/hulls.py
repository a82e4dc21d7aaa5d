"""Planar friction cones, their wrenches, and epsilon of two fingers over many normals."""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from grasp3d.arrays import Bools, Floats, Ints, locked
from grasp3d.errors import SettingError
from grasp3d.planar.contacts import Places
from grasp3d.quality.ferrari_canny import epsilon_of_wrenches
from grasp3d.settings import Actuation

MOST_NORMALS = 64
"""Of one contact, in all combinations with those of the other."""

PART = 1 << 16
"""Wrenches in memory at once."""

RANK = 3
"""Dimensions of planar wrenches; fewer is no grasp."""

SAME = 1e-12
"""Normals closer than this are one [rad]."""

Choice = Callable[[float], Floats]
"""From how far a place's normals lie from their middle to the angles to try about it [rad]."""


class Span(NamedTuple):
    """Epsilon and closure of places over several normals, each of shape (k,)."""

    lowest: Floats
    highest: Floats
    every: Bools
    """Whether all combinations close."""
    some: Bools
    """Whether any does."""


@dataclass(frozen=True, eq=False)
class Pairs:
    """One finger with each of others, about the center of mass."""

    fixed: Places
    """One place."""
    places: Places
    """The others (k,)."""
    torque_scale: float
    """Length that torques are divided by [unit]."""
    actuation: Actuation
    """What is at most 1; see `GraspModel`."""
    edges: int
    """Forces of a cone, spread evenly between its two edges."""

    def each(self, choose: Choice, friction_angle: float) -> tuple[Floats, Bools]:
        """Epsilon, 0 where not closed, and closure of every combination of two chosen normals.

        Args:
            choose: The normals, as many at every place.
            friction_angle: Half-angle of the cones [rad].

        Returns:
            Shape (combinations, k), the scanned finger's normals running fastest.
        """
        count = len(choose(0.0)) ** 2
        values = np.zeros((count, len(self.places.points)))
        closed = np.zeros(values.shape, dtype=np.bool_)
        for part, value, closes in self._answers(choose, friction_angle):
            values[:, part], closed[:, part] = value.T, closes.T
        return values, closed

    def over(self, choose: Choice, friction_angle: float) -> Span:
        """The same over all combinations of normals, whose number may differ among places."""
        count = len(self.places.points)
        lowest, highest = np.zeros((2, count))
        every, some = np.zeros((2, count), dtype=np.bool_)
        for part, value, closes in self._answers(choose, friction_angle):
            lowest[part], highest[part] = value.min(axis=1), value.max(axis=1)
            every[part], some[part] = closes.all(axis=1), closes.any(axis=1)
        return Span(locked(lowest), locked(highest), locked(every), locked(some))

    def _answers(
        self, choose: Choice, friction_angle: float
    ) -> Iterator[tuple[Ints, Floats, Bools]]:
        """(which places (m,), epsilon, closed (m, combinations)) of places off the fixed one."""
        index = np.flatnonzero((self.places.points != self.fixed.points).any(axis=1))
        finger = self._rows(self.fixed, np.array([0]), choose, friction_angle)  # (1, k1, e, 3)
        rows = 2 * self.edges + (self.edges**2 if self.actuation == "per_finger" else 0)
        wide = np.round(self.places.half_range[index], 12)  # places at equal corners go together
        for half in np.unique(wide):
            group = index[wide == half]
            step = max(1, PART // (finger.shape[1] * len(choose(float(half))) * rows))
            for start in range(0, len(group), step):
                part = group[start : start + step]
                other = self._rows(self.places, part, choose, friction_angle)  # (m, k2, e, 3)
                value, closed = self._epsilon(finger[:, :, None], other[:, None])
                yield part, value.reshape(len(part), -1), closed.reshape(len(part), -1)

    def _rows(self, places: Places, index: Ints, choose: Choice, beta: float) -> Floats:
        """Wrenches of places of one kind for every normal: force x, y, torque over its scale."""
        offsets = choose(float(places.half_range[index[0]]))
        spread = np.linspace(-beta, beta, self.edges)
        turn = (places.middle[index, None] + offsets)[..., None] + spread  # (m, k, e)
        force = np.stack([np.cos(turn), np.sin(turn)])
        x, y = places.points[index].T[..., None, None] / self.torque_scale
        return np.stack([*force, x * force[1] - y * force[0]], axis=-1)

    def _epsilon(self, first: Floats, second: Floats) -> tuple[Floats, Bools]:
        """Of wrenches of two fingers (..., e, 3), with axes to broadcast."""
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
    """The two normals that lie farthest apart, the counter-clockwise one first.

    Args:
        half_range: How far the normals of the place lie from their middle [rad].
        tilt: How far each may turn, alpha / 2 [rad].

    Returns:
        Angles about the middle [rad], shape (2,).
    """
    return np.array([half_range + tilt, -half_range - tilt])


def face_normals(half_range: float) -> Floats:
    """The normals on both sides of a place and the bisecting one; of a smooth place its normal."""
    return np.array([-half_range, 0.0, half_range]) if half_range > SAME else np.zeros(1)


def tested_normals(half_range: float, tilt: float, friction_angle: float, *, rings: bool) -> Floats:
    """Normals that are tested where the sensor cannot tell them apart.

    Wan & Howe 2018, Sec. III and IV: those on either side of the place with their rims, and the
    bisecting one. With rings there are more between them, so that none of all normals is farther
    than the friction angle from a tested one.

    Args:
        half_range: How far the normals of the place lie from their middle [rad].
        tilt: How far each may turn, alpha / 2 [rad].
        friction_angle: Half-angle of the friction cone, beta [rad].
        rings: Whether gaps of more than 2 beta are filled.

    Returns:
        Angles about the middle [rad], ascending, shape (k,).

    Raises:
        SettingError: The rings would need too many.
    """
    rims = [side * half_range + turn for side in (-1, 1) for turn in (-tilt, 0.0, tilt)]
    known: Floats = np.sort(np.array([*rims, 0.0]))
    known = known[np.concatenate([[True], np.diff(known) > SAME])]
    if not rings:
        return known
    parts = np.ceil(np.diff(known) / (2.0 * friction_angle) - SAME)
    needed = int(parts.sum()) + 1
    if needed > MOST_NORMALS:
        raise SettingError(
            f"to leave no gap between friction cones of {math.degrees(friction_angle):.3g} "
            f"degrees, {needed} normals of a contact would have to be tested, more than "
            f"{MOST_NORMALS}; scan with rings=False, or use the exact label"
        )
    filled = [
        np.linspace(start, end, int(count), endpoint=False)
        for start, end, count in zip(known, known[1:], parts, strict=False)
    ]
    return np.concatenate([*filled, known[-1:]])
