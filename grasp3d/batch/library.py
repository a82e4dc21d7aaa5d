"""Labelling of a library of meshes: plan, labels from many processes, results, report."""

import json
import logging
import os
import re
import time
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager, suppress
from dataclasses import dataclass, replace
from functools import cache, partial
from itertools import chain
from pathlib import Path, PurePosixPath
from typing import Any

from upath import UPath

from grasp3d.batch.batch_settings import BatchSettings, Surfaces
from grasp3d.batch.chunks import ChunkWriter, DamagedError, Library, current, open_library
from grasp3d.batch.inputs import MeshFile, find_meshes, local_copy
from grasp3d.batch.labelling import (
    METHOD,
    Job,
    JobSettings,
    content_hash,
    label_jobs,
    lost_job,
    mesh_key,
    settings_text,
)
from grasp3d.batch.report_page import SHOWN, write_report
from grasp3d.batch.row import Outcome, Row
from grasp3d.errors import GraspError, MeshError, OutputError, SettingError
from grasp3d.jobs.cluster_settings import ClusterSettings
from grasp3d.jobs.running import run
from grasp3d.settings.checks import check_choice
from grasp3d.stability.label import Label
from grasp3d.system.context import is_strict
from grasp3d.system.documents import package_version
from grasp3d.system.files import TEMPORARY_PREFIX
from grasp3d.system.names import as_unicode, name_key, printable, safe_stem, short_hash
from grasp3d.system.places import converted, place

try:
    import fcntl
except ImportError:  # Windows
    fcntl = None  # type: ignore[assignment]

logger = logging.getLogger(__name__)

MOST_PAGES = 1000
"""Largest number of meshes for which each mesh has pictures, a report page and a PLY."""

MOST_ROWS = {False: 64, True: 500}
"""Largest number of rows in a chunk, for up to `MOST_PAGES` meshes and for more."""

BYTES_PER_MESH = 100_000
"""Bytes added to the size of each file, as the work for a mesh is estimated from the size of its
file."""

STORED = ("labels", "surfaces", "report")
"""Folders of results."""

UNFINISHED = 86400.0
"""Age beyond which no run can still be writing an unfinished file [s]."""

KNOWN = ("mesh", "source", "outcome", "stamp", "content", "key", "warnings")
"""Columns that show which meshes are done."""


@dataclass(frozen=True)
class BatchProgress:
    """Progress of a batch, reported at the start and whenever a mesh is finished."""

    finished: int
    """Number of meshes that an earlier batch had finished."""
    labelled: int
    failed: int
    """Number of meshes that were refused or lost."""
    left: int
    """Number of meshes without a row yet, including those in progress."""
    fraction: float
    """Finished fraction of the work, estimated from file sizes, from 0 to 1."""
    row: Row | None = None
    """Row of the mesh that has just finished."""

    def with_row(self, row: Row, fraction: float) -> "BatchProgress":
        """Return the progress after one more row, with the work increased by a fraction."""
        labelled = row.outcome is Outcome.LABELLED
        return replace(
            self, labelled=self.labelled + labelled, failed=self.failed + (not labelled),
            left=self.left - 1, fraction=self.fraction + fraction, row=row,
        )  # fmt: skip


ProgressCallback = Callable[[BatchProgress], None]


def ignore_progress(progress: BatchProgress) -> None:
    """Ignore the progress of a batch."""


def label_library(
    inputs: Iterable[str | Path],
    output: str | Path,
    settings: BatchSettings | None = None,
    *,
    cluster: ClusterSettings | None = None,
    surfaces: Surfaces = "auto",
    part: str | None = None,
    overwrite: bool = False,
    force: bool = False,
    report: bool = True,
    progress: ProgressCallback = ignore_progress,
) -> Library:
    """Label every mesh of a library, and resume an earlier call.

    The folder `output` gets `labels/`, Parquet files with a row per mesh; `surfaces/`, the labelled
    surfaces; and `report/index.html`, with a page per mesh for up to 1,000 meshes. A mesh whose
    content, settings and version of the method equal those of its row is not labelled again. Meshes
    that fail have rows with the reason. If any process is interrupted, finished meshes stay
    finished; if this process is killed, those of the last minute are labelled again.

    Args:
        inputs: Folders, mesh files, globs, and tables of meshes (.csv, .parquet), on this machine
            or any file system that fsspec supports (s3://...).
        output: Folder for the results, on any of these file systems.
        settings: Settings of the labels.
        cluster: The processes that label the meshes.
        surfaces: How labelled surfaces are stored: ply, a file for each mesh; tar, a file of NPZ
            for a few hundred meshes; none; auto: as in the folder, or in a new one ply for up to
            1,000 meshes, and tar for more.
        part: Label only one part of the meshes, 'I/N': the I-th of N parts, which may run at the
            same time and write to the same folder. None: all.
        overwrite: Remove existing results, and label all meshes again.
        force: Accept lengths that are implausible for an object of a mesh's size; without it such a
            mesh fails.
        report: Write the report, and the pictures for it.
        progress: Called with the progress at the start and whenever a mesh is finished.

    Returns:
        The library, restricted to these meshes.

    Raises:
        MeshError: An input is missing, the inputs have no mesh, or a table is invalid.
        SettingError: The cluster cannot be reached, or the hand cannot make such grasps.
        OutputError: The results cannot be written, or `output` has results of other settings.

    Example:
        A library of one mesh, labelled in this process:

        >>> from pathlib import Path
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.jobs import ClusterSettings
        >>> Path("parts").mkdir()
        >>> _ = trimesh.creation.box([0.08, 0.05, 0.03]).export("parts/box.stl")
        >>> settings = grasp3d.BatchSettings(mesh=grasp3d.MeshOptions(unit="m", max_edge=0.02))
        >>> library = grasp3d.label_library(
        ...     ["parts"], "results", settings, cluster=ClusterSettings(workers=0), report=False
        ... )
        >>> [row] = library.rows()
        >>> print(f"{row.mesh}: {row.stable:.1%} surely stable")
        box.stl: 67.4% surely stable
        >>> sorted(path.name for path in Path("results/surfaces").iterdir())
        ['box.stl.ply']
    """
    settings, cluster = settings or BatchSettings(), cluster or ClusterSettings()
    if not str(output):
        raise OutputError("no folder for the results: name one")
    folder, (first, parts) = place(str(output), OutputError), _part(part)
    if part and overwrite:
        raise SettingError("a part overwrites nothing: remove the folder, then label all parts")
    found = find_meshes(map(str, inputs), results=str(output))
    settled = _settled(found, settings, folder)
    meshes = [*chain.from_iterable(settled)]
    many, prefix = len(meshes) > MOST_PAGES, f"{first}of{parts}" if part else "all"
    with _locked(folder, prefix):
        earlier = _earlier(folder, remove=overwrite)
        head = _head(settings, surfaces, earlier, many=many)
        keys = Counter(name_key(mesh.name) for mesh in meshes)
        jobs = [
            _job(
                mesh, earlier.rows.get(mesh.name), head["surfaces"],
                is_unique=keys[name_key(mesh.name)] == 1,
            )
            for mesh in chain.from_iterable(settled[first - 1 :: parts])
        ]  # fmt: skip
        todo = [job for job in jobs if not earlier.has(job.mesh, settings, force=force)]
        state = BatchProgress(len(jobs) - len(todo), 0, 0, len(todo), 0.0 if todo else 1.0)
        progress(state)
        work = {job.mesh.name: job.mesh.size + BYTES_PER_MESH for job in todo}
        whole = sum(work.values())
        each = JobSettings(settings, head["surfaces"], report and not many, force)
        writer = ChunkWriter(folder, prefix, head, MOST_ROWS[many])
        if not earlier.rows:
            writer.write()  # marks the folder, and detects a full disk at once
        done = run(
            partial(label_jobs, settings=each), _groups(todo), cluster=cluster, compiled=True
        )
        try:
            for one in done:
                for mesh in one.value or [lost_job(job, str(one.error)) for job in one.job]:
                    writer.add(mesh)
                    state = state.with_row(mesh.row, work[mesh.row.mesh] / whole)
                    progress(state)
        finally:  # also when interrupted
            done.close()
            if writer.waits:
                writer.write()
        writer.merge()
    library = open_library(output)
    if report:
        write_report(folder, library.rows(SHOWN), settings)
    return replace(library, only=frozenset(job.mesh.name for job in jobs))


def _part(text: str | None) -> tuple[int, int]:
    """Return the number of a part, and the number of parts."""
    if text is None:
        return 1, 1
    found = re.fullmatch(r"(\d{1,6})/(\d{1,6})", text)
    number, count = map(int, found.groups()) if found else (0, 0)
    if not 1 <= number <= count:
        raise SettingError(f"part must be I/N with I from 1 to N, such as 2/8; got {text!r}")
    return number, count


def _settled(
    meshes: Sequence[MeshFile], settings: BatchSettings, folder: UPath
) -> list[list[MeshFile]]:
    """List each mesh for each hand, with its own settings checked and its hand read.

    Raises:
        MeshError: Settings are invalid, or a mesh lies among the results.
    """
    below = tuple(f"{_location(str(folder))}/{name}/" for name in ("surfaces", "report"))
    of_mesh, settled = cache(lambda own: settings.of_mesh(dict(own))), list[list[MeshFile]]()
    for mesh in meshes:
        if _location(mesh.source).startswith(below):
            raise MeshError(f"{printable(mesh.source)}: is a result; it would be overwritten")
        try:
            own = of_mesh(tuple(mesh.own.items()))
            if settings.more_hands and "hand" in mesh.own:
                raise SettingError("the table states its hand; leave out more_hands (--more-hands)")
        except GraspError as error:
            raise MeshError(f"{printable(mesh.name)}: {error}") from error
        if "hand" in mesh.own:  # its content counts as well as its name, as it may change
            settled.append([replace(mesh, own={**mesh.own, "hand": own.reach.hand})])
        elif settings.more_hands:
            settled.append([
                replace(mesh, name=f"{hand.name}/{mesh.name}", own={**mesh.own, "hand": hand})
                for hand in settings.hands
            ])  # fmt: skip
        else:
            settled.append([mesh])
    return settled


def _groups(jobs: Iterable[Job]) -> list[tuple[Job, ...]]:
    """Group the jobs of each file, in an order that is independent of file sizes.

    So the finished work is a measure of the remaining time.
    """
    groups: dict[str, list[Job]] = {}
    for job in jobs:
        groups.setdefault(job.mesh.source, []).append(job)
    return [tuple(groups[source]) for source in sorted(groups, key=short_hash)]


@contextmanager
def _locked(folder: UPath, prefix: str) -> Iterator[None]:
    """Lock the chunks of a run; the operating system releases the lock with the process.

    An object store has no locks; there the lock has no effect.
    """
    if not isinstance(folder, Path) or fcntl is None:
        yield
        return
    with converted(folder, OutputError, "written"):
        folder.mkdir(parents=True, exist_ok=True)
        file = (folder / f".lock-{prefix}").open("w")
    with file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            raise OutputError(
                f"{printable(str(folder))}: another run is writing to it; wait until it ends, or "
                "name another folder"
            ) from error
        except OSError:  # a file system without locks
            pass
        yield


@dataclass(frozen=True)
class _Earlier:
    """Results that earlier runs have left in a folder."""

    folder: UPath
    head: Mapping[str, Any]
    """Metadata of the chunks; empty: there are no chunks."""
    rows: Mapping[str, Row]
    """Rows by name of the mesh, with the columns of `KNOWN`."""

    def has(self, mesh: MeshFile, settings: BatchSettings, *, force: bool) -> bool:
        """Whether a mesh is done and need not be labelled.

        A refused mesh is tried again if this run accepts any lengths, as these may be the reason. A
        mesh with warnings is tried again if warnings are errors.
        """
        row = self.rows.get(mesh.name)
        if row is None or row.outcome is Outcome.LOST:
            return False
        again = (force and row.outcome is Outcome.REFUSED) or (is_strict() and row.warnings)
        if again or row.key != mesh_key(row.content, settings, mesh.own):
            return False
        if mesh.stamp and mesh.stamp == row.stamp and as_unicode(mesh.source) == row.source:
            return True
        with suppress(GraspError), local_copy(mesh.source) as path:
            return content_hash(path) == row.content
        return False


def _earlier(folder: UPath, *, remove: bool) -> _Earlier:
    """Read the results in a folder; damaged chunks are removed.

    Raises:
        OutputError: The folder has other files, or results of a newer version.
    """
    damaged = False
    while True:
        try:
            library = current(folder)
            rows = library.rows(KNOWN) if library.chunks else []
            break
        except DamagedError as error:
            if not error.is_chunk:
                raise
            logger.warning("%s", error)
            error.path.unlink(missing_ok=True)  # another part may have replaced it meanwhile
            damaged = True
    with converted(folder, OutputError, "read"):
        stored = [folder / name for name in STORED]
        others = [one for one in stored if one.is_dir() and any(one.iterdir())]
        if others and not library.chunks and not damaged:
            raise OutputError(
                f"{printable(str(others[0]))}: grasp3d batch did not write it; name another folder"
            )
        for one in others if remove else ():
            one.fs.rm(one.path, recursive=True)
        for part in folder.glob(f"*/{TEMPORARY_PREFIX}*"):  # of killed runs
            if time.time() - part.stat().st_mtime > UNFINISHED:
                part.unlink()
    if remove or not library.chunks:
        return _Earlier(folder, {}, {})
    return _Earlier(folder, library.chunks[-1].head, {row.mesh: row for row in rows})


def _head(
    settings: BatchSettings, surfaces: Surfaces, earlier: _Earlier, *, many: bool
) -> dict[str, Any]:
    """Return the metadata of a run's chunks.

    Raises:
        OutputError: The folder has results of other settings.
    """
    check_choice("surfaces", surfaces, Surfaces)
    if surfaces == "auto":
        surfaces = earlier.head.get("surfaces") or ("tar" if many else "ply")
    head = {
        "method": METHOD,
        "settings": json.loads(settings_text(settings)),
        "surfaces": surfaces,
        "lengths": "m where the unit of a mesh is known, else that of its file",
        "angles": "rad",
        "poses": "rows of the 4 x 4 matrix from the gripper's frame to the mesh's",
        "codes": {label.name: int(label) for label in Label},
        "version": package_version(),
    }
    differs = [name for name in ("method", "settings", "surfaces") if name in earlier.head
               and earlier.head[name] != head[name]]  # fmt: skip
    if differs:
        what = {"method": "another version of the method", "settings": "other settings"}
        raise OutputError(
            f"{printable(str(earlier.folder))}: has results of "
            f"{what.get(differs[0], 'another kind of surfaces')}; name another folder, or replace "
            "them with --overwrite"
        )
    return head


def _job(mesh: MeshFile, row: Row | None, surfaces: Surfaces, *, is_unique: bool) -> Job:
    """Return the job of a mesh; its results are named after its file.

    Args:
        mesh: The mesh.
        row: Row of the mesh in the folder; None: it has no row.
        surfaces: How surfaces are stored.
        is_unique: Whether no other mesh has its name on file systems that ignore case.

    Raises:
        OutputError: The folder has labels of another file of this name.
    """
    source = as_unicode(mesh.source)
    if row is not None and _location(row.source) != _location(source) and not mesh.own:
        with suppress(MeshError, OSError):
            if place(row.source).exists():
                raise OutputError(
                    f"{printable(mesh.source)}: has the name {printable(mesh.name)}, by which this "
                    f"folder has labels of {printable(row.source)}; name another folder, or give "
                    "the folder that both are in"
                )
    # Names may be paths from anywhere, and WebDataset's keys have neither slashes nor dots.
    path = "/".join(map(safe_stem, PurePosixPath(mesh.name.replace(os.sep, "/")).parts))
    path = path if is_unique else f"{path}-{short_hash(mesh.name)}"
    key = f"{re.sub(r'[/.]', '_', path)}-{short_hash(mesh.name)}.npz"
    return Job(mesh, path, {"ply": f"surfaces/{path}.ply", "tar": key}.get(surfaces, ""))


def _location(source: str) -> str:
    return source if "://" in source else os.path.abspath(source)  # noqa: PTH100, links stay
