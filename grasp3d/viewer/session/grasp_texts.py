"""Numbers of one grasp as they are listed: angles, margin and budget; force and payload."""

import math
from dataclasses import dataclass

from grasp3d.arrays import Floats
from grasp3d.grasps.explanations import PAIR, Case
from grasp3d.quality.grip_forces import Resistance
from grasp3d.stability.thresholds import margin_budget
from grasp3d.surface.holding import Holding
from grasp3d.system.counts import short_number

SYMBOLS = {"critical angle": "β*", "sensor resolution": "α/2"}
"""Parts of a budget that have a symbol in the viewer."""


ALIKE = 5e-3
"""Relative difference below which forces are not distinguished."""


def angle_numbers(case: Case) -> list[tuple[str, str]]:
    """Names and values of critical angles, the coarsest resolution and the margin."""
    numbers = [("β*", _critical_angles(*case.angles, "normals"))]
    if case.perceived is not None:
        numbers.append(("located β*", _critical_angles(case.worst, case.best, "points")))
    return [*numbers, ("α*", _max_resolution(case)), ("margin", _margin(case))]


def budget_text(case: Case) -> str:
    """What the friction angle is spent on, as one line; empty where there is no grasp."""
    critical = case.angles[0]
    if not (math.isfinite(critical) and math.isfinite(case.worst)):
        return ""
    located = None if case.perceived is None else case.worst
    budget = margin_budget(case.model, critical, located)
    parts = [
        f"{SYMBOLS.get(name, name)} {_signed(float(angle))}"
        for name, angle in budget.stack.items()
        if float(angle) != 0.0 or name in {"critical angle", "margin"}
    ]
    return f"β {_signed(float(budget.friction_angle))} = {' + '.join(parts)}"


def _critical_angles(worst: float, best: float, of: str) -> str:
    texts = [_signed(angle) for angle in (worst, best)]
    if texts[0] == texts[1]:
        return texts[0]
    return f"{texts[0] if math.isfinite(worst) else 'none'} (worst), {texts[1]} (best {of})"


def _max_resolution(case: Case) -> str:
    """Coarsest resolution of all fingers below which it is S: alpha + 2 margins."""
    coarsest = case.model.sensor_resolution + 2.0 * case.margin
    return _signed(coarsest) if coarsest > 0.0 else "no sensor is fine enough"


def _margin(case: Case) -> str:
    return "none" if math.isinf(case.margin) else _signed(case.margin, always=True)


def _signed(angle: float, *, always: bool = False) -> str:
    """An angle in degrees with a typographic minus sign, and on demand with a plus sign."""
    degrees = round(math.degrees(angle), 1) + 0.0  # never -0
    return f"{degrees:{'+' if always else ''}.1f}°".replace("-", "−")


@dataclass(frozen=True, eq=False)
class HeldGrasp:
    """Force and payload of one of several grasps under a load."""

    holding: Holding
    row: int
    fingers: int

    def numbers(self) -> list[tuple[str, str]]:
        """Names and values that a load adds."""
        holding = self.holding
        force, largest = self._of(holding.grip_force), self._of(holding.grip_force_largest)
        if math.isnan(force):
            return []
        numbers = [("grip force", self._text(force))]
        if largest > force * (1.0 + ALIKE):
            numbers.append(("at worst normals", self._text(largest)))
        if math.isfinite(payload := self._of(holding.payload)):
            numbers.append(("payload", f"{short_number(payload)} kg with {holding.case.at_hand}"))
        return numbers

    def _of(self, values: Floats) -> float:
        return float(values[self.row])

    def _text(self, force: float) -> str:
        if math.isinf(force):
            return "none suffices"
        return f"{short_number(force)} N{'' if self.holding.case.decided else ' per kg'}"

    def sentence(self) -> str:
        """Whether the force at hand holds the load, or why none does; empty: that is unknown."""
        load, least = self.holding.case, self._of(self.holding.grip_force_least)
        if math.isnan(force := self._of(self.holding.grip_force)):
            return ""
        if math.isinf(force):
            where = "" if math.isinf(least) else " at the nominal normals"
            return f"No force holds it{where}: {self._why()}."
        if load.available is None or not load.decided:
            return ""
        mass = f" of {load.to_hold}" if load.by_mass else ""
        start = f"With {load.at_hand} the load{mass} is"
        if self._of(self.holding.grip_force_largest) <= load.available:
            return f"{start} held at all normals within the sensor resolution."
        if least > load.available:
            return f"{start} not held at any of these normals."
        return f"{start} held at some of the normals within the sensor resolution only."

    def _why(self) -> str:
        codes = self.holding.resistance
        if codes is not None and codes[self.row] == Resistance.NO_SUCH_WRENCH:
            if self.fingers == PAIR and self.holding.case.hard:
                return (
                    "two hard fingers cannot resist a torque about the line through them; give a "
                    "torsion radius, or a gripper, whose pads have one"
                )
            return "these contacts resist no torque about one axis"
        return "the fingers can only push, and the contacts cannot push against all of the load"
