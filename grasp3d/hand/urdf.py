"""Links and joints of a robot in a URDF file."""

import logging
from collections.abc import Mapping
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
import trimesh

from grasp3d.arrays import Floats
from grasp3d.errors import MeshError, SettingError
from grasp3d.hand.link_tree import Joint, LinkTree, check_xml
from grasp3d.reading.mesh_files import read_mesh
from grasp3d.system.names import printable

if TYPE_CHECKING:
    from yourdfpy import URDF

_KINDS: dict[str, Literal["fixed", "slides", "turns"]] = {"fixed": "fixed", "prismatic": "slides"}
"""Kinds of joints; all others turn, or do both."""

_BAD = (ValueError, TypeError, AttributeError, KeyError, IndexError)
"""What the parser raises for elements and numbers that are missing or wrong."""


def read_urdf(path: Path) -> LinkTree:
    """Read the links and joints of a URDF.

    Args:
        path: The file. Its collision meshes are read as well; `package://NAME/...` is looked for in
            a folder NAME that contains the file, or is beside such a folder.

    Raises:
        SettingError: It is no URDF. A mesh that is missing or damaged is refused when the geometry
            of its link is asked for.
    """
    check_xml(path)
    robot = _parsed(path).robot
    where = str(path)
    links = {link.name: link for link in robot.links}
    joints: dict[str, Joint] = {}
    for joint in robot.joints:
        if joint.child in joints or joint.parent not in links or joint.child not in links:
            raise SettingError(
                printable(f"{where}: joint {joint.name} joins no two links of its own")
            )
        joints[joint.child] = _joint(joint)

    def geometry(name: str) -> Floats:
        parts = [_triangles(part, name, path) for part in links[name].collisions]
        return np.concatenate([np.zeros((0, 3, 3)), *parts])

    order = _from_root(list(links), joints)
    return LinkTree(where, order, joints, geometry)


def _parsed(path: Path) -> "URDF":
    try:
        from yourdfpy import URDF
    except ImportError as error:
        raise SettingError(
            "reading a URDF needs yourdfpy; install it with: pip install 'grasp3d[grippers]'"
        ) from error
    # It reports prefixes that are not declared, and reads the file nevertheless.
    logging.getLogger("yourdfpy.urdf").setLevel(logging.CRITICAL)
    try:
        return URDF.load(
            str(path),
            build_scene_graph=False,
            build_collision_scene_graph=False,
            load_meshes=False,
            load_collision_meshes=False,
        )
    except _BAD as error:
        raise SettingError(printable(f"{path}: is no URDF ({error})")) from error


def _from_root(links: list[str], joints: Mapping[str, Joint]) -> tuple[str, ...]:
    """Links in an order in which parents come before their children."""

    def depth(name: str) -> int:
        count = 0
        while name in joints and count <= len(links):  # a cycle has no root
            name, count = joints[name].parent, count + 1
        return count

    return tuple(sorted(links, key=depth))


def _joint(joint: Any) -> Joint:
    limit, mimic = joint.limit, joint.mimic
    has_limits = limit is not None and limit.lower is not None and limit.upper is not None
    axis = np.array([1.0, 0.0, 0.0]) if joint.axis is None else np.asarray(joint.axis, np.float64)
    length = float(np.linalg.norm(axis))
    return Joint(
        joint.name,
        _KINDS.get(joint.type, "turns"),
        joint.parent,
        np.eye(4) if joint.origin is None else np.asarray(joint.origin, np.float64),
        axis / length if length > 0.0 else np.array([1.0, 0.0, 0.0]),
        (float(limit.lower), float(limit.upper)) if has_limits else None,
        None if mimic is None else (mimic.joint, float(mimic.multiplier), float(mimic.offset)),
    )


def _triangles(collision: Any, link: str, path: Path) -> Floats:
    """Corners of one piece of collision geometry in the frame of its link, shape (n, 3, 3)."""
    shape = collision.geometry
    if shape.box is not None:
        faces = trimesh.creation.box(shape.box.size).triangles
    elif shape.cylinder is not None:
        faces = trimesh.creation.cylinder(shape.cylinder.radius, shape.cylinder.length).triangles
    elif shape.sphere is not None:
        faces = trimesh.creation.icosphere(radius=shape.sphere.radius).triangles
    elif shape.mesh is not None:
        raw = read_collision_mesh(shape.mesh.filename, link, path)
        faces = raw * (1.0 if shape.mesh.scale is None else np.asarray(shape.mesh.scale))
    else:
        raise SettingError(printable(f"{path}: collision geometry of {link} is of no known kind"))
    pose = np.eye(4) if collision.origin is None else collision.origin
    return np.asarray(faces @ pose[:3, :3].T + pose[:3, 3])


def read_collision_mesh(name: str, link: str, path: Path) -> Floats:
    """Read a mesh that a URDF names, as the corners of its triangles, shape (n, 3, 3).

    Raises:
        SettingError: There is no such file, or it is no mesh.
    """
    scheme, _, rest = name.rpartition("://")
    folders = path.absolute().parents
    if scheme in {"package", "model"}:
        package, _, inside = rest.partition("/")
        candidates = [folder / package / inside for folder in folders]
        candidates += [folder / inside for folder in folders if folder.name == package]
    else:
        candidates = [path.absolute().parent / rest]  # an absolute path stays what it is
    file = next(filter(Path.is_file, candidates), None)
    if file is None:
        raise SettingError(
            printable(f"{path}: there is no mesh {name} of link {link}; put it where the file says")
        )
    try:
        raw = read_mesh(file)
    except MeshError as error:
        raise SettingError(printable(f"{path}: mesh of link {link}: {error}")) from error
    return raw.vertices[raw.faces]
