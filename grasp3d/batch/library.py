"""Labelling a library of meshes: planned, labelled by many processes, stored, reported."""

import time
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property, partial
from pathlib import Path
from typing import Any

from grasp3d.batch.batch_settings import BatchSettings, ClusterSettings
from grasp3d.batch.inputs import MeshFile, find_meshes, use_stored_names
from grasp3d.batch.job_requests import local_workers
from grasp3d.batch.labelling import Unchanged, label_job, lost_row
from grasp3d.batch.plan import Job, plan, use_all_processors
from grasp3d.batch.report import write_report
from grasp3d.batch.row import Outcome, Row, Summary
from grasp3d.batch.run import run
from grasp3d.batch.storage.files import local_path
from grasp3d.batch.storage.folder import Folder
from grasp3d.batch.store import Store
from grasp3d.errors import OutputError
from grasp3d.system.context import is_strict

SHARED_FOLDER_TIMEOUT = 10.0
"""Time until a shared folder shows a file that another machine has written [s]."""

MOST_PAGES = 1000
"""Meshes up to which each of them has pictures, and a page of its own in the report."""

BYTES_PER_MESH = 100_000
"""Bytes added to the size of each file: the work for a mesh is estimated by the bytes of its
file."""


@dataclass(frozen=True)
class BatchProgress:
    """Progress of a batch, reported whenever a mesh is started or finished."""

    finished: int
    """Meshes that an earlier batch had finished."""
    stale: int
    """Meshes of this batch whose labels of other settings are replaced."""
    labelled: int
    failed: int
    """Refused or lost."""
    left: int
    """Meshes without a row yet, including the running ones."""
    fraction: float
    """Fraction of the work that is done, estimated by the size of the files, from 0 to 1."""
    row: Row | None = None
    """Row of the mesh that has just finished."""


ProgressCallback = Callable[[BatchProgress], None]


def ignore_progress(progress: BatchProgress) -> None:
    """Do nothing with the progress of a batch."""


class _ProgressCounter:
    """Counts what a batch has done, and reports it."""

    def __init__(
        self, meshes: Sequence[MeshFile], finished: int, stale: int, report: ProgressCallback
    ) -> None:
        """Count the meshes to label; the other arguments are those of `BatchProgress`."""
        self._total_work = sum(mesh.size + BYTES_PER_MESH for mesh in meshes)
        self._work_done, self._report_to = 0, report
        self._running: dict[str, MeshFile] = {}
        fraction = 0.0 if meshes else 1.0
        self._progress = BatchProgress(finished, stale, 0, 0, len(meshes), fraction)
        report(self._progress)

    def start(self, mesh: MeshFile) -> None:
        """Count a mesh that is sent to a worker."""
        self._running[mesh.name] = mesh
        self._report(row=None)

    def finish(self, row: Row) -> None:
        """Count a mesh that has got a row."""
        before, labelled = self._progress, row.outcome == Outcome.LABELLED
        self._work_done += self._running.pop(row.mesh).size + BYTES_PER_MESH
        self._report(
            labelled=before.labelled + labelled,
            failed=before.failed + (not labelled),
            left=before.left - 1,
            fraction=self._work_done / self._total_work,
            row=row,
        )

    def _report(self, **changes: Any) -> None:
        self._progress = replace(self._progress, **changes)
        self._report_to(self._progress)


@dataclass(frozen=True)
class LibraryLabels:
    """Results of a batch."""

    output: str
    """Folder of the results."""
    rows: Mapping[str, Row]
    """A row for each input mesh, by the mesh's name and in the order of names."""
    finished: int
    """How many of them were finished by an earlier batch."""

    @cached_property
    def failed(self) -> tuple[Row, ...]:
        """Rows of meshes that were not labelled."""
        return tuple(row for row in self.rows.values() if row.outcome != Outcome.LABELLED)

    @property
    def summary(self) -> Summary:
        """The rows as a list, with `to_table` (Arrow) and `to_dataframe` (pandas)."""
        return Summary(self.rows.values())


def label_library(
    inputs: Iterable[str | Path],
    output: str | Path,
    settings: BatchSettings | None = None,
    *,
    cluster: ClusterSettings | None = None,
    overwrite: bool = False,
    force: bool = False,
    report: bool = True,
    progress: ProgressCallback = ignore_progress,
) -> LibraryLabels:
    """Label every mesh of a library, largest files first; resumes an earlier call.

    Below `output`: `labels/NAME.ply`, `fields/NAME.parquet` (a row per vertex), `summary/` (a
    Parquet data set, a row per mesh) and `report/index.html`, with a page per mesh for up to 1,000
    meshes. A mesh whose content, settings and
    version of the method equal those of its row is not labelled again. Meshes that fail have rows
    with the reason. If any process is interrupted, finished meshes stay finished.

    Args:
        inputs: Folders, mesh files, globs, lists (.txt), on this machine or any file system that
            fsspec supports (s3://...).
        output: Folder for the results, on any of these file systems.
        settings: Settings of the labels.
        cluster: Which processes label the meshes.
        overwrite: Label all meshes again, and remove labels of other meshes that were made with
            other settings.
        force: Accept lengths that cannot be meant for an object of a mesh's size; without it such
            a mesh fails.
        report: Write the report, and the pictures for it.
        progress: Called with the progress whenever a mesh is started or finished.

    Raises:
        MeshError: An input is missing, or there is no mesh among them.
        SettingError: The cluster cannot be reached, or the hand cannot make such grasps.
        OutputError: The results cannot be written, or `output` contains other meshes with other
            settings.

    Example:
        A library of one mesh, labelled in this process:

        >>> from pathlib import Path
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.batch import ClusterSettings
        >>> Path("parts").mkdir()
        >>> _ = trimesh.creation.box([0.08, 0.05, 0.03]).export("parts/box.stl")
        >>> settings = grasp3d.BatchSettings(mesh=grasp3d.MeshOptions(unit="m", max_edge=0.02))
        >>> done = grasp3d.label_library(
        ...     ["parts"], "results", settings, cluster=ClusterSettings(workers=0), report=False
        ... )
        >>> print(f"{done.rows['box.stl'].stable:.1%} surely stable, {len(done.failed)} failed")
        67.4% surely stable, 0 failed
        >>> sorted(path.name for path in Path("results/labels").iterdir())
        ['box.ply']
    """
    settings, folder = settings or BatchSettings(), Folder(str(output))
    cluster = cluster or ClusterSettings()
    if settings.reach.hand is not None:
        settings.reach.hand.check_fingers(settings.model.fingers)
    if not str(output):
        raise OutputError("no folder for the results: name one")
    files = find_meshes(map(str, inputs), results=folder.url)
    store = Store(folder, settings, overwrite=overwrite)
    try:
        meshes = use_stored_names(files, store.rows)
        jobs, finished = _jobs_to_run(meshes, store, overwrite=overwrite, force=force)
        pages = report and len(meshes) <= MOST_PAGES
        jobs = [replace(job, has_page=pages) for job in jobs]
        if cluster.scheduler is None:
            jobs = use_all_processors(jobs, local_workers(cluster))
        stale = store.begin(job.mesh.name for job in jobs)
        counter = _ProgressCounter([job.mesh for job in jobs], finished, stale, progress)
        check_shared_folder = cluster.scheduler is not None
        for result in run(
            partial(label_job, force=True) if force else label_job,
            jobs,
            settings,
            lost=lost_row,
            cluster=cluster,
            started=lambda job: counter.start(job.mesh),
            compiled=True,
        ):
            row = _row_of(result, store.rows)
            if check_shared_folder and row.labels:
                _check_shared(store.output, row)
                check_shared_folder = False
            store.add(row)
            counter.finish(row)
    finally:  # also when interrupted
        store.close()
    if report:
        write_report(folder, [store.rows[name] for name in sorted(store.rows)], settings)
    names = sorted(mesh.name for mesh in meshes)
    return LibraryLabels(folder.url, {name: store.rows[name] for name in names}, finished)


def _jobs_to_run(
    meshes: Sequence[MeshFile], store: Store, *, overwrite: bool, force: bool
) -> tuple[list[Job], int]:
    """Jobs for the unfinished meshes, the largest first, and the number of finished meshes.

    A mesh that was refused, perhaps for its lengths, is tried again if this call accepts them; one
    with warnings if they are errors.
    """
    jobs = plan(meshes, store.output, earlier=_stems(store.rows))
    if not overwrite:
        again = {
            name
            for name, row in store.rows.items()
            if (force and row.outcome is Outcome.REFUSED) or (is_strict() and row.warnings)
        }
        jobs = [job for job in jobs if job.mesh.name in again or not store.finished(job.mesh)]
        jobs = [
            job
            if job.mesh.name in again
            else replace(job, known_content=store.known_content(job.mesh))
            for job in jobs
        ]
    jobs.sort(key=lambda job: (-job.mesh.size, job.mesh.name))
    return jobs, len(meshes) - len(jobs)


def _check_shared(output: Folder, row: Row) -> None:
    """Check that a worker of a cluster writes to the folder that this process reads."""
    path, end = local_path(output.path(row.labels)), time.monotonic() + SHARED_FOLDER_TIMEOUT
    while path is not None and not path.exists():
        if time.monotonic() > end:
            raise OutputError(
                f"{output.url}: a worker of the cluster has written results, but they do not "
                "appear here; name a folder that all machines access, or an object store"
            )
        time.sleep(0.1)


def _row_of(result: Row | Unchanged, rows: Mapping[str, Row]) -> Row:
    """Row of a finished mesh; an unchanged mesh keeps its row, with the new stamp."""
    if isinstance(result, Unchanged):
        row = rows[result.mesh.name]
        stamp = result.mesh.stamp if row.stamp else ""  # none for meshes with side files
        return replace(row, stamp=stamp, source=result.mesh.source)
    return result


def _stems(rows: Mapping[str, Row]) -> dict[str, str]:
    """Stems of the existing results, by the name of their mesh."""
    return {
        name: row.labels.removeprefix("labels/").removesuffix(".ply")
        for name, row in rows.items()
        if row.labels
    }
