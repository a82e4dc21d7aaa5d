"""Labelling of one mesh of a batch, for each hand: a pure function of file and settings.

A result is identified by the content of the mesh, the settings and the version of the method.
"""

import hashlib
import json
import math
import tempfile
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.batch.batch_settings import BatchSettings, Surfaces
from grasp3d.batch.chunks import VERTICES, LabelledMesh
from grasp3d.batch.inputs import MeshFile, local_copy
from grasp3d.batch.row import BestGrasp, Outcome, Row
from grasp3d.errors import FileUnreadError, GraspError, MeshError, OutputError, WarningError
from grasp3d.mesh.sources import side_names
from grasp3d.settings.parsing import plain, plain_values
from grasp3d.stability.label import Label
from grasp3d.system.documents import problem_of_file
from grasp3d.system.names import printable

if TYPE_CHECKING:
    from grasp3d.grasps.jaw_grasps import JawGrasps
    from grasp3d.mesh import ObjectMesh
    from grasp3d.settings import MeshOptions
    from grasp3d.surface.grasp_table import GraspTable
    from grasp3d.surface.labels import SurfaceLabels


METHOD = 9
"""Version of the method; increase it when labels or rows of an unchanged mesh change."""


def content_hash(path: Path) -> str:
    """SHA-256 of a mesh file, and of the data files of a glTF.

    Args:
        path: Local file.

    Raises:
        MeshError: The file cannot be read.
    """
    try:
        digest = _digest(path)
        side_digests = [f"{name} {_side_digest(path, name)}" for name in side_names(path)]
    except OSError as error:
        reason = problem_of_file(path) or f"cannot be opened ({error.strerror})"
        raise MeshError(f"{printable(str(path))}: {reason}") from error
    if not side_digests:
        return digest
    return hashlib.sha256("\n".join([digest, *sorted(side_digests)]).encode()).hexdigest()


def mesh_key(content: str, settings: BatchSettings, own: Mapping[str, Any]) -> str:
    """SHA-256 of everything that determines a mesh's results; if it differs, label again.

    Args:
        content: Hash from `content_hash`.
        settings: Settings of the labels of all meshes.
        own: Settings of this mesh alone, as stated in a table.
    """
    mine = json.dumps(_canonical({name: plain(one) for name, one in own.items()}), sort_keys=True)
    return hashlib.sha256(
        f"{content} {settings_key(settings)} {mine} {METHOD}".encode()
    ).hexdigest()


@lru_cache(maxsize=16)
def settings_key(settings: BatchSettings) -> str:
    """SHA-256 of settings, the same for equal settings."""
    return hashlib.sha256(settings_text(settings).encode()).hexdigest()


def settings_text(settings: BatchSettings) -> str:
    """Return settings as canonical JSON: sorted, whole numbers without decimals, inf as null."""
    values = plain_values(settings)
    values["reach"]["gripper"] = values["reach"].pop("hand")  # the name in files
    return json.dumps(_canonical(values), sort_keys=True, separators=(",", ":"), allow_nan=False)


def _canonical(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _canonical(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_canonical(item) for item in value]
    if isinstance(value, float):
        if value == float("inf"):
            return None
        return int(value) if value.is_integer() else value
    return value


def _digest(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _side_digest(path: Path, name: str) -> str:
    """Digest of a side file; files that are missing or outside the folder are not read."""
    folder = path.parent.resolve()
    side = (folder / name).resolve()
    return _digest(side) if side.is_relative_to(folder) and side.is_file() else "missing"


KEPT = 16
"""Number of results that a process keeps: files with the same content are labelled once."""


NUMBERS = ("score", "critical_angle", "max_resolution", "epsilon", "opening")
"""Numbers that are known for every grasp."""


@dataclass(frozen=True)
class JobSettings:
    """Settings that all jobs of a run share."""

    labels: BatchSettings
    surfaces: Surfaces
    has_pages: bool
    """Whether each mesh gets pictures, and a page of its own in the report."""
    force: bool
    """Whether lengths are accepted that are implausible for an object of a mesh's size."""


@dataclass(frozen=True)
class Job:
    """One mesh to label, for one hand."""

    mesh: MeshFile
    path: str
    """Path of the results without suffix, below their folders."""
    surface: str
    """Name of the surface, as stated in its row; empty: it is not stored."""


Prepared: TypeAlias = "dict[MeshOptions, ObjectMesh]"
"""A mesh, prepared with each of several options."""

_finished: dict[tuple[str, Surfaces], LabelledMesh] = {}


def label_jobs(jobs: Sequence[Job], settings: JobSettings) -> list[LabelledMesh]:
    """Label one mesh once for each job; the mesh is read and prepared once.

    Args:
        jobs: Jobs for one mesh, whose own settings may differ.
        settings: Settings of the labels and of the results.

    Returns:
        The data to store for each job; if a mesh cannot be labelled, a row with the reason in
        `error`.
    """
    prepared: Prepared = {}
    return [_label(job, settings, prepared) for job in jobs]


def _label(job: Job, settings: JobSettings, prepared: Prepared) -> LabelledMesh:
    begun, mesh = time.perf_counter(), job.mesh
    row = Row(
        mesh=mesh.name, source=mesh.source, bytes=mesh.size, stamp=mesh.stamp, surface=job.surface
    )
    try:
        with local_copy(mesh.source) as path:
            content = content_hash(path)
            # The stamp of a file does not change when its side files change.
            stamp = "" if side_names(path) else row.stamp
            row = replace(
                row, content=content, stamp=stamp,
                key=mesh_key(content, settings.labels, mesh.own),
            )  # fmt: skip
            done = _labelled(path, job, settings, row, prepared)
    except GraspError as error:
        # Some errors disappear by themselves; warnings are errors only in strict runs.
        lost = isinstance(error, OutputError | FileUnreadError)
        row = replace(
            row, outcome=Outcome.LOST if lost else Outcome.REFUSED, error=str(error), surface="",
            content="" if isinstance(error, WarningError) else row.content,
        )  # fmt: skip
        done = LabelledMesh(row, {}, {})
    return replace(done, row=replace(done.row, seconds=time.perf_counter() - begun))


def lost_job(job: Job, reason: str) -> LabelledMesh:
    """Return the data to store for a mesh whose process failed.

    Args:
        job: The mesh.
        reason: Reason why the process ended.
    """
    mesh, error = job.mesh, f"{job.mesh.source}: {reason}"
    row = Row(mesh.name, mesh.source, Outcome.LOST, error, bytes=mesh.size)
    return LabelledMesh(row, {}, {})


@lru_cache(maxsize=KEPT)
def _settings_of(settings: BatchSettings, own: tuple[tuple[str, Any], ...]) -> BatchSettings:
    return settings.of_mesh(dict(own))


def _labelled(
    path: Path, job: Job, settings: JobSettings, row: Row, prepared: Prepared
) -> LabelledMesh:
    key = row.key, settings.surfaces
    known = _finished.get(key)
    if known is None or settings.has_pages:
        known = _computed(path, job, settings, row, prepared)
        if settings.has_pages:
            return known
        _finished[key] = known
        if len(_finished) > KEPT:
            del _finished[next(iter(_finished))]
    same = {name: getattr(row, name) for name in ("mesh", "source", "bytes", "stamp", "surface")}
    return replace(known, row=replace(known.row, **same))


def _computed(
    path: Path, job: Job, settings: JobSettings, row: Row, prepared: Prepared
) -> LabelledMesh:
    # Imported here, as planning and reading rows need neither ray tracing nor the compiler.
    from grasp3d.formats import write_npz, write_ply
    from grasp3d.surface.labelling import Labelling

    own = _settings_of(settings.labels, tuple(job.mesh.own.items()))
    begun = time.perf_counter()
    task = Labelling.read(
        prepared.get(own.mesh, path), own.model, own.sampling, own.reach, own.load, own.mesh,
        force=settings.force,
    )  # fmt: skip
    prepared[own.mesh] = task.mesh
    read = time.perf_counter()
    labels = task.labels()
    _ = labels.epsilon_range, labels.load_result
    labelled = time.perf_counter()
    best = _best_of(labels, own.best)
    row = replace(row, grasps=_best_rows(best)).of(labels, judged=bool(own.best))
    surface = b""
    with tempfile.TemporaryDirectory(prefix="grasp3d-") as temporary:
        folder = Path(temporary)
        if settings.surfaces != "none":
            write = write_ply if settings.surfaces == "ply" else write_npz
            file = folder / f"surface.{'ply' if settings.surfaces == 'ply' else 'npz'}"
            write(file, labels)
            surface = file.read_bytes()
            file.unlink()
        if settings.has_pages:
            from grasp3d.batch.object_page import write_object

            row = write_object(row, labels, best, folder, f"report/objects/{job.path}")
        files = {
            file.relative_to(folder).as_posix(): file.read_bytes()
            for file in folder.rglob("*")
            if file.is_file()
        }
    row = replace(
        row, seconds_reading=read - begun, seconds_labelling=labelled - read,
        seconds_writing=time.perf_counter() - labelled,
    )  # fmt: skip
    vertices = {name: getattr(labels, name) for name in VERTICES}
    return LabelledMesh(row, vertices, files, surface)


def _best_of(labels: "SurfaceLabels", count: int) -> "GraspTable | JawGrasps | None":
    """Best distinct grasps of a surface; None if there are none, or none are asked for."""
    from grasp3d.grasps.best import best_grasps, has_poses
    from grasp3d.surface.vertex_fields import Reason

    if not count or (not has_poses(labels) and not np.any(labels.reason == Reason.FOUND)):
        return None
    return best_grasps(labels, count)


def _best_rows(best: "GraspTable | JawGrasps | None") -> tuple[BestGrasp, ...]:
    """Return the best distinct grasps as the row of a surface stores them."""
    if best is None:
        return ()
    names = [label.name for label in sorted(Label)]
    poses = np.full((best.size, 4, 4), np.nan) if best.poses is None else best.poses
    contacts: Any = getattr(best, "jaws", None) or getattr(best, "contacts", None)
    numbers = {name: getattr(best, name) for name in NUMBERS} | _further_values(best)

    def grasp(row: int) -> BestGrasp:
        values: dict[str, Any] = {name: _finite(one[row]) for name, one in numbers.items()}
        values |= {name: float(numbers[name][row]) for name in NUMBERS}
        return BestGrasp(
            label=names[best.letter[row]],
            points=_triples(contacts.points[row]),
            normals=_triples(-contacts.normals[row]),
            pose=() if np.isnan(poses[row]).any() else tuple(poses[row].ravel().tolist()),
            **values,
        )

    return tuple(map(grasp, range(best.size)))


def _finite(number: Any) -> float | None:
    return float(number) if math.isfinite(number) else None


def _further_values(best: "GraspTable | JawGrasps") -> dict[str, Floats]:
    """Return approach margins and loads by their names in `BestGrasp`, shape (k,) each."""
    from grasp3d.describe.verdict import needed_force

    values = {"approach_margin": getattr(best, "approach_margin", None)}
    if best.load is not None:
        values |= {"grip_force": needed_force(best), "payload": best.payload}
    return {name: one for name, one in values.items() if one is not None}


def _triples(rows: Any) -> tuple[tuple[float, float, float], ...]:
    return tuple((float(x), float(y), float(z)) for x, y, z in rows)
