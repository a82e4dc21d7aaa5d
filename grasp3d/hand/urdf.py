"""Links and joints of a robot in a URDF file."""

import math
from collections.abc import Iterable
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np
from trimesh import transformations

from grasp3d.arrays import Floats
from grasp3d.errors import MeshError, SettingError
from grasp3d.hand.description_xml import mesh_file, xml_tree
from grasp3d.hand.link_tree import Joint, JointKind, LinkMass, LinkShape, LinkTree, mesh_shape
from grasp3d.mesh.reading.mesh_files import read_mesh
from grasp3d.system.documents import number_of, numbers_of
from grasp3d.system.names import printable

_KINDS: dict[str, JointKind] = {
    "fixed": "fixed", "prismatic": "slides", "revolute": "turns", "continuous": "turns",
}  # fmt: skip
"""Kinds of joints; all others move in other ways."""

FAR = 1e4
"""Largest distance of a link or a shape from what it is fixed to [m]."""


def read_urdf(path: Path) -> LinkTree:
    """Read the links and joints of a URDF.

    Args:
        path: The file. Its collision meshes are read as well; `package://NAME/...` is looked for in
            a folder NAME that contains the file, or is beside such a folder.

    Raises:
        SettingError: It is no URDF. A mesh that is missing or damaged is refused when the geometry
            of its link is asked for.
    """
    root = xml_tree(path)
    try:
        links = _links(root)
        joints = _joints(root, links)
    except ValueError as error:
        raise SettingError(printable(f"{path}: is no URDF: {error}")) from error

    def shapes(name: str) -> tuple[LinkShape, ...]:
        try:
            return tuple(_shape(part, name, path) for part in links[name].findall("collision"))
        except ValueError as error:
            raise SettingError(printable(f"{path}: link {name}: {error}")) from error

    masses = {name: mass for name, link in links.items() if (mass := _mass(link)) is not None}
    return LinkTree(str(path), _from_root(links, joints), joints, shapes, masses=masses)


def _links(root: Element) -> dict[str, Element]:
    """Links by name. Raises ValueError."""
    if root.tag != "robot":
        raise ValueError(f"its first element is {root.tag[:40]}, and must be robot")
    links: dict[str, Element] = {}
    for link in root.findall("link"):
        name = _text(link, "name")
        if name in links:
            raise ValueError(f"two links are called {name}")
        links[name] = link
    return links


def _mass(link: Element) -> LinkMass | None:
    """What a link weighs; None: it is not stated, or impossible."""
    inertial = link.find("inertial")
    if inertial is None:
        return None
    try:
        mass = _number(_part(inertial, "mass"), "value")
        x, y, z = _pose(inertial)[:3, 3].tolist()
    except ValueError:
        return None
    return LinkMass(mass, (x, y, z)) if 0.0 < mass < math.inf else None


def _joints(root: Element, links: dict[str, Element]) -> dict[str, Joint]:
    """Joints by the links that they move. Raises ValueError."""
    joints: dict[str, Joint] = {}
    for element in root.findall("joint"):
        parent, child = (_text(_part(element, end), "link") for end in ("parent", "child"))
        name = _text(element, "name")
        if child in joints or parent not in links or child not in links:
            raise ValueError(f"joint {name} joins no two links of its own")
        try:
            joints[child] = _joint(element, name, parent)
        except ValueError as error:
            raise ValueError(f"joint {name}: {error}") from error
    return joints


def _from_root(links: Iterable[str], joints: dict[str, Joint]) -> tuple[str, ...]:
    """Links in an order in which parents come before their children, where there is one."""
    above = {name: [joints[name].parent] if name in joints else [] for name in links}
    try:
        return tuple(TopologicalSorter(above).static_order())
    except CycleError:
        return tuple(links)


def _joint(element: Element, name: str, parent: str) -> Joint:
    axis, limit, mimic = (element.find(part) for part in ("axis", "limit", "mimic"))
    direction = np.array([1.0, 0.0, 0.0] if axis is None else _numbers(axis, "xyz", 3))
    length = float(np.linalg.norm(direction))
    limits = follows = effort = None
    kind = element.get("type", "")
    if kind == "continuous":
        limits = -math.inf, math.inf
    elif limit is not None and {"lower", "upper"} <= {*limit.keys()}:
        limits = _number(limit, "lower"), _number(limit, "upper")
    if limit is not None and math.isfinite(stated := number_of(limit.get("effort", "nan"))):
        effort = stated
    if mimic is not None:
        factor, offset = _number(mimic, "multiplier", "1"), _number(mimic, "offset", "0")
        follows = _text(mimic, "joint"), factor, offset
    return Joint(
        name,
        _KINDS.get(kind, "free"),
        parent,
        _pose(element),
        direction / length if length > 0.0 else np.array([1.0, 0.0, 0.0]),
        limits,
        follows,
        effort=effort,
    )


def _shape(collision: Element, link: str, path: Path) -> LinkShape:
    """One piece of collision geometry. Raises SettingError, ValueError."""
    geometry, pose = _part(collision, "geometry"), _pose(collision)
    shape = next(iter(geometry), geometry)
    if shape.tag == "box":
        x, y, z = (0.5 * length for length in _lengths(shape, "size", 3))
        return LinkShape("box", pose, (x, y, z))
    if shape.tag in {"cylinder", "capsule"}:
        (radius,), (length,) = _lengths(shape, "radius", 1), _lengths(shape, "length", 1)
        size = radius, 0.5 * length
        return LinkShape("cylinder" if shape.tag == "cylinder" else "capsule", pose, size)
    if shape.tag == "sphere":
        return LinkShape("sphere", pose, (*_lengths(shape, "radius", 1),))
    if shape.tag == "mesh":
        raw = read_collision_mesh(_text(shape, "filename"), link, path)
        scale = shape.get("scale", "1")
        faces = raw * numbers_of(scale, 1 if len(scale.split()) == 1 else 3)
        return mesh_shape(faces, pose)
    raise SettingError(printable(f"{path}: collision geometry of {link} is of no known kind"))


def _pose(element: Element) -> Floats:
    """The origin that an element states, shape (4, 4); without one the identity."""
    origin = element.find("origin")
    if origin is None:
        return np.eye(4)
    angles = _numbers(origin, "rpy", 3, "0 0 0")
    pose = np.array(transformations.euler_matrix(*angles), dtype=np.float64)
    pose[:3, 3] = _numbers(origin, "xyz", 3, "0 0 0")
    if np.abs(pose[:3, 3]).max() > FAR:
        raise ValueError(f"xyz of origin is more than {FAR:,.0f} m away")
    return pose


def _part(element: Element, name: str) -> Element:
    part = element.find(name)
    if part is None:
        raise ValueError(f"{element.tag} has no {name}")
    return part


def _text(element: Element, name: str) -> str:
    text = element.get(name)
    if text is None:
        raise ValueError(f"{element.tag} has no {name}")
    return text


def _number(element: Element, name: str, default: str | None = None) -> float:
    return _numbers(element, name, 1, default)[0]


def _numbers(element: Element, name: str, count: int, default: str | None = None) -> list[float]:
    """Numbers of an attribute. Raises ValueError."""
    text = _text(element, name) if default is None else element.get(name, default)
    try:
        return numbers_of(text, count)
    except ValueError as error:
        raise ValueError(f"{name} of {element.tag} {error}") from error


def _lengths(element: Element, name: str, count: int) -> list[float]:
    """Lengths of an attribute, which are above 0. Raises ValueError."""
    lengths = _numbers(element, name, count)
    if min(lengths) <= 0.0:
        raise ValueError(f"{name} of {element.tag} must be above 0; got {element.get(name)}")
    return lengths


def read_collision_mesh(name: str, link: str, path: Path) -> Floats:
    """Read a mesh that a URDF names, as the corners of its triangles, shape (n, 3, 3).

    Raises:
        SettingError: There is no such file, or it is no mesh.
    """
    file = mesh_file(name, path)
    if file is None:
        scheme, _, rest = name.rpartition("://")
        package = rest.partition("/")[0]
        where = "put it where the file says"
        if scheme in {"package", "model"}:
            where = f"put the folder {package}, which the file takes for a ROS package, beside it"
        raise SettingError(printable(f"{path}: there is no mesh {name} of link {link}; {where}"))
    try:
        raw = read_mesh(file)
    except MeshError as error:
        raise SettingError(printable(f"{path}: mesh of link {link}: {error}")) from error
    return raw.vertices[raw.faces]
