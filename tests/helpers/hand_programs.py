"""Closure of grasps of hands by linear programs alone: an oracle with pyramids for cones."""

import math

import numpy as np
from scipy.optimize import linprog

from grasp3d.arrays import Bools
from grasp3d.contact.friction_cones import cone_edges
from grasp3d.quality.hand_forces.actuation import Actuation
from grasp3d.quality.hand_forces.hand_grasp import HandGrasp


def closes_by_linear_programs(
    grasp: HandGrasp, half_angle: float, *, edges: int, outer: bool
) -> bool:
    """Whether every wrench of the span, and its opposite, can be exerted by forces of some scale.

    Args:
        grasp: The grasp.
        half_angle: Of all cones [rad].
        edges: Of the pyramids.
        outer: Whether they are around the cones, instead of inside.
    """
    contacts, actuation = grasp.contacts, grasp.actuation
    if outer:
        half_angle = math.atan(math.tan(half_angle) / math.cos(math.pi / edges))
    angles = np.full(contacts.count, half_angle)
    forces = cone_edges(contacts.normals, angles, edges=edges)  # (n, m, 3)
    moments = np.cross(contacts.points[:, None], forces)
    wrenches = np.concatenate([forces, moments / grasp.length], axis=2).reshape(-1, 6).T
    torques = np.einsum("nip,nmi->pnm", grasp.jacobian, forces).reshape(actuation.joints, -1)
    units, drives = wrenches.shape[1], len(actuation.lower)
    statics = np.concatenate([torques, -actuation.columns, -actuation.offset[:, None]], axis=1)
    limits = []
    for side, bounds in ((1.0, actuation.upper), (-1.0, actuation.lower)):
        finite = np.flatnonzero(np.isfinite(bounds))
        rows = np.zeros((len(finite), units + drives + 1))
        rows[np.arange(len(finite)), units + finite] = side
        rows[:, -1] = -side * bounds[finite]
        limits.append(rows)
    at_most = np.concatenate(limits)
    ranges = [(0.0, None)] * units + [(None, None)] * drives + [(0.0, None)]
    equations = np.concatenate([np.pad(wrenches, ((0, 0), (0, drives + 1))), statics])
    left, sizes, _ = np.linalg.svd(wrenches)
    for wrench in left[:, sizes > 1e-10].T:
        for sign in (1.0, -1.0):
            right = np.concatenate([sign * wrench, np.zeros(actuation.joints)])
            found = linprog(
                np.zeros(equations.shape[1]), A_ub=at_most, b_ub=np.zeros(len(at_most)),
                A_eq=equations, b_eq=right, bounds=ranges,
            )  # fmt: skip
            if found.status == 2:
                return False
            assert found.status == 0, found.message
    return True


def tight_by_linear_programs(actuation: Actuation) -> Bools | None:
    """Bounds, lower and upper ones, at which drives stay while no force is exerted, (2, q).

    One program for each; None: the drives cannot hold the hand's own links and springs.
    """
    bounds = np.stack([actuation.lower, actuation.upper])
    side, drive = np.nonzero(np.isfinite(bounds))
    sign = 1.0 - 2.0 * side
    count = len(actuation.lower)
    room = np.zeros((len(side), count + 2))  # of z and t, of any scale, and of what is sought
    room[np.arange(len(side)), drive] = sign
    room[:, count] = -sign * bounds[side, drive]
    columns = (actuation.columns, actuation.offset[:, None], np.zeros((actuation.joints, 1)))
    sought = np.eye(count + 2)[-1]
    tight = np.zeros(bounds.shape, dtype=np.bool_)
    for one in range(len(side)):
        found = linprog(
            -sought, A_ub=np.concatenate([-room, sought[None] - room[one]]),
            b_ub=np.zeros(len(side) + 1), A_eq=np.concatenate(columns, axis=1),
            b_eq=np.zeros(actuation.joints),
            bounds=[(None, None)] * count + [(1.0, None), (0.0, 1.0)],
        )  # fmt: skip
        if found.x is None:
            return None
        tight[side[one], drive[one]] = found.x[-1] < 0.5
    return tight
