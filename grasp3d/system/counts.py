"""Counts with their nouns, for messages."""

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
