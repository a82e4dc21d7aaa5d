"""Tables in Markdown."""

from collections.abc import Mapping, Sequence


def table(head: Sequence[str], rows: Sequence[Sequence[str]], *, left: int = 1) -> str:
    """Write a table.

    Args:
        head: Headings.
        rows: Cells, as many in each row as there are headings.
        left: Columns at the left that hold words; the others hold numbers, aligned at the right.
    """
    rule = [":---"] * left + ["---:"] * (len(head) - left)
    return "\n".join(f"| {' | '.join(row)} |" for row in (head, rule, *rows))


def percent(share: float) -> str:
    """Write a share with one decimal."""
    return f"{100.0 * share + 0.0:.1f} %"


def shares(fractions: Mapping[str, float]) -> list[str]:
    """Write the shares S, M and U, a cell each."""
    return [percent(fractions[name]) for name in ("S", "M", "U")]
