"""Measures of internal forces: how far they can stay from the borders of the friction cones."""

import math

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.contact.friction_cones import edge_angles
from grasp3d.quality.critical_angle import critical_friction_angle
from grasp3d.quality.measures.geometry import GraspGeometry
from grasp3d.quality.measures.linear_programs import Program, solve
from grasp3d.quality.measures.metric import NO_EQUILIBRIUM, Measured


def internal_force_margin(grasps: GraspGeometry) -> Measured:
    """Largest distance of internal forces from the borders of the cones (Kerr & Roth 1986)."""
    rows = np.flatnonzero(~grasps.at_one_point)
    values = np.full(grasps.size, np.nan)
    values[rows] = solve([_forces_of(grasps, int(row)) for row in rows])
    return Measured.of(
        values,
        (grasps.at_one_point, "all contacts are at one point"),
        (np.isnan(values), NO_EQUILIBRIUM),
    )


def _forces_of(grasps: GraspGeometry, row: int) -> Program:
    """The program of one grasp.

    Its unknowns are the margin, each contact's force along normal and tangents and torsional moment
    divided by its radius, and for each contact a number of at least the size of that moment.
    """
    count = grasps.count
    balance = grasps.axis_span.rows[row].T * math.sqrt(count)  # (6, 4 n)
    balance = balance[np.any(balance != 0.0, axis=1)]
    equal = np.zeros((len(balance) + 1, 1 + 5 * count))
    equal[:-1, 1 : 1 + 4 * count] = balance
    equal[-1, 1 : 1 + 4 * count : 4] = 1.0  # all normal forces together are 1
    unlimited = np.where(grasps.used_axes[row], np.inf, 0.0)  # (n, 4)
    most = np.concatenate([[np.inf], unlimited.ravel(), unlimited[:, 3]])
    least = -most
    least[1 : 1 + 4 * count : 4] = 0.0  # fingers press
    return Program(
        equal=equal,
        given=np.concatenate([np.zeros(len(balance)), [1.0]]),
        below=np.vstack([_cone_faces(grasps, row), _moment_limits(count)]),
        least=least,
        most=most,
    )


def _cone_faces(grasps: GraspGeometry, row: int) -> Floats:
    """Margin less the distance to each face of each cone, shape (m n, 1 + 5 n)."""
    count, edges = grasps.count, grasps.edges
    middles = edge_angles(edges, math.pi / edges)  # the faces are between the edges
    apothem = math.cos(math.pi / edges)
    faces = np.zeros((count, edges, 1 + 5 * count))
    faces[..., 0] = 1.0
    for contact in range(count):
        slope = math.atan(float(grasps.contacts.friction[row, contact]) * apothem)
        force = 1 + 4 * contact
        faces[contact, :, force] = -math.sin(slope)
        faces[contact, :, force + 1] = math.cos(slope) * np.cos(middles)
        faces[contact, :, force + 2] = math.cos(slope) * np.sin(middles)
        # Torsion takes its part of the normal force.
        faces[contact, :, 1 + 4 * count + contact] = math.sin(slope)
    return faces.reshape(count * edges, -1)


def _moment_limits(count: int) -> Floats:
    """The last unknowns are at least the moments, either way round, shape (2 n, 1 + 5 n)."""
    limits = np.zeros((2, count, 1 + 5 * count))
    contact = np.arange(count)
    limits[:, contact, 1 + 4 * count + contact] = -1.0
    limits[0, contact, 4 + 4 * contact] = 1.0
    limits[1, contact, 4 + 4 * contact] = -1.0
    return limits.reshape(2 * count, -1)


def friction_margin(grasps: GraspGeometry) -> Measured:
    """Friction angle less the critical friction angle."""
    contacts = grasps.contacts
    angles = critical_friction_angle(contacts, tolerance=grasps.tolerance, threads=grasps.threads)
    own = contacts.friction_angle
    finite = np.where(np.isfinite(angles), angles, 0.0)
    return Measured.of(
        own[:, 0] - finite,
        (grasps.at_one_point, "all contacts are at one point"),
        ((own != own[:, :1]).any(axis=1), "the fingers' friction differs"),
        (~np.isfinite(angles), NO_EQUILIBRIUM),
    )
