"""Atomic writing of files, and checks of output paths."""

from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from secrets import token_hex

from grasp3d.errors import OutputError
from grasp3d.system.names import unsupported

TEMPORARY_PREFIX = ".grasp3d-"
"""Start of the names of temporary files, which hold incomplete output."""

_PART = ".part"
"""End of the names of temporary files, before the suffix."""


@contextmanager
def atomic_write(
    path: Path, *, keep: bool = True, temporary_folder: Path | None = None
) -> Iterator[Path]:
    """Yield a temporary path to write to; it replaces `path` if no error occurred.

    If `path` is itself such a temporary path, it is yielded and written directly.

    Args:
        path: File to create or replace.
        keep: Whether the temporary file replaces `path` at the end; otherwise it is deleted.
        temporary_folder: Folder of the temporary file, on the same file system; None: that of
            `path`.

    Raises:
        OutputError: The folder is missing or cannot be written to.
    """
    temporary = _temporary(path, temporary_folder)
    replaced = temporary == path
    try:
        yield temporary
        if keep and not replaced:
            temporary.replace(path)
            replaced = True
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror or error})") from error
    finally:
        if not replaced:
            temporary.unlink(missing_ok=True)


def _temporary(path: Path, folder: Path | None) -> Path:
    """Create a temporary file beside a path or in a folder; return a temporary path as it is."""
    if path.name.startswith(TEMPORARY_PREFIX) and path.stem.endswith(_PART):
        return path
    name = f"{TEMPORARY_PREFIX}{token_hex(8)}{_PART}{path.suffix}"
    temporary = (folder or path.parent) / name
    try:
        if path.is_dir():
            raise OutputError(f"{path}: is a folder; name a file")
        temporary.touch(exist_ok=False)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written ({error.strerror})") from error
    return temporary


def check_writable(path: Path) -> None:
    """Check before a long computation that its output file can be created or replaced.

    Raises:
        OutputError: It cannot be written.
    """
    with atomic_write(path, keep=False):
        pass


def check_suffix(path: Path, formats: Iterable[str], what: str) -> None:
    """Check before a long computation that the suffix of its output file is a known format.

    Args:
        path: File to create.
        formats: Suffixes, in lower case.
        what: What the file contains, for the error: a table, a figure.

    Raises:
        OutputError: The suffix is not known.
    """
    suffixes = tuple(formats)
    if path.suffix.lower() not in suffixes:
        raise OutputError(unsupported(path, suffixes, what))
