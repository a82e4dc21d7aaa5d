"""Meshes of a folder, of this machine or at an address, by one listing of it."""

from collections.abc import Callable, Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path

from grasp3d.reading import mesh_suffixes
from grasp3d.storage import Entry, entries, local_path
from grasp3d.system.names import as_unicode

RESULT = "_labeled.ply"
"""How results of `grasp3d label` are called, which are no inputs."""

MARKER = "grasp3d.json"
"""File that marks a folder as a store of results."""

STORED = ("labels", "fields", "summary", "journal", "report", "damaged")
"""Folders of a store; there is no input in them."""


@dataclass(frozen=True)
class MeshFile:
    """A mesh among the inputs."""

    name: str
    """Its path below the folder that was given, or that of the list; of a file that was given, its
    name. No two meshes have one name: those that would are called by their source."""
    source: str
    """Path or address of the file, as it was given."""
    size: int = 0
    """Bytes."""
    stamp: str = ""
    """Changes when the file does; empty: nothing tells, as for a .gltf, whose data lie beside."""


@dataclass(frozen=True)
class Found:
    """A mesh, and where it really is."""

    mesh: MeshFile
    place: str
    """The same for all links to a file."""


def meshes_below(
    folder: str,
    results: str | None,
    *,
    wanted: Callable[[str], object] = bool,
    depth: int | None = None,
) -> Iterator[Found]:
    """Find the meshes in a folder and below; what is hidden, or a result, is none.

    Args:
        folder: Path or address.
        results: Folder for results, left out where it is below.
        wanted: Tells of a name below the folder whether it counts.
        depth: Levels to go down; none: all.

    Raises:
        FileNotFoundError: There is no such folder.
        MeshError: It cannot be opened.
    """
    listed = entries(folder, depth=depth)
    suffixes = tuple(mesh_suffixes())
    stored = _stores(listed)
    own = _own(folder, results)
    for entry in listed:
        path, _, name = entry.name.rpartition("/")
        if not name.lower().endswith(suffixes) or name.startswith(".") or name.endswith(RESULT):
            continue
        if (stored and _inside(path, stored)) or (own and _inside(entry.place, {own})):
            continue
        if wanted(entry.name):
            yield found_at(joined(folder, entry.name), entry, entry.name)


def _stores(listed: Iterable[Entry]) -> set[str]:
    """Folders that hold the results of a store."""
    homes = [
        entry.name.removesuffix(MARKER)
        for entry in listed
        if entry.name == MARKER or entry.name.endswith(f"/{MARKER}")
    ]
    return {f"{home}{name}" for home in homes for name in STORED}


def _inside(path: str, folders: set[str]) -> bool:
    """Whether a path is one of the folders, or below one."""
    while path not in folders:
        path, slash, _ = path.replace("\\", "/").rpartition("/")
        if not slash:
            return False
    return True


def _own(folder: str, results: str | None) -> str:
    """Where the results go, if that is below the folder that is searched; else empty."""
    if results is None:
        return ""
    here, there = local_path(folder), local_path(results)
    if here is None or there is None:
        below = here is there and results.startswith(folder.rstrip("/") + "/")
        return results.rstrip("/") if below else ""
    home, own = here.resolve(), there.resolve()
    return own.as_posix() if own != home and own.is_relative_to(home) else ""


def found_at(source: str, entry: Entry, name: str) -> Found:
    """A mesh that was found: its path or address, what a listing says of it, and its name."""
    stamp = "" if source.lower().endswith(".gltf") else entry.stamp
    return Found(MeshFile(as_unicode(name), source, entry.size, stamp), entry.place)


def joined(folder: str, name: str) -> str:
    """Path or address of a file below a folder."""
    if local_path(folder) is None:
        return f"{folder.rstrip('/')}/{name}"
    return str(Path(folder, name))
