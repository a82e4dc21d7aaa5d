"""Labelling one mesh of a batch: a pure function of the file and the settings."""

import math
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.identity import METHOD, content_hash, mesh_key
from grasp3d.batch.inputs import MeshFile
from grasp3d.batch.limits import NeedsMemory, allowed_memory
from grasp3d.batch.plan import Job
from grasp3d.batch.row import BestGrasp, Outcome, Row
from grasp3d.batch.storage.files import local_copy
from grasp3d.errors import FileUnreadError, GraspError, OutputError, WarningError
from grasp3d.mesh.reading.scenes import side_names
from grasp3d.settings.costs import labelling_cost
from grasp3d.stability.label import Label
from grasp3d.system.context import running
from grasp3d.system.versions import package_version

if TYPE_CHECKING:
    from grasp3d.grasps.jaw_grasps import JawGrasps
    from grasp3d.surface.grasp_table import GraspTable
    from grasp3d.surface.labels import SurfaceLabels


@dataclass(frozen=True)
class Unchanged:
    """A mesh whose row is still valid: its file was touched, but its content is the same."""

    mesh: MeshFile


def label_job(job: Job, settings: BatchSettings, *, force: bool = False) -> Row | Unchanged:
    """Label one mesh and write all its results.

    Args:
        job: The mesh, and the files for its results.
        settings: Settings of the labels.
        force: Accept lengths that cannot be meant for an object of this size.

    Returns:
        The mesh's row of the summary; of a mesh that cannot be labelled with the reason in `error`.
        `Unchanged` where the content is `job.known_content`.

    Raises:
        NeedsMemory: The mesh is expected to need more memory than this process may take.
    """
    begun = time.perf_counter()
    row = _unlabelled_row(job)
    try:
        with running(threads=job.threads), local_copy(job.mesh.source) as path:
            content = content_hash(path)
            if content == job.known_content:
                return Unchanged(job.mesh)
            # The stamp of a file does not change when its side files do.
            stamp = "" if side_names(path) else row.stamp
            key = mesh_key(content, settings)
            row = replace(row, content=content, key=key, stamp=stamp)
            row = _labelled(path, job, settings, row, force=force)
    except (OutputError, FileUnreadError) as error:  # may pass by itself
        row = replace(row, outcome=Outcome.LOST, error=str(error))
    except WarningError as error:  # no error of another run, which may not be strict
        row = replace(row, outcome=Outcome.REFUSED, content="", error=str(error))
    except GraspError as error:
        row = replace(row, outcome=Outcome.REFUSED, error=str(error))
    return replace(row, seconds=time.perf_counter() - begun)


def lost_row(job: Job, reason: str) -> Row:
    """Row of a mesh whose process failed.

    Args:
        job: The mesh.
        reason: What ended the process.
    """
    return Row.lost(job.mesh.name, job.mesh.source, job.mesh.size, reason)


def _unlabelled_row(job: Job) -> Row:
    """Row of a mesh with the values that are known before it is read."""
    mesh = job.mesh
    return Row(
        mesh=mesh.name,
        source=mesh.source,
        bytes=mesh.size,
        stamp=mesh.stamp,
        version=package_version(),
        method=METHOD,
    )


def _labelled(path: Path, job: Job, settings: BatchSettings, row: Row, *, force: bool) -> Row:
    # Imported here: planning and reading rows need neither ray tracing nor the compiler.
    from grasp3d.surface.labelling import Labelling

    clock = _lap_times()
    next(clock)
    task = Labelling.read(
        path, settings.model, settings.sampling, settings.reach, settings.load, settings.mesh,
        force=force,
    )  # fmt: skip
    reading = next(clock)
    cost = labelling_cost(len(task.mesh.vertices), task.model, task.sampling)
    allowed = allowed_memory()
    if allowed is not None and cost.memory > allowed:
        raise NeedsMemory(cost.memory)
    labels = task.labels()
    _ = labels.epsilon_range, labels.load_result
    labelling = next(clock)
    best = _best_of(labels, settings.best)
    row = replace(row, grasps=_best_rows(best)).of(labels)
    row = _write(row, labels, best, job)
    return replace(
        row, seconds_reading=reading, seconds_labelling=labelling, seconds_writing=next(clock)
    )


def _lap_times() -> Iterator[float]:
    """Yield the time since the previous value [s]."""
    last = time.perf_counter()
    while True:
        now = time.perf_counter()
        yield now - last
        last = now


def _write(
    row: Row, labels: "SurfaceLabels", best: "GraspTable | JawGrasps | None", job: Job
) -> Row:
    """Write all results of a mesh except its row, each atomically; returns the row with them."""
    from grasp3d.formats import write_fields, write_ply

    output = job.output
    for name, write in {job.labels: write_ply, job.fields: write_fields}.items():
        with output.atomic_write(name) as path:
            write(path, labels)
    row = replace(row, labels=job.labels, fields=job.fields)
    if not job.has_page:
        return row
    from grasp3d.batch.report import write_object

    return write_object(row, labels, best, output, job.page)


def _best_of(labels: "SurfaceLabels", count: int) -> "GraspTable | JawGrasps | None":
    """Best distinct grasps of a surface; None: there are none, or none are asked for."""
    from grasp3d.grasps.best import best_grasps, has_poses
    from grasp3d.surface.vertex_grasps import Reason

    if not count or (not has_poses(labels) and not np.any(labels.reason == Reason.FOUND)):
        return None
    return best_grasps(labels, count)


def _best_rows(best: "GraspTable | JawGrasps | None") -> tuple[BestGrasp, ...]:
    """The best distinct grasps as they are stored in the row of a surface."""
    if best is None:
        return ()
    names, further = [label.name for label in sorted(Label)], _further_values(best)
    contacts: Any = getattr(best, "jaws", None) or getattr(best, "contacts", None)
    poses = best.poses
    return tuple(
        BestGrasp(
            label=names[best.letter[row]],
            score=float(best.score[row]),
            critical_angle=float(best.critical_angle[row]),
            max_resolution=float(best.max_resolution[row]),
            epsilon=float(best.epsilon[row]),
            opening=float(best.opening[row]),
            points=_triples(contacts.points[row]),
            normals=_triples(-contacts.normals[row]),
            pose=() if poses is None or np.isnan(poses[row]).any() else _flat(poses[row]),
            **{name: _finite(float(one[row])) for name, one in further.items()},
        )
        for row in range(best.size)
    )


def _finite(number: float) -> float | None:
    return number if math.isfinite(number) else None


def _flat(pose: Floats) -> tuple[float, ...]:
    return tuple(pose.ravel().tolist())


def _further_values(best: "GraspTable | JawGrasps") -> dict[str, Floats]:
    """How far the approach may turn, and what is held: by name in `BestGrasp`, shape (k,) each."""
    from grasp3d.describe.verdict import needed_force

    values = {"approach_margin": getattr(best, "approach_margin", None)}
    if best.load is not None:
        values |= {"grip_force": needed_force(best), "payload": best.payload}
    return {name: one for name, one in values.items() if one is not None}


def _triples(rows: Any) -> tuple[tuple[float, float, float], ...]:
    return tuple((float(x), float(y), float(z)) for x, y, z in rows)
