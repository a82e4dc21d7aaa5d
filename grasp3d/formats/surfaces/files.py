"""Files of labelled surfaces by suffix, and reading of them, their mesh without repair."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np

from grasp3d.arrays import Floats, locked
from grasp3d.errors import GraspError, MeshError, OutputError
from grasp3d.formats.surfaces.glb import write_glb
from grasp3d.formats.surfaces.npz import read_npz, write_npz
from grasp3d.formats.surfaces.parquet import write_fields
from grasp3d.formats.surfaces.ply import read_ply, write_ply
from grasp3d.formats.surfaces.stored import (
    FIELDS,
    FileSettings,
    Stored,
    check_stored,
    damaged,
    settings_from,
)
from grasp3d.formats.surfaces.vtp import write_vtp
from grasp3d.hand.reach import Reach
from grasp3d.mesh import MeshReport, ObjectMesh
from grasp3d.mesh.normals import CornerNormals
from grasp3d.mesh.object_mesh import scale_of
from grasp3d.mesh.reading.sources import Source, find_source
from grasp3d.mesh.repair.work import RepairStep
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.quality.force_ranges import Certainty
from grasp3d.quality.tilting import EpsilonRange
from grasp3d.settings.units import Unit, with_lengths_scaled
from grasp3d.surface.fields import AREA, LENGTH, Array
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.load_case import LoadCase
from grasp3d.surface.load_result import LoadResult
from grasp3d.surface.vertex_fields import unpacked_bits
from grasp3d.surface.vertex_grasps import Reason
from grasp3d.system.documents import parse_json
from grasp3d.system.limited_reading import read_file
from grasp3d.system.names import printable, unsupported

WRITERS: dict[str, Callable[[Path, SurfaceLabels], None]] = {
    ".ply": write_ply,
    ".glb": write_glb,
    ".npz": write_npz,
    ".vtp": write_vtp,
    ".parquet": write_fields,
}
READERS: dict[str, Callable[[Source], Stored | None]] = {".ply": read_ply, ".npz": read_npz}
"""By suffix."""


def writer_for(path: Path) -> Callable[[Path, SurfaceLabels], None]:
    """Choose the writer by the file's suffix.

    Raises:
        OutputError: No writer has that suffix.
    """
    writer = WRITERS.get(path.suffix.lower())
    if writer is None:
        raise OutputError(unsupported(path, WRITERS))
    return writer


def read_labels(path: str | Path, *, unit: Unit | None = None) -> SurfaceLabels:
    """Read a labelled PLY or NPZ file.

    They are those that were written, bit for bit, with their grasps, mesh and settings.

    Args:
        path: A file that `write_ply` or `write_npz` wrote.
        unit: Unit of the mesh, for files that state none.

    Raises:
        MeshError: The file is missing, damaged, or was not written by grasp3d.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> ball = grasp3d.load_mesh(trimesh.creation.icosphere(2), unit="cm", max_edge="9cm")
        >>> grasp3d.write_npz("ball.npz", grasp3d.label_surface(ball))
        >>> labels = grasp3d.read_labels("ball.npz")
        >>> labels
        <SurfaceLabels of trimesh.Trimesh: 162 vertices, ...; S 100.0%, M 0.0%, U 0.0%>
        >>> labels.relabel(friction=0.1).fractions()["S"], labels.mesh.file_unit
        (0.0, 'cm')
    """
    labels = labels_in(Path(path), unit=unit)
    if labels is None:
        kind = Path(path).suffix[1:].upper()
        where = printable(str(path))
        raise MeshError(f"{where}: is not a {kind} labelled by grasp3d; label it first")
    return labels


def labels_in(path: Path, *, unit: Unit | None = None) -> SurfaceLabels | None:
    """The labels of a file; None: it has none, as a PLY that is a mesh. As `read_labels`."""
    stored = read_file(_stored, path)
    if stored is None:
        return None
    try:
        settings = settings_from(stored.settings)
    except ValueError as error:
        stored.reject(f"its grasp3d comments are not valid: {error}")
    check_stored(stored, settings)
    mesh = _read_mesh(stored, settings, unit)
    if mesh.unit is not None and settings.unit is None:
        stored, settings = _in_metres(stored, settings, mesh.file_scale)
    try:
        return _labels(stored, settings, mesh)
    except GraspError as error:
        raise damaged(stored.source, str(error)) from error


def _in_metres(stored: Stored, settings: FileSettings, scale: float) -> tuple[Stored, FileSettings]:
    """What a file of unknown unit holds, with lengths in metres."""
    factors = {LENGTH: scale, AREA: scale**2}
    values = {
        name: one * factors[FIELDS[name].unit] if FIELDS[name].unit in factors else one
        for name, one in stored.values.items()
    }
    in_metres = replace(
        settings,
        model=with_lengths_scaled(settings.model, scale),
        sampling=with_lengths_scaled(settings.sampling, scale),
    )
    return replace(stored, values=values), in_metres


def _stored(path: Path) -> Stored | None:
    """What a file holds; None: no labels."""
    source = find_source(path, READERS)
    return READERS[f".{source.kind}"](source)


def _labels(stored: Stored, settings: FileSettings, mesh: ObjectMesh) -> SurfaceLabels:
    """Labels of checked values. Raises GraspError."""
    model, known = settings.model, {
        "label": _value(stored, "label"),
        "epsilon_range": EpsilonRange(*(_floats(stored, f"epsilon{end}") for end in _ENDS)),
        "load_result": _load_result(stored, settings, mesh),
    }  # fmt: skip
    worst, best = (_floats(stored, f"critical_angle{end}") for end in ("", "_best"))
    labels = SurfaceLabels.of_vertices(
        mesh, model, angles=(worst, best), partner_points=_partner_points(stored),
        grip=stored.field("grip"), reason=stored.field("reason"),
        reach=_reach(stored, settings), sampling=settings.sampling, mode=settings.mode,
        search=settings.search, scene=settings.scene, load=settings.load,
    )  # fmt: skip
    vars(labels).update({name: value for name, value in known.items() if value is not None})
    return labels


_ENDS = ("", "_min", "_max")


def _value(stored: Stored, name: str) -> Array | None:
    """Values of a field as Python has them; None: the file has none."""
    values = stored.values.get(name)
    if values is None:
        return None
    field = FIELDS[name]
    return locked(-values if field.outward else values, np.dtype(field.kind))


def _floats(stored: Stored, name: str) -> Floats:
    return locked(stored.field(name), np.float64)


def _partner_points(stored: Stored) -> SurfacePoints:
    """The opposing contacts as surface points, (V, n - 1)."""
    return SurfacePoints(
        locked(stored.field("partner_faces")), locked(stored.field("partner_weights"))
    )


def _reach(stored: Stored, settings: FileSettings) -> Reach | None:
    """How a gripper reaches the grasps, if there is one."""
    if settings.scene is None:
        return None
    margin = _floats(stored, "approach_margin")
    columns = [stored.field(name) for name in ("closing", "lateral", "approach", "tcp")]
    poses = np.full((len(margin), 4, 4), math.nan)
    poses[:, :3] = np.stack(columns, axis=2)
    poses[np.isfinite(columns[3]).all(axis=1), 3] = 0.0, 0.0, 0.0, 1.0
    count, angles = len(margin), settings.scene.approach.angles
    free = stored.values.get("free_angles")
    return Reach(
        state=locked(stored.field("reach_state")),
        poses=locked(poses),
        approach_margin=margin,
        opening=_floats(stored, "held_opening"),
        pregrasp_opening=_floats(stored, "pregrasp_opening"),
        depth=_floats(stored, "depth"),
        free=locked(np.zeros((count, 0), bool) if free is None else unpacked_bits(free, angles)),
    )


def _load_result(stored: Stored, settings: FileSettings, mesh: ObjectMesh) -> LoadResult | None:
    """Forces and payloads under the load; None: the file has none. Raises GraspError."""
    load, scene = settings.load, settings.scene
    if load is None or "force_bounds" not in stored.settings:
        return None
    text = stored.settings["force_bounds"]
    how = next((one for one in get_args(Certainty) if one == text), None)
    if how is None:
        stored.reject(f"its force_bounds are {text[:20]!r}")
    case = LoadCase.of(load, mesh, settings.model, None if scene is None else scene.hand)
    payload = np.full(len(stored.field("label")), math.nan)
    if case.available is not None and case.task.mass is not None:
        payload = stored.field("payload")
    resistance = stored.values.get("resistance")
    return LoadResult(
        case=case,
        grip_force=_floats(stored, "grip_force"),
        grip_force_least=_floats(stored, "grip_force_least"),
        grip_force_largest=_floats(stored, "grip_force_largest"),
        payload=locked(payload, np.float64),
        resistance=None if resistance is None else locked(resistance),
        how=how,
    )


def _read_mesh(stored: Stored, settings: FileSettings, unit: Unit | None) -> ObjectMesh:
    """The surface of a file whose values were checked. Raises MeshError."""
    try:
        mesh = _complete_mesh(stored, settings)
    except (ValueError, TypeError, KeyError, RecursionError) as error:
        stored.reject(f"its mesh is damaged ({' '.join(str(error).split())[:200]})")
    if mesh.unit is None and unit is not None:
        mesh = mesh.with_unit(unit)
    if mesh.options.region is not None:
        mesh = replace(mesh, region=locked(stored.field("reason") != Reason.EXCLUDED))
    return mesh


def _complete_mesh(stored: Stored, settings: FileSettings) -> ObjectMesh:
    """The same mesh as was labelled."""
    surface = dict(parse_json(stored.settings["surface"]))
    vertices, faces, canonical = map(stored.field, ("vertices", "faces", "canonical"))
    if (canonical[canonical] != canonical).any() or (canonical[faces] != faces).any():
        raise ValueError("its faces do not use canonical vertices")
    corners, normals = stored.field("corners"), -stored.field("corner_normals")
    of_vertices = np.zeros(len(normals), dtype=np.int64)
    of_vertices[corners] = faces
    if (of_vertices[corners] != faces).any():
        raise ValueError("corners of several vertices have one normal")
    center, size = _numbers(surface["center"], (3,)), _numbers(surface["size"], ())
    if not size > 0.0:
        raise ValueError(f"its size is {size}")
    report = dict(surface["report"])
    steps = tuple(RepairStep(**step) for step in report.pop("repairs"))
    mesh = ObjectMesh(
        vertices=locked(vertices * scale_of(settings.unit)),
        file_points=locked(vertices),
        faces=locked(faces),
        canonical=locked(canonical),
        file_vertices=settings.file_vertices,
        corner_normals=CornerNormals(locked(corners), locked(normals), locked(of_vertices)),
        center=locked(center),
        size=float(size),
        center_mass=locked(_numbers(surface["center_mass"], (3,))),
        volume=float(surface["volume"]),
        options=settings.options,
        report=MeshReport(**{**report, "repairs": steps, "warnings": tuple(report["warnings"])}),
    )
    if mesh.file_unit != settings.unit:
        raise ValueError(f"its unit is {mesh.file_unit} and {settings.unit}")
    return mesh


def _numbers(values: Any, shape: tuple[int, ...]) -> Floats:
    numbers = np.array(values, dtype=np.float64)
    if not numbers.size:
        numbers = numbers.reshape(0, *shape[1:])
    if numbers.shape != shape or not np.isfinite(numbers).all():
        raise ValueError(f"{str(values)[:60]} are not {math.prod(shape)} finite numbers")
    return numbers
