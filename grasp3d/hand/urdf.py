"""The XML of a URDF: faults that MuJoCo passes over, what it drops, and meshes that it cannot read.

What is left for MuJoCo are links, joints and shapes; meshes are balls there, with numbers.
"""

import math
import re
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError, SubElement, fromstring, tostring

from grasp3d.errors import SettingError
from grasp3d.hand.link_tree import LinkMass
from grasp3d.system.documents import file_bytes, number_of, numbers_of
from grasp3d.system.names import printable

KEPT = {"parent", "child", "origin", "axis", "limit", "mimic"}
"""Elements of joints that MuJoCo reads."""


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
    for name, joint in joints.items():
        _read_joint(joint, name, joints, found)
        kept = SubElement(robot, "joint", joint.attrib)
        kept.extend(part for part in joint if part.tag in KEPT)
    for name, link in links.items():
        kept, collisions = SubElement(robot, "link", name=name), link.findall("collision")
        for number, collision in enumerate(collisions):
            for geometry in collision.findall("geometry[mesh]"):
                mesh = next(iter(geometry))
                found.meshes[name, number] = mesh
                scale = mesh.get("scale", "1")
                if 0.0 in numbers_of(scale, 1 if len(scale.split()) == 1 else 3):
                    raise ValueError(f"link {name}: scale of mesh must not be 0")
                geometry.remove(mesh)
                SubElement(geometry, "sphere", radius="1")
            collision.set("name", f"{name} {number}")  # for errors of MuJoCo
            kept.append(collision)
        if (mass := _mass(link)) is not None:
            found.masses[name] = mass
        if link.find("visual") is not None and not collisions:
            found.unseen.append(name)
    found.text, found.has_world = tostring(robot, "unicode"), "world" in links
    return found


def _by_name(root: Element, kind: str) -> dict[str, Element]:
    """The elements of a kind; those without a name have an empty one, which MuJoCo refuses."""
    elements = root.findall(kind)
    found = {element.get("name", ""): element for element in elements}
    for element in elements:
        if found[name := element.get("name", "")] is not element:
            raise ValueError(f"two {kind}s are called {name}")
    return found


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
    limit, mimic, ends = joint.find("limit"), joint.find("mimic"), (-math.inf, math.inf)
    if mimic is not None:
        source = joints.get(mimic.get("joint", ""))
        if source is None or source.get("type") == "fixed" or source is joint:
            raise ValueError(f"joint {name} follows {mimic.get('joint')}, which it cannot")
        numbers_of(f"{mimic.get('multiplier', 1)} {mimic.get('offset', 0)}", 2)
    if limit is not None and math.isfinite(effort := number_of(limit.attrib.pop("effort", "nan"))):
        found.efforts[name] = effort
    if joint.get("type") in {"revolute", "prismatic"}:
        if limit is not None and {"lower", "upper"} <= {*limit.keys()}:
            ends = number_of(limit.get("lower")), number_of(limit.get("upper"))
        stated = "no limits" if limit is None else f"limits from {ends[0]:g} to {ends[1]:g}"
        if not ends[0] <= ends[1] or (math.isinf(ends[0]) and mimic is None):
            raise ValueError(
                f"joint {name} has {stated}; state its smallest and its largest value, or that it "
                "has none (continuous)"
            )
    found.limits[name] = ends
