"""A library of meshes: planned, labelled by many processes, kept, resumed, reported."""

import time
from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path

from grasp3d.batch.batch_settings import BatchSettings, ClusterSettings
from grasp3d.batch.inputs import MeshFile, find_meshes
from grasp3d.batch.labelling import Unchanged, label_job, lost_row, warm_up
from grasp3d.batch.plan import Job, plan
from grasp3d.batch.renaming import known_names
from grasp3d.batch.report import write_report
from grasp3d.batch.row import Outcome, Row
from grasp3d.batch.run import run
from grasp3d.batch.state import Books, Watch, unwatched
from grasp3d.batch.store import Store
from grasp3d.errors import OutputError
from grasp3d.storage import Folder, local_path

REPORT = "report/index.html"

LOOKING = 10.0
"""Time that a shared folder may take to show what another machine has written [s]."""


@dataclass(frozen=True)
class LibraryLabels:
    """What is known of a library after a batch."""

    output: str
    """Folder of the results."""
    rows: Mapping[str, Row]
    """One for each mesh among the inputs, by the mesh's name and in the order of names."""
    finished: int
    """How many of them were finished by an earlier batch."""
    told: tuple[str, ...]
    """What was wrong with the folder of the results, and what was done about it."""

    @cached_property
    def failed(self) -> tuple[Row, ...]:
        """Rows of meshes that were not labelled."""
        return tuple(row for row in self.rows.values() if row.outcome != Outcome.LABELLED)


def label_library(
    inputs: Iterable[str | Path],
    output: str | Path,
    settings: BatchSettings | None = None,
    *,
    cluster: ClusterSettings | None = None,
    force: bool = False,
    report: bool = True,
    watch: Watch = unwatched,
) -> LibraryLabels:
    """Label every mesh of a library, largest files first; resumes what an earlier call began.

    Below `output`: `labels/NAME.ply`, `fields/NAME.parquet` (a row per vertex), `summary/` (a
    Parquet data set, a row per mesh) and `report/index.html`. A mesh whose content, settings and
    version of the method are those of its row is not labelled again. Meshes that fail are rows with
    the reason. What was done by the time of an interruption, of any process, is kept.

    Args:
        inputs: Folders, mesh files, globs, lists (.txt), on this machine or any file system that
            fsspec knows (s3://...).
        output: Folder for the results, likewise.
        settings: What all meshes are labelled with.
        cluster: Who does the work.
        force: Label all anew.
        report: Write the report.
        watch: Told how it goes.

    Raises:
        MeshError: An input is missing, or there is no mesh among them.
        SettingError: The cluster cannot be reached.
        OutputError: The results cannot be written, or `output` holds other meshes with other
            settings.
    """
    settings, folder = settings or BatchSettings(), Folder(str(output))
    if not str(output):
        raise OutputError("no folder for the results: name one")
    found = find_meshes(map(str, inputs), results=folder.url)
    store = Store.open(folder, settings, force=force)
    try:
        meshes = known_names(found, store.rows)
        jobs, finished = _to_do(meshes, store, force=force)
        store.begin(job.mesh.name for job in jobs)
        stale = sum(1 for job in jobs if store.is_stale(job.mesh.name))
        books = Books([job.mesh for job in jobs], finished, stale, watch)
        for row in _rows(jobs, settings, cluster or ClusterSettings(), store, books):
            store.add(row)
            books.end(row)
    finally:  # also when interrupted: what is done is done
        store.close()
    if report:
        write_report(folder, store.rows_of(sorted(store.rows)).values(), settings)
    names = sorted(mesh.name for mesh in meshes)
    return LibraryLabels(folder.url, store.rows_of(names), finished, tuple(store.told))


def _to_do(meshes: Sequence[MeshFile], store: Store, *, force: bool) -> tuple[list[Job], int]:
    """Jobs for what is not finished, the largest first, and how many meshes are."""
    jobs = plan(meshes, store.output, taken=_stems(store.rows))
    if not force:
        jobs = [job for job in jobs if not store.finished(job.mesh)]
        jobs = [replace(job, known=store.known(job.mesh)) for job in jobs]
    jobs.sort(key=lambda job: (-job.mesh.size, job.mesh.name))
    return jobs, len(meshes) - len(jobs)


def _rows(
    jobs: Sequence[Job],
    settings: BatchSettings,
    cluster: ClusterSettings,
    store: Store,
    books: Books,
) -> Iterator[Row]:
    """Label the meshes; yields each row when it is known."""
    away = cluster.scheduler is not None
    if jobs and cluster.workers != 0 and not away:
        warm_up(settings)
    for came in run(
        label_job,
        jobs,
        settings,
        lost=lost_row,
        cluster=cluster,
        started=lambda job: books.begin(job.mesh),
    ):
        row = _row_of(came, store.rows)
        if away and row.labels:
            _check_here(store.output, row)
            away = False
        yield row


def _check_here(output: Folder, row: Row) -> None:
    """Tell whether a worker of a cluster writes to the same folder as this process reads."""
    path, end = local_path(output.path(row.labels)), time.monotonic() + LOOKING
    while path is not None and not path.exists():
        if time.monotonic() > end:
            raise OutputError(
                f"{output.url}: a worker of the cluster has written to it, but nothing came here; "
                "name a folder that all machines share, or an object store"
            )
        time.sleep(0.1)


def _row_of(came: Row | Unchanged, known: Mapping[str, Row]) -> Row:
    """Row of a mesh that has come back; of one that is unchanged its own, with the new stamp."""
    if isinstance(came, Unchanged):
        row = known[came.mesh.name]
        stamp = came.mesh.stamp if row.stamp else ""  # of files that others lie beside
        return replace(row, stamp=stamp, source=came.mesh.source)
    return came


def _stems(rows: Mapping[str, Row]) -> dict[str, str]:
    """What the results of meshes that are labelled already are called."""
    return {
        name: row.labels.removeprefix("labels/").removesuffix(".ply")
        for name, row in rows.items()
        if row.labels
    }
