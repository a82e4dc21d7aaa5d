"""The decorators of the compiled loops, and where what they compile is kept."""

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

KERNELS = "grasp3d-kernels-"
"""How the folders of machine code are called, before the fingerprint."""

OLD = 30 * 24 * 3600.0
"""Age at which another state's machine code is removed [s]."""

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
    """Folder for compiled kernels, one for each state of the sources; None: none can be written.

    Numba's own cache sees a change in a kernel's own file only, and would go on calling the old
    version of a kernel that stands in another. NUMBA_CACHE_DIR comes first where it is set, then
    the package, then the user's cache.
    """
    for root in _roots():
        folder = root / f"{KERNELS}{fingerprint(_HERE)}"
        try:
            folder.mkdir(parents=True, exist_ok=True)
            tempfile.TemporaryFile(dir=folder).close()
        except OSError:
            continue
        _forget_old(folder)
        return folder
    return None


def compiled_before() -> bool:
    """Tell whether kernels in their present state were compiled already, and kept."""
    folder = cache_folder()
    return folder is not None and any(folder.rglob("*.nbc"))


def _roots() -> Iterator[Path]:
    """Folders to try, the most fitting first."""
    if _config.CACHE_DIR:
        yield Path(_config.CACHE_DIR)
        return
    yield _HERE / "__pycache__"
    home = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))  # noqa: PTH111
    if home.is_absolute():  # the shell's sign for a home stays where there is none
        yield home / "grasp3d"


def _forget_old(folder: Path) -> None:
    """Remove what earlier states of the sources left, once nothing can be using it any more."""
    for other in folder.parent.glob(f"{KERNELS}*"):
        with suppress(OSError):  # another process may be removing it
            if other != folder and time.time() - other.stat().st_mtime > OLD:
                shutil.rmtree(other)


@contextmanager
def _caching_in(folder: Path) -> Iterator[None]:
    """Let functions decorated meanwhile keep their machine code in a folder."""
    with _decorating:
        before = _config.CACHE_DIR
        _config.CACHE_DIR = str(folder)
        try:
            yield
        finally:
            _config.CACHE_DIR = before


def _compiled(function: Callable[..., object], **flags: Any) -> Any:
    """Without the GIL, and with IEEE semantics, so that a NaN reaches the caller."""
    return numba.njit(nogil=True, error_model="numpy", **flags)(function)


def _kept(function: Callable[..., object], **flags: Any) -> Any:
    folder = cache_folder()
    if folder is None:
        return _compiled(function, **flags)
    with _caching_in(folder):
        return _compiled(function, cache=True, **flags)


def kernel(function: Callable[..., object]) -> Any:
    """Compile with Numba and keep the machine code."""
    return _kept(function)


def scratch_kernel(function: Callable[..., object]) -> Any:
    """Compile a kernel that works in the arrays it is given and allocates nothing.

    Numba refuses an allocation then, and spares the counting of references, which costs more than
    a small support function itself.
    """
    return _kept(function, _nrt=False)


def inlined(function: Callable[..., object]) -> Any:
    """Write a kernel out where it is called: handing over many arrays costs more than the work."""
    return _compiled(function, inline="always")


def merged(function: Callable[..., object]) -> Any:
    """Merge a step of a scratch kernel into the machine code of its callers."""
    return _compiled(function, forceinline=True, _nrt=False)
