"""An object of convex parts between two fingertips, as a model of MuJoCo."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from grasp3d.arrays import Floats, short_repr
from grasp3d.physics.engine import contact_fields, mujoco_module, new_spec
from grasp3d.physics.hand import JOINTS, TIP_BIT, Tips, add_tips
from grasp3d.physics.parts import ConvexParts
from grasp3d.physics.simulation_settings import SimulationSettings

OBJECT = "object"

SPIN_LEVER = 1e-3
"""Lever at which the object's weight turns it by 1 rad/s against the drag on its turning [m]. Drag
does not change where anything is at rest; without it the free spin about the line of two hard
fingers would grow from rounding."""


@dataclass(frozen=True, eq=False)
class SimulatedObject:
    """What is simulated of an object; lengths in metres, in the mesh's frame."""

    parts: ConvexParts
    center: Floats
    """Centre of mass, shape (3,)."""
    extents: Floats
    """Sides of its bounding box, whose moments of inertia it has, shape (3,)."""

    __repr__ = short_repr

    def inertia(self, mass: float) -> Floats:
        """Moments of inertia of the bounding box [kg m^2]: what is at rest depends on none."""
        square = self.extents**2
        return np.asarray(mass / 12.0 * (square.sum() - square))


def grasp_model(
    thing: SimulatedObject, tips: Tips, settings: SimulationSettings
) -> "tuple[Any, Any]":
    """MuJoCo's model and data of tips on the x axis, and of the object as a free body.

    The tips' middles are at the origin while their joints are 0: joints of -a put both a distance
    2 a apart.

    Args:
        thing: The object.
        tips: The tips.
        settings: Masses and forces.
    """
    mujoco = mujoco_module()
    spec = new_spec(settings.time_step)
    body = spec.worldbody.add_body(name=OBJECT)
    body.add_freejoint()
    body.explicitinertial = True
    body.mass = settings.object_mass
    # Away from the origin: MuJoCo compiles bodies whose centre of mass is there for good.
    body.ipos = thing.center + thing.extents
    body.inertia = thing.inertia(settings.object_mass)
    touch = contact_fields(tips.friction, tips.torsion_radius)
    for number, vertices in enumerate(thing.parts.vertices):
        name = f"part {number}"
        mesh = spec.add_mesh(name=name, uservert=vertices.ravel().tolist())
        mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=name,
            contype=TIP_BIT | TIP_BIT << 1,
            conaffinity=0,
            **touch,
        )
    add_tips(
        spec,
        np.zeros((2, 3)),
        tips,
        mass=settings.object_mass,
        force=settings.force,
        until=-tips.depth,
    )
    model = spec.compile()
    model.dof_damping[3:6] = SPIN_LEVER * settings.weight
    return model, mujoco.MjData(model)


def put_object(model: Any, data: Any, pose: Floats, center: Floats, friction: Floats) -> None:
    """Put the object where a gripper's pose wants it, and set what differs between grasps.

    Args:
        model: MuJoCo's model; changed.
        data: Its data; reset.
        pose: Matrix that takes the gripper's coordinates to the object's [m], shape (4, 4).
        center: Centre of mass in the object's frame [m], shape (3,).
        friction: Coulomb coefficient of each tip, shape (2,).
    """
    mujoco = mujoco_module()
    model.body(OBJECT).ipos[:] = center
    for number, name in enumerate(JOINTS):
        model.geom(name).friction[0] = friction[number]
    mujoco.mj_setConst(model, data)
    mujoco.mj_resetData(model, data)
    rotation, origin = pose[:3, :3], pose[:3, 3]
    data.qpos[:3] = -rotation.T @ origin
    mujoco.mju_mat2Quat(data.qpos[3:7], np.ascontiguousarray(rotation.T).ravel())
