"""Preparation of an ObjectMesh from any source: repair, mass properties, refinement."""

import math
from pathlib import Path
from typing import Any, get_args

import numpy as np

from grasp3d.arrays import Floats, Ints, locked, used_indices
from grasp3d.costs import check_cost
from grasp3d.errors import MeshError, SettingError
from grasp3d.mesh.measures import face_areas, rounding_of, signed_volumes
from grasp3d.mesh.mesh_sources import GivenMesh, MeshSource, read_source
from grasp3d.mesh.normals import CornerNormals, corner_normals, normal_sets
from grasp3d.mesh.object_mesh import MeshReport, ObjectMesh
from grasp3d.mesh.patches import fingertip_normals
from grasp3d.mesh.refinement import refine, refined_faces
from grasp3d.mesh.repair import MOST_ROUNDING, RepairedSurface, Solids, repair_surface
from grasp3d.mesh.units import impossible_size, unit_warning
from grasp3d.mesh.work_bounds import bounds_of, cell_counts
from grasp3d.reading import RawMesh, check_finite
from grasp3d.settings import MeshOptions
from grasp3d.settings.lengths import Unit, settings_in_unit
from grasp3d.system.names import printable
from grasp3d.system.steps import begin_step

DEFAULT_EDGE = 1.0 / 32.0
"""Longest edge as a fraction of the object's size."""

LARGEST = 1e60
"""Largest coordinate, and reciprocal of the smallest size, whose powers stay finite."""

APART = 1e-5
"""Distance above which vertices are not joined, as a fraction of the size."""

TINY = float(np.finfo(np.float64).tiny)

MANY = 1e15
"""Upper bound of estimated face counts, so that they fit an integer."""

OUTSIDE = 1e-6
"""Distance from the bounding box, as a fraction of the size, from which a point is outside it."""

FAR = 100.0
"""Distance of a centre of mass from the object, in its sizes, that cannot be meant."""

FLAT_VOLUME = 1e-9
"""Volume, as a fraction of the size cubed, below which a closed surface encloses none."""


def load_mesh(source: MeshSource, options: MeshOptions | None = None, **fields: Any) -> ObjectMesh:
    """Read a mesh, and prepare its surface for contacts.

    The source's own vertices keep their order and come first. Nothing is scaled or moved.

    Args:
        source: A path (STL, OBJ, PLY, OFF, GLB, glTF, 3MF, ...), a trimesh `Trimesh` or `Scene`, a
            PyVista `PolyData`, an Open3D `TriangleMesh`, a pair (vertices, faces) of arrays of
            shapes (V, 3) and (F, 3), or an `ObjectMesh`; see `MeshSource`. An `ObjectMesh` is
            returned as it is; with other options than its own, its surface is prepared again,
            without removing vertices that were added to divide edges.
        options: How the mesh is read and prepared; None: the defaults.
        fields: Fields of `MeshOptions` that differ from `options`: unit, max_edge, crease_angle,
            repair, patch_radius, center_of_mass, max_memory.

    Returns:
        The mesh, with a report of what was read, repaired and doubtful in `report`. Positions are
        in the source's own unit and frame, normals point into the object.

    Raises:
        MeshError: The file is missing, damaged, too large, of an unknown format, or contains no
            surface; or the object is no mesh.
        SettingError: An option is outside its range.

    Example:
        A cube of 40 mm as arrays, and as an object of trimesh:

        >>> import trimesh
        >>> import grasp3d
        >>> cube = trimesh.creation.box([40.0, 40.0, 40.0])
        >>> mesh = grasp3d.load_mesh((cube.vertices, cube.faces), unit="mm")
        >>> mesh.report.source, mesh.unit, mesh.report.closed
        ('arrays', 'mm', True)
        >>> print(f"{mesh.volume:.0f}, {mesh.file_vertices} of {len(mesh.vertices):,} vertices")
        64000, 8 of 6,146 vertices
        >>> coarse = grasp3d.load_mesh(cube, max_edge=20.0)
        >>> coarse.report.source, coarse.unit, len(coarse.vertices)
        ('trimesh.Trimesh', None, 50)
    """
    if isinstance(source, ObjectMesh):
        chosen = MeshOptions.of(options or source.options, fields)
        return source if chosen == source.options else _prepared(read_source(source), chosen)
    chosen = MeshOptions.of(options, fields)
    return _prepared(read_source(source, max_memory=chosen.max_memory), chosen)


def prepare_file(path: Path, options: MeshOptions, *, threads: int | None = None) -> ObjectMesh:
    """Like `load_mesh` for a file, with the options in one object.

    Args:
        path: The file.
        options: How it is read and prepared.
        threads: Threads to use; None: one per processor.
    """
    return _prepared(read_source(path, max_memory=options.max_memory), options, threads)


def _prepared(given: GivenMesh, options: MeshOptions, threads: int | None = None) -> ObjectMesh:
    surface = check_and_repair(given.raw, options, given.where)
    return refined_mesh(
        given.raw, surface, options, name=given.name, where=given.where, threads=threads
    )


def check_and_repair(raw: RawMesh, options: MeshOptions, where: str) -> RepairedSurface:
    """Check and repair a surface read from a file.

    Args:
        raw: Positions and faces.
        options: How much is repaired, and how large it may be.
        where: Its name in errors.

    Raises:
        MeshError: It is not a surface, or too large.
    """
    begin_step("repairing the surface")
    _check_numbers(raw, where)
    _check_magnitude(raw, where)
    check_cost(_fewest_vertices(raw), options.max_memory, where, "simplify the mesh")
    with bounds_of(where):
        return repair_surface(raw.vertices, raw.faces, options.repair, where)


def refined_mesh(
    raw: RawMesh,
    surface: RepairedSurface,
    options: MeshOptions,
    *,
    name: str,
    where: str,
    threads: int | None = None,
) -> ObjectMesh:
    """Make the mesh of a repaired surface: mass properties, contact normals, refinement.

    Args:
        raw: The surface as it was read.
        surface: The repaired surface.
        options: Longest edge, crease angle, patch radius, unit and memory limit.
        name: Its name in the report.
        where: Its name in errors.
        threads: Threads to use; None: one per processor.

    Raises:
        MeshError: It would become too large.
        SettingError: A length has a unit, but that of the mesh is not known; or the centre of mass
            is far away.
    """
    begin_step("refining the mesh")
    unit = options.unit or raw.unit
    (options,) = settings_in_unit(unit, options, source=name)
    center, size = surface_extent(surface.vertices, surface.faces)
    points = (surface.vertices - center) / size
    normals = corner_normals(points, surface.faces, options.crease_angle)
    edge = DEFAULT_EDGE if options.max_edge is None else options.max_edge / size
    added = int(min(refined_faces(points, surface.faces, edge), MANY)) - len(surface.faces)
    expected = max(len(used_indices(surface.faces)), len(surface.faces) // 2) + added // 2
    check_cost(expected, options.max_memory, where, "give a longer max_edge (--max-edge)")
    rounding = min(rounding_of(raw.vertices) / size, MOST_ROUNDING)
    with bounds_of(where):
        refined = refine(points, surface.faces, normals, edge, rounding)
    normals, patch_warnings = fingertip_normals(surface, refined, size, options, threads=threads)
    new = refined.vertices[len(points) :] * size + center
    vertices = np.concatenate([surface.vertices, new])
    center_mass, volume = _mass(points, surface)
    given = options.center_of_mass is not None
    if given:
        center_mass = (np.array(options.center_of_mass) - center) / size
        _check_center(center_mass, where)
    report = MeshReport(
        source=name,
        format=raw.format,
        unit=unit,
        file_vertices=len(raw.vertices),
        file_faces=len(raw.faces),
        vertices=len(vertices),
        faces=len(refined.faces),
        bodies=surface.bodies,
        closed=surface.closed,
        center_mass_from="given" if given else "surface" if math.isnan(volume) else "volume",
        repairs=surface.steps,
        warnings=(
            *_warnings(surface, volume, size, unit, raw, given=given),
            *(_center_warnings(points[surface.faces].reshape(-1, 3), center_mass) if given else ()),
            *surface.warnings,
            *patch_warnings,
        ),
    )
    own = np.arange(len(points), len(vertices))
    return ObjectMesh(
        vertices=locked(vertices),
        faces=locked(refined.faces),
        canonical=locked(np.concatenate([surface.canonical, own])),
        file_vertices=len(raw.vertices),
        corner_normals=CornerNormals(
            locked(normals.corners),
            locked(normals.normals),
            locked(normals.vertices),
        ),
        normal_sets=normal_sets(len(vertices), normals),
        center=locked(center),
        size=size,
        center_mass=locked(center_mass * size + center),
        volume=volume * size**3,
        options=options,
        report=report,
        solids=_normalized(surface.solids, center, size),
    )


def _check_numbers(raw: RawMesh, where: str) -> None:
    check_finite(raw.vertices, where)
    if len(raw.faces) == 0:
        raise MeshError(f"{where}: holds no faces")
    outside = (raw.faces < 0) | (raw.faces >= len(raw.vertices))
    if outside.any():
        face = int(np.flatnonzero(outside.any(axis=1))[0])
        raise MeshError(
            f"{where}: face {face} uses vertex {raw.faces[face][outside[face]][0]}, "
            f"but there are {len(raw.vertices)} vertices"
        )


def _check_magnitude(raw: RawMesh, where: str) -> None:
    corners = raw.vertices[raw.faces]
    largest = float(np.abs(corners).max())
    with np.errstate(over="ignore"):  # values that overflow are refused below
        spread = float(np.ptp(corners.reshape(-1, 3), axis=0).max())
    if largest > LARGEST or 0.0 < spread < 1.0 / LARGEST:
        raise MeshError(
            f"{where}: coordinates up to {largest:.3g} and a size of {spread:.3g} are beyond what "
            f"can be computed with ({1.0 / LARGEST:.0e} to {LARGEST:.0e}); scale the mesh"
        )


def surface_extent(vertices: Floats, faces: Ints) -> tuple[Floats, float]:
    """Centre and diameter of a surface; both follow rotations and translations of the object.

    Args:
        vertices: Positions (V, 3).
        faces: Faces (F, 3), at least one with an area.
    """
    middle = vertices[faces].mean(axis=(0, 1))
    centred = vertices - middle
    area = face_areas(centred, faces)
    offset = (centred[faces].mean(axis=1) * area[:, None]).sum(axis=0) / area.sum()
    radius = np.linalg.norm(vertices[used_indices(faces)] - middle - offset, axis=1).max()
    return middle + offset, float(2.0 * radius)


def _fewest_vertices(raw: RawMesh) -> int:
    """Estimate the least number of vertices after repair: those within rounding count once."""
    fewest = len(raw.faces) // 2
    corners = used_indices(raw.faces)
    if len(corners) <= 2 * fewest:
        return fewest
    points = raw.vertices[corners]
    points = (points - points.min(axis=0)) / max(float(np.ptp(points, axis=0).max()), TINY)
    return max(fewest, len(cell_counts(points, APART)))


def _mass(points: Floats, surface: RepairedSurface) -> tuple[Floats, float]:
    """Centre of mass and volume in the normalised frame; the surface's centre and nan if open."""
    if surface.closed:
        pieces = signed_volumes(points, surface.faces)
        volume = float(pieces.sum())
        if volume > FLAT_VOLUME:
            corners = points[surface.faces].sum(axis=1) / 4.0
            return (pieces[:, None] * corners).sum(axis=0) / volume, volume
    return np.zeros(3), math.nan


def _check_center(center_mass: Floats, where: str) -> None:
    """Refuse a centre of mass, in the normalised frame, that cannot be meant."""
    away = float(np.linalg.norm(center_mass))
    if not away <= FAR:
        raise SettingError(
            f"center_of_mass is {away:.3g} times the object's size away from {where}: give it in "
            "the mesh's frame, with its unit if that is another one (10mm,0,-2mm)"
        )


def _center_warnings(points: Floats, center_mass: Floats) -> tuple[str, ...]:
    """A warning if the centre of mass is outside the box around the surface's points (n, 3)."""
    low, high = points.min(axis=0), points.max(axis=0)
    beyond = float(np.maximum(low - center_mass, center_mass - high).max())
    if beyond <= OUTSIDE:
        return ()
    warning = (
        f"the centre of mass is outside the object's bounding box by {beyond:.3g} of its size: is "
        "it in the mesh's unit and frame?"
    )
    return (warning,)


def _normalized(solids: Solids | None, center: Floats, size: float) -> Solids | None:
    """Solids in the normalised frame."""
    if solids is None:
        return None
    return Solids(locked(solids.volumes / size**3), locked((solids.centers - center) / size))


def _warnings(
    surface: RepairedSurface,
    volume: float,
    size: float,
    unit: Unit | None,
    raw: RawMesh,
    *,
    given: bool,
) -> tuple[str, ...]:
    """What may make the labels wrong; `given`: whether the centre of mass is."""
    warnings = []
    if not surface.closed:
        warnings.append(
            "the surface is open: inside and outside are taken from the winding of its faces"
            f"{'' if given else ', and the centre of mass from the surface'}"
        )
    if surface.closed and math.isnan(volume):
        center = "" if given else "; the centre of mass is the surface's"
        warnings.append(f"the surface is closed but encloses no volume{center}")
    if raw.unit not in {None, unit}:
        warnings.append(f"the mesh states the unit {raw.unit}, but {unit} was requested")
    if raw.unknown_unit and unit is None:
        warnings.append(
            f"the mesh states the unit {printable(raw.unknown_unit)!r}, which is none of "
            f"{', '.join(get_args(Unit))}: its unit is taken as not stated (--unit)"
        )
    implausible = impossible_size(size, unit) or (unit and unit_warning(size, unit))
    if implausible:
        warnings.append(implausible)
    return tuple(warnings)
