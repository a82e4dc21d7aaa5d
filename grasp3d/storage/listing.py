"""Listings of files, with a stamp of each file that changes when the file changes."""

import os
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from grasp3d.errors import MeshError
from grasp3d.storage.addresses import convert_errors, file_system_of, local_path
from grasp3d.system.names import printable

_STAMPS = ("ETag", "etag", "md5Hash", "content_md5", "LastModified", "last_modified", "mtime",
           "updated", "modified", "created")  # fmt: skip
"""Names of metadata that change when a file changes, in order of preference."""


@dataclass(frozen=True)
class Entry:
    """A file in a listing."""

    name: str
    """Path relative to the listed folder, with `/`."""
    size: int
    """Size [bytes]."""
    stamp: str
    """Text that changes when the file changes; empty: the file system provides none."""
    real_path: str
    """Path or address with links resolved: equal for all links to one file."""


def find_entry(source: str) -> Entry | None:
    """Return the entry of the file at a path or address; None: it is a folder.

    Raises:
        FileNotFoundError: There is no such file or folder.
        MeshError: It cannot be opened.
    """
    local = local_path(source)
    with convert_errors(source, MeshError, "opened"):
        if local is not None:
            status = local.stat()
            if local.is_dir():
                return None
            return Entry(local.name, status.st_size, _stamp_of(status), os.path.realpath(local))
        system, path = file_system_of(source)
        system.invalidate_cache()
        info = system.info(path)
        if info["type"] == "directory":
            return None
        return _entry(path.rpartition("/")[2], source, info)


def list_entries(source: str, *, depth: int | None = None) -> list[Entry]:
    """List the files of a folder and of its subfolders; links to folders are not followed.

    Args:
        source: The folder.
        depth: Levels of folders to list; 1: the folder's own files only; none: all levels.

    Raises:
        FileNotFoundError: There is no such folder.
        MeshError: It cannot be opened.
    """
    local = local_path(source)
    with convert_errors(source, MeshError, "opened"):
        if local is not None:
            return list(_walk(local, "", os.path.realpath(local), depth))
        system, root = file_system_of(source)
        system.invalidate_cache()
        found: Mapping[str, Any] = system.find(root, maxdepth=depth, detail=True)
    head = root.rstrip("/") + "/" if root.strip("/") else root
    return [
        _entry(path[len(head) :], f"{source.rstrip('/')}/{path[len(head) :]}", info)
        for path, info in found.items()
        if path.startswith(head) and path != head
    ]


def name_matcher(pattern: str) -> Callable[[str], object]:
    """Return a matcher of names for a glob pattern; `**` matches any number of folders.

    Raises:
        MeshError: The pattern is not valid.
    """
    from fsspec.utils import glob_translate

    try:
        return re.compile(glob_translate(pattern)).match
    except ValueError as error:
        raise MeshError(
            f"{printable(pattern)}: is not a valid file name pattern ({error})"
        ) from error


def _walk(
    folder: Path | str, relative: str, real_folder: str, depth: int | None
) -> Iterator[Entry]:
    """Yield the files below a local folder; subfolders that cannot be opened are left out."""
    try:
        found = list(os.scandir(folder))
    except PermissionError:
        if not relative:
            raise
        return
    for item in found:
        try:
            if item.is_dir(follow_symlinks=False):
                if depth is None or depth > 1:
                    deeper = None if depth is None else depth - 1
                    name = f"{relative}{item.name}/"
                    real = f"{real_folder}{os.sep}{item.name}"
                    yield from _walk(item.path, name, real, deeper)
            elif item.is_file():
                link = item.is_symlink()
                real = os.path.realpath(item.path) if link else f"{real_folder}{os.sep}{item.name}"
                status = item.stat()
                yield Entry(f"{relative}{item.name}", status.st_size, _stamp_of(status), real)
        except OSError:  # a circular link, or a file that was deleted meanwhile
            continue


def _stamp_of(status: os.stat_result) -> str:
    # ctime changes even if a replaced file keeps the modification time of its source.
    return f"{status.st_size}-{status.st_mtime_ns}-{status.st_ctime_ns}"


def _entry(name: str, source: str, info: Mapping[str, Any]) -> Entry:
    state = next((info[key] for key in _STAMPS if info.get(key)), None)
    if isinstance(state, datetime):
        state = state.isoformat()
    size = int(info.get("size") or 0)
    stamp = "" if state is None else f"{size}-{str(state).strip(chr(34))}"
    return Entry(name, size, stamp, source)
