"""Meshes of a local or remote folder, found with one listing."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from grasp3d.batch.storage import Entry, list_entries, local_path
from grasp3d.reading import mesh_suffixes
from grasp3d.system.names import as_unicode

RESULT = "_labeled.ply"
"""Suffix of results of `grasp3d label`, which are not inputs."""

MARKER = "grasp3d.json"
"""File that marks a folder as a store of results."""

STORED = ("labels", "fields", "summary", "journal", "report", "damaged")
"""Folders of a store; they contain no inputs."""


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
class FoundMesh:
    """A mesh and its real path."""

    mesh: MeshFile
    real_path: str
    """Path or address with links resolved: equal for all links to one file."""


def meshes_below(
    folder: str,
    results: str | None,
    *,
    matches: Callable[[str], object] = bool,
    depth: int | None = None,
) -> Iterator[FoundMesh]:
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
    suffixes = tuple(mesh_suffixes())
    stored = _store_folders(listed)
    own = _results_below(folder, results)
    for entry in listed:
        path, _, name = entry.name.rpartition("/")
        if not name.lower().endswith(suffixes) or name.startswith(".") or name.endswith(RESULT):
            continue
        if (stored and _inside(path, stored)) or (own and _inside(entry.real_path, {own})):
            continue
        if matches(entry.name):
            yield found_at(joined(folder, entry.name), entry, entry.name)


def _store_folders(listed: Iterable[Entry]) -> set[str]:
    """Folders with the results of a store."""
    stores = [
        entry.name.removesuffix(MARKER)
        for entry in listed
        if entry.name == MARKER or entry.name.endswith(f"/{MARKER}")
    ]
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


def found_at(source: str, entry: Entry, name: str) -> FoundMesh:
    """Describe a mesh that was found.

    Args:
        source: Path or address.
        entry: The file in a listing.
        name: Name of the mesh.
    """
    stamp = "" if source.lower().endswith(".gltf") else entry.stamp
    return FoundMesh(MeshFile(as_unicode(name), source, entry.size, stamp), entry.real_path)


def joined(folder: str, name: str) -> str:
    """Path or address of a file below a folder."""
    if local_path(folder) is None:
        return f"{folder.rstrip('/')}/{name}"
    return str(Path(folder, name))
