"""The smallest force with which two simulated tips hold a load, to compare with grip forces."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, unit_rows
from grasp3d.contact.contacts import Contacts
from grasp3d.errors import ContactError
from grasp3d.physics.engine import mujoco_module, without_log
from grasp3d.physics.facets import PLATES, plates_model
from grasp3d.physics.scene import Tips

PRESSED, LOADED, WATCHED = 0.2, 0.4, 1.0
"""Times until the tips press fully, until the full load acts, and until the end [s]."""

LEVER = 0.01
"""Lever by which a turn counts as a shift [m]."""

MOVED = 5e-5
"""Shift, while all forces are constant, from which the load is not held [m]."""

MOST = 1e4
"""Largest force that is tried, as a multiple of the load's."""


@dataclass(frozen=True)
class HoldingForce:
    """The smallest force that holds, from a simulation."""

    motor: float
    """Force of each tip along the line between the contacts [N]; inf: none holds."""
    normal: float
    """Normal component of the harder pressed contact at that force [N]."""


@dataclass(frozen=True, eq=False)
class _Case:
    """A load on two contacts, in the frame whose x axis is the line between them."""

    normals: Floats
    opening: float
    center: Floats
    wrench: Floats
    tips: Tips
    mass: float


def holding_force(
    contacts: Contacts,
    wrench: ArrayLike,
    *,
    tip_radius: float = 0.005,
    mass: float = 0.1,
    within: float = 0.01,
) -> HoldingForce:
    """The smallest force with which two round tips hold a load on two facets, by bisection.

    Args:
        contacts: Two contacts, relative to the centre of mass, in metres, of one grasp. Their
            torsion radius is that of the tips.
        wrench: Force [N] and torque about the centre of mass [N m] on the object, shape (6,).
        tip_radius: Radius of the tips [m].
        mass: Mass of the object, for its inertia [kg]: it weighs what the wrench says.
        within: Largest error, as a fraction of the force.

    Raises:
        ContactError: It is not one grasp of two contacts with one friction and torsion radius.
        SettingError: MuJoCo is not installed.

    Example:
        1 N across two fingers with a friction of 0.5 needs 1 N of each:

        >>> import grasp3d
        >>> from grasp3d.physics import holding_force
        >>> normals = [[1, 0, 0], [-1, 0, 0]]
        >>> contacts = grasp3d.Contacts([[-0.02, 0, 0], [0.02, 0, 0]], normals, friction=0.5)
        >>> print(f"{holding_force(contacts, [0, 0, -1, 0, 0, 0]).normal:.1f} N")
        1.0 N
    """
    case = _case(contacts, wrench, tip_radius, mass)
    high = float(np.linalg.norm(case.wrench[:3]))
    low, most = 0.0, MOST * high
    while (normal := _normal_if_held(case, high)) is None:
        low, high = high, 2.0 * high
        if high > most:
            return HoldingForce(math.inf, math.inf)
    while high - low > within * high:
        middle = 0.5 * (low + high)
        force = _normal_if_held(case, middle)
        low, high, normal = (middle, high, normal) if force is None else (low, middle, force)
    return HoldingForce(high, normal)


def _case(contacts: Contacts, wrench: ArrayLike, tip_radius: float, mass: float) -> _Case:
    load = np.array(wrench, dtype=np.float64)
    if contacts.points.shape != (2, 3) or load.shape != (6,):
        raise ContactError(
            "a holding force needs one grasp of two contacts and one wrench of shape (6,); got "
            f"points of shape {contacts.points.shape} and a wrench of shape {load.shape}"
        )
    frictions, radii = np.unique(contacts.friction), np.unique(contacts.torsion_radius)
    if len(frictions) != 1 or len(radii) != 1:
        raise ContactError("a holding force needs one friction and torsion radius of both contacts")
    line = contacts.points[1] - contacts.points[0]
    x = unit_rows(line[None])[0]
    y = unit_rows(np.cross(np.eye(3)[np.abs(x).argmin()], x)[None])[0]
    frame = np.stack([x, y, np.cross(x, y)])  # rows: the axes
    return _Case(
        normals=contacts.normals @ frame.T,
        opening=float(np.linalg.norm(line)),
        center=-frame @ contacts.points.mean(axis=0),
        wrench=np.concatenate([frame @ load[:3], frame @ load[3:]]),
        tips=Tips(tip_radius, float(frictions[0]), float(radii[0])),
        mass=mass,
    )


@without_log()
def _normal_if_held(case: _Case, force: float) -> float | None:
    """Normal force of the harder pressed contact [N]; None: the load is not held."""
    mujoco = mujoco_module()
    model = plates_model(
        case.normals, case.opening, case.tips, mass=case.mass, force=force, center=case.center
    )
    data, step = mujoco.MjData(model), model.opt.timestep
    body, before = model.body(PLATES).id, None
    for number in range(math.ceil(WATCHED / step)):
        time = (number + 1) * step
        data.ctrl[:] = force * min(1.0, 2.0 * time / PRESSED)
        load = np.clip((time - PRESSED) / (LOADED - PRESSED) * 1.25, 0.0, 1.0)
        data.xfrc_applied[body] = load * case.wrench
        mujoco.mj_step(model, data)
        if before is None and time >= LOADED:
            before = np.array(data.qpos[:7])
    assert before is not None
    return _largest_normal(model, data) if _distance(before, data.qpos[:7]) < MOVED else None


def _distance(before: Floats, after: Floats) -> float:
    """How far a body with a free joint has moved, with its turn at a lever [m]."""
    shift = float(np.linalg.norm(after[:3] - before[:3]))
    cosine = min(1.0, abs(float(np.dot(before[3:], after[3:]))))
    distance = max(shift, LEVER * 2.0 * math.acos(cosine))
    return distance if math.isfinite(distance) else math.inf


def _largest_normal(model: Any, data: Any) -> float:
    """Normal component of the harder pressed contact [N]; 0: nothing touches."""
    mujoco, force, largest = mujoco_module(), np.zeros(6), 0.0
    for number in range(data.ncon):
        mujoco.mj_contactForce(model, data, number, force)
        largest = max(largest, float(force[0]))
    return largest
