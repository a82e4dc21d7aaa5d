"""Temporary local copies of remote mesh files."""

import tempfile
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from grasp3d.errors import GraspError, MeshError, MeshUnreadError
from grasp3d.reading.side_files import side_names
from grasp3d.storage.addresses import convert_errors, file_system_of, local_path
from grasp3d.system.names import printable, safe_stem


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
    with convert_errors(source, MeshError, "read"):
        local = local_path(source)
        if local is not None:
            data = local.read_bytes()
        else:
            system, path = file_system_of(source)
            data = bytes(system.cat_file(path))
    return data.decode("utf-8-sig", "surrogateescape")


def _download(source: str, target: Path) -> None:
    with convert_errors(source, MeshUnreadError, "downloaded"):
        system, path = file_system_of(source)
        target.parent.mkdir(parents=True, exist_ok=True)
        system.get_file(path, str(target))


def _download_side_files(source: str, copy: Path) -> None:
    """Download the side files of a glTF; missing files are reported when the glTF is read."""
    with convert_errors(source, MeshUnreadError, "downloaded"):
        names = side_names(copy)
    for name in names:
        target = copy.parent / name
        if target != copy and target.resolve().is_relative_to(copy.parent.resolve()):
            with suppress(FileNotFoundError):
                _download(f"{source.rpartition('/')[0]}/{name}", target)
