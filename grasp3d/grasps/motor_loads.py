"""What the motors of a hand with joints hold at given poses."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import RIGHT_ANGLE, Bools, Bytes, Floats, locked, short_repr
from grasp3d.contact.contacts import Contacts
from grasp3d.hand.articulated.articulated_hand import ArticulatedHand, actuation_of
from grasp3d.hand.articulated.plausible_numbers import too_strong
from grasp3d.quality.hand_forces.hand_grasp import HandGrasp
from grasp3d.quality.hand_forces.payloads import (
    OF_LINE,
    OF_LINKS,
    HandPayload,
    hand_payload,
    links_weigh,
)
from grasp3d.stability.contact_sets import ContactSets
from grasp3d.stability.label import Label
from grasp3d.surface.load_case import LoadCase
from grasp3d.system.context import report_progress
from grasp3d.system.counts import short_number

FORCE_RTOL = 1e-2
"""Width of the brackets of payloads, relative to them."""

WHY = {
    OF_LINKS: "the weight of the links alone is too much for the motors",
    OF_LINE: "point contacts on one line leave the turn about it free",
}
"""Limits with which nothing is held, as sentences."""

UNKNOWN = HandPayload(math.nan, math.nan, "")
"""Of a pose that is no grasp."""

FLAT = 1e-3
"""Angle by which cones must be narrower than a half-space [rad]."""


@dataclass(frozen=True, eq=False, kw_only=True)
class MotorLoads:
    """What the motors of a hand hold at each of k poses: masses [kg], or factors of wrenches."""

    case: LoadCase
    hand: ArticulatedHand
    torques: Floats
    """As `torques_of` has them, shape (p,)."""
    friction: tuple[float, float]
    """The smallest coefficient, which counts for what is sure, and the largest one."""
    sets: ContactSets
    jacobians: Floats
    """Of the contacts, in the mesh's frame [m], shape (c, 3, p)."""
    tilts: Floats
    """Largest angle between true and perceived normals [rad], shape (c,)."""
    postures: Floats
    """Shape (k, p)."""
    link_loads: Floats | None = None
    """Torques that hold the links per acceleration of gravity, in the mesh's frame [kg m], shape
    (k, p, 3); None: no link has a known mass."""

    __repr__ = short_repr

    def held(self, chosen: Bools, angles: Floats, tilts: Floats | None = None) -> list[HandPayload]:
        """What is held at each pose, `UNKNOWN` at those that are not chosen.

        Args:
            chosen: Shape (k,).
            angles: Half-angles of the friction cones of the contacts [rad], shape (c,).
            tilts: Largest angles between true and given normals [rad], shape (c,); None: 0.
        """
        sets, found = self.sets, [UNKNOWN] * self.sets.size
        for row in np.flatnonzero(chosen).tolist():
            own = slice(*np.searchsorted(sets.row, [row, row + 1]))
            contacts = Contacts(sets.points[own], sets.normals[own], np.tan(angles[own]))
            links = None if self.link_loads is None else self.link_loads[row]
            actuation = actuation_of(self.hand, self.postures[row], self.torques, links)
            grasp = HandGrasp(contacts, self.jacobians[own], actuation)
            tilt = 0.0 if tilts is None else tilts[own]
            found[row] = hand_payload(grasp, self.case.task, tilt=tilt, rtol=FORCE_RTOL)
            report_progress((row + 1) / sets.size)
        return found

    def _angles(self, friction: float) -> Floats:
        """Half-angles of the friction cones [rad], shape (c,)."""
        return np.full(len(self.tilts), math.atan(friction))

    @cached_property
    def _sure(self) -> list[HandPayload]:
        return self.held(self.sets.evaluated, self._angles(self.friction[0]), self.tilts)

    @cached_property
    def payload(self) -> Floats:
        """Largest masses that are surely held, at the worst normals, shape (k,); nan: no grasp."""
        return locked([one.lower for one in self._sure])

    @cached_property
    def limit(self) -> npt.NDArray[np.str_]:
        """What limits them, such as a joint, shape (k,)."""
        return np.array([one.limit for one in self._sure], dtype=np.str_)

    @cached_property
    def payload_most(self) -> Floats:
        """Masses above which no normals, of those that may be true, let the hand hold, (k,).

        The cones of all of them are within beta + a, so one of these masses need not be held at any
        one of the normals. nan where it is not known, or does not matter: the mass is surely held.
        """
        angles = self._angles(self.friction[1]) + self.tilts
        chosen = self.payload < self._mass
        chosen[self.sets.row[angles >= RIGHT_ANGLE - FLAT]] = False
        return locked([one.upper for one in self.held(chosen, angles)])

    @property
    def doubts(self) -> Iterator[str]:
        """Torques of the load that are hardly true, one sentence each."""
        hand, stated = self.hand, self.case.load.torque_limits or 0.0
        driven = np.array(hand.joint_names)[~np.isnan(self.torques)].tolist()
        yield from too_strong(hand, "torque_limits", dict.fromkeys(driven, stated))

    @property
    def link_weights(self) -> str:
        """Whether the weight of the hand's links counts, in one sentence."""
        hand = self.hand
        moving = [name for name in hand.beyond_base if hand.shapes[hand.link_names.index(name)]]
        known = [name for name in hand.beyond_base if name in hand.masses]
        if self.link_loads is None:
            return "the weight of the links is neglected: no masses of links are stated"
        if not links_weigh(self.case.task):
            return "the weight of the links is neglected: the task does not say where gravity acts"
        total = short_number(sum(hand.masses[name].mass for name in known))
        missing = sorted({*moving} - {*known})
        but = f", but not of {', '.join(missing[:5])}, which state no mass" if missing else ""
        return f"the weight of the links that move, {total} kg, counts{but}"

    @property
    def _mass(self) -> float:
        """What must be held, nan: it is not known."""
        mass = self.case.mass if self.case.by_mass else 1.0
        return math.nan if mass is None else mass

    @cached_property
    def load_fraction(self) -> Floats:
        """Mass over what is surely held, shape (k,): above 1 it is not; nan: no mass is known."""
        with np.errstate(divide="ignore"):
            return locked(self._mass / self.payload)

    def label(self, codes: Bytes) -> Bytes:
        """Labels that take the load into account, shape (k,), where its mass is known.

        A grasp is S if the motors hold the mass at the worst normals, too, and U if they do not at
        any that may be true.

        Args:
            codes: Those without a load, shape (k,).
        """
        if math.isnan(self._mass):
            return codes
        most = np.where(self.payload >= self._mass, Label.S, Label.M)
        most[self.payload_most < self._mass] = Label.U
        return locked(np.minimum(codes, most), np.uint8)

    @property
    def unit(self) -> str:
        """Unit of the masses, with a space; of wrenches alone what their factors are."""
        return " kg" if self.case.by_mass else " times the wrenches"

    def shortfall(self, row: int) -> str:
        """Why the mass is not surely held at a pose, in one sentence."""
        most, sure = self.payload_most[row], self.payload[row]
        why = f": {WHY[cause]}" if (cause := str(self.limit[row])) in WHY else ""
        if most < self._mass:
            return f"holds {short_number(most)}{self.unit} at most{why}"
        return f"surely holds {short_number(sure)}{self.unit} only{why}"
