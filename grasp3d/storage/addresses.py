"""File systems of paths and addresses, and conversion of their errors.

fsspec is imported with the first address.
"""

import errno
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any
from urllib.parse import unquote, urlsplit

from grasp3d.errors import GraspError
from grasp3d.system.names import printable

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
            return f"needs a package that is not installed ({_line(error)})"
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
        return f"access is denied: check the credentials and their rights; {_line(error)}"
    if isinstance(error, NotADirectoryError):
        return "its folder is a file; name another folder"
    if isinstance(error, OSError) and error.errno == errno.ENOSPC:
        return "no space left on this machine; TMPDIR names another folder"
    if isinstance(error, OSError) and error.strerror:
        return error.strerror
    return _line(error) or type(error).__name__


def _line(error: Exception) -> str:
    """Return the message of an error as one line."""
    return " ".join(str(error).split())[:200]
