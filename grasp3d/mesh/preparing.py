"""From a file or arrays to an ObjectMesh: mend, weigh, refine."""

import math
from pathlib import Path
from typing import Unpack

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Floats, Ints, locked
from grasp3d.errors import MeshError
from grasp3d.mesh.measures import face_areas, rounding_of, signed_volumes
from grasp3d.mesh.normals import CornerNormals, corner_normals, normal_sets
from grasp3d.mesh.object_mesh import MeshReport, ObjectMesh
from grasp3d.mesh.refinement import refine
from grasp3d.mesh.repair import MOST_ROUNDING, RepairedSurface, repair_surface
from grasp3d.reading import RawMesh, check_finite, read_mesh
from grasp3d.settings import MeshKeywords, MeshOptions, Unit

METRES: dict[Unit, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
PLAUSIBLE = (0.002, 2.0)
"""Sizes of objects that a hand may hold [m]."""

DEFAULT_EDGE = 1.0 / 32.0
"""Longest edge as a share of the object's size."""

LARGEST = 1e60
"""Largest coordinate, and one over the smallest size, whose powers stay finite."""

FLAT_VOLUME = 1e-9
"""Share of size cubed below which a closed surface encloses nothing."""


def load_mesh(path: str | Path, **options: Unpack[MeshKeywords]) -> ObjectMesh:
    """Read a mesh file and prepare its surface for contacts.

    The file's own vertices keep their order and come first. Nothing is scaled or moved.

    Args:
        path: A file in any format that is read: STL, OBJ, PLY, OFF, GLB, glTF, 3MF, ...
        options: Fields of `MeshOptions`: unit, max_edge, crease_angle, repair, patch_radius,
            max_memory.

    Raises:
        MeshError: The file is missing, damaged, too large, of an unknown format, or holds no
            surface.
        SettingError: An option is outside its range.
    """
    return prepare_file(Path(path), MeshOptions(**options))


def mesh_from_arrays(
    vertices: npt.ArrayLike, faces: npt.ArrayLike, **options: Unpack[MeshKeywords]
) -> ObjectMesh:
    """Prepare a surface given as arrays; the options are those of `load_mesh`.

    Args:
        vertices: Positions (V, 3).
        faces: Indices of the corners (F, 3), counter-clockwise from outside.
        options: Fields of `MeshOptions`.

    Raises:
        MeshError: The arrays are no surface.
        SettingError: An option is outside its range.
    """
    chosen = MeshOptions(**options)
    points, corners = np.asarray(vertices), np.asarray(faces)
    for name, array, kinds in (("vertices", points, "fiu"), ("faces", corners, "iu")):
        if array.ndim != 2 or array.shape[1] != 3:  # noqa: PLR2004
            raise MeshError(f"{name} must have shape (n, 3); got {array.shape}")
        if array.dtype.kind not in kinds and array.size:
            raise MeshError(f"{name} must be numbers of the right kind; got {array.dtype}")
    raw = RawMesh(points.astype(np.float64), corners.astype(np.int64), "arrays", None)
    return prepare_surface(raw, chosen, name="arrays", where="arrays")


def prepare_file(path: Path, options: MeshOptions) -> ObjectMesh:
    """Do what `load_mesh` does, with options that stand together already."""
    raw = read_mesh(path, max_memory=options.max_memory)
    return prepare_surface(raw, options, name=path.name, where=str(path))


def prepare_surface(raw: RawMesh, options: MeshOptions, *, name: str, where: str) -> ObjectMesh:
    """Prepare a surface as a file has it for contacts.

    Args:
        raw: Positions and faces.
        options: How.
        name: What the report calls it.
        where: What errors call it.

    Raises:
        MeshError: It is no surface.
    """
    _check_numbers(raw, where)
    _check_magnitude(raw, where)
    surface = repair_surface(raw.vertices, raw.faces, options.repair, where)
    center, size = _extent(surface.vertices, surface.faces)
    points = (surface.vertices - center) / size
    normals = corner_normals(points, surface.faces, options.crease_angle)
    edge = DEFAULT_EDGE if options.max_edge is None else options.max_edge / size
    rounding = min(rounding_of(raw.vertices) / size, MOST_ROUNDING)
    refined = refine(points, surface.faces, normals, edge, rounding)
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
        warnings=(*_warnings(surface, volume, size, unit, raw.unit), *surface.warnings),
    )
    own = np.arange(len(points), len(vertices))
    return ObjectMesh(
        vertices=locked(vertices),
        faces=locked(refined.faces),
        canonical=locked(np.concatenate([surface.canonical, own])),
        file_vertices=len(raw.vertices),
        corner_normals=CornerNormals(
            locked(refined.normals.corners),
            locked(refined.normals.normals),
            locked(refined.normals.vertices),
        ),
        normal_sets=normal_sets(len(vertices), refined.normals),
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
    spread = float(np.ptp(corners.reshape(-1, 3), axis=0).max())
    if largest > LARGEST or 0.0 < spread < 1.0 / LARGEST:
        raise MeshError(
            f"{where}: coordinates up to {largest:.3g} and a size of {spread:.3g} are beyond what "
            f"can be computed with ({1.0 / LARGEST:.0e} to {LARGEST:.0e}); scale the mesh"
        )


def _extent(vertices: Floats, faces: Ints) -> tuple[Floats, float]:
    """Centre and diameter of the surface; both turn and move with the object."""
    middle = vertices[faces].mean(axis=(0, 1))
    centred = vertices - middle
    area = face_areas(centred, faces)
    offset = (centred[faces].mean(axis=1) * area[:, None]).sum(axis=0) / area.sum()
    radius = np.linalg.norm(vertices[np.unique(faces)] - middle - offset, axis=1).max()
    return middle + offset, float(2.0 * radius)


def _mass(points: Floats, surface: RepairedSurface) -> tuple[Floats, float]:
    """Centre of mass and volume in the normalised frame; nan and the surface's centre if open."""
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
        warnings.append(f"the file says its unit is {declared}, but {unit} was asked for")
    if unit is not None:
        metres = size * METRES[unit]
        if not PLAUSIBLE[0] <= metres <= PLAUSIBLE[1]:
            warnings.append(
                f"the object is {metres:.3g} m large if its unit is {unit}: "
                "is the unit right? (m, cm, mm, in)"
            )
    return tuple(warnings)
