"""Critical friction angles of grasps on a surface: over the worst and the best normals.

On a crease or at a corner a contact may have any normal between those of the faces, so that a grasp
has two critical friction angles. S is decided by the one over the normals that hurt most, U by that
over the normals that help most.
"""

import math
from collections.abc import Iterator

import numpy as np

from grasp3d._kernels.normal_angles import largest_angle, smallest_angle
from grasp3d.arrays import Bools, Floats, Ints, locked
from grasp3d.contact.contacts import Contacts, centred
from grasp3d.errors import SettingError
from grasp3d.quality.critical_angle import RIGHT, critical_friction_angle
from grasp3d.stability.normal_sets import STEP
from grasp3d.stability.sampled_normals import Both, NormalSamples, angle_bounds, planar_bounds
from grasp3d.surface.contacts import SurfaceContacts
from grasp3d.system.progress import Progress, ignore

SAME = 1e-12
"""Distance between contacts at one place, in object sizes."""

STEPS = tuple(STEP * 2.0**k for k in range(5))
"""Steps at which sets of normals are sampled [rad]; the first that makes few enough combinations
is taken, and what it leaves out is allowed for."""

MOST_COMBINATIONS = 2048
"""Combinations of sampled normals of one grasp beyond which a coarser step is taken."""

PART = 1 << 14
"""Combinations, or smooth grasps, that are looked at together."""

NO_VERDICT = (RIGHT, 0.0)
"""Worst and best angle of three contacts and more of which nothing can be said."""


def critical_angles(
    contacts: SurfaceContacts,
    *,
    tolerance: float = 1e-4,
    threads: int | None = None,
    progress: Progress | None = None,
) -> Both:
    """Critical friction angles of grasps over the worst and over the best normals of the contacts.

    Two contacts have a closed form. Of more, all on smooth places, both are the critical friction
    angle. Where some are on creases, their sets of normals are sampled, in steps of 5 degrees or
    of more where combinations are many, and what lies between the samples is allowed for: the worst
    is never too small and the best never too large by more than the tolerance. A contact whose set
    spans every direction leaves the grasp neither surely stable nor surely unstable.

    Args:
        contacts: Grasps on a surface.
        tolerance: Three contacts and more: as in `critical_friction_angle` [rad].
        threads: Threads; None: one per processor.
        progress: Called with the share of the work done, from 0 to 1.

    Returns:
        (worst, best) [rad], shape (b,) each. For two contacts up to pi; for more pi/2 where no
        friction closes the grasp. inf where all contacts are at one place.

    Raises:
        SettingError: A tolerance that is not above 0.
    """
    if not tolerance > 0.0:
        raise SettingError(f"tolerance must be above 0; got {tolerance}")
    found = np.full((2, contacts.size), math.inf)
    off = np.linalg.norm(contacts.points - contacts.points[:, :1], axis=2)
    grasping = (off > SAME * contacts.mesh.size).any(axis=1)
    done = contacts.size - int(grasping.sum())
    for rows, angles in _parts(contacts, grasping, tolerance, threads):
        if not len(rows):
            continue
        found[:, rows] = angles
        done += len(rows)
        (progress or ignore)(done / contacts.size)
    return locked(found[0]), locked(found[1])


def _parts(
    contacts: SurfaceContacts, grasping: Bools, tolerance: float, threads: int | None
) -> Iterator[tuple[Ints, Floats]]:
    """Some grasps at a time, smooth ones first, and their angles (b,) or (2, b)."""
    creased = contacts.on_crease.any(axis=1)
    for rows in _runs(np.flatnonzero(grasping & ~creased)):
        few = _contacts(contacts, rows, contacts.normals[rows])
        yield rows, critical_friction_angle(few, tolerance=tolerance, threads=threads)
    yield from _on_creases(contacts, np.flatnonzero(grasping & creased), tolerance, threads)


def _runs(rows: Ints) -> Iterator[Ints]:
    for start in range(0, len(rows), PART):
        yield rows[start : start + PART]


def _contacts(contacts: SurfaceContacts, rows: Ints, normals: Floats) -> Contacts:
    """Some grasps with given normals, without friction and about their own middle."""
    points, _, _ = centred(contacts.points[rows])
    return Contacts(points, normals, friction=0.0)


def _on_creases(
    contacts: SurfaceContacts, rows: Ints, tolerance: float, threads: int | None
) -> Iterator[tuple[Ints, Floats]]:
    """Grasps with a contact on a crease, some at a time, and their angles (2, b)."""
    if contacts.count <= 2:
        for some in _runs(rows):
            yield some, _of_pairs(contacts, some)
        return
    anything = contacts.any_normal[rows].any(axis=1)
    yield rows[anything], np.transpose([NO_VERDICT] * int(anything.sum()))
    pending = rows[~anything]
    if contacts.count == 3:
        on_line = []
        for some in _runs(pending):
            triples = _of_triples(contacts.take(some), tolerance)
            planar = ~np.isnan(triples[0])
            yield some[planar], triples[:, planar]
            on_line.append(some[~planar])
        pending = np.concatenate([pending[:0], *on_line])
    for step in STEPS:
        few = contacts.take(pending)
        samples = NormalSamples.of_sets(few.set_start, few.set_normals, few.count, step)
        many = samples.combinations > MOST_COMBINATIONS
        for part in _parts_of(samples.combinations, np.flatnonzero(~many)):
            points, _, _ = centred(few.points[part])
            tested = samples.take(part)
            angles = angle_bounds(points, tested, tolerance=tolerance, threads=threads)
            yield pending[part], np.stack(angles)
        pending = pending[many]
    yield pending, np.transpose([NO_VERDICT] * len(pending))


def _of_triples(contacts: SurfaceContacts, tolerance: float) -> Floats:
    """Three contacts with sets of normals, in the plane through them, (2, b); nan on one line."""
    start, normals = contacts.set_start, contacts.set_normals
    samples = NormalSamples.of_sets(start, normals, contacts.count, STEP)
    points, _, _ = centred(contacts.points)
    return np.stack(planar_bounds(points, samples, tolerance=tolerance))


def _parts_of(sizes: Floats, rows: Ints) -> Iterator[Ints]:
    """Some of the rows (b,) at a time, as many as their sizes allow to be looked at together."""
    part = np.cumsum(sizes[rows]) // PART
    yield from (some for some in np.split(rows, np.flatnonzero(np.diff(part)) + 1) if len(some))


def _of_pairs(contacts: SurfaceContacts, rows: Ints) -> Floats:
    """Closed form of two contacts with sets of normals: squeezing or expanding, (2, b)."""
    found = np.full((2, len(rows)), math.inf)
    start, normals, anything = contacts.set_start, contacts.set_normals, contacts.any_normal
    lines = contacts.points[rows, 1] - contacts.points[rows, 0]
    for g, (row, line) in enumerate(zip(rows, lines, strict=True)):
        sets = [
            (start[i], 0 if anything[row, i - 2 * row] else start[i + 1] - start[i])
            for i in (2 * row, 2 * row + 1)
        ]
        for sign in (1.0, -1.0):
            ways = (sign * line, -sign * line)
            for k, angle in enumerate((largest_angle, smallest_angle)):
                both = max(
                    angle(normals, *set_, *way) for set_, way in zip(sets, ways, strict=True)
                )
                found[k, g] = min(found[k, g], both)
    return found
