"""Mesh files from any file system, as files of this machine for as long as they are needed."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from grasp3d.errors import GraspError, MeshError, MeshUnreadError
from grasp3d.reading.side_files import side_names
from grasp3d.storage.addresses import failures_told, local_path, system_of
from grasp3d.system.names import printable, safe_stem


@contextmanager
def local_copy(source: str) -> Iterator[Path]:
    """Give a mesh file as a file of this machine; a copy has its name and is removed afterwards.

    With a glTF come the files that it asks for in its own folder or below. Errors of the family
    that are raised meanwhile and name the copy name the source instead.

    Args:
        source: Path or address of the file.

    Raises:
        MeshError: It is missing, or cannot be fetched.
    """
    local = local_path(source)
    if local is not None:
        yield local
        return
    with tempfile.TemporaryDirectory(prefix="grasp3d-", ignore_cleanup_errors=True) as folder:
        name = Path(source.rpartition("/")[2])
        copy = Path(folder, f"{safe_stem(name.stem)}{name.suffix}")
        try:
            _fetch(source, copy)
        except FileNotFoundError as error:
            raise MeshError(f"{printable(source)}: there is no such file") from error
        _fetch_beside(source, copy)
        try:
            yield copy
        except GraspError as error:
            told = str(error).replace(str(copy), printable(source))
            raise type(error)(told) from error


def read_text(source: str) -> str:
    """Read a text file; bytes that are no Unicode stand for themselves, as in names of files.

    Raises:
        MeshError: It cannot be read.
    """
    with failures_told(source, MeshError, "read"):
        local = local_path(source)
        if local is not None:
            data = local.read_bytes()
        else:
            system, path = system_of(source)
            data = bytes(system.cat_file(path))
    return data.decode("utf-8-sig", "surrogateescape")


def _fetch(source: str, target: Path) -> None:
    with failures_told(source, MeshUnreadError, "fetched"):
        system, path = system_of(source)
        target.parent.mkdir(parents=True, exist_ok=True)
        system.get_file(path, str(target))


def _fetch_beside(source: str, copy: Path) -> None:
    """Fetch what a glTF asks for; whether something is missing is the reader's to say."""
    with failures_told(source, MeshUnreadError, "fetched"):
        names = side_names(copy)
    for name in names:
        target = copy.parent / name
        if target != copy and target.resolve().is_relative_to(copy.parent.resolve()):
            with suppress(FileNotFoundError):
                _fetch(f"{source.rpartition('/')[0]}/{name}", target)
