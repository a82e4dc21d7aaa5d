"""A gripper and an object of convex parts between its fingers, as a model of MuJoCo.

The fingers slide along the closing axis and press with a force. Both move by the same distance, as
those of parallel grippers do, and yield to nothing across the axis.
"""

import math
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from grasp3d.arrays import Floats, short_repr
from grasp3d.mesh import ObjectMesh
from grasp3d.outcomes.engine import IMPEDANCE, STIFFNESS, contact_fields, new_spec
from grasp3d.outcomes.fingers import Fingers
from grasp3d.outcomes.simulation_settings import SimulationSettings

OBJECT = "object"

SPIN_LEVER = 1e-3
"""Lever at which the object's weight turns it by 1 rad/s against the drag on its turning [m]. Drag
does not change where anything is at rest; without it the free spin about the line of two hard
fingers would grow from rounding."""

JOINTS = ("tip 1", "tip 2")
"""Names of the fingers' bodies, joints and motors; positive is closing."""

CLOSING = 0.1
"""Speed of fingers that meet no resistance [m/s]: at that an object that lies with friction goes on
by a millimetre where a finger lets it go. Their damping is force over speed, and does not change
where anything comes to rest."""

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
"""Farther than any finger slides [m]."""

LYING = 0.5
"""Friction with which an object lies while it is grasped: a force of its weight times this, and a
torque of the force times a quarter of its size. It does not fly off where one finger comes first.
"""

TIP_BIT = 1
"""Fingers and object collide with each other, not among themselves."""


@dataclass(frozen=True, eq=False)
class Stage:
    """What all grasps of an object have in common; lengths in metres, in the mesh's frame."""

    parts: tuple[Floats, ...]
    """Corners of its convex parts, shape (n, 3) each."""
    center: Floats
    """Centre of mass, shape (3,)."""
    extents: Floats
    """Sides of its bounding box, whose moments of inertia it has, shape (3,)."""
    fingers: Fingers
    settings: SimulationSettings
    force: float
    """Of each finger along the closing axis [N]."""

    __repr__ = short_repr

    @classmethod
    def of(
        cls, mesh: ObjectMesh, parts: tuple[Floats, ...], fingers: Fingers,
        settings: SimulationSettings, force: float,
    ) -> "Stage":  # fmt: skip
        """The object of a mesh and of its convex parts, and a gripper."""
        extents = np.ptp(mesh.vertices[mesh.faces].reshape(-1, 3), axis=0)
        return cls(parts, mesh.center_mass, extents, fingers, settings, force)


def add_fingers(spec: Any, centres: Floats, fingers: Fingers, force: float) -> None:
    """Add the fingers, their joints along x, and motors.

    Args:
        spec: A model of MuJoCo.
        centres: Positions of the fingers where the joints are 0 [m], shape (2, 3); finger 1 closes
            along +x.
        fingers: Their shape.
        force: Force at which they are damped to their speed [N].
    """
    hard, balls = contact_fields(), contact_fields(fingers.torsion_radius)
    for number, (name, side) in enumerate(zip(JOINTS, (1.0, -1.0), strict=True)):
        body = spec.worldbody.add_body(name=name, pos=centres[number])
        body.explicitinertial = True
        body.mass, body.inertia = FINGER_MASS, (FINGER_MASS,) * 3  # they do not turn
        body.add_joint(
            name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(side, 0.0, 0.0),
            damping=[force / CLOSING, 0.0, 0.0], limited=mujoco.mjtLimited.mjLIMITED_TRUE,
            range=(-FAR, 0.0), solref_limit=STIFFNESS, solimp_limit=IMPEDANCE,
        )  # fmt: skip
        # Friction is that of the finger, not the larger one of both.
        touch = {"priority": 1, "contype": 0, "conaffinity": TIP_BIT << number}
        mirrored = np.array([side, 1.0, 1.0])
        for place, radius in zip(fingers.centres * mirrored, fingers.radii, strict=True):
            sphere = mujoco.mjtGeom.mjGEOM_SPHERE
            body.add_geom(type=sphere, size=(radius, 0.0, 0.0), pos=place, **touch, **balls)
        for count, solid in enumerate(fingers.solids):
            _add_convex(spec, body, f"{name} solid {count}", solid * mirrored, **touch, **hard)
        motor = spec.add_actuator(
            name=name, target=name, trntype=mujoco.mjtTrn.mjTRN_JOINT, gear=[1.0, 0, 0, 0, 0, 0]
        )
        motor.gainprm[0] = 1.0
    equality = spec.add_equality(  # both move by the same distance
        type=mujoco.mjtEq.mjEQ_JOINT, name1=JOINTS[0], name2=JOINTS[1],
        objtype=mujoco.mjtObj.mjOBJ_JOINT, solref=STIFFNESS, solimp=IMPEDANCE,
    )  # fmt: skip
    equality.data[:5] = (0.0, 1.0, 0.0, 0.0, 0.0)


def _add_convex(spec: Any, body: Any, name: str, vertices: Floats, **fields: Any) -> None:
    """Add a convex part of corners (n, 3) [m] to a body, with fields of its geom."""
    mesh = spec.add_mesh(name=name, uservert=vertices.ravel().tolist())
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, **fields)


def grasp_model(stage: Stage) -> tuple[Any, Any]:
    """MuJoCo's model and data of fingers on the x axis, and of the object as a free body.

    The planes of the pads are at the origin while their joints are 0: joints of -a put both a
    distance 2 a apart.
    """
    settings = stage.settings
    spec = new_spec(settings.time_step)
    spec.option.impratio, spec.option.noslip_iterations = GIVING_RATIO, 0
    body = spec.worldbody.add_body(name=OBJECT)
    body.add_freejoint()
    body.explicitinertial = True
    body.mass = settings.object_mass
    body.ipos = stage.center
    square = stage.extents**2
    body.inertia = settings.object_mass / 12.0 * (square.sum() - square)
    touched = {"contype": TIP_BIT | TIP_BIT << 1, "conaffinity": 0}
    for number, vertices in enumerate(stage.parts):
        _add_convex(spec, body, f"part {number}", vertices, **touched, **contact_fields())
    met = {"priority": 1, "contype": 0, "conaffinity": TIP_BIT}
    _add_convex(spec, spec.worldbody, "palm", stage.fingers.palm, **met, **contact_fields())
    add_fingers(spec, np.zeros((2, 3)), stage.fingers, stage.force)
    model = spec.compile()
    model.dof_damping[3:6] = SPIN_LEVER * settings.weight
    _give_way(model, stage.fingers.stiffness)
    return model, mujoco.MjData(model)


def _give_way(model: Any, stiffness: float) -> None:
    """Set the stiffness of every ball [N/m].

    MuJoCo states stiffness per mass, and at rest a contact of impedance d resists more than in
    motion: its force is `stiffness x depth / ((1 - d) A)`, A the sum of the inverse inertias of
    both bodies; its acceleration is `stiffness x depth / d`. The impedance is as near to 1/2 as
    the time step allows.
    """
    inverse = sum(model.body_invweight0[model.body(name).id, 0] for name in (OBJECT, JOINTS[0]))
    fastest = (FASTEST / model.opt.timestep) ** 2
    impedance = max(0.5, 1.0 / (1.0 + fastest / (stiffness * inverse)))
    per_mass = stiffness * inverse * (1.0 - impedance)
    balls = model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE
    model.geom_solref[balls] = -per_mass, -2.0 * math.sqrt(per_mass * impedance)
    model.geom_solimp[balls, :2] = impedance


def put_object(model: Any, data: Any, pose: Floats, friction: float) -> None:
    """Put the object where a gripper's pose wants it.

    Args:
        model: MuJoCo's model; gets the friction.
        data: Its data; reset.
        pose: Matrix that takes the gripper's coordinates to the object's [m], shape (4, 4).
        friction: Coulomb coefficient.
    """
    model.geom_friction[:, 0] = friction
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
