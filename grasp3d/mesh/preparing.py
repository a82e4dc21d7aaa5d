"""From a file or arrays to an ObjectMesh: clean, orient, weigh, refine."""

import math
from pathlib import Path

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Floats, Ints, locked
from grasp3d.errors import MeshError
from grasp3d.mesh.cleaning import CleanFaces, clean_faces, has_area, rounding_of
from grasp3d.mesh.loading import RawMesh, check_finite, read_mesh
from grasp3d.mesh.normals import CornerNormals, corner_normals, normal_sets
from grasp3d.mesh.object_mesh import MeshReport, ObjectMesh
from grasp3d.mesh.orientation import OrientedFaces, face_areas, orient_faces, signed_volumes
from grasp3d.mesh.refinement import refine
from grasp3d.settings import MeshOptions, Unit

METRES: dict[Unit, float] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
PLAUSIBLE = (0.002, 2.0)
"""Sizes of objects that a hand may hold [m]."""

DEFAULT_EDGE = 1.0 / 32.0
"""Longest edge as a share of the object's size."""

LARGEST = 1e60
"""Largest coordinate, and one over the smallest size, whose powers stay finite."""

MOST_ROUNDING = 1e-6
"""Largest rounding believed, as a share of the size: whole numbers fit in 32 bits as well."""

FLAT_VOLUME = 1e-9
"""Share of size cubed below which a closed surface encloses nothing."""


def load_mesh(
    path: str | Path,
    *,
    unit: Unit | None = None,
    max_edge: float | None = None,
    crease_angle: float = MeshOptions.crease_angle,
) -> ObjectMesh:
    """Read a mesh file and prepare its surface for contacts.

    The file's own vertices keep their order and come first. Nothing is scaled or moved.

    Args:
        path: A file in any format that trimesh reads (STL, OBJ, PLY, OFF, GLB, 3MF, ...).
        unit: Unit of the file's numbers: m, cm, mm or in; None: as the file says, if it does.
        max_edge: Longer edges are divided, in the file's unit; None: 1/32 of the object's size.
        crease_angle: Edges that bend by more keep the normals of both faces [rad].

    Raises:
        MeshError: The file is missing, damaged, of an unknown format, or holds no surface.
        SettingError: An option is outside its range.
    """
    options = MeshOptions(unit=unit, max_edge=max_edge, crease_angle=crease_angle)
    path = Path(path)
    return _prepared(read_mesh(path), options, name=path.name, where=str(path))


def mesh_from_arrays(
    vertices: npt.ArrayLike,
    faces: npt.ArrayLike,
    *,
    unit: Unit | None = None,
    max_edge: float | None = None,
    crease_angle: float = MeshOptions.crease_angle,
) -> ObjectMesh:
    """Prepare a surface given as arrays; the options are those of `load_mesh`.

    Args:
        vertices: Positions (V, 3).
        faces: Indices of the corners (F, 3), counter-clockwise from outside.
        unit: Unit of the positions.
        max_edge: Longest edge kept undivided.
        crease_angle: Largest bend of a smooth edge [rad].

    Raises:
        MeshError: The arrays are no surface.
        SettingError: An option is outside its range.
    """
    options = MeshOptions(unit=unit, max_edge=max_edge, crease_angle=crease_angle)
    points, corners = np.asarray(vertices), np.asarray(faces)
    for name, array, kinds in (("vertices", points, "fiu"), ("faces", corners, "iu")):
        if array.ndim != 2 or array.shape[1] != 3:  # noqa: PLR2004
            raise MeshError(f"{name} must have shape (n, 3); got {array.shape}")
        if array.dtype.kind not in kinds and array.size:
            raise MeshError(f"{name} must be numbers of the right kind; got {array.dtype}")
    return _prepared(
        RawMesh(points.astype(np.float64), corners.astype(np.int64), "arrays", None),
        options,
        name="arrays",
        where="arrays",
    )


def _prepared(raw: RawMesh, options: MeshOptions, *, name: str, where: str) -> ObjectMesh:
    _check_numbers(raw, where)
    clean = clean_faces(raw.vertices, raw.faces)
    if len(clean.faces) == 0:
        raise MeshError(f"{where}: all {len(raw.faces)} faces have collapsed to points or lines")
    center, size = _extent(raw.vertices, clean.faces, where)
    points = (raw.vertices - center) / size
    oriented = orient_faces(points, clean.faces)
    rounding = min(rounding_of(raw.vertices) / size, MOST_ROUNDING)
    solid = has_area(points, oriented.faces, rounding)
    faces = oriented.faces[solid]
    if len(faces) == 0:
        raise MeshError(f"{where}: no face has an area")
    flat = int((~solid).sum())
    normals = corner_normals(points, faces, options.crease_angle)
    edge = DEFAULT_EDGE if options.max_edge is None else options.max_edge / size
    refined = refine(points, faces, normals, edge, rounding)
    added = refined.vertices[len(points) :] * size + center
    vertices = np.concatenate([raw.vertices, added])
    center_mass, volume = _mass(points, oriented)
    unit = options.unit or raw.unit
    report = MeshReport(
        source=name,
        format=raw.format,
        unit=unit,
        file_vertices=len(raw.vertices),
        file_faces=len(raw.faces),
        vertices=len(vertices),
        faces=len(refined.faces),
        bodies=oriented.bodies,
        closed=oriented.closed,
        center_mass_from="surface" if math.isnan(volume) else "volume",
        repairs=_repairs(clean, oriented, flat),
        warnings=_warnings(oriented, volume, size, unit, raw.unit),
    )
    return ObjectMesh(
        vertices=locked(vertices),
        faces=locked(refined.faces),
        canonical=locked(np.concatenate([clean.canonical, np.arange(len(points), len(vertices))])),
        file_vertices=len(points),
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


def _extent(vertices: Floats, faces: Ints, where: str) -> tuple[Floats, float]:
    """Centre and diameter of the surface; both turn and move with the object."""
    largest = float(np.abs(vertices[faces]).max())
    spread = float(np.ptp(vertices[faces].reshape(-1, 3), axis=0).max())
    if largest > LARGEST or 0.0 < spread < 1.0 / LARGEST:
        raise MeshError(
            f"{where}: coordinates up to {largest:.3g} and a size of {spread:.3g} are beyond what "
            f"can be computed with ({1.0 / LARGEST:.0e} to {LARGEST:.0e}); scale the mesh"
        )
    middle = vertices[faces].mean(axis=(0, 1))
    centred = vertices - middle
    area = face_areas(centred, faces)
    if not area.sum() > 0.0:
        raise MeshError(f"{where}: no face has an area")
    offset = (centred[faces].mean(axis=1) * area[:, None]).sum(axis=0) / area.sum()
    radius = np.linalg.norm(vertices[np.unique(faces)] - middle - offset, axis=1).max()
    return middle + offset, float(2.0 * radius)


def _mass(points: Floats, oriented: OrientedFaces) -> tuple[Floats, float]:
    """Centre of mass and volume in the normalised frame; nan and the surface's centre if open."""
    if oriented.closed:
        pieces = signed_volumes(points, oriented.faces)
        volume = float(pieces.sum())
        if volume > FLAT_VOLUME:
            corners = points[oriented.faces].sum(axis=1) / 4.0
            return (pieces[:, None] * corners).sum(axis=0) / volume, volume
    return np.zeros(3), math.nan


def _repairs(clean: CleanFaces, oriented: OrientedFaces, flat: int) -> tuple[str, ...]:
    joined = int((clean.canonical != np.arange(len(clean.canonical))).sum())
    counted = (
        (joined, "vertices joined to an earlier one at the same position"),
        (clean.collapsed, "faces left out: two corners at one place"),
        (clean.repeated, "faces left out: they came twice"),
        (flat, "faces left out: no area"),
        (oriented.filled, "faces added to close holes of three or four edges"),
        (oriented.rewound, "faces turned to agree with their neighbours"),
        (oriented.inverted, "faces turned: they were inside out"),
    )
    return tuple(f"{count} {what}" for count, what in counted if count)


def _warnings(
    oriented: OrientedFaces, volume: float, size: float, unit: Unit | None, declared: Unit | None
) -> tuple[str, ...]:
    warnings = []
    if not oriented.closed:
        warnings.append(
            "the surface is open: inside and outside are taken from the winding of its faces, "
            "and the centre of mass from the surface"
        )
    if oriented.doubled:
        warnings.append(
            f"{oriented.doubled} bodies lie within others and are wound like them: "
            "the volume counts them twice; cavities must be wound inward"
        )
    if oriented.closed and math.isnan(volume):
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
