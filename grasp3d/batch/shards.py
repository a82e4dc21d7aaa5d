"""The summary: Parquet files, each replaced whole, with the row of each mesh in one of them."""

import json
import re
from collections.abc import Iterable

from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.identity import METHOD, settings_text
from grasp3d.batch.journal import FOLDER, NAME, Note, unpack_note
from grasp3d.batch.row import Row
from grasp3d.batch.row_box import RowBox
from grasp3d.storage import Folder
from grasp3d.tables import pack_records, unpack_records

MOST = 1000
"""Rows of a shard, after which the next one begins; all of them are unpacked to write it."""

SMALL, FEW = 500, 16
"""Shards with fewer rows are small; more small ones than a few are put together."""

_NAME = re.compile(r"summary/part-(\d{5,})(-\w+)?\.parquet")


class Shards:
    """Shards of one store, and which of them has which mesh.

    A run replaces shards of others only to take rows out, and puts new ones into its own.
    """

    def __init__(self, output: Folder, settings: BatchSettings, run: str) -> None:
        self.output = output
        self.run = run
        self.shards: dict[str, RowBox] = {}
        """Rows of each shard by mesh; in the order of their age."""
        self.outdated: set[str] = set()
        """Shards to be written anew, since an older version knew fewer columns."""
        model = settings.model
        self._settings = {
            **json.loads(settings_text(settings)),
            "method": METHOD,
            "epsilon_rank": model.epsilon_rank,
            "epsilon_min": model.tilts,
        }
        self._home: dict[str, str] = {}
        self._current = ""

    def rows(self) -> RowBox:
        """All rows by mesh."""
        every = RowBox()
        for rows in self.shards.values():
            every.take(rows)
        return every

    def mend(self) -> None:
        """Leave each mesh in the latest shard that has it, with today's columns in all."""
        self._home = {mesh: name for name, rows in self.shards.items() for mesh in rows}
        for name, rows in list(self.shards.items()):
            left = rows.only(mesh for mesh in rows if self._home[mesh] == name)
            if len(left) < len(rows) or name in self.outdated:
                self._write(name, left)

    def small(self) -> RowBox:
        """Rows of shards that are to be put together with others; none: they are few."""
        names = [name for name, rows in self.shards.items() if len(rows) < SMALL]
        small = names if len(names) > FEW else []
        rows = RowBox()
        for name in small:
            rows.take(self.shards[name])
        return rows

    def take_out(self, meshes: Iterable[str]) -> None:
        """Take rows out of their shards; those that are in none are no matter."""
        homes: dict[str, set[str]] = {}
        for mesh in meshes:
            if mesh in self._home:
                homes.setdefault(self._home[mesh], set()).add(mesh)
        for name, gone in homes.items():
            rows = self.shards[name]
            self._write(name, rows.only(mesh for mesh in rows if mesh not in gone))
            for mesh in gone:
                del self._home[mesh]

    def put(self, rows: Iterable[Row]) -> None:
        """Put rows into the shards: each where its mesh is, or into this run's last one."""
        changed: dict[str, RowBox] = {}
        for row in rows:
            name = self._home.get(row.mesh) or self._room(changed)
            held = self.shards.get(name, RowBox())
            if held.get(row.mesh) != row:
                changed.setdefault(name, RowBox(held))[row.mesh] = row
        for name, box in changed.items():
            self._write(name, box)
            self._home |= dict.fromkeys(box, name)

    def _room(self, changed: dict[str, RowBox]) -> str:
        """This run's shard that is not full."""
        held = changed.get(self._current) or self.shards.get(self._current) or ()
        if not self._current or len(held) >= MOST:
            numbers = [int(_number(name)) for name in (*self.shards, *changed)]
            number = max(numbers, default=-1) + 1
            self._current = f"summary/part-{number:05d}-{self.run}.parquet"
        return self._current

    def _write(self, name: str, rows: RowBox) -> None:
        """Replace a shard; one without rows goes."""
        if rows:
            records = [rows[mesh] for mesh in sorted(rows)]
            self.output.write(name, pack_records(records, Row, self._settings))
            self.shards[name] = rows
        else:
            self.output.remove(name)
            self.shards.pop(name, None)
        self.outdated.discard(name)


def _number(name: str) -> str:
    found = _NAME.fullmatch(name)
    return "0" if found is None else found[1]


def read_shards(output: Folder, shards: Shards) -> dict[str, tuple[bytes, str]]:
    """Read the summary into `shards`.

    Returns:
        Content of files that are damaged, and what is wrong with them, by name.
    """
    names = sorted(
        (name for name in output.names("summary") if _NAME.fullmatch(name)),
        key=lambda name: (int(_number(name)), name),
    )
    damaged = {}
    found = output.read_all(names)
    for name in names:
        if name not in found:
            continue
        try:
            rows, exact = unpack_records(found[name], Row)
        except ValueError as error:
            damaged[name] = found[name], str(error)
            continue
        shards.shards[name] = RowBox({row.mesh: row for row in rows})
        if not exact:
            shards.outdated.add(name)
    return damaged


def read_journal(output: Folder) -> tuple[dict[str, Note], dict[str, tuple[bytes, str]]]:
    """Read the journal.

    Returns:
        (notes by the name of their file, files that are damaged as of `read_shards`).
    """
    notes, damaged = {}, {}
    names = [name for name in output.names(FOLDER) if NAME.fullmatch(name)]
    for name, data in sorted(output.read_all(names).items()):
        try:
            notes[name] = unpack_note(data)
        except ValueError as error:
            damaged[name] = data, str(error)
    return notes, damaged
