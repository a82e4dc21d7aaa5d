"""Counts with their nouns, and numbers, for messages."""

SINGULARS = {
    "bodies": "body", "meshes": "mesh", "sealed cavities": "sealed cavity", "vertices": "vertex",
}  # fmt: skip
"""Singulars of plurals, if they are not the plural without its s."""


def counted(count: int, things: str) -> str:
    """Count with its noun, which is given in the plural: `2 faces`, `1 face`."""
    return f"{count:,} {noun(count, things)}"


def noun(count: int, things: str) -> str:
    """The given plural, or its singular for a count of one."""
    return things if count != 1 else SINGULARS.get(things, things.removesuffix("s"))


def short_number(value: float) -> str:
    """Three digits of a number, and all of a large one before the point: `0.369`, `25`, `1,230`."""
    return f"{value:,.0f}" if 999.5 <= abs(value) < 1e9 else f"{value + 0.0:.3g}"  # 0, not -0
