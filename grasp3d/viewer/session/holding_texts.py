"""Grip force and payload of one grasp, as they are listed, and why no force suffices."""

import math
from dataclasses import dataclass, replace

from grasp3d.quality.grip_forces import Resistance
from grasp3d.settings import GraspModel
from grasp3d.surface.contacts import SurfaceContacts
from grasp3d.surface.grasp_forces import surface_holding
from grasp3d.surface.load_case import LoadCase
from grasp3d.viewer.session.explanations import PAIR
from grasp3d.viewer.subjects.forces import LoadNumbers

ALIKE = 5e-3
"""Relative difference below which forces are not distinguished."""


@dataclass(frozen=True)
class HeldGrasp:
    """Force and payload of one grasp under a load."""

    load: LoadNumbers
    grip_force: float
    """[N]; inf: none suffices; nan: no grasp."""
    least: float
    largest: float
    payload: float
    """[kg]; nan: no force at hand, or a task without a mass."""
    fingers: int
    hard: bool
    """Whether the fingers resist no torsional moment."""
    resistance: Resistance | None
    """Why no force suffices; None: unknown."""

    def numbers(self) -> list[tuple[str, str]]:
        """Names and values that a load adds."""
        if math.isnan(self.grip_force):
            return []
        found = [("grip force", self._text(self.grip_force))]
        if self.largest > self.grip_force * (1.0 + ALIKE):
            found.append(("at worst normals", self._text(self.largest)))
        if math.isfinite(self.payload):
            found.append(("payload", f"{self.payload:.3g} kg with {self.load.available:.3g} N"))
        return found

    def _text(self, force: float) -> str:
        if math.isinf(force):
            return "none suffices"
        return f"{force:.3g} N{'' if self.load.decided else ' per kg'}"

    def sentence(self) -> str:
        """Whether the force at hand holds the load, or why none does; empty: that is unknown."""
        if math.isnan(self.grip_force):
            return ""
        if math.isinf(self.grip_force):
            where = "" if math.isinf(self.least) else " at the nominal normals"
            return f"No force holds it{where}: {self._why()}."
        available = self.load.available
        if available is None or not self.load.decided:
            return ""
        mass = f" of {self.load.mass:.3g} kg" if self.load.by_mass else ""
        start = f"With {available:.3g} N the load{mass} is"
        if self.largest <= available:
            return f"{start} held at all normals within the sensor resolution."
        if self.least > available:
            return f"{start} not held at any of these normals."
        return f"{start} held at some of the normals within the sensor resolution only."

    def _why(self) -> str:
        if self.resistance == Resistance.NO_SUCH_WRENCH:
            if self.fingers == PAIR and self.hard:
                return (
                    "two hard fingers cannot resist a torque about the line through them; give a "
                    "torsion radius, or a gripper, whose pads have one"
                )
            return "these contacts resist no torque about one axis"
        return "the fingers can only push, and the contacts cannot push against all of the load"


def held_grasp(contacts: SurfaceContacts, model: GraspModel, case: LoadCase) -> HeldGrasp:
    """Force and payload of one grasp, shape (1, n)."""
    found = surface_holding(contacts, replace(model, fingers=contacts.count), case, threads=1)
    numbers = (found.grip_force, found.grip_force_least, found.grip_force_largest, found.payload)
    force, least, largest, payload = (float(values[0]) for values in numbers)
    return HeldGrasp(
        LoadNumbers.of(case), force, least, largest, payload, contacts.count,
        hard=case.hard, resistance=Resistance(int(found.resistance[0])),
    )  # fmt: skip
