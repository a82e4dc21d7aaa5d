"""Two fingertips of a gripper and an object of convex parts between them, as a model of MuJoCo.

The tips slide along the closing axis and press with a force. Both move by the same distance, as
those of parallel grippers do, and yield to nothing across the axis. Only the tips touch the object:
fingers and palm are left out.
"""

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from grasp3d.arrays import Floats, short_repr
from grasp3d.hand.jaws import metres_per_unit
from grasp3d.mesh import ObjectMesh
from grasp3d.physics.engine import IMPEDANCE, STIFFNESS, contact_fields, mujoco_module, new_spec
from grasp3d.physics.parts import ConvexParts
from grasp3d.physics.simulation_settings import SimulationSettings

OBJECT = "object"

SPIN_LEVER = 1e-3
"""Lever at which the object's weight turns it by 1 rad/s against the drag on its turning [m]. Drag
does not change where anything is at rest; without it the free spin about the line of two hard
fingers would grow from rounding."""

JOINTS = ("tip 1", "tip 2")
"""Names of the tips' joints and motors; positive is closing."""

SPEED = 0.5
"""Speed of tips that meet no resistance [m/s]: their damping is force over speed, and does not
change where anything comes to rest."""

FAR = 10.0
"""Farther than any tip slides [m]."""

TIP_BIT = 1
"""Tips and object collide with each other, not among themselves."""


@dataclass(frozen=True)
class Tips:
    """The shape of the tips, and how they touch."""

    radius: float
    """Radius of round tips [m]; 0: flat pads."""
    friction: float = 0.5
    """Coulomb coefficient between tips and object."""
    torsion_radius: float = 0.0
    """Largest torsional moment per normal force [m]; 0: hard fingers."""
    pad: tuple[float, float, float] = (0.0, 0.0, 0.0)
    """Size of flat pads along x, y and z [m]."""

    @property
    def depth(self) -> float:
        """From the middle of a tip to where it touches [m]."""
        return self.radius or 0.5 * self.pad[0]


def add_tips(
    spec: Any, centres: Floats, tips: Tips, *, mass: float, force: float, until: float = FAR
) -> None:
    """Add the tips, their joints along x, and motors.

    Args:
        spec: A model of MuJoCo.
        centres: Positions of the tips' middles where the joints are 0 [m], shape (2, 3); tip 1
            closes along +x.
        tips: Their shape and friction.
        mass: Mass of each [kg].
        force: Force at which they are damped to `SPEED` [N].
        until: Where their joints end: tips do not pass through each other [m].
    """
    mujoco = mujoco_module()
    shape = (
        {"type": mujoco.mjtGeom.mjGEOM_SPHERE, "size": (tips.radius, 0.0, 0.0)}
        if tips.radius
        else {"type": mujoco.mjtGeom.mjGEOM_BOX, "size": tuple(0.5 * one for one in tips.pad)}
    )
    for number, name in enumerate(JOINTS):
        body = spec.worldbody.add_body(name=name, pos=centres[number])
        body.explicitinertial = True
        body.mass, body.inertia = mass, (mass, mass, mass)  # they do not turn
        axis = (1.0 if number == 0 else -1.0, 0.0, 0.0)
        body.add_joint(
            name=name,
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=axis,
            damping=[force / SPEED, 0.0, 0.0],
            limited=mujoco.mjtLimited.mjLIMITED_TRUE,
            range=(-FAR, until),
            solref_limit=STIFFNESS,
            solimp_limit=IMPEDANCE,
        )
        body.add_geom(
            name=name,
            priority=1,  # friction is that of the tip, not the larger one of both
            contype=0,
            conaffinity=TIP_BIT << number,
            **shape,
            **contact_fields(tips.friction, tips.torsion_radius),
        )
        motor = spec.add_actuator(
            name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, gear=[1.0, 0, 0, 0, 0, 0]
        )
        motor.gainprm[0] = 1.0
    equality = spec.add_equality(  # both tips move by the same distance
        type=mujoco.mjtEq.mjEQ_JOINT, name1=JOINTS[0], name2=JOINTS[1],
        objtype=mujoco.mjtObj.mjOBJ_JOINT, solref=STIFFNESS, solimp=IMPEDANCE,
    )  # fmt: skip
    equality.data[:5] = (0.0, 1.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True, eq=False)
class Stage:
    """What all grasps of an object have in common; lengths in metres, in the mesh's frame."""

    parts: ConvexParts
    center: Floats
    """Centre of mass, shape (3,)."""
    extents: Floats
    """Sides of its bounding box, whose moments of inertia it has, shape (3,)."""
    tips: Tips
    settings: SimulationSettings

    __repr__ = short_repr

    @classmethod
    def of(
        cls, mesh: ObjectMesh, parts: ConvexParts, tips: Tips, settings: SimulationSettings
    ) -> "Stage":
        """The object of a mesh whose unit is known, and of its convex parts in that unit.

        Args:
            mesh: The object.
            parts: Its convex parts.
            tips: The tips, in metres.
            settings: Forces, times and limits; lengths in metres.
        """
        scale = metres_per_unit(mesh)
        return cls(
            replace(parts, vertices=tuple(scale * one for one in parts.vertices)),
            scale * mesh.center_mass,
            scale * np.ptp(mesh.vertices[mesh.faces].reshape(-1, 3), axis=0),
            tips,
            settings,
        )

    @property
    def inertia(self) -> Floats:
        """Moments of inertia of the bounding box [kg m^2]: what is at rest depends on none."""
        square = self.extents**2
        return np.asarray(self.settings.object_mass / 12.0 * (square.sum() - square))


def grasp_model(stage: Stage) -> tuple[Any, Any]:
    """MuJoCo's model and data of tips on the x axis, and of the object as a free body.

    The tips' middles are at the origin while their joints are 0: joints of -a put both a distance
    2 a apart.
    """
    tips, settings = stage.tips, stage.settings
    mujoco = mujoco_module()
    spec = new_spec(settings.time_step)
    body = spec.worldbody.add_body(name=OBJECT)
    body.add_freejoint()
    body.explicitinertial = True
    body.mass = settings.object_mass
    # Away from the origin: MuJoCo compiles bodies whose centre of mass is there for good.
    body.ipos = stage.center + stage.extents
    body.inertia = stage.inertia
    touch = contact_fields(tips.friction, tips.torsion_radius)
    for number, vertices in enumerate(stage.parts.vertices):
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
