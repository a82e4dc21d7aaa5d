"""Results of repair: the surface, and a record of each change."""

from dataclasses import dataclass

from grasp3d.arrays import Floats, Ints, short_repr

SINGULARS = {"bodies": "body", "sealed cavities": "sealed cavity", "vertices": "vertex"}
"""Singulars of plurals, if they are not the plural without its s."""


def counted(count: int, things: str) -> str:
    """Count with its noun, which is given in the plural: `2 faces`, `1 face`."""
    return f"{count} {noun(count, things)}"


def noun(count: int, things: str) -> str:
    """The given plural, or its singular for a count of one."""
    return things if count != 1 else SINGULARS.get(things, things.removesuffix("s"))


@dataclass(frozen=True)
class RepairStep:
    """One kind of change, and how often it was made."""

    name: str
    """Identifier of the change: welded, collapsed, repeated, ..."""
    count: int
    """Number of vertices, faces or bodies that were changed."""
    message: str
    """Description of the change, to be read after the count."""

    def __str__(self) -> str:
        """Count and message in one sentence."""
        return f"{self.count} {self.message}"


@dataclass(frozen=True, eq=False)
class RepairedSurface:
    """A repaired surface over the given vertices."""

    vertices: Floats
    """Positions (V', 3): the given ones, unmoved and in their order, then added ones."""
    faces: Ints
    """Faces (F', 3), counter-clockwise from outside as far as that can be determined."""
    canonical: Ints
    """Canonical vertex of each vertex, shape (V',); faces use canonical vertices only."""
    closed: bool
    """Whether the faces bound a volume: equally many run along every edge in both directions."""
    bodies: int
    """Number of connected components."""
    steps: tuple[RepairStep, ...]
    """What was changed."""
    warnings: tuple[str, ...]
    """What could not be repaired, one sentence each."""

    __repr__ = short_repr
