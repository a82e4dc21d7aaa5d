"""A body of two plates between two round tips, as a model of MuJoCo.

Its grasp is that of two contacts whose normals are known exactly.
"""

from typing import Any

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.physics.engine import contact_fields, mujoco_module, new_spec
from grasp3d.physics.hand import TIP_BIT, Tips, add_tips

PLATE = (0.05, 0.05, 0.004)
"""Half sizes of the plates [m]: no tip slides off them before it is seen to slip."""

PLATES = "plates"
"""Name of the body."""

DEFAULT_CONTACT = {"solref": (0.02, 1.0), "solimp": (0.9, 0.95, 0.001, 0.5, 2.0)}
"""MuJoCo's defaults."""


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
    found = np.zeros(4)
    mujoco.mju_quatZ2Vec(found, normal)
    return found
