"""The surface of a labelled file as a mesh, without repair."""

import json
import math
from dataclasses import replace
from typing import Any

import numpy as np

from grasp3d.arrays import Floats, Ints, first_at_position, locked
from grasp3d.export.read_settings import FileSettings
from grasp3d.export.stored import Stored
from grasp3d.mesh import MeshReport, ObjectMesh
from grasp3d.mesh.measures import Triangles, is_closed, surface_extent
from grasp3d.mesh.normals import CornerNormals, corner_normals
from grasp3d.mesh.preparing import center_and_volume, center_mass_from
from grasp3d.mesh.repair import RepairStep, Solids
from grasp3d.settings.lengths import Unit


def read_mesh(stored: Stored, settings: FileSettings, unit: Unit | None = None) -> ObjectMesh:
    """The surface of a file whose values were checked.

    Args:
        stored: What the file holds.
        settings: Its settings.
        unit: Unit of the mesh, if the file states none.

    Raises:
        MeshError: What it has of the mesh is damaged.
    """
    try:
        mesh = (_complete_mesh if stored.complete else _displayed_mesh)(stored, settings)
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        stored.reject(f"its mesh is damaged ({' '.join(str(error).split())[:200]})")
    if mesh.unit is None and unit is not None:
        mesh = replace(mesh, report=replace(mesh.report, unit=unit))
    # A file has both with more digits than they follow from what else it has.
    vars(mesh)["normals"] = locked(-stored.field("normal").astype(np.float64))
    vars(mesh)["torque_scale"] = settings.torque_scale
    return mesh


def _complete_mesh(stored: Stored, settings: FileSettings) -> ObjectMesh:
    """The same mesh as was labelled."""
    found = dict(json.loads(stored.settings["surface"]))
    vertices, faces, canonical = map(stored.field, ("vertices", "faces", "canonical"))
    if (canonical[canonical] != canonical).any() or (canonical[faces] != faces).any():
        raise ValueError("its faces do not use canonical vertices")
    corners, normals = stored.field("corners"), -stored.field("corner_normals")
    of_vertices = np.zeros(len(normals), dtype=np.int64)
    of_vertices[corners] = faces
    if (of_vertices[corners] != faces).any():
        raise ValueError("corners of several vertices have one normal")
    center, size = _numbers(found["center"], (3,)), _numbers(found["size"], ())
    if not size > 0.0:
        raise ValueError(f"its size is {size}")
    report = dict(found["report"])
    steps = tuple(RepairStep(**step) for step in report.pop("repairs"))
    mesh = ObjectMesh(
        vertices=locked(vertices),
        faces=locked(faces),
        canonical=locked(canonical),
        file_vertices=settings.file_vertices,
        corner_normals=CornerNormals(locked(corners), locked(normals), locked(of_vertices)),
        center=locked(center),
        size=float(size),
        center_mass=locked(_numbers(found["center_mass"], (3,))),
        volume=float(found["volume"]),
        options=settings.options,
        report=MeshReport(**{**report, "repairs": steps, "warnings": tuple(report["warnings"])}),
        solids=_solids(found),
    )
    if mesh.unit != settings.unit:
        raise ValueError(f"its unit is {mesh.unit} and {settings.unit}")
    return mesh


def _numbers(found: Any, shape: tuple[int, ...]) -> Floats:
    numbers = np.array(found, dtype=np.float64)
    if numbers.shape != shape or not np.isfinite(numbers).all():
        raise ValueError(f"{str(found)[:60]} are not {math.prod(shape)} finite numbers")
    return numbers


def _solids(found: dict[str, Any]) -> Solids | None:
    volumes, centers = found["solid_volumes"], found["solid_centers"]
    if volumes is None:
        return None
    count = len(volumes)
    return Solids(locked(_numbers(volumes, (count,))), locked(_numbers(centers, (count, 3))))


def _displayed_mesh(stored: Stored, settings: FileSettings) -> ObjectMesh:
    """The surface of a file without more than is displayed: a PLY."""
    vertices, faces = stored.field("vertices"), stored.field("faces")
    canonical = first_at_position(vertices)
    faces = canonical[faces]
    center, size = surface_extent(vertices, faces)
    closed, given = is_closed(faces), settings.options.center_of_mass
    surface = Triangles((vertices - center) / size, faces)
    center_mass, volume = center_and_volume(surface, closed=closed)
    warnings = [] if closed else [
        "the surface is open: inside and outside are taken from the winding of its faces"
    ]  # fmt: skip
    return ObjectMesh(
        vertices=locked(vertices),
        faces=locked(faces),
        canonical=locked(canonical),
        file_vertices=settings.file_vertices,
        corner_normals=_shading(stored, vertices, faces, settings.options.crease_angle),
        center=locked(center),
        size=size,
        center_mass=locked(center_mass * size + center if given is None else given),
        volume=volume * size**3,
        options=settings.options,
        report=MeshReport(
            source=settings.source,
            format=stored.source.kind,
            unit=settings.unit,
            file_vertices=settings.file_vertices,
            file_faces=len(faces),
            vertices=len(vertices),
            faces=len(faces),
            bodies=1,
            closed=closed,
            center_mass_from=center_mass_from(settings.options, volume),
            repairs=(),
            warnings=tuple(warnings),
        ),
    )


def _shading(stored: Stored, vertices: Floats, faces: Ints, crease_angle: float) -> CornerNormals:
    """Normals at the corners of the faces; on smooth parts those of the file."""
    computed = corner_normals(Triangles(vertices, faces), crease_angle)
    corners = np.bincount(computed.vertices, minlength=len(vertices))[computed.vertices]
    own = -stored.field("normal").astype(np.float64)[computed.vertices]
    smooth = (corners == 1) & (own != 0.0).any(axis=1)
    normals = np.where(smooth[:, None], own, computed.normals)
    return CornerNormals(locked(computed.corners), locked(normals), locked(computed.vertices))
