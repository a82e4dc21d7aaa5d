"""What repair hands over: a surface, and the record of each change."""

from dataclasses import dataclass

from grasp3d.arrays import Floats, Ints

SINGULARS = {"bodies": "body", "sealed cavities": "sealed cavity", "vertices": "vertex"}
"""What one of some things is called, if that is more than to leave out an s."""


def counted(count: int, things: str) -> str:
    """Write how many things there are, which are given in the plural: `2 faces`, `1 face`."""
    return f"{count} {noun(count, things)}"


def noun(count: int, things: str) -> str:
    """Choose between the plural that is given and its singular."""
    return things if count != 1 else SINGULARS.get(things, things.removesuffix("s"))


@dataclass(frozen=True)
class RepairStep:
    """One kind of change, and how often it was made."""

    name: str
    """What was done, in one word for programs: welded, collapsed, repeated, ..."""
    count: int
    """Vertices, faces or bodies that were changed."""
    message: str
    """What was done, to be read after the count."""

    def __str__(self) -> str:
        """Say it in one sentence."""
        return f"{self.count} {self.message}"


@dataclass(frozen=True, eq=False)
class RepairedSurface:
    """A surface to put contacts on, over the vertices that were given."""

    vertices: Floats
    """Positions (V', 3): those that were given, unmoved and in their order, then added ones."""
    faces: Ints
    """Faces (F', 3), counter-clockwise from outside as far as that can be message."""
    canonical: Ints
    """For every vertex the one that stands for it, shape (V',); faces use no others."""
    closed: bool
    """Every edge is passed as often one way as the other: the faces bound a volume."""
    bodies: int
    """Connected parts."""
    steps: tuple[RepairStep, ...]
    """What was changed."""
    warnings: tuple[str, ...]
    """What was not, a sentence each."""
