"""The paper's enumeration of extreme normals for the grasps on a surface."""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from grasp3d.arrays import Bytes, Floats, Ints
from grasp3d.contact.contacts import Contacts
from grasp3d.settings import GraspModel
from grasp3d.stability.enumeration import extremes, see
from grasp3d.stability.extreme_normals import (
    Tested,
    check_combinations,
    extreme_normals,
    rings_needed,
)
from grasp3d.stability.label import Label
from grasp3d.surface.contacts import SurfaceContacts
from grasp3d.system.progress import Progress

SEARCH_FRACTION = 0.3
"""Fraction of the work with method extremes that the search for grasps is expected to take."""

PART = 4096
"""Grasps enumerated at once."""

MOST_FACES = 12
"""Faces at one place whose normals are tried; of more, so many spread evenly around it."""


def check_combinations_of(model: GraspModel) -> None:
    """Refuse before the work what no smooth grasp could be labelled with.

    Raises:
        SettingError: A grasp of smooth contacts has too many combinations.
    """
    rings = rings_needed(model.tilt, model.friction_angle)
    check_combinations([1 + rings * model.extreme_normals] * model.fingers)


def hull_labels(
    grasps: SurfaceContacts,
    model: GraspModel,
    *,
    threads: int | None = 1,
    progress: Progress | None = None,
) -> Bytes:
    """Label grasps by their wrench hulls alone (Wan & Howe 2018, Sec. III).

    Args:
        grasps: The grasps.
        model: Friction, resolution, edges and the number of extreme normals.
        threads: Threads; None: one per processor.
        progress: Called with the share of the work done, from 0 to 1.

    Returns:
        Label codes, shape (b,).

    Raises:
        SettingError: A grasp has too many combinations.
    """
    labels = np.full(grasps.size, Label.M, dtype=np.uint8)
    done = 0
    for rows, contacts, tested in _groups(grasps, model):
        seen = see(contacts, tested, edges=model.edges, threads=threads)
        labels[rows[~seen.closing]] = Label.U
        labels[rows[~seen.failing]] = Label.S
        done += len(rows)
        if progress is not None:
            progress(done / len(labels))
    return labels


def hull_epsilons(
    grasps: SurfaceContacts,
    model: GraspModel,
    *,
    rtol: float,
    threads: int | None = 1,
    progress: Progress | None = None,
) -> tuple[Floats, Floats]:
    """Smallest and largest epsilon over the combinations of extreme normals, shape (b,) each.

    Args:
        grasps: The grasps.
        model: As for `hull_labels`, and actuation and torsion.
        rtol: As in `quality.epsilon`.
        threads: Threads; None: one per processor.
        progress: Called with the share of the work done, from 0 to 1.

    Raises:
        SettingError: A grasp has too many combinations.
    """
    found, done = np.zeros((2, grasps.size)), 0
    for rows, contacts, tested in _groups(grasps, model):
        range_ = extremes(
            contacts, tested, edges=model.edges, actuation=model.actuation,
            torque_scale=grasps.mesh.torque_scale, rtol=rtol, threads=threads,
        )  # fmt: skip
        found[:, rows] = range_.minimum, range_.maximum
        done += len(rows)
        if progress is not None:
            progress(done / grasps.size)
    return found[0], found[1]


def _groups(grasps: SurfaceContacts, model: GraspModel) -> Iterator[tuple[Ints, Contacts, Tested]]:
    """Grasps with as many normals at every contact, some at a time: (rows, contacts, tested)."""
    normals = _normals(grasps)
    points = grasps.points - grasps.mesh.center_mass
    sizes = np.array([len(some) for some in normals], dtype=np.int64)
    kinds, kind = np.unique(sizes.reshape(-1, grasps.count), axis=0, return_inverse=True)
    for number in range(len(kinds)):
        members = np.flatnonzero(kind == number)
        for start in range(0, len(members), PART):
            rows = members[start : start + PART]
            sets = [
                np.stack([normals[row * grasps.count + i] for row in rows])
                for i in range(grasps.count)
            ]
            nominal = np.stack([some[:, 0] for some in sets], axis=1)
            contacts = Contacts(points[rows], nominal, model.friction, model.torsion_radius)
            creases = {i: some for i, some in enumerate(sets) if some.shape[1] > 1}
            tilt = np.full((len(rows), grasps.count), model.tilt)
            count = model.extreme_normals
            yield rows, contacts, extreme_normals(contacts, tilt, count=count, creases=creases)


def _normals(grasps: SurfaceContacts) -> list[Floats]:
    """Normals of the faces at every contact, (k, 3) each; of many only some, spread evenly."""
    found = []
    for first, end in pairwise(grasps.set_start.tolist()):
        count = min(end - first, MOST_FACES)
        rows = np.linspace(0, end - first, count, endpoint=False).astype(np.int64)
        found.append(grasps.set_normals[first + rows])
    return found
