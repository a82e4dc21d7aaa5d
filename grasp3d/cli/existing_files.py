"""Files that are there already at the paths of outputs: none is replaced without `--overwrite`."""

from collections.abc import Iterable
from contextlib import suppress
from pathlib import Path

from grasp3d.errors import OutputError
from grasp3d.quality.loads import Load
from grasp3d.system.files import check_suffix, check_writable


def check_output(
    path: Path | None,
    suffixes: Iterable[str] = (),
    what: str = "",
    *,
    overwrite: bool,
    sources: Iterable[Path | None] = (),
) -> None:
    """Check before a long computation that an output has a known format and can be written.

    Args:
        path: File to create or replace; None: nothing is written.
        suffixes: Of the formats, in lower case; none: they are checked elsewhere.
        what: What the file contains, for the error: a table, a figure.
        overwrite: Whether any existing file may be replaced.
        sources: Files that it must not replace; None: no local file.

    Raises:
        OutputError: The suffix is not known, it cannot be written, or a file is there already.
    """
    if path is None:
        return
    if suffixes:
        check_suffix(path, suffixes, what)
    for source in (None, *sources):
        check_writable(path, source=source)
    if path.exists() and not overwrite:
        raise OutputError(f"{path}: exists; name another file, or replace it with --overwrite")


def check_not_source(path: Path, source: Path, what: str) -> None:
    """Check that an output does not replace a file that is read.

    Args:
        path: File to create or replace.
        source: The file that is read.
        what: What it holds, for the error: poses, contacts.

    Raises:
        OutputError: It is that file.
    """
    with suppress(OSError):  # a file does not exist
        if path.samefile(source):
            raise OutputError(f"{path}: is the file of {what}; name another file with -o")


def check_not_task(path: Path, load: Load) -> None:
    """Check that an output does not replace a file of the task.

    Args:
        path: File to create or replace.
        load: As the options give it, with the names of the task's files.

    Raises:
        OutputError: It is a file of the task.
    """
    for file in load.task.files:
        check_not_source(path, file, "the task")
