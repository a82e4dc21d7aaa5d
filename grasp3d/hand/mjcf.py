"""Links and joints of a robot in a MuJoCo model."""

from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from trimesh import creation, transformations

from grasp3d.arrays import Floats
from grasp3d.errors import SettingError
from grasp3d.hand.link_tree import Joint, LinkTree
from grasp3d.system.names import printable

if TYPE_CHECKING:
    from collections.abc import Callable

    from mujoco import MjModel


def read_mjcf(path: Path) -> LinkTree:
    """Read the bodies and joints of a MuJoCo model.

    Geometry that collides with nothing (contype and conaffinity 0) is not read.

    Args:
        path: The file; MuJoCo reads its meshes and included files as well.

    Raises:
        SettingError: MuJoCo cannot read it.
    """
    model = _loaded(path)
    names = [model.body(number).name or f"body {number}" for number in range(model.nbody)]
    joints = {names[number]: _joint(model, number, names) for number in range(1, model.nbody)}
    numbers = {name: number for number, name in enumerate(names)}

    def geometry(name: str) -> Floats:
        first, count = model.body_geomadr[numbers[name]], model.body_geomnum[numbers[name]]
        parts = [_triangles(model, number, path) for number in range(first, first + count)]
        return np.concatenate([np.zeros((0, 3, 3)), *parts])

    return LinkTree(str(path), tuple(names), joints, geometry)


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


def _joint(model: "MjModel", body: int, names: list[str]) -> Joint:
    """The joint that moves a body; of several the first, as a joint that turns it."""
    from mujoco import mjtJoint

    pose = np.eye(4)
    pose[:3, :3] = _rotation(model.body_quat[body])
    pose[:3, 3] = model.body_pos[body]
    parent = names[model.body_parentid[body]]
    number, count = int(model.body_jntadr[body]), int(model.body_jntnum[body])
    name = model.joint(number).name or f"joint {number}" if count else names[body]
    if count == 0:
        return Joint(name, "fixed", parent, pose, np.array([1.0, 0.0, 0.0]), None)
    axis = np.array(model.jnt_axis[number])
    slides = count == 1 and model.jnt_type[number] == mjtJoint.mjJNT_SLIDE
    if slides:
        # The pose of a body in the file is that at the joint's reference value, rarely not 0.
        pose[:3, 3] -= pose[:3, :3] @ axis * float(model.qpos0[model.jnt_qposadr[number]])
    low, high = (float(limit) for limit in model.jnt_range[number])
    limits = (low, high) if model.jnt_limited[number] else None
    kind: Literal["slides", "turns"] = "slides" if slides else "turns"
    return Joint(name, kind, parent, pose, axis, limits, _followed(model, number))


def _followed(model: "MjModel", joint: int) -> tuple[str, float, float] | None:
    """The joint that another joint follows by an equality constraint, with factor and offset."""
    from mujoco import mjtEq

    for number in range(model.neq):
        one, two = int(model.eq_obj1id[number]), int(model.eq_obj2id[number])
        if model.eq_type[number] == mjtEq.mjEQ_JOINT and one == joint and two >= 0:
            offset, factor = (float(value) for value in model.eq_data[number][:2])
            return model.joint(two).name or f"joint {two}", factor, offset
    return None


def _triangles(model: "MjModel", geom: int, path: Path) -> Floats:
    """Corners of a piece of collision geometry in the frame of its body, shape (n, 3, 3)."""
    if not (model.geom_contype[geom] or model.geom_conaffinity[geom]):
        return np.zeros((0, 3, 3))
    triangles = _shape(model, geom)
    if triangles is None:
        body = model.body(int(model.geom_bodyid[geom])).name
        raise SettingError(printable(f"{path}: collision geometry of {body} is of no finite shape"))
    return np.asarray(triangles @ _rotation(model.geom_quat[geom]).T + model.geom_pos[geom])


def _shape(model: "MjModel", geom: int) -> Floats | None:
    """Corners of a shape in its own frame; None: a plane or a height field."""
    from mujoco import mjtGeom

    kind, size = int(model.geom_type[geom]), np.array(model.geom_size[geom])
    if kind == mjtGeom.mjGEOM_MESH:
        return _mesh(model, int(model.geom_dataid[geom]))
    makers: dict[int, Callable[[], Any]] = {
        int(mjtGeom.mjGEOM_BOX): lambda: creation.box(2.0 * size),
        int(mjtGeom.mjGEOM_SPHERE): lambda: creation.icosphere(radius=size[0]),
        int(mjtGeom.mjGEOM_ELLIPSOID): lambda: creation.icosphere().apply_scale(size),
        int(mjtGeom.mjGEOM_CYLINDER): lambda: creation.cylinder(size[0], 2.0 * size[1]),
        int(mjtGeom.mjGEOM_CAPSULE): lambda: _capsule(size[0], 2.0 * size[1]),
    }
    return np.asarray(makers[kind]().triangles) if kind in makers else None


def _capsule(radius: float, length: float) -> Any:
    """A capsule whose cylinder is centred at the origin, along z."""
    shape = creation.capsule(height=length, radius=radius)
    return shape.apply_translation(-shape.bounds.mean(axis=0))


def _mesh(model: "MjModel", number: int) -> Floats:
    start, count = model.mesh_vertadr[number], model.mesh_vertnum[number]
    first, faces = model.mesh_faceadr[number], model.mesh_facenum[number]
    vertices = np.asarray(model.mesh_vert[start : start + count], np.float64)
    return np.asarray(vertices[model.mesh_face[first : first + faces]])


def _rotation(quaternion: Floats) -> Floats:
    """Rotation matrix (3, 3) of a quaternion (w, x, y, z)."""
    return np.asarray(transformations.quaternion_matrix(quaternion)[:3, :3])
