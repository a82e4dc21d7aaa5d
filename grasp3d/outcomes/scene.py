"""A gripper and an object of convex parts between its fingers, as a model of MuJoCo.

The fingers slide along the closing axis and press with a force. Both move by the same distance, as
those of parallel grippers do, and yield to nothing across the axis.

MuJoCo's settings are such that pressed contacts behave as dry friction does. The gripper is made of
bodies that collide: pads of balls that give way, rigid fingers behind, and a palm.

A pad of rubber gives way where something presses on it, and there alone. So a pad is a bed of balls
that are tangent to its face, each with its share of the pad's stiffness (a Winkler foundation): the
patch grows with the force and with the curvature of what is touched, and torsion and rolling follow
from where the balls press. Balls at the border are smaller, so that the pad ends where it ends,
with an edge as round as that of moulded rubber.

Lengths are in metres, in the gripper's frame: finger 1 closes along +x, finger 2 mirrors it.
"""

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np

from grasp3d.arrays import Floats, locked, short_repr
from grasp3d.hand.closing import inner_faces
from grasp3d.hand.jaws import FLATNESS, Corners, Jaws
from grasp3d.hand.triangles import PAD_DEPTH
from grasp3d.mesh import ObjectMesh
from grasp3d.outcomes.simulation_settings import SimulationSettings

TIME_STEP = 1e-3
"""Default step of the simulation [s]."""

STIFFNESS = (0.004, 1.0)
"""Time constant [s] and damping ratio of contacts (`solref`): four steps, as stiff as is stable."""

IMPEDANCE = (0.99, 0.99, 0.001, 0.5, 2.0)
"""`solimp`: contacts yield by a hundredth of what they would without constraint."""

IMPEDANCE_RATIO = 10.0
"""How much harder friction constrains than the normal does; at MuJoCo's 1 contacts creep."""

NOSLIP_ITERATIONS = 10
"""Iterations of the solver that removes the creep that is left, of soft friction."""


@contextmanager
def without_log() -> Iterator[None]:
    """Keep MuJoCo from writing a file of warnings into the working folder.

    A simulation that diverges is a result, which states it.
    """
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(_ignore)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


def _ignore(_warning: str) -> None:
    """Do nothing with a warning."""


def new_spec(time_step: float = TIME_STEP) -> Any:
    """An empty MuJoCo model without gravity, whose contacts behave as dry friction.

    MuJoCo's friction is a soft constraint. With its defaults (pyramidal cones, as hard as the
    normals, no further iterations) a contact well inside its friction cone creeps by centimetres
    per second; with elliptic cones, friction that is harder than the normal, and iterations without
    slip it stands still to micrometres, and slides beyond the cone.

    Args:
        time_step: Step [s].
    """
    spec = mujoco.MjSpec()
    option = spec.option
    option.timestep = time_step
    option.gravity = (0.0, 0.0, 0.0)
    option.integrator = mujoco.mjtIntegrator.mjINT_IMPLICITFAST
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = IMPEDANCE_RATIO
    option.noslip_iterations = NOSLIP_ITERATIONS
    option.noslip_tolerance = 1e-10
    option.tolerance = 1e-12
    option.iterations = 200
    return spec


def contact_fields(torsion_radius: float = 0.0) -> dict[str, Any]:
    """Fields of a geom for contacts whose friction is set in the compiled model.

    Args:
        torsion_radius: Largest torsional moment per normal force [m]; MuJoCo's elliptic cone with
            it is the limit surface (f_t / friction)^2 + (moment / radius)^2 <= f_n^2 of Howe &
            Cutkosky (IJRR 1996). 0: a hard finger.
    """
    return {
        "friction": (1.0, torsion_radius, 0.0),
        "condim": 4 if torsion_radius > 0.0 else 3,
        "solref": STIFFNESS,
        "solimp": IMPEDANCE,
    }


SPACING = 3e-3
"""Largest distance of neighbouring balls [m]."""

ROUNDEST = 6e-3
"""Largest radius of a ball [m]: the pad's face is bumpy by SPACING^2 / (8 radius), 0.2 mm."""

INSET = 1.5e-3
"""Distance of the outermost balls from the border [m]."""

PROTRUDING = 5e-4
"""How far a ball reaches past the border, behind the face [m]: pressed in by a few tenths of a
millimetre it touches up to the border."""


@dataclass(frozen=True, eq=False)
class Fingers:
    """What touches of a gripper."""

    centres: Floats
    """Centres of the balls of finger 1, with the pad's plane at x = 0, shape (k, 3)."""
    radii: Floats
    """Their radii, shape (k,)."""
    stiffness: float
    """Of each ball [N/m]."""
    torsion_radius: float
    """Largest torsional moment per normal force of a ball [m]; 0: hard."""
    solids: tuple[Floats, ...]
    """Corners of the convex rigid parts of finger 1, shape (n, 3) each."""
    palm: Floats
    """Corners of the palm, shape (8, 3)."""

    __repr__ = short_repr

    @property
    def soft(self) -> bool:
        """Whether they resist torsion about the line through their contacts."""
        return self.torsion_radius > 0.0 or len(self.radii) > 1

    @classmethod
    def of(cls, jaws: Jaws, stiffness: float, torsion_radius: float = 0.0) -> "Fingers":
        """The fingers of a gripper.

        Args:
            jaws: The gripper.
            stiffness: Of a pad, or a round tip [N/m].
            torsion_radius: Of a round tip [m]; torsion on pads follows from where they are touched.
        """
        front = jaws.end - jaws.finger_length
        palm = _box(
            (-0.5 * jaws.palm_thickness, 0.5 * jaws.palm_thickness),
            (-0.5 * jaws.palm_width, 0.5 * jaws.palm_width),
            (front - jaws.palm_length, front),
        )
        finger = (-0.5 * jaws.finger_width, 0.5 * jaws.finger_width), (front, jaws.end)
        if jaws.round_tips:
            middle, half = -jaws.tip_radius, 0.5 * jaws.finger_thickness
            solid = _box((middle - half, middle + half), *finger)
            return cls(
                locked(np.array([[middle, 0.0, 0.0]])), locked(np.array([jaws.tip_radius])),
                stiffness, torsion_radius, (locked(solid),), locked(palm),
            )  # fmt: skip
        thickness = jaws.tip_thickness or jaws.finger_thickness
        depth = PAD_DEPTH * thickness
        beds = [_bed(face, 0.5 * thickness) for face in inner_faces(jaws)]
        y, z = (_spread(-0.5 * side, 0.5 * side) for side in (jaws.pad_width, jaws.pad_height))
        if jaws.inner_faces:
            solids = tuple(_behind(face, depth, jaws) for face in jaws.inner_faces)
        else:
            solids = (_box((-jaws.finger_thickness, -depth), *finger),)
        return cls(
            locked(np.concatenate([centres for centres, _ in beds])),
            locked(np.concatenate([radii for _, radii in beds])),
            stiffness / (len(y) * len(z)),
            0.0,
            tuple(map(locked, solids)),
            locked(palm),
        )


def _box(*bounds: tuple[float, float]) -> Floats:
    """Corners of a box (8, 3)."""
    return np.stack(np.meshgrid(*bounds), axis=-1).reshape(-1, 3)


def _bed(face: Corners, largest: float) -> tuple[Floats, Floats]:
    """Centres (k, 3) and radii (k,) of balls that are tangent to a face from behind."""
    corners = np.array(face)
    plane, inward = corners[:, 1:], _inward(corners[:, 1:])
    low, high = plane.min(axis=0), plane.max(axis=0)
    axes = [_spread(one, two) for one, two in zip(low, high, strict=True)]
    grid = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 2)
    sides = zip(plane, inward, strict=True)
    inside = np.min([(grid - corner) @ normal for corner, normal in sides], axis=0)
    kept = inside > 0.5 * INSET
    grid, inside = grid[kept], inside[kept]
    columns = np.column_stack([np.ones(len(corners)), plane])
    slope = np.linalg.lstsq(columns, corners[:, 0])[0]  # x = a + b y + c z
    normal = np.array([1.0, -slope[1], -slope[2]]) / math.hypot(1.0, *slope[1:])
    points = np.column_stack([slope[0] + grid @ slope[1:], grid])
    radii = np.minimum(inside + PROTRUDING, min(ROUNDEST, largest))
    return points - radii[:, None] * normal, radii


def _spread(low: float, high: float) -> Floats:
    """Positions between two borders, evenly, with an inset."""
    inset = min(INSET, 0.25 * (high - low))
    return np.linspace(
        low + inset, high - inset, 1 + math.ceil((high - low - 2.0 * inset) / SPACING)
    )


def _inward(outline: Floats) -> Floats:
    """Inward unit normals (n, 2) of the sides, which begin at the corners, of a convex outline."""
    along = np.roll(outline, -1, axis=0) - outline
    x, y = outline.T
    turn = 1.0 if x @ np.roll(y, -1) > y @ np.roll(x, -1) else -1.0
    normals = turn * np.stack([-along[:, 1], along[:, 0]], axis=1)
    return np.asarray(normals / np.linalg.norm(normals, axis=1, keepdims=True))


def _behind(face: Corners, depth: float, jaws: Jaws) -> Floats:
    """Corners (2 n, 3) of the rigid part of a finger behind a face."""
    near = np.array(face) - [depth, 0.0, 0.0]
    at_pad = near[:, 0].min() > -depth - FLATNESS
    thickness = (jaws.tip_thickness if at_pad else None) or jaws.finger_thickness
    far = near.copy()
    far[:, 0] = np.minimum(-thickness, near[:, 0] - depth)
    return np.concatenate([near, far])


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
