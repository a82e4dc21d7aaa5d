"""Identity of results: the content of a mesh, the settings, and the version of the method."""

import hashlib
import json
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any

from grasp3d.batch.batch_settings import BatchSettings
from grasp3d.errors import MeshError
from grasp3d.mesh.reading.scenes import side_names
from grasp3d.settings.parsing import plain, plain_values
from grasp3d.system.documents import problem_of_file
from grasp3d.system.names import printable

METHOD = 8
"""Version of the method; to be increased when labels or the row of the same mesh change."""


def content_hash(path: Path) -> str:
    """SHA-256 of a mesh file, and of the files with the data of a glTF.

    Args:
        path: Local file.

    Raises:
        MeshError: The file cannot be read.
    """
    try:
        digest = _digest(path)
        side_digests = [f"{name} {_side_digest(path, name)}" for name in side_names(path)]
    except OSError as error:
        reason = problem_of_file(path) or f"cannot be opened ({error.strerror})"
        raise MeshError(f"{printable(str(path))}: {reason}") from error
    if not side_digests:
        return digest
    return hashlib.sha256("\n".join([digest, *sorted(side_digests)]).encode()).hexdigest()


def mesh_key(content: str, settings: BatchSettings, own: Mapping[str, Any]) -> str:
    """SHA-256 of all that determines the results of a mesh; where it differs, label again.

    Args:
        content: From `content_hash`.
        settings: Settings of the labels of all meshes.
        own: Those of this mesh alone, as a table states them.
    """
    mine = json.dumps(_canonical({name: plain(one) for name, one in own.items()}), sort_keys=True)
    return hashlib.sha256(
        f"{content} {settings_key(settings)} {mine} {METHOD}".encode()
    ).hexdigest()


@lru_cache(maxsize=16)
def settings_key(settings: BatchSettings) -> str:
    """SHA-256 of settings, the same for equal settings."""
    return hashlib.sha256(settings_text(settings).encode()).hexdigest()


def settings_text(settings: BatchSettings) -> str:
    """Settings as canonical JSON: sorted, whole numbers without a decimal point, inf as null."""
    values = plain_values(settings)
    values["reach"]["gripper"] = values["reach"].pop("hand")  # the name that it has in files
    return json.dumps(_canonical(values), sort_keys=True, separators=(",", ":"), allow_nan=False)


def _canonical(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _canonical(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_canonical(item) for item in value]
    if isinstance(value, float):
        if value == float("inf"):
            return None
        return int(value) if value.is_integer() else value
    return value


def _digest(path: Path) -> str:
    with path.open("rb") as stream:
        return hashlib.file_digest(stream, "sha256").hexdigest()


def _side_digest(path: Path, name: str) -> str:
    """Digest of a side file; a file that is missing or outside the folder is not read."""
    folder = path.parent.resolve()
    side = (folder / name).resolve()
    return _digest(side) if side.is_relative_to(folder) and side.is_file() else "missing"
