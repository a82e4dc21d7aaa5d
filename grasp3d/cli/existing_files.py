"""Files that are there already at the paths of outputs: none is replaced without `--overwrite`."""

from collections.abc import Iterable
from pathlib import Path

from grasp3d.errors import OutputError
from grasp3d.system.files import check_suffix, check_writable
from grasp3d.system.limited_reading import files_read


def check_output(
    path: Path | None,
    suffixes: Iterable[str] = (),
    what: str = "",
    *,
    overwrite: bool,
    inputs: Iterable[Path | None] = (),
) -> None:
    """Check before a long computation that an output has a known format and can be written.

    Args:
        path: File to create or replace; None: nothing is written.
        suffixes: Of the formats, in lower case; none: they are checked elsewhere.
        what: What the file contains, for the error: a table, a figure.
        overwrite: Whether any existing file may be replaced.
        inputs: Files that the command is going to read, which it must not replace, nor those that
            it has read; None: no local file.

    Raises:
        OutputError: The suffix is not known, it cannot be written, or a file is there already.
    """
    if path is None:
        return
    if suffixes:
        check_suffix(path, suffixes, what)
    check_writable(path)
    if not path.exists():
        return
    every = filter(None, (*inputs, *files_read()))
    if any(one.exists() and path.samefile(one) for one in every):
        raise OutputError(f"{path}: is read by this command; name another file")
    if not overwrite:
        raise OutputError(f"{path}: exists; name another file, or replace it with --overwrite")
