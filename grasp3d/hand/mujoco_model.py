"""Links and joints of a robot as MuJoCo reads them, from a URDF or a model of its own."""

import math
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from mujoco import (
    FatalError,
    MjModel,
    MjSpec,
    UnexpectedError,
    mjtBias,
    mjtDyn,
    mjtEq,
    mjtGain,
    mjtGeom,
    mjtJoint,
    mjtTrn,
    mjtWrap,
    set_mju_user_warning,
)
from trimesh import creation, transformations

from grasp3d.arrays import Floats
from grasp3d.errors import SettingError
from grasp3d.hand.link_meshes import mesh_triangles
from grasp3d.hand.link_tree import (
    Joint,
    JointKind,
    LinkMass,
    LinkShape,
    LinkTree,
    ShapeKind,
    mesh_shape,
)
from grasp3d.hand.urdf import Urdf, read_urdf
from grasp3d.system.names import printable

LEAST_MASS, LEAST_INERTIA = 1e-9, 1e-12
"""Given to moving links that state none, which MuJoCo would refuse [kg, kg m^2]."""

JOINTS: dict[int, JointKind] = {
    int(mjtJoint.mjJNT_SLIDE): "slides",
    int(mjtJoint.mjJNT_HINGE): "turns",
}

SHAPES: dict[int, tuple[ShapeKind, int]] = {
    int(mjtGeom.mjGEOM_BOX): ("box", 3),
    int(mjtGeom.mjGEOM_SPHERE): ("sphere", 1),
    int(mjtGeom.mjGEOM_CYLINDER): ("cylinder", 2),
    int(mjtGeom.mjGEOM_CAPSULE): ("capsule", 2),
}
"""Kinds of shapes, and how many numbers their sizes are."""


def read_links(path: Path) -> LinkTree:
    """All links and joints of a URDF (.urdf) or a MuJoCo model.

    Geometry that collides with nothing (contype and conaffinity 0, in no pair) is not read.

    Args:
        path: The file. Of a URDF a mesh that is missing or damaged is refused when the geometry of
            its link is asked for; `package://NAME/...` is looked for in a folder NAME that contains
            the file, or is beside such a folder.

    Raises:
        SettingError: It has a fault, or MuJoCo cannot read it.
    """
    urdf = read_urdf(path) if path.suffix.lower() == ".urdf" else None
    return _Reader(path, _compiled(path, urdf), urdf).tree()


def _compiled(path: Path, urdf: Urdf | None) -> MjModel:
    set_mju_user_warning(lambda _: None)  # otherwise it writes a log into the working folder
    try:
        spec = MjSpec.from_file(str(path)) if urdf is None else MjSpec.from_string(urdf.text)
        spec.compiler.boundmass, spec.compiler.boundinertia = LEAST_MASS, LEAST_INERTIA
        spec.compiler.balanceinertia = True
        return spec.compile()
    except (ValueError, RuntimeError, FatalError, UnexpectedError) as error:
        reason = " ".join(str(error).split())
        raise SettingError(printable(f"{path}: MuJoCo cannot read it ({reason})")) from error
    finally:
        set_mju_user_warning(None)


class _Reader:
    """A model that MuJoCo has read, as a tree of links."""

    def __init__(self, path: Path, model: MjModel, urdf: Urdf | None) -> None:
        self.path, self.model, self.urdf = path, model, urdf
        bodies, joints = range(model.nbody), range(model.njnt)
        self.links = [model.body(one).name or f"body {one}" for one in bodies]
        self.names = [model.joint(one).name or f"joint {one}" for one in joints]
        self.paired = {*model.pair_geom1.tolist(), *model.pair_geom2.tolist()}
        self.equations = np.flatnonzero(model.eq_active0).tolist()
        self.efforts, self.pulled = self._motors()

    def tree(self) -> LinkTree:
        """Its links, with their masses and shapes."""
        model, urdf, joints = self.model, self.urdf, dict[str, Joint]()
        for body in range(1, model.nbody):
            joints.update(self._joints_of(body))
        root, links = self.links[0], (self.links[0], *joints)
        if urdf is None:
            with_geometry = sorted({*model.geom_bodyid.tolist()} - {0})
            unseen = [self.links[one] for one in with_geometry if not self._numbers(one)]
            masses = {
                name: LinkMass(weight, tuple(center))
                for name, weight, center in zip(
                    self.links, model.body_mass.tolist(), model.body_ipos.tolist(), strict=True
                )
                if weight > 2.0 * LEAST_MASS
            }
        else:
            unseen, masses = urdf.unseen, urdf.masses
            if not urdf.has_world:  # MuJoCo adds one
                links = links[1:]
                joints = {link: joint for link, joint in joints.items() if joint.parent != root}
            # Postures have the order of the file.
            order = {name: number for number, name in enumerate(urdf.limits)}
            ordered = sorted(joints.items(), key=lambda one: order.get(one[1].name, -1))
            joints = dict(ordered)
        return LinkTree(
            str(self.path), links, joints, self.shapes, self.pulled, masses, self._closures(),
            tuple(unseen),
        )  # fmt: skip

    def _joints_of(self, body: int) -> Iterator[tuple[str, Joint]]:
        """The joints that move a body, each with the link that it moves.

        Of several, all but the last one move links of their own without geometry.
        """
        model, name = self.model, self.links[body]
        pose = _pose(model.body_pos[body], model.body_quat[body])
        parent = self.links[model.body_parentid[body]]
        first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
        if count == 0:
            yield name, Joint(f"{name} (fixed)", "fixed", parent, pose, np.array([1.0, 0.0, 0.0]))
        for number in range(first, first + count):
            joint = self._joint(number, parent, pose)
            link = name if number == first + count - 1 else f"{name} ({joint.name})"
            yield link, joint
            parent, pose = link, np.eye(4)

    def _joint(self, number: int, parent: str, pose: Floats) -> Joint:
        """A joint whose link has a pose in the frame of its parent at its reference value."""
        model, name = self.model, self.names[number]
        kind = JOINTS.get(int(model.jnt_type[number]), "free")
        axis, position = np.array(model.jnt_axis[number]), np.array(model.jnt_pos[number])
        back = np.eye(4)
        reference = float(model.qpos0[model.jnt_qposadr[number]])  # rarely not 0
        if kind == "slides":
            back[:3, 3] = -reference * axis
        elif kind == "turns" and reference:
            back = transformations.rotation_matrix(-reference, axis, position)
        limits = -math.inf, math.inf
        if self.urdf is not None:
            limits = self.urdf.limits.get(name, limits)
        elif model.jnt_limited[number]:
            limits = tuple(model.jnt_range[number].tolist())
        effort = self.efforts.get(number)
        follows = self._followed(number)
        return Joint(name, kind, parent, pose @ back, axis, limits, follows, position, effort)

    def _followed(self, joint: int) -> tuple[str, float, float] | None:
        """The joint that another joint follows by an equality constraint, with factor, offset."""
        model = self.model
        for number in self.equations:
            one, two = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
            if model.eq_type[number] == mjtEq.mjEQ_JOINT and one == joint and two >= 0:
                offset, factor = (float(value) for value in model.eq_data[number][:2])
                # The equation is one of changes since the joints' reference values.
                start, other = (float(model.qpos0[model.jnt_qposadr[end]]) for end in (one, two))
                return self.names[two], factor, offset + start - factor * other
        return None

    def _closures(self) -> tuple[str, ...]:
        """Names of constraints that a tree with straight couplings does not keep."""
        model = self.model
        return tuple(
            model.equality(number).name or f"equality {number}"
            for number in self.equations
            if model.eq_type[number] != mjtEq.mjEQ_JOINT
            or model.eq_obj2id[number] < 0
            or model.eq_data[number][2:5].any()
        )

    def _motors(self) -> tuple[dict[int, float], frozenset[str]]:
        """Greatest torque or force of the motors at joints, and joints that are pulled alone.

        Tendons, and motors with a force of one sign, pull. What holds a joint with a spring is not
        known.
        """
        model, efforts = self.model, dict[int, float]()
        if self.urdf is not None:
            stated = self.urdf.efforts
            return {
                n: stated[one] for n, one in enumerate(self.names) if one in stated
            }, frozenset()
        driven, pulled = set[int](), set[int]()
        for number in range(model.nu):
            low, high = self._forces(number)
            kind, joints = model.actuator_trntype[number], self._driven(number)
            one_way = math.isfinite(high - low) and low < high and low * high >= 0.0
            (pulled if one_way or kind == mjtTrn.mjTRN_TENDON else driven).update(joints)
            if kind == mjtTrn.mjTRN_JOINT and model.actuator_forcelimited[number] and not one_way:
                gear = abs(float(model.actuator_gear[number, 0]))
                efforts.setdefault(joints[0], gear * max(abs(low), abs(high)))
        pulled -= driven
        for joint in {*np.flatnonzero(model.jnt_actfrclimited).tolist()} - pulled:
            efforts[joint] = float(np.abs(model.jnt_actfrcrange[joint]).max())
        for joint in np.flatnonzero(model.jnt_stiffness).tolist():
            efforts.pop(joint, None)
        return efforts, frozenset(self.names[joint] for joint in pulled)

    def _driven(self, number: int) -> list[int]:
        """Joints that an actuator drives, by a tendon or not."""
        model = self.model
        kind, target = model.actuator_trntype[number], int(model.actuator_trnid[number, 0])
        if kind == mjtTrn.mjTRN_JOINT:
            return [target]
        if kind != mjtTrn.mjTRN_TENDON:
            return []
        wraps = slice(model.tendon_adr[target], model.tendon_adr[target] + model.tendon_num[target])
        over = model.wrap_type[wraps] == mjtWrap.mjWRAP_JOINT
        return list(map(int, model.wrap_objid[wraps][over]))

    def _forces(self, number: int) -> tuple[float, float]:
        """Smallest and largest force of an actuator; infinite: none is stated."""
        model, low, high = self.model, -math.inf, math.inf
        if model.actuator_forcelimited[number]:
            low, high = model.actuator_forcerange[number].tolist()
        kinds = model.actuator_gaintype, model.actuator_biastype, model.actuator_dyntype
        of_motor = [mjtGain.mjGAIN_FIXED, mjtBias.mjBIAS_NONE, mjtDyn.mjDYN_NONE]
        if model.actuator_ctrllimited[number] and [kind[number] for kind in kinds] == of_motor:
            ends = model.actuator_gainprm[number, 0] * model.actuator_ctrlrange[number]
            low, high = np.clip(sorted(ends), low, high).tolist()
        return low, high

    def _numbers(self, body: int) -> list[int]:
        """Pieces of geometry of a body that collide."""
        model = self.model
        first, count = int(model.body_geomadr[body]), int(model.body_geomnum[body])
        collides = (model.geom_contype != 0) | (model.geom_conaffinity != 0)
        return [one for one in range(first, first + count) if collides[one] or one in self.paired]

    def shapes(self, link: str) -> tuple[LinkShape, ...]:
        """Collision geometry of a link, by its name."""
        if link not in self.links:  # between joints of one body
            return ()
        found = enumerate(self._numbers(self.links.index(link)))
        return tuple(self._shape(geom, link, number) for number, geom in found)

    def _shape(self, geom: int, link: str, number: int) -> LinkShape:
        model, kind = self.model, int(self.model.geom_type[geom])
        pose = _pose(model.geom_pos[geom], model.geom_quat[geom])
        size = tuple(model.geom_size[geom].tolist())
        if self.urdf is not None and (link, number) in self.urdf.meshes:
            mesh = self.urdf.meshes[link, number]
            return mesh_shape(mesh_triangles(mesh, link, self.path), pose)
        if kind == mjtGeom.mjGEOM_MESH:
            return mesh_shape(_mesh(model, int(model.geom_dataid[geom])), pose)
        if kind == mjtGeom.mjGEOM_ELLIPSOID:
            return mesh_shape(np.asarray(creation.icosphere().triangles * size), pose)
        if kind not in SHAPES:  # a plane or a height field
            problem = f"{self.path}: collision geometry of {link} is of no finite shape"
            raise SettingError(printable(problem))
        name, count = SHAPES[kind]
        return LinkShape(name, pose, size[:count])


def _mesh(model: MjModel, number: int) -> Floats:
    start, count = model.mesh_vertadr[number], model.mesh_vertnum[number]
    first, faces = model.mesh_faceadr[number], model.mesh_facenum[number]
    vertices = np.asarray(model.mesh_vert[start : start + count], np.float64)
    return np.asarray(vertices[model.mesh_face[first : first + faces]])


def _pose(position: Floats, quaternion: Floats) -> Floats:
    """The pose (4, 4) of a position and a quaternion (w, x, y, z)."""
    pose = np.array(transformations.quaternion_matrix(quaternion), dtype=np.float64)
    pose[:3, 3] = position
    return pose
