"""Diagnosis of a mesh file, before and after repair, with warnings about its labels."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.arrays import Floats, Ints, first_at_position
from grasp3d.costs import labelling_cost
from grasp3d.diagnosis.length_warnings import length_warnings
from grasp3d.diagnosis.mesh_diagnosis import MeshDiagnosis, MeshWarning, SurfaceMeasures, Trust
from grasp3d.diagnosis.mesh_warnings import (
    body_warnings,
    count_parts,
    hole_warnings,
    interior_warnings,
    missing_fraction,
    noise_warnings,
    self_intersection_warnings,
    stray_warnings,
)
from grasp3d.mesh.manifolds import manifold_status
from grasp3d.mesh.measures import (
    edge_counts,
    face_areas,
    is_closed,
    signed_volumes,
)
from grasp3d.mesh.noise import normal_noise
from grasp3d.mesh.object_mesh import ObjectMesh
from grasp3d.mesh.preparing import check_and_repair, refined_mesh
from grasp3d.mesh.repair import RepairedSurface
from grasp3d.mesh.repair.cleaning import is_face
from grasp3d.mesh.self_intersections import crossings
from grasp3d.mesh.units import guess_unit
from grasp3d.reading import RawMesh, read_mesh
from grasp3d.settings import GraspModel, MeshOptions, Sampling
from grasp3d.system.names import printable
from grasp3d.system.processors import available_processors


def check_mesh(
    path: str | Path,
    *,
    model: GraspModel | None = None,
    sampling: Sampling | None = None,
    options: MeshOptions | None = None,
    **fields: Any,
) -> MeshDiagnosis:
    """Diagnose a mesh file before labelling: defects, repairs, and the cost of labelling.

    Args:
        path: The file.
        model: Model for labelling; used for the cost, and to find lengths in a wrong unit.
        sampling: Settings of the grasp search; used in the same way.
        options: How the file is read and prepared; None: the defaults.
        fields: Fields of `MeshOptions` that differ from `options`, as in `load_mesh`.

    Raises:
        MeshError: The file cannot be read, for the same reasons as in `load_mesh`.
        SettingError: An option is outside its range.
    """
    chosen = MeshOptions.of(options, fields)
    return diagnose(Path(path), model or GraspModel(), sampling or Sampling(), chosen)


def diagnose(
    path: Path, model: GraspModel, sampling: Sampling, options: MeshOptions
) -> MeshDiagnosis:
    """Diagnose a mesh file, as `check_mesh` does, with all settings given."""
    where = printable(str(path))
    raw = read_mesh(path, max_memory=options.max_memory)
    surface = check_and_repair(raw, options, where)
    mesh = refined_mesh(raw, surface, options, name=path.name, where=where)
    points = (surface.vertices - mesh.center) / mesh.size
    crossing = crossings(points, surface.faces)
    areas = face_areas(points, surface.faces)
    fraction = float(areas[crossing.faces].sum() / areas.sum())
    noise = normal_noise(points, surface.faces)
    bodies, cavities = count_parts(points, surface.faces)
    warnings = (
        *(MeshWarning(Trust.CARE, message) for message in mesh.report.warnings),
        *interior_warnings(mesh),
        *_hole_warnings(raw, surface, options, where),
        *self_intersection_warnings(int(crossing.faces.sum()), fraction),
        *body_warnings(bodies),
        *stray_warnings(points, surface.faces),
        *noise_warnings(points, surface.faces, mesh, noise),
        *(
            MeshWarning(Trust.CARE, message)
            for message in length_warnings(mesh.size, mesh.unit, model, sampling, options)
        ),
    )
    corners = surface.vertices[surface.faces].reshape(-1, 3)
    extents = np.ptp(corners, axis=0).tolist()
    return MeshDiagnosis(
        mesh=path.name,
        format=raw.format,
        file_bytes=path.stat().st_size,
        unit=mesh.unit,
        guess=guess_unit(max(extents)),
        size=mesh.size,
        extents=(extents[0], extents[1], extents[2]),
        bodies=bodies,
        cavities=cavities,
        before=_measure_file(raw, mesh),
        after=_measure(points, surface.faces, mesh),
        repairs=surface.steps,
        manifold=manifold_status(points, surface.faces),
        crossing_faces=int(crossing.faces.sum()),
        self_intersecting_fraction=fraction,
        noise=noise,
        label_vertices=len(mesh.vertices),
        cost=labelling_cost(len(mesh.vertices), model, sampling, threads=available_processors()),
        warnings=warnings,
    )


def _measure_file(raw: RawMesh, mesh: ObjectMesh) -> SurfaceMeasures:
    """Measure the surface as stored in the file, with vertices at equal positions merged."""
    points = (raw.vertices - mesh.center) / mesh.size
    return _measure(points, first_at_position(raw.vertices)[raw.faces], mesh)


def _measure(points: Floats, faces: Ints, mesh: ObjectMesh) -> SurfaceMeasures:
    """Measure a surface; `points` are in the mesh's normalised frame, shape (V, 3)."""
    count, faces = len(faces), faces[is_face(faces)]
    areas, pieces = face_areas(points, faces), signed_volumes(points, faces)
    closed, volume = is_closed(faces), float(pieces.sum())
    corners = points[faces]
    center = (areas[:, None] * corners.mean(axis=1)).sum(axis=0) / areas.sum()
    if closed and volume:
        center = (pieces[:, None] * corners.sum(axis=1)).sum(axis=0) / (4.0 * volume)
    boundary, nonmanifold = edge_counts(faces)
    x, y, z = mesh.from_normalized(center).tolist()
    return SurfaceMeasures(
        vertices=len(np.unique(faces)),
        faces=count,
        closed=closed,
        boundary_edges=boundary,
        crowded_edges=nonmanifold,
        area=float(areas.sum()) * mesh.size**2,
        volume=volume * mesh.size**3 if closed else None,
        center_mass=(x, y, z),
    )


def _hole_warnings(
    raw: RawMesh, surface: RepairedSurface, options: MeshOptions, where: str
) -> Iterator[MeshWarning]:
    """Warn about holes, open or closed by repair."""
    filled = any(step.name == "closed" for step in surface.steps)
    if filled:
        surface = check_and_repair(raw, replace(options, repair="safe"), where)
    yield from hole_warnings(*missing_fraction(surface.vertices, surface.faces), filled=filled)
