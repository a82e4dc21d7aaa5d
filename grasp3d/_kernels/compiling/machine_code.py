"""The folder of the kernels' machine code."""

import atexit
import hashlib
import os
import shutil
import tempfile
import time
from collections.abc import Iterable, Iterator
from contextlib import suppress
from functools import cache
from pathlib import Path
from typing import Any

import numba

_config: Any = numba.config
_HERE = Path(__file__).parents[1]

FOLDER_PREFIX = "grasp3d-kernels-"
"""Start of the names of the machine-code folders; the fingerprint of the sources follows."""

MAX_AGE = 30 * 24 * 3600.0
"""Age at which the machine code of other versions of the sources is removed [s]."""


def fingerprint(folder: Path) -> str:
    """Digest of every source file in a folder and below it."""
    digest = hashlib.sha256()
    for source in sorted(folder.rglob("*.py")):
        name = source.relative_to(folder).as_posix()
        digest.update(name.encode() + b"\0" + source.read_bytes())
    return digest.hexdigest()[:16]


@cache
def cache_folder() -> Path | None:
    """Folder for compiled kernels, one per version of the sources; None: none can be written.

    NUMBA_CACHE_DIR is preferred where it is set, then the user's cache, then the package's folder.
    All copies of the same sources use it. Machine code in a folder that cannot be written, as in
    a container whose user did not compile it, or in the package's folder, as an installation may
    bring it, is copied to one that can. Where only reading is possible, that is one which this
    process removes when it ends.
    """
    name, read_only = f"{FOLDER_PREFIX}{fingerprint(_HERE)}", []
    *_, brought = folders = [root / name for root in _possible_roots()]
    for folder in folders:
        try:
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
        except OSError:
            read_only.append(folder)
            continue
        _remove_old_folders(folder)
        _copy_machine_code([*read_only, *([brought] if brought != folder else [])], folder)
        return folder
    return _temporary_copy(read_only)


def _possible_roots() -> Iterator[Path]:
    """Folders to try, in order of preference; the last one is the package's."""
    if _config.CACHE_DIR:
        yield Path(_config.CACHE_DIR)
    home = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))  # noqa: PTH111
    if home.is_absolute():  # without a home directory expanduser leaves the "~"
        yield home / "grasp3d"
    yield _HERE / "__pycache__"


def _temporary_copy(sources: Iterable[Path]) -> Path | None:
    """Copy machine code to a folder of this process; None: there is none, or no such folder."""
    with suppress(OSError):
        sources = [source for source in sources if source.is_dir() and any(source.iterdir())]
        if sources:
            # Nobody else may put machine code there; it is removed when the interpreter ends.
            temporary = tempfile.TemporaryDirectory(prefix=FOLDER_PREFIX)
            atexit.register(temporary.cleanup)
            folder = Path(temporary.name, sources[0].name)
            folder.mkdir()
            _copy_machine_code(sources, folder)
            return folder
    return None


def _remove_old_folders(folder: Path) -> None:
    """Remove machine code of other versions of the sources that is old enough to be unused."""
    for other in folder.parent.glob(f"{FOLDER_PREFIX}*"):
        with suppress(OSError):  # another process may be removing it
            if other != folder and time.time() - other.stat().st_mtime > MAX_AGE:
                shutil.rmtree(other)


def _copy_machine_code(sources: Iterable[Path], folder: Path) -> None:
    """Copy the files of the first of some folders that has any, if the folder has none."""
    for source in sources:
        with suppress(OSError, shutil.Error):
            if not any(folder.iterdir()) and any(source.iterdir()):
                shutil.copytree(source, folder, dirs_exist_ok=True)
