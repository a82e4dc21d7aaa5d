"""The XML of a URDF: faults that MuJoCo passes over, what it drops, and meshes that it cannot read.

What is left for MuJoCo are links, joints and shapes; meshes are balls there, with numbers.
"""

import math
import re
from dataclasses import dataclass, field
from graphlib import CycleError, TopologicalSorter
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError, SubElement, fromstring, tostring

from grasp3d.errors import SettingError
from grasp3d.hand.link_tree import LinkMass
from grasp3d.system.documents import file_bytes, number_of, numbers_of
from grasp3d.system.names import printable

NUMBERS = {
    "origin": {"xyz": 3, "rpy": 3}, "axis": {"xyz": 3}, "limit": {"lower": 1, "upper": 1},
    "mimic": {"multiplier": 1, "offset": 1},
}  # fmt: skip
"""Numbers that elements may state, and how many."""

SIZES = {
    "box": {"size": 3}, "sphere": {"radius": 1}, "cylinder": {"radius": 1, "length": 1},
    "capsule": {"radius": 1, "length": 1}, "mesh": {},
}  # fmt: skip
"""Lengths that shapes must state."""

FAR = 1e3
"""Largest length and distance [m]."""


@dataclass
class Urdf:
    """A URDF, ready for MuJoCo, with what that does not keep."""

    text: str = ""
    """What MuJoCo reads."""
    meshes: dict[tuple[str, int], Element] = field(default_factory=dict)
    """The element of each mesh, by link and number among its shapes."""
    limits: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Smallest and largest value of joints [m or rad]; infinite: none."""
    efforts: dict[str, float] = field(default_factory=dict)
    """Of joints [N m or N]."""
    masses: dict[str, LinkMass] = field(default_factory=dict)
    """Of links, where they are stated and possible."""
    unseen: list[str] = field(default_factory=list)
    """Links that are seen, but have no collision geometry."""
    has_world: bool = False
    """Whether it has a link of that name, which is MuJoCo's own."""


def read_urdf(path: Path) -> Urdf:
    """Check and prepare a URDF for MuJoCo. Raises SettingError with the fault."""
    try:  # prefixes of other programs are often declared nowhere
        data = re.sub(rb"(</?[\w-]+):(?=[\w-])", rb"\1.", file_bytes(path))
        return _prepared(fromstring(data))  # noqa: S314, in a process with limits
    except OSError as error:
        reason = f"cannot be read ({error.strerror or error})"
    except (ParseError, LookupError) as error:
        reason = f"is no XML: {error}"
    except (ValueError, RecursionError) as error:
        reason = str(error)
    raise SettingError(printable(f"{path}: {reason}"))


def _prepared(root: Element) -> Urdf:
    """What is in a URDF. Raises ValueError."""
    if root.tag != "robot":
        raise ValueError(f"is no URDF: its first element is {root.tag[:40]}, and must be robot")
    found, robot = Urdf(), Element("robot", name="robot")
    SubElement(SubElement(robot, "mujoco"), "compiler", fusestatic="false")  # links stay links
    links, joints = (_by_name(root, kind) for kind in ("link", "joint"))
    _check_tree(links, joints)
    for name, joint in joints.items():
        _check(joint, f"joint {name}")
        _read_joint(joint, name, joints, found)
        kept = SubElement(robot, "joint", joint.attrib)
        kept.extend(part for part in joint if part.tag in {"parent", "child", *NUMBERS})
    for name, link in links.items():
        kept, collisions = SubElement(robot, "link", name=name), link.findall("collision")
        for number, collision in enumerate(collisions):
            if (mesh := _mesh(collision, f"link {name}")) is not None:
                found.meshes[name, number] = mesh
            kept.append(collision)
        if (mass := _mass(link)) is not None:
            found.masses[name] = mass
        if link.find("visual") is not None and not collisions:
            found.unseen.append(name)
    found.text, found.has_world = tostring(robot, "unicode"), "world" in links
    return found


def _by_name(root: Element, kind: str) -> dict[str, Element]:
    found: dict[str, Element] = {}
    for element in root.findall(kind):
        name = _text(element, "name")
        if name in found:
            raise ValueError(f"two {kind}s are called {name}")
        found[name] = element
    return found


def _text(element: Element, name: str) -> str:
    text = element.get(name)
    if text is None:
        raise ValueError(f"{element.tag} has no {name}")
    return text


def _check(owner: Element, of: str) -> None:
    """Refuse numbers that are none, or that no hand has."""
    for element in owner.iter():
        sizes = SIZES.get(element.tag, {})
        for name, count in (NUMBERS.get(element.tag, {}) | sizes).items():
            if name not in element.attrib and name not in sizes:
                continue
            what = f"{of}: {name} of {element.tag}"
            try:
                numbers = numbers_of(_text(element, name), count)
            except ValueError as error:
                text = f"{what} {error}" if name in element.attrib else f"{of}: {error}"
                raise ValueError(text) from error
            if sizes and min(numbers) <= 0.0:
                raise ValueError(f"{what} must be above 0; got {element.get(name)}")
            if (sizes or name == "xyz") and max(map(abs, numbers)) > FAR:
                raise ValueError(f"{what} is more than {FAR:,.0f} m; is it in mm?")


def _mesh(collision: Element, of: str) -> Element | None:
    """Check a piece of collision geometry, and return its mesh, which becomes a ball there."""
    geometry = collision.find("geometry")
    shape = None if geometry is None else next(iter(geometry), None)
    if geometry is None or shape is None or shape.tag not in SIZES:
        raise ValueError(f"collision geometry of {of} is of no known kind")
    _check(collision, of)
    if shape.tag != "mesh":
        return None
    words = shape.get("scale", "1")
    try:
        scale = numbers_of(words, 1 if len(words.split()) == 1 else 3)
    except ValueError as error:
        raise ValueError(f"{of}: scale of mesh {error}") from error
    if not all(scale):
        raise ValueError(f"{of}: scale of mesh must not be 0")
    geometry.remove(shape)
    SubElement(geometry, "sphere", radius="1")
    return shape


def _mass(link: Element) -> LinkMass | None:
    """What a link weighs; None: it is not stated, or impossible."""
    mass, origin = link.find("inertial/mass"), link.find("inertial/origin")
    weight = math.nan if mass is None else number_of(mass.get("value"))
    try:
        x, y, z = numbers_of("0 0 0" if origin is None else origin.get("xyz", "0 0 0"), 3)
    except ValueError:
        return None
    return LinkMass(weight, (x, y, z)) if 0.0 < weight < math.inf else None


def _read_joint(joint: Element, name: str, joints: dict[str, Element], found: Urdf) -> None:
    """Keep limits and effort of a joint. Raises ValueError."""
    limit, axis, mimic = (joint.find(part) for part in ("limit", "axis", "mimic"))
    moves, ends = joint.get("type") != "fixed", (-math.inf, math.inf)
    if axis is not None and moves and not any(numbers_of(_text(axis, "xyz"), 3)):
        raise ValueError(f"joint {name} has the axis 0 0 0")
    if mimic is not None:
        source = joints.get(_text(mimic, "joint"))
        if source is None or source.get("type") == "fixed" or source is joint:
            raise ValueError(f"joint {name} follows {mimic.get('joint')}, which it cannot")
    if limit is not None and math.isfinite(effort := number_of(limit.attrib.pop("effort", "nan"))):
        found.efforts[name] = effort
    if joint.get("type") in {"revolute", "prismatic"}:
        if limit is not None and {"lower", "upper"} <= {*limit.keys()}:
            ends = float(_text(limit, "lower")), float(_text(limit, "upper"))
        stated = "no limits" if limit is None else f"limits from {ends[0]:g} to {ends[1]:g}"
        if not ends[0] <= ends[1] or (math.isinf(ends[0]) and mimic is None):
            raise ValueError(
                f"joint {name} has {stated}; state its smallest and its largest value, or that it "
                "has none (continuous)"
            )
    found.limits[name] = ends


def _check_tree(links: dict[str, Element], joints: dict[str, Element]) -> None:
    """Refuse links that joints join in other ways than a tree. Raises ValueError."""
    above: dict[str, tuple[str, str]] = {}
    for name, joint in joints.items():
        ends = [joint.find(end) for end in ("parent", "child")]
        parent, child = ("" if end is None else end.get("link", "") for end in ends)
        if child in above or not {parent, child} <= {*links} or child == "world":
            raise ValueError(f"joint {name} joins no two links of its own")
        above[child] = name, parent
    try:
        TopologicalSorter({child: [parent] for child, (_, parent) in above.items()}).prepare()
    except CycleError as error:
        first, _ = above[error.args[1][0]]
        raise ValueError(f"joint {first} is part of a loop of joints") from error
