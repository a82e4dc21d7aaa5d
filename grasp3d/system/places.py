"""Paths and addresses (s3://...) of files: parsing, error messages, and atomic writes."""

import errno
import tempfile
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from upath import UPath

from grasp3d.errors import GraspError, MeshError, OutputError
from grasp3d.system.files import atomic_write
from grasp3d.system.names import printable, reason_of

_NO_CREDENTIALS = ("NoCredentialsError", "PartialCredentialsError", "ProfileNotFound")


def place(text: str, kind: type[GraspError] = MeshError) -> UPath:
    """Parse a path or an address; a file:// address becomes a path.

    Raises:
        GraspError: Of class `kind`: the file system is unknown, or its package is not installed.
    """
    with converted(text, kind, "opened"):
        found = UPath(text)
        if found.protocol in {"file", "local"}:
            return UPath(found.path)
        found.fs.invalidate_cache()  # so that new files are listed as well
        return found


def local_path(text: str) -> Path | None:
    """Local path of a path or an address; None: it is not on this machine."""
    where = place(text)
    return where if isinstance(where, Path) else None


@contextmanager
def converted(where: object, kind: type[GraspError], action: str) -> Iterator[None]:
    """Convert errors of any file system to an error of this package.

    Args:
        where: Path or address, for the message.
        kind: Class of the error to raise.
        action: Past participle of the action, for the message: read, written.
    """
    try:
        yield
    except GraspError:
        raise
    except Exception as error:  # each file system raises its own classes of errors
        raise kind(f"{printable(str(where))}: {_message(str(where), error, action)}") from error


def _message(where: str, error: Exception, action: str) -> str:
    """Describe the cause of a file system's error and its remedy."""
    protocol = where.partition("://")[0] if "://" in where else ""
    if isinstance(error, ImportError) and protocol in {"s3", "s3a"}:
        return 'needs the package s3fs: pip install "grasp3d[s3]"'
    if isinstance(error, ImportError):
        return f"needs a package that is not installed ({reason_of(error)})"
    if isinstance(error, ValueError) and "Unsupported filesystem" in str(error):
        return f"no file system is called {protocol}://; s3:// and those of fsspec are known"
    if isinstance(error, FileNotFoundError):
        return "there is no such file, bucket or folder"
    reason = reason_of(error)
    if type(error).__name__ in _NO_CREDENTIALS:
        reason = (
            "there are no credentials: set AWS_ACCESS_KEY_ID and AWS_SECRET_ACCESS_KEY, or "
            "AWS_PROFILE; for a public bucket FSSPEC_S3_ANON=true"
        )
    elif protocol and isinstance(error, PermissionError):
        reason = f"access is denied: check the credentials and their rights; {reason}"
    elif isinstance(error, NotADirectoryError | FileExistsError):
        reason = "its folder is a file; name another folder"
    elif isinstance(error, OSError) and error.errno == errno.ENOSPC:
        reason = "no space left; free some, or name another folder"
    elif isinstance(error, OSError) and error.strerror:
        reason = error.strerror
    return f"cannot be {action} ({reason})"


@contextmanager
def writing(target: UPath) -> Iterator[Path]:
    """Yield a local path; the file written to it becomes the target, whole or not at all.

    Raises:
        OutputError: It cannot be written.
    """
    with converted(target, OutputError, "written"):
        if isinstance(target, Path):
            target.parent.mkdir(parents=True, exist_ok=True)
            with atomic_write(target) as part:
                yield part
            return
        with tempfile.TemporaryDirectory(prefix="grasp3d-") as folder:
            part = Path(folder, target.name)
            yield part
            target.fs.put_file(str(part), target.path)
