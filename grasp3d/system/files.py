"""Writing files whole or not at all."""

import os
import tempfile
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path

from grasp3d.errors import OutputError

PART = ".grasp3d-"
"""How names of files begin that are not written to their end."""


@contextmanager
def written_whole(path: Path, *, keep: bool = True, room: Path | None = None) -> Iterator[Path]:
    """Give a temporary path beside `path` to write to; it takes the name only when all went well.

    Args:
        path: The file to make or replace.
        keep: Whether it takes the name at all.
        room: Folder of the same file system for the temporary path, where it may not lie beside.

    Raises:
        OutputError: The folder is missing or cannot be written to.
    """
    try:
        if path.is_dir():
            raise OutputError(f"{path}: is a folder; name a file")
        handle, name = tempfile.mkstemp(
            dir=room or path.parent, prefix=PART, suffix=f".part{path.suffix}"
        )
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror})") from error
    os.close(handle)
    part = Path(name)
    try:
        yield part
        if keep:
            part.chmod(0o666 & ~_umask())
            part.replace(path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error
    finally:
        part.unlink(missing_ok=True)


def check_writable(path: Path, *, source: Path | None = None) -> None:
    """Tell before the work whether a file could be written after it.

    Args:
        path: The file to make or replace.
        source: A file that it must not replace.

    Raises:
        OutputError: It could not, or it is the source.
    """
    with written_whole(path, keep=False):
        if source is not None and path.exists() and path.samefile(source):
            raise OutputError(f"{path}: is the mesh itself; name another file")


def check_suffix(path: Path, known: Iterable[str], what: str) -> None:
    """Tell before the work whether a file's suffix names a format.

    Args:
        path: The file to make.
        known: Suffixes, in small letters.
        what: What the file would be: a table, a figure.

    Raises:
        OutputError: It names none.
    """
    suffixes = tuple(known)
    if path.suffix.lower() not in suffixes:
        raise OutputError(
            f"{path}: no {what} is called {path.suffix!r}; known: {' '.join(suffixes)}"
        )


def _umask() -> int:
    """The process's file mode mask, which can only be read by setting it."""
    mask = os.umask(0)
    os.umask(mask)
    return mask
