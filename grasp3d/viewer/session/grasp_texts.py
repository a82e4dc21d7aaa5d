"""Numbers of one grasp as they are listed: angles, margin and budget; force and payload."""

import math
from dataclasses import dataclass

from grasp3d.grasps.explanations import PAIR, Case
from grasp3d.quality.grip_forces import Resistance
from grasp3d.stability.thresholds import margin_budget
from grasp3d.surface.holding import Holding
from grasp3d.surface.load_case import LoadCase
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


@dataclass(frozen=True)
class HeldGrasp:
    """Force and payload of one grasp under a load."""

    load: LoadCase
    grip_force: float
    """[N]; inf: none suffices; nan: no grasp."""
    least: float
    largest: float
    payload: float
    """[kg]; nan: no force at hand, or a task without a mass."""
    fingers: int
    resistance: Resistance | None
    """Why no force suffices; None: unknown."""

    @classmethod
    def of(cls, holding: Holding, row: int, fingers: int) -> "HeldGrasp":
        """Force and payload of one of several grasps."""
        numbers = (
            holding.grip_force, holding.grip_force_least, holding.grip_force_largest,
            holding.payload,
        )  # fmt: skip
        force, least, largest, payload = (float(values[row]) for values in numbers)
        codes = holding.resistance
        resistance = None if codes is None else Resistance(int(codes[row]))
        return cls(holding.case, force, least, largest, payload, fingers, resistance)

    def numbers(self) -> list[tuple[str, str]]:
        """Names and values that a load adds."""
        if math.isnan(self.grip_force):
            return []
        numbers = [("grip force", self._text(self.grip_force))]
        if self.largest > self.grip_force * (1.0 + ALIKE):
            numbers.append(("at worst normals", self._text(self.largest)))
        if math.isfinite(self.payload):
            numbers.append(("payload", f"{short_number(self.payload)} kg with {self.load.at_hand}"))
        return numbers

    def _text(self, force: float) -> str:
        if math.isinf(force):
            return "none suffices"
        return f"{short_number(force)} N{'' if self.load.decided else ' per kg'}"

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
        mass = f" of {self.load.to_hold}" if self.load.by_mass else ""
        start = f"With {self.load.at_hand} the load{mass} is"
        if self.largest <= available:
            return f"{start} held at all normals within the sensor resolution."
        if self.least > available:
            return f"{start} not held at any of these normals."
        return f"{start} held at some of the normals within the sensor resolution only."

    def _why(self) -> str:
        if self.resistance == Resistance.NO_SUCH_WRENCH:
            if self.fingers == PAIR and self.load.hard:
                return (
                    "two hard fingers cannot resist a torque about the line through them; give a "
                    "torsion radius, or a gripper, whose pads have one"
                )
            return "these contacts resist no torque about one axis"
        return "the fingers can only push, and the contacts cannot push against all of the load"
