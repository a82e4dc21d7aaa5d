"""Wrench spaces over all normals that a sensor cannot distinguish from the given ones.

The true normal of each contact lies anywhere within the tilt a = alpha/2 of the perceived one (Wan
& Howe 2018, Sec. III), each independently. Two convex sets of contact forces bound what that means:

* 'sure': forces that a contact can apply whichever its normal is. Some force of them suffices at
  every tilt. Of hard fingers it is the cone of half-angle beta - a; where lengths of forces are
  bounded the force that it needs is exactly the largest over all tilts: a tilt by a turns the
  normal away from any direction, so that the smallest support function over the tilts is that of
  the smaller cone. Of two soft fingers see `_kernels.forces.sure_forces`; more of them are taken as
  hard.
* 'possible': forces and moments that it can apply at some of the normals, each at one of its own.
  No tilt needs less. It holds the convex hull of the tilted cones and limit surfaces.

A patch is held as by hard fingers at points of it, which share the bound of their forces: pressure
may be centred anywhere in it, so that torsion and rolling follow from where it is. For 'sure' the
points are on the patch's rim, for 'possible' at the corners of a polygon that contains it. That the
normals of the points tilt independently only widens the range.
"""

import math
from concurrent.futures import ThreadPoolExecutor
from typing import Literal

import numpy as np

from grasp3d._kernels.forces.sure_forces import write_sure_forces
from grasp3d._kernels.hull.support_functions import PER_FINGER
from grasp3d._kernels.hull.tilted_forces import COLUMNS, MODES, POSSIBLE, SURE
from grasp3d.arrays import Floats, Ints
from grasp3d.contact.contacts import Contacts
from grasp3d.contact.friction_cones import edge_angles, tangents
from grasp3d.quality.wrench_problem import WrenchProblem
from grasp3d.quality.wrenches import read_only, wrench_axes
from grasp3d.system.context import thread_count

Side = Literal["sure", "possible"]
"""Which of the two sets of forces."""

SURFACES = {"sure": SURE, "possible": POSSIBLE}
"""Limit surfaces of the kernels."""

LEVELS = 5
"""Largest torsional moments of two soft fingers for which their sure forces are computed."""

CHUNK = 256
"""Grasps whose sure forces one thread computes at a time."""

PATCH_POINTS = 8
"""Points at which a patch is pressed."""


def pressed_at_points(contacts: Contacts, side: Side) -> Contacts:
    """Hard contacts at points of patches: `PATCH_POINTS` for each contact of a flat batch."""
    assert contacts.patch is not None
    angles = edge_angles(PATCH_POINTS)
    corners = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    if side == "possible":
        corners /= math.cos(math.pi / PATCH_POINTS)
    points = contacts.points[..., None, :] + corners @ contacts.patch  # (b, n, k, 3)
    normals = np.broadcast_to(contacts.normals[..., None, :], points.shape)
    friction = np.repeat(contacts.friction, PATCH_POINTS, axis=-1)
    shape = (*friction.shape, 3)
    return Contacts(points.reshape(shape), normals.reshape(shape), friction)


def problem_over_tilts(
    contacts: Contacts, tilts: Floats, side: Side, *, spherical: bool, offset: Floats, soft: bool
) -> WrenchProblem:
    """The wrench spaces of a flat batch of contacts without patches.

    Args:
        contacts: The contacts, of a size of about 1.
        tilts: Largest tilts a [rad], shape (b, n).
        side: Which forces.
        spherical: Whether lengths of forces are bounded by 1, instead of normal components.
        offset: Angles added to the half-angles of the cones, shape (b, n).
        soft: Whether torsion counts for sure forces, which bounds the force of each contact.
    """
    points, normals, torsion = contacts.points, contacts.normals, contacts.torsion_radius
    any_soft = bool((torsion > 0.0).any())
    angles = np.clip(contacts.friction_angle + offset, 0.0, None)
    tilts = np.array(tilts, order="C")  # one that kernels are compiled for
    turning = np.zeros((*tilts.shape, 2, 3))
    if side == "sure":
        modes = LEVELS * MODES if any_soft and soft and contacts.count == 2 else 1
        cones, moments = np.empty((*tilts.shape, modes * COLUMNS)), np.empty(points.shape)
        given = [read_only(one, one.shape) for one in (points, normals, torsion)]
        arrays = (*given, angles, tilts)

        def write(first: int) -> None:
            rows, scratch = slice(first, first + CHUNK), np.zeros((2, 2))
            parts = (array[rows] for array in arrays)
            write_sure_forces(spherical, *parts, *scratch, cones[rows], moments[rows])

        with ThreadPoolExecutor(thread_count()) as executor:
            list(executor.map(write, range(0, len(tilts), CHUNK)))
        tangential = cones[..., COLUMNS - 1] > 0.0
    else:
        widest = np.minimum(angles + tilts, math.pi)
        turns = (turn(angle) for angle in (tilts, widest) for turn in (np.cos, np.sin))
        cones = np.stack([contacts.friction, *turns], axis=-1)
        moments = torsion[..., None] * normals
        tangential = angles + tilts > 0.0
        # Moments about other axes than the given normal.
        own = np.where(tilts > 0.0, torsion, 0.0)
        turning = own[..., None, None] * np.stack(tangents(normals), axis=-2)
    six = any_soft and side == "possible"

    def wrenches_of(chunk: slice | Ints) -> Floats:
        axes = wrench_axes(
            points[chunk], normals[chunk], torsion[chunk], 1.0, turning[chunk] if six else None
        )
        axes[..., 3, 3:] = moments[chunk]
        return axes

    return WrenchProblem(
        kind=PER_FINGER,
        size=len(points),
        count=contacts.count,
        wrenches_of=wrenches_of,
        tangential=tangential.astype(float),
        cones=cones,
        tilts_exceed_friction=np.zeros(len(points), dtype=np.bool_),
        spherical=spherical,
        soft=any_soft,
        rolling=six,
    )
