"""Two fingertips of a gripper in MuJoCo: they slide along the closing axis and press with a force.

Both move by the same distance, as those of parallel grippers do, and yield to nothing across the
axis. Only the tips touch the object: fingers and palm are left out.
"""

from dataclasses import dataclass
from typing import Any

from grasp3d.arrays import Floats
from grasp3d.physics.engine import IMPEDANCE, STIFFNESS, contact_fields, mujoco_module

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
    _couple(spec)


def _couple(spec: Any) -> None:
    """Let both tips move by the same distance."""
    mujoco = mujoco_module()
    equality = spec.add_equality(
        type=mujoco.mjtEq.mjEQ_JOINT, name1=JOINTS[0], name2=JOINTS[1],
        objtype=mujoco.mjtObj.mjOBJ_JOINT, solref=STIFFNESS, solimp=IMPEDANCE,
    )  # fmt: skip
    equality.data[:5] = (0.0, 1.0, 0.0, 0.0, 0.0)
