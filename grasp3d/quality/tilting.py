"""Epsilon over all normals that a sensor cannot distinguish from the perceived ones.

The true normal of each contact lies anywhere within the tilt a = alpha/2 of the perceived one
(Wan & Howe 2018, Sec. III, who sample extreme normals). Friction, contact locations and the centre
of mass may be uncertain too.

A contact that is d away from its perceived position applies the torque of its force there and up to
d times the force more. Its support function falls by at most d |u_tau|. So all grasps with contacts
within d_i of the perceived positions are force-closed if

    max over i of h_i(u) - d_i |u_tau| > 0 for all u,

that is if the convex hull of the contacts' wrenches, forces bounded by 1 / d_i, contains every
torque of length 1 in its interior: epsilon with another ruler, like the grip force. For equal d it
contains the ball of torques of radius d, which is smaller than the ball of wrenches that bounds d
by epsilon, and depends neither on the centre of mass nor on a torque scale.
"""

import math
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple, TypeVar

import numpy as np

from grasp3d.arrays import ArrayLike, Bools, Floats, Ints, angles_between, locked, short_repr
from grasp3d.contact.contacts import Contacts, per_contact, tilts_of
from grasp3d.errors import SettingError
from grasp3d.quality.ferrari_canny import epsilon_with
from grasp3d.quality.force_problem import ForceProblem
from grasp3d.quality.tasks import Ellipsoid
from grasp3d.quality.wrenches import EpsilonOptions
from grasp3d.settings import GraspModel
from grasp3d.system.context import report_progress, unreported, within

CHUNK = 32_768
"""Grasps, or grasps with tilted normals, in memory at once."""

TORQUES = Ellipsoid(np.eye(6)[3:])
"""Torques of length 1."""

LARGEST_RATIO = 1e3
"""Largest location error of a contact over that of another one; smaller errors count as larger."""

FULL_RANK = 6
"""Dimension of all wrenches."""

COLLINEAR = 1e-9
"""Width of contacts on a line, relative to its length."""

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
    * soft fingers: a bound where normals may tilt. Torsion turns with the normal, so that no such
      formula holds. Three and more have at least the epsilon of hard fingers at beta - a; nothing
      is known of two, which resist no torque about their line as hard fingers: 0.

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
    soft = (contacts.torsion_radius > 0.0).any(axis=-1).reshape(-1)
    bounded = soft & tilts.any(axis=1)
    values, count = np.empty((3, len(soft))), 0
    flat = contacts.reshape((-1,))
    for rows in _chunks(soft.astype(np.int64) + bounded):
        chunk, angles = flat.take(rows), tilts[rows]
        nominal = minimum = epsilon_with(chunk, options).lower
        hard, torsion = chunk, np.zeros(len(rows))
        if bounded[rows[0]]:
            hard, torsion = _hard(chunk), _torsion(chunk, options)
        if angles.any():
            least = epsilon_with(hard, options, cone_offset=-angles)
            unknown = bounded[rows] & (least.rank < FULL_RANK)
            minimum = np.where(unknown, 0.0, np.minimum(least.lower, nominal))
        maximum = epsilon_with(hard, bound, cone_offset=angles).upper + torsion
        values[:, rows] = nominal, minimum, maximum
        count += len(rows)
        report_progress(count / len(soft))
    return EpsilonRange(*(locked(row.reshape(contacts.batch))[()] for row in values))


def _chunks(kinds: Ints) -> Iterator[Ints]:
    """Indices of grasps of one kind after the other, as many at a time as fit."""
    for kind in np.unique(kinds):
        chosen = np.flatnonzero(kinds == kind)
        for start in range(0, len(chosen), CHUNK):
            yield chosen[start : start + CHUNK]


def _hard(contacts: Contacts) -> Contacts:
    """The contacts as hard fingers."""
    return Contacts(contacts.points, contacts.normals, contacts.friction)


def _torsion(contacts: Contacts, options: EpsilonOptions) -> Floats:
    """The largest torsional moments of unit forces, as lengths of wrenches, shape (b,)."""
    moments = contacts.torsion_radius / options.torque_scale
    return np.asarray(moments.max(axis=1) if options.actuation == "total" else moments.sum(axis=1))


def _largest_force(contacts: Contacts, options: EpsilonOptions) -> float:
    """Size of the forces of a grasp wrench space, which no epsilon exceeds."""
    return 1.0 if options.actuation == "total" else float(contacts.count)


@dataclass(frozen=True)
class WrenchErrors:
    """What is not known about contacts beside their normals."""

    friction: tuple[float | tuple[float, ...], float | tuple[float, ...]]
    """Smallest and largest coefficient of friction, for all contacts or for each."""
    location: tuple[float, ...]
    """Location error of each contact, in the unit of the points."""
    center_radius: float = 0.0
    """Radius of the ball in which the centre of mass lies, in the same unit."""

    @classmethod
    def of_model(cls, model: GraspModel, center_radius: float = 0.0) -> "WrenchErrors":
        """The errors of a model, with lengths in the mesh's unit."""
        errors = (model.location_error,) * model.fingers
        return cls(model.friction_interval, errors, center_radius)

    @property
    def friction_known(self) -> bool:
        """Whether friction is known exactly."""
        return self.friction[0] == self.friction[1]


def uncertain_epsilon_range(
    contacts: Contacts,
    tilt: float | tuple[float, ...],
    errors: WrenchErrors,
    options: EpsilonOptions,
    *,
    bound_rtol: float | None = None,
) -> EpsilonRange:
    """As `epsilon_range`, over friction, contact locations and centre of mass as well.

    The minimum is at the smallest friction, the bound on the maximum at the largest. Contacts that
    are d away from their perceived positions change the support function by at most d / rho, for
    actuation 'total' the largest d, for 'per_finger' their sum, and the span of two hard fingers
    turns with the line between them; of three and more on one line the minimum is 0. A centre of
    mass c away from the nominal one changes epsilon by at most the factor
    s = (k + sqrt(k^2 + 4)) / 2, k = c / rho: the largest singular value of the change of reference
    point.

    Args:
        contacts: The contacts (b, n) at their nominal friction.
        tilt: As in `epsilon_range`, for all contacts or for each.
        errors: What is not known.
        options: Cones, actuation, torque scale and accuracy.
        bound_rtol: As in `epsilon_range`.
    """
    if errors.friction_known:
        interval = epsilon_range(contacts, tilt, options, bound_rtol=bound_rtol)
    else:
        interval = _over_friction(contacts, tilt, errors, options, bound_rtol)
    minimum, maximum = interval.minimum, interval.maximum
    if any(errors.location):
        change, turned = _of_locations(contacts, errors.location, options)
        minimum = np.maximum(minimum * turned - change, 0.0)
        minimum = np.where(_on_a_line(contacts), 0.0, minimum)
        with np.errstate(divide="ignore"):
            maximum = (maximum + change) / turned
        longest = _largest_force(contacts, options) * _largest_wrench(contacts, errors, options)
        maximum = np.minimum(maximum, longest)
    if errors.center_radius > 0.0:
        k = errors.center_radius / np.asarray(options.torque_scale)
        factor = 0.5 * (k + np.sqrt(k * k + 4.0))
        minimum, maximum = minimum / factor, maximum * factor
    return EpsilonRange(interval.nominal, locked(minimum), locked(maximum))


def _over_friction(
    contacts: Contacts,
    tilt: float | tuple[float, ...],
    errors: WrenchErrors,
    options: EpsilonOptions,
    bound_rtol: float | None,
) -> EpsilonRange:
    def epsilons(contacts: Contacts, tilt: float | tuple[float, ...]) -> EpsilonRange:
        return epsilon_range(contacts, tilt, options, bound_rtol=bound_rtol)

    cases = FrictionCases(contacts, *map(contacts.with_friction, errors.friction))
    nominal, low, high = over_friction(epsilons, cases, tilt)
    return EpsilonRange(nominal.nominal, low.minimum, high.maximum)


def _of_locations(
    contacts: Contacts, location: tuple[float, ...], options: EpsilonOptions
) -> tuple[Floats, Floats]:
    """(change of epsilon, cosine of the turn of the span), shape (b,) each."""
    scale = np.broadcast_to(np.asarray(options.torque_scale), contacts.batch)
    total = max(location) if options.actuation == "total" else sum(location)
    change = total / scale
    if contacts.count > 2 or (contacts.torsion_radius > 0.0).any():
        return change, np.ones(contacts.batch)
    # What two hard fingers cannot resist is the torque about their line d: the wrench (p x d, d)
    # spans the orthogonal complement, p a point of the line. It turns with d and moves with p.
    line = contacts.points[..., 1, :] - contacts.points[..., 0, :]
    opening = np.linalg.norm(line, axis=-1)
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = np.where(opening > 0.0, sum(location) / opening, math.inf)
        direction = np.nan_to_num(line / opening[..., None])
    turn = 2.0 * np.sin(0.5 * np.where(ratio > 1.0, math.pi, np.arcsin(np.minimum(ratio, 1.0))))
    middle = contacts.points.mean(axis=-2) / scale[..., None]
    size = np.sqrt(1.0 + (np.cross(middle, direction) ** 2).sum(axis=-1))
    moved = 0.5 * sum(location) / scale + np.linalg.norm(middle, axis=-1) * turn
    sine = np.minimum(np.hypot(moved, turn) / size, 1.0)
    return change, np.sqrt((1.0 - sine) * (1.0 + sine))


def _on_a_line(contacts: Contacts) -> Bools:
    """Whether three hard contacts or more are on one line, up to rounding, shape (b,).

    Epsilon is that within the wrenches that they span, without the torque about the line. Contacts
    beside the line resist that torque too, however little.
    """
    if contacts.count < 3:
        return np.zeros(contacts.batch, dtype=np.bool_)
    centred = contacts.points - contacts.points.mean(axis=-2, keepdims=True)
    lengths = np.linalg.svd(centred, compute_uv=False)
    straight = lengths[..., 1] <= COLLINEAR * np.maximum(lengths[..., 0], 1e-300)
    return np.asarray(straight & (contacts.torsion_radius == 0.0).all(axis=-1))


def _largest_wrench(contacts: Contacts, errors: WrenchErrors, options: EpsilonOptions) -> Floats:
    """Length of the longest wrench of a unit force at any position of a contact, shape (b,)."""
    arms = np.linalg.norm(contacts.points, axis=-1) + np.array(errors.location)
    arms += contacts.torsion_radius
    scale = np.asarray(options.torque_scale)
    return np.asarray(np.sqrt(1.0 + (arms.max(axis=-1) / scale) ** 2))


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


def location_tolerance(
    contacts: Contacts,
    *,
    relative_errors: ArrayLike = 1.0,
    cone_offset: ArrayLike = 0.0,
    rtol: float = 1e-2,
) -> Floats:
    """Largest location error of the contacts at which grasps are surely force-closed.

    Wan & Howe 2018 (Sec. III-A) name the uncertainty of contact locations. Normals do not change
    with the location. For two hard fingers the value is exact: the line between the contacts turns
    by asin(2 d / opening). For three and more it is safe: the grasp may tolerate more.

    Args:
        contacts: The contacts; torsion does not matter.
        relative_errors: Location errors of the contacts relative to each other, at least 0, the
            largest 1: one value or shape (..., n).
        cone_offset: Angle added to the cones' half-angles [rad], one value or shape (..., n).
            Minus half the sensor resolution: for every normal within it.
        rtol: Three contacts and more: accuracy, as a fraction of the value.

    Returns:
        Lengths in the unit of the contacts' points, shape (...); 0 where the grasp is not
        force-closed at the perceived positions.

    Raises:
        SettingError: A setting outside its range.

    Example:
        Three fingers around a disc of radius 30 mm tolerate that much:

        >>> import numpy as np
        >>> import grasp3d
        >>> from grasp3d.quality import location_tolerance
        >>> angles = np.radians([0.0, 120.0, 240.0])
        >>> points = 30.0 * np.stack([np.cos(angles), np.sin(angles), 0.0 * angles], axis=1)
        >>> contacts = grasp3d.Contacts(points, -points, friction=0.5)
        >>> print(f"{location_tolerance(contacts):.1f} mm")
        8.3 mm
    """
    relative = per_contact("relative errors", relative_errors, contacts)
    valid = (relative >= 0.0).all() and abs(relative.max(initial=0.0) - 1.0) <= 1e-9
    if relative.size and not valid:
        raise SettingError("relative errors must be at least 0, and the largest of them 1")
    if contacts.count == 2:
        return _tolerance_of_pairs(contacts, relative, cone_offset)
    hard = Contacts(contacts.points, contacts.normals, contacts.friction)
    forces = ForceProblem.of_contacts(hard, bound="total", lengths=True, cone_offset=cone_offset)
    scale = 1.0 / np.maximum(relative, 1.0 / LARGEST_RATIO).reshape(-1, contacts.count)
    axes_of = forces.problem.wrenches_of
    scaled = replace(
        forces.problem, wrenches_of=lambda chunk: axes_of(chunk) * scale[chunk, :, None, None]
    )
    force = replace(forces, problem=scaled).of_task(TORQUES, rtol).upper
    usable = ~forces.problem.tilts_exceed_friction
    return np.asarray(np.where(usable, 1.0 / force, 0.0).reshape(contacts.batch))[()]


def _tolerance_of_pairs(contacts: Contacts, relative: Floats, cone_offset: ArrayLike) -> Floats:
    """Two contacts: opening x sin(the angle by which their line may turn), exact."""
    half_angles = contacts.friction_angle + per_contact("cone offset", cone_offset, contacts)
    line = contacts.points[..., 1, :] - contacts.points[..., 0, :]
    spare = [
        np.minimum(
            half_angles[..., 0] - angles_between(contacts.normals[..., 0, :], side * line),
            half_angles[..., 1] - angles_between(contacts.normals[..., 1, :], -side * line),
        )
        for side in (1.0, -1.0)
    ]
    turn = np.clip(np.maximum(*spare), 0.0, np.pi / 2.0)
    opening = np.linalg.norm(line, axis=-1)
    return np.asarray(opening * np.sin(turn) / relative.sum(axis=-1))[()]
