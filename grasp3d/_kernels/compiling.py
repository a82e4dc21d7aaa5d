"""Decorators that compile the kernels with Numba, and the folder of their machine code."""

import hashlib
import os
import shutil
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from functools import cache
from pathlib import Path
from typing import Any

import numba

_HERE = Path(__file__).parent

FOLDER_PREFIX = "grasp3d-kernels-"
"""Start of the names of the machine-code folders; the fingerprint of the sources follows."""

MAX_AGE = 30 * 24 * 3600.0
"""Age at which the machine code of other versions of the sources is removed [s]."""

_config: Any = numba.config
_decorating = threading.Lock()


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

    Numba's own cache detects a change only in a kernel's own file, so a caller would keep the old
    machine code of kernels in other files. NUMBA_CACHE_DIR is used where it is set; otherwise the
    package's folder, otherwise the user's cache.
    """
    for root in _possible_roots():
        folder = root / f"{FOLDER_PREFIX}{fingerprint(_HERE)}"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
        except OSError:
            continue
        _remove_old_folders(folder)
        return folder
    return None


def compiled_before() -> bool:
    """Whether machine code of the current kernel sources exists on disk."""
    folder = cache_folder()
    return folder is not None and any(folder.rglob("*.nbc"))


def _possible_roots() -> Iterator[Path]:
    """Folders to try, in order of preference."""
    if _config.CACHE_DIR:
        yield Path(_config.CACHE_DIR)
        return
    yield _HERE / "__pycache__"
    home = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))  # noqa: PTH111
    if home.is_absolute():  # without a home directory expanduser leaves the "~"
        yield home / "grasp3d"


def _remove_old_folders(folder: Path) -> None:
    """Remove machine code of other versions of the sources that is old enough to be unused."""
    for other in folder.parent.glob(f"{FOLDER_PREFIX}*"):
        with suppress(OSError):  # another process may be removing it
            if other != folder and time.time() - other.stat().st_mtime > MAX_AGE:
                shutil.rmtree(other)


@contextmanager
def _caching_in(folder: Path) -> Iterator[None]:
    """Set Numba's cache folder for functions that are decorated meanwhile."""
    with _decorating:
        before = _config.CACHE_DIR
        _config.CACHE_DIR = str(folder)
        try:
            yield
        finally:
            _config.CACHE_DIR = before


def _compiled(function: Callable[..., object], **flags: Any) -> Any:
    """Compile without the GIL and with IEEE semantics, so that a NaN reaches the caller."""
    return numba.njit(nogil=True, error_model="numpy", **flags)(function)


def _compiled_and_cached(function: Callable[..., object], **flags: Any) -> Any:
    folder = cache_folder()
    if folder is None:
        return _compiled(function, **flags)
    with _caching_in(folder):
        return _compiled(function, cache=True, **flags)


def kernel(function: Callable[..., object]) -> Any:
    """Compile with Numba and cache the machine code."""
    return _compiled_and_cached(function)


def scratch_kernel(function: Callable[..., object]) -> Any:
    """Compile a kernel that works in the arrays it is given and allocates nothing.

    Numba then rejects allocations and omits reference counting, which costs more time than a small
    support function itself.
    """
    return _compiled_and_cached(function, _nrt=False)


def inlined(function: Callable[..., object]) -> Any:
    """Inline a kernel into its callers: passing many arrays costs more than the work itself."""
    return _compiled(function, inline="always")


def merged(function: Callable[..., object]) -> Any:
    """Inline a part of a scratch kernel into the machine code of its callers (by LLVM)."""
    return _compiled(function, forceinline=True, _nrt=False)
