"""Two round tips on two facets: does what the critical friction angle says happen in physics?

The object is a free body of two plates, on whose faces the tips press; nothing else acts on it. Its
grasp is that of two contacts whose normals are known exactly, so that hold and slip can be compared
with the critical friction angle to fractions of a degree.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, unit_rows
from grasp3d.errors import SettingError
from grasp3d.physics.engine import contact_fields, mujoco_module, new_spec, without_log
from grasp3d.physics.scene import TIP_BIT, Tips, add_tips

SLIPPED = 5e-5
"""Shift of a contact across the line between the two from which a grasp has slipped [m]. Grasps
that hold move by a fifth of it at most, as contacts yield; those beyond the cone by 0.05 degrees
pass it within a second."""

RAMP = 0.1
"""Time in which the force grows to its full value [s]."""

PLATE = (0.05, 0.05, 0.004)
"""Half sizes of the plates [m]: no tip slides off them before it is seen to slip."""

PLATES = "plates"
"""Name of the body."""

DEFAULT_CONTACT = {"solref": (0.02, 1.0), "solimp": (0.9, 0.95, 0.001, 0.5, 2.0)}
"""MuJoCo's defaults."""


@dataclass(frozen=True, kw_only=True)
class FacetPress:
    """How two tips press on two facets.

    Attributes:
        opening: Distance of the contacts [m].
        tip_radius: Radius of the tips [m].
        force: Force of each tip along the line between the contacts [N].
        mass: Mass of the object [kg].
        seconds: How long they press [s].
        most_shift: Shift at which a run ends [m].
        dry_friction: Whether contacts behave as dry friction; otherwise MuJoCo's defaults.
    """

    opening: float = 0.05
    tip_radius: float = 0.005
    force: float = 5.0
    mass: float = 0.1
    seconds: float = 1.0
    most_shift: float = 5e-3
    dry_friction: bool = True


@without_log()
def facet_slip(normals: ArrayLike, friction: float, press: FacetPress | None = None) -> float:
    """Shift of two contacts on inclined facets that are pressed together.

    Args:
        normals: Inward normals of the facets, shape (2, 3); contact 1 is at -x of contact 2, and
            both are on the x axis.
        friction: Coulomb coefficient.
        press: How they are pressed; None: the defaults.

    Returns:
        The farther shift of the two points of the object across the line between the contacts [m],
        when the run ends. The grasp holds where it is below `SLIPPED`.

    Raises:
        SettingError: A facet faces away from its tip, or MuJoCo is not installed.

    Example:
        Contacts with normals 20 degrees from the line between them hold at a friction of tan 21,
        and slip at tan 19 degrees:

        >>> import math
        >>> from grasp3d.physics.facets import SLIPPED, facet_slip
        >>> tilt = math.radians(20.0)
        >>> normals = [[math.cos(tilt), math.sin(tilt), 0.0], [-1.0, 0.0, 0.0]]
        >>> frictions = [math.tan(math.radians(angle)) for angle in (21.0, 19.0)]
        >>> [facet_slip(normals, friction) < SLIPPED for friction in frictions]
        [True, False]
    """
    setup = press or FacetPress()
    inward = unit_rows(np.array(normals, dtype=np.float64))
    if inward.shape != (2, 3) or not (inward[:, 0] * (1.0, -1.0) > 0.0).all():
        raise SettingError("facets must face their tips: normals of shape (2, 3), inward along x")
    mujoco = mujoco_module()
    model = plates_model(
        inward,
        setup.opening,
        Tips(setup.tip_radius, friction),
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

    Args:
        normals: Inward normals of the facets, shape (2, 3), as in `facet_slip`.
        press: How they are pressed; None: the defaults.
        within: Largest error of the angle, in degrees.

    Raises:
        SettingError: As in `facet_slip`.
    """

    def holds(angle: float) -> bool:
        return facet_slip(normals, math.tan(angle), press) < SLIPPED

    return _first_angle(holds, within)


def slip_tilt(
    normals: ArrayLike, friction: float, *, press: FacetPress | None = None, within: float = 0.02
) -> float:
    """Critical friction angle at which tilted facets begin to slip, by bisection over the tilt.

    Both normals are turned from the line between the contacts about axes of their own, in the
    proportion of their given angles.

    Args:
        normals: Inward normals of the facets, shape (2, 3), as in `facet_slip`; at least one off
            the line.
        friction: Coulomb coefficient.
        press: How they are pressed; None: the defaults.
        within: Largest error of the angle, in degrees.

    Returns:
        The larger angle of the two normals from the line where they begin to slip [rad]: to be
        compared with the friction angle.
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
    """First angle at which a condition holds [rad], by bisection to within some degrees."""
    low, high = 0.0, 0.5 * math.pi - 0.02
    while high - low > 2.0 * math.radians(within):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if reaches(middle) else (middle, high)
    return 0.5 * (low + high)


def random_facets(random: np.random.Generator, largest: float) -> Floats:
    """Normals of two facets, tilted about random axes by up to an angle, shape (2, 3).

    Args:
        random: Source of randomness.
        largest: Largest tilt [rad].
    """
    tilt, turn = largest * random.random(2), 2.0 * math.pi * random.random(2)
    across = np.sin(tilt)
    normals = np.stack([np.cos(tilt), across * np.cos(turn), across * np.sin(turn)], axis=1)
    return normals * [[1.0, 1.0, 1.0], [-1.0, 1.0, 1.0]]


def _shift(data: Any, opening: float) -> float:
    """The farther shift of the contacts' points of the object, across x [m]."""
    turned = np.zeros(9)
    mujoco_module().mju_quat2Mat(turned, data.qpos[3:7])
    end = 0.5 * opening * turned.reshape(3, 3)[:, 0]
    ends = data.qpos[:3] + np.array([[-1.0], [1.0]]) * end
    return float(np.hypot(ends[:, 1], ends[:, 2]).max())


def plates_model(
    normals: Floats,
    opening: float,
    tips: Tips,
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
        tips: The tips.
        mass: Mass of the body, and of each tip [kg].
        force: Force at which the tips are damped [N].
        center: Centre of mass of the body [m], shape (3,); None: the origin.
        dry_friction: Whether contacts behave as dry friction; otherwise MuJoCo's defaults.
    """
    mujoco = mujoco_module()
    spec = new_spec(dry_friction=dry_friction)
    touch = contact_fields(tips.friction, tips.torsion_radius)
    points = 0.5 * opening * np.array([[-1.0, 0.0, 0.0], [1.0, 0.0, 0.0]])
    body = spec.worldbody.add_body(name=PLATES)
    body.add_freejoint()
    body.explicitinertial = True
    body.ipos = np.zeros(3) if center is None else center
    body.mass, body.inertia = mass, [mass * opening**2] * 3
    for number in range(2):
        body.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX,
            size=PLATE,
            pos=points[number] + PLATE[2] * normals[number],
            quat=_from_z(normals[number]),
            contype=TIP_BIT << number,
            conaffinity=0,
            **touch,
        )
    add_tips(spec, points - tips.radius * normals, tips, mass=mass, force=force)
    if not dry_friction:
        for geom in spec.geoms:
            geom.solref, geom.solimp = DEFAULT_CONTACT["solref"], DEFAULT_CONTACT["solimp"]
    return spec.compile()


def _from_z(normal: Floats) -> Floats:
    """Quaternion (w, x, y, z) of a rotation that takes z to a unit vector."""
    mujoco = mujoco_module()
    quaternion = np.zeros(4)
    mujoco.mju_quatZ2Vec(quaternion, normal)
    return quaternion
