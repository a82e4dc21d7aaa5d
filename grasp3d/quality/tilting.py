"""Epsilon over all normals that a sensor cannot distinguish from the perceived ones.

The true normal of each contact lies anywhere within the tilt a = alpha/2 of the perceived one
(Wan & Howe 2018, Sec. III, who sample extreme normals). Friction may be uncertain too.
Contacts are at their perceived locations. A soft finger presses at points (`Contacts.as_points`)
where its normal may tilt, as for forces; see `force_ranges`.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np

from grasp3d.arrays import ArrayLike, Bools, Floats, Ints, locked, short_repr
from grasp3d.contact.contacts import Contacts, tilts_of
from grasp3d.errors import SettingError
from grasp3d.quality.ferrari_canny import epsilon_with
from grasp3d.quality.wrenches import EpsilonOptions
from grasp3d.system.context import report_progress, unreported, within

CHUNK = 32_768
"""Grasps, or grasps with tilted normals, in memory at once."""

Tilt = TypeVar("Tilt")
Result = TypeVar("Result")


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
) -> EpsilonRange:
    """Epsilon at the given normals, its minimum and a bound on its maximum over all tilts.

    The minimum is, for

    * hard fingers with circular cones: exact. The worst tilt reduces the half-angle of a contact's
      cone by a whatever the direction of the disturbance, so the minimum is epsilon at beta - a.
      Where a exceeds beta at some contact the result is 0, a bound;
    * hard fingers with polygonal cones: epsilon of polygons of the effective friction, half-angle
      beta - a, as in the paper. A tilted polygon does not contain that polygon exactly, so epsilon
      at some tilt may be slightly smaller;
    * soft fingers: the smaller of epsilon at the given normals and that of the points at which they
      press, at beta - a: a bound in this model, in which the normal of each point tilts. A limit
      surface that turns with its normal may attain less, but is force-closed at every tilt where
      the minimum is above 0: it is 0 unless hard fingers are.

    The maximum of hard fingers is at most epsilon of circular cones at beta + a. Torsion adds at
    most its moment for a unit force: the largest of all fingers, or with actuation 'per_finger' the
    sum of them.

    Args:
        contacts: The contacts.
        tilt: Largest angle a between true and given normals [rad], from 0 to below pi/2: one value,
            or shape (..., n).
        options: Cones, actuation, torque scale, and accuracy; None: the defaults.
        bound_rtol: `rtol` of the maximum, which is always one of circular cones; None:
            `options.rtol`.

    Raises:
        SettingError: A setting outside its range, or friction 0.
    """
    tilts = tilts_of(tilt, contacts)
    options = options or EpsilonOptions()
    # The bound on the maximum comes from circular cones, which contain the polygons.
    bound = replace(options, edges=None, rtol=options.rtol if bound_rtol is None else bound_rtol)
    if ((tilts > 0.0) & (contacts.friction.reshape(tilts.shape) == 0.0)).any():
        raise SettingError("friction must be above 0 where normals may tilt")
    flat, may_tilt = contacts.reshape((-1,)), np.asarray(tilts.any(axis=1))
    values, count = np.empty((3, len(tilts))), 0
    for rows in _chunks(may_tilt):
        chunk, angles = flat.take(rows), tilts[rows]
        nominal = epsilon_with(chunk, options)
        if may_tilt[rows[0]]:
            hard = Contacts(chunk.points, chunk.normals, chunk.friction, groups=chunk.groups)
            least = epsilon_with(hard, options, cone_offset=-angles)
            minimum = np.minimum(least.lower, nominal.lower)
            if chunk.torsion_radius.any():
                points = chunk.as_points()
                narrower = -angles.repeat(points.count // chunk.count, axis=1)
                pressed = epsilon_with(points, options, cone_offset=narrower)
                # Without friction a soft finger is no disc.
                sure = least.closed & (pressed.rank == nominal.rank)
                minimum = np.where(sure, np.minimum(pressed.lower, nominal.lower), 0.0)
            widest = epsilon_with(hard, bound, cone_offset=angles).upper
            maximum = widest + _torsion(chunk, options)
        else:
            minimum, maximum = nominal.lower, epsilon_with(chunk, bound).upper
        values[:, rows] = nominal.lower, minimum, maximum
        count += len(rows)
        report_progress(count / len(tilts))
    return EpsilonRange(*(locked(row.reshape(contacts.batch))[()] for row in values))


def _chunks(kinds: Bools) -> Iterator[Ints]:
    """Indices of grasps of one kind after the other, as many at a time as fit."""
    for kind in np.unique(kinds):
        chosen = np.flatnonzero(kinds == kind)
        for start in range(0, len(chosen), CHUNK):
            yield chosen[start : start + CHUNK]


def _torsion(contacts: Contacts, options: EpsilonOptions) -> Floats:
    """The largest torsional moments of unit forces, as lengths of wrenches, shape (b,)."""
    moments = contacts.torsion_radius / options.torque_scale
    return np.asarray(moments.max(axis=1) if options.actuation == "total" else moments.sum(axis=1))


def uncertain_epsilon_range(
    contacts: Contacts,
    tilt: float,
    friction: tuple[float, float],
    options: EpsilonOptions,
    *,
    bound_rtol: float | None = None,
) -> EpsilonRange:
    """As `epsilon_range`, over friction as well.

    The minimum is at the smallest friction, the bound on the maximum at the largest.

    Args:
        contacts: The contacts (b, n) at their nominal friction.
        tilt: As in `epsilon_range`.
        friction: Smallest and largest coefficient of friction.
        options: Cones, actuation, torque scale and accuracy.
        bound_rtol: As in `epsilon_range`.
    """
    if friction[0] == friction[1]:
        return epsilon_range(contacts, tilt, options, bound_rtol=bound_rtol)

    def epsilons(contacts: Contacts, tilt: float) -> EpsilonRange:
        return epsilon_range(contacts, tilt, options, bound_rtol=bound_rtol)

    cases = FrictionCases(contacts, *map(contacts.with_friction, friction))
    nominal, low, high = over_friction(epsilons, cases, tilt)
    return EpsilonRange(nominal.nominal, low.minimum, high.maximum)


class FrictionCases(NamedTuple):
    """The same contacts at three frictions."""

    nominal: Contacts
    weakest: Contacts
    """With the smallest friction."""
    strongest: Contacts
    """With the largest friction."""


def over_friction(
    evaluated: Callable[[Contacts, Tilt | float], Result], cases: FrictionCases, tilt: Tilt
) -> tuple[Result, Result, Result]:
    """Results at the nominal, the smallest and the largest friction.

    Args:
        evaluated: Its result for contacts and the largest tilt of their normals.
        cases: The contacts.
        tilt: Largest tilt at the smallest and at the largest friction; nominal normals are exact.
    """
    with unreported():
        nominal = evaluated(cases.nominal, 0.0)
    with within(0.0, 0.5):
        weakest = evaluated(cases.weakest, tilt)
    with within(0.5, 1.0):
        return nominal, weakest, evaluated(cases.strongest, tilt)
