"""The files of a store: the marker, the summary with a row per mesh, and the journal.

The summary is a set of Parquet files, shards, each replaced atomically, with the row of a mesh in
one of them. The journal is JSON files with rows that are not in the summary yet and survive a
crash.
"""

import json
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from typing import Any

from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.identity import METHOD, settings_text
from grasp3d.batch.inputs import MARKER, STORED
from grasp3d.batch.row import PackedRows, Row
from grasp3d.batch.storage.folder import Folder
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
    output.remove(name)
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
            self.output.remove(name)
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
