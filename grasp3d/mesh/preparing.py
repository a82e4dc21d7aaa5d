"""Preparation of an ObjectMesh from any source: read, check, repair, refine."""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Any, get_args

import numpy as np

from grasp3d.arrays import Floats, locked, short_repr
from grasp3d.errors import SettingError
from grasp3d.mesh.measures import Triangles, rounding_of, surface_extent
from grasp3d.mesh.mesh_sources import MeshSource, check_surface, read_source
from grasp3d.mesh.normals import corner_normals
from grasp3d.mesh.object_mesh import MeshReport, ObjectMesh, scale_of, unknown_unit
from grasp3d.mesh.plausible_units import impossible_size, unit_warning
from grasp3d.mesh.refinement import check_refinement, longest_edge, refine
from grasp3d.mesh.region import restricted
from grasp3d.mesh.repair.work import MOST_ROUNDING, RepairedSurface, repair_surface
from grasp3d.reading.sources import RawMesh
from grasp3d.settings import MeshOptions
from grasp3d.settings.units import Unit, with_units
from grasp3d.system.limited_reading import Limits, in_limits
from grasp3d.system.names import printable

OUTSIDE = 1e-6
"""Distance from the bounding box, as a fraction of the size, from which a point is outside it."""

FAR = 100.0
"""Distance of a centre of mass from the object, in its sizes, that cannot be meant."""

SECONDS = 120.0
"""Time to repair a mesh, or to divide its edges, where reading is limited [s]; 4 s are usual for
300,000 faces."""

MEMORY = 4e9
"""Memory for the same [bytes]."""

FLAT_VOLUME = 1e-9
"""Volume, as a fraction of the size cubed, below which a closed surface encloses none."""


@dataclass(frozen=True, eq=False)
class PreparedMesh:
    """A mesh, and the surfaces that it was made of."""

    given: RawMesh
    """As it was read."""
    repaired: RepairedSurface
    """Repaired, before long edges are divided; in the file's coordinates."""
    mesh: ObjectMesh

    __repr__ = short_repr


def load_mesh(source: MeshSource, options: MeshOptions | None = None, **fields: Any) -> ObjectMesh:
    """Read a mesh, and prepare its surface for contacts.

    The source's own vertices keep their order and come first. Nothing is moved; where the unit is
    known, positions are in metres.

    Args:
        source: A path (STL, OBJ, PLY, OFF, GLB, glTF, 3MF, ...), a trimesh `Trimesh` or `Scene`, a
            PyVista `PolyData`, an Open3D `TriangleMesh`, a pair (vertices, faces) of arrays of
            shapes (V, 3) and (F, 3), or an `ObjectMesh`; see `MeshSource`. An `ObjectMesh` is
            returned as it is; with other options than its own, its surface is prepared again,
            without removing vertices that were added to divide edges. Only the region may change
            without that: then it keeps its vertices.
        options: How the mesh is read and prepared; None: the defaults.
        fields: Fields of `MeshOptions` that differ from `options`: unit, max_edge, crease_angle,
            repair, center_of_mass, region, max_memory.

    Returns:
        The mesh, with a report of what was read, repaired and doubtful in `report`. Positions are
        in the source's frame, in metres if its unit is known, and normals point into the object.

    Raises:
        MeshError: The file is missing, damaged, too large, of an unknown format, or contains no
            surface; or the object is no mesh.
        SettingError: An option is outside its range; or a length has a unit, but that of the mesh
            is not known.

    Example:
        A cube of 40 mm as arrays, and as an object of trimesh:

        >>> import numpy as np
        >>> import trimesh
        >>> import grasp3d
        >>> cube = trimesh.creation.box([40.0, 40.0, 40.0])
        >>> mesh = grasp3d.load_mesh((cube.vertices, cube.faces), unit="mm")
        >>> mesh.report.source, mesh.file_unit, mesh.report.closed
        ('arrays', 'mm', True)
        >>> print(f"{mesh.volume:.2g}, {mesh.file_vertices} of {len(mesh.vertices):,} vertices")
        6.4e-05, 8 of 6,146 vertices
        >>> coarse = grasp3d.load_mesh(cube, max_edge=20.0)
        >>> coarse.report.source, coarse.unit, len(coarse.vertices)
        ('trimesh.Trimesh', None, 50)

        Contacts on one end alone:

        >>> end = grasp3d.load_mesh(coarse, region="box:15,-20,-20,20,20,20")
        >>> len(end.contact_faces), round(end.allowed_fraction, 3)
        (16, 0.278)
    """
    if isinstance(source, ObjectMesh) and source.unit is None:
        unit = MeshOptions.of(options, fields).unit
        source = source if unit is None else source.with_unit(unit)
    own = source.options if isinstance(source, ObjectMesh) else None
    settings = MeshOptions.of(options or own, fields)
    if isinstance(source, ObjectMesh):
        if settings == own:
            return source
        if replace(settings, region=source.options.region) == own:
            return restricted(source, settings)
    return prepare(source, settings).mesh


def prepare(source: MeshSource | RawMesh, options: MeshOptions) -> PreparedMesh:
    """Prepare a mesh, as `load_mesh` does, and keep the surfaces that it was made of.

    Args:
        source: As in `load_mesh`; an `ObjectMesh` is prepared again; or a mesh that was read.
        options: How the mesh is read and prepared.

    Raises:
        MeshError: For the same reasons as in `load_mesh`.
        SettingError: A length has a unit, but that of the mesh is not known; or the centre of mass
            is far away.
    """
    mesh = read_source(source)
    check_unit(mesh, options)
    repaired = repair_given(mesh, options)
    return PreparedMesh(mesh, repaired, refined_mesh(mesh, repaired, options))


def check_unit(
    mesh: RawMesh, options: MeshOptions, *settings: object, needed_by: str | None = None
) -> None:
    """Ask for the unit of a surface, before any work, where it must be known and is not.

    Args:
        mesh: The surface as it was read.
        options: How it is prepared; they may state the unit.
        settings: Further settings.
        needed_by: Whatever else needs it, as the beginning of a sentence; None: nothing.

    Raises:
        SettingError: A length in them has a unit, or it is needed, but it is not known.
        MeshError: It is not a surface.
    """
    if mesh.unit is None and options.unit is None:
        every = (options, *settings)
        lengths = (f"{name} is {one}" for each in every for name, one in with_units("", each))
        if what := needed_by or next(lengths, None):
            check_surface(mesh, options.max_memory)
            extents = np.ptp(mesh.vertices[mesh.faces].reshape(-1, 3), axis=0)
            raise unknown_unit(what, mesh.name, float(extents.max()))


def repair_given(mesh: RawMesh, options: MeshOptions) -> RepairedSurface:
    """Check and repair a surface.

    Args:
        mesh: The surface.
        options: How much is repaired, and how large it may be.

    Raises:
        MeshError: It is not a surface, or too large.
        FileUnreadError: Reading is limited, and repair exceeds a limit.
    """
    check_surface(mesh, options.max_memory)
    limits = Limits(
        SECONDS,
        MEMORY,
        f"{mesh.where}: repairing it",
        "mend it in a CAD program, or give --repair none",
    )
    arguments = mesh.vertices, mesh.faces, options.repair, mesh.where
    return in_limits(limits, repair_surface, *arguments)


def refined_mesh(source: RawMesh, repaired: RepairedSurface, options: MeshOptions) -> ObjectMesh:
    """Make the mesh of a repaired surface: contact normals, refinement, mass properties.

    Args:
        source: The surface as it was read.
        repaired: The repaired surface.
        options: Longest edge, crease angle, unit and memory limit.

    Raises:
        MeshError: It would become too large.
        SettingError: A length has a unit, but that of the mesh is not known; or the centre of mass
            is far away.
    """
    unit = options.unit or source.unit
    metres = scale_of(unit)
    error = rounding_of(source.vertices)
    center, size = surface_extent(repaired.vertices, repaired.faces)
    surface = Triangles((repaired.vertices - center) / size, repaired.faces)
    normals = corner_normals(surface, options.crease_angle)
    edge = longest_edge(options, metres * size)
    check_refinement(surface, edge, options.max_memory, source.where)
    rounding = min(error / size, MOST_ROUNDING)
    limits = Limits(
        SECONDS,
        MEMORY,
        f"{source.where}: dividing its long edges",
        "give a longer max_edge (--max-edge)",
    )
    refined, normals = in_limits(limits, refine, surface, normals, edge, rounding)
    center_mass, volume = center_and_volume(surface, closed=repaired.closed)
    warnings = [
        *_surface_warnings(repaired, volume, given=options.center_of_mass is not None),
        *_size_warnings(source, metres * size / metres, unit),
    ]
    if options.center_of_mass is not None:
        center_mass = (np.array(options.center_of_mass) / metres - center) / size
        _check_distance(center_mass, source.where)
    warnings += _center_warnings(surface, center_mass, given=options.center_of_mass is not None)
    added = np.arange(len(repaired.vertices), len(refined.vertices))
    points = np.concatenate([repaired.vertices, refined.vertices[added] * size + center])
    mesh = ObjectMesh(
        vertices=locked(points * metres),
        file_points=locked(points),
        faces=locked(refined.faces),
        canonical=locked(np.concatenate([repaired.canonical, added])),
        file_vertices=len(source.vertices),
        corner_normals=normals.locked(),
        center=locked(center * metres),
        size=size * metres,
        center_mass=locked((center_mass * size + center) * metres),
        volume=volume * (size * metres) ** 3,
        options=options,
        report=MeshReport(
            source=source.name,
            format=source.format,
            unit=unit,
            file_vertices=len(source.vertices),
            file_faces=len(source.faces),
            vertices=len(refined.vertices),
            faces=len(refined.faces),
            bodies=repaired.bodies,
            closed=repaired.closed,
            center_mass_from=center_mass_from(options, volume),
            repairs=repaired.steps,
            warnings=(*warnings, *repaired.warnings),
        ),
    )
    return restricted(mesh, options)


def center_mass_from(options: MeshOptions, volume: float) -> str:
    """What the centre of mass follows from, as `MeshReport.center_mass_from`."""
    if options.center_of_mass is not None:
        return "given"
    return "surface" if math.isnan(volume) else "volume"


def center_and_volume(surface: Triangles, *, closed: bool) -> tuple[Floats, float]:
    """Centre of mass and volume of a surface in the normalised frame; 0 and nan if it is open."""
    if closed:
        volume = float(surface.volumes.sum())
        if volume > FLAT_VOLUME:
            corners = surface.vertices[surface.faces].sum(axis=1) / 4.0
            return (surface.volumes[:, None] * corners).sum(axis=0) / volume, volume
    return np.zeros(3), math.nan


def _surface_warnings(surface: RepairedSurface, volume: float, *, given: bool) -> Iterator[str]:
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


def _size_warnings(raw: RawMesh, size: float, unit: Unit | None) -> Iterator[str]:
    """Warn about a doubtful unit, and a size that no object to grasp has.

    Args:
        raw: The surface as it was read, with the unit that it states.
        size: The object's size, in the file's coordinates.
        unit: Their unit; None: unknown.
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


def _check_distance(center_mass: Floats, where: str) -> None:
    """Refuse a given centre of mass, in the normalised frame, that cannot be meant.

    Raises:
        SettingError: It is far away.
    """
    away = float(np.linalg.norm(center_mass))
    if not away <= FAR:
        raise SettingError(
            f"center_of_mass is {away:.3g} times the object's size away from {where}: give it in "
            "the mesh's frame, with its unit (10mm,0,-2mm)"
        )


def _center_warnings(surface: Triangles, center_mass: Floats, *, given: bool) -> Iterator[str]:
    """Warn about a centre of mass outside the surface's bounding box, in the normalised frame."""
    points = surface.vertices[surface.used]
    low, high = points.min(axis=0), points.max(axis=0)
    beyond = float(np.maximum(low - center_mass, center_mass - high).max())
    if beyond > OUTSIDE:
        reason = (
            "is it in the mesh's frame? Lengths without a unit are in metres"
            if given
            else "the surface crosses itself, and is inside out beyond; mend it, or give the "
            "centre of mass (--center-of-mass)"
        )
        yield (
            f"the centre of mass is outside the object's bounding box by {beyond:.3g} of its "
            f"size: {reason}"
        )
