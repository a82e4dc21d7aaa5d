"""Enumeration of extreme normals for grasps on a surface (Wan & Howe 2018)."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from grasp3d.arrays import Bytes, Floats, Ints
from grasp3d.contact.contacts import Contacts
from grasp3d.quality.wrenches import EpsilonOptions
from grasp3d.settings import GraspModel
from grasp3d.stability.classification import classify
from grasp3d.stability.enumeration import (
    Tested,
    check_combinations,
    closure_at,
    extreme_normals,
    extremes,
    rings_needed,
)
from grasp3d.stability.label import Label
from grasp3d.surface.contacts import GraspContacts, JawContacts
from grasp3d.system.context import report_progress

BEFORE_ENUMERATION = 0.3
"""Fraction of the work with method extremes that the search for grasps is expected to take."""

LABEL_RTOL = 1e-2
"""Accuracy of epsilon where labels of closed jaws are computed."""

CHUNK = 4096
"""Grasps enumerated at once."""

MAX_FACE_NORMALS = 12
"""Face normals tested at one contact; of more, so many are chosen evenly."""


def check_combinations_of(model: GraspModel) -> None:
    """Check the number of combinations of smooth contacts, before grasps are searched for.

    Raises:
        SettingError: A grasp of smooth contacts has too many combinations.
    """
    rings = rings_needed(model.tilt, model.friction_angle)
    check_combinations([1 + rings * model.extreme_normals] * model.fingers)


def hull_labels(grasps: GraspContacts, model: GraspModel) -> Bytes:
    """Label grasps by their wrench hulls at extreme normals (Wan & Howe 2018, Sec. III).

    Args:
        grasps: The grasps.
        model: Friction, sensor resolution, edges and number of extreme normals.

    Returns:
        Label codes, shape (b,).

    Raises:
        SettingError: A grasp has too many combinations.
    """
    if isinstance(grasps, JawContacts):
        return _labels_of_jaws(grasps, model)
    labels = np.full(grasps.size, Label.M, dtype=np.uint8)
    options = EpsilonOptions(edges=model.edges)
    done = 0
    for rows, (low, high), tested in _groups(grasps, model):
        worst = closure_at(low, tested, options)
        best = worst if high is low else closure_at(high, tested, options)
        labels[rows[~best.closing]] = Label.U
        labels[rows[~worst.failing]] = Label.S
        done += len(rows)
        report_progress(done / len(labels))
    return labels


def _labels_of_jaws(grasps: JawContacts, model: GraspModel) -> Bytes:
    """Label codes of patches that closed jaws touch, which have one normal each, shape (b,)."""
    if not grasps.size:
        return np.zeros(0, dtype=np.uint8)
    result = classify(
        grasps.contacts(model),
        2.0 * model.tilt,
        method=model.method,
        friction_interval=model.friction_interval if model.friction_error else None,
        extreme_normals=model.extreme_normals,
        options=EpsilonOptions.of_model(model, torque_scale=1.0, rtol=LABEL_RTOL),
    )
    return np.asarray(result.label)


def hull_epsilons(
    grasps: GraspContacts,
    model: GraspModel,
    options: EpsilonOptions,
) -> tuple[Floats, Floats]:
    """Smallest and largest epsilon over the combinations of extreme normals, shape (b,) each.

    The smallest at the smallest friction, the largest at the largest.

    Args:
        grasps: The grasps.
        model: Friction, sensor resolution, torsion and number of extreme normals.
        options: Cones, actuation, torque scale and accuracy.

    Raises:
        SettingError: A grasp has too many combinations.
    """
    epsilons, done = np.zeros((2, grasps.size)), 0
    for rows, (low, high), tested in _groups(grasps, model):
        worst = extremes(low, tested, options)
        best = worst if high is low else extremes(high, tested, options)
        epsilons[:, rows] = worst.minimum, best.maximum
        done += len(rows)
        report_progress(done / grasps.size)
    return epsilons[0], epsilons[1]


def _groups(
    grasps: GraspContacts, model: GraspModel
) -> Iterator[tuple[Ints, tuple[Contacts, Contacts], Tested]]:
    """Chunks of grasps with equal numbers of normals at each contact.

    Their rows, the contacts at the smallest and at the largest friction, and the tested normals.
    """
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
            contacts = Contacts(points[rows], nominal, model.friction, model.torsion_radius)
            creases = {i: faces for i, faces in enumerate(sets) if faces.shape[1] > 1}
            tilt = np.full((len(rows), grasps.count), model.tilt)
            count = model.extreme_normals
            ends = contacts, contacts
            if model.friction_error != 0.0:
                low, high = model.friction_interval
                ends = contacts.with_friction(low), contacts.with_friction(high)
            yield rows, ends, extreme_normals(contacts, tilt, count=count, creases=creases)


def _normals(grasps: GraspContacts) -> list[Floats]:
    """Normals of the faces at every contact, (k, 3) each, at most `MAX_FACE_NORMALS`."""
    normals = []
    for first, end in pairwise(grasps.set_start.tolist()):
        count = min(end - first, MAX_FACE_NORMALS)
        rows = np.linspace(0, end - first, count, endpoint=False).astype(np.int64)
        normals.append(grasps.set_normals[first + rows])
    return normals
