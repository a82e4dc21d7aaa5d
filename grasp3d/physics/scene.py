"""Two fingertips of a gripper and an object of convex parts between them, as a model of MuJoCo.

The tips slide along the closing axis and press with a force. Both move by the same distance, as
those of parallel grippers do, and yield to nothing across the axis. Tips alone are rigid balls;
those of a gripper are its `Fingers`, with the palm.
"""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from grasp3d.arrays import Floats, short_repr
from grasp3d.mesh import ObjectMesh
from grasp3d.physics.engine import IMPEDANCE, STIFFNESS, contact_fields, mujoco_module, new_spec
from grasp3d.physics.fingers import Fingers
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

CLOSING = 0.1
"""Speed of the fingers of a gripper that meet no resistance [m/s]: at that an object that lies with
friction goes on by a millimetre where a finger lets it go."""

FINGER_MASS = 1.0
"""Inertia of a finger with its drive [kg]; what is at rest does not depend on it."""

FASTEST = 0.3
"""Largest angle by which a contact that gives way swings in one time step [rad]."""

GIVING_RATIO = 1e4
"""How much harder friction constrains than the normal does where pads give way. At 10, as of rigid
tips, a pad that bears half of its torsion turns by 0.7 degrees a second: so many contacts are too
many for the iterations without slip; at this it turns by a hundredth of it without any, in half the
time."""

FAR = 10.0
"""Farther than any tip slides [m]."""

LYING = 0.5
"""Friction with which an object lies while it is grasped: a force of its weight times this, and a
torque of the force times a quarter of its size. It does not fly off where one finger comes first.
"""

TIP_BIT = 1
"""Tips and object collide with each other, not among themselves."""


@dataclass(frozen=True)
class Tips:
    """The shape of the tips, and how they touch."""

    radius: float = 0.0
    """Radius of tips that are balls and nothing else [m]."""
    friction: float = 0.5
    """Coulomb coefficient between tips and object."""
    torsion_radius: float = 0.0
    """Largest torsional moment per normal force of a ball [m]; 0: hard fingers."""
    fingers: Fingers | None = None
    """The whole fingers of a gripper, and its palm; None: balls alone."""

    @property
    def speed(self) -> float:
        """Speed at which they close [m/s]."""
        return SPEED if self.fingers is None else CLOSING

    def parts(self, side: float) -> tuple[Floats, Floats, tuple[Floats, ...]]:
        """Centres (k, 3) and radii (k,) of the balls of a tip, and corners of its solids [m].

        Args:
            side: 1: of tip 1; -1: of tip 2.
        """
        if self.fingers is None:
            return np.zeros((1, 3)), np.array([self.radius]), ()
        sides, solids = np.array([side, 1.0, 1.0]), self.fingers.solids
        return (
            self.fingers.centres * sides,
            self.fingers.radii,
            tuple(one * sides for one in solids),
        )

    @property
    def soft(self) -> bool:
        """Whether the tips resist torsion about the line through their contacts."""
        pad = self.fingers is not None and len(self.fingers.radii) > 1
        return self.torsion_radius > 0.0 or pad


def add_tips(
    spec: Any, centres: Floats, tips: Tips, *, mass: float, force: float, until: float = FAR
) -> None:
    """Add the tips, their joints along x, and motors.

    Args:
        spec: A model of MuJoCo.
        centres: Positions of the tips where the joints are 0 [m], shape (2, 3): of the middles of
            balls, or of the planes of pads; tip 1 closes along +x.
        tips: Their shape and friction.
        mass: Mass of each [kg].
        force: Force at which they are damped to their speed [N].
        until: Where their joints end: tips do not pass through each other [m].
    """
    mujoco = mujoco_module()
    for number, name in enumerate(JOINTS):
        body = spec.worldbody.add_body(name=name, pos=centres[number])
        body.explicitinertial = True
        body.mass, body.inertia = mass, (mass, mass, mass)  # they do not turn
        axis = (1.0 if number == 0 else -1.0, 0.0, 0.0)
        body.add_joint(
            name=name,
            type=mujoco.mjtJoint.mjJNT_SLIDE,
            axis=axis,
            damping=[force / tips.speed, 0.0, 0.0],
            limited=mujoco.mjtLimited.mjLIMITED_TRUE,
            range=(-FAR, until),
            solref_limit=STIFFNESS,
            solimp_limit=IMPEDANCE,
        )
        # Friction is that of the tip, not the larger one of both.
        touch = {"priority": 1, "contype": 0, "conaffinity": TIP_BIT << number}
        hard = contact_fields(tips.friction)
        balls = contact_fields(tips.friction, tips.torsion_radius)
        places, radii, solids = tips.parts(1.0 if number == 0 else -1.0)
        for place, radius in zip(places, radii, strict=True):
            sphere = mujoco.mjtGeom.mjGEOM_SPHERE
            body.add_geom(type=sphere, size=(radius, 0.0, 0.0), pos=place, **touch, **balls)
        for count, solid in enumerate(solids):
            add_convex(spec, body, f"{name} solid {count}", solid, **touch, **hard)
        motor = spec.add_actuator(
            name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, gear=[1.0, 0, 0, 0, 0, 0]
        )
        motor.gainprm[0] = 1.0
    equality = spec.add_equality(  # both tips move by the same distance
        type=mujoco.mjtEq.mjEQ_JOINT, name1=JOINTS[0], name2=JOINTS[1],
        objtype=mujoco.mjtObj.mjOBJ_JOINT, solref=STIFFNESS, solimp=IMPEDANCE,
    )  # fmt: skip
    equality.data[:5] = (0.0, 1.0, 0.0, 0.0, 0.0)


def add_convex(spec: Any, body: Any, name: str, vertices: Floats, **fields: Any) -> None:
    """Add a convex part of corners (n, 3) [m] to a body, with fields of its geom."""
    mujoco = mujoco_module()
    mesh = spec.add_mesh(name=name, uservert=vertices.ravel().tolist())
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, **fields)


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
        """The object of a mesh in metres, and of its convex parts.

        Args:
            mesh: The object.
            parts: Its convex parts.
            tips: The tips, in metres.
            settings: Forces, times and limits; lengths in metres.
        """
        extents = np.ptp(mesh.vertices[mesh.faces].reshape(-1, 3), axis=0)
        return cls(parts, mesh.center_mass, extents, tips, settings)

    @property
    def inertia(self) -> Floats:
        """Moments of inertia of the bounding box [kg m^2]: what is at rest depends on none."""
        square = self.extents**2
        return np.asarray(self.settings.object_mass / 12.0 * (square.sum() - square))


def grasp_model(stage: Stage) -> tuple[Any, Any]:
    """MuJoCo's model and data of tips on the x axis, and of the object as a free body.

    The tips are at the origin while their joints are 0: joints of -a put both a distance 2 a apart.
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
        touched = {"contype": TIP_BIT | TIP_BIT << 1, "conaffinity": 0}
        add_convex(spec, body, f"part {number}", vertices, **touched, **touch)
    if tips.fingers is not None:
        met = {"priority": 1, "contype": 0, "conaffinity": TIP_BIT}
        hard = contact_fields(tips.friction)
        add_convex(spec, spec.worldbody, "palm", tips.fingers.palm, **met, **hard)
    add_tips(
        spec,
        np.zeros((2, 3)),
        tips,
        mass=settings.object_mass if tips.fingers is None else FINGER_MASS,
        force=settings.force,
        until=-tips.radius,
    )
    if tips.fingers is not None:
        spec.option.impratio, spec.option.noslip_iterations = GIVING_RATIO, 0
    model = spec.compile()
    model.dof_damping[3:6] = SPIN_LEVER * settings.weight
    if tips.fingers is not None:
        _give_way(model, tips.fingers.stiffness)
    return model, mujoco.MjData(model)


def _give_way(model: Any, stiffness: float) -> None:
    """Set the stiffness of every ball [N/m].

    MuJoCo states stiffness per mass, and at rest a contact of impedance d resists more than in
    motion: its force is `stiffness x depth / ((1 - d) A)`, A the sum of the inverse inertias of
    both bodies; its acceleration is `stiffness x depth / d`. The impedance is as near to 1/2 as
    the time step allows.
    """
    mujoco = mujoco_module()
    inverse = sum(model.body_invweight0[model.body(name).id, 0] for name in (OBJECT, JOINTS[0]))
    fastest = (FASTEST / model.opt.timestep) ** 2
    impedance = max(0.5, 1.0 / (1.0 + fastest / (stiffness * inverse)))
    per_mass = stiffness * inverse * (1.0 - impedance)
    balls = model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE
    model.geom_solref[balls] = -per_mass, -2.0 * math.sqrt(per_mass * impedance)
    model.geom_solimp[balls, :2] = impedance


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
        model.geom_friction[model.geom_bodyid == model.body(name).id, 0] = friction[number]
    mujoco.mj_setConst(model, data)
    mujoco.mj_resetData(model, data)
    rotation, origin = pose[:3, :3], pose[:3, 3]
    data.qpos[:3] = -rotation.T @ origin
    mujoco.mju_mat2Quat(data.qpos[3:7], np.ascontiguousarray(rotation.T).ravel())


def lay_object(model: Any, stage: Stage | None) -> None:
    """Let the object lie with friction in all directions, or float.

    Args:
        model: MuJoCo's model; changed.
        stage: The object; None: it floats.
    """
    force = 0.0 if stage is None else LYING * stage.settings.weight
    lever = 0.0 if stage is None else 0.25 * float(np.linalg.norm(stage.extents))
    model.dof_frictionloss[:3] = force / math.sqrt(3.0)
    model.dof_frictionloss[3:6] = force * lever / math.sqrt(3.0)
