"""What is done for one mesh: a pure function of the file and the settings."""

import itertools
import logging
import math
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from grasp3d.batch.batch_settings import ROUNDING, BatchSettings
from grasp3d.batch.identity import METHOD, content_of, mesh_key
from grasp3d.batch.inputs import MeshFile
from grasp3d.batch.plan import Job
from grasp3d.batch.row import BestGrasp, Outcome, Row, Share
from grasp3d.costs import labelling_cost
from grasp3d.errors import GraspError, MeshUnreadError, OutputError
from grasp3d.isolation import NeedsMemory, allowed_memory, call
from grasp3d.reading.side_files import side_names
from grasp3d.settings import GraspModel
from grasp3d.storage import local_copy
from grasp3d.system.progress import ignore
from grasp3d.system.versions import package_version

if TYPE_CHECKING:
    from grasp3d.surface.labels import SurfaceLabels

logger = logging.getLogger(__name__)

QUARTILES = (0.1, 0.25, 0.5, 0.75, 0.9)
DECILES = (0.1, 0.5, 0.9)
REQUIRED = (0.5, 0.8, 0.9)
_CUBE = np.array(
    [[0, 1, 3], [0, 3, 2], [4, 6, 7], [4, 7, 5], [0, 4, 5], [0, 5, 1],
     [2, 3, 7], [2, 7, 6], [0, 2, 6], [0, 6, 4], [1, 5, 7], [1, 7, 3]]
)  # fmt: skip


@dataclass(frozen=True)
class Unchanged:
    """A mesh whose row still holds: its file was touched, but its content is the same."""

    mesh: MeshFile


def label_job(job: Job, settings: BatchSettings) -> Row | Unchanged:
    """Label one mesh and write all its results.

    Args:
        job: The mesh, and where its results go.
        settings: What all meshes are labelled with.

    Returns:
        The mesh's row of the summary, which is all that is left to write; one that cannot be
        labelled has its reason in `error`. `Unchanged`, where its content is what is known already.

    Raises:
        NeedsMemory: It is expected to take more memory than this process may.
    """
    begun = time.perf_counter()
    row = _head(job, settings)
    try:
        with local_copy(job.mesh.source) as path:
            content = content_of(path)
            if content == job.known:
                return Unchanged(job.mesh)
            # Of a mesh with files beside it, its own date tells nothing.
            stamp = "" if side_names(path) else row.stamp
            key = mesh_key(content, settings)
            row = replace(row, content=content, key=key, stamp=stamp)
            row = _labelled(path, job, settings, row)
    except (OutputError, MeshUnreadError) as error:  # what is full or away now may not be tomorrow
        row = replace(row, outcome=Outcome.LOST, error=str(error))
    except GraspError as error:
        row = replace(row, outcome=Outcome.REFUSED, error=str(error))
    return replace(row, seconds=time.perf_counter() - begun)


def warm_up(settings: BatchSettings) -> None:
    """Compile what labelling needs, if nothing is yet: once, and not as part of a mesh's time.

    Args:
        settings: What meshes will be labelled with.
    """
    from grasp3d._kernels.compiling import compiled_before

    if not compiled_before():
        logger.info("compiling, which the first run has to do; it takes a minute or two")
        with suppress(GraspError):  # whatever is wrong is told of each mesh
            call(_label_cube, settings)


def _label_cube(settings: BatchSettings) -> None:
    from grasp3d.mesh import mesh_from_arrays
    from grasp3d.surface.labelling import label_surface

    corners = np.array(list(itertools.product((0.0, 1.0), repeat=3)))
    mesh = mesh_from_arrays(corners, _CUBE, max_edge=2.0)
    label_surface(mesh, settings.model, threads=1).measure(ignore)


def lost_row(job: Job, reason: str) -> Row:
    """Row of a mesh whose process did not come back with one.

    Args:
        job: The mesh.
        reason: What ended the process.
    """
    mesh = job.mesh
    return Row(
        mesh=mesh.name,
        source=mesh.source,
        outcome=Outcome.LOST,
        error=f"{mesh.source}: {reason}",
        bytes=mesh.size,
        version=package_version(),
        method=METHOD,
    )


def _head(job: Job, settings: BatchSettings) -> Row:
    """What is known of a mesh before it is read."""
    mesh = job.mesh
    return Row(
        mesh=mesh.name,
        source=mesh.source,
        bytes=mesh.size,
        stamp=mesh.stamp,
        version=package_version(),
        method=METHOD,
        friction=settings.model.friction,
        sensor_resolution=settings.model.sensor_resolution,
        fingers=settings.model.fingers,
    )


def _labelled(path: Path, job: Job, settings: BatchSettings, row: Row) -> Row:
    # Loaded here: whoever plans a batch or reads its rows needs no rays and no compiler.
    from grasp3d.diagnosis.length_warnings import length_warnings
    from grasp3d.mesh import prepare_file
    from grasp3d.surface.labelling import label_surface

    model, sampling = settings.model, settings.search
    clock = _clock()
    next(clock)
    mesh = prepare_file(path, settings.mesh, threads=1)
    reading = next(clock)
    cost, allowed = labelling_cost(len(mesh.vertices), model, sampling), allowed_memory()
    if allowed is not None and cost.memory > allowed:
        raise NeedsMemory(cost.memory)
    labels = label_surface(mesh, model, sampling=sampling, threads=1)
    labels.measure(ignore)
    labelling = next(clock)
    grasps = _best(labels, settings.best)
    _write(labels, job, grasps)
    warnings = length_warnings(mesh.size, mesh.unit, model, settings.sampling, settings.mesh)
    return replace(
        row,
        labels=job.labels,
        fields=job.fields,
        view=job.view,
        thumbnail=job.thumbnail,
        **_of_surface(labels),
        **_of_angles(labels),
        shares=tuple(_shares(labels, settings)),
        grasps=grasps,
        warnings="; ".join((*mesh.report.warnings, *warnings)),
        seconds_reading=reading,
        seconds_labelling=labelling,
        seconds_writing=next(clock),
    )


def _clock() -> Iterator[float]:
    """Seconds since it was last asked."""
    last = time.perf_counter()
    while True:
        now = time.perf_counter()
        yield now - last
        last = now


def _write(labels: "SurfaceLabels", job: Job, grasps: tuple[BestGrasp, ...]) -> None:
    """Write all results of a mesh but its row, each whole or not at all."""
    from grasp3d.batch.report import object_script, thumbnail
    from grasp3d.export import write_fields, write_ply

    output = job.output
    for name, write in {job.labels: write_ply, job.fields: write_fields}.items():
        with output.making(name) as part:
            write(part, labels)
    output.write(job.view, object_script(labels, job.mesh.name, grasps))
    output.write(job.thumbnail, thumbnail(labels))


def _of_surface(labels: "SurfaceLabels") -> dict[str, Any]:
    mesh, fractions = labels.mesh, labels.fractions()
    x, y, z = mesh.center_mass.tolist()
    return {
        "vertices": len(mesh.vertices),
        "faces": len(mesh.faces),
        "size": mesh.size,
        "unit": mesh.unit,
        "closed": mesh.report.closed,
        "area": float(mesh.vertex_areas.sum()),
        "volume": mesh.volume if math.isfinite(mesh.volume) else None,
        "center_mass": (x, y, z),
        "torque_scale": mesh.torque_scale,
        "stable": fractions["S"],
        "ambiguous": fractions["M"],
        "no_grasp_found": fractions["U"],
        "repairs": "; ".join(map(str, mesh.report.repairs)),
    }


def _of_angles(labels: "SurfaceLabels") -> dict[str, Any]:
    beta, angles = labels.model.friction_angle, labels.angle_distribution()
    return {
        **_quantiles("critical_angle", QUARTILES, labels.angle_quantiles(QUARTILES)),
        **_quantiles("epsilon", DECILES, labels.epsilon_quantiles(DECILES)),
        **_quantiles("epsilon_min", DECILES, labels.epsilon_quantiles(DECILES, of="minimum")),
        **{
            f"required_resolution_{100.0 * share:.0f}": max(
                0.0, 2.0 * (beta - angles.worst_quantile(share))
            )
            for share in REQUIRED
        },
        "search_angle": labels.search.cone,
    }


def _quantiles(name: str, levels: Iterable[float], values: Iterable[float]) -> dict[str, float]:
    """Name the quantiles of one quantity as the summary has them."""
    return {
        f"{name}_p{100.0 * level:.0f}": float(value)
        for level, value in zip(levels, values, strict=True)
    }


def _shares(labels: "SurfaceLabels", settings: BatchSettings) -> Iterator[Share]:
    """Shares over the grid; M and U are told apart only as far as grasps were searched."""
    angles = labels.angle_distribution()
    for friction in settings.frictions:
        beta = GraspModel(friction=friction).friction_angle
        for resolution in settings.resolutions:
            stable = float(angles.worst_below(beta - 0.5 * resolution))
            ambiguous = unstable = None
            if min(beta + 0.5 * resolution, math.pi / 2.0) <= angles.limit + ROUNDING:
                told = angles.fractions(friction=friction, sensor_resolution=resolution)
                ambiguous, unstable = told["M"], told["U"]
            yield Share(friction, resolution, stable, ambiguous, unstable)


def _best(labels: "SurfaceLabels", count: int) -> tuple[BestGrasp, ...]:
    """Take the best distinct grasps as the summary has them."""
    from grasp3d.grasps.distinct import best_grasps
    from grasp3d.surface.labels import Reason

    if not count or not np.any(labels.reason == Reason.FOUND):
        return ()
    best = best_grasps(labels, count)
    # The first finger is at a vertex, whose epsilon is known.
    places = best.contacts.surface_points
    vertices = labels.mesh.faces[places.faces[:, 0], places.weights[:, 0].argmax(axis=1)]
    return tuple(
        BestGrasp(
            critical_angle=float(best.critical_angle[number]),
            max_resolution=float(best.max_resolution[number]),
            epsilon=float(labels.epsilon[vertices[number]]),
            opening=float(best.opening[number]),
            points=_triples(best.contacts.points[number]),
            normals=_triples(-best.contacts.normals[number]),
        )
        for number in range(best.size)
    )


def _triples(rows: Any) -> tuple[tuple[float, float, float], ...]:  # noqa: ANN401
    return tuple((float(x), float(y), float(z)) for x, y, z in rows)
