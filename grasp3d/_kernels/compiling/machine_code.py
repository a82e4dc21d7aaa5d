"""The folders of the kernels' machine code."""

import hashlib
import os
import shutil
import tempfile
import time
from collections.abc import Iterator
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
def code_folders() -> tuple[Path, ...]:
    """Folders for machine code of these sources, in the order in which they are read and written.

    The package's own comes first, to which an installation brings machine code; then that which
    NUMBA_CACHE_DIR names, and the user's cache.
    """
    name = f"{FOLDER_PREFIX}{fingerprint(_HERE)}"
    return tuple(root / name for root in _possible_roots())


def _possible_roots() -> Iterator[Path]:
    yield _HERE / "__pycache__"
    if _config.CACHE_DIR:
        yield Path(_config.CACHE_DIR)
    home = Path(os.environ.get("XDG_CACHE_HOME") or os.path.expanduser("~/.cache"))  # noqa: PTH111
    if home.is_absolute():  # without a home directory expanduser leaves the "~"
        yield home / "grasp3d"


def can_be_stored() -> bool:
    """Whether machine code that is compiled now can be written to one of the folders."""
    for folder in code_folders():
        with suppress(OSError):
            make_folder(folder)
            tempfile.TemporaryFile(dir=folder).close()
            return True
    return False


def make_folder(folder: Path) -> None:
    """Make a folder for machine code, in place of those of other versions that are old."""
    folder.mkdir(parents=True, exist_ok=True)
    for other in folder.parent.glob(f"{FOLDER_PREFIX}*"):
        with suppress(OSError):  # another process may be removing it
            if other != folder and time.time() - other.stat().st_mtime > MAX_AGE:
                shutil.rmtree(other)
