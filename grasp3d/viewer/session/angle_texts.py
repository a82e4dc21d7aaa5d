"""Critical angles, margin and budget of one grasp, as they are listed."""

import math

from grasp3d.stability.budgets import margin_budget
from grasp3d.viewer.session.explanations import Case

SYMBOLS = {"critical angle": "β*", "sensor resolution": "α/2"}
"""Parts of a budget that have a symbol in the viewer."""


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
