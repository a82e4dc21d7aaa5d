"""Numbers of grasps on a surface: located angles, epsilon, grip forces, quality measures."""

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from grasp3d.arrays import Floats, locked
from grasp3d.contact.contacts import Contacts
from grasp3d.mesh import ObjectMesh
from grasp3d.quality.ferrari_canny import epsilon_with
from grasp3d.quality.measures.measuring import MetricValues, metrics
from grasp3d.quality.tilting import EpsilonRange, WrenchErrors, uncertain_epsilon_range
from grasp3d.quality.wrenches import EpsilonOptions
from grasp3d.settings import GraspModel
from grasp3d.stability.located_angles import (
    ContactLimits,
    PairLines,
    located_grasps,
    located_pairs,
)
from grasp3d.stability.normal_sets import WorstAndBest
from grasp3d.surface.contacts import GraspContacts, JawContacts
from grasp3d.surface.critical_angles import AMBIGUOUS
from grasp3d.surface.extreme_normals import hull_epsilons
from grasp3d.surface.holding import Holding, holding_of
from grasp3d.surface.load_case import LoadCase

EPSILON_RTOL = 1e-2
"""Fraction of epsilon's upper bound that may lie between its bounds."""

BOUND_RTOL = 3e-2
"""The same for the largest epsilon, itself only a bound; saves most time for symmetric grasps."""


def located_angles_of(
    grasps: GraspContacts,
    angles: WorstAndBest,
    model: GraspModel,
    *,
    lines: PairLines | None = None,
) -> WorstAndBest:
    """Located angles of grasps on a surface.

    Args:
        grasps: The grasps, shape (b, n).
        angles: Their critical angles over the worst and the best normals [rad], shape (b,) each.
        model: What is known about the contacts, with lengths in the mesh's unit.
        lines: Two contacts: their lines; None: computed.

    Returns:
        (worst, best) [rad], shape (b,) each; inf where there is no grasp.
    """
    if model.is_uniform:
        return angles
    limits = ContactLimits.of(model.fingertips)
    if grasps.count == 2:
        worst, best = located_pairs(*angles, lines or grasps.lines, limits)
        return locked(worst), locked(best)
    bounds = np.full((2, grasps.size), math.inf)
    rows = np.flatnonzero(np.isfinite(angles[0]))
    on_crease = grasps.on_crease[rows].any(axis=1)
    bounds[:, rows[on_crease]] = np.array(AMBIGUOUS)[:, None]
    smooth = rows[~on_crease]
    if len(smooth):
        contacts = Contacts(grasps.points[smooth] - grasps.mesh.center, grasps.normals[smooth])
        bounds[:, smooth] = located_grasps(contacts, np.asarray(angles[0])[smooth], limits)
    return locked(bounds[0]), locked(bounds[1])


def surface_epsilons(
    grasps: GraspContacts,
    model: GraspModel,
    *,
    center_radius: float = 0.0,
) -> EpsilonRange:
    """Epsilon of grasps about the mesh's centre of mass, torques divided by its torque scale.

    Args:
        grasps: The grasps.
        model: Friction, resolution, edges, actuation and torsion. With method extremes the minimum
            and the maximum are those over the combinations of extreme normals, at the smallest and
            at the largest friction.
        center_radius: Radius of the ball in which the centre of mass lies, in the mesh's unit.

    Returns:
        Shape (b,) each; nan where the normals at a contact cancel out.

    Raises:
        SettingError: A grasp has too many combinations of extreme normals.
    """
    values = np.full((3, grasps.size), math.nan)
    rows = grasps.with_normals
    if not len(rows):
        return EpsilonRange(*map(locked, values))
    chosen_grasps = grasps.take(rows)
    contacts = chosen_grasps.contacts(model)
    options = EpsilonOptions.of_model(
        model, torque_scale=grasps.mesh.torque_scale, rtol=EPSILON_RTOL
    )
    if model.method == "extremes" and not isinstance(grasps, JawContacts):
        values[0, rows] = epsilon_with(contacts, options).lower
        values[1:, rows] = hull_epsilons(chosen_grasps, model, options)
    else:
        epsilon = uncertain_epsilon_range(
            contacts, model.tilt_of_fingers, WrenchErrors.of_model(model, center_radius), options,
            bound_rtol=BOUND_RTOL,
        )  # fmt: skip
        values[:, rows] = epsilon.nominal, epsilon.minimum, epsilon.maximum
    return EpsilonRange(*map(locked, values))


EDGES = 8
"""Edges of polygonal friction cones where the model has circular ones."""

NO_NORMALS = "the normals at a contact cancel out"

LONGEST = 0.01
"""Difference of the object's two largest second moments, relative to the largest, from which one of
its principal axes is the longest."""


def surface_metrics(
    grasps: GraspContacts,
    model: GraspModel,
    names: str | Sequence[str] = "all",
) -> MetricValues:
    """Quality measures of grasps about the mesh's centre of mass, torques divided by its scale.

    Args:
        grasps: The grasps, at their nominal normals.
        model: Friction, torsion and edges; for circular cones `EDGES`.
        names: As in `quality.metrics`.

    Returns:
        Shape (b,) each; nan where the normals at a contact cancel out.

    Raises:
        SettingError: An unknown name.
    """
    rows = grasps.with_normals
    if not len(rows):
        return MetricValues.undefined(names, grasps.size, NO_NORMALS)
    values = metrics(
        grasps.take(rows).contacts(model),
        names,
        torque_scale=grasps.mesh.torque_scale,
        edges=model.edges or EDGES,
        principal_axis=longest_axis(grasps.mesh),
    )
    return values.placed(rows, grasps.size, NO_NORMALS)


def longest_axis(mesh: ObjectMesh) -> Floats:
    """Longest principal axis of an object of uniform density, of an open surface that of its area.

    Args:
        mesh: The object.

    Returns:
        Unit direction, shape (3,); nan where no axis is clearly longest, as of a ball or a disc.
    """
    corners = (mesh.vertices[mesh.faces] - mesh.center) / mesh.size  # (F, 3, 3)
    if np.isfinite(mesh.volume):  # tetrahedra, whose fourth corner is the origin
        weights, number = np.linalg.det(corners), 4
    else:
        sides = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
        weights, number = np.linalg.norm(sides, axis=1), 3
    weights = weights / weights.sum()
    sums = corners.sum(axis=1)
    centroid = weights @ sums / number  # a given centre of mass may be elsewhere
    # Second moments of a simplex are sums of products of its corners, and of their sum.
    moments = np.einsum("f,fki,fkj->ij", weights, corners, corners)
    moments += np.einsum("f,fi,fj->ij", weights, sums, sums)
    moments = moments / (number * (number + 1)) - np.outer(centroid, centroid)
    sizes, axes = np.linalg.eigh(moments)
    if sizes[2] - sizes[1] < LONGEST * sizes[2]:
        return np.full(3, np.nan)
    return np.asarray(axes[:, 2])


def surface_holding(grasps: GraspContacts, model: GraspModel, case: LoadCase) -> Holding:
    """Grip forces and payloads of grasps under a load, about the mesh's centre of mass.

    Args:
        grasps: The grasps (b,).
        model: Friction and resolution; the torsion radius is that of the load case.
        case: The load.

    Returns:
        Rows (b,). Where the normals at a contact cancel out nothing is known of the forces: the
        label with force is M.
    """
    rows = grasps.with_normals
    if not len(rows):
        return _unknown_normals(Holding.none(case, grasps.size))
    subset = grasps.take(rows)
    holding = holding_of(
        subset.contacts(model), subset.tilts(model), case, friction=model.friction_bounds,
    )  # fmt: skip
    if len(rows) == grasps.size:
        return holding
    return _unknown_normals(holding.placed(rows, grasps.size))


def _unknown_normals(holding: Holding) -> Holding:
    """The forces of rows without numbers, whose normals cancel out: anything may be true."""
    unknown = np.isnan(holding.grip_force)
    payload = np.where(unknown & holding.has_payload, 0.0, holding.payload)
    return replace(
        holding,
        grip_force_least=locked(np.where(unknown, 0.0, holding.grip_force_least)),
        grip_force_largest=locked(np.where(unknown, math.inf, holding.grip_force_largest)),
        payload=locked(payload),
    )
