"""Critical friction angles of grasps on a surface: over the worst and the best normals.

On a crease or at a corner a contact may have any normal between those of the faces, so that a grasp
has two critical friction angles. S is decided by the one over the worst normals, U by the one over
the best normals.
"""

import math
from collections.abc import Iterator

import numpy as np

from grasp3d._kernels.surface.surface_contacts import largest_angle, smallest_angle
from grasp3d.arrays import RIGHT_ANGLE, Bools, Floats, Ints, angles_between, locked
from grasp3d.contact.contacts import Contacts, centred, not_nearly_degenerate
from grasp3d.errors import SettingError
from grasp3d.quality.critical_angle import critical_friction_angle
from grasp3d.stability.normal_sets import (
    STEP,
    NormalSamples,
    WorstAndBest,
    angle_bounds,
    planar_bounds,
)
from grasp3d.surface.contacts import GraspContacts
from grasp3d.system.context import report_progress

SAME_POINT = 1e-12
"""Distance up to which contacts are at the same point, in object sizes."""

STEPS = tuple(STEP * 2.0**k for k in range(5))
"""Steps at which sets of normals are sampled [rad]; the first with few enough combinations is used,
with a margin for the normals between the samples."""

MAX_COMBINATIONS = 2048
"""Most combinations of sampled normals of one grasp; with more, a coarser step is used."""

CHUNK = 1 << 14
"""Combinations, or smooth grasps, that are evaluated at once."""

MAX_EXAMINED = 8
"""Most contacts of a grasp that is examined for contacts that nearly coincide."""

AMBIGUOUS = (RIGHT_ANGLE, 0.0)
"""Worst and best angle of a grasp of three contacts and more that is not evaluated: neither S nor
U."""


def critical_angles(contacts: GraspContacts, *, tolerance: float = 1e-4) -> WorstAndBest:
    """Critical friction angles of grasps over the worst and over the best normals of the contacts.

    Two contacts have a closed form. For more, none on a crease, both are the critical friction
    angle. If some are on creases, their sets of normals are sampled, in steps of 5 degrees, or of
    more where combinations are many, with a margin for the normals between the samples: the worst
    is never too small and the best never too large by more than the tolerance. If the set of a
    contact spans every direction, the grasp is neither surely stable nor surely unstable. Contacts
    that are all at one point are no grasp, but at an edge they may push against each other: their
    best angle is a lower bound. Of three contacts and more that nearly coincide, or are nearly on a
    line, it is 0: no U is proven.

    Args:
        contacts: Grasps on a surface.
        tolerance: Three contacts and more: as in `critical_friction_angle` [rad].

    Returns:
        (worst, best) [rad], shape (b,) each. For two contacts up to pi; for more, pi/2 where the
        grasp is force-closed at no friction. The worst is inf where all contacts are at the same
        point.

    Raises:
        SettingError: A tolerance that is not above 0.
    """
    if not tolerance > 0.0:
        raise SettingError(f"tolerance must be above 0; got {tolerance}")
    bounds = np.full((2, contacts.size), math.inf)
    distances = np.linalg.norm(contacts.points - contacts.points[:, :1], axis=2)
    separate = (distances > SAME_POINT * contacts.mesh.size).any(axis=1)
    together = np.flatnonzero(~separate)
    bounds[1, together] = _best_at_one_point(contacts, together, tolerance)
    done = len(together)
    for rows, angles in _evaluated(contacts, separate, tolerance):
        if not len(rows):
            continue
        bounds[:, rows] = angles
        if 3 <= contacts.count <= MAX_EXAMINED:
            points, _, _ = centred(contacts.points[rows])
            bounds[1, rows[~not_nearly_degenerate(points)]] = 0.0
        done += len(rows)
        report_progress(done / contacts.size)
    return locked(bounds[0]), locked(bounds[1])


def _best_at_one_point(contacts: GraspContacts, rows: Ints, tolerance: float) -> Floats:
    """Lower bounds of the best angles (b,) of grasps with all contacts at the same point.

    Forces there balance only if they do not all lie in one half-space. With normals within r of a
    common direction that takes friction of at least 90 degrees - r.
    """
    best = np.zeros(len(rows))
    smooth = ~contacts.on_crease[rows].any(axis=1)
    smooth_normals = contacts.normals[rows[smooth]]
    at_origin = Contacts(np.zeros(smooth_normals.shape), smooth_normals, friction=0.0)
    best[smooth] = critical_friction_angle(at_origin, tolerance=tolerance)
    start, count = contacts.set_start, contacts.count
    for g in np.flatnonzero(~smooth & ~contacts.any_normal[rows].any(axis=1)):
        first = count * rows[g]
        normals = contacts.set_normals[start[first] : start[first + count]]
        middle = normals.sum(axis=0)
        best[g] = max(0.0, RIGHT_ANGLE - float(angles_between(normals, middle).max()))
    return best


def _evaluated(
    contacts: GraspContacts, separate: Bools, tolerance: float
) -> Iterator[tuple[Ints, Floats]]:
    """Chunks of grasps, smooth ones first, and their angles (b,) or (2, b)."""
    on_crease = contacts.on_crease.any(axis=1)
    for rows in _chunks(np.flatnonzero(separate & ~on_crease)):
        points, _, _ = centred(contacts.points[rows])
        smooth = Contacts(points, contacts.normals[rows], friction=0.0)
        yield rows, critical_friction_angle(smooth, tolerance=tolerance)
    yield from _on_creases(contacts, np.flatnonzero(separate & on_crease), tolerance)


def _chunks(rows: Ints) -> Iterator[Ints]:
    for start in range(0, len(rows), CHUNK):
        yield rows[start : start + CHUNK]


def _on_creases(
    contacts: GraspContacts, rows: Ints, tolerance: float
) -> Iterator[tuple[Ints, Floats]]:
    """Chunks of grasps with a contact on a crease, and their angles (2, b)."""
    if contacts.count <= 2:
        for chunk in _chunks(rows):
            yield chunk, _of_pairs(contacts, chunk)
        return
    any_normal = contacts.any_normal[rows].any(axis=1)
    yield rows[any_normal], np.transpose([AMBIGUOUS] * int(any_normal.sum()))
    pending = rows[~any_normal]
    if contacts.count == 3:
        on_line = []
        for chunk in _chunks(pending):
            grasps = contacts.take(chunk)
            samples = NormalSamples.of_sets(grasps.set_start, grasps.set_normals, 3, STEP)
            points, _, _ = centred(grasps.points)
            triples = np.stack(planar_bounds(points, samples, tolerance=tolerance))
            planar = ~np.isnan(triples[0])  # the contacts are not on one line
            yield chunk[planar], triples[:, planar]
            on_line.append(chunk[~planar])
        pending = np.concatenate([pending[:0], *on_line])
    for step in STEPS:
        grasps = contacts.take(pending)
        samples = NormalSamples.of_sets(grasps.set_start, grasps.set_normals, grasps.count, step)
        too_many = samples.combinations > MAX_COMBINATIONS
        for chunk in _chunks_of_sizes(samples.combinations, np.flatnonzero(~too_many)):
            points, _, _ = centred(grasps.points[chunk])
            tested = samples.take(chunk)
            angles = angle_bounds(points, tested, tolerance=tolerance)
            yield pending[chunk], np.stack(angles)
        pending = pending[too_many]
    yield pending, np.transpose([AMBIGUOUS] * len(pending))


def _chunks_of_sizes(sizes: Floats, rows: Ints) -> Iterator[Ints]:
    """Chunks of the rows (b,), each with about `CHUNK` combinations in all."""
    number = np.cumsum(sizes[rows]) // CHUNK
    chunks = np.split(rows, np.flatnonzero(np.diff(number)) + 1)
    yield from (chunk for chunk in chunks if len(chunk))


def _of_pairs(contacts: GraspContacts, rows: Ints) -> Floats:
    """Closed form of two contacts with sets of normals: squeezing or expanding, (2, b)."""
    angles = np.full((2, len(rows)), math.inf)
    start, normals, any_normal = contacts.set_start, contacts.set_normals, contacts.any_normal
    lines = contacts.points[rows, 1] - contacts.points[rows, 0]
    for g, (row, line) in enumerate(zip(rows, lines, strict=True)):
        sets = [
            (start[i], 0 if any_normal[row, i - 2 * row] else start[i + 1] - start[i])
            for i in (2 * row, 2 * row + 1)
        ]
        for sign in (1.0, -1.0):
            directions = (sign * line, -sign * line)
            for k, angle in enumerate((largest_angle, smallest_angle)):
                larger = max(
                    angle(normals, *set_, *direction)
                    for set_, direction in zip(sets, directions, strict=True)
                )
                angles[k, g] = min(angles[k, g], larger)
    return angles
