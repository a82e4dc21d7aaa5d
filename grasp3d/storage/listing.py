"""What files there are, with what tells whether they changed: one listing for each folder."""

import os
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any

from grasp3d.errors import MeshError
from grasp3d.storage.addresses import failures_told, local_path, system_of
from grasp3d.system.names import printable

_STAMPS = ("ETag", "etag", "md5Hash", "content_md5", "LastModified", "last_modified", "mtime",
           "updated", "modified", "created")  # fmt: skip
"""What file systems call that which changes when a file does, the surest first."""


@dataclass(frozen=True)
class Entry:
    """A file in a listing."""

    name: str
    """Its path below the folder that was listed, with `/`."""
    size: int
    """Bytes."""
    stamp: str
    """Changes when the file does; empty: the file system does not tell."""
    place: str
    """Where it really is: links to one file have one place."""


def look(source: str) -> Entry | None:
    """Look what there is at a path or address: the entry of a file, or None for a folder.

    Raises:
        FileNotFoundError: There is nothing.
        MeshError: It cannot be opened.
    """
    local = local_path(source)
    with failures_told(source, MeshError, "opened"):
        if local is not None:
            status = local.stat()
            if local.is_dir():
                return None
            return Entry(local.name, status.st_size, _stamp_of(status), os.path.realpath(local))
        system, path = system_of(source)
        system.invalidate_cache()
        info = system.info(path)
        if info["type"] == "directory":
            return None
        return _entry(path.rpartition("/")[2], source, info)


def entries(source: str, *, depth: int | None = None) -> list[Entry]:
    """List the files of a folder and of all below it; links to folders are not followed.

    Args:
        source: The folder.
        depth: Levels to go down; 1: its own files alone; none: all.

    Raises:
        FileNotFoundError: There is no such folder.
        MeshError: It cannot be opened.
    """
    local = local_path(source)
    with failures_told(source, MeshError, "opened"):
        if local is not None:
            return list(_walk(local, "", os.path.realpath(local), depth))
        system, root = system_of(source)
        system.invalidate_cache()
        found: Mapping[str, Any] = system.find(root, maxdepth=depth, detail=True)
    head = root.rstrip("/") + "/" if root.strip("/") else root
    return [
        _entry(path[len(head) :], f"{source.rstrip('/')}/{path[len(head) :]}", info)
        for path, info in found.items()
        if path.startswith(head) and path != head
    ]


def named_like(pattern: str) -> Callable[[str], object]:
    """Give what tells whether a name fits a pattern; `**` stands for any folders, or none."""
    from fsspec.utils import glob_translate

    try:
        return re.compile(glob_translate(pattern)).match
    except ValueError as error:
        raise MeshError(f"{printable(pattern)}: is no pattern of names ({error})") from error


def _walk(folder: Path | str, below: str, place: str, depth: int | None) -> Iterator[Entry]:
    """Files of a folder of this machine; folders below it that cannot be opened are left out."""
    try:
        found = list(os.scandir(folder))
    except PermissionError:
        if not below:
            raise
        return
    for item in found:
        try:
            if item.is_dir(follow_symlinks=False):
                if depth is None or depth > 1:
                    deeper = None if depth is None else depth - 1
                    name = f"{below}{item.name}/"
                    yield from _walk(item.path, name, f"{place}{os.sep}{item.name}", deeper)
            elif item.is_file():
                link = item.is_symlink()
                real = os.path.realpath(item.path) if link else f"{place}{os.sep}{item.name}"
                status = item.stat()
                yield Entry(f"{below}{item.name}", status.st_size, _stamp_of(status), real)
        except OSError:  # a link in a circle, or a file that has just gone
            continue


def _stamp_of(status: os.stat_result) -> str:
    # The time of the last change of any kind tells where a copy has kept the date of its source.
    return f"{status.st_size}-{status.st_mtime_ns}-{status.st_ctime_ns}"


def _entry(name: str, source: str, info: Mapping[str, Any]) -> Entry:
    said = next((info[key] for key in _STAMPS if info.get(key)), None)
    if isinstance(said, datetime):
        said = said.isoformat()
    size = int(info.get("size") or 0)
    stamp = "" if said is None else f"{size}-{str(said).strip(chr(34))}"
    return Entry(name, size, stamp, source)
