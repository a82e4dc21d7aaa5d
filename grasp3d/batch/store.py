"""The store of a batch: what came of each mesh, kept through whatever ends the run."""

import secrets
import time
from collections.abc import Iterable, Mapping
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

from grasp3d.batch import journal
from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.folders import MARKER, MeshFile
from grasp3d.batch.identity import mesh_key
from grasp3d.batch.journal import Note, pack_note
from grasp3d.batch.marker import marker_of, read_marker, set_aside
from grasp3d.batch.row import Outcome, Row
from grasp3d.batch.row_box import RowBox
from grasp3d.batch.shards import Shards, read_journal, read_shards
from grasp3d.errors import OutputError
from grasp3d.storage import Folder, Lock
from grasp3d.system.names import as_unicode, printable

ROWS, SECONDS = 500, 30.0
"""How many rows, or for how long, the journal keeps rows before they go into the summary."""

LEFT = 2.0
"""Age at which files that are not written to their end are taken for a dead writer's [s]."""

LOCK = ".lock"
"""File that is locked while a run writes to the folder."""


class Store:
    """Rows of a batch in a folder on any file system.

    A new row goes into the journal, a small file of its own, before `add` returns; from time to
    time the journal goes into the summary, a Parquet data set of which every file is replaced whole
    and no two files have the same mesh; then the journal is emptied. So at any moment summary and
    journal together are all rows that were added, whatever ends the run; opening the store puts
    what is left of the journal into the summary.

    A folder of this machine's file system is locked until the store is closed or its process ends:
    another run into it is refused. On an object store nothing tells that there is another run, and
    two at the same time may take out each other's rows.
    """

    def __init__(self, output: Folder, settings: BatchSettings, *, force: bool = False) -> None:
        self.output = output
        self.settings = settings
        self.told: list[str] = []
        """Sentences on what was damaged."""
        self._force = force
        self._run = secrets.token_hex(4)
        self._notes: list[str] = []
        self._doubts: list[str] = []
        self._doubted: dict[str, dict[str, str]] = {}
        self._locked: Lock | None = None
        self._written = 0
        self._waiting = RowBox()
        self._since = time.monotonic()
        self._marker = b""
        self._shards = Shards(output, settings, self._run)
        self._rows = RowBox()

    @classmethod
    def open(cls, output: Folder, settings: BatchSettings, *, force: bool = False) -> "Store":
        """Open the store in a folder, or make one.

        Args:
            output: The folder; it need not exist.
            settings: What meshes are labelled with.
            force: Whether rows of other settings may be taken out though this run has no mesh for
                them.

        Raises:
            OutputError: The folder cannot be written to, holds another summary, or a newer store.
        """
        store = cls(output, settings, force=force)
        store._take_over()
        return store

    @property
    def rows(self) -> Mapping[str, Row]:
        """All rows by the name of their mesh."""
        return MappingProxyType(self._rows)

    def rows_of(self, names: Iterable[str]) -> Mapping[str, Row]:
        """Rows of some meshes, in the order of their names as given."""
        return MappingProxyType(self._rows.only(names))

    def finished(self, mesh: MeshFile) -> Row | None:
        """Row of a mesh that need not be looked at: nothing has changed since it was made.

        Args:
            mesh: From `find_meshes`.
        """
        row = self._rows.get(mesh.name)
        if row is None or not mesh.stamp or row.stamp != mesh.stamp:
            return None
        return row if row.source == as_unicode(mesh.source) and self._holds(row) else None

    def known(self, mesh: MeshFile) -> str:
        """Content for which the mesh's row would hold; empty: it has no such row."""
        row = self._rows.get(mesh.name)
        return row.content if row is not None and self._holds(row) else ""

    def is_stale(self, name: str) -> bool:
        """Whether a mesh has labels of other settings, or of another version of the method."""
        row = self._rows.get(name)
        return row is not None and bool(row.labels) and not self._is_of_now(row)

    def begin(self, names_to_run: Iterable[str]) -> None:
        """Note which meshes are labelled anew, before anything is written for them.

        Their rows stay until `add` replaces them; those whose results are touched meanwhile go when
        the store is closed, or opened again. So nothing is lost by a run that never gets to a mesh.

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
            if name not in names and row.key and not self._is_of_now(row)
        }
        self._check_others(others)
        if names:
            self._doubted = {name: self._state(self._rows[name]) for name in sorted(names)}
            self._doubts.append(self._note(Note(doubted=self._doubted)))
        self._take_out(others)
        marker = marker_of(self.settings)
        if marker != self._marker:
            self.output.write(MARKER, marker)
            self._marker = marker

    def _check_others(self, others: Iterable[str]) -> None:
        """Refuse to take out labels that this run does not make anew, unless it is forced to."""
        labelled = [name for name in others if self._rows[name].outcome is Outcome.LABELLED]
        if labelled and not self._force:
            raise OutputError(
                f"{printable(self.output.url)}: holds labels of meshes that are not among these "
                "inputs, made with other settings or by another version of the method "
                f"({len(labelled)}, such as {printable(min(labelled))}); name another folder, or "
                "remove them with --force"
            )

    def add(self, row: Row) -> None:
        """Keep a row; when this returns, it survives the death of this process.

        Raises:
            OutputError: It cannot be written.
        """
        row = journal.plain(row)
        before = self._rows.get(row.mesh)
        self._notes.append(self._note(Note((row,))))
        self._waiting[row.mesh] = self._rows[row.mesh] = row
        self._doubted.pop(row.mesh, None)
        if before is not None:
            self.output.remove_all(set(_results(before)) - set(_results(row)))
        if len(self._waiting) >= ROWS or time.monotonic() - self._since >= SECONDS:
            self._fold()

    def close(self) -> None:
        """Put all rows into the summary and empty the journal.

        Raises:
            OutputError: It cannot be written.
        """
        if self._locked is not None:
            self._fold()
            self._take_out(self._touched(self._doubted))
            self.output.remove_all(self._doubts)
            self._doubts, self._doubted = [], {}
            self.output.remove_parts(LEFT)
            self._locked.close()
            self._locked = None

    def _take_over(self) -> None:
        """Read what earlier runs left, mend what is damaged, and fold their journal."""
        self._open_marker()
        self._locked = self.output.locked(LOCK)
        self.output.remove_parts(LEFT)
        damaged = read_shards(self.output, self._shards)
        notes, broken = read_journal(self.output)
        for name, (data, why) in (damaged | broken).items():
            self._set_aside(name, data, f"({why}); its meshes are labelled again")
        self._shards.mend()
        self._rows = self._shards.rows()
        doubted = {name: state for note in notes.values() for name, state in note.doubted.items()}
        self._take_out(self._touched(doubted))
        self._notes = list(notes)
        fresh = {row.mesh: row for note in notes.values() for row in note.rows}
        small = self._shards.small()
        small = small.only(name for name in small if name not in fresh)
        if small:
            self._notes.append(self._note(Note(tuple(small.values()))))
            self._shards.take_out(small)
        self._waiting = small
        self._waiting.update(fresh)
        self._rows.take(self._waiting)
        self._fold()

    def _open_marker(self) -> None:
        """Read the marker, and write it in any case: so a place that is full is told at once."""
        found, sound = read_marker(self.output)
        if found is not None and not sound:
            self._set_aside(MARKER, found, "and made anew")
        self._marker = found if found is not None and sound else marker_of(self.settings)
        self.output.write(MARKER, self._marker)

    def _set_aside(self, name: str, data: bytes, what: str) -> None:
        aside = set_aside(self.output, name, data)
        self.told.append(
            f"{printable(self.output.path(name))}: is damaged, set aside as {aside} {what}"
        )

    def _touched(self, doubted: Mapping[str, Mapping[str, str]]) -> set[str]:
        """Rows that a run was about to replace, and whose results it has touched."""
        if not doubted:
            return set()
        vars(self).pop("_results", None)  # as they are now
        rows = {name: self._rows[name] for name in doubted if name in self._rows}
        return {
            name
            for name, row in rows.items()
            if doubted[name].get("") == _identity(row) and doubted[name] != self._state(row)
        }

    def _note(self, note: Note) -> str:
        """Write a file of the journal; returns its name."""
        name = f"{journal.FOLDER}/{self._run}-{self._written:08d}.json"
        self._written += 1
        self.output.write(name, pack_note(note))
        return name

    def _fold(self) -> None:
        """Put the journal's rows into the summary; only then they leave the journal."""
        self._shards.put(self._waiting.values())
        self.output.remove_all(self._notes)
        self._notes, self._waiting = [], RowBox()
        self._since = time.monotonic()

    def _take_out(self, names: Iterable[str]) -> None:
        """Take out rows, and what was written of their meshes: it would be of no row."""
        names = set(names)
        files = [
            file for name in names if name in self._rows for file in _results(self._rows[name])
        ]
        self._shards.take_out(names)
        for name in names:
            self._rows.pop(name, None)
        self.output.remove_all(files)

    def _holds(self, row: Row) -> bool:
        """Whether a row holds if the content of its mesh has not changed."""
        if row.outcome is Outcome.LOST or not row.content or not self._is_of_now(row):
            return False
        return not any(self._results.get(name, "0-").startswith("0-") for name in _results(row))

    def _is_of_now(self, row: Row) -> bool:
        return row.key == mesh_key(row.content, self.settings)

    def _state(self, row: Row) -> dict[str, str]:
        """What a row says of its mesh, and the file system of its results."""
        return {"": _identity(row)} | {name: self._results.get(name, "") for name in _results(row)}

    @cached_property
    def _results(self) -> dict[str, str]:
        """What the file system says of all results: a listing for each folder."""
        return {
            name: stamp or "there"
            for folder in ("labels", "fields", "report")
            for name, stamp in self.output.stamps(folder).items()
        }


def _identity(row: Row) -> str:
    return f"{row.content} {row.stamp}"


def _results(row: Row) -> list[str]:
    """Files that a row names."""
    return [name for name in (row.labels, row.fields, row.view, row.thumbnail) if name]


def read_summary(results: str | Path) -> list[Row]:
    """Read the rows of a store, those in the journal included, and change nothing.

    Args:
        results: Folder of the store, or its address.

    Returns:
        In alphabetical order of the meshes.

    Raises:
        OutputError: There is no store, or it is damaged.
    """
    output = Folder(str(results))
    if not read_marker(output)[1]:
        raise OutputError(f"{printable(output.url)}: is no folder that grasp3d batch has written")
    shards = Shards(output, BatchSettings(), "")
    damaged = read_shards(output, shards)
    notes, broken = read_journal(output)
    for name, (_, why) in (damaged | broken).items():
        raise OutputError(
            f"{printable(output.path(name))}: is damaged ({why}); run grasp3d batch again"
        )
    rows = shards.rows()
    rows.update({row.mesh: row for note in notes.values() for row in note.rows})
    return [rows[name] for name in sorted(rows)]
