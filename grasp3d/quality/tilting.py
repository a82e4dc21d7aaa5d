"""Epsilon over all normals that a sensor cannot distinguish from the perceived ones.

The true normal of each contact lies anywhere within the tilt a = alpha/2 of the perceived one
(Wan & Howe 2018, Sec. III, who sample extreme normals).
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np

from grasp3d._kernels.support_functions import TOTAL
from grasp3d.arrays import ArrayLike, Bools, Floats, Ints, locked, short_repr
from grasp3d.contact.contacts import Contacts, per_contact
from grasp3d.contact.friction_cones import tilted_normals
from grasp3d.errors import SettingError
from grasp3d.quality.epsilon_options import EpsilonOptions
from grasp3d.quality.ferrari_canny import epsilon_with, smallest_epsilon
from grasp3d.quality.wrench_problem import WrenchProblem
from grasp3d.quality.wrenches import wrench_axes
from grasp3d.system.progress import Progress

CHUNK = 32_768
"""Grasps, or grasps with tilted normals, in memory at once."""

FULL_RANK = 6
"""Dimension of all wrenches."""

MAX_SAMPLED_FINGERS = 5
"""Most soft fingers whose tilts are sampled: 9 normals each, in all combinations."""


@dataclass(frozen=True, eq=False)
class EpsilonRange:
    """Epsilon at the given normals and over all tilts of them."""

    nominal: Floats
    """At the given normals, a certified lower bound, shape (...)."""
    minimum: Floats
    """Smallest over all tilts, a lower bound, shape (...); see `epsilon_range`."""
    maximum: Floats
    """Upper bound over all tilts, shape (...), which need not be attained."""

    __repr__ = short_repr

    def take(self, rows: Ints) -> "EpsilonRange":
        """The chosen rows."""
        return EpsilonRange(
            locked(self.nominal[rows]), locked(self.minimum[rows]), locked(self.maximum[rows])
        )


def epsilon_range(
    contacts: Contacts,
    tilt: ArrayLike,
    options: EpsilonOptions | None = None,
    *,
    bound_rtol: float | None = None,
    progress: Progress | None = None,
) -> EpsilonRange:
    """Epsilon at the given normals, its minimum and a bound on its maximum over all tilts.

    The minimum is, for

    * hard fingers with circular cones: exact. The worst tilt reduces the half-angle of a contact's
      cone by a whatever the direction of the disturbance, so the minimum is epsilon at beta - a.
      Where a exceeds beta at some contact the result is 0, a bound;
    * hard fingers with polygonal cones: epsilon of polygons of the effective friction, half-angle
      beta - a, as in the paper. A tilted polygon does not contain that polygon exactly, so epsilon
      at some tilt may be slightly smaller;
    * hard fingers with patches: exact as well, as the cones tilt and the patches, which are touched
      wherever the normals point, do not;
    * soft fingers: the smallest among sampled tilts, the given normal and 8 at the angle a around
      it, in all combinations of the contacts. Torsion turns with the normal, so that no such
      formula holds, and epsilon at tilts between the samples may be smaller. Patches do not turn,
      and resist rolling as far as is sure (`Contacts.with_normals`).

    The maximum of hard fingers is at most epsilon of circular cones at beta + a. That of soft
    fingers is at most epsilon of the wrenches that are possible at any of their normals: forces in
    circular cones at beta + a, and forces in cones of half-angle a, each with the torsional moment
    along itself in either sense. With actuation 'per_finger' it is at most the number of fingers
    times that bound for 'total', since a sum of n support functions is at most n times the largest
    of them.

    Args:
        contacts: The contacts.
        tilt: Largest angle a between true and given normals [rad], from 0 to below pi/2: one value,
            or shape (..., n).
        options: Cones, actuation, torque scale, accuracy and threads; None: the defaults.
        bound_rtol: `rtol` of the maximum, which is always one of circular cones; None:
            `options.rtol`.
        progress: Called with the fraction of the work done, from 0 to 1.

    Raises:
        SettingError: A setting outside its range, friction 0, or too many soft fingers.
    """
    tilts = per_contact("tilt", tilt, contacts).reshape(-1, contacts.count)
    if not ((tilts >= 0.0) & (tilts < math.pi / 2.0)).all():
        raise SettingError(f"tilt must be from 0 to below pi/2; got {tilts}")
    options = options or EpsilonOptions()
    # The bound on the maximum comes from circular cones, which contain the polygons.
    bound = replace(options, edges=None, rtol=options.rtol if bound_rtol is None else bound_rtol)
    if ((tilts > 0.0) & (contacts.friction.reshape(tilts.shape) == 0.0)).any():
        raise SettingError("friction must be above 0 where normals may tilt")
    soft = (contacts.torsion_radius > 0.0).any(axis=-1).reshape(-1)
    tilted = bool(tilts.any())
    if tilted and soft.any() and contacts.count > MAX_SAMPLED_FINGERS:
        raise SettingError(
            f"tilts of soft fingers are sampled, for at most {MAX_SAMPLED_FINGERS} of them; "
            f"got {contacts.count}"
        )
    values, done = np.empty((3, len(soft))), 0
    flat = contacts.reshape((-1,))
    for rows in _chunks(contacts.count, soft, tilted=tilted):
        chunk, angles = flat.take(rows), tilts[rows]
        nominal = epsilon_with(chunk, options).lower
        minimum = np.minimum(_minimum(chunk, angles, options, nominal), nominal)
        maximum = (_maximum_soft if soft[rows[0]] else _maximum_hard)(chunk, angles, bound)
        values[:, rows] = nominal, minimum, maximum
        done += len(rows)
        if progress is not None:
            progress(done / len(soft))
    return EpsilonRange(*(locked(row.reshape(contacts.batch))[()] for row in values))


def _chunks(count: int, soft: Bools, *, tilted: bool) -> Iterator[Ints]:
    """Indices of hard grasps, then of soft ones, as many at a time as fit with their tilts."""
    for kind in (False, True):
        chosen = np.flatnonzero(soft == kind)
        step = max(1, CHUNK // len(_combinations(count))) if kind and tilted else CHUNK
        for start in range(0, len(chosen), step):
            yield chosen[start : start + step]


def _minimum(contacts: Contacts, tilt: Floats, options: EpsilonOptions, nominal: Floats) -> Floats:
    """Smallest epsilon over all tilts, shape (b,); see `epsilon_range`."""
    if not tilt.any():
        return nominal
    if (contacts.torsion_radius > 0.0).any():
        return smallest_epsilon(_tilted(contacts, tilt), options).lower
    return epsilon_with(contacts, options, cone_offset=-tilt).lower


def _combinations(count: int) -> np.ndarray[Any, np.dtype[np.int64]]:
    """Indices of the normals in every combination of sampled tilts, shape (k ** n, n)."""
    sampled = tilted_normals(np.array([0.0, 0.0, 1.0]), 0.0).shape[0]
    return np.indices((sampled,) * count).reshape(count, -1).T


def _tilted(contacts: Contacts, tilt: Floats) -> Contacts:
    """Every grasp (b,) with every combination of sampled tilts, batch (b, k ** n)."""
    sampled = tilted_normals(contacts.normals, tilt)  # (b, n, k, 3)
    choice = _combinations(contacts.count)
    normals = sampled[:, np.arange(contacts.count), choice]  # (b, k ** n, n, 3)
    return contacts.with_normals(normals)


def _maximum_hard(contacts: Contacts, tilt: Floats, options: EpsilonOptions) -> Floats:
    """Upper bound on epsilon of hard fingers over all tilts, shape (b,)."""
    bound = epsilon_with(contacts, options, cone_offset=tilt).upper
    if contacts.patch is None:
        return bound
    # Rolling is resisted by forces that press: those of cones from 90 degrees on need not.
    wide = (contacts.friction_angle + tilt >= math.pi / 2.0).any(axis=-1)
    return np.where(wide, _largest_force(contacts, options), bound)


def _largest_force(contacts: Contacts, options: EpsilonOptions) -> float:
    """Size of the forces of a grasp wrench space, which no epsilon exceeds."""
    return 1.0 if options.actuation == "total" else float(contacts.count)


def _maximum_soft(contacts: Contacts, tilt: Floats, options: EpsilonOptions) -> Floats:
    """Upper bound on epsilon of soft fingers over all tilts, shape (b,).

    Each contact is represented three times: by its forces, and by its normals n as wrenches of
    force n and moment +e n or -e n, e its torsion radius. All three are circular cones, and the
    support function of each is exactly the largest over all tilts. Patches add at most the moment
    of a unit force at the end of their longest semi-axis, in any direction.
    """
    size, count = len(contacts.points), contacts.count
    hard = wrench_axes(
        contacts.points, contacts.normals, np.zeros((size, count)), options.torque_scale
    )  # (b, n, 4, 6)
    axes = np.tile(hard, (1, 3, 1, 1))  # (b, 3 n, 4, 6)
    moments = hard[..., :3] * (contacts.torsion_radius / options.torque_scale)[..., None, None]
    axes[:, count : 2 * count, :, 3:] += moments
    axes[:, 2 * count :, :, 3:] -= moments
    widest = np.minimum(contacts.friction_angle + tilt, math.pi)
    angles = np.concatenate([widest, np.tile(tilt, 2)], axis=1)
    problem = WrenchProblem(
        kind=TOTAL,
        spherical=True,
        soft=False,
        rolling=False,
        size=size,
        count=3 * count,
        wrenches_of=partial(_rows_of, axes),
        tangential=np.sin(np.minimum(angles, math.pi / 2.0)),
        cones=np.stack([np.cos(angles), np.sin(angles)], axis=-1),
        rim=np.zeros((0, 2)),
        tilts_exceed_friction=np.zeros(size, dtype=np.bool_),
    )
    results = problem.solve(options.goal, with_forces=False, threads=options.threads)
    bound, longest = results.upper, _largest_force(contacts, options)
    if contacts.patch is not None:
        arms = np.linalg.norm(contacts.patch, ord=2, axis=(-2, -1)).max(axis=-1)
        rolling = bound + arms / options.torque_scale
        bound = np.where(results.rank == FULL_RANK, np.minimum(rolling, 1.0), 1.0)
    return longest * bound


def _rows_of(axes: Floats, chunk: slice) -> Floats:
    return np.ascontiguousarray(axes[chunk])
