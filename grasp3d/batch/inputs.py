"""Input meshes: files, folders, patterns and tables, on this machine or at an address."""

import os
import re
import tempfile
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import Any

from upath import UPath

from grasp3d.batch.batch_settings import OF_TABLES
from grasp3d.errors import FileUnreadError, GraspError, MeshError
from grasp3d.mesh.sources import SUFFIXES, side_names
from grasp3d.system.names import as_unicode, printable, safe_stem, short_hash, unknown
from grasp3d.system.places import converted, place
from grasp3d.system.tables import SUFFIXES as TABLES
from grasp3d.system.tables import read_columns

RESULT = "_labeled.ply"
"""End of the names of results of `grasp3d label`, which are not inputs."""

STAMPS = ("ETag", "etag", "md5Hash", "content_md5", "LastModified", "last_modified", "mtime",
          "updated", "modified", "created")  # fmt: skip
"""Keys of metadata that change when a file changes, in order of preference."""

_MAGIC = re.compile(r"[*?\[]")


@dataclass(frozen=True)
class MeshFile:
    """One input mesh."""

    name: str
    """Path below the input folder, or below the folder of the table, or the name of a file given
    directly. Names are unique: where they would be equal, meshes are named by their source."""
    source: str
    """Path or address of the file, as given."""
    size: int = 0
    """Size of the file [bytes]."""
    stamp: str = ""
    """Text that changes when the file changes; empty: unknown, as for a .gltf, whose data are in
    other files."""
    own: Mapping[str, Any] = field(default_factory=dict)
    """Settings of this mesh alone, from its row of a table, by name."""


def find_meshes(inputs: Iterable[str], *, results: str | None = None) -> list[MeshFile]:
    """List the input meshes, each only once.

    An input is a mesh file, a folder that is searched recursively, a pattern for files such as
    `lib/**/*.stl`, a table (.csv or .parquet) with a row per mesh, or the address of one of these,
    such as s3://bucket/lib. A table has a column `path`, relative to its folder, and may have
    `name` and the columns in `OF_TABLES`. If a file exists whose name looks like a pattern, the
    input is that file. Folders and patterns leave out hidden files, results of `grasp3d label`, and
    folders of labels.

    Args:
        inputs: Paths and addresses.
        results: Folder of the results; it is left out of searched folders.

    Returns:
        The meshes, sorted by name.

    Raises:
        MeshError: An input is missing or cannot be opened, the inputs have no mesh, or a row of a
            table is invalid.
    """
    inputs = list(inputs)
    found: dict[object, MeshFile] = {}
    for item in inputs:
        is_table = item.lower().endswith(TABLES)
        for real, mesh in _of_table(item) if is_table else _of_place(item, results):
            found.setdefault((real, mesh.name if is_table else ""), mesh)
    if not found:
        where = printable(", ".join(inputs))
        raise MeshError(f"{where}: no mesh in it; files named {' '.join(SUFFIXES)} are read")
    meshes = list(found.values())
    for other in (lambda one: one.source, lambda one: f"{one.source}-{short_hash(one.source)}"):
        counts = Counter(mesh.name for mesh in meshes)
        meshes = [
            mesh if counts[mesh.name] == 1 else replace(mesh, name=as_unicode(other(mesh)))
            for mesh in meshes
        ]
    counts = Counter(mesh.name for mesh in meshes)
    if twice := [mesh.source for mesh in meshes if counts[mesh.name] > 1]:
        raise MeshError(f"{printable(twice[0])}: is given twice: in a table and by itself")
    return sorted(meshes, key=lambda mesh: mesh.name)


def _of_place(item: str, results: str | None) -> Iterator[tuple[str, MeshFile]]:
    """Yield the meshes at a path or address, or of a pattern, each after its real path."""
    where = place(item)
    with converted(item, MeshError, "opened"):
        exists, is_folder = where.exists(), where.is_dir()
    if not exists and not _MAGIC.search(item):
        raise MeshError(f"{printable(item)}: there is no such file or folder")
    if exists and not is_folder:
        with converted(item, MeshError, "opened"):
            yield _found(str(where), as_unicode(where.name), where.fs.info(where.path))
        return
    folder, pattern = (where, "") if exists else _fixed(where)
    with converted(folder, MeshError, "opened"):
        if not folder.is_dir():
            raise MeshError(f"{printable(str(folder))}: there is no such folder")
        root = _real(folder)
        listed = (
            folder.fs.glob(f"{root}/{pattern}", detail=True)
            if pattern
            else folder.fs.find(root, detail=True)
        )
    own = root if results is None else _real(place(results))
    has_labels = cache(lambda path: bool(folder.fs.glob(f"{path}/labels/*.parquet")))
    count = 0
    for path, info in listed.items():
        name = path[len(root) :].lstrip("/")
        last = name.rpartition("/")[2]
        if not last.lower().endswith(SUFFIXES) or last.startswith(".") or last.endswith(RESULT):
            continue
        linked = info.get("islink") and Path(path).is_file()
        if not (info["type"] == "file" or linked) or _is_result(root, name, own, has_labels):
            continue
        count += 1
        yield _found(str(folder / name), as_unicode(name), info)
    if pattern and not count:
        raise MeshError(
            f"{printable(item)}: no mesh matches; a pattern names mesh files, such as lib/**/*.stl"
        )


def _fixed(where: UPath) -> tuple[UPath, str]:
    """Return the folder before the first part with a wildcard, and the pattern below it."""
    parts = [*where.parts]
    first = next(number for number, part in enumerate(parts) if _MAGIC.search(part))
    folder = where
    for _ in parts[first:]:
        folder = folder.parent
    return folder, "/".join(parts[first:])


def _real(where: UPath) -> str:
    """Return a path in its file system with links resolved, unique for each folder or file."""
    if isinstance(where, Path):
        return os.path.realpath(where).replace(os.sep, "/")
    return str(where.path).rstrip("/")


def _is_result(root: str, name: str, own: str, has_labels: Callable[[str], bool]) -> bool:
    """Whether a file below a folder is among the results of this or of another batch."""
    path = root
    for part in name.split("/"):
        if part in {"surfaces", "report"} and has_labels(path):
            return True
        path = f"{path}/{part}"
        if path == own:
            return True
    return False


def _found(source: str, name: str, info: Mapping[str, Any]) -> tuple[str, MeshFile]:
    """Return a mesh from the entry of its file in a listing, after its real path."""
    size, path = int(info.get("size") or 0), str(info["name"])
    if "ino" in info:  # a local file; its ctime changes even if a copy keeps the mtime
        stamp = f"{size}-{info['mtime']}-{info['created']}"
    else:
        state = next((info[key] for key in STAMPS if info.get(key)), "")
        stamp = f"{size}-{state}" if state else ""
    if source.lower().endswith(".gltf"):
        stamp = ""
    real = os.path.realpath(path) if info.get("islink") else path
    return real, MeshFile(name, source, size, stamp)


def _of_table(item: str) -> Iterator[tuple[str, MeshFile]]:
    """Yield the meshes of a table; missing files are not an error here, but fail one by one."""
    with local_copy(item) as path:
        try:
            columns = read_columns(path)
        except (OSError, ValueError) as error:
            raise MeshError(f"{printable(item)}: cannot be read ({error})") from error
    known = ("path", "name", *OF_TABLES)
    for column in columns:
        if column not in known:
            raise MeshError(f"{printable(item)}: {unknown('column', column, known)}")
    if "path" not in columns:
        raise MeshError(f"{printable(item)}: has no column path, which names the mesh files")
    base, first = place(item).parent, dict[str, int]()
    for number in range(len(columns["path"])):
        row = {name: values[number : number + 1].tolist()[0] for name, values in columns.items()}
        given = {name: one for name, one in row.items() if one not in {None, ""} and one == one}  # noqa: PLR0124, nan
        where = f"{printable(item)}, row {number + 1}"
        if "path" not in given:
            raise MeshError(f"{where}: names no mesh file in its column path")
        text = str(given.pop("path"))
        file = place(text) if "://" in text else base / text
        name = str(given.pop("name", "" if "://" in text else text)) or file.name
        if name in first:
            raise MeshError(
                f"{where}: names {printable(name)} a second time (first in row {first[name]}); "
                "remove one, or give each a name in a column called name"
            )
        first[name] = number + 1
        info: dict[str, Any] = {"name": _real(file)}
        if isinstance(file, Path) and file.is_file():
            info = file.fs.info(str(file))
        real, mesh = _found(str(file), as_unicode(name), info)
        yield real, replace(mesh, own=given)


@contextmanager
def local_copy(source: str) -> Iterator[Path]:
    """Yield a local path of a mesh file; a copy of a remote file is deleted at the end.

    The side files of a glTF in its folder or below are copied, too. The message of a `GraspError`
    from inside the context names the source instead of the copy.

    Raises:
        MeshError: The file is missing, or cannot be downloaded.
    """
    where = place(source)
    if isinstance(where, Path):
        yield where
        return
    with tempfile.TemporaryDirectory(prefix="grasp3d-", ignore_cleanup_errors=True) as folder:
        copy = Path(folder, f"{safe_stem(where.stem)}{where.suffix}")
        with converted(source, MeshError, "opened"):
            if not where.exists():
                raise MeshError(f"{printable(source)}: there is no such file")
        with converted(source, FileUnreadError, "downloaded"):
            where.fs.get_file(where.path, str(copy))
            for name in side_names(copy):
                target = copy.parent / name
                if target == copy or not target.resolve().is_relative_to(copy.parent.resolve()):
                    continue
                target.parent.mkdir(parents=True, exist_ok=True)
                with suppress(FileNotFoundError):  # reported when the glTF is read
                    where.fs.get_file(f"{where.parent.path}/{name}", str(target))
        try:
            yield copy
        except GraspError as error:
            raise type(error)(str(error).replace(str(copy), printable(source))) from error
