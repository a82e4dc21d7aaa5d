"""Labelling one mesh of a batch: a pure function of the file and the settings."""

import math
import time
from collections.abc import Iterator, Sequence
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
from grasp3d.stability.angle_distributions import AngleDistribution, SampledAngles
from grasp3d.stability.label import Label
from grasp3d.system.context import running
from grasp3d.system.versions import package_version

if TYPE_CHECKING:
    from grasp3d.grasps.jaw_grasps import JawGrasps
    from grasp3d.surface.grasp_table import GraspTable
    from grasp3d.surface.labels import SurfaceLabels

QUARTILES = (0.1, 0.25, 0.5, 0.75, 0.9)
DECILES = (0.1, 0.5, 0.9)
REQUIRED = (0.5, 0.8, 0.9)


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
    row = _unlabelled_row(job, settings)
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


def _unlabelled_row(job: Job, settings: BatchSettings) -> Row:
    """Row of a mesh with the values that are known before it is read."""
    mesh = job.mesh
    return Row(
        mesh=mesh.name,
        source=mesh.source,
        bytes=mesh.size,
        stamp=mesh.stamp,
        version=package_version(),
        method=METHOD,
        friction_min=settings.model.friction_interval[0],
        friction_max=settings.model.friction_interval[1],
        sensor_resolution=settings.model.sensor_resolution,
        fingers=settings.model.fingers,
        gripper=None if settings.reach.hand is None else settings.reach.hand.name,
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
    _write(labels, job)
    return replace(
        row,
        labels=job.labels,
        fields=job.fields,
        thumbnail=job.thumbnail,
        **_surface_values(labels),
        location_error=labels.model.location_error,
        **_angle_values(labels),
        **_verdict_values(labels),
        **_load_values(labels),
        grasps=_best_rows(best),
        warnings="; ".join(labels.warnings),
        seconds_reading=reading,
        seconds_labelling=labelling,
        seconds_writing=next(clock),
    )


def _lap_times() -> Iterator[float]:
    """Yield the time since the previous value [s]."""
    last = time.perf_counter()
    while True:
        now = time.perf_counter()
        yield now - last
        last = now


def _write(labels: "SurfaceLabels", job: Job) -> None:
    """Write all results of a mesh except its row, each atomically."""
    from grasp3d.batch.report import thumbnail
    from grasp3d.formats import write_fields, write_ply

    output = job.output
    for name, write in {job.labels: write_ply, job.fields: write_fields}.items():
        with output.atomic_write(name) as path:
            write(path, labels)
    output.write(job.thumbnail, thumbnail(labels))


def _surface_values(labels: "SurfaceLabels") -> dict[str, Any]:
    mesh, fractions = labels.mesh, labels.fractions()
    x, y, z = mesh.center_mass.tolist()
    return {
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "size": mesh.size,
        "unit": mesh.unit,
        "closed": mesh.report.closed,
        "area": mesh.area,
        "volume": _finite_or_none(mesh.volume),
        "center_mass": (x, y, z),
        "torque_scale": mesh.torque_scale,
        "stable": fractions["S"],
        "ambiguous": fractions["M"],
        "no_grasp_found": fractions["U"],
        "repairs": "; ".join(map(str, mesh.report.repairs)),
    }


def _angle_values(labels: "SurfaceLabels") -> dict[str, Any]:
    model, angles = labels.model, _angles_of(labels)
    available = replace(model, sensor_resolution=0.0).sure_angle  # for a sensor
    return {
        **_quantiles(labels, "critical_angle", QUARTILES),
        **_quantiles(labels, "epsilon", DECILES),
        **_quantiles(labels, "epsilon_min", DECILES),
        **{
            f"required_resolution_{100.0 * fraction:.0f}": max(
                0.0, 2.0 * (available - angles.worst_quantile(fraction))
            )
            for fraction in REQUIRED
        },
        **{  # the largest angles are the smallest margins
            f"margin_p{100.0 * level:.0f}": model.sure_angle - angles.worst_quantile(1.0 - level)
            for level in DECILES
        },
        "search_angle": labels.search.cone,
    }


def _verdict_values(labels: "SurfaceLabels") -> dict[str, Any]:
    from grasp3d.describe.causes import causes_text
    from grasp3d.describe.verdict import verdict_of

    verdict, load = verdict_of(labels), {}
    if (load_result := verdict.load_result) is not None:
        load = {
            "holds": load_result.holds,
            "grip_force_needed": load_result.needed,
            "payload_best": _finite_or_none(load_result.payload),
        }
    return {
        "verdict": verdict.word,
        "verdict_text": str(verdict),
        "causes": causes_text(labels),
        "stable_grasps": verdict.count,
        "spare_resolution": _finite_or_none(verdict.spare_resolution),
        **load,
    }


def _load_values(labels: "SurfaceLabels") -> dict[str, Any]:
    """What the grasps hold; nothing without a load."""
    from grasp3d.quality.loads import load_settings
    from grasp3d.surface.area_statistics import label_fractions, vertex_weights

    load_result = labels.load_result
    if load_result is None:
        return {}
    codes, weights = load_result.label, vertex_weights(labels.mesh, "area")
    return {
        "task": load_settings(labels.load)["task"],
        "mass": load_result.mass,
        "grip_force_at_hand": load_result.available,
        "held": None if codes is None else label_fractions(codes, weights)["S"],
        **_quantiles(labels, "payload", DECILES),
    }


def _finite_or_none(number: float) -> float | None:
    return number if math.isfinite(number) else None


def _quantiles(labels: "SurfaceLabels", name: str, levels: Sequence[float]) -> dict[str, float]:
    """Quantiles of a column, where the labels have it, by the names of their columns."""
    values = labels.quantiles(name, levels)
    if values is None:
        return {}
    return {
        f"{name}_p{100.0 * level:.0f}": float(value)
        for level, value in zip(levels, values, strict=True)
    }


def _angles_of(labels: "SurfaceLabels") -> AngleDistribution:
    """Distribution of the critical angles, to be compared with the thresholds of a model."""
    from grasp3d.surface.area_statistics import vertex_weights

    weights = vertex_weights(labels.mesh, "area")
    counted = weights > 0.0
    worst, best = labels.critical_angle[counted], labels.critical_angle_best[counted]
    return SampledAngles(worst, best, weights[counted], limit=labels.search.cone)


def _best_of(labels: "SurfaceLabels", count: int) -> "GraspTable | JawGrasps | None":
    """Best distinct grasps of a surface; None: there are none, or none are asked for."""
    from grasp3d.grasps.best import are_named, best_grasps, has_poses
    from grasp3d.surface.vertex_grasps import Reason

    if not count or not are_named(labels):
        return None
    if not has_poses(labels) and not np.any(labels.reason == Reason.FOUND):
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
            **{name: _finite_or_none(float(one[row])) for name, one in further.items()},
        )
        for row in range(best.size)
    )


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
