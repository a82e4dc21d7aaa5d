"""Grip force, payload and epsilon over all normals within the resolution of a sensor.

The true normal of each contact lies anywhere within the tilt a = alpha/2 of the perceived one
(Wan & Howe 2018, Sec. III), each independently. Let F be the force with cones of other half-angles
and a bound on the lengths of forces instead of their normal components:

* The cone of half-angle beta - a lies in every tilted one, and a force has no normal component that
  is longer than itself. So F at beta - a suffices whatever the normals are. Where lengths are
  bounded anyway, it is the largest force over all tilts: a tilt by a turns the normal away from any
  direction, so that the smallest support function over the tilts is that of the smaller cone.
* Every tilted cone lies in that of half-angle beta + a, below 90 degrees, and there a force is at
  most 1 / cos(beta) times as long as its normal component. So no normals need less than cos(beta)
  times F at beta + a.

In the first case soft fingers press at points (`Contacts.as_points`), and the pressure may gather
in one of them: this is what the proof covers. A finger whose limit surface turns with its normal
may need more at some tilt, so the force must also suffice for that surface at the given normals. In
the second case only the forces of soft fingers must balance, whatever torques they resist.

Epsilon has such a range too, for which Wan & Howe sample extreme normals. Friction may be uncertain
as well; contacts are at their perceived locations.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Literal, NamedTuple, TypeVar

import numpy as np

from grasp3d.arrays import RIGHT_ANGLE, ArrayLike, Bools, Bytes, Floats, Ints, locked, short_repr
from grasp3d.contact.contacts import Contacts, tilts_of
from grasp3d.errors import SettingError
from grasp3d.quality.ferrari_canny import epsilon_with
from grasp3d.quality.grip_forces import ForceBound, ForceOptions, ForceProblem
from grasp3d.quality.tasks import Task
from grasp3d.quality.wrenches import EpsilonOptions
from grasp3d.system.context import report_progress, unreported, within

TILTED_AT_ONCE = 32_768
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

    The minimum depends on the fingers:

    * Hard fingers with circular cones: it is exact. The worst tilt reduces the half-angle of a
      contact's cone by a whatever the direction of the disturbance, so the minimum is epsilon at
      beta - a. Where a exceeds beta at some contact the result is 0, a bound.
    * Hard fingers with polygonal cones: it is epsilon of polygons of the effective friction,
      half-angle beta - a, as in the paper. A tilted polygon does not contain that polygon exactly,
      so epsilon at some tilt may be slightly smaller.
    * Soft fingers: it is the smaller of epsilon at the given normals and epsilon of the points at
      which they press, at beta - a: a bound in this model, in which the normal of each point tilts.
      With a limit surface that turns with its normal, epsilon may be smaller, but the grasp is
      force-closed at every tilt if the minimum is above 0: it is 0 unless hard fingers are.

    The maximum of hard fingers is at most epsilon of circular cones at beta + a. Torsion adds at
    most its moment for a unit force: the largest of all fingers, or with actuation 'per_finger' the
    sum of them.

    Args:
        contacts: The contacts.
        tilt: Largest angle a between true and given normals [rad], from 0 to below pi/2: one value,
            or shape (..., n).
        options: Cones, actuation, torque scale, and accuracy; None: the defaults.
        bound_rtol: `rtol` of the maximum, which always comes from circular cones; None:
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
                # Without friction a soft finger is not a disc.
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
    """Yield indices of grasps, one kind after the other, in chunks that fit in memory."""
    for kind in np.unique(kinds):
        chosen = np.flatnonzero(kinds == kind)
        for start in range(0, len(chosen), TILTED_AT_ONCE):
            yield chosen[start : start + TILTED_AT_ONCE]


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
    """`epsilon_range` over an interval of friction as well.

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
        evaluated: Function of contacts and of the largest tilt of their normals.
        cases: The contacts.
        tilt: Largest tilt at the smallest and the largest friction; it is 0 at the nominal one.
    """
    with unreported():
        nominal = evaluated(cases.nominal, 0.0)
    with within(0.0, 0.5):
        weakest = evaluated(cases.weakest, tilt)
    with within(0.5, 1.0):
        return nominal, weakest, evaluated(cases.strongest, tilt)


Certainty = Literal["exact", "bound"]
"""How the extreme forces over all tilts are known: as exact values (within the tolerance), or as
safe bounds, the least not too large and the largest not too small; for soft fingers, in the model
in which they press at points (see above)."""

CHUNK = 4096
"""Grasps between two reports of progress."""

STEPS = 60
"""Most steps of the search, for tasks with wrenches that do not grow with the mass."""

LARGEST_MASS = 1e6
"""Mass [kg] beyond which no payload is searched for."""


@dataclass(frozen=True, eq=False)
class ForceRange:
    """Grip force at the given normals and over all tilts of them [N]."""

    nominal: Floats
    """At the given normals, shape (...); inf: no force suffices."""
    least: Floats
    """Smallest over all tilts, shape (...), as `how` says."""
    largest: Floats
    """Largest over all tilts, shape (...), as `how` says."""
    resistance: Bytes
    """`Resistance` codes at the given normals, shape (...)."""
    how: Certainty
    """How `least` and `largest` are known; `least` is a bound also where `largest` is exact."""

    __repr__ = short_repr


def force_range(
    contacts: Contacts,
    task: Task | ArrayLike,
    tilt: ArrayLike,
    *,
    bound: ForceBound = "normal",
    masses: ArrayLike | None = None,
    rtol: float = 1e-3,
) -> ForceRange:
    """Smallest forces that resist a task, at the given normals and over all tilts of them.

    Args:
        contacts: The contacts.
        task: As in `grip_force`.
        tilt: Largest angle a between true and given normals [rad], from 0 to below pi/2: one value,
            or shape (..., n).
        bound: As in `grip_force`. With 'norm' the largest force of hard fingers is exact, where no
            tilt exceeds a contact's friction angle; otherwise it is a safe bound, for soft fingers
            as points.
        masses: As in `grip_force`.
        rtol: As in `grip_force`.

    Raises:
        ContactError: As in `grip_force`.
        SettingError: A setting outside its range.

    Example:
        Three hard fingers around a ball, each normal known to within 5 degrees:

        >>> import math
        >>> import numpy as np
        >>> import grasp3d
        >>> from grasp3d.quality import Weight, force_range
        >>> angle = np.radians([0.0, 120.0, 240.0])
        >>> points = 0.03 * np.stack([np.cos(angle), np.sin(angle), np.zeros(3)], axis=1)
        >>> contacts = grasp3d.Contacts(points, -points, friction=0.5)
        >>> forces = force_range(contacts, Weight(0.5), math.radians(5.0))
        >>> print(f"{forces.nominal:.1f} N, at most {forces.largest:.1f} N ({forces.how})")
        5.2 N, at most 5.8 N (bound)
    """
    tilts = tilts_of(tilt, contacts)
    options = ForceOptions(task, masses, rtol).flat(contacts)
    flat = contacts.reshape((-1,))
    values = np.empty((3, len(tilts)))
    resistance = np.empty(len(tilts), dtype=np.uint8)
    for first in range(0, len(tilts), CHUNK):
        rows = slice(first, first + CHUNK)
        grasps, part = flat.take(rows), options.take(rows)
        nominal = part.found(ForceProblem.bounded(grasps, bound))[0]
        least, largest = nominal.lower, np.array(nominal.upper)
        if tilts[rows].any():
            least = _least(grasps, tilts[rows], part, bound)
            held = np.flatnonzero(np.isfinite(largest))
            worst = _largest(grasps.take(held), tilts[rows][held], part.take(held), bound)
            largest[held] = np.maximum(worst, largest[held])
        values[:, rows] = nominal.upper, np.minimum(least, nominal.upper), largest
        resistance[rows] = nominal.reason
        report_progress(min(1.0, (first + CHUNK) / len(tilts)))
    within = bool((tilts <= flat.friction_angle).all())
    is_exact = bound == "norm" and within and not flat.torsion_radius.any()
    nominal_, least_, largest_ = (locked(row.reshape(contacts.batch))[()] for row in values)
    codes = locked(resistance.reshape(contacts.batch))[()]
    how: Certainty = "exact" if is_exact or not tilts.any() else "bound"
    return ForceRange(nominal_, least_, largest_, codes, how)


def _largest(contacts: Contacts, tilts: Floats, options: ForceOptions, bound: ForceBound) -> Floats:
    """A force that suffices at all tilts of a flat batch, with tilts (b, n), shape (b,)."""
    largest = np.full(len(tilts), math.inf)
    sure = np.flatnonzero((tilts <= contacts.friction_angle).all(axis=1))
    some = contacts.take(sure)
    points, narrow = some.as_points(), some.friction_angle - tilts[sure]
    cones = np.tan(narrow).repeat(points.count // some.count, axis=-1)
    problem = ForceProblem.of_contacts(
        points.with_friction(cones), size="length", total=bound == "total"
    )
    largest[sure] = options.take(sure).found(problem)[0].upper
    return largest


def _least(contacts: Contacts, tilts: Floats, options: ForceOptions, bound: ForceBound) -> Floats:
    """A lower bound of the force at all tilts of a flat batch, with tilts (b, n), shape (b,)."""
    least, widest = np.zeros(len(tilts)), contacts.friction_angle + tilts
    soft = np.asarray((contacts.torsion_radius > 0.0).any(axis=1))
    # Whatever soft fingers resist by torsion, their forces must balance: as if all were at the
    # centre of mass.
    points = np.where(soft[:, None, None], 0.0, contacts.points)
    known = ~soft | (not options.has_torques)
    rows = np.flatnonzero(known & (widest < RIGHT_ANGLE).all(axis=1))
    cones = np.tan(widest[rows])
    wide = Contacts(points[rows], contacts.normals[rows], cones, groups=contacts.groups)
    problem = ForceProblem.of_contacts(wide, size="length", total=bound == "total")
    least[rows] = options.take(rows).found(problem)[0].lower
    if bound == "norm":
        return least
    return np.asarray(least * np.cos(contacts.friction_angle).min(axis=1))


def force_within_tilt(
    contacts: Contacts,
    task: Task,
    *,
    at: Literal["worst", "best"] = "worst",
    tilt: ArrayLike = 0.0,
    bound: ForceBound = "normal",
    rtol: float = 1e-3,
) -> Floats:
    """Force for a task at the worst or the best normals within a tilt of the given ones [N].

    With 'worst' it suffices at all these normals; with 'best' none of them needs less. Other
    arguments, shape and errors are as for `payload`; inf where no force suffices.
    """
    flat, tilts = contacts.reshape((-1,)), tilts_of(tilt, contacts)
    options = ForceOptions(task, None, rtol)
    if at == "best":
        needed = _least(flat, tilts, options, bound)
    else:
        needed = _enough(flat, tilts, options, bound)
    return locked(needed.reshape(contacts.batch))[()]


def _enough(contacts: Contacts, tilts: Floats, options: ForceOptions, bound: ForceBound) -> Floats:
    """A force that suffices at all tilts, for soft fingers also with their limit surface, (b,)."""
    if tilts.any() and not contacts.torsion_radius.any():
        return _largest(contacts, tilts, options, bound)
    nominal = options.found(ForceProblem.bounded(contacts, bound))[0].upper
    if not tilts.any():
        return nominal
    return np.maximum(nominal, _largest(contacts, tilts, options, bound))


def payload(
    contacts: Contacts,
    task: Task,
    force: float,
    *,
    tilt: ArrayLike = 0.0,
    bound: ForceBound = "normal",
    rtol: float = 1e-3,
) -> Floats:
    """Largest mass for which a force suffices, at all normals within a tilt of the given ones.

    Soft fingers press at points where normals may tilt; see `force_range`.

    Args:
        contacts: The contacts.
        task: What must be resisted; its own mass has no effect.
        force: Available force [N], bounded as `bound` states.
        tilt: As in `force_range`, whose largest force counts.
        bound: As in `grip_force`.
        rtol: As in `grip_force`.

    Returns:
        Masses [kg], shape (...); 0 where the force does not hold even the part that does not grow
        with the mass, or no force holds the task.

    Raises:
        SettingError: A setting outside its range, or a task without weight or acceleration.

    Example:
        Two soft fingers that press with 40 N each, the part turned in any direction:

        >>> import grasp3d
        >>> from grasp3d.quality import Weight, payload
        >>> points, normals = [[-0.02, 0, 0], [0.02, 0, 0]], [[1, 0, 0], [-1, 0, 0]]
        >>> contacts = grasp3d.Contacts(points, normals, friction=0.5, torsion_radius=0.003)
        >>> print(f"{payload(contacts, Weight(), 40.0):.2f} kg")
        2.88 kg
    """
    if not 0.0 < force < math.inf:
        raise SettingError(f"the available force must be finite and above 0 [N]; got {force:g}")
    if not isinstance(task, Task) or task.mass is None:
        raise SettingError("a payload needs a task with a weight or an acceleration")
    task = task.scaled_to(1.0)
    if all(term.mass is not None for term in task.terms()):
        needed = force_within_tilt(contacts, task, tilt=tilt, bound=bound, rtol=rtol)
        with np.errstate(divide="ignore"):  # no force is needed where nothing accelerates
            return locked(force / needed)[()]
    options = ForceOptions(task, None, rtol)
    flat = contacts.reshape((-1,))
    tilts = tilts_of(tilt, contacts)

    def excess(rows: Ints, masses: Floats) -> Floats:
        """Force that some of the grasps need for masses (r,), beyond the available one."""
        part = replace(options, masses=masses)
        needed = _enough(flat.take(rows), tilts[rows], part, bound)
        return np.asarray(needed - force)

    masses = _search(excess, len(tilts), rtol)
    return locked(masses.reshape(contacts.batch))[()]


def _search(excess: Callable[[Ints, Floats], Floats], count: int, rtol: float) -> Floats:
    """Largest masses that a force holds: the force is convex in the mass, so secants close in."""
    low, high = np.zeros(count), np.full(count, math.inf)
    at_low, at_high = excess(np.arange(count), low), np.full(count, math.inf)
    rows = np.flatnonzero(at_low <= 0.0)
    guess = np.ones(count)
    for step in range(STEPS):
        bracketed = np.isfinite(high[rows])
        near = bracketed & (high[rows] - low[rows] <= rtol * low[rows])
        rows = rows[~near & (low[rows] < LARGEST_MASS)]
        if not len(rows):
            break
        more = excess(rows, guess[rows])
        enough = more <= 0.0
        low[rows[enough]], at_low[rows[enough]] = guess[rows[enough]], more[enough]
        high[rows[~enough]], at_high[rows[~enough]] = guess[rows[~enough]], more[~enough]
        with np.errstate(invalid="ignore"):
            secant = low + (high - low) * at_low / (at_low - at_high)
        # A secant comes from below; a point just above the lower end may end the search.
        candidate = (secant, low * (1.0 + 0.9 * rtol), 0.5 * (low + high))[step % 3]
        inside = (candidate > low) & (candidate < high)
        with np.errstate(invalid="ignore"):
            guess = np.where(inside, candidate, 0.5 * (low + high))
        guess = np.where(np.isinf(high), 2.0 * np.maximum(low, 0.5), guess)
    return low
