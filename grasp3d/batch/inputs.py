"""Input meshes: files, folders, patterns and lists, on this machine or at an address."""

import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

from grasp3d.batch.row import Row
from grasp3d.batch.storage.files import (
    Entry,
    find_entry,
    list_entries,
    local_path,
    name_matcher,
    read_text,
)
from grasp3d.errors import MeshError
from grasp3d.mesh.reading.sources import SUFFIXES
from grasp3d.system.names import as_unicode, printable, short_hash

RESULT = "_labeled.ply"
"""Suffix of results of `grasp3d label`, which are not inputs."""

STORED = ("labels", "fields", "summary", "report")
"""Folders of a store; they contain no inputs."""

PART = re.compile(r"(.*/)?summary/part-\d{5,}\.parquet")
"""Files with the rows of a store; a folder that has one is a store."""

LIST = ".txt"
MIN_FOR_LISTING = 10
"""Entries of a list in one folder of an object store from which on the folder is listed once."""

_MAGIC = re.compile(r"[*?\[]")
_COMMENT = re.compile(r"(^|\s)#.*")


@dataclass(frozen=True)
class MeshFile:
    """One input mesh."""

    name: str
    """Path below the input folder, or below the folder of the list; for a file given directly, its
    file name. Names are unique: where they would be equal, meshes are named by their source."""
    source: str
    """Path or address of the file, as given."""
    size: int = 0
    """Bytes."""
    stamp: str = ""
    """Changes when the file changes; empty: unknown, as for a .gltf, whose data are in other
    files."""


@dataclass(frozen=True)
class _FoundMesh:
    """A mesh and its real path."""

    mesh: MeshFile
    real_path: str
    """Path or address with links resolved: equal for all links to one file."""


def find_meshes(inputs: Iterable[str], *, results: str | None = None) -> list[MeshFile]:
    """List the input meshes, each once.

    An input is a mesh file, a folder that is searched recursively, a pattern for files such as
    `lib/**/*.stl`, a list of inputs (.txt: one per line, relative to the list's folder, `#` begins
    a comment), or the address of one of these such as s3://bucket/lib. An existing file whose name
    looks like a pattern is that file. In folders and patterns hidden files, results of
    `grasp3d label`, and the contents of a store of results are left out.

    Args:
        inputs: Paths and addresses.
        results: Folder for results, left out where it is below a folder that is searched.

    Returns:
        In alphabetical order of the names.

    Raises:
        MeshError: An input is missing or cannot be opened, or there is no mesh among them.
    """
    inputs = list(inputs)
    meshes: dict[str, MeshFile] = {}
    for item in inputs:
        for one in _meshes_of_input(item, results):
            meshes.setdefault(one.real_path, one.mesh)
    if not meshes:
        suffixes = " ".join(SUFFIXES)
        folders = printable(", ".join(inputs))
        raise MeshError(f"{folders}: no mesh in it; files named {suffixes} are read")
    return sorted(with_unique_names(meshes.values()), key=lambda mesh: (mesh.name, mesh.source))


def real_path(source: str) -> str:
    """Path with links resolved, equal for all links to one file; an address stays as it is."""
    path = local_path(source)
    return source if path is None else os.path.realpath(path)


def _meshes_of_input(item: str, results: str | None) -> Iterator[_FoundMesh]:
    """Meshes of one input."""
    item = _normalized(item)
    try:
        entry = find_entry(item)
    except FileNotFoundError as error:
        if not _MAGIC.search(item):
            raise MeshError(f"{printable(item)}: there is no such file or folder") from error
        yield from _meshes_of_pattern(item, results)
        return
    if entry is None:
        yield from _meshes_below(item, results)
    elif item.lower().endswith(LIST):
        yield from _meshes_of_list(item, results)
    else:
        yield _found_at(item, entry, entry.name)


def _normalized(item: str) -> str:
    """A path as pathlib writes it; an address without a slash at its end."""
    path = local_path(item)
    return (item.rstrip("/") or item) if path is None else str(path)


def _meshes_of_pattern(pattern: str, results: str | None) -> Iterator[_FoundMesh]:
    """Files that match a pattern, found with one listing of its fixed part."""
    parts = pattern.replace(os.sep, "/").split("/")
    fixed = next(number for number, part in enumerate(parts) if _MAGIC.search(part))
    folder, below = "/".join(parts[:fixed]), "/".join(parts[fixed:])
    depth = None if "**" in below else len(parts) - fixed
    matches = name_matcher(below)
    if not folder:
        folder = "/" if fixed else "."
    try:
        meshes = list(_meshes_below(folder, results, matches=matches, depth=depth))
    except FileNotFoundError as error:
        raise MeshError(f"{printable(folder)}: there is no such folder") from error
    if not meshes:
        raise MeshError(
            f"{printable(pattern)}: no mesh in it; a pattern names mesh files, as lib/**/*.stl"
        )
    yield from meshes


def _meshes_of_list(source: str, results: str | None) -> Iterator[_FoundMesh]:
    """Meshes of a list; errors contain the number of the line."""
    lines = [_COMMENT.sub("", line).strip() for line in read_text(source).splitlines()]
    path = local_path(source)
    base = source.rpartition("/")[0] if path is None else str(path.parent)
    items = {
        number: line if "://" in line else _joined(base, line)
        for number, line in enumerate(lines, 1)
        if line
    }
    listed = _listed_together(items.values())
    for number, item in items.items():
        try:
            for one in [listed[item]] if item in listed else _meshes_of_line(item, results):
                yield replace(one, mesh=_named_below(base, one.mesh))
        except MeshError as error:
            raise MeshError(f"{printable(source)}, line {number}: {error}") from error


def _named_below(base: str, mesh: MeshFile) -> MeshFile:
    """Name a mesh by its path below the folder of its list, if it is there."""
    head = base + ("/" if local_path(base) is None else os.sep)
    below = mesh.source if base == "." else mesh.source.removeprefix(head)
    if (
        (below == mesh.source and base != ".")
        or Path(below).is_absolute()
        or ".." in Path(below).parts
    ):
        return mesh
    return replace(mesh, name=as_unicode(below))


def _meshes_of_line(item: str, results: str | None) -> Iterator[_FoundMesh]:
    if item.lower().endswith(LIST):
        raise MeshError(f"{printable(item)}: is a list within a list, which is not read")
    yield from _meshes_of_input(item, results)


def _listed_together(items: Iterable[str]) -> dict[str, _FoundMesh]:
    """Files of an object store, where a list names many in one folder: one listing per folder."""
    remote = [item for item in items if local_path(item) is None and not _MAGIC.search(item)]
    counts = Counter(item.rpartition("/")[0] for item in remote)
    files = {}
    for folder in sorted(folder for folder, count in counts.items() if count >= MIN_FOR_LISTING):
        try:
            listed = list_entries(folder, depth=1)
        except FileNotFoundError:
            continue  # reported for each entry
        for entry in listed:
            item = _joined(folder, entry.name)
            files[item] = _found_at(item, entry, entry.name)
    return files


def with_unique_names(meshes: Iterable[MeshFile]) -> list[MeshFile]:
    """Name meshes with equal names by their source, until all names differ."""
    by_source = _renamed(list(meshes), lambda mesh: mesh.source)
    return _renamed(by_source, lambda mesh: f"{mesh.source}-{short_hash(mesh.source)}")


def _renamed(meshes: list[MeshFile], other: Callable[[MeshFile], str]) -> list[MeshFile]:
    while True:
        counts = Counter(mesh.name for mesh in meshes)
        renamed = [
            mesh if counts[mesh.name] == 1 else replace(mesh, name=as_unicode(other(mesh)))
            for mesh in meshes
        ]
        if renamed == meshes:
            return meshes
        meshes = renamed


def _meshes_below(
    folder: str,
    results: str | None,
    *,
    matches: Callable[[str], object] = bool,
    depth: int | None = None,
) -> Iterator[_FoundMesh]:
    """Find the meshes in a folder and below, without hidden files and results.

    Args:
        folder: Path or address.
        results: Folder for results, left out where it is below `folder`.
        matches: Called with a name below the folder; a false value excludes the file.
        depth: Levels of folders to search; none: all.

    Raises:
        FileNotFoundError: There is no such folder.
        MeshError: The folder cannot be opened.
    """
    listed = list_entries(folder, depth=depth)
    stored = _store_folders(listed)
    own = _results_below(folder, results)
    for entry in listed:
        path, _, name = entry.name.rpartition("/")
        if not name.lower().endswith(SUFFIXES) or name.startswith(".") or name.endswith(RESULT):
            continue
        if (stored and _inside(path, stored)) or (own and _inside(entry.real_path, {own})):
            continue
        if matches(entry.name):
            yield _found_at(_joined(folder, entry.name), entry, entry.name)


def _store_folders(listed: Iterable[Entry]) -> set[str]:
    """Folders with the results of a store."""
    stores = {found[1] or "" for entry in listed if (found := PART.fullmatch(entry.name))}
    return {f"{store}{name}" for store in stores for name in STORED}


def _inside(path: str, folders: set[str]) -> bool:
    """Whether a path is one of the folders, or below one."""
    while path not in folders:
        path, slash, _ = path.replace("\\", "/").rpartition("/")
        if not slash:
            return False
    return True


def _results_below(folder: str, results: str | None) -> str:
    """Folder for results if it is below the searched folder; else empty."""
    if results is None:
        return ""
    searched, target = local_path(folder), local_path(results)
    if searched is None or target is None:
        below = searched is target and results.startswith(folder.rstrip("/") + "/")
        return results.rstrip("/") if below else ""
    base, own = searched.resolve(), target.resolve()
    return own.as_posix() if own != base and own.is_relative_to(base) else ""


def _found_at(source: str, entry: Entry, name: str) -> _FoundMesh:
    """A mesh at a path or address, from the entry of its file in a listing."""
    stamp = "" if source.lower().endswith(".gltf") else entry.stamp
    return _FoundMesh(MeshFile(as_unicode(name), source, entry.size, stamp), entry.real_path)


def _joined(folder: str, name: str) -> str:
    """Path or address of a file below a folder."""
    if local_path(folder) is None:
        return f"{folder.rstrip('/')}/{name}"
    return str(Path(folder, name))


def use_stored_names(meshes: Sequence[MeshFile], rows: Mapping[str, Row]) -> list[MeshFile]:
    """Name meshes as in their rows, so that no file has two rows and no row two files.

    The name of a mesh depends on the input folder, which may differ from run to run. A mesh whose
    file has a row keeps the row's name. A mesh whose name belongs to another file that still
    exists is named by its source.

    Args:
        meshes: From `find_meshes`.
        rows: Rows of the store, by name.
    """
    name_at = {_location(row.source): name for name, row in rows.items()}
    named = [replace(mesh, name=_name(mesh, rows, name_at)) for mesh in meshes]
    counts = Counter(mesh.name for mesh in named)
    return [
        mesh if counts[mesh.name] == 1 else replace(mesh, name=as_unicode(mesh.source))
        for mesh in named
    ]


def _name(mesh: MeshFile, rows: Mapping[str, Row], name_at: Mapping[str, str]) -> str:
    location = _location(mesh.source)
    if location in name_at:
        return name_at[location]
    if mesh.name in rows and _exists(rows[mesh.name].source):
        return as_unicode(mesh.source)
    return mesh.name


def _location(source: str) -> str:
    path = local_path(source)
    return source if path is None else os.path.abspath(path)  # noqa: PTH100, links stay


def _exists(source: str) -> bool:
    try:
        find_entry(source)
    except (FileNotFoundError, MeshError):
        return False
    return True
