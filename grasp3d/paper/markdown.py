"""Tables in Markdown."""

import math
from collections.abc import Mapping, Sequence

from grasp3d.settings import GraspModel


def table(head: Sequence[str], rows: Sequence[Sequence[str]], *, left: int = 1) -> str:
    """Write a table.

    Args:
        head: Headings.
        rows: Cells, as many in each row as there are headings.
        left: Number of left-aligned columns of text; the others are right-aligned numbers.
    """
    rule = [":---"] * left + ["---:"] * (len(head) - left)
    return "\n".join(f"| {' | '.join(row)} |" for row in (head, rule, *rows))


def percent(fraction: float) -> str:
    """Write a fraction in percent with one decimal."""
    return f"{100.0 * fraction + 0.0:.1f} %"


def fraction_cells(fractions: Mapping[str, float]) -> list[str]:
    """Write the fractions S, M and U, one cell each."""
    return [percent(fractions[name]) for name in ("S", "M", "U")]


def resolution_cell(model: GraspModel) -> str:
    """Write the resolution of a model in degrees."""
    return f"{math.degrees(model.sensor_resolution):.4g}°"
