"""Input meshes: files, folders, patterns and lists, on this machine or at an address."""

import os
import re
from collections import Counter
from collections.abc import Callable, Iterable, Iterator
from dataclasses import replace
from pathlib import Path

from grasp3d.batch.folders import FoundMesh, MeshFile, found_at, joined, meshes_below
from grasp3d.batch.storage import find_entry, list_entries, local_path, name_matcher, read_text
from grasp3d.errors import MeshError
from grasp3d.reading import mesh_suffixes
from grasp3d.system.names import as_unicode, printable, short_hash

LIST = ".txt"
MIN_FOR_LISTING = 10
"""Entries of a list in one folder of an object store from which on the folder is listed once."""

__all__ = ["MeshFile", "find_meshes", "real_path"]

_MAGIC = re.compile(r"[*?\[]")
_COMMENT = re.compile(r"(^|\s)#.*")


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
        suffixes = " ".join(sorted(mesh_suffixes()))
        folders = printable(", ".join(inputs))
        raise MeshError(f"{folders}: no mesh in it; files named {suffixes} are read")
    return sorted(_with_unique_names(meshes.values()), key=lambda mesh: (mesh.name, mesh.source))


def real_path(source: str) -> str:
    """Path with links resolved, equal for all links to one file; an address stays as it is."""
    path = local_path(source)
    return source if path is None else os.path.realpath(path)


def _meshes_of_input(item: str, results: str | None) -> Iterator[FoundMesh]:
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
        yield from meshes_below(item, results)
    elif item.lower().endswith(LIST):
        yield from _meshes_of_list(item, results)
    else:
        yield found_at(item, entry, entry.name)


def _normalized(item: str) -> str:
    """A path as pathlib writes it; an address without a slash at its end."""
    path = local_path(item)
    return (item.rstrip("/") or item) if path is None else str(path)


def _meshes_of_pattern(pattern: str, results: str | None) -> Iterator[FoundMesh]:
    """Files that match a pattern, found with one listing of its fixed part."""
    parts = pattern.replace(os.sep, "/").split("/")
    fixed = next(number for number, part in enumerate(parts) if _MAGIC.search(part))
    folder, below = "/".join(parts[:fixed]), "/".join(parts[fixed:])
    depth = None if "**" in below else len(parts) - fixed
    matches = name_matcher(below)
    if not folder:
        folder = "/" if fixed else "."
    try:
        meshes = list(meshes_below(folder, results, matches=matches, depth=depth))
    except FileNotFoundError as error:
        raise MeshError(f"{printable(folder)}: there is no such folder") from error
    if not meshes:
        raise MeshError(
            f"{printable(pattern)}: no mesh in it; a pattern names mesh files, as lib/**/*.stl"
        )
    yield from meshes


def _meshes_of_list(source: str, results: str | None) -> Iterator[FoundMesh]:
    """Meshes of a list; errors contain the number of the line."""
    lines = [_COMMENT.sub("", line).strip() for line in read_text(source).splitlines()]
    path = local_path(source)
    base = source.rpartition("/")[0] if path is None else str(path.parent)
    items = {
        number: line if "://" in line else joined(base, line)
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


def _meshes_of_line(item: str, results: str | None) -> Iterator[FoundMesh]:
    if item.lower().endswith(LIST):
        raise MeshError(f"{printable(item)}: is a list within a list, which is not read")
    yield from _meshes_of_input(item, results)


def _listed_together(items: Iterable[str]) -> dict[str, FoundMesh]:
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
            item = joined(folder, entry.name)
            files[item] = found_at(item, entry, entry.name)
    return files


def _with_unique_names(meshes: Iterable[MeshFile]) -> list[MeshFile]:
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
