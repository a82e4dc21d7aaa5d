"""The store of a batch: the rows of all meshes, kept on disk so that they survive a crash.

Its files are the marker, the summary with a row per mesh, and the journal. The summary is a set of
Parquet files, shards, each replaced atomically, with the row of a mesh in one of them. The journal
is JSON files with rows that are not in the summary yet.
"""

import json
import re
import secrets
import time
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Any

from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.identity import METHOD, mesh_key, settings_text
from grasp3d.batch.inputs import MARKER, STORED, MeshFile
from grasp3d.batch.row import Outcome, PackedRows, Row, Summary
from grasp3d.batch.storage.folder import Folder, Lock
from grasp3d.errors import OutputError
from grasp3d.system.documents import typed
from grasp3d.system.names import as_unicode, printable
from grasp3d.system.tables import pack_records, unpack_records
from grasp3d.system.versions import package_version

FORMAT = 2
"""Version of the store's files; other versions of grasp3d may be unable to read them."""

MAX_ROWS = 1000
"""Rows of a shard, after which the next one begins; all of them are unpacked to write it."""

SMALL, MAX_SMALL = 500, 16
"""Shards with fewer rows are small; more small shards than this are merged."""

_SHARD_NAME = re.compile(r"summary/part-(\d{5,})(-\w+)?\.parquet")

JOURNAL = "journal"

_ENTRY_NAME = re.compile(r"journal/[0-9a-f]{8}-\d{8,}\.json")
"""Names of the journal's files."""


def read_marker(output: Folder) -> tuple[bytes | None, bool]:
    """Read the marker of a store, or check that a folder without a marker can become a store.

    Args:
        output: Folder for the results.

    Returns:
        (the marker's content, None where there is none; whether it is valid).

    Raises:
        OutputError: Another version wrote the store, or the folder contains
            other files in the folders of a store.
    """
    try:
        data = output.read(MARKER)
    except FileNotFoundError:
        _check_free(output)
        return None, False
    try:
        marker = json.loads(data)
        version = int(marker["format"])
    except (KeyError, TypeError, ValueError):
        return data, False
    if version != FORMAT:
        age, remedy = ("a newer", "update grasp3d, or ") if version > FORMAT else ("an older", "")
        raise OutputError(
            f"{printable(output.url)}: is a store of {age} version of grasp3d "
            f"({printable(str(marker.get('version')))}); {remedy}name another folder"
        )
    return data, True


def marker_content(settings: BatchSettings) -> bytes:
    """Content of the marker of a store with these settings."""
    marker = {
        "format": FORMAT,
        "version": package_version(),
        "method": METHOD,
        "settings": json.loads(settings_text(settings)),
    }
    return (json.dumps(marker, indent=1) + "\n").encode()


def set_aside(output: Folder, name: str, data: bytes) -> str:
    """Move a damaged file to `damaged/`; returns its new name."""
    now = datetime.now(UTC).strftime("%Y%m%dT%H%M%S.%f")
    new_name = f"damaged/{now}-{name.replace('/', '-')}"
    output.write(new_name, data)
    output.remove_all([name])
    return new_name


def _check_free(output: Folder) -> None:
    """Refuse a folder without marker whose files a store would read or replace."""
    summary = output.names("summary")
    if summary and all(_is_summary(output, name) for name in summary):
        return  # the summary of a store without its marker
    for folder in STORED:
        for name in output.names(folder):
            raise OutputError(
                f"{printable(output.url)}: contains a folder {folder} that grasp3d has not written "
                f"({printable(name)}); name another folder"
            )


def _is_summary(output: Folder, name: str) -> bool:
    """Whether a file is part of a summary."""
    try:
        unpack_records(output.read(name), Row)
    except (ValueError, FileNotFoundError):
        return False
    return True


class Shards:
    """Shards of one store, and which of them has the row of which mesh.

    A run replaces shards of other runs only to remove rows, and adds new rows to its own shards.
    """

    def __init__(self, output: Folder, settings: BatchSettings, run: str) -> None:
        self.output = output
        self.run = run
        self.shards: dict[str, PackedRows] = {}
        """Rows of each shard by mesh, the oldest shard first."""
        self.outdated: set[str] = set()
        """Shards to be rewritten, since an older version wrote fewer columns."""
        model = settings.model
        self._settings = {
            **json.loads(settings_text(settings)),
            "method": METHOD,
            "epsilon_rank": model.epsilon_rank,
            "epsilon_min": model.tilts,
        }
        self._shard_of: dict[str, str] = {}
        self._current = ""

    def rows(self) -> PackedRows:
        """All rows by mesh."""
        every = PackedRows()
        for rows in self.shards.values():
            every.add_all(rows)
        return every

    def repair(self) -> None:
        """Leave each mesh in the latest shard that has it, with the current columns in all."""
        self._shard_of = {mesh: name for name, rows in self.shards.items() for mesh in rows}
        for name, rows in list(self.shards.items()):
            latest = rows.subset(mesh for mesh in rows if self._shard_of[mesh] == name)
            if len(latest) < len(rows) or name in self.outdated:
                self._write(name, latest)

    def restore(self) -> None:
        """Write shards again whose files were removed since they were read or written."""
        present = set(self.output.names("summary"))
        for name in self.shards.keys() - present:
            self._write(name, self.shards[name])

    def rows_to_merge(self) -> PackedRows:
        """Rows of small shards if there are too many of these; else none."""
        names = [name for name, rows in self.shards.items() if len(rows) < SMALL]
        small = names if len(names) > MAX_SMALL else []
        rows = PackedRows()
        for name in small:
            rows.add_all(self.shards[name])
        return rows

    def remove(self, meshes: Iterable[str]) -> None:
        """Remove the rows of meshes from their shards; meshes without a row are ignored."""
        by_shard: dict[str, set[str]] = {}
        for mesh in meshes:
            if mesh in self._shard_of:
                by_shard.setdefault(self._shard_of[mesh], set()).add(mesh)
        for name, removed in by_shard.items():
            rows = self.shards[name]
            self._write(name, rows.subset(mesh for mesh in rows if mesh not in removed))
            for mesh in removed:
                del self._shard_of[mesh]

    def put(self, rows: Iterable[Row]) -> None:
        """Write rows: each to the shard that has its mesh, or to this run's last shard."""
        changed: dict[str, PackedRows] = {}
        for row in rows:
            name = self._shard_of.get(row.mesh) or self._shard_to_fill(changed)
            present = self.shards.get(name, PackedRows())
            if present.get(row.mesh) != row:
                changed.setdefault(name, PackedRows(present))[row.mesh] = row
        for name, packed in changed.items():
            self._write(name, packed)
            self._shard_of |= dict.fromkeys(packed, name)

    def _shard_to_fill(self, changed: dict[str, PackedRows]) -> str:
        """Name of this run's shard that is not full."""
        rows = changed.get(self._current) or self.shards.get(self._current) or ()
        if not self._current or len(rows) >= MAX_ROWS:
            numbers = [int(_number(name)) for name in (*self.shards, *changed)]
            number = max(numbers, default=-1) + 1
            self._current = f"summary/part-{number:05d}-{self.run}.parquet"
        return self._current

    def _write(self, name: str, rows: PackedRows) -> None:
        """Replace a shard; a shard without rows is removed."""
        if rows:
            records = [rows[mesh] for mesh in sorted(rows)]
            self.output.write(name, pack_records(records, Row, self._settings))
            self.shards[name] = rows
        else:
            self.output.remove_all([name])
            self.shards.pop(name, None)
        self.outdated.discard(name)


def _number(name: str) -> str:
    match = _SHARD_NAME.fullmatch(name)
    return "0" if match is None else match[1]


def read_shards(output: Folder, shards: Shards) -> dict[str, tuple[bytes, str]]:
    """Read the summary into `shards`.

    Returns:
        By name, the content of damaged files and how they are damaged.
    """
    names = sorted(
        (name for name in output.names("summary") if _SHARD_NAME.fullmatch(name)),
        key=lambda name: (int(_number(name)), name),
    )
    damaged = {}
    files = output.read_all(names)
    for name in names:
        if name not in files:
            continue
        try:
            rows, exact = unpack_records(files[name], Row)
        except ValueError as error:
            damaged[name] = files[name], str(error)
            continue
        shards.shards[name] = PackedRows({row.mesh: row for row in rows})
        if not exact:
            shards.outdated.add(name)
    return damaged


@dataclass(frozen=True)
class JournalEntry:
    """One file of the journal."""

    rows: tuple[Row, ...] = ()
    """Rows to be put into the summary."""
    to_replace: Mapping[str, Mapping[str, str]] = field(default_factory=dict)
    """Rows of the summary that a run is about to replace, by the name of their mesh: the state of
    their result files before the run, according to the file system."""


def pack_entry(entry: JournalEntry) -> bytes:
    """Write an entry as JSON."""
    # The fields of nested dataclasses, without the copies that `asdict` makes of all values.
    return json.dumps(vars(entry), default=vars).encode()


def unpack_entry(data: bytes) -> JournalEntry:
    """Read an entry.

    Raises:
        ValueError: The data are damaged.
    """
    try:
        values = json.loads(data)
        rows = tuple(typed(row, Row) for row in values["rows"])
        to_replace = {
            str(name): {str(file): str(stamp) for file, stamp in stamps.items()}
            for name, stamps in values["to_replace"].items()
        }
    except (AttributeError, KeyError, TypeError, RecursionError) as error:
        raise ValueError(str(error)) from error
    return JournalEntry(rows, to_replace)


def in_unicode(row: Row) -> Row:
    """A row as tables can hold it: bytes of file names that are not Unicode are escaped."""
    text: dict[str, Any] = {
        name: as_unicode(value)
        for name, value in vars(row).items()
        if type(value) is str and not value.isascii()
    }
    return replace(row, **text) if text else row


def read_journal(output: Folder) -> tuple[dict[str, JournalEntry], dict[str, tuple[bytes, str]]]:
    """Read the journal.

    Returns:
        (entries by the name of their file, damaged files as from `read_shards`).
    """
    entries, damaged = {}, {}
    names = [name for name in output.names(JOURNAL) if _ENTRY_NAME.fullmatch(name)]
    for name, data in sorted(output.read_all(names).items()):
        try:
            entries[name] = unpack_entry(data)
        except ValueError as error:
            damaged[name] = data, str(error)
    return entries, damaged


MERGE_ROWS, MERGE_SECONDS = 500, 30.0
"""Rows in the journal, or time [s], after which the journal is moved into the summary."""

TEMPORARY_FILE_AGE = 2.0
"""Age at which unfinished files are removed as those of a process that died [s]."""

LOCK = ".lock"
"""File that is locked while a run writes to the folder."""


class Store:
    """Rows of a batch in a folder on any file system.

    A new row is written to the journal, as a small file of its own, before `add` returns. From
    time to time the journal is moved into the summary, a Parquet data set whose files are replaced
    atomically and of which no two files have the same mesh; then the journal is emptied. So at any
    moment summary and journal together contain all rows that were added, however the run ends;
    opening the store moves the rest of the journal into the summary.

    A folder on a local file system is locked until the store is closed or its process ends, and
    another run is refused. On an object store another run cannot be detected, and two at the same
    time may remove each other's rows.
    """

    def __init__(self, output: Folder, settings: BatchSettings, *, overwrite: bool = False) -> None:
        self.output = output
        self.settings = settings
        self.warnings: list[str] = []
        """Sentences on damaged files."""
        self._overwrite = overwrite
        self._run = secrets.token_hex(4)
        self._entry_files: list[str] = []
        self._replacement_files: list[str] = []
        self._to_replace: dict[str, dict[str, str]] = {}
        self._lock: Lock | None = None
        self._entries_written = 0
        self._in_journal = PackedRows()
        self._last_merge = time.monotonic()
        self._marker = b""
        self._shards = Shards(output, settings, self._run)
        self._rows = PackedRows()

    @classmethod
    def open(cls, output: Folder, settings: BatchSettings, *, overwrite: bool = False) -> "Store":
        """Open the store in a folder, or make one.

        Args:
            output: The folder; it need not exist.
            settings: Settings of the labels.
            overwrite: Whether rows of other settings may be removed even if this run does not label
                their meshes.

        Raises:
            OutputError: The folder cannot be written to, contains another summary, or is a store
                of a newer version.
        """
        store = cls(output, settings, overwrite=overwrite)
        store._recover()
        return store

    @property
    def rows(self) -> Mapping[str, Row]:
        """All rows by the name of their mesh."""
        return MappingProxyType(self._rows)

    def rows_of(self, names: Iterable[str]) -> Mapping[str, Row]:
        """Rows of some meshes, in the given order of names."""
        return MappingProxyType(self._rows.subset(names))

    def finished(self, mesh: MeshFile) -> Row | None:
        """Row of a mesh whose file, settings and results have not changed; else none.

        Args:
            mesh: From `find_meshes`.
        """
        row = self._rows.get(mesh.name)
        if row is None or not mesh.stamp or row.stamp != mesh.stamp:
            return None
        return row if row.source == as_unicode(mesh.source) and self._is_valid(row) else None

    def known_content(self, mesh: MeshFile) -> str:
        """Hash of the content for which the mesh's row is valid; empty: there is no such row."""
        row = self._rows.get(mesh.name)
        return row.content if row is not None and self._is_valid(row) else ""

    def is_stale(self, name: str) -> bool:
        """Whether a mesh has labels of other settings, or of another version of the method."""
        row = self._rows.get(name)
        return row is not None and bool(row.labels) and not self._is_current(row)

    def begin(self, names_to_run: Iterable[str]) -> None:
        """Record which meshes are labelled again, before anything is written for them.

        Their rows stay until `add` replaces them. Rows whose result files are changed before that
        are removed when the store is closed, or opened again. So a mesh that an interrupted run
        did not reach keeps its row.

        Args:
            names_to_run: Names of all meshes of this run that are not finished.

        Raises:
            OutputError: The store has rows of other settings, or of another version of the method,
                for meshes that are not among these.
        """
        names = set(names_to_run) & self._rows.keys()
        others = {
            name
            for name, row in self._rows.items()
            if name not in names and row.key and not self._is_current(row)
        }
        self._check_removable(others)
        if names:
            self._to_replace = {name: self._state(self._rows[name]) for name in sorted(names)}
            entry = JournalEntry(to_replace=self._to_replace)
            self._replacement_files.append(self._write_entry(entry))
        self._remove(others)
        marker = marker_content(self.settings)
        if marker != self._marker:
            self.output.write(MARKER, marker)
            self._marker = marker

    def _check_removable(self, others: Iterable[str]) -> None:
        """Refuse to remove labels that this run does not make again, unless that is wanted."""
        labelled = [name for name in others if self._rows[name].outcome is Outcome.LABELLED]
        if labelled and not self._overwrite:
            raise OutputError(
                f"{printable(self.output.url)}: contains labels of meshes that are not among these "
                "inputs, made with other settings or by another version of the method "
                f"({len(labelled)}, such as {printable(min(labelled))}); name another folder, or "
                "remove them with --overwrite"
            )

    def add(self, row: Row) -> None:
        """Store a row; when this returns, the row survives the death of this process.

        Raises:
            OutputError: The row cannot be written.
        """
        row = in_unicode(row)
        before = self._rows.get(row.mesh)
        self._entry_files.append(self._write_entry(JournalEntry((row,))))
        self._rows[row.mesh] = row
        self._in_journal.add_all(self._rows.subset([row.mesh]))
        self._to_replace.pop(row.mesh, None)
        if before is not None:
            self.output.remove_all(set(_result_files(before)) - set(_result_files(row)))
        age = time.monotonic() - self._last_merge
        if len(self._in_journal) >= MERGE_ROWS or age >= MERGE_SECONDS:
            self._merge_journal()

    def verify(self, names: Iterable[str]) -> None:
        """Check that what the summary states is there, as somebody may have removed it meanwhile.

        Labelled meshes whose results are missing get rows that say so; files of the summary that
        are missing are written again.

        Args:
            names: Names of the meshes of this run; if the marker is missing, all are checked.

        Raises:
            OutputError: A row cannot be written.
        """
        if MARKER not in self.output.names():
            self.output.write(MARKER, self._marker)
            names = list(self._rows)
        vars(self).pop("_file_stamps", None)
        for name in names:
            row = self._rows[name]
            if row.outcome is Outcome.LABELLED and not self._has_results(row):
                reason = "its results were removed while the batch ran; run it again"
                self.add(Row.lost(row.mesh, row.source, row.bytes, reason))
        self._shards.restore()

    def close(self) -> None:
        """Move all rows into the summary and empty the journal.

        Raises:
            OutputError: The summary cannot be written.
        """
        if self._lock is not None:
            self._merge_journal()
            self._remove(self._changed(self._to_replace))
            self.output.remove_all(self._replacement_files)
            self._replacement_files, self._to_replace = [], {}
            self.output.remove_temporary_files(TEMPORARY_FILE_AGE, wait=True)
            self._lock.close()
            self._lock = None

    def _recover(self) -> None:
        """Read the files of earlier runs, set damaged ones aside, and merge their journal."""
        self._open_marker()
        self._lock = self.output.lock(LOCK)
        self.output.remove_temporary_files(TEMPORARY_FILE_AGE)
        damaged = read_shards(self.output, self._shards)
        entries, damaged_entries = read_journal(self.output)
        for name, (data, why) in (damaged | damaged_entries).items():
            self._set_aside(name, data, f"({why}); its meshes are labelled again")
        self._shards.repair()
        self._rows = self._shards.rows()
        to_replace = {
            name: state for entry in entries.values() for name, state in entry.to_replace.items()
        }
        self._remove(self._changed(to_replace))
        self._entry_files = list(entries)
        new_rows = {row.mesh: row for entry in entries.values() for row in entry.rows}
        to_merge = self._shards.rows_to_merge()
        to_merge = to_merge.subset(name for name in to_merge if name not in new_rows)
        if to_merge:
            self._entry_files.append(self._write_entry(JournalEntry(tuple(to_merge.values()))))
            self._shards.remove(to_merge)
        self._in_journal = to_merge
        self._in_journal.update(new_rows)
        self._rows.add_all(self._in_journal)
        self._merge_journal()

    def _open_marker(self) -> None:
        """Read the marker, and write it in any case, so that a full disk is found at once."""
        data, valid = read_marker(self.output)
        if data is not None and not valid:
            self._set_aside(MARKER, data, "and replaced")
        self._marker = data if data is not None and valid else marker_content(self.settings)
        self.output.write(MARKER, self._marker)

    def _set_aside(self, name: str, data: bytes, consequence: str) -> None:
        new_name = set_aside(self.output, name, data)
        self.warnings.append(
            f"{printable(self.output.path(name))}: is damaged, moved to {new_name} {consequence}"
        )

    def _changed(self, to_replace: Mapping[str, Mapping[str, str]]) -> set[str]:
        """Rows that a run was about to replace, and whose result files it has changed."""
        if not to_replace:
            return set()
        vars(self).pop("_file_stamps", None)  # read the current stamps
        rows = {name: self._rows[name] for name in to_replace if name in self._rows}
        return {
            name
            for name, row in rows.items()
            if to_replace[name].get("") == _identity(row) and to_replace[name] != self._state(row)
        }

    def _write_entry(self, entry: JournalEntry) -> str:
        """Write a file of the journal; returns its name."""
        name = f"{JOURNAL}/{self._run}-{self._entries_written:08d}.json"
        self._entries_written += 1
        self.output.write(name, pack_entry(entry))
        return name

    def _merge_journal(self) -> None:
        """Move the journal's rows into the summary; only then they are removed from the journal."""
        self._shards.put(self._in_journal.values())
        self.output.remove_all(self._entry_files)
        self._entry_files, self._in_journal = [], PackedRows()
        self._last_merge = time.monotonic()

    def _remove(self, names: Iterable[str]) -> None:
        """Remove rows and the result files of their meshes."""
        names = set(names)
        files = [
            file for name in names if name in self._rows for file in _result_files(self._rows[name])
        ]
        self._shards.remove(names)
        for name in names:
            self._rows.pop(name, None)
        self.output.remove_all(files)

    def _is_valid(self, row: Row) -> bool:
        """Whether a row is valid provided that the content of its mesh has not changed."""
        if row.outcome is Outcome.LOST or not row.content or not self._is_current(row):
            return False
        return self._has_results(row)

    def _has_results(self, row: Row) -> bool:
        """Whether all result files of a row are there, and none is empty."""
        return not any(
            self._file_stamps.get(name, "0-").startswith("0-") for name in _result_files(row)
        )

    def _is_current(self, row: Row) -> bool:
        """Whether a row was made with the current settings and version of the method."""
        return row.key == mesh_key(row.content, self.settings)

    def _state(self, row: Row) -> dict[str, str]:
        """Identity of a row's mesh, and the stamps of its result files."""
        stamps = {name: self._file_stamps.get(name, "") for name in _result_files(row)}
        return {"": _identity(row)} | stamps

    @cached_property
    def _file_stamps(self) -> dict[str, str]:
        """Stamps of all result files, from one listing for each folder."""
        return {
            name: stamp or "there"
            for folder in ("labels", "fields", "report")
            for name, stamp in self.output.stamps(folder).items()
        }


def _identity(row: Row) -> str:
    return f"{row.content} {row.stamp}"


def _result_files(row: Row) -> list[str]:
    """Names of the files in a row."""
    return [name for name in (row.labels, row.fields, row.thumbnail) if name]


def read_summary(results: str | Path) -> Summary:
    """Read the rows of a store, including those in the journal, without changing it.

    Args:
        results: Folder of the store, or its address.

    Returns:
        A list in alphabetical order of the meshes, with `to_table` and `to_dataframe`.

    Raises:
        OutputError: There is no store, or it is damaged.
    """
    output = Folder(str(results))
    if not read_marker(output)[1]:
        raise OutputError(f"{printable(output.url)}: is not a folder that grasp3d batch wrote")
    shards = Shards(output, BatchSettings(), "")
    damaged = read_shards(output, shards)
    entries, damaged_entries = read_journal(output)
    for name, (_, why) in (damaged | damaged_entries).items():
        raise OutputError(
            f"{printable(output.path(name))}: is damaged ({why}); run grasp3d batch again"
        )
    rows = shards.rows()
    rows.update({row.mesh: row for entry in entries.values() for row in entry.rows})
    return Summary(rows[name] for name in sorted(rows))
