"""Labels of a library on disk: files of rows, each written once and as a whole.

A chunk is `labels/NAME.parquet`, with a row for each of its meshes, and `surfaces/NAME.tar` with
their labelled surfaces, unless these have their own files. A mesh with a row in a chunk is done. If
a mesh has two rows, which a killed run may leave, the one written later counts.
"""

import io
import json
import re
import tarfile
import tempfile
import time
from collections import Counter
from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any

import pyarrow as pa
import pyarrow.parquet as pq
from upath import UPath

from grasp3d.batch.inputs import local_copy
from grasp3d.batch.row import COLUMNS, Row
from grasp3d.errors import MeshError, OutputError
from grasp3d.settings.units import Unit
from grasp3d.system.documents import newer_version
from grasp3d.system.names import printable, reason_of
from grasp3d.system.places import converted, place, writing
from grasp3d.system.tables import records_of_table, table_of_records

if TYPE_CHECKING:
    from grasp3d.surface.fields import Array
    from grasp3d.surface.labels import SurfaceLabels

NAME = r"(all|\d+of\d+)-\d{5,}\.parquet"
"""Regular expression for the names of chunks."""

SECONDS = 60.0
"""Time after which waiting rows are written, even if they are few [s]."""

MOST_BYTES = 100e6
"""Total size of waiting surfaces at which they are written, even if they are few [bytes]."""

VERTICES = {"label": pa.int8(), "critical_angle": pa.float32(), "margin": pa.float32()}
"""Values at each vertex of a surface, stored as lists in the columns `vertex_NAME`; and types."""


class DamagedError(OutputError):
    """Error of a file of results that is damaged."""

    def __init__(self, path: UPath, reason: str) -> None:
        self.path, self.is_chunk = path, bool(re.fullmatch(NAME, path.name))
        remedy = "the same batch command removes it and labels its meshes again"
        if path.suffix == ".tar":
            remedy = f"remove labels/{path.stem}.parquet too, and label its meshes again"
        elif not self.is_chunk:
            remedy = "remove it"
        super().__init__(
            f"{printable(str(path))}: is damaged, or not written by grasp3d batch ({reason}); "
            f"{remedy}"
        )


@dataclass(frozen=True)
class LabelledMesh:
    """All data that are stored for one mesh."""

    row: Row
    vertices: Mapping[str, "Array"]
    """Values by the names in `VERTICES`, shape (V,) each; empty: the mesh was not labelled."""
    files: Mapping[str, bytes]
    """Contents of the mesh's files in the report, by path below the output folder."""
    surface: bytes = b""
    """The labelled surface as a PLY, or as an NPZ for the chunk's .tar; empty: it is not stored."""


class ChunkWriter:
    """Writer that collects labelled meshes, and writes a chunk when there are enough."""

    def __init__(self, folder: UPath, prefix: str, head: Mapping[str, Any], most: int) -> None:
        """Prepare the writer; nothing is written yet.

        Args:
            folder: Folder of the results.
            prefix: Beginning of the chunks' names; no other run may use it at the same time.
            head: Metadata that all chunks share.
            most: Largest number of rows in a chunk.
        """
        self._folder, self._prefix, self._head, self._most = folder, prefix, head, most
        paths = _found(folder, f"labels/{prefix}-*.parquet")
        numbers = [int(path.stem.rpartition("-")[2]) for path in paths]
        self._number = max(numbers, default=-1)
        self._waiting: list[LabelledMesh] = []
        self._bytes, self._since = 0, 0.0

    @property
    def waits(self) -> bool:
        """Whether meshes are waiting to be written."""
        return bool(self._waiting)

    def add(self, done: LabelledMesh) -> None:
        """Store a labelled mesh; its row is written a little later.

        Raises:
            OutputError: The mesh cannot be written.
        """
        files = dict(done.files)
        if done.row.surface.endswith(".ply"):
            files[done.row.surface], done = done.surface, replace(done, surface=b"")
        for name, data in files.items():
            with writing(self._folder / name) as part:
                part.write_bytes(data)
        if not self._waiting:
            self._since = time.monotonic()
        self._waiting.append(replace(done, files={}))
        self._bytes += len(done.surface)
        late = time.monotonic() - self._since >= SECONDS
        if late or len(self._waiting) >= self._most or self._bytes >= MOST_BYTES:
            self.write()

    def write(self) -> None:
        """Write the waiting meshes; if there are none, write an empty chunk.

        Raises:
            OutputError: The meshes cannot be written.
        """
        meshes = sorted(self._waiting, key=lambda one: one.row.mesh)
        surfaces = [(one.row.surface, one.surface) for one in meshes if one.surface]
        self._write(_table(meshes), surfaces or None)
        self._waiting, self._bytes = [], 0

    def merge(self) -> None:
        """Join small chunks with this prefix, and remove superseded rows.

        Raises:
            OutputError: The chunks cannot be written.
        """
        library = current(self._folder)
        own = [one for one in library.chunks if one.path.stem.startswith(f"{self._prefix}-")]
        last = {name: library.chunks[at].path.stem for name, (at, _) in library.meshes.items()}
        held, groups = Counter(last.values()), list[list[Chunk]]()
        for one in own:
            rows = held[one.path.stem]
            if rows >= self._most:
                continue
            if not groups or sum(held[each.path.stem] for each in groups[-1]) + rows > self._most:
                groups.append([])
            groups[-1].append(one)
        for group in groups:
            rows = sum(held[one.path.stem] for one in group)
            is_alone = len(group) == 1 and rows == group[0].rows
            if is_alone and (rows or len(library.chunks) == 1):
                continue
            if rows:
                self._join(group, last)
            for one in group:
                with converted(one.path, OutputError, "removed"):
                    one.path.unlink()
        there = {path.stem for path in _found(self._folder, f"labels/{self._prefix}-*.parquet")}
        for tar in _found(self._folder, f"surfaces/{self._prefix}-*.tar"):
            if tar.stem not in there:
                with converted(tar, OutputError, "removed"):
                    tar.unlink()

    def _join(self, chunks: Sequence["Chunk"], last: Mapping[str, str]) -> None:
        """Write the rows of several chunks as one, without superseded rows."""
        tables = []
        for chunk in chunks:
            table = chunk.read(None)
            holds = [last[name] == chunk.path.stem for name in table["mesh"].to_pylist()]
            tables.append(table.filter(pa.array(holds, pa.bool_())))
        names = [one["surface"].to_pylist() for one in tables]
        surfaces = (
            surface
            for chunk, held in zip(chunks, names, strict=True)
            for surface in chunk.surfaces(held)
        )
        self._write(
            pa.concat_tables(tables, promote_options="permissive").sort_by("mesh"),
            surfaces if any(chunk.members for chunk in chunks) else None,
            chunks[-1].head["written"],
        )

    def _write(
        self,
        table: pa.Table,
        surfaces: Iterable[tuple[str, bytes]] | None,
        written: int | None = None,
    ) -> None:
        """Write a chunk: surfaces first, since a row in the table means that its mesh is done."""
        self._number += 1
        name = f"{self._prefix}-{self._number:05d}"
        if surfaces is not None:
            target = self._folder / "surfaces" / f"{name}.tar"
            with writing(target) as part, tarfile.open(part, "w") as tar:
                for member, data in surfaces:
                    info = tarfile.TarInfo(member)
                    info.size = len(data)
                    tar.addfile(info, io.BytesIO(data))
        head = {**self._head, "written": written or time.time_ns()}
        schema = _described(table.schema).with_metadata({"grasp3d": json.dumps(head)})
        with writing(self._folder / "labels" / f"{name}.parquet") as part:
            pq.write_table(table.cast(schema), part, compression="zstd", write_page_checksum=True)


def _found(folder: UPath, pattern: str) -> list[UPath]:
    with converted(folder, OutputError, "read"):
        return sorted(path for path in folder.glob(pattern) if path.name[0] != ".")  # unfinished


def _table(meshes: Sequence[LabelledMesh]) -> pa.Table:
    """Return the rows of meshes, with the values at their vertices."""
    table = table_of_records([one.row for one in meshes], Row, {})
    for name, kind in VERTICES.items():
        lists = [one.vertices.get(name) for one in meshes]
        table = table.append_column(f"vertex_{name}", pa.array(lists, pa.list_(kind)))
    return table


def _described(schema: pa.Schema) -> pa.Schema:
    """Return a schema whose columns state their meaning and unit; `unit` means that of the row.

    Fractions have no unit: only the report shows them in per cent.
    """
    said = {name: (one.meaning, one.unit.replace("%", "")) for name, one in COLUMNS.items()}
    of_vertices = {"label": "", "critical_angle": "rad", "margin": "rad"}
    for name, unit in of_vertices.items():
        said[f"vertex_{name}"] = f"{name} of each vertex of the surface", unit
    return pa.schema(
        one.with_metadata(dict(zip(("meaning", "unit"), said[one.name], strict=True)))
        for one in schema
    )


@dataclass(frozen=True)
class Chunk:
    """A chunk on disk."""

    path: UPath
    head: Mapping[str, Any]
    """Metadata of the chunk: version, settings, and time of writing."""
    rows: int

    @classmethod
    def at(cls, path: UPath) -> "Chunk":
        """Read the metadata of a chunk.

        Raises:
            OutputError: The chunk is damaged, or is not from this or an older version of grasp3d.
        """
        with _undamaged(path), path.open("rb") as file:
            parquet = pq.ParquetFile(file)
            head = dict(json.loads(parquet.schema_arrow.metadata[b"grasp3d"]))
            head["written"], rows = int(head["written"]), parquet.metadata.num_rows
        if newer := newer_version(head.get("version")):
            raise OutputError(f"{printable(str(path))}: {newer}")
        return cls(path, head, rows)

    @property
    def tar(self) -> UPath:
        """File with the surfaces of the chunk, which may not exist."""
        return self.path.parent.parent / "surfaces" / f"{self.path.stem}.tar"

    def read(self, columns: Collection[str] | None) -> pa.Table:
        """Read the given columns, if they exist, or all columns if None.

        Raises:
            OutputError: The chunk is damaged.
        """
        with _undamaged(self.path), self.path.open("rb") as file:
            parquet = pq.ParquetFile(file, page_checksum_verification=True)
            there = parquet.schema_arrow.names
            wanted = None if columns is None else [one for one in columns if one in there]
            # Arrow's threads would release parts of a Python file after the interpreter has ended,
            # which aborts the process.
            return parquet.read(wanted, use_threads=False)

    @cached_property
    def members(self) -> dict[str, tuple[int, int]]:
        """Position and size of each surface in the .tar file [bytes], by name."""
        if not self.tar.exists():
            return {}
        with _undamaged(self.tar), self.tar.open("rb") as file, tarfile.open(fileobj=file) as tar:
            return {one.name: (one.offset_data, one.size) for one in tar}

    def surfaces(self, names: Collection[str]) -> Iterator[tuple[str, bytes]]:
        """Yield names and contents of the given surfaces, if they exist.

        Raises:
            OutputError: The .tar file is damaged.
        """
        if there := [name for name in names if name in self.members]:
            with _undamaged(self.tar), self.tar.open("rb") as file:
                for name in there:
                    start, size = self.members[name]
                    file.seek(start)
                    yield name, bytes(file.read(size))


@contextmanager
def _undamaged(path: UPath) -> Iterator[None]:
    """Raise a DamagedError for a bad file, and an OutputError for a fault of its disk.

    Arrow reports bad files by an OSError without a number; a batch removes damaged files.
    """
    damage = pa.ArrowException, tarfile.TarError, ValueError, TypeError, LookupError
    with converted(path, OutputError, "read"):
        try:
            yield
        except (*damage, OSError) as error:
            of_disk = isinstance(error, OSError) and error.errno is not None
            if of_disk and not isinstance(error, FileNotFoundError):
                raise
            raise DamagedError(path, reason_of(error)) from error


@dataclass(frozen=True)
class Library:
    """A library of labelled meshes, as written by `label_library`."""

    folder: UPath
    chunks: tuple[Chunk, ...]
    only: frozenset[str] | None = None
    """Names of the meshes to which it is restricted; None: all meshes."""

    @property
    def settings(self) -> dict[str, Any]:
        """The settings with which all meshes were labelled."""
        return dict(self.chunks[-1].head["settings"])

    @cached_property
    def meshes(self) -> dict[str, tuple[int, int]]:
        """Number of each mesh's chunk, and of its row in the chunk, sorted by name of the mesh."""
        found = {
            name: (number, row)
            for number, chunk in enumerate(self.chunks)
            for row, name in enumerate(chunk.read(["mesh"])["mesh"].to_pylist())
        }
        only = found if self.only is None else self.only
        return {name: found[name] for name in sorted(found) if name in only}

    def table(self, columns: Iterable[str] | None = None) -> pa.Table:
        """Return the rows as a table, sorted by the names of the meshes.

        Args:
            columns: Names of the columns; None: all but those of vertices (`vertex_label`,
                `vertex_critical_angle` and `vertex_margin`, lists with a value per vertex).

        Raises:
            OutputError: A file is damaged, or there is no such column.
        """
        names = list(COLUMNS) if columns is None else list(columns)
        try:
            tables = [chunk.read(names) for chunk in self.chunks]
        except DamagedError as error:
            if error.path.exists():
                raise
            return replace(current(self.folder), only=self.only).table(names)  # chunks were joined
        table = pa.concat_tables(tables, promote_options="permissive")
        if missing := [name for name in names if name not in table.column_names]:
            raise OutputError(f"{printable(str(self.folder))}: has no column {missing[0]}")
        starts = [0]
        for one in tables:
            starts.append(starts[-1] + one.num_rows)
        rows = [starts[chunk] + row for chunk, row in self.meshes.values()]
        return table.take(pa.array(rows, pa.int64())).select(names)

    def rows(self, columns: Iterable[str] | None = None) -> list[Row]:
        """Return the rows as records, sorted by the names of the meshes.

        Args:
            columns: Names of the columns to read; others get their defaults. None: all.

        Raises:
            OutputError: A file is damaged.
        """
        return records_of_table(self.table(columns), Row)

    def labels(self, mesh: str, *, unit: Unit | None = None) -> "SurfaceLabels":
        """Return the labelled surface of a mesh, with its grasps and settings.

        Args:
            mesh: Name of the mesh.
            unit: Unit of the mesh, for files that do not state one.

        Raises:
            MeshError: There is no such mesh, or its surface is not stored.
        """
        from grasp3d.formats import read_labels  # not needed for rows

        where = printable(f"{self.folder}: {mesh}")
        if mesh not in self.meshes:
            raise MeshError(f"{where} is not in this library")
        number, row = self.meshes[mesh]
        chunk = self.chunks[number]
        name = chunk.read(["surface"])["surface"][row].as_py()
        if not name:
            raise MeshError(f"{where} has no surface here; label it with --surfaces ply")
        if name.endswith(".ply"):
            with local_copy(str(self.folder / name)) as path:
                return read_labels(path, unit=unit)
        found = dict(chunk.surfaces([name]))
        if not found:
            raise MeshError(f"{where}: its surface is missing from {chunk.tar.name}")
        with tempfile.TemporaryDirectory(prefix="grasp3d-") as folder:
            path = Path(folder, name)
            path.write_bytes(found[name])
            return read_labels(path, unit=unit)


def current(folder: UPath) -> Library:
    """Return the library in a folder of labels; the chunk that was written last is at the end.

    Raises:
        OutputError: A chunk is damaged, or was written by a newer version.
    """
    try:
        chunks = [Chunk.at(path) for path in _found(folder, "labels/*.parquet")]
        library = Library(folder, tuple(sorted(chunks, key=lambda one: one.head["written"])))
        _ = library.meshes
    except DamagedError as error:
        if error.path in _found(folder, "labels/*.parquet"):
            raise
        return current(folder)  # another part of the run has just joined the chunk with others
    return library


def open_library(folder: str | Path) -> Library:
    """Open a library of labelled meshes.

    Args:
        folder: Folder of the results of `label_library` or `grasp3d batch`, or its address.

    Raises:
        OutputError: The folder has no labels, or they are damaged or from a newer version.

    Example:
        >>> import grasp3d
        >>> from grasp3d.jobs import ClusterSettings
        >>> here = ClusterSettings(workers=0)
        >>> _ = grasp3d.label_library(["meshes/box.obj"], "results", cluster=here, report=False)
        >>> library = grasp3d.open_library("results")
        >>> library.table(["mesh", "stable"]).num_rows
        1
        >>> library.labels("box.obj").fractions()["S"] > 0.5
        True
    """
    library = current(place(str(folder), OutputError))
    if not library.chunks:
        raise OutputError(
            f"{printable(str(folder))}: was not written by grasp3d batch; label the meshes of a "
            "folder with grasp3d batch, or give the path of one mesh"
        )
    return library
