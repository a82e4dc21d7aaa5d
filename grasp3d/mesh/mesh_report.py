"""The report of a mesh: what a file contained, how it was repaired, and what is doubtful."""

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import get_args

from grasp3d.mesh.repair import RepairedSurface, RepairStep
from grasp3d.mesh.units import impossible_size, unit_warning
from grasp3d.reading import RawMesh
from grasp3d.settings.lengths import Unit
from grasp3d.system.names import printable


@dataclass(frozen=True)
class MeshReport:
    """What a mesh file contained and how it was repaired."""

    source: str
    """Name of the file, the type of another library's object ('trimesh.Trimesh'), or 'arrays'."""
    format: str
    """Suffix of the file, name of the other library ('trimesh'), or 'arrays'."""
    unit: Unit | None
    """Unit of positions and openings; None if neither the file nor the user states it."""
    file_vertices: int
    file_faces: int
    vertices: int
    """Vertices after refinement, the file's own included."""
    faces: int
    """Faces after cleaning and refinement."""
    bodies: int
    closed: bool
    """Whether the faces bound a volume: equally many run along every edge in both directions."""
    center_mass_from: str
    """'volume' (uniform density) or, if the mesh is open, 'surface'; 'given', or 'densities'."""
    repairs: tuple[RepairStep, ...]
    """What was changed; one sentence each as text."""
    warnings: tuple[str, ...]
    """What may make the labels wrong, one sentence each."""


def surface_warnings(surface: RepairedSurface, volume: float, *, given: bool) -> Iterator[str]:
    """Warn about a surface without an inside.

    Args:
        surface: The repaired surface.
        volume: Its volume; nan: none.
        given: Whether the centre of mass is given.
    """
    if not surface.closed:
        yield (
            "the surface is open: inside and outside are taken from the winding of its faces"
            f"{'' if given else ', and the centre of mass from the surface'}"
        )
    elif math.isnan(volume):
        center = "" if given else "; the centre of mass is the surface's"
        yield f"the surface is closed but encloses no volume{center}"


def size_warnings(raw: RawMesh, size: float, unit: Unit | None) -> Iterator[str]:
    """Warn about a doubtful unit, and a size that no object to grasp has.

    Args:
        raw: The surface as it was read, with the unit that it states.
        size: The object's size, in the mesh's unit.
        unit: The mesh's unit; None: unknown.
    """
    if raw.unit not in {None, unit}:
        yield f"the mesh states the unit {raw.unit}, but {unit} was requested"
    if raw.unknown_unit and unit is None:
        yield (
            f"the mesh states the unit {printable(raw.unknown_unit)!r}, which is none of "
            f"{', '.join(get_args(Unit))}: its unit is taken as not stated (--unit)"
        )
    implausible = impossible_size(size, unit) or (unit and unit_warning(size, unit))
    if implausible:
        yield implausible
