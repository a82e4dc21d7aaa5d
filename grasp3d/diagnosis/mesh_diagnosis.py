"""The record of a diagnosis."""

from dataclasses import dataclass
from enum import StrEnum

from grasp3d.costs import Cost
from grasp3d.mesh.repair import RepairStep
from grasp3d.mesh.units import UnitGuess
from grasp3d.settings import Unit


class Trust(StrEnum):
    """Whether labels of a mesh can be trusted."""

    YES = "yes"
    CARE = "with care"
    """Something may spoil some of them; the warnings say what."""
    NO = "no"
    """They would say little about the object."""


@dataclass(frozen=True)
class MeshWarning:
    """Something that speaks against the labels of a mesh."""

    trust: Trust
    """What is left of the trust."""
    message: str
    """What it is and what helps, in a sentence."""


@dataclass(frozen=True)
class Measured:
    """What a surface amounts to."""

    vertices: int
    """Vertices that faces use; those at exactly one position count once."""
    faces: int
    closed: bool
    """Every edge is passed as often one way as the other: the faces bound a volume."""
    boundary_edges: int
    """Edges with one face: the rims of holes."""
    crowded_edges: int
    """Edges with more than two faces, where the surface is no manifold."""
    area: float
    volume: float | None
    """Enclosed volume, negative where the faces look inward; None: the surface is open."""
    center_mass: tuple[float, float, float]
    """Centre of mass at uniform density; of an open surface that of the surface itself."""


@dataclass(frozen=True)
class MeshDiagnosis:
    """What was found in a mesh file; lengths are in the file's unit, angles in radians."""

    mesh: str
    """Name of the file."""
    format: str
    file_bytes: int
    unit: Unit | None
    """As the file or the user says; None: neither does."""
    guess: UnitGuess
    """What the size speaks for; never applied."""
    size: float
    """Diameter of the ball around the surface."""
    extents: tuple[float, float, float]
    bodies: int
    """Connected parts after repair, without cavities."""
    cavities: int
    """Closed parts that are wound inward."""
    before: Measured
    """The surface as the file has it."""
    after: Measured
    """The surface after repair, before long edges are divided."""
    repairs: tuple[RepairStep, ...]
    manifold: str
    """What Manifold says of the repaired surface: NoError, NotManifold, ..."""
    crossing_faces: int
    """Faces that surely cross others; grazing ones are not counted."""
    self_intersecting_fraction: float
    """Their share of the area."""
    noise: float
    """By how much contact normals are off because the surface is rough [rad], a median."""
    label_vertices: int
    """Vertices to label, after long edges are divided."""
    cost: Cost
    """What labelling is expected to take."""
    warnings: tuple[MeshWarning, ...]
    """What speaks against its labels."""

    @property
    def trust(self) -> Trust:
        """Whether its labels can be trusted: the worst of the warnings."""
        return max(
            (warning.trust for warning in self.warnings), key=list(Trust).index, default=Trust.YES
        )

    @property
    def center_shift(self) -> float:
        """How far repair moves the centre of mass, as a share of the size."""
        moved = zip(self.before.center_mass, self.after.center_mass, strict=True)
        return float(sum((a - b) ** 2 for a, b in moved) ** 0.5 / self.size)
