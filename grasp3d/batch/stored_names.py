"""Names of meshes that a store already has rows for, under the same or another name."""

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

from grasp3d.batch.inputs import MeshFile
from grasp3d.batch.row import Row
from grasp3d.batch.storage import find_entry, local_path
from grasp3d.errors import MeshError
from grasp3d.system.names import as_unicode


def use_stored_names(meshes: Sequence[MeshFile], rows: Mapping[str, Row]) -> list[MeshFile]:
    """Name meshes as in their rows, so that no file has two rows and no row two files.

    The name of a mesh depends on the input folder, which may differ from run to run. A mesh whose
    file has a row keeps the row's name. A mesh whose name belongs to another file that still
    exists is named by its source.

    Args:
        meshes: From `find_meshes`.
        rows: Rows of the store, by name.
    """
    name_at = {_location(row.source): name for name, row in rows.items()}
    named = [replace(mesh, name=_name(mesh, rows, name_at)) for mesh in meshes]
    counts = Counter(mesh.name for mesh in named)
    return [
        mesh if counts[mesh.name] == 1 else replace(mesh, name=as_unicode(mesh.source))
        for mesh in named
    ]


def _name(mesh: MeshFile, rows: Mapping[str, Row], name_at: Mapping[str, str]) -> str:
    location = _location(mesh.source)
    if location in name_at:
        return name_at[location]
    if mesh.name in rows and _exists(rows[mesh.name].source):
        return as_unicode(mesh.source)
    return mesh.name


def _location(source: str) -> str:
    path = local_path(source)
    return source if path is None else os.path.abspath(path)  # noqa: PTH100, links stay


def _exists(source: str) -> bool:
    try:
        find_entry(source)
    except (FileNotFoundError, MeshError):
        return False
    return True
