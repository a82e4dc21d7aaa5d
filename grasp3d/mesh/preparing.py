"""Preparation of an ObjectMesh from a file or arrays: repair, mass properties, refinement."""

import math
from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, Ints, locked
from grasp3d.costs import check_cost
from grasp3d.errors import MeshError
from grasp3d.mesh.measures import face_areas, rounding_of, signed_volumes
from grasp3d.mesh.normals import CornerNormals, corner_normals, normal_sets
from grasp3d.mesh.object_mesh import MeshReport, ObjectMesh
from grasp3d.mesh.patches import fingertip_normals
from grasp3d.mesh.refinement import refine, refined_faces
from grasp3d.mesh.repair import MOST_ROUNDING, RepairedSurface, repair_surface
from grasp3d.mesh.units import unit_warning
from grasp3d.reading import RawMesh, check_finite, read_mesh
from grasp3d.settings import MeshOptions, Unit
from grasp3d.system.names import printable

DEFAULT_EDGE = 1.0 / 32.0
"""Longest edge as a fraction of the object's size."""

LARGEST = 1e60
"""Largest coordinate, and reciprocal of the smallest size, whose powers stay finite."""

MANY = 1e15
"""Upper bound of estimated face counts, so that they fit an integer."""

FLAT_VOLUME = 1e-9
"""Volume, as a fraction of the size cubed, below which a closed surface encloses none."""


def load_mesh(path: str | Path, options: MeshOptions | None = None, **fields: Any) -> ObjectMesh:
    """Read a mesh file and prepare its surface for contacts.

    The file's own vertices keep their order and come first. Nothing is scaled or moved.

    Args:
        path: A file in any format that is read: STL, OBJ, PLY, OFF, GLB, glTF, 3MF, ...
        options: How the file is read and prepared; None: the defaults.
        fields: Fields of `MeshOptions` that differ from `options`: unit, max_edge, crease_angle,
            repair, patch_radius, max_memory.

    Raises:
        MeshError: The file is missing, damaged, too large, of an unknown format, or contains no
            surface.
        SettingError: An option is outside its range.
    """
    return prepare_file(Path(path), MeshOptions.of(options, fields))


def mesh_from_arrays(
    vertices: ArrayLike,
    faces: ArrayLike,
    options: MeshOptions | None = None,
    **fields: Any,
) -> ObjectMesh:
    """Prepare a surface given as arrays; the options are those of `load_mesh`.

    Args:
        vertices: Positions (V, 3).
        faces: Indices of the corners (F, 3), counter-clockwise from outside.
        options: How the surface is prepared; None: the defaults.
        fields: Fields of `MeshOptions` that differ from `options`.

    Raises:
        MeshError: The arrays are not a surface.
        SettingError: An option is outside its range.
    """
    chosen = MeshOptions.of(options, fields)
    points, corners = np.asarray(vertices), np.asarray(faces)
    for name, array, kinds in (("vertices", points, "fiu"), ("faces", corners, "iu")):
        if array.ndim != 2 or array.shape[1] != 3:
            raise MeshError(f"{name} must have shape (n, 3); got {array.shape}")
        if array.dtype.kind not in kinds and array.size:
            raise MeshError(f"{name} must be numbers of the right kind; got {array.dtype}")
    raw = RawMesh(points.astype(np.float64), corners.astype(np.int64), "arrays", None)
    surface = check_and_repair(raw, chosen, "arrays")
    return refined_mesh(raw, surface, chosen, name="arrays", where="arrays")


def prepare_file(path: Path, options: MeshOptions, *, threads: int | None = None) -> ObjectMesh:
    """Like `load_mesh`, with the options in one object.

    Args:
        path: The file.
        options: How it is read and prepared.
        threads: Threads to use; None: one per processor.
    """
    where = printable(str(path))
    raw = read_mesh(path, max_memory=options.max_memory)
    surface = check_and_repair(raw, options, where)
    return refined_mesh(raw, surface, options, name=path.name, where=where, threads=threads)


def check_and_repair(raw: RawMesh, options: MeshOptions, where: str) -> RepairedSurface:
    """Check and repair a surface read from a file.

    Args:
        raw: Positions and faces.
        options: How much is repaired, and how large it may be.
        where: Its name in errors.

    Raises:
        MeshError: It is not a surface, or too large.
    """
    _check_numbers(raw, where)
    _check_magnitude(raw, where)
    check_cost(len(raw.faces) // 2, options.max_memory, where, "simplify the mesh")
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
    """
    center, size = surface_extent(surface.vertices, surface.faces)
    points = (surface.vertices - center) / size
    normals = corner_normals(points, surface.faces, options.crease_angle)
    edge = DEFAULT_EDGE if options.max_edge is None else options.max_edge / size
    expected = int(min(refined_faces(points, surface.faces, edge), MANY))
    check_cost(expected // 2, options.max_memory, where, "give a longer max_edge (--max-edge)")
    rounding = min(rounding_of(raw.vertices) / size, MOST_ROUNDING)
    refined = refine(points, surface.faces, normals, edge, rounding)
    normals, patch_warnings = fingertip_normals(surface, refined, size, options, threads=threads)
    added = refined.vertices[len(points) :] * size + center
    vertices = np.concatenate([surface.vertices, added])
    center_mass, volume = _mass(points, surface)
    unit = options.unit or raw.unit
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
        center_mass_from="surface" if math.isnan(volume) else "volume",
        repairs=surface.steps,
        warnings=(
            *_warnings(surface, volume, size, unit, raw.unit),
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
    radius = np.linalg.norm(vertices[np.unique(faces)] - middle - offset, axis=1).max()
    return middle + offset, float(2.0 * radius)


def _mass(points: Floats, surface: RepairedSurface) -> tuple[Floats, float]:
    """Centre of mass and volume in the normalised frame; the surface's centre and nan if open."""
    if surface.closed:
        pieces = signed_volumes(points, surface.faces)
        volume = float(pieces.sum())
        if volume > FLAT_VOLUME:
            corners = points[surface.faces].sum(axis=1) / 4.0
            return (pieces[:, None] * corners).sum(axis=0) / volume, volume
    return np.zeros(3), math.nan


def _warnings(
    surface: RepairedSurface,
    volume: float,
    size: float,
    unit: Unit | None,
    declared: Unit | None,
) -> tuple[str, ...]:
    warnings = []
    if not surface.closed:
        warnings.append(
            "the surface is open: inside and outside are taken from the winding of its faces, "
            "and the centre of mass from the surface"
        )
    if surface.closed and math.isnan(volume):
        warnings.append(
            "the surface is closed but encloses no volume; the centre of mass is the surface's"
        )
    if declared not in {None, unit}:
        warnings.append(f"the file states the unit {declared}, but {unit} was requested")
    if unit is not None and (implausible := unit_warning(size, unit)):
        warnings.append(implausible)
    return tuple(warnings)
