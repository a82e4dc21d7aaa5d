"""The summary: Parquet files, each replaced atomically, with the row of a mesh in one of them."""

import json
import re
from collections.abc import Iterable

from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.identity import METHOD, settings_text
from grasp3d.batch.journal import FOLDER, NAME, JournalEntry, unpack_entry
from grasp3d.batch.row import PackedRows, Row
from grasp3d.batch.storage import Folder
from grasp3d.system.tables import pack_records, unpack_records

MAX_ROWS = 1000
"""Rows of a shard, after which the next one begins; all of them are unpacked to write it."""

SMALL, MAX_SMALL = 500, 16
"""Shards with fewer rows are small; more small shards than this are merged."""

_NAME = re.compile(r"summary/part-(\d{5,})(-\w+)?\.parquet")


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
    match = _NAME.fullmatch(name)
    return "0" if match is None else match[1]


def read_shards(output: Folder, shards: Shards) -> dict[str, tuple[bytes, str]]:
    """Read the summary into `shards`.

    Returns:
        By name, the content of damaged files and how they are damaged.
    """
    names = sorted(
        (name for name in output.names("summary") if _NAME.fullmatch(name)),
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


def read_journal(output: Folder) -> tuple[dict[str, JournalEntry], dict[str, tuple[bytes, str]]]:
    """Read the journal.

    Returns:
        (entries by the name of their file, damaged files as from `read_shards`).
    """
    entries, damaged = {}, {}
    names = [name for name in output.names(FOLDER) if NAME.fullmatch(name)]
    for name, data in sorted(output.read_all(names).items()):
        try:
            entries[name] = unpack_entry(data)
        except ValueError as error:
            damaged[name] = data, str(error)
    return entries, damaged
