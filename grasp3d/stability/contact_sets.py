"""Labels of grasps of any numbers of contacts, whose normals are known to within different angles.

A hand touches with as many links as it happens to, and these may have different sensors.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from grasp3d.arrays import Bools, Bytes, Floats, Ints, locked, short_repr
from grasp3d.contact.contacts import Contacts
from grasp3d.quality.closure import force_closure
from grasp3d.quality.ferrari_canny import epsilon_with
from grasp3d.quality.wrenches import EpsilonOptions
from grasp3d.settings import MAX_FINGERS
from grasp3d.stability.classification import Uncertain
from grasp3d.stability.label import Label
from grasp3d.stability.normal_sets import NormalSets, WorstAndBest
from grasp3d.stability.uncertain_angles import uncertain_angles


@dataclass(frozen=True, eq=False, kw_only=True)
class ContactSets:
    """Contacts of k grasps, of any numbers, by ascending grasp."""

    size: int
    """Number of grasps k."""
    row: Ints
    """Grasp of each contact, shape (c,)."""
    points: Floats
    """Relative to the centre of mass [m], shape (c, 3)."""
    normals: Floats
    """Perceived unit normals into the object, shape (c, 3)."""
    location_error: float = 0.0
    """Largest distance between true and perceived points [m]."""
    turns: Floats | None = None
    """How far the surface turns within it at each contact [rad], shape (c,); None: locations are
    exact."""

    __repr__ = short_repr

    @cached_property
    def counts(self) -> Ints:
        """Number of contacts of each grasp, shape (k,)."""
        return np.bincount(self.row, minlength=self.size)

    @property
    def evaluated(self) -> Bools:
        """Whether a grasp has 2 to `MAX_FINGERS` contacts, shape (k,)."""
        return np.asarray((self.counts >= 2) & (self.counts <= MAX_FINGERS))

    def groups(self) -> Iterator[tuple[Ints, Ints]]:
        """Grasps that are evaluated, by their number of contacts.

        Yields:
            Their numbers, shape (b,), and their contacts, shape (b, n).
        """
        start = np.cumsum(self.counts) - self.counts
        for count in np.unique(self.counts[self.evaluated]):
            grasps = np.flatnonzero(self.counts == count)
            yield grasps, start[grasps, None] + np.arange(count)

    def contacts(self, index: Ints, friction: float = 0.5, torsion_radius: float = 0.0) -> Contacts:
        """Contacts of grasps of equal numbers.

        Args:
            index: Their contacts, shape (b, n).
            friction: Coulomb coefficient.
            torsion_radius: [m].
        """
        return Contacts(self.points[index], self.normals[index], friction, torsion_radius)

    @cached_property
    def critical_angles(self) -> WorstAndBest:
        """Critical friction angles at the worst and the best locations [rad], shape (k,) each.

        nan where a grasp is not evaluated.
        """
        worst, best = np.full((2, self.size), math.nan)
        for grasps, index in self.groups():
            contacts, turns = self.contacts(index), self.turns
            worst[grasps], best[grasps] = uncertain_angles(
                contacts.points,
                NormalSets.of_contacts(contacts, {}),
                location=None if turns is None else np.full(index.shape, self.location_error),
                turns=None if turns is None else turns[index],
            )
        return locked(worst), locked(best)

    def tilts(self, tilt: Floats) -> Floats:
        """Largest angles between true and perceived normals at the true locations [rad], (c,).

        Args:
            tilt: The same at the perceived ones, shape (c,).
        """
        return tilt if self.turns is None else tilt + self.turns

    @cached_property
    def rank(self) -> Ints:
        """Dimension of the span of the wrenches, shape (k,); 0 where a grasp is not evaluated."""
        ranks = np.zeros(self.size, dtype=np.int64)
        for grasps, index in self.groups():
            ranks[grasps] = force_closure(self.contacts(index)).rank
        return locked(ranks)

    def epsilon(
        self, options: EpsilonOptions, *, friction: float, torsion_radius: float = 0.0
    ) -> Floats:
        """Epsilon at the perceived normals, certified from below, shape (k,); nan as above.

        Args:
            options: Cones, actuation, torque scale and accuracy.
            friction: As in `contacts`.
            torsion_radius: As in `contacts`.
        """
        values = np.full(self.size, math.nan)
        for grasps, index in self.groups():
            contacts = self.contacts(index, friction, torsion_radius)
            values[grasps] = epsilon_with(contacts, options).lower
        return locked(values)


class SetLabels(NamedTuple):
    """Labels of `ContactSets`, and how sure they are."""

    label: Bytes
    """`Label` codes, shape (k,). U where there are fewer than two contacts, M where there are more
    than `MAX_FINGERS`, of which nothing is computed."""
    margin: Floats
    """Angle by which the grasp is S [rad], shape (k,): S where it is above 0; nan: fewer than two
    contacts or too many."""


def label_sets(sets: ContactSets, tilt: Floats, friction_angles: tuple[float, float]) -> SetLabels:
    """Label grasps whose links have different sensors, as `classify` does.

    Args:
        sets: The contacts.
        tilt: Largest angle between the true and the perceived normal, at one location [rad],
            shape (c,).
        friction_angles: At the smallest and at the largest friction [rad].

    Example:
        Three fingers around a disc, of which one knows its normal within 40 degrees, the others
        within 1 degree:

        >>> import numpy as np
        >>> from grasp3d.stability.contact_sets import ContactSets, label_sets
        >>> angle = np.radians([0.0, 120.0, 240.0])
        >>> points = np.stack([np.cos(angle), np.sin(angle), np.zeros(3)], axis=1)
        >>> sets = ContactSets(size=1, row=np.zeros(3, int), points=points, normals=-points)
        >>> beta = np.arctan(0.8)
        >>> label_sets(sets, np.array([0.02, 0.02, 0.02]), (beta, beta)).label.tolist()
        [2]
        >>> label_sets(sets, np.array([0.02, 0.02, 0.7]), (beta, beta)).label.tolist()
        [1]
    """
    least, largest = map(math.tan, friction_angles)
    label = np.where(sets.counts < 2, Label.U, Label.M).astype(np.uint8)
    margin = np.full(sets.size, math.nan)
    for grasps, index in sets.groups():
        low = sets.contacts(index, least)
        found = Uncertain(
            contacts=low,
            tilt=sets.tilts(tilt)[index],
            low=low,
            high=low.with_friction(largest),
            location=np.full(index.shape, sets.location_error),
        )
        label[grasps], margin[grasps] = found.labels(), found.margin()
    return SetLabels(locked(label), locked(margin))
