"""Results of repair: the surface, and a record of each change."""

from dataclasses import dataclass

from grasp3d.arrays import Floats, Ints, short_repr


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
class Solids:
    """The closed bodies of a surface before those that overlap or touch are united.

    In the order of their first vertices. Cavities are parts of the bodies around them.
    """

    volumes: Floats
    """Shape (k,)."""
    centers: Floats
    """Centre of mass of each at uniform density, shape (k, 3)."""

    __repr__ = short_repr


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
    solids: Solids | None = None
    """The bodies of which it was united; None: too many for densities of their own."""

    __repr__ = short_repr
