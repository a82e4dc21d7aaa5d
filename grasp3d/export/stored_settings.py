"""Settings in labelled files: what an existing file was made with."""

import json
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.export.ply import comments_of
from grasp3d.reading.sources import LONGEST_HEADER
from grasp3d.surface.label_settings import SETTING
from grasp3d.system.tables import read_settings

FORMAT_KEYS = frozenset({"format", "version", "unit"})
"""Keys of a gripper in JSON that describe the format."""

_GLB_HEAD = struct.Struct("<4sIIII")


def stored_settings(path: Path) -> dict[str, str] | None:
    """Read the settings in a labelled file, or in a file of grasps.

    Args:
        path: An existing file, of any format and content.

    Returns:
        The values by name, as text; None: it was not written by grasp3d, or is damaged.
    """
    read = _READERS.get(path.suffix.lower())
    try:
        found = None if read is None else read(path)
    except (OSError, ValueError, KeyError, TypeError, struct.error, zipfile.BadZipFile):
        return None
    return {str(name): str(value) for name, value in found.items()} if found else None


def _from_ply(path: Path) -> dict[str, str]:
    with path.open("rb") as stream:
        header = stream.read(LONGEST_HEADER).partition(b"end_header")[0]
    return comments_of(header)


def _from_npz(path: Path) -> dict[str, str]:
    with path.open("rb") as stream, np.load(stream) as arrays:
        names = [name for name in arrays.files if name.startswith(SETTING)]
        return {name.removeprefix(SETTING): str(arrays[name]) for name in names}


def _from_glb(path: Path) -> dict[str, Any]:
    with path.open("rb") as stream:
        length = _GLB_HEAD.unpack(stream.read(_GLB_HEAD.size))[3]
        tree = json.loads(stream.read(length))
    return dict(tree["asset"]["extras"]["grasp3d"])


def _from_json(path: Path) -> dict[str, Any]:
    """Settings in the first line of a file of grasps."""
    with path.open(encoding="utf-8") as stream:
        found = dict(json.loads(stream.readline().rstrip().removesuffix(",") + "}")["grasp3d"])
    if isinstance(found.get("gripper"), dict):  # as in other labelled files
        kept = {k: v for k, v in found["gripper"].items() if k not in FORMAT_KEYS}
        found["gripper"] = json.dumps(kept)
    return found


def _from_vtp(path: Path) -> dict[str, str]:
    import pyvista

    with path.open("rb") as stream:
        if b"VTKFile" not in stream.read(LONGEST_HEADER):  # VTK prints its errors
            return {}
    fields = pyvista.read(path).field_data
    names = [name for name in fields.keys() if name.startswith(SETTING)]  # noqa: SIM118
    return {name.removeprefix(SETTING): str(fields[name][0]) for name in names}


_READERS: dict[str, Callable[[Path], dict[str, Any] | None]] = {
    ".ply": _from_ply,
    ".npz": _from_npz,
    ".glb": _from_glb,
    ".vtp": _from_vtp,
    ".parquet": read_settings,
    ".json": _from_json,
}
