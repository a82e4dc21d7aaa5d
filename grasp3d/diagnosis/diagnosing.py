"""Diagnosis of a mesh, before and after repair, with warnings about its labels."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from grasp3d.arrays import first_at_position
from grasp3d.costs import labelling_cost
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
from grasp3d.errors import SettingError
from grasp3d.mesh.measures import edge_counts, is_closed
from grasp3d.mesh.mesh_sources import MeshSource
from grasp3d.mesh.noise import normal_noise
from grasp3d.mesh.object_mesh import ObjectMesh
from grasp3d.mesh.plausible_lengths import length_warnings, refuse_lengths
from grasp3d.mesh.preparing import PreparedMesh, prepare, repair_given
from grasp3d.mesh.repair.cleaning import is_face
from grasp3d.mesh.repair.solids import manifold_status
from grasp3d.mesh.self_intersections import crossings
from grasp3d.mesh.triangles import Triangles
from grasp3d.mesh.units import guess_unit, impossible_size
from grasp3d.reading import RawMesh
from grasp3d.settings import GraspModel, MeshOptions, Sampling
from grasp3d.system.processors import available_processors


def check_mesh(
    source: MeshSource,
    *,
    model: GraspModel | None = None,
    sampling: Sampling | None = None,
    options: MeshOptions | None = None,
    **fields: Any,
) -> MeshDiagnosis:
    """Diagnose a mesh before labelling: defects, repairs, and the cost of labelling.

    Args:
        source: A path, or an object as in `load_mesh`. An `ObjectMesh`, which is repaired already,
            is diagnosed as it is.
        model: Model for labelling; used for the cost, and to find lengths in a wrong unit.
        sampling: Settings of the grasp search; used in the same way.
        options: How the mesh is read and prepared; None: the defaults.
        fields: Fields of `MeshOptions` that differ from `options`, as in `load_mesh`.

    Returns:
        Measures before and after repair, warnings, whether labels can be trusted, and the time and
        memory that labelling takes. Lengths are in the mesh's unit.

    Raises:
        MeshError: The mesh cannot be read, for the same reasons as in `load_mesh`.
        SettingError: An option is outside its range.

    Example:
        A box of which one of twelve faces is missing:

        >>> import trimesh
        >>> import grasp3d
        >>> box = trimesh.creation.box([0.1, 0.06, 0.04])
        >>> found = grasp3d.check_mesh((box.vertices, box.faces[1:]), unit="m")
        >>> found.before.closed, found.after.closed, found.trust.value
        (False, False, 'with care')
        >>> print(found.warnings[1].message)
        holes: 1, ...: grasps with contacts there are not found; repair full (--repair full) ...
    """
    given = source.options if isinstance(source, ObjectMesh) else None
    chosen = MeshOptions.of(options or given, fields)
    return diagnose(source, model or GraspModel(), sampling or Sampling(), chosen)


def diagnose(
    source: MeshSource,
    model: GraspModel,
    sampling: Sampling,
    options: MeshOptions,
    *,
    force: bool = False,
) -> MeshDiagnosis:
    """Diagnose a mesh, as `check_mesh` does, with all settings given.

    With `force` lengths that cannot be meant for an object of this size are accepted.
    """
    found = prepare(source, options)
    given, repaired, mesh = found.given, found.repaired, found.mesh
    model, sampling = mesh.in_own_unit(model, sampling)
    lengths = model.lengths() | sampling.lengths() | mesh.options.lengths()
    surface = Triangles((repaired.vertices - mesh.center) / mesh.size, repaired.faces)
    crossing = crossings(surface.vertices, surface.faces)
    fraction = float(surface.areas[crossing.faces].sum() / surface.areas.sum())
    noise = normal_noise(surface)
    bodies, cavities = count_parts(surface)
    warnings = (
        *_report_warnings(mesh),
        *interior_warnings(mesh),
        *_hole_warnings(found, options),
        *self_intersection_warnings(int(crossing.faces.sum()), fraction),
        *body_warnings(bodies),
        *stray_warnings(surface),
        *noise_warnings(surface, mesh, noise),
        *_length_warnings(mesh, lengths, force=force),
    )
    corners = repaired.vertices[repaired.faces].reshape(-1, 3)
    extents = np.ptp(corners, axis=0).tolist()
    return MeshDiagnosis(
        mesh=given.name,
        format=given.raw.format,
        file_bytes=given.file_bytes,
        unit=mesh.unit,
        guess=guess_unit(max(extents)),
        size=mesh.size,
        extents=(extents[0], extents[1], extents[2]),
        bodies=bodies,
        cavities=cavities,
        before=_measure_file(given.raw, mesh),
        after=_measure(surface, mesh),
        repairs=repaired.steps,
        manifold=manifold_status(surface.vertices, surface.faces),
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
    return _measure(Triangles(points, first_at_position(raw.vertices)[raw.faces]), mesh)


def _measure(surface: Triangles, mesh: ObjectMesh) -> SurfaceMeasures:
    """Measure a surface in the mesh's normalised frame."""
    count, faces = len(surface.faces), surface.faces[is_face(surface.faces)]
    proper = Triangles(surface.vertices, faces)
    corners, areas = surface.vertices[faces], proper.areas
    closed, volume = is_closed(faces), float(proper.volumes.sum())
    center = (areas[:, None] * corners.mean(axis=1)).sum(axis=0) / areas.sum()
    if closed and volume:
        weighted = proper.volumes[:, None] * corners.sum(axis=1)
        center = weighted.sum(axis=0) / (4.0 * volume)
    boundary, nonmanifold = edge_counts(faces)
    x, y, z = mesh.from_normalized(center).tolist()
    return SurfaceMeasures(
        vertices=len(proper.used),
        faces=count,
        closed=closed,
        boundary_edges=boundary,
        crowded_edges=nonmanifold,
        area=float(areas.sum()) * mesh.size**2,
        volume=volume * mesh.size**3 if closed else None,
        center_mass=(x, y, z),
    )


def _report_warnings(mesh: ObjectMesh) -> Iterator[MeshWarning]:
    """Warnings of the preparation; an object of an impossible size is not the one that is meant."""
    impossible = impossible_size(mesh.size, mesh.unit)
    for message in mesh.report.warnings:
        yield MeshWarning(Trust.NO if message == impossible else Trust.CARE, message)


def _length_warnings(
    mesh: ObjectMesh, lengths: Mapping[str, float | None], *, force: bool
) -> Iterator[MeshWarning]:
    """Warn about lengths that are probably in another unit; some of them cannot be meant."""
    try:
        if not force:
            refuse_lengths(mesh, **lengths)
    except SettingError as error:
        yield MeshWarning(Trust.NO, str(error))
        return
    for message in length_warnings(lengths, mesh.size, mesh.unit):
        yield MeshWarning(Trust.CARE, message)


def _hole_warnings(found: PreparedMesh, options: MeshOptions) -> Iterator[MeshWarning]:
    """Warn about holes, open or closed by repair."""
    repaired = found.repaired
    filled = any(step.name == "closed" for step in repaired.steps)
    if filled:
        repaired = repair_given(found.given, replace(options, repair="safe"))
    surface = Triangles(repaired.vertices, repaired.faces)
    yield from hole_warnings(*missing_fraction(surface), filled=filled)
