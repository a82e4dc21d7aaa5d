"""MuJoCo, with settings under which pressed contacts behave as dry friction does."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import mujoco

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
