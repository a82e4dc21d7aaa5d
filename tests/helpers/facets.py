"""Two round tips on two facets: do critical angles and grip forces agree with physics?

The object is a free body of two plates, on whose faces the tips press; nothing else acts on it. It
is grasped by two contacts whose normals are known exactly. So hold and slip can be compared with
the critical friction angle to fractions of a degree.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from functools import partial
from typing import Any

import mujoco
import numpy as np

from grasp3d.arrays import ArrayLike, Floats, unit_rows
from grasp3d.contact.contacts import Contacts, tangents
from grasp3d.outcomes.scene import (
    FAR,
    JOINTS,
    TIME_STEP,
    TIP_BIT,
    Fingers,
    add_fingers,
    contact_fields,
    new_spec,
    without_log,
)

SLIPPED = 5e-5
"""Shift of a contact, across the line between both, from which a grasp has slipped [m]. Grasps that
hold move by at most a fifth of it, as contacts yield; grasps beyond the cone by 0.05 degrees pass
it within a second."""

SPEED = 0.5
"""Speed of unloaded tips [m/s]."""

RAMP = 0.1
"""Time in which the force grows to its full value [s]."""

PLATE = (0.05, 0.05, 0.004)
"""Half sizes of the plates [m]; no tip slides off them before its slip is noticed."""

PLATES = "plates"
"""Name of the body of both plates."""

DEFAULT_CONTACT = {"solref": (0.02, 1.0), "solimp": (0.9, 0.95, 0.001, 0.5, 2.0)}
"""MuJoCo's defaults."""


@dataclass(frozen=True)
class Tip:
    """A rigid ball that presses; lengths in metres."""

    radius: float
    friction: float
    torsion_radius: float = 0.0

    @property
    def fingers(self) -> Fingers:
        """Two such tips, with nothing behind them."""
        ball, nothing = np.zeros((1, 3)), np.zeros((0, 3))
        radii = np.array([self.radius])
        return Fingers(ball, radii, math.inf, self.torsion_radius, (), nothing)


@dataclass(frozen=True, kw_only=True)
class FacetPress:
    """Settings of two tips that press on two facets, in metres, kilograms, newtons and seconds."""

    opening: float = 0.05
    tip_radius: float = 0.005
    force: float = 5.0  # of each tip, along the line between the contacts
    mass: float = 0.1
    seconds: float = 1.0
    most_shift: float = 5e-3  # at which a run ends
    dry_friction: bool = True  # otherwise MuJoCo's defaults


@without_log()
def facet_slip(normals: ArrayLike, friction: float, press: FacetPress | None = None) -> float:
    """Shift of the contacts on two inclined facets that are pressed together.

    Args:
        normals: Inward normals of the facets, shape (2, 3); contact 1 is at -x of contact 2, and
            both are on the x axis.
        friction: Coulomb coefficient.
        press: Settings of the press; None: the defaults.

    Returns:
        The larger shift of the object's two points, across the line between the contacts, at the
        end of the run [m]. The grasp holds if it is below `SLIPPED`.
    """
    setup = press or FacetPress()
    inward = unit_rows(np.array(normals, dtype=np.float64))
    model = plates_model(
        inward,
        setup.opening,
        Tip(setup.tip_radius, friction),
        mass=setup.mass,
        force=setup.force,
        dry_friction=setup.dry_friction,
    )
    data = mujoco.MjData(model)
    steps = math.ceil(setup.seconds / model.opt.timestep)
    for step in range(steps):
        data.ctrl[:] = setup.force * min(1.0, (step + 1) * model.opt.timestep / RAMP)
        mujoco.mj_step(model, data)
        shift = _shift(data, setup.opening)
        if not shift <= setup.most_shift:
            break
    return shift


def slip_friction(
    normals: ArrayLike, *, press: FacetPress | None = None, within: float = 0.02
) -> float:
    """Friction angle at which two pressed facets begin to slip, by bisection [rad].

    `within` is the largest error of the angle, in degrees; the rest is as for `facet_slip`.
    """

    def holds(angle: float) -> bool:
        return facet_slip(normals, math.tan(angle), press) < SLIPPED

    return _first_angle(holds, within)


def slip_tilt(
    normals: ArrayLike, friction: float, *, press: FacetPress | None = None, within: float = 0.02
) -> float:
    """Critical friction angle at which tilted facets begin to slip, by bisection over the tilt.

    Both normals are turned away from the line between the contacts, each about its own axis, in the
    proportion of their given angles, at least one of which is not 0. Returns the larger of both
    angles to the line at which the facets begin to slip [rad], to compare with the friction angle.
    """
    inward = unit_rows(np.array(normals, dtype=np.float64))
    axes = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]])
    angles = np.arccos(np.clip((inward * axes).sum(axis=1), -1.0, 1.0))
    across = unit_rows(inward - (inward * axes).sum(axis=1, keepdims=True) * axes)

    def slips(angle: float) -> bool:
        tilt = (angle * angles / angles.max())[:, None]
        tilted = np.cos(tilt) * axes + np.sin(tilt) * across
        return not facet_slip(tilted, friction, press) < SLIPPED

    return _first_angle(slips, within)


def _first_angle(reaches: Callable[[float], bool], within: float) -> float:
    """First angle at which a condition holds [rad], by bisection to within `within` degrees."""
    low, high = 0.0, 0.5 * math.pi - 0.02
    while high - low > 2.0 * math.radians(within):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if reaches(middle) else (middle, high)
    return 0.5 * (low + high)


def random_facets(random: np.random.Generator, largest: float) -> Floats:
    """Normals of two facets, tilted about random axes by up to an angle [rad], shape (2, 3)."""
    tilt, turn = largest * random.random(2), 2.0 * math.pi * random.random(2)
    across = np.sin(tilt)
    normals = np.stack([np.cos(tilt), across * np.cos(turn), across * np.sin(turn)], axis=1)
    return normals * [[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]]


def tilt_at_random(normals: Floats, tilt: Floats, random: np.random.Generator) -> Floats:
    """Tilt unit normals (..., 3) by up to an angle (...) [rad], uniformly over a cap."""
    shape = normals.shape[:-1]
    angle = np.arccos(1.0 - random.random(shape) * (1.0 - np.cos(tilt)))
    turn = 2.0 * math.pi * random.random(shape)
    one, two = tangents(normals)
    across = np.cos(turn)[..., None] * one + np.sin(turn)[..., None] * two
    return unit_rows(np.cos(angle)[..., None] * normals + np.sin(angle)[..., None] * across)


def _shift(data: Any, opening: float) -> float:
    """Larger shift, across x, of the points of the object at the contacts [m]."""
    turned = np.zeros(9)
    mujoco.mju_quat2Mat(turned, data.qpos[3:7])
    end = 0.5 * opening * turned.reshape(3, 3)[:, 0]
    ends = data.qpos[:3] + np.array([[-1.0], [1.0]]) * end
    return float(np.hypot(ends[:, 1], ends[:, 2]).max())


def plates_model(
    normals: Floats,
    opening: float,
    tip: Tip,
    *,
    mass: float,
    force: float,
    center: Floats | None = None,
    dry_friction: bool = True,
) -> Any:
    """MuJoCo's model of a free body of two plates, on which two tips press along x.

    Args:
        normals: Inward normals of the plates, shape (2, 3); contact 1 is at -x of contact 2.
        opening: Distance of the contacts, which are on the x axis beside the origin [m].
        tip: Tip of both fingers.
        mass: Mass of the body, and of each tip [kg].
        force: Force at which damping holds the tips to their speed [N].
        center: Centre of mass of the body [m], shape (3,); None: the origin.
        dry_friction: Whether contacts behave like dry friction; otherwise MuJoCo's defaults.
    """
    spec = new_spec() if dry_friction else _default_spec()
    touch = contact_fields(tip.torsion_radius)
    points = 0.5 * opening * np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    body = spec.worldbody.add_body(name=PLATES)
    body.add_freejoint()
    body.explicitinertial = True
    body.ipos = np.zeros(3) if center is None else center
    body.mass, body.inertia = mass, [mass * opening**2] * 3
    for number in range(2):
        turn = np.zeros(4)  # (w, x, y, z)
        mujoco.mju_quatZ2Vec(turn, normals[number])
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=PLATE,
            pos=points[number] + PLATE[2] * normals[number],
            quat=turn,
            contype=TIP_BIT << number,
            conaffinity=0,
            **touch,
        )
    add_fingers(spec, points - tip.radius * normals, tip.fingers, force)
    for name in JOINTS:
        finger, joint = spec.body(name), spec.joint(name)
        finger.mass, finger.inertia = mass, (mass, mass, mass)
        joint.damping, joint.range = [force / SPEED, 0.0, 0.0], (-FAR, FAR)
    if not dry_friction:
        for geom in spec.geoms:
            geom.solref, geom.solimp = DEFAULT_CONTACT["solref"], DEFAULT_CONTACT["solimp"]
    model = spec.compile()
    model.geom_friction[:, 0] = tip.friction
    return model


def _default_spec() -> Any:
    """An empty model without gravity, with MuJoCo's defaults."""
    spec = mujoco.MjSpec()
    spec.option.timestep, spec.option.gravity = TIME_STEP, (0.0, 0.0, 0.0)
    return spec


PRESSED, LOADED, WATCHED = 0.2, 0.4, 1.0
"""Times until the tips press fully, until the full load acts, and until the end [s]."""

LEVER = 0.01
"""Lever by which a turn counts as a shift [m]."""

MOVED = 5e-5
"""Shift from which a load is not held, while all forces are constant [m]."""

MOST = 1e4
"""Largest force to try, as a multiple of the load's force."""


@dataclass(frozen=True)
class HoldingForce:
    """The smallest force that holds, from a simulation."""

    motor: float
    """Force of each tip along the line between the contacts [N]; inf: no force holds."""
    normal: float
    """Normal component at the contact that is pressed harder, at that force [N]."""


def holding_force(
    contacts: Contacts,
    wrench: ArrayLike,
    *,
    tip_radius: float = 0.005,
    mass: float = 0.1,
    within: float = 0.01,
) -> HoldingForce:
    """Find the smallest force with which two round tips hold a load on two facets, by bisection.

    Args:
        contacts: Two contacts of one grasp, relative to the centre of mass, in metres, with one
            friction, and with the torsion radius of the tips.
        wrench: Force [N] and torque about the centre of mass [N m] on the object, shape (6,).
        tip_radius: Radius of the tips [m].
        mass: Mass of the object, for its inertia only [kg]; its weight is part of the wrench.
        within: Largest error, as a fraction of the force.
    """
    points, load = contacts.points, np.array(wrench, dtype=np.float64)
    (friction,), (radius,) = np.unique(contacts.friction), np.unique(contacts.torsion_radius)
    x = unit_rows(points[1:] - points[:1])[0]
    y = unit_rows(np.cross(np.eye(3)[np.abs(x).argmin()], x)[None])[0]
    frame = np.stack([x, y, np.cross(x, y)])  # rows: the axes
    model = partial(
        plates_model,
        contacts.normals @ frame.T,
        float(np.linalg.norm(points[1] - points[0])),
        Tip(tip_radius, float(friction), float(radius)),
        mass=mass,
        center=-frame @ points.mean(axis=0),
    )
    load = np.concatenate([frame @ load[:3], frame @ load[3:]])
    high = float(np.linalg.norm(load[:3]))
    low, most = 0.0, MOST * high
    while (normal := _normal_if_held(model(force=high), load, high)) is None:
        low, high = high, 2.0 * high
        if high > most:
            return HoldingForce(math.inf, math.inf)
    while high - low > within * high:
        middle = 0.5 * (low + high)
        force = _normal_if_held(model(force=middle), load, middle)
        low, high, normal = (middle, high, normal) if force is None else (low, middle, force)
    return HoldingForce(high, normal)


@without_log()
def _normal_if_held(model: Any, wrench: Floats, force: float) -> float | None:
    """Normal force at the contact that is pressed harder [N]; None: the load is not held."""
    data, step = mujoco.MjData(model), model.opt.timestep
    body, before = model.body(PLATES).id, None
    for number in range(math.ceil(WATCHED / step)):
        time = (number + 1) * step
        data.ctrl[:] = force * min(1.0, 2.0 * time / PRESSED)
        load = np.clip((time - PRESSED) / (LOADED - PRESSED) * 1.25, 0.0, 1.0)
        data.xfrc_applied[body] = load * wrench
        mujoco.mj_step(model, data)
        if before is None and time >= LOADED:
            before = np.array(data.qpos[:7])
    assert before is not None
    return _largest_normal(model, data) if _distance(before, data.qpos[:7]) < MOVED else None


def _distance(before: Floats, after: Floats) -> float:
    """Distance by which a body with a free joint has moved, with its turn at a lever [m]."""
    shift = float(np.linalg.norm(after[:3] - before[:3]))
    cosine = min(1.0, abs(float(np.dot(before[3:], after[3:]))))
    distance = max(shift, LEVER * 2.0 * math.acos(cosine))
    return distance if math.isfinite(distance) else math.inf


def _largest_normal(model: Any, data: Any) -> float:
    """Normal component at the contact that is pressed harder [N]; 0: nothing touches."""
    force, largest = np.zeros(6), 0.0
    for number in range(data.ncon):
        mujoco.mj_contactForce(model, data, number, force)
        largest = max(largest, float(force[0]))
    return largest
