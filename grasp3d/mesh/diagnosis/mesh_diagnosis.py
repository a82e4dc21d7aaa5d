"""Result of a mesh diagnosis."""

from dataclasses import dataclass
from enum import StrEnum

from grasp3d.mesh.repair import RepairStep
from grasp3d.mesh.units import UnitGuess
from grasp3d.settings.costs import Cost
from grasp3d.settings.lengths import Unit


class Trust(StrEnum):
    """Whether labels of a mesh can be trusted."""

    YES = "yes"
    CARE = "with care"
    """Some labels may be wrong; the warnings give the reasons."""
    NO = "no"
    """Many labels may be wrong."""


@dataclass(frozen=True)
class MeshWarning:
    """A defect of a mesh that can make its labels wrong."""

    trust: Trust
    """Whether labels can be trusted despite the defect."""
    message: str
    """The defect and its remedy, in one sentence."""


@dataclass(frozen=True)
class SurfaceMeasures:
    """Counts, area, volume and centre of mass of a surface."""

    vertices: int
    """Vertices that faces use; vertices at equal positions count once."""
    faces: int
    closed: bool
    """Every edge is used equally often in both directions: the faces enclose a volume."""
    boundary_edges: int
    """Edges with one face: the boundaries of holes."""
    crowded_edges: int
    """Edges with more than two faces, where the surface is not a manifold."""
    area: float
    volume: float | None
    """Enclosed volume, negative if the faces are oriented inward; None: the surface is open."""
    center_mass: tuple[float, float, float]
    """Centre of mass at uniform density; of an open surface, the centroid of its area."""


@dataclass(frozen=True)
class MeshDiagnosis:
    """Diagnosis of a mesh; lengths are in the file's unit, angles in radians."""

    mesh: str
    """Name of the file, the type of another library's object, or 'arrays'."""
    format: str
    """File suffix without its dot, in lower case; else the other library, or 'arrays'."""
    file_bytes: int | None
    """Size of the file; None: the mesh is not from a file."""
    unit: Unit | None
    """Unit stated by the file or the user; None: not stated."""
    guess: UnitGuess
    """Unit that the size suggests; never applied."""
    size: float
    """Diameter of the ball around the surface."""
    extents: tuple[float, float, float]
    """Edge lengths of the axis-aligned bounding box."""
    bodies: int
    """Connected parts after repair, without cavities."""
    cavities: int
    """Closed parts that are oriented inward."""
    before: SurfaceMeasures
    """The surface as it was given."""
    after: SurfaceMeasures
    """The surface after repair, before long edges are divided."""
    repairs: tuple[RepairStep, ...]
    manifold: str
    """Status of the repaired surface in the library Manifold: NoError, NotManifold, ..."""
    crossing_faces: int
    """Faces that certainly intersect others; faces that only touch are not counted."""
    self_intersecting_fraction: float
    """Area fraction of these faces."""
    noise: float
    """Median error of contact normals due to the roughness of the surface [rad]."""
    label_vertices: int
    """Number of vertices to label, after long edges are divided."""
    cost: Cost
    """Expected time and memory of labelling."""
    warnings: tuple[MeshWarning, ...]
    """Defects that can make its labels wrong."""

    @property
    def trust(self) -> Trust:
        """Whether its labels can be trusted: the lowest trust of all warnings."""
        return max(
            (warning.trust for warning in self.warnings), key=list(Trust).index, default=Trust.YES
        )

    @property
    def center_shift(self) -> float:
        """Distance by which repair moves the centre of mass, as a fraction of the size."""
        moved = zip(self.before.center_mass, self.after.center_mass, strict=True)
        return float(sum((a - b) ** 2 for a, b in moved) ** 0.5 / self.size)
