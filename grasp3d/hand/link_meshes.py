"""Meshes that a URDF names."""

from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.errors import MeshError, SettingError
from grasp3d.mesh.reading.mesh_files import read_mesh
from grasp3d.system.documents import is_file
from grasp3d.system.names import printable, reason_of


def mesh_triangles(mesh: Element, link: str, path: Path) -> Floats:
    """Read a mesh that a URDF names, as the corners of its triangles [m], shape (n, 3, 3).

    Raises:
        SettingError: There is no such file, or it is no mesh.
    """
    name, scale = mesh.get("filename", ""), [float(word) for word in mesh.get("scale", "1").split()]
    file = mesh_file(name, path)
    if file is None:
        scheme, _, rest = name.rpartition("://")
        where = "put it where the file says"
        if scheme in {"package", "model"}:
            package = rest.partition("/")[0]
            where = f"put the folder {package}, which the file takes for a ROS package, beside it"
        raise SettingError(printable(f"{path}: there is no mesh {name} of link {link}; {where}"))
    try:
        if file.suffix.lower() == ".dae":
            return _collada(file) * scale
        raw = read_mesh(file)
    except MeshError as error:
        raise SettingError(printable(f"{path}: mesh of link {link}: {error}")) from error
    return np.asarray(raw.vertices[raw.faces] * scale)


def _collada(file: Path) -> Floats:
    """Triangles of a COLLADA file [m], shape (n, 3, 3). Raises MeshError."""
    from trimesh import load_scene
    from trimesh.units import unit_conversion

    try:
        scene = load_scene(file)
        return np.asarray(
            scene.to_mesh().triangles * unit_conversion(scene.units or "meters", "meters")
        )
    except Exception as error:  # of any class
        raise MeshError(f"{file}: cannot be read as COLLADA ({reason_of(error)})") from error


def mesh_file(name: str, path: Path) -> Path | None:
    """The mesh that a URDF names; None: there is none."""
    scheme, _, rest = name.rpartition("://")
    folders = path.absolute().parents
    if scheme in {"package", "model"}:
        package, _, inside = rest.partition("/")
        inside = inside.lstrip("/")  # some have two
        candidates = [folder / package / inside for folder in folders]
        candidates += [folder / inside for folder in folders if folder.name == package]
    else:
        candidates = [path.absolute().parent / rest]  # an absolute path stays what it is
    return next(filter(is_file, candidates), None)
