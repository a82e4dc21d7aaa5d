"""MuJoCo model of a gripper with an object of convex parts between its fingers.

The fingers slide along the closing axis and press with a force. Both move by the same distance,
like those of a parallel gripper, and are rigid across the axis.

MuJoCo's settings make pressed contacts behave like dry friction. The gripper consists of colliding
bodies: pads of balls that give way, rigid fingers behind them, and a palm.

A rubber pad gives way only where something presses on it. So a pad is a bed of balls tangent to its
face, each with its part of the pad's stiffness (a Winkler foundation): the patch grows with the
force and the curvature of the object, and torsion and rolling resistance follow from where the
balls press. Balls at the border are smaller, so that the pad ends at its true edge, as round as
that of moulded rubber.

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
"""`solimp`: contacts yield by a hundredth of what they would yield without the constraint."""

IMPEDANCE_RATIO = 10.0
"""Ratio of the hardness of friction to that of the normal; with MuJoCo's 1, contacts creep."""

NOSLIP_ITERATIONS = 10
"""Iterations of the solver that removes the remaining creep, which soft friction causes."""


@contextmanager
def without_log() -> Iterator[None]:
    """Keep MuJoCo from writing a file of warnings into the working folder.

    A diverged simulation is reported as a result instead.
    """
    before = mujoco.get_mju_user_warning()
    mujoco.set_mju_user_warning(_ignore)
    try:
        yield
    finally:
        mujoco.set_mju_user_warning(before)


def _ignore(_warning: str) -> None:
    """Ignore a warning."""


def new_spec(time_step: float = TIME_STEP) -> Any:
    """Return an empty MuJoCo model without gravity, with contacts that behave like dry friction.

    MuJoCo's friction is a soft constraint. With its defaults (pyramidal cones, friction as hard as
    the normals, no further iterations) a contact well inside its friction cone creeps by
    centimetres per second. With elliptic cones, harder friction and no-slip iterations it stands
    still to within micrometres, and slides only beyond the cone.

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
    """Return fields of a geom for contacts whose friction is set in the compiled model.

    Args:
        torsion_radius: Largest torsional moment per normal force [m]; 0: a hard finger. With it
            MuJoCo's elliptic cone is the limit surface (f_t / friction)^2 + (moment / radius)^2 <=
            f_n^2 of Howe & Cutkosky (IJRR 1996).
    """
    return {
        "friction": (1.0, torsion_radius, 0.0),
        "condim": 4 if torsion_radius > 0.0 else 3,
        "solref": STIFFNESS,
        "solimp": IMPEDANCE,
    }


SPACING = 3e-3
"""Largest distance between neighbouring balls [m]."""

ROUNDEST = 6e-3
"""Largest radius of a ball [m]; the pad's face has bumps of SPACING^2 / (8 radius), 0.2 mm."""

INSET = 1.5e-3
"""Distance of the outermost balls from the border [m]."""

PROTRUDING = 5e-4
"""Reach of a ball past the border, behind the face [m]: pressed in by a few tenths of a millimetre,
it touches up to the border."""


@dataclass(frozen=True, eq=False)
class Fingers:
    """Parts of a gripper that can touch the object."""

    centres: Floats
    """Centres of the balls of finger 1, with the pad's plane at x = 0, shape (k, 3)."""
    radii: Floats
    """Radii of the balls, shape (k,)."""
    stiffness: float
    """Stiffness of each ball [N/m]."""
    torsion_radius: float
    """Largest torsional moment per normal force of a ball [m]; 0: a hard finger."""
    solids: tuple[Floats, ...]
    """Corners of the convex rigid parts of finger 1, shape (n, 3) each."""
    palm: Floats
    """Corners of the palm, shape (8, 3)."""

    __repr__ = short_repr

    @property
    def soft(self) -> bool:
        """Whether the fingers resist torsion about the line through their contacts."""
        return self.torsion_radius > 0.0 or len(self.radii) > 1

    @classmethod
    def of(cls, jaws: Jaws, stiffness: float, torsion_radius: float = 0.0) -> "Fingers":
        """Return the fingers of a gripper.

        Args:
            jaws: The gripper.
            stiffness: Stiffness of a pad, or of a round tip [N/m].
            torsion_radius: Torsion radius of a round tip [m]; not used for pads.
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
    """Corners of a box, shape (8, 3)."""
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
    """Evenly spaced positions between two borders, with an inset."""
    inset = min(INSET, 0.25 * (high - low))
    return np.linspace(
        low + inset, high - inset, 1 + math.ceil((high - low - 2.0 * inset) / SPACING)
    )


def _inward(outline: Floats) -> Floats:
    """Inward unit normals (n, 2) of the sides of a convex outline; each starts at its corner."""
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
"""Lever at which the object's weight turns it at 1 rad/s against the drag on its rotation [m]. Drag
does not change any state of rest; without it, rounding would start a free spin about the line of
two hard fingers."""

JOINTS = ("tip 1", "tip 2")
"""Names of the fingers' bodies, joints and motors; positive is closing."""

CLOSING = 0.1
"""Speed of unloaded fingers [m/s]. At this speed an object that lies with friction moves on by a
millimetre where a finger lets it go. The fingers' damping is force over speed, and does not change
where anything comes to rest."""

FINGER_MASS = 1.0
"""Inertia of a finger with its drive [kg]; states of rest do not depend on it."""

FASTEST = 0.3
"""Largest angle by which a compliant contact oscillates in one time step [rad]."""

GIVING_RATIO = 1e4
"""Ratio of the hardness of friction to that of the normal where pads give way. With the 10 of rigid
tips, a pad that bears half of its torsion turns by 0.7 degrees a second, as the no-slip iterations
cannot cope with so many contacts. With this ratio and no such iterations it turns by a hundredth of
that, in half the time."""

FAR = 10.0
"""Distance beyond the travel of any finger [m]."""

LYING = 0.5
"""Friction coefficient of the object where it lies during the grasp: the friction force is this
times its weight, the torque this force times a quarter of its size. So the object does not fly off
when one finger comes first."""

TIP_BIT = 1
"""Collision bit: fingers and object collide with each other, but not among themselves."""


@dataclass(frozen=True, eq=False)
class Stage:
    """Data common to all grasps of an object; lengths in metres, in the mesh's frame."""

    parts: tuple[Floats, ...]
    """Corners of the object's convex parts, shape (n, 3) each."""
    center: Floats
    """Centre of mass, shape (3,)."""
    extents: Floats
    """Sides of its bounding box, which sets the moments of inertia, shape (3,)."""
    fingers: Fingers
    settings: SimulationSettings
    force: float
    """Force of each finger along the closing axis [N]."""

    __repr__ = short_repr

    @classmethod
    def of(
        cls, mesh: ObjectMesh, parts: tuple[Floats, ...], fingers: Fingers,
        settings: SimulationSettings, force: float,
    ) -> "Stage":  # fmt: skip
        """Return the stage for a gripper and the object of a mesh, in convex parts."""
        extents = np.ptp(mesh.vertices[mesh.faces].reshape(-1, 3), axis=0)
        return cls(parts, mesh.center_mass, extents, fingers, settings, force)


def add_fingers(spec: Any, centres: Floats, fingers: Fingers, force: float) -> None:
    """Add the fingers, their joints along x, and motors.

    Args:
        spec: A MuJoCo model.
        centres: Positions of the fingers where the joints are 0 [m], shape (2, 3); finger 1 closes
            along +x.
        fingers: Shape of the fingers.
        force: Force at which damping holds the fingers to their speed [N].
    """
    hard, balls = contact_fields(), contact_fields(fingers.torsion_radius)
    for number, (name, side) in enumerate(zip(JOINTS, (1.0, -1.0), strict=True)):
        body = spec.worldbody.add_body(name=name, pos=centres[number])
        body.explicitinertial = True
        body.mass, body.inertia = FINGER_MASS, (FINGER_MASS,) * 3  # fingers do not turn
        body.add_joint(
            name=name, type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(side, 0.0, 0.0),
            damping=[force / CLOSING, 0.0, 0.0], limited=mujoco.mjtLimited.mjLIMITED_TRUE,
            range=(-FAR, 0.0), solref_limit=STIFFNESS, solimp_limit=IMPEDANCE,
        )  # fmt: skip
        # The friction of the finger counts, not the larger of both.
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
    equality = spec.add_equality(  # both fingers move by the same distance
        type=mujoco.mjtEq.mjEQ_JOINT, name1=JOINTS[0], name2=JOINTS[1],
        objtype=mujoco.mjtObj.mjOBJ_JOINT, solref=STIFFNESS, solimp=IMPEDANCE,
    )  # fmt: skip
    equality.data[:5] = (0.0, 1.0, 0.0, 0.0, 0.0)


def _add_convex(spec: Any, body: Any, name: str, vertices: Floats, **fields: Any) -> None:
    """Add a convex part with corners (n, 3) [m] to a body, with fields of its geom."""
    mesh = spec.add_mesh(name=name, uservert=vertices.ravel().tolist())
    mesh.inertia = mujoco.mjtMeshInertia.mjMESH_INERTIA_CONVEX
    body.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname=name, **fields)


def grasp_model(stage: Stage) -> tuple[Any, Any]:
    """Return MuJoCo's model and data of fingers on the x axis and of the object as a free body.

    With joints at 0 the planes of the pads are at the origin; joints of -a put them a distance of 2
    a apart.
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

    MuJoCo states stiffness per mass. At rest, a contact of impedance d resists more than in motion:
    its force is `stiffness x depth / ((1 - d) A)`, with A the sum of the inverse inertias of both
    bodies; its acceleration is `stiffness x depth / d`. The impedance is as near to 1/2 as the time
    step allows.
    """
    inverse = sum(model.body_invweight0[model.body(name).id, 0] for name in (OBJECT, JOINTS[0]))
    fastest = (FASTEST / model.opt.timestep) ** 2
    impedance = max(0.5, 1.0 / (1.0 + fastest / (stiffness * inverse)))
    per_mass = stiffness * inverse * (1.0 - impedance)
    balls = model.geom_type == mujoco.mjtGeom.mjGEOM_SPHERE
    model.geom_solref[balls] = -per_mass, -2.0 * math.sqrt(per_mass * impedance)
    model.geom_solimp[balls, :2] = impedance


def put_object(model: Any, data: Any, pose: Floats, friction: float) -> None:
    """Place the object relative to the gripper as a pose states.

    Args:
        model: MuJoCo's model, whose friction is set.
        data: Data of the model, which are reset.
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
