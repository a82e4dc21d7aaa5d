"""Classification of grasps as S, M or U, exactly or by enumeration of extreme normals.

The result has epsilon, certificates, worst and best normals beside the label.
"""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from grasp3d.arrays import ArrayLike, Bytes, Floats, Ints, shaped, short_repr
from grasp3d.contact.contacts import Contacts, per_contact
from grasp3d.contact.friction_cones import turned
from grasp3d.errors import SettingError
from grasp3d.quality.closure import ForceClosure, force_closure
from grasp3d.quality.critical_angle import critical_friction_angle
from grasp3d.quality.ferrari_canny import Epsilon, epsilon_with
from grasp3d.quality.tilting import EpsilonRange, epsilon_range
from grasp3d.quality.wrenches import EpsilonOptions
from grasp3d.settings import MIN_EXTREMES, check_choice, whole_number
from grasp3d.settings.grasp_model import Method
from grasp3d.stability.enumeration import Extremes, Tested, extremes
from grasp3d.stability.exact import StabilityProblem, closing_normals, decide, margins
from grasp3d.stability.label import Label
from grasp3d.stability.normal_sets import face_normals

STATIONARY = 1e-12
"""Velocity of a contact, relative to that of its turning about the centre of mass, which is 0."""


@dataclass(frozen=True, eq=False)
class Stability:
    """Reliability of grasps whose normals are perceived with a limited sensor resolution.

    Labels are those of hard fingers in either method; torsion affects epsilon only. Epsilon and
    everything derived from it is computed when it is first read. For contacts on creases the label,
    and with method extremes the extremes of epsilon, consider all normals there; everything else is
    that of the perceived normals.
    """

    label: Bytes
    """`Label` codes, shape (...): 0 U, 1 M, 2 S."""
    method: Method
    """Method of the label."""
    hulls: Ints
    """Number of wrench hulls grown for the label, one for each closure test, shape (...); 0: closed
    form. Searches for critical angles are not counted."""
    batch: tuple[int, ...]
    """Shape of the batch (...)."""
    _problem: StabilityProblem

    __repr__ = short_repr

    @cached_property
    def critical_friction_angle(self) -> Floats:
        """beta* at the perceived normals [rad], shape (...)."""
        problem = self._problem
        return self._shaped(critical_friction_angle(problem.contacts))

    @cached_property
    def margin(self) -> Floats:
        """Margin [rad]: beta - alpha/2 - beta*, less all other uncertainties, shape (...).

        With method exact a grasp is S iff it is above 0; where the tilt of one of three contacts or
        more exceeds its friction, an S that the others hold alone may have a negative one. Of the
        finger with the least; beta at the smallest friction. -inf for two contacts at one point;
        nan for three contacts and more with one on a crease.
        """
        return self._shaped(margins(self._problem))

    @cached_property
    def worst(self) -> ForceClosure:
        """Force closure with the cones at the worst tilts, half-angle beta - alpha/2.

        Proves an S: the equilibrium forces lie within the cones of all tilted normals. Where not
        force-closed, its direction separates the grasp with all normals turned away from that
        direction, so that the grasp is no S; except where tilts exceed friction at some contact and
        the status is UNDECIDED: then nothing follows.
        """
        problem = self._problem
        return self._closure(problem.inner_offset)

    @cached_property
    def best(self) -> ForceClosure:
        """Force closure with the cones at the best tilts, half-angle beta + alpha/2.

        Proves a U, while these stay below 90 degrees: its direction separates the grasp whatever
        the tilts. Where force-closed, tilts toward the equilibrium forces are force-closed.
        """
        problem = self._problem
        return self._closure(problem.outer_offset)

    @property
    def epsilon(self) -> Floats:
        """Epsilon at the perceived normals, certified from below, shape (...)."""
        return self._shaped(self._nominal.lower)

    @property
    def epsilon_min(self) -> Floats:
        """Smallest epsilon over the tilts, shape (...).

        Method exact: over all tilts, see `quality.epsilon_range`; 0, which then is only a bound,
        where tilts exceed friction at some contact. Method extremes: over the combinations of
        extreme normals.
        """
        return self._shaped(self._range.minimum)

    @property
    def epsilon_max(self) -> Floats:
        """Largest epsilon over the tilts, shape (...).

        Method exact: an upper bound over all tilts. Method extremes: attained at one of the
        combinations of extreme normals.
        """
        return self._shaped(self._range.maximum)

    @cached_property
    def epsilon_effective(self) -> Floats:
        """Epsilon at the effective friction tan(beta - alpha/2), shape (...).

        Wan & Howe 2018, Sec. III-A. For hard fingers with circular cones it is the smallest epsilon
        over all tilts if none of them exceeds friction; else it is 0.
        """
        return self._shaped(self._effective.lower)

    @property
    def worst_normals(self) -> Floats:
        """Inward normals within the resolution that attain `epsilon_min`, shape (..., n, 3).

        Method exact: every normal turned away from the disturbance that is hardest to resist;
        epsilon there is `epsilon_min` for hard fingers with circular cones if no tilt exceeds
        friction.
        """
        return self._shaped(self._worst_and_best_normals[0])

    @property
    def best_normals(self) -> Floats:
        """Inward normals within the resolution at which the grasp is best, shape (..., n, 3).

        Method extremes: those of `epsilon_max`. Method exact: normals at which the grasp is
        force-closed with the largest friction; nan where none are known, as in every U.
        """
        return self._shaped(self._worst_and_best_normals[1])

    @property
    def combinations(self) -> int:
        """Number of combinations of extreme normals of each grasp; 0 for method exact."""
        if self.method == "exact":
            return 0
        return math.prod(normals.shape[1] for normals in self._tested)

    @cached_property
    def _tested(self) -> Tested:
        return self._problem.tested

    @cached_property
    def _nominal(self) -> Epsilon:
        return epsilon_with(self._problem.contacts, self._problem.options)

    def _closure(self, cone_offset: Floats) -> ForceClosure:
        contacts = self._problem.hard.reshape(self.batch)
        shape = contacts.friction.shape
        return force_closure(contacts, cone_offset=cone_offset.reshape(shape))

    @cached_property
    def _effective(self) -> Epsilon:
        problem = self._problem
        return epsilon_with(problem.contacts, problem.options, cone_offset=problem.inner_offset)

    @cached_property
    def _range(self) -> EpsilonRange:
        problem, nominal = self._problem, self._nominal.lower
        if self.method == "extremes":
            lowest, highest = self._enumerated
            return EpsilonRange(nominal, lowest.minimum, highest.maximum)
        low = epsilon_range(problem.low, problem.tilt, problem.options)
        if problem.low is problem.high:
            return low
        high = epsilon_range(problem.high, problem.tilt, problem.options)
        return EpsilonRange(nominal, low.minimum, high.maximum)

    @cached_property
    def _enumerated(self) -> tuple[Extremes, Extremes]:
        problem, tested = self._problem, self._tested
        low = extremes(problem.low, tested, problem.options)
        if problem.low is problem.high:
            return low, low
        return low, extremes(problem.high, tested, problem.options)

    @cached_property
    def _worst_and_best_normals(self) -> tuple[Floats, Floats]:
        if self.method == "extremes":
            lowest, highest = self._enumerated
            return lowest.worst_normals, highest.best_normals
        problem = self._problem
        contacts = problem.contacts
        u = self._effective.certificate.direction[:, None]
        turning = np.cross(u[..., 3:], contacts.points) / problem.options.torque_scale
        velocities = u[..., :3] + turning
        # A contact about which the object turns does not move, whatever rounding leaves.
        length = np.linalg.norm(turning, axis=-1, keepdims=True)
        velocities[(np.abs(velocities) <= STATIONARY * length).all(axis=-1)] = 0.0
        return turned(contacts.normals, -velocities, problem.tilt), closing_normals(problem)

    def _shaped(self, values: ArrayLike) -> Floats:
        in_batch: Floats = shaped(np.asarray(values), self.batch)
        return in_batch


def classify(
    contacts: Contacts,
    sensor_resolution: ArrayLike,
    *,
    method: Method = "exact",
    friction_interval: tuple[ArrayLike, ArrayLike] | None = None,
    location_error: ArrayLike = 0.0,
    creases: Mapping[int, ArrayLike] | None = None,
    extreme_normals: int = 8,
    rings: int | None = None,
    options: EpsilonOptions | None = None,
) -> Stability:
    """Classify grasps as surely stable (S), ambiguous (M) or surely unstable (U).

    The method 'exact' considers every normal within the resolution: a grasp is S if it is
    force-closed with cones of half-angle beta - alpha/2, and U if it is not with cones of
    beta + alpha/2. For two fingers this is a closed form, for more two closure tests. From
    beta + alpha/2 = 90 degrees on, grasps of three fingers and more are never U: such cones are not
    convex, and nothing is proved. Where tilts exceed friction at some of three contacts or more,
    and no contact is on a crease, the grasp is S if the other contacts alone are force-closed;
    seven contacts and more also if their critical friction angle is below the smallest
    beta - alpha/2. Where friction or resolution differ among the contacts this is safe, not exact.

    The method 'extremes' is that of Wan & Howe 2018, Sec. III: all combinations of the perceived
    and of extreme normals, `extreme_normals` on a rim alpha/2 away. It is sampled. An M may be
    labelled S or U, if the decisive tilt is not among the samples; with polygonal cones, which lie
    inside the circular ones, also an S as M or U, and an M as U.

    Args:
        contacts: The contacts, with their perceived normals.
        sensor_resolution: Resolution alpha [rad], from 0 to below pi: one value, or shape
            (..., n).
        method: 'exact' or 'extremes'.
        friction_interval: Smallest and largest friction coefficient, where friction is uncertain:
            each above 0, one number or of shape (..., n), with the contacts' friction between them;
            None: the contacts' friction alone. S is decided by the smallest, U by the largest.
        location_error: Largest distance between true and perceived contacts, in the unit of the
            points, at least 0: one value, or shape (..., n). Normals do not change with the
            location. Method exact only. Two contacts: S is exact, every U is correct; more: every S
            is correct, nothing is U, and grasps with a contact on a crease are M.
        creases: For contacts on creases and corners, by number: inward normals of the faces that
            meet there, shape (k, 3) or (..., k, 3). The contact may have any normal between them,
            tilted by up to alpha/2. They affect labels, and with method extremes epsilon. Method
            exact: exact for two fingers; for more the sets are sampled in steps of 5 degrees,
            safely: every S and U is correct.
        extreme_normals: Method extremes: number of normals on a rim, at least 3.
        rings: Method extremes: number of rims, at even steps up to alpha/2; None: one, and more
            where alpha > 4 beta, so that they are at most 2 beta apart.
        options: Cones, actuation, torque scale and accuracy of epsilon; edges apply to
            labels of method extremes too, while exact labels always come from circular cones.
            None: the defaults.

    Raises:
        SettingError: A setting outside its range, friction 0, or too many combinations.
        ContactError: Creases that do not match the contacts.

    Example:
        Three grasps of two fingers, felt with a resolution of 20 degrees:

        >>> import math
        >>> import grasp3d
        >>> points = [[[-1, 0, 0], [1, y, 0]] for y in (0.0, 0.6, 1.5)]
        >>> contacts = grasp3d.Contacts(points, [[[1, 0, 0], [-1, 0, 0]]] * 3, friction=0.5)
        >>> stability = grasp3d.classify(contacts, math.radians(20.0))
        >>> [grasp3d.Label(code).name for code in stability.label]
        ['S', 'M', 'U']
    """
    check_choice("method", method, Method)
    if rings is not None:
        whole_number("rings", rings, 1)
    whole_number("extreme normals", extreme_normals, MIN_EXTREMES)
    alpha = per_contact("sensor resolution", sensor_resolution, contacts)
    if not ((alpha >= 0.0) & (alpha < math.pi)).all():
        raise SettingError(
            "sensor resolution must be at least 0 and below pi radians; "
            f"got {sensor_resolution!r} (radians)"
        )
    location = per_contact("location error", location_error, contacts)
    if not ((location >= 0.0) & (location < math.inf)).all():
        raise SettingError(f"location error must be at least 0; got {location_error!r}")
    if method == "extremes" and location.any():
        raise SettingError("method extremes tests normals only; a location_error needs exact")
    low, high = _friction_range(contacts, friction_interval)
    flat = contacts.reshape((-1,))
    problem = StabilityProblem(
        contacts=flat,
        tilt=alpha.reshape(-1, contacts.count) / 2.0,
        low=flat if low is contacts else low.reshape((-1,)),
        high=flat if high is contacts else high.reshape((-1,)),
        creases=face_normals(creases or {}, contacts),
        extreme_normals=extreme_normals,
        rings=rings,
        options=options or EpsilonOptions(),
        location=location.reshape(-1, contacts.count),
    )
    stable, unstable, hulls = decide(problem, method)
    label = np.full(len(stable), Label.M, dtype=np.uint8)
    label[unstable] = Label.U
    label[stable] = Label.S
    return Stability(
        label=shaped(label, contacts.batch),
        method=method,
        hulls=shaped(hulls, contacts.batch),
        batch=contacts.batch,
        _problem=problem,
    )


def _friction_range(
    contacts: Contacts, interval: tuple[ArrayLike, ArrayLike] | None
) -> tuple[Contacts, Contacts]:
    """The contacts with their smallest and with their largest friction."""
    if not (contacts.friction > 0.0).all():
        raise SettingError(f"friction must be above 0; got {contacts.friction.min():g}")
    if interval is None:
        return contacts, contacts
    if not (isinstance(interval, Sequence) and len(interval) == 2):
        raise SettingError(f"friction_interval must be (smallest, largest); got {interval!r}")
    low, high = (
        per_contact(f"{end} friction", value, contacts)
        for end, value in zip(("smallest", "largest"), interval, strict=True)
    )
    if not ((low > 0.0) & (low <= contacts.friction) & (contacts.friction <= high)).all():
        raise SettingError(
            "friction_interval must be (smallest, largest), above 0, with the contacts' friction "
            "between them"
        )
    return contacts.with_friction(low), contacts.with_friction(high)
