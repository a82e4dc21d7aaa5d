"""Files at paths and addresses: listings, with a stamp of each file, contents, and local copies.

A stamp changes when the file changes. fsspec, whose file systems addresses are on, is imported with
the first address; its errors are converted.
"""

import errno
import os
import re
import tempfile
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from datetime import datetime
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from grasp3d.errors import FileUnreadError, GraspError, MeshError
from grasp3d.mesh.reading.scenes import side_names
from grasp3d.system.names import printable, reason_of, safe_stem

_STAMPS = ("ETag", "etag", "md5Hash", "content_md5", "LastModified", "last_modified", "mtime",
           "updated", "modified", "created")  # fmt: skip
"""Names of metadata that change when a file changes, in order of preference."""

_LOCAL = ("file://", "local://")
_PACKAGES = {"s3": "s3fs", "s3a": "s3fs"}
_NO_CREDENTIALS = ("NoCredentialsError", "PartialCredentialsError", "ProfileNotFound")


def local_path(source: str) -> Path | None:
    """Return the local path of a path or address; None: it is not on this machine."""
    for head in _LOCAL:
        if source.startswith(head):
            return Path(unquote(urlsplit(source).path) if "%" in source else source[len(head) :])
    return None if "://" in source else Path(source)


def file_system_of(url: str) -> tuple[Any, str]:
    """Return the fsspec file system of an address, and the path in it."""
    import fsspec

    system, path = fsspec.core.url_to_fs(url)
    return system, path


@contextmanager
def convert_errors(url: str, kind: type[GraspError], action: str) -> Iterator[None]:
    """Convert the errors of any file system to an error of this package.

    A FileNotFoundError is not converted where a file is read, listed or opened.

    Args:
        url: Path or address, for the message.
        kind: Class of the error to raise.
        action: Past participle of the action, for the message: read, written.
    """
    try:
        yield
    except GraspError:
        raise
    except FileNotFoundError as error:
        if action not in {"written", "removed"}:
            raise
        raise kind(
            f"{printable(url)}: cannot be {action} (there is no such bucket or folder); "
            "create it first"
        ) from error
    except Exception as error:  # each file system raises its own classes of errors
        raise kind(f"{printable(url)}: {_message(url, error, action)}") from error


def _message(url: str, error: Exception, action: str) -> str:
    """Describe the cause of a file system's error and its remedy."""
    protocol = url.partition("://")[0] if "://" in url else ""
    if isinstance(error, ImportError):
        package = _PACKAGES.get(protocol)
        if package is None:
            return f"needs a package that is not installed ({reason_of(error)})"
        return f'needs the package {package}: pip install "grasp3d[s3]"'
    if isinstance(error, ValueError) and "rotocol not known" in str(error):
        return f"no file system is called {protocol}://; s3:// and those of fsspec are known"
    return f"cannot be {action} ({_reason(protocol, error)})"


def _reason(protocol: str, error: Exception) -> str:
    if type(error).__name__ in _NO_CREDENTIALS:
        return (
            "there are no credentials: set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or "
            "AWS_PROFILE; for a public bucket FSSPEC_S3_ANON=true"
        )
    if protocol and isinstance(error, PermissionError):
        return f"access is denied: check the credentials and their rights; {reason_of(error)}"
    if isinstance(error, NotADirectoryError):
        return "its folder is a file; name another folder"
    if isinstance(error, OSError) and error.errno == errno.ENOSPC:
        return "no space left on this machine; TMPDIR names another folder"
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return reason_of(error)


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
        infos: Mapping[str, Any] = system.find(root, maxdepth=depth, detail=True)
    head = root.rstrip("/") + "/" if root.strip("/") else root
    return [
        _entry(path[len(head) :], f"{source.rstrip('/')}/{path[len(head) :]}", info)
        for path, info in infos.items()
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
        items = list(os.scandir(folder))
    except PermissionError:
        if not relative:
            raise
        return
    for item in items:
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


@contextmanager
def local_copy(source: str) -> Iterator[Path]:
    """Yield a local path of a mesh file; the copy of a remote file is deleted at the end.

    The copy has the name of the source. The side files of a glTF in its folder or below are copied
    too. In the message of a `GraspError` that is raised inside the context, the path of the copy
    is replaced by the source.

    Args:
        source: Path or address of the file.

    Raises:
        MeshError: It is missing, or cannot be downloaded.
    """
    local = local_path(source)
    if local is not None:
        yield local
        return
    with tempfile.TemporaryDirectory(prefix="grasp3d-", ignore_cleanup_errors=True) as folder:
        name = Path(source.rpartition("/")[2])
        copy = Path(folder, f"{safe_stem(name.stem)}{name.suffix}")
        try:
            _download(source, copy)
        except FileNotFoundError as error:
            raise MeshError(f"{printable(source)}: there is no such file") from error
        _download_side_files(source, copy)
        try:
            yield copy
        except GraspError as error:
            message = str(error).replace(str(copy), printable(source))
            raise type(error)(message) from error


def read_text(source: str) -> str:
    """Read a text file; undecodable bytes are kept as surrogates, as in file names.

    Raises:
        MeshError: It cannot be read.
    """
    return read_bytes(source, MeshError).decode("utf-8-sig", "surrogateescape")


def read_bytes(source: str, kind: type[GraspError]) -> bytes:
    """Read a file.

    Args:
        source: Path or address.
        kind: Class of the error where it cannot be read.

    Raises:
        FileNotFoundError: There is no such file.
    """
    with convert_errors(source, kind, "read"):
        local = local_path(source)
        if local is not None:
            return local.read_bytes()
        system, path = file_system_of(source)
        return bytes(system.cat_file(path))


def _download(source: str, target: Path) -> None:
    with convert_errors(source, FileUnreadError, "downloaded"):
        system, path = file_system_of(source)
        target.parent.mkdir(parents=True, exist_ok=True)
        system.get_file(path, str(target))


def _download_side_files(source: str, copy: Path) -> None:
    """Download the side files of a glTF; missing files are reported when the glTF is read."""
    with convert_errors(source, FileUnreadError, "downloaded"):
        names = side_names(copy)
    for name in names:
        target = copy.parent / name
        if target != copy and target.resolve().is_relative_to(copy.parent.resolve()):
            with suppress(FileNotFoundError):
                _download(f"{source.rpartition('/')[0]}/{name}", target)
