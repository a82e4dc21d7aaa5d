"""Files of labelled surfaces by suffix, and reading of them, their mesh without repair."""

import math
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, get_args

import numpy as np

from grasp3d.arrays import Floats, locked
from grasp3d.errors import MeshError
from grasp3d.formats.surfaces import layouts
from grasp3d.formats.surfaces.stored import (
    DAMAGE,
    FIELDS,
    FileSettings,
    Stored,
    check_stored,
    damaged,
    settings_from,
)  # fmt: skip
from grasp3d.hand.reach import ANGLES, Reach
from grasp3d.mesh import MeshReport, ObjectMesh
from grasp3d.mesh.normals import CornerNormals
from grasp3d.mesh.object_mesh import scale_of
from grasp3d.mesh.reading.sources import find_source
from grasp3d.mesh.repair.work import RepairStep
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.quality.force_ranges import Certainty
from grasp3d.quality.tilting import EpsilonRange
from grasp3d.settings.units import Unit, with_lengths_scaled
from grasp3d.surface.fields import AREA, LENGTH, Arrays
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.load_case import LoadCase
from grasp3d.surface.load_result import LoadResult
from grasp3d.surface.vertex_fields import unpacked_bits
from grasp3d.surface.vertex_grasps import Reason
from grasp3d.system.documents import parse_json
from grasp3d.system.files import check_suffix
from grasp3d.system.limited_reading import read_file
from grasp3d.system.names import printable
from grasp3d.system.versions import newer_version

WRITERS: dict[str, Callable[[Path, SurfaceLabels], None]] = {
    ".ply": layouts.write_ply, ".glb": layouts.write_glb, ".npz": layouts.write_npz,
    ".vtp": layouts.write_vtp, ".parquet": layouts.write_fields,
}  # fmt: skip
READERS = {".ply": layouts.read_ply, ".npz": layouts.read_npz}
"""By suffix."""


def writer_for(path: Path) -> Callable[[Path, SurfaceLabels], None]:
    """Choose the writer by the file's suffix.

    Raises:
        OutputError: No writer has that suffix.
    """
    check_suffix(path, WRITERS, "")
    return WRITERS[path.suffix.lower()]


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
        kind, where = Path(path).suffix[1:].upper(), printable(str(path))
        raise MeshError(f"{where}: is not a {kind} labelled by grasp3d; label it first")
    return labels


def labels_in(path: Path, *, unit: Unit | None = None) -> SurfaceLabels | None:
    """The labels of a file; None: it has none, as a PLY that is a mesh. As `read_labels`."""
    stored = read_file(_stored, path)
    if stored is None:
        return None
    if newer := newer_version(stored.settings.get("version")):
        raise MeshError(f"{stored.source.where}: {newer}")
    try:
        return _labels(stored, unit)
    except DAMAGE as error:
        raise damaged(stored.source, error) from error


def _stored(path: Path) -> Stored | None:
    """What a file holds; None: no labels."""
    source = find_source(path, READERS)
    return READERS[f".{source.kind}"](source)


def _labels(stored: Stored, unit: Unit | None) -> SurfaceLabels:
    """The labels, whose values are checked. Raises one of `DAMAGE`."""
    settings, values = settings_from(stored.settings), stored.values
    check_stored(stored, settings)
    mesh = _mesh(stored, settings)
    if mesh.unit is None and unit is not None:
        mesh = mesh.with_unit(unit)
    if mesh.options.region is not None:
        mesh = replace(mesh, region=locked(values["reason"] != Reason.EXCLUDED))
    if (
        mesh.unit is not None and settings.options.stated_unit is None
    ):  # lengths are in metres from here
        scale = scale_of(mesh.file_unit)
        powers = {LENGTH: scale, AREA: scale**2}
        values = {name: one * powers.get(FIELDS[name].unit, 1) for name, one in values.items()}
        settings = replace(
            settings,
            model=with_lengths_scaled(settings.model, scale),
            sampling=with_lengths_scaled(settings.sampling, scale),
        )

    def floats(*names: str) -> Any:
        return (locked(values[name], np.float64) for name in names)

    partners = SurfacePoints(locked(values["partner_faces"]), locked(values["partner_weights"]))
    labels = SurfaceLabels.of_vertices(
        mesh, settings.model, angles=tuple(floats("critical_angle", "critical_angle_best")),
        partner_points=partners, grip=values["grip"], reason=values["reason"],
        reach=_reach(values, settings), sampling=settings.sampling, mode=settings.mode,
        search=settings.search, scene=settings.scene, load=settings.load,
    )  # fmt: skip
    known: dict[str, Any] = {
        "label": locked(values["label"]),
        "epsilon_range": EpsilonRange(*floats("epsilon", "epsilon_min", "epsilon_max")),
    }
    if settings.load is not None and "force_bounds" in stored.settings:
        known["load_result"] = _load_result(values, settings, mesh, stored.settings["force_bounds"])
    vars(labels).update(known)
    return labels


def _reach(values: Arrays, settings: FileSettings) -> Reach | None:
    """How a gripper reaches the grasps, if there is one."""
    if settings.scene is None:
        return None
    columns = [values[name] for name in ("closing", "lateral", "approach", "tcp")]
    poses = np.full((len(columns[3]), 4, 4), math.nan)
    poses[:, :3] = np.stack(columns, axis=2)
    poses[np.isfinite(columns[3]).all(axis=1), 3] = 0.0, 0.0, 0.0, 1.0
    bits = values.get("free_angles")
    free = np.zeros((len(poses), 0), bool) if bits is None else unpacked_bits(bits, ANGLES)
    floats = ("approach_margin", "pregrasp_opening", "depth")
    return Reach(
        state=locked(values["reach_state"]),
        poses=locked(poses),
        opening=locked(values["held_opening"], np.float64),
        free=locked(free),
        **{name: locked(values[name], np.float64) for name in floats},
    )


def _load_result(values: Arrays, settings: FileSettings, mesh: ObjectMesh, how: Any) -> LoadResult:
    """Forces and payloads under the load. Raises one of `DAMAGE`."""
    load, scene = settings.load, settings.scene
    if load is None or how not in get_args(Certainty):
        raise ValueError(f"its force_bounds are {how[:20]!r}")
    case = LoadCase.of(load, mesh, settings.model, None if scene is None else scene.hand)
    has_payload = case.available is not None and case.task.mass is not None
    payload = values["payload"] if has_payload else np.full(len(values["label"]), math.nan)
    resistance = values.get("resistance")
    forces = ("grip_force", "grip_force_least", "grip_force_largest")
    return LoadResult(
        case=case,
        payload=locked(payload, np.float64),
        resistance=None if resistance is None else locked(resistance),
        how=how,
        **{name: locked(values[name], np.float64) for name in forces},
    )


def _mesh(stored: Stored, settings: FileSettings) -> ObjectMesh:
    """The same mesh as was labelled. Raises one of `DAMAGE`."""
    surface, values = dict(parse_json(stored.settings["surface"])), stored.values
    vertices, faces, canonical = (values[name] for name in ("vertices", "faces", "canonical"))
    if (canonical[canonical] != canonical).any() or (canonical[faces] != faces).any():
        raise ValueError("its faces do not use canonical vertices")
    corners, normals = values["corners"], -values["corner_normals"]
    of_vertices = np.zeros(len(normals), dtype=np.int64)
    of_vertices[corners] = faces
    if (of_vertices[corners] != faces).any():
        raise ValueError("corners of several vertices have one normal")
    center, center_mass = (_finite(surface[name], (3,)) for name in ("center", "center_mass"))
    size = _finite(surface["size"], ())
    if not size > 0.0:
        raise ValueError(f"its size is {size}")
    report = dict(surface["report"])
    report["repairs"] = tuple(RepairStep(**step) for step in report["repairs"])
    report["source"], report["warnings"] = str(report["source"]), tuple(report["warnings"])
    mesh = ObjectMesh(
        vertices=locked(
            vertices * (scale_of(settings.options.stated_unit) * settings.options.scale)
        ),
        file_points=locked(vertices), faces=locked(faces), canonical=locked(canonical),
        file_vertices=settings.file_vertices,
        corner_normals=CornerNormals(locked(corners), locked(normals), locked(of_vertices)),
        center=locked(center), size=float(size), center_mass=locked(center_mass),
        volume=float(surface["volume"]), options=settings.options, report=MeshReport(**report),
    )  # fmt: skip
    if mesh.file_unit != settings.options.stated_unit:
        raise ValueError(f"its unit is {mesh.file_unit} and {settings.options.stated_unit}")
    return mesh


def _finite(values: Any, shape: tuple[int, ...]) -> Floats:
    numbers = np.array(values, dtype=np.float64)
    if numbers.shape != shape or not np.isfinite(numbers).all():
        raise ValueError(f"{str(values)[:60]} are not {math.prod(shape)} finite numbers")
    return numbers
