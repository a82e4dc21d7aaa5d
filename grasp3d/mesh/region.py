"""Restriction of contacts to a part of a surface: the option `region`, applied to a mesh."""

from dataclasses import replace
from pathlib import Path

import numpy as np

from grasp3d.arrays import Bools, Floats, locked
from grasp3d.errors import SettingError
from grasp3d.mesh.measures import face_areas
from grasp3d.mesh.mesh_files import open_ply, read_elements, read_mesh
from grasp3d.mesh.object_mesh import ObjectMesh
from grasp3d.mesh.sources import find_source
from grasp3d.mesh.surface_points import nearest_surface_points
from grasp3d.settings import MeshOptions
from grasp3d.settings.mesh_options import Box, Mask
from grasp3d.system.limited_reading import read_file
from grasp3d.system.names import printable

ROUNDING = 1e-9
"""Distance from a box, in object sizes, within which a vertex counts as inside."""

OFF_MASK = 1e-2
"""Largest distance of a vertex from the surface of a mask, in object sizes."""

COLORED = 0.2
"""Difference between the channels of a colour above which it is paint, not white or grey."""

HALF = 0.5
"""Scalar above which a vertex is painted, and fraction of paint above which a point is painted."""


def restricted(mesh: ObjectMesh, options: MeshOptions) -> ObjectMesh:
    """Return the same mesh, with contacts only where its options allow them.

    Args:
        mesh: The mesh.
        options: Its options, perhaps with another region.

    Raises:
        SettingError: No face is in the region, or a length has a unit, but that of the mesh is not
            known.
        MeshError: A mask cannot be read.
    """
    mesh.check_units(options)
    mesh, part = replace(mesh, options=options, region=None), options.region
    if part is None:
        return mesh
    if isinstance(part, Box):
        low, high = np.array(part.corners).reshape(2, 3)
        beyond = np.maximum(low - mesh.vertices, mesh.vertices - high)
        inside = (beyond <= ROUNDING * mesh.size).all(axis=1)
    else:
        inside = _on_paint(mesh, part)
    region = np.zeros(len(mesh.vertices), dtype=bool)
    region[mesh.canonical[inside & mesh.on_surface]] = True  # the same at equal positions
    mesh = replace(mesh, region=locked(region[mesh.canonical]))
    if not len(mesh.contact_faces):
        raise SettingError(
            f"{mesh.report.source}: {printable(str(part))} has {int(mesh.allowed.sum()):,} of its "
            f"{len(region):,} vertices, and no face with three of them; {_extent(mesh)}"
        )
    return mesh


def allowed_contacts(mesh: ObjectMesh, points: Floats) -> Bools:
    """Whether all contacts of grasps are in the region, shape (b,).

    Args:
        mesh: The object.
        points: Contacts on or near its surface, (b, n, 3); nan: unknown, which counts as inside.
    """
    inside = np.ones(points.shape[:2], dtype=bool)
    if mesh.region is not None:
        known = np.isfinite(points).all(axis=2)
        part = replace(mesh, faces=locked(mesh.faces[mesh.contact_faces]))
        gaps, whole = (nearest_surface_points(one, points[known])[2] for one in (part, mesh))
        inside[known] = gaps <= whole + ROUNDING * mesh.size
    return np.asarray(inside.all(axis=1))


def _extent(mesh: ObjectMesh) -> str:
    """Where an object lies, for messages."""
    points = mesh.vertices[mesh.faces].reshape(-1, 3)
    low, high = (
        ",".join(map(str, (end(points, axis=0).round(6) + 0.0).tolist()))
        for end in (np.min, np.max)
    )
    return f"the object lies from {low} to {high}{f' {mesh.unit}' if mesh.unit else ''}"


def _on_paint(mesh: ObjectMesh, mask: Mask) -> Bools:
    """Mask of the vertices whose nearest point on a painted surface is painted, shape (V,)."""
    where = printable(str(mask.path))
    raw = read_mesh(mask.path)
    paint = _paint(read_file(_vertex_columns, mask.path), mask.painted, where)
    faces = locked(raw.faces[face_areas(raw.vertices, raw.faces) > 0.0])
    surface = replace(mesh, vertices=raw.vertices * mesh.file_scale, faces=faces)
    used, reach = np.flatnonzero(mesh.on_surface), OFF_MASK * mesh.size
    nearest, _, gaps = nearest_surface_points(surface, mesh.vertices[used], limit=reach)
    if np.isinf(gaps).any():
        raise SettingError(
            f"{where}: is not a mask of {mesh.report.source}, of which vertices are farther than "
            f"{reach:.4g} away from it; {_extent(mesh)}"
        )
    inside = np.zeros(len(mesh.vertices), dtype=bool)
    inside[used] = (paint[faces[nearest.faces]] * nearest.weights).sum(axis=1) > HALF
    return inside


def _vertex_columns(path: Path) -> dict[str, Floats]:
    """Numbers of the vertices of a PLY, by name."""
    columns = read_elements(open_ply(find_source(path)))["vertex"]
    return {name: np.asarray(one, float) for name, one in columns.items() if not np.ndim(one[0])}


def _paint(columns: dict[str, Floats], name: str, where: str) -> Bools:
    """Mask of the vertices of a PLY that are painted.

    Args:
        columns: Numbers of its vertices by name.
        name: Property that marks the paint; empty: the colours do.
        where: Name of the file in errors.
    """
    painted, how = np.zeros(1, dtype=bool), f"with {name} above {HALF:g}"
    if name in columns:
        painted = columns[name] > HALF
    elif not name:
        how = "in a colour other than white, grey and black"
        if columns.keys() >= {"red", "green", "blue"}:
            colors = np.stack([columns[one] for one in ("red", "green", "blue")], axis=1)
            painted = np.ptp(colors, axis=1) > COLORED * (255.0 if colors.max() > 1.0 else 1.0)
    if not painted.any():
        raise SettingError(
            f"{where}: no vertex is painted {how}; its vertices have {', '.join(columns)}: name "
            "one of these after a colon (mask.ply:PROPERTY)"
        )
    return np.asarray(painted)
