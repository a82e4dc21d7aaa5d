"""The store of a batch: the rows of all meshes, kept on disk so that they survive a crash.

They are a Parquet data set, whose files are each written atomically. A run adds its rows in files
of their own. Of two rows of a mesh, as a run that is killed may leave them, the later file's holds.
"""

import json
import math
import re
import time
from collections.abc import Collection, Iterable, Mapping
from functools import cached_property
from pathlib import Path
from types import MappingProxyType

from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.batch.identity import METHOD, mesh_key, settings_text
from grasp3d.batch.inputs import PART, STORED, MeshFile
from grasp3d.batch.row import Outcome, Row, Summary, in_unicode
from grasp3d.batch.storage.folder import Folder, Lock
from grasp3d.errors import OutputError
from grasp3d.system.names import as_unicode, printable
from grasp3d.system.tables import pack_records, unpack_records

MAX_ROWS = 1000
"""Rows of a file, at most."""

MAX_SMALL = 8
"""Files that are not full, about, before all are joined."""

WRITE_SECONDS = 10.0
"""Time after which new rows are written [s]."""

TEMPORARY_FILE_AGE = 2.0
"""Age at which unfinished files are removed as those of a process that died [s]."""

LOCK = ".lock"
"""File that is locked while a run writes to the folder."""


def _parts(output: Folder) -> list[str]:
    """Files of the data set, the oldest first."""
    return sorted(filter(PART.fullmatch, output.names("summary")), key=_number)


def _number(part: str) -> int:
    return int(re.sub(r"\D", "", part))


def _read(output: Folder, parts: Iterable[str]) -> tuple[dict[str, Row], bool]:
    """Rows by the name of their mesh, and whether each mesh has one, with the current columns.

    Raises:
        OutputError: A file is damaged, or another program wrote it.
    """
    rows, count, current = dict[str, Row](), 0, True
    for name, data in output.read_all(parts).items():
        try:
            found, exact = unpack_records(data, Row)
        except ValueError as error:
            raise OutputError(
                f"{printable(output.path(name))}: is damaged, or not written by grasp3d batch "
                f"({error}); remove it, or name another folder"
            ) from error
        rows |= {row.mesh: row for row in found}
        count, current = count + len(found), current and exact
    return rows, current and count == len(rows)


class Store:
    """Rows of a batch in a folder on any file system.

    A folder on a local file system is locked until the store is closed or its process ends, and
    another run is refused. On an object store another run cannot be detected, and two at the same
    time may remove each other's rows.
    """

    def __init__(self, output: Folder, settings: BatchSettings, *, overwrite: bool = False) -> None:
        """Open the store in a folder, or make one.

        Args:
            output: The folder; it need not exist.
            settings: Settings of the labels.
            overwrite: Whether rows of other settings may be removed even if this run does not label
                their meshes.

        Raises:
            OutputError: The folder cannot be written to, has other files in the folders of a store,
                or damaged ones.
        """
        self.output, self.settings, self._overwrite = output, settings, overwrite
        self._parts = _parts(output)
        for folder in STORED if not self._parts else ():
            for name in output.names(folder):
                raise OutputError(
                    f"{printable(output.url)}: contains a folder {folder} that grasp3d has not "
                    f"written ({printable(name)}); name another folder"
                )
        self._lock: Lock | None = output.lock(LOCK)
        output.remove_temporary_files(TEMPORARY_FILE_AGE)
        self._rows, self._tidy = _read(output, self._parts)
        self._new: dict[str, Row] = {}
        self._written_at = time.monotonic()
        self._settings = {
            **json.loads(settings_text(settings)),
            "method": METHOD,
            "epsilon_rank": settings.model.epsilon_rank,
            "epsilon_min": settings.model.tilts,
        }
        if not self._parts:
            self._write(())  # marks the folder as a store, and finds a full disk at once

    @property
    def rows(self) -> Mapping[str, Row]:
        """All rows by the name of their mesh."""
        return MappingProxyType(self._rows)

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

    def begin(self, names_to_run: Iterable[str]) -> int:
        """Remove the rows and results of other settings, or of another version of the method.

        Args:
            names_to_run: Names of all meshes of this run that are not finished.

        Returns:
            How many of these meshes had labels that are removed.

        Raises:
            OutputError: There are such labels of other meshes, and `overwrite` was not given.
        """
        names = set(names_to_run)
        stale = {name for name, row in self._rows.items() if row.key and not self._is_current(row)}
        labelled = {name for name in stale if self._rows[name].labels}
        if (others := labelled - names) and not self._overwrite:
            raise OutputError(
                f"{printable(self.output.url)}: contains labels of meshes that are not among these "
                "inputs, made with other settings or by another version of the method "
                f"({len(others)}, such as {printable(min(others))}); name another folder, or "
                "remove them with --overwrite"
            )
        if stale:
            removed = [self._rows.pop(name) for name in stale]
            self._join()
            self.output.remove_all(file for row in removed for file in row.files)
        return len(labelled & names)

    def add(self, row: Row) -> None:
        """Store a row; after some seconds at most it survives the death of this process.

        Raises:
            OutputError: The rows cannot be written.
        """
        row = in_unicode(row)
        before = self._rows.get(row.mesh)
        self._rows[row.mesh] = self._new[row.mesh] = row
        if before is not None:
            self._tidy = False
            self.output.remove_all(set(before.files) - set(row.files))
        if time.monotonic() - self._written_at >= WRITE_SECONDS:
            self._write(self._new.values())

    def close(self) -> None:
        """Write all rows, in files that have each of them once, and release the folder.

        Raises:
            OutputError: The rows cannot be written.
        """
        if self._lock is not None:
            if self._new:
                self._write(self._new.values())
            if not self._tidy or len(self._parts) > MAX_SMALL + 2 * len(self._rows) / MAX_ROWS:
                self._join()
            self.output.remove_temporary_files(TEMPORARY_FILE_AGE, wait=True)
            self._lock.close()
            self._lock = None

    def _join(self) -> None:
        """Write all rows, each once, and only then remove the files that had them."""
        before = list(self._parts)
        self._write(self._rows.values())
        self.output.remove_all(before)
        self._parts = self._parts[len(before) :]
        self._tidy = True

    def _write(self, rows: Collection[Row]) -> None:
        """Write rows into new files."""
        ordered = sorted(rows, key=lambda row: row.mesh)
        first = 1 + max(map(_number, self._parts), default=-1)
        for number in range(max(1, math.ceil(len(ordered) / MAX_ROWS))):
            some = ordered[number * MAX_ROWS : (number + 1) * MAX_ROWS]
            name = f"summary/part-{first + number:05d}.parquet"
            self.output.write(name, pack_records(some, Row, self._settings))
            self._parts.append(name)
        self._new = {}
        self._written_at = time.monotonic()

    def _is_valid(self, row: Row) -> bool:
        """Whether a row is valid provided that the content of its mesh has not changed.

        That includes that all its result files are there, and none is empty.
        """
        if row.outcome is Outcome.LOST or not row.content or not self._is_current(row):
            return False
        return not any(self._file_stamps.get(name, "0-").startswith("0-") for name in row.files)

    def _is_current(self, row: Row) -> bool:
        """Whether a row was made with the current settings and version of the method."""
        return row.key == mesh_key(row.content, self.settings)

    @cached_property
    def _file_stamps(self) -> dict[str, str]:
        """Stamps of all result files, from one listing for each folder."""
        return {
            name: stamp or "there"
            for folder in STORED
            for name, stamp in self.output.stamps(folder).items()
        }


def read_summary(results: str | Path) -> Summary:
    """Read the rows of a store without changing it.

    Args:
        results: Folder of the store, or its address.

    Returns:
        A list in alphabetical order of the meshes, with `to_table` and `to_dataframe`.

    Raises:
        OutputError: There is no store, or it is damaged.
    """
    output = Folder(str(results))
    parts = _parts(output)
    if not parts:
        raise OutputError(
            f"{printable(output.url)}: was not written by grasp3d batch; label the meshes of a "
            "folder with grasp3d batch, or give the path of one mesh"
        )
    rows, _ = _read(output, parts)
    return Summary(rows[name] for name in sorted(rows))
