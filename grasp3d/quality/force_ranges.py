"""Grip force and payload over all normals that a sensor cannot distinguish from the perceived ones.

The true normal of each contact lies anywhere within the tilt a = alpha/2 of the perceived one (Wan
& Howe 2018, Sec. III). For hard fingers, beta the half-angle of a friction cone:

* Where lengths of forces are bounded, the largest force over all tilts is exactly that of cones of
  half-angle beta - a: a tilt by a turns the normal away from any direction, so the smallest support
  function over the tilts is that of the smaller cone; the contacts tilt independently.
* Where normal components are bounded, that force is still enough, because the smaller cone lies in
  every tilted one and no force has a normal component larger than its length.
* Every tilted cone lies in the one of half-angle beta + a, and in it a force is at most 1/cos(beta)
  times as long as its normal component: so no tilt needs less than cos(beta) times the force that
  the larger cones need with bounded lengths.

The torsional moment of soft fingers turns with the normal, so that none of this holds. But for one
direction u of wrenches the contacts tilt independently, and the tilts that resist least along it
are found contact by contact; at these tilts some wrench of the task is the hardest one and has a
direction of its own. So a direction, tilts and a wrench lead to the next ones, with ever larger
forces, from several starts; the last tilts are then evaluated against the whole task. What is found
is a force that some tilt needs: others may need more.
"""

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np

from grasp3d.arrays import ArrayLike, Bytes, Floats, Ints, locked, short_repr
from grasp3d.contact.contacts import Contacts, tilts_of
from grasp3d.contact.friction_cones import tilted_normals, turned
from grasp3d.errors import SettingError
from grasp3d.quality.closure import force_closure
from grasp3d.quality.force_problem import ForceBound, ForceProblem
from grasp3d.quality.grip_forces import ForceOptions, GripForce
from grasp3d.quality.tasks import Task
from grasp3d.system.context import report_progress, unreported

ROUNDS = 5
"""Tilts that are tried from each start."""

EVALUATIONS = 3
"""Most evaluations of the tilts found against the whole task; each leads on to others."""

AROUND = 24
"""Sampled normals on the rim of a contact's possible normals."""

AXES = np.concatenate([np.eye(6)[:3], -np.eye(6)[:3]])
"""Directions of wrenches from which the search starts (s, 6)."""

STARTS = 3
"""Tilts in a few directions from which the search goes on, the worst ones."""

COARSE = 1e-2
"""Relative gap of bounds while the tilts are searched."""

Certainty = Literal["exact", "bound", "sampled"]
"""How the extreme forces over all tilts are known: as exact values (within the tolerance); as safe
bounds, the least not too large and the largest not too small; or as those of sampled tilts, beyond
which others may lie."""

CHUNK = 4096
"""Grasps between two reports of progress."""

STEPS = 60
"""Most steps of the search, for tasks with wrenches that do not grow with the mass."""

LARGEST_MASS = 1e6
"""Mass [kg] beyond which no payload is searched for."""


@dataclass(frozen=True, eq=False)
class _Tilted:
    """The worst tilts of grasps so far (b, ...), and the forces that they need at least."""

    normals: Floats
    """Shape (b, n, 3)."""
    force: Floats
    """Shape (b,)."""

    def worsen(self, grasps: Ints, normals: Floats, force: Floats) -> None:
        """Take other tilts of some grasps where they need more force."""
        more = force > self.force[grasps]
        self.normals[grasps[more]], self.force[grasps[more]] = normals[more], force[more]


def largest_sampled(
    contacts: Contacts, tilt: Floats, options: ForceOptions, nominal: GripForce
) -> tuple[Floats, Floats]:
    """Largest force found among tilts, a certified upper bound at one of them.

    Args:
        contacts: Grasps, a flat batch.
        tilt: Largest tilts [rad], shape (b, n).
        options: The task and more.
        nominal: Their forces without tilts.

    Returns:
        The forces (b,) and the normals (b, n, 3) of these tilts.
    """
    largest, worst = np.array(nominal.upper), contacts.normals.copy()
    # Where no force suffices none is larger, so nothing is searched there.
    rows = np.flatnonzero(np.isfinite(largest))
    normals, force = _opened(contacts.take(rows), tilt[rows], options.take(rows))
    held = np.isfinite(force)
    largest[rows[~held]], worst[rows[~held]] = math.inf, normals[~held]
    rows = rows[held]
    if len(rows):
        sampled = _Tilted(contacts.normals[rows], nominal.lower[rows])
        sampled.worsen(np.arange(len(rows)), normals[held], force[held])
        searched = contacts.take(rows), tilt[rows], options.take(rows), sampled
        weakest = nominal.certificate.direction[rows]
        largest[rows], worst[rows] = _worst(*searched, largest[rows], weakest)
    return largest, worst


def _worst(
    contacts: Contacts,
    tilt: Floats,
    options: ForceOptions,
    sampled: _Tilted,
    largest: Floats,
    weakest: Floats,
) -> tuple[Floats, Floats]:
    """The results of `largest_sampled` by a search from the worst of some tilts.

    Args:
        contacts: Grasps that some force holds, a flat batch.
        tilt: Largest tilts [rad], shape (b, n).
        options: The task and more.
        sampled: The worst tilts so far.
        largest: The largest forces so far, shape (b,).
        weakest: Directions along which the grasps resist least without tilts, shape (b, 6).
    """
    active, worst = np.arange(len(tilt)), contacts.normals.copy()
    wrenches = _hardest(options, -weakest)
    directions, forces = [], []
    for normals in _tilts_around(contacts, tilt):
        direction, force = _against(contacts.with_normals(normals), wrenches, options)
        sampled.worsen(active, normals, force)
        directions.append(direction)
        forces.append(force)
    order = np.argsort(np.stack(forces), axis=0)[-STARTS:]  # (STARTS, b)
    starts = [
        _against(contacts, _hardest(options, along), options)[0]
        for along in np.broadcast_to(AXES[:, None], (len(AXES), len(tilt), 6))
    ]
    starts += [weakest, *np.take_along_axis(np.stack(directions), order[..., None], axis=0)]
    for start in starts:
        _ascend(contacts, tilt, options, active, start, sampled)
    for _ in range(EVALUATIONS):
        normals = sampled.normals[active]
        evaluated = options.take(active).force(contacts.take(active).with_normals(normals))
        more = evaluated.upper > largest[active]
        larger = np.asarray(evaluated.upper > largest[active] * (1.0 + COARSE))
        worst[active[more]] = normals[more]
        largest[active] = np.maximum(largest[active], evaluated.upper)
        active = active[larger]
        if not len(active):
            break
        weakest = evaluated.certificate.direction[larger]
        _ascend(contacts, tilt, options, active, weakest, sampled)
    return largest, worst


def _tilts_around(contacts: Contacts, tilt: Floats) -> Iterator[Floats]:
    """Normals (b, n, 3) tilted in combinations of a few directions."""
    rim = tilted_normals(contacts.normals, tilt, count=4)[..., 1:, :]
    for first in range(4):
        for other in range(4):
            yield np.concatenate([rim[:, :1, first], rim[:, 1:, other]], axis=1)


def least_sampled(
    contacts: Contacts, tilt: Floats, options: ForceOptions, nominal: GripForce
) -> Floats:
    """Least force found among tilts, a certified lower bound at one of them, shape (b,).

    Normals turn toward the contact forces of the hardest wrench; where no force suffices, toward
    the middle of the contacts.
    """
    middle = contacts.points.mean(axis=1, keepdims=True)
    forces = nominal.certificate.forces[..., :3]
    goals = np.where(np.isfinite(forces), forces, middle - contacts.points)
    toward = turned(contacts.normals, goals, tilt)
    normals = np.where(np.isfinite(toward), toward, contacts.normals)
    first = options.force(contacts.with_normals(normals))
    forces = first.certificate.forces[..., :3]
    again = turned(contacts.normals, np.where(np.isfinite(forces), forces, normals), tilt)
    second = options.force(contacts.with_normals(again))
    return np.minimum(np.minimum(nominal.lower, first.lower), second.lower)


def _opened(contacts: Contacts, tilt: Floats, options: ForceOptions) -> tuple[Floats, Floats]:
    """Tilts (b, n, 3) away from the direction in which smaller cones are not force-closed.

    Without torsion no force is then safe along it, and torsion may not help. Returns the forces of
    these tilts too, 0 for grasps whose smaller cones are force-closed.
    """
    hard = Contacts(contacts.points, contacts.normals, contacts.friction, patch=contacts.patch)
    offset = -np.minimum(tilt, contacts.friction_angle)
    closure = force_closure(hard, cone_offset=offset)
    opened = np.flatnonzero(~closure.closed)
    force, normals = np.zeros(len(tilt)), contacts.normals.copy()
    grasps = contacts.take(opened)
    directions = closure.certificate.direction[opened]
    normals[opened] = _weakest(grasps, tilt[opened], directions)
    coarse = replace(options.take(opened), rtol=COARSE)
    force[opened] = coarse.force(grasps.with_normals(normals[opened])).lower
    return normals, force


def _ascend(
    contacts: Contacts,
    tilt: Floats,
    options: ForceOptions,
    active: Ints,
    directions: Floats,
    worst: _Tilted,
) -> None:
    """Tilt some grasps (k,) against directions (k, 6), find directions for the tilts, by turns."""
    for _ in range(ROUNDS):
        grasps, some = contacts.take(active), options.take(active)
        normals = _weakest(grasps, tilt[active], directions)
        directions, force = _against(
            grasps.with_normals(normals), _hardest(some, -directions), some
        )
        further = (force > worst.force[active] * (1.0 + COARSE)) & np.isfinite(force)
        worst.worsen(active, normals, force)
        active, directions = active[further], directions[further]
        if not len(active):
            break


def _hardest(options: ForceOptions, directions: Floats) -> Floats:
    """Wrenches of the task that reach farthest along directions (b, 6)."""
    if isinstance(options.task, Task):
        masses = None if options.masses is None else np.asarray(options.masses)
        return options.task.farthest_for(masses, directions)
    return np.asarray(options.task)


def _against(contacts: Contacts, wrenches: Floats, options: ForceOptions) -> tuple[Floats, Floats]:
    """Directions (b, 6) that prove the force that wrenches need, and that force (b,)."""
    problem = ForceProblem.of_contacts(contacts, bound=options.bound)
    bounds = problem.of_wrenches(wrenches, COARSE, proven=False)
    return bounds.direction, bounds.lower


def _weakest(contacts: Contacts, tilt: Floats, directions: Floats) -> Floats:
    """Normals within the tilts that resist least along directions (b, 6), shape (b, n, 3)."""
    g = directions[:, None, :3] + np.cross(directions[:, None, 3:], contacts.points)
    away = turned(contacts.normals, -g, tilt)[..., None, :]
    candidates = np.concatenate(
        [tilted_normals(contacts.normals, tilt, count=AROUND), away], axis=-2
    )  # (b, n, k, 3)
    normal = (candidates * g[..., None, :]).sum(axis=-1)
    square = np.maximum((g * g).sum(axis=-1)[..., None] - normal**2, 0.0)
    twist = (candidates * directions[:, None, None, 3:]).sum(axis=-1)
    twist = twist * contacts.torsion_radius[..., None]
    if contacts.rolling_arms is not None:
        turning = (contacts.rolling_arms * directions[:, None, None, 3:]).sum(axis=-1)
        normal = normal + np.linalg.norm(turning, axis=-1)[..., None]
    support = normal + np.sqrt(contacts.friction[..., None] ** 2 * square + twist**2)
    least = support.argmin(axis=-1)[..., None, None]
    return np.asarray(np.take_along_axis(candidates, least, axis=-2)[..., 0, :])


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
    """How `least` and `largest` are known; of hard fingers with bounded lengths `least` is a bound
    also where `largest` is exact."""

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
    """Smallest forces that resist a task, at the given normals and at all that may be true.

    Args:
        contacts: The contacts.
        task: As in `grip_force`.
        tilt: Largest angle a between true and given normals [rad], from 0 to below pi/2: one value,
            or shape (..., n).
        bound: As in `grip_force`. With 'norm' the largest force of hard fingers is exact, where no
            tilt exceeds a contact's friction angle; otherwise it is a safe bound.
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
    soft = bool((contacts.torsion_radius > 0.0).any())
    options = ForceOptions(task, bound, masses, rtol).flat(contacts)
    flat = contacts.reshape((-1,))
    values = np.empty((3, len(tilts)))
    resistance = np.empty(len(tilts), dtype=np.uint8)
    for first in range(0, len(tilts), CHUNK):
        rows = slice(first, first + CHUNK)
        grasps, part = flat.take(rows), options.take(rows)
        bounds = part.force(grasps)
        if not tilts[rows].any():
            least, largest = bounds.lower, bounds.upper
        else:
            limits = grasps, tilts[rows], part
            if soft:
                largest, _ = largest_sampled(*limits, bounds)
                least = least_sampled(*limits, bounds)
            else:
                least, largest = _bounds(*limits)
        values[:, rows] = bounds.upper, np.minimum(least, bounds.upper), largest
        resistance[rows] = bounds.resistance
        report_progress(min(1.0, (first + CHUNK) / len(tilts)))
    within = bool((tilts <= flat.friction_angle).all())
    how: Certainty = "sampled" if soft else "exact" if bound == "norm" and within else "bound"
    if not tilts.any():
        how = "exact"
    nominal, least, largest = (locked(row.reshape(contacts.batch))[()] for row in values)
    codes = locked(resistance.reshape(contacts.batch))[()]
    return ForceRange(nominal, least, np.maximum(largest, nominal), codes, how)


def _bounds(contacts: Contacts, tilt: Floats, options: ForceOptions) -> tuple[Floats, Floats]:
    """Least and largest force of hard fingers over all tilts, or safe bounds, shape (b,) each."""
    angles = contacts.friction_angle
    largest = np.full(len(tilt), math.inf)
    # Where a tilt exceeds friction no force lies in all cones of that contact: the others hold.
    safe = tilt <= angles
    for fingers in np.unique(safe[safe.any(axis=-1)], axis=0):
        rows = np.flatnonzero((safe == fingers).all(axis=-1))
        grasps = contacts.take(rows).fingers(fingers)
        offset = -tilt[rows][:, fingers]
        largest[rows] = options.take(rows).force_of_lengths(grasps, offset).upper
    # Wider cones are not convex from 90 degrees on: any force may then do.
    convex = np.asarray((angles + tilt < math.pi / 2.0).all(axis=-1))
    wide = options.force_of_lengths(contacts, np.where(convex[:, None], tilt, 0.0)).lower
    least = np.where(convex, wide, 0.0)
    if options.bound != "norm":
        least = least * np.cos(angles).min(axis=-1)
    return least, largest


@dataclass(frozen=True, eq=False)
class WorstCase:
    """Largest forces of grasps for any masses, at tilts that are searched for only once."""

    contacts: Contacts
    """A flat batch."""
    tilts: Floats
    options: ForceOptions
    worst: Contacts | None
    """Soft fingers: the same grasps at the worst tilts found for the options' own mass."""

    @classmethod
    def of(cls, contacts: Contacts, tilts: Floats, options: ForceOptions) -> "WorstCase":
        """The worst case of a flat batch (b,) with tilts (b, n)."""
        worst = None
        if tilts.any() and (contacts.torsion_radius > 0.0).any():
            nominal = options.force(contacts)
            _, normals = largest_sampled(contacts, tilts, options, nominal)
            worst = contacts.with_normals(normals)
        return cls(contacts, tilts, options, worst)

    def force(self, rows: Ints, masses: Floats) -> Floats:
        """Largest forces of some of the grasps for masses (r,)."""
        options = replace(self.options, masses=masses)
        grasps = self.contacts.take(rows)
        nominal = options.force(grasps).upper
        if not self.tilts.any():
            return nominal
        if self.worst is None:
            _, largest = _bounds(grasps, self.tilts[rows], options)
        else:
            largest = options.force(self.worst.take(rows)).upper
        return np.maximum(nominal, largest)


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

    Args:
        contacts: The contacts.
        task: What must be resisted; its own mass does not matter.
        force: Force at hand [N], bounded as `bound` says.
        tilt: As in `force_range`, whose largest force counts.
        bound: As in `grip_force`.
        rtol: As in `grip_force`.

    Returns:
        Masses [kg], shape (...); 0: the force does not even hold what does not grow with the mass,
        or no force holds the task.

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
        raise SettingError(f"the force at hand must be finite and above 0 [N]; got {force:g}")
    if task.mass is None:
        raise SettingError("a payload needs a task with a weight or an acceleration")
    task = task.scaled_to(1.0)
    options = ForceOptions(task, bound, None, rtol)
    if all(term.mass is not None for term in task.terms()):
        with unreported():
            largest = force_range(contacts, task, tilt, bound=bound, rtol=rtol).largest
        with np.errstate(divide="ignore"):  # no force is needed where nothing accelerates
            return locked(force / largest)[()]
    flat = contacts.reshape((-1,))
    tilts = tilts_of(tilt, contacts)
    masses = _search(WorstCase.of(flat, tilts, options), force, rtol)
    return locked(masses.reshape(contacts.batch))[()]


def _search(worst: WorstCase, force: float, rtol: float) -> Floats:
    """Largest masses that a force holds: the force is convex in the mass, so secants close in."""
    count = len(worst.contacts.points)
    low, high = np.zeros(count), np.full(count, math.inf)
    at_low, at_high = worst.force(np.arange(count), low) - force, np.full(count, math.inf)
    rows = np.flatnonzero(at_low <= 0.0)
    guess = np.ones(count)
    for step in range(STEPS):
        bracketed = np.isfinite(high[rows])
        near = bracketed & (high[rows] - low[rows] <= rtol * low[rows])
        rows = rows[~near & (low[rows] < LARGEST_MASS)]
        if not len(rows):
            break
        excess = worst.force(rows, guess[rows]) - force
        enough = excess <= 0.0
        low[rows[enough]], at_low[rows[enough]] = guess[rows[enough]], excess[enough]
        high[rows[~enough]], at_high[rows[~enough]] = guess[rows[~enough]], excess[~enough]
        with np.errstate(invalid="ignore"):
            secant = low + (high - low) * at_low / (at_low - at_high)
        # A secant comes from below; a point just above the lower end may end the search.
        candidate = (secant, low * (1.0 + 0.9 * rtol), 0.5 * (low + high))[step % 3]
        inside = (candidate > low) & (candidate < high)
        with np.errstate(invalid="ignore"):
            guess = np.where(inside, candidate, 0.5 * (low + high))
        guess = np.where(np.isinf(high), 2.0 * np.maximum(low, 0.5), guess)
    return low
