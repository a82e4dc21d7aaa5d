"""Links and joints of a robot in a MuJoCo model."""

import math
from collections.abc import Collection, Iterator
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from trimesh import creation, transformations

from grasp3d.arrays import Floats
from grasp3d.errors import SettingError
from grasp3d.hand.link_tree import (
    Joint,
    JointKind,
    LinkMass,
    LinkShape,
    LinkTree,
    ShapeKind,
    mesh_shape,
)
from grasp3d.system.names import printable

if TYPE_CHECKING:
    from mujoco import MjModel


def read_mjcf(path: Path) -> LinkTree:
    """Read the bodies and joints of a MuJoCo model.

    Geometry that collides with nothing (contype and conaffinity 0, in no pair) is not read.

    Args:
        path: The file; MuJoCo reads its meshes and included files as well.

    Raises:
        SettingError: MuJoCo cannot read it.
    """
    model = _loaded(path)
    names = [model.body(number).name or f"body {number}" for number in range(model.nbody)]
    joints, pulling = dict[str, Joint](), _pulls(model)
    for body in range(1, model.nbody):
        joints.update(_joints(model, body, names, pulling))
    numbers = {name: number for number, name in enumerate(names)}

    def shapes(name: str) -> tuple[LinkShape, ...]:
        if name not in numbers:
            return ()
        first, count = model.body_geomadr[numbers[name]], model.body_geomnum[numbers[name]]
        found = (_shape(model, number, path) for number in range(first, first + count))
        return tuple(shape for shape in found if shape is not None)

    links = (names[0], *joints)
    pulls = {_actuator(model, number): joints for number, joints in pulling.items()}
    pulls |= _springs(model)
    masses = {
        name: LinkMass(float(model.body_mass[number]), tuple(model.body_ipos[number].tolist()))
        for name, number in numbers.items()
        if model.body_mass[number] > 0.0
    }
    return LinkTree(str(path), links, joints, shapes, pulls, masses, _closures(model))


def _loaded(path: Path) -> "MjModel":
    try:
        from mujoco import FatalError, MjModel, UnexpectedError, set_mju_user_warning
    except ImportError as error:
        raise SettingError(
            "reading a MuJoCo model needs mujoco; install it with: pip install 'grasp3d[grippers]'"
        ) from error
    set_mju_user_warning(lambda _: None)  # otherwise it writes a log into the working folder
    try:
        return MjModel.from_xml_path(str(path))
    except (ValueError, RuntimeError, FatalError, UnexpectedError) as error:
        reason = " ".join(str(error).split())
        raise SettingError(printable(f"{path}: MuJoCo cannot read it ({reason})")) from error
    finally:
        set_mju_user_warning(None)


def _joints(
    model: "MjModel", body: int, names: list[str], pulling: Collection[int]
) -> Iterator[tuple[str, Joint]]:
    """The joints that move a body, each with the link that it moves.

    Of several, all but the last one move links of their own without geometry.
    """
    pose = _pose(model.body_pos[body], model.body_quat[body])
    parent = names[model.body_parentid[body]]
    first, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
    if count == 0:
        yield (
            names[body],
            Joint(names[body], "fixed", parent, pose, np.array([1.0, 0.0, 0.0]), None),
        )
    for number in range(first, first + count):
        joint = _joint(model, number, parent, pose, pulling)
        link = names[body] if number == first + count - 1 else f"{names[body]} ({joint.name})"
        yield link, joint
        parent, pose = link, np.eye(4)


def _joint(
    model: "MjModel", number: int, parent: str, pose: Floats, pulling: Collection[int]
) -> Joint:
    """A joint whose link has a pose in the frame of its parent at the joint's reference value."""
    from mujoco import mjtJoint

    kinds: dict[int, JointKind] = {
        int(mjtJoint.mjJNT_SLIDE): "slides", int(mjtJoint.mjJNT_HINGE): "turns",
    }  # fmt: skip
    kind = kinds.get(int(model.jnt_type[number]), "free")
    axis, position = np.array(model.jnt_axis[number]), np.array(model.jnt_pos[number])
    back = np.eye(4)
    reference = float(model.qpos0[model.jnt_qposadr[number]])  # rarely not 0
    if kind == "slides":
        back[:3, 3] = -reference * axis
    elif kind == "turns":
        back = transformations.rotation_matrix(-reference, axis, position)
    low, high = (float(limit) for limit in model.jnt_range[number])
    return Joint(
        _name(model, number),
        kind,
        parent,
        pose @ back,
        axis,
        (low, high) if model.jnt_limited[number] else (-math.inf, math.inf),
        _followed(model, number),
        position,
        _effort(model, number, pulling),
    )


def _name(model: "MjModel", joint: int) -> str:
    return model.joint(joint).name or f"joint {joint}"


def _followed(model: "MjModel", joint: int) -> tuple[str, float, float] | None:
    """The joint that another joint follows by an equality constraint, with factor and offset."""
    for number in _equalities(model):
        one, two = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
        if one == joint and two >= 0:
            offset, factor = (float(value) for value in model.eq_data[number][:2])
            # The equation is one of changes since the joints' reference values.
            start, other = (float(model.qpos0[model.jnt_qposadr[end]]) for end in (one, two))
            return _name(model, two), factor, offset + start - factor * other
    return None


def _equalities(model: "MjModel") -> list[int]:
    """Numbers of the active equality constraints between joints."""
    from mujoco import mjtEq

    kinds = zip(model.eq_type, model.eq_active0, strict=True)
    return [n for n, (kind, active) in enumerate(kinds) if active and kind == mjtEq.mjEQ_JOINT]


def _closures(model: "MjModel") -> tuple[str, ...]:
    """Names of constraints that a tree with straight couplings does not keep."""
    straight = {
        number
        for number in _equalities(model)
        if model.eq_obj2id[number] >= 0 and not model.eq_data[number][2:5].any()
    }
    others = [n for n in range(model.neq) if model.eq_active0[n] and n not in straight]
    return tuple(model.equality(number).name or f"equality {number}" for number in others)


def _effort(model: "MjModel", joint: int, pulling: Collection[int]) -> float | None:
    """Greatest torque or force of the motors at a joint; None: none is stated."""
    from mujoco import mjtTrn

    acting = [n for n in range(model.nu) if _name(model, joint) in _driven(model, n)]
    motors = [number for number in acting if number not in pulling]
    if model.jnt_actfrclimited[joint] and (motors or not acting):  # or they are in another file
        return float(np.abs(model.jnt_actfrcrange[joint]).max())
    for number in motors:
        if model.actuator_trntype[number] == mjtTrn.mjTRN_JOINT:
            gear = abs(float(model.actuator_gear[number, 0]))
            if model.actuator_forcelimited[number]:
                return gear * float(np.abs(_forces(model, number)).max())
    return None


def _springs(model: "MjModel") -> dict[str, tuple[str, ...]]:
    """Springs of joints, with their joints."""
    names = [_name(model, int(number)) for number in np.flatnonzero(model.jnt_stiffness)]
    return {f"the spring of {name}": (name,) for name in names}


def _driven(model: "MjModel", number: int) -> tuple[str, ...]:
    """Joints that an actuator drives, by a tendon or not."""
    from mujoco import mjtTrn, mjtWrap

    kind, target = model.actuator_trntype[number], int(model.actuator_trnid[number, 0])
    if kind == mjtTrn.mjTRN_JOINT:
        return (_name(model, target),)
    if kind != mjtTrn.mjTRN_TENDON:
        return ()
    first, count = int(model.tendon_adr[target]), int(model.tendon_num[target])
    wraps = range(first, first + count)
    over = [wrap for wrap in wraps if model.wrap_type[wrap] == mjtWrap.mjWRAP_JOINT]
    return tuple(_name(model, model.wrap_objid[wrap]) for wrap in over)


def _pulls(model: "MjModel") -> dict[int, tuple[str, ...]]:
    """Actuators of tendons, and of joints with a force of one sign, with the joints."""
    from mujoco import mjtTrn

    found = {}
    for number in range(model.nu):
        low, high = _forces(model, number)
        one_way = math.isfinite(low) and math.isfinite(high) and low < high and low * high >= 0.0
        joints, kind = _driven(model, number), model.actuator_trntype[number]
        if kind == mjtTrn.mjTRN_TENDON or (one_way and joints):
            found[number] = joints
    return found


def _actuator(model: "MjModel", number: int) -> str:
    return model.actuator(number).name or f"actuator {number}"


def _forces(model: "MjModel", actuator: int) -> tuple[float, float]:
    """Smallest and largest force of an actuator; infinite: none is stated."""
    from mujoco import mjtBias, mjtDyn, mjtGain

    low, high = -math.inf, math.inf
    if model.actuator_forcelimited[actuator]:
        low, high = model.actuator_forcerange[actuator].tolist()
    kinds = (model.actuator_gaintype, model.actuator_biastype, model.actuator_dyntype)
    of_motor = mjtGain.mjGAIN_FIXED, mjtBias.mjBIAS_NONE, mjtDyn.mjDYN_NONE
    if model.actuator_ctrllimited[actuator] and all(
        kind[actuator] == one for kind, one in zip(kinds, of_motor, strict=True)
    ):
        ends = model.actuator_gainprm[actuator, 0] * model.actuator_ctrlrange[actuator]
        low, high = np.clip(sorted(ends), low, high).tolist()
    return low, high


def _shape(model: "MjModel", geom: int, path: Path) -> LinkShape | None:
    """A piece of geometry; None: it collides with nothing."""
    from mujoco import mjtGeom

    pairs = {*model.pair_geom1.tolist(), *model.pair_geom2.tolist()}
    if not (model.geom_contype[geom] or model.geom_conaffinity[geom] or geom in pairs):
        return None
    kind, size = int(model.geom_type[geom]), tuple(map(float, model.geom_size[geom]))
    pose = _pose(model.geom_pos[geom], model.geom_quat[geom])
    if kind == mjtGeom.mjGEOM_MESH:
        return mesh_shape(_mesh(model, int(model.geom_dataid[geom])), pose)
    if kind == mjtGeom.mjGEOM_ELLIPSOID:
        return mesh_shape(np.asarray(creation.icosphere().triangles * size), pose)
    kinds: dict[int, tuple[ShapeKind, int]] = {
        int(mjtGeom.mjGEOM_BOX): ("box", 3),
        int(mjtGeom.mjGEOM_SPHERE): ("sphere", 1),
        int(mjtGeom.mjGEOM_CYLINDER): ("cylinder", 2),
        int(mjtGeom.mjGEOM_CAPSULE): ("capsule", 2),
    }
    if kind not in kinds:  # a plane or a height field
        body = model.body(int(model.geom_bodyid[geom])).name
        raise SettingError(printable(f"{path}: collision geometry of {body} is of no finite shape"))
    name, count = kinds[kind]
    return LinkShape(name, pose, size[:count])


def _mesh(model: "MjModel", number: int) -> Floats:
    start, count = model.mesh_vertadr[number], model.mesh_vertnum[number]
    first, faces = model.mesh_faceadr[number], model.mesh_facenum[number]
    vertices = np.asarray(model.mesh_vert[start : start + count], np.float64)
    return np.asarray(vertices[model.mesh_face[first : first + faces]])


def _pose(position: Floats, quaternion: Floats) -> Floats:
    """The pose (4, 4) of a position and a quaternion (w, x, y, z)."""
    pose = np.array(transformations.quaternion_matrix(quaternion), dtype=np.float64)
    pose[:3, 3] = position
    return pose
