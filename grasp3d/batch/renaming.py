"""What meshes are called that a store knows already, under this name or another one."""

import os
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import replace

from grasp3d.batch.inputs import MeshFile
from grasp3d.batch.row import Row
from grasp3d.errors import MeshError
from grasp3d.storage import local_path, look
from grasp3d.system.names import as_unicode


def known_names(meshes: Sequence[MeshFile], rows: Mapping[str, Row]) -> list[MeshFile]:
    """Call meshes as their rows do, so that no file has two rows, and no two files one.

    A mesh is called after the folder that was given, and that may be another one this time. One
    whose file has a row keeps the row's name; one whose name belongs to a file elsewhere, which is
    still there, is called by its source.

    Args:
        meshes: From `find_meshes`.
        rows: Of the store, by name.
    """
    name_at = {_place(row.source): name for name, row in rows.items()}
    named = [replace(mesh, name=_name(mesh, rows, name_at)) for mesh in meshes]
    often = Counter(mesh.name for mesh in named)
    return [
        mesh if often[mesh.name] == 1 else replace(mesh, name=as_unicode(mesh.source))
        for mesh in named
    ]


def _name(mesh: MeshFile, rows: Mapping[str, Row], name_at: Mapping[str, str]) -> str:
    place = _place(mesh.source)
    if place in name_at:
        return name_at[place]
    if mesh.name in rows and _is_there(rows[mesh.name].source):
        return as_unicode(mesh.source)
    return mesh.name


def _place(source: str) -> str:
    path = local_path(source)
    return source if path is None else os.path.abspath(path)  # noqa: PTH100, links stay


def _is_there(source: str) -> bool:
    try:
        look(source)
    except (FileNotFoundError, MeshError):
        return False
    return True
