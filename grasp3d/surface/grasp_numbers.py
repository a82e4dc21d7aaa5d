"""Numbers of grasps on a surface: epsilon, grip forces, quality measures.

With method extremes, extreme normals are enumerated for labels and epsilon (Wan & Howe 2018).
"""

import math
from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np

from grasp3d.arrays import Bytes, Floats, Ints, locked
from grasp3d.contact.contacts import Contacts
from grasp3d.quality.ferrari_canny import epsilon_with
from grasp3d.quality.force_ranges import EpsilonRange, uncertain_epsilon_range
from grasp3d.quality.measures import ALL, metrics
from grasp3d.quality.wrenches import EpsilonOptions
from grasp3d.settings import GraspModel
from grasp3d.stability.label import Label
from grasp3d.stability.normal_sets import (
    EXTREME_NORMALS,
    Creases,
    Extremes,
    check_combinations,
    extremes,
    rings_needed,
)
from grasp3d.surface.contacts import SurfaceContacts
from grasp3d.surface.load_case import LoadCase, LoadResult, at_rows, load_result_of
from grasp3d.system.context import report_progress

BEFORE_ENUMERATION = 0.3
"""Fraction of the work that the search for grasps is expected to take with method extremes."""

CHUNK = 4096
"""Grasps enumerated at once."""

MAX_FACE_NORMALS = 12
"""Largest number of face normals tested at one contact; of more, this many are chosen evenly."""


def check_combinations_of(model: GraspModel) -> None:
    """Check the number of combinations of smooth contacts, before grasps are searched for.

    Raises:
        SettingError: A grasp of smooth contacts has too many combinations.
    """
    rings = rings_needed(model.tilt, model.friction_angle)
    check_combinations([1 + rings * EXTREME_NORMALS] * model.fingers)


def hull_labels(grasps: SurfaceContacts, model: GraspModel) -> Bytes:
    """Label grasps by their wrench hulls at extreme normals (Wan & Howe 2018, Sec. III).

    Args:
        grasps: The grasps.
        model: Friction and sensor resolution.

    Returns:
        Label codes, shape (b,).

    Raises:
        SettingError: A grasp has too many combinations.
    """
    labels = np.full(grasps.size, Label.M, dtype=np.uint8)
    for rows, worst, best in _enumerated(grasps, model, None):
        labels[rows[best.unstable]] = Label.U
        labels[rows[worst.stable]] = Label.S
    return labels


def hull_epsilons(
    grasps: SurfaceContacts, model: GraspModel, options: EpsilonOptions
) -> tuple[Floats, Floats]:
    """Smallest and largest epsilon over the combinations of extreme normals, shape (b,) each.

    The smallest holds at the smallest friction, the largest at the largest friction.

    Args:
        grasps: The grasps.
        model: Friction, sensor resolution and torsion.
        options: Torque scale and accuracy.

    Raises:
        SettingError: A grasp has too many combinations.
    """
    epsilons = np.zeros((2, grasps.size))
    for rows, worst, best in _enumerated(grasps, model, options):
        epsilons[:, rows] = worst.minimum, best.maximum
    return epsilons[0], epsilons[1]


def _enumerated(
    grasps: SurfaceContacts, model: GraspModel, options: EpsilonOptions | None
) -> Iterator[tuple[Ints, Extremes, Extremes]]:
    """Rows of grasps, and their extremes at the smallest and at the largest friction."""
    done = 0
    for rows, contacts, creases in _groups(grasps, model):
        tilt = np.full((len(rows), grasps.count), model.tilt)
        low, high = model.friction_interval
        worst = best = extremes(contacts.with_friction(low), tilt, creases=creases, options=options)
        if low != high:
            best = extremes(contacts.with_friction(high), tilt, creases=creases, options=options)
        yield rows, worst, best
        done += len(rows)
        report_progress(done / grasps.size)


def _groups(grasps: SurfaceContacts, model: GraspModel) -> Iterator[tuple[Ints, Contacts, Creases]]:
    """Rows of grasps with equal numbers of normals at each contact, the contacts, and creases."""
    normals = _normals(grasps)
    points = grasps.points - grasps.mesh.center_mass
    sizes = np.array([len(faces) for faces in normals], dtype=np.int64)
    kinds, kind = np.unique(sizes.reshape(-1, grasps.count), axis=0, return_inverse=True)
    for number in range(len(kinds)):
        members = np.flatnonzero(kind == number)
        for start in range(0, len(members), CHUNK):
            rows = members[start : start + CHUNK]
            sets = [
                np.stack([normals[row * grasps.count + i] for row in rows])
                for i in range(grasps.count)
            ]
            nominal = np.stack([faces[:, 0] for faces in sets], axis=1)
            contacts = Contacts(points[rows], nominal, model.nominal_friction, model.torsion_radius)
            yield rows, contacts, {i: set_ for i, set_ in enumerate(sets) if set_.shape[1] > 1}


def _normals(grasps: SurfaceContacts) -> list[Floats]:
    """Normals of the faces at every contact, (k, 3) each, at most `MAX_FACE_NORMALS`."""
    normals = []
    for first, end in pairwise(grasps.sets.start.tolist()):
        count = min(end - first, MAX_FACE_NORMALS)
        rows = np.linspace(0, end - first, count, endpoint=False).astype(np.int64)
        normals.append(grasps.sets.normals[first + rows])
    return normals


EPSILON_RTOL = 1e-2
"""Fraction of epsilon's upper bound that may lie between its bounds."""

BOUND_RTOL = 3e-2
"""The same for the largest epsilon, which is only a bound: saves most time for symmetric grasps."""


def surface_epsilons(grasps: SurfaceContacts, model: GraspModel) -> EpsilonRange:
    """Epsilon of grasps about the mesh's centre of mass, torques divided by its torque scale.

    Args:
        grasps: The grasps.
        model: Friction, resolution and torsion. With method extremes the minimum
            and the maximum are those over the combinations of extreme normals, at the smallest and
            at the largest friction.

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
    options = EpsilonOptions(torque_scale=grasps.mesh.torque_scale, rtol=EPSILON_RTOL)
    if model.method == "extremes":
        values[0, rows] = epsilon_with(contacts, options).lower
        values[1:, rows] = hull_epsilons(chosen_grasps, model, options)
    else:
        epsilon = uncertain_epsilon_range(
            contacts, model.tilt, model.friction_interval, options, bound_rtol=BOUND_RTOL
        )
        values[:, rows] = epsilon.nominal, epsilon.minimum, epsilon.maximum
    return EpsilonRange(*map(locked, values))


def surface_metrics(
    grasps: SurfaceContacts, model: GraspModel, names: str | Sequence[str] = ALL
) -> dict[str, Floats]:
    """Quality measures of grasps about the mesh's centre of mass, torques divided by its scale.

    Args:
        grasps: The grasps, at their nominal normals.
        model: Friction and torsion.
        names: As in `quality.metrics`.

    Returns:
        Values by name, shape (b,) each; nan where the normals at a contact cancel out.

    Raises:
        SettingError: An unknown name.
    """
    rows = grasps.with_normals
    contacts = grasps.take(rows).contacts(model)
    known = metrics(contacts, names, torque_scale=grasps.mesh.torque_scale)
    return {name: locked(at_rows(column, rows, grasps.size)) for name, column in known.items()}


def surface_load_result(grasps: SurfaceContacts, model: GraspModel, case: LoadCase) -> LoadResult:
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
    subset = grasps.take(rows)
    found = load_result_of(
        subset.contacts(model), subset.tilts(model), case, friction=model.friction_interval
    ).each(lambda values: at_rows(values, rows, grasps.size))
    return found.with_forces(np.isnan(found.grip_force), math.nan, 0.0, math.inf)
