"""Read the links and joints of a robot with MuJoCo, from a URDF or a MuJoCo model.

First, the XML of a URDF is searched for faults that MuJoCo ignores, for data that it drops, and for
meshes that it cannot read. MuJoCo then reads links, joints and shapes, with a numbered ball in
place of each mesh.
"""

import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from xml.etree.ElementTree import Element, ParseError, SubElement, fromstring, tostring

import mujoco as mj
import numpy as np
from trimesh import creation, load_scene, transformations
from trimesh.units import unit_conversion

from grasp3d.arrays import Floats, locked
from grasp3d.errors import MeshError, SettingError
from grasp3d.hand.link_tree import Joint, JointKind, LinkMass, LinkShape, LinkTree, ShapeKind
from grasp3d.mesh.mesh_files import read_mesh
from grasp3d.system.documents import file_bytes, is_file, number_of, numbers_of
from grasp3d.system.names import printable, reason_of

KEPT = {"parent", "child", "origin", "axis", "limit", "mimic"}
"""Elements of joints that MuJoCo reads."""


@dataclass
class Urdf:
    """A URDF prepared for MuJoCo, with the data that MuJoCo does not keep."""

    text: str = ""
    """XML that MuJoCo reads."""
    meshes: dict[tuple[str, int], Element] = field(default_factory=dict)
    """The element of each mesh, by link and number among its shapes."""
    limits: dict[str, tuple[float, float]] = field(default_factory=dict)
    """Smallest and largest value of joints [m or rad]; infinite: none."""
    efforts: dict[str, float] = field(default_factory=dict)
    """Efforts of joints [N m or N]."""
    masses: dict[str, LinkMass] = field(default_factory=dict)
    """Masses of links, where they are stated and possible."""
    unseen: list[str] = field(default_factory=list)
    """Links with visual geometry, but no collision geometry."""
    has_world: bool = False
    """Whether it has a link called world, the name of MuJoCo's own root."""


def read_urdf(path: Path) -> Urdf:
    """Check and prepare a URDF for MuJoCo. Raises SettingError with the fault."""
    try:  # prefixes of other programs are often undeclared
        data = re.sub(rb"(</?[\w-]+):(?=[\w-])", rb"\1.", file_bytes(path))
        return _prepared(fromstring(data))  # noqa: S314, in a process with limits
    except OSError as error:
        reason = f"cannot be read ({error.strerror or error})"
    except (ParseError, LookupError) as error:
        reason = f"is not valid XML: {error}"
    except (ValueError, RecursionError) as error:
        reason = str(error)
    raise SettingError(printable(f"{path}: {reason}"))


def _prepared(root: Element) -> Urdf:
    """Prepare the XML of a URDF for MuJoCo. Raises ValueError."""
    if root.tag != "robot":
        raise ValueError(f"is not a URDF: its first element is {root.tag[:40]}, and must be robot")
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
    """The elements of a kind by name; unnamed ones have the name "", which MuJoCo refuses."""
    elements = root.findall(kind)
    found = {element.get("name", ""): element for element in elements}
    for element in elements:
        if found[name := element.get("name", "")] is not element:
            raise ValueError(f"two {kind}s are called {name}")
    return found


def _mass(link: Element) -> LinkMass | None:
    """The mass of a link; None if it is not stated, or impossible."""
    mass, origin = link.find("inertial/mass"), link.find("inertial/origin")
    weight = math.nan if mass is None else number_of(mass.get("value"))
    try:
        x, y, z = numbers_of("0 0 0" if origin is None else origin.get("xyz", "0 0 0"), 3)
    except ValueError:
        return None
    return LinkMass(weight, (x, y, z)) if 0.0 < weight < math.inf else None


def _read_joint(joint: Element, name: str, joints: dict[str, Element], found: Urdf) -> None:
    """Check a joint, and add its limits and effort to `found`. Raises ValueError."""
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


LEAST_MASS, LEAST_INERTIA = 1e-9, 1e-12
"""Mass and inertia for moving links that state none, which MuJoCo would refuse [kg, kg m^2]."""

FAR = 1e3
"""Largest length and distance [m]."""

JOINTS: dict[str, JointKind] = {"mjJNT_SLIDE": "slides", "mjJNT_HINGE": "turns"}
"""Kinds of joints by their names in MuJoCo."""

SHAPES: dict[str, tuple[ShapeKind, int]] = {
    "mjGEOM_BOX": ("box", 3), "mjGEOM_SPHERE": ("sphere", 1), "mjGEOM_CYLINDER": ("cylinder", 2),
    "mjGEOM_CAPSULE": ("capsule", 2),
}  # fmt: skip
"""Kinds of shapes by their names in MuJoCo, and how many numbers state their sizes."""


def read_links(path: Path) -> LinkTree:
    """Read all links and joints of a URDF (.urdf) or a MuJoCo model.

    Geometry that collides with nothing (contype and conaffinity 0, in no pair) is skipped.

    Args:
        path: The file. A missing or damaged mesh of a URDF is an error only when the geometry of
            its link is read. `package://NAME/...` is looked for in a folder NAME that contains the
            file, or that lies in any folder which does.

    Raises:
        SettingError: The file has a fault, or MuJoCo cannot read it.
    """
    urdf = read_urdf(path) if path.suffix.lower() == ".urdf" else None
    return _Reader(path, _compiled(path, urdf), urdf).tree()


def _compiled(path: Path, urdf: Urdf | None) -> mj.MjModel:
    warnings = list[str]()  # otherwise MuJoCo logs them in the working folder
    mj.set_mju_user_warning(warnings.append)
    try:
        spec = mj.MjSpec.from_string(urdf.text) if urdf else mj.MjSpec.from_file(str(path))
        spec.compiler.boundmass, spec.compiler.boundinertia = LEAST_MASS, LEAST_INERTIA
        spec.compiler.balanceinertia = True
        model = spec.compile()
    except (ValueError, RuntimeError, mj.FatalError, mj.UnexpectedError) as error:
        reason = " ".join(str(error).split())
        raise SettingError(printable(f"{path}: MuJoCo cannot read it ({reason})")) from error
    finally:
        mj.set_mju_user_warning(None)
    if any("NaN" in one for one in warnings):
        raise SettingError(printable(f"{path}: one of its numbers is NaN"))
    return model


class _Reader:
    """A model that MuJoCo has read, as a tree of links."""

    def __init__(self, path: Path, model: mj.MjModel, urdf: Urdf | None) -> None:
        self.path, self.model, self.urdf = path, model, urdf
        bodies, joints = range(model.nbody), range(model.njnt)
        self.links = [model.body(one).name or f"body {one}" for one in bodies]
        self.names = [model.joint(one).name or f"joint {one}" for one in joints]
        self.paired = {*model.pair_geom1.tolist(), *model.pair_geom2.tolist()}
        self.follows, self.closures = self._equations()
        self.efforts = self._motors() if urdf is None else {}

    def tree(self) -> LinkTree:
        """The tree of links, with their masses and shapes."""
        model, urdf = self.model, self.urdf
        joints = dict(one for body in range(1, model.nbody) for one in self._joints_of(body))
        root, links = self.links[0], (self.links[0], *joints)
        if urdf is None:
            seen = sorted({*model.geom_bodyid.tolist()} - {0})
            unseen = [self.links[one] for one in seen if not self._numbers(one)]
            columns = self.links, model.body_mass.tolist(), model.body_ipos.tolist()
            masses = {
                name: LinkMass(weight, tuple(center))
                for name, weight, center in zip(*columns, strict=True)
                if weight > 2.0 * LEAST_MASS
            }
        else:
            unseen, masses = urdf.unseen, urdf.masses
            if not urdf.has_world:  # MuJoCo adds one
                links = links[1:]
                joints = {link: joint for link, joint in joints.items() if joint.parent != root}
            # Joints keep the order of the file, as postures do.
            order = {name: number for number, name in enumerate(urdf.limits)}
            joints = dict(sorted(joints.items(), key=lambda one: order.get(one[1].name, -1)))
        return LinkTree(
            str(self.path), links, joints, self.shapes, masses, self.closures,
            tuple(unseen),
        )  # fmt: skip

    def _joints_of(self, body: int) -> Iterator[tuple[str, Joint]]:
        """The joints that move a body, each with the link that it moves.

        If there are several, all but the last move additional links without geometry.
        """
        model, name = self.model, self.links[body]
        pose = self._pose(name, model.body_pos[body], model.body_quat[body])
        parent, first = self.links[model.body_parentid[body]], int(model.body_jntadr[body])
        numbers = range(first, first + int(model.body_jntnum[body]))
        if not numbers:
            yield name, Joint(f"{name} (fixed)", "fixed", parent, pose, np.array([1.0, 0.0, 0.0]))
        for number in numbers:
            link = name if number == numbers[-1] else f"{name} ({self.names[number]})"
            yield link, self._joint(number, parent, pose)
            parent, pose = link, np.eye(4)

    def _joint(self, number: int, parent: str, pose: Floats) -> Joint:
        """Make a joint; `pose` is that of its link in the parent's frame at the reference value."""
        model, name = self.model, self.names[number]
        kind = JOINTS.get(mj.mjtJoint(model.jnt_type[number]).name, "free")
        axis, position = np.array(model.jnt_axis[number]), np.array(model.jnt_pos[number])
        back, reference = np.eye(4), self._reference(number)
        if kind == "slides":
            back[:3, 3] = -reference * axis
        elif kind == "turns" and reference:
            back = transformations.rotation_matrix(-reference, axis, position)
        limits, effort = (-math.inf, math.inf), self.efforts.get(number)
        if self.urdf is not None:
            limits, effort = self.urdf.limits.get(name, limits), self.urdf.efforts.get(name)
        elif model.jnt_limited[number]:
            limits = tuple(model.jnt_range[number].tolist())
        follows = self.follows.get(number)
        return Joint(name, kind, parent, pose @ back, axis, limits, follows, position, effort)

    def _reference(self, joint: int) -> float:
        """The value of a joint in the pose of the file, usually 0."""
        return float(self.model.qpos0[self.model.jnt_qposadr[joint]])

    def _equations(self) -> tuple[dict[int, tuple[str, float, float]], tuple[str, ...]]:
        """Couplings of joints, as in `Joint.follows`, and the names of all other constraints.

        A tree with linear couplings cannot represent the latter.
        """
        model, follows, others = self.model, dict[int, tuple[str, float, float]](), list[str]()
        for number in np.flatnonzero(model.eq_active0).tolist():
            one, two = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
            couples = model.eq_type[number] == mj.mjtEq.mjEQ_JOINT and two >= 0
            offset, factor, *curved = model.eq_data[number][:5].tolist()
            if couples and one not in follows:
                # The equation couples changes from the joints' reference values.
                offset += self._reference(one) - factor * self._reference(two)
                follows[one] = self.names[two], factor, offset
            if not couples or any(curved):
                others.append(model.equality(number).name or f"equality {number}")
        return follows, tuple(others)

    def _motors(self) -> dict[int, float]:
        """Greatest torque or force of the motors of joints, where it is known.

        It is unknown where a spring acts on the joint, or a motor acts in one direction only.
        """
        model, efforts = self.model, dict[int, float]()
        unknown = {*np.flatnonzero(model.jnt_stiffness).tolist()}
        for number in np.flatnonzero(model.actuator_trntype == mj.mjtTrn.mjTRN_JOINT).tolist():
            joint, (low, high) = int(model.actuator_trnid[number, 0]), self._forces(number)
            if not low < 0.0 < high:
                unknown.add(joint)
            elif model.actuator_forcelimited[number]:
                gear = abs(float(model.actuator_gear[number, 0]))
                efforts.setdefault(joint, gear * max(-low, high))
        for joint in np.flatnonzero(model.jnt_actfrclimited).tolist():
            efforts[joint] = float(np.abs(model.jnt_actfrcrange[joint]).max())
        return {joint: effort for joint, effort in efforts.items() if joint not in unknown}

    def _forces(self, number: int) -> tuple[float, float]:
        """Smallest and largest force of an actuator; infinite: none is stated."""
        model, low, high = self.model, -math.inf, math.inf
        if model.actuator_forcelimited[number]:
            low, high = model.actuator_forcerange[number].tolist()
        kinds = model.actuator_gaintype, model.actuator_biastype, model.actuator_dyntype
        of_motor = [mj.mjtGain.mjGAIN_FIXED, mj.mjtBias.mjBIAS_NONE, mj.mjtDyn.mjDYN_NONE]
        if model.actuator_ctrllimited[number] and [kind[number] for kind in kinds] == of_motor:
            ends = model.actuator_gainprm[number, 0] * model.actuator_ctrlrange[number]
            low, high = np.clip(sorted(ends), low, high).tolist()
        return low, high

    def _numbers(self, body: int) -> list[int]:
        """Numbers of the geoms of a body that collide."""
        model = self.model
        first, count = int(model.body_geomadr[body]), int(model.body_geomnum[body])
        collides = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
        return [one for one in range(first, first + count) if collides[one] or one in self.paired]

    def _pose(
        self, link: str, position: Floats, quaternion: Floats, size: Sequence[float] = ()
    ) -> Floats:
        """The pose (4, 4) of a position and a quaternion (w, x, y, z). Raises SettingError."""
        pose = np.array(transformations.quaternion_matrix(quaternion), dtype=np.float64)
        pose[:3, 3] = position
        if not np.abs([*position, *size]).max() <= FAR:
            problem = f"{self.path}: link {link} or its geometry is more than {FAR:,.0f} m large"
            raise SettingError(printable(f"{problem} or away; is it in mm?"))
        return pose

    def shapes(self, link: str) -> tuple[LinkShape, ...]:
        """Collision geometry of a link, by its name."""
        if link not in self.links:  # a link between the joints of one body
            return ()
        found = enumerate(self._numbers(self.links.index(link)))
        return tuple(self._shape(geom, link, number) for number, geom in found)

    def _shape(self, geom: int, link: str, number: int) -> LinkShape:
        model, kind = self.model, mj.mjtGeom(self.model.geom_type[geom]).name
        size = tuple(model.geom_size[geom].tolist())
        pose = self._pose(link, model.geom_pos[geom], model.geom_quat[geom], size)
        if kind in SHAPES and (self.urdf is None or (link, number) not in self.urdf.meshes):
            name, count = SHAPES[kind]
            return LinkShape(name, pose, size[:count])
        if self.urdf is not None:
            triangles = mesh_triangles(self.urdf.meshes[link, number], link, self.path)
        elif kind == "mjGEOM_MESH":
            mesh = model.mesh(model.geom_dataid[geom])
            start, first = mesh.vertadr[0], mesh.faceadr[0]
            vertices = model.mesh_vert[start : start + mesh.vertnum[0]].astype(np.float64)
            triangles = vertices[model.mesh_face[first : first + mesh.facenum[0]]]
        elif kind == "mjGEOM_ELLIPSOID":
            triangles = np.asarray(creation.icosphere().triangles * size)
        else:  # a plane or a height field
            problem = f"{self.path}: collision geometry of {link} has no finite shape"
            raise SettingError(printable(problem))
        return LinkShape("mesh", pose, surface=locked(triangles))


def mesh_triangles(mesh: Element, link: str, path: Path) -> Floats:
    """Read a mesh that a URDF names, as the corners of its triangles [m], shape (n, 3, 3).

    Raises:
        SettingError: The file does not exist, or is not a mesh.
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
    try:
        scene = load_scene(file)
        scale = unit_conversion(scene.units or "meters", "meters")
        return np.asarray(scene.to_mesh().triangles * scale)
    except Exception as error:  # of any class
        raise MeshError(f"{file}: cannot be read as COLLADA ({reason_of(error)})") from error


def mesh_file(name: str, path: Path) -> Path | None:
    """The file of a mesh that a URDF names; None if it does not exist."""
    scheme, _, rest = name.rpartition("://")
    folders = path.absolute().parents
    candidates = [folders[0] / rest]  # an absolute path stays what it is
    if scheme in {"package", "model"}:
        package, _, inside = rest.partition("/")
        inside = inside.lstrip("/")  # some URDFs have two slashes
        candidates = [folder / package / inside for folder in folders]
        candidates += [folder / inside for folder in folders if folder.name == package]
    return next(filter(is_file, candidates), None)
