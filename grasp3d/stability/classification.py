"""Classification of grasps as S, M or U, exactly or by enumeration of extreme normals.

All uncertainties besides the tilts are covered by two critical angles: a grasp is S if the worst is
below beta - alpha/2, and U if the best is at least beta + alpha/2.

*Normals on creases.* A contact may have any normal of a set. For two contacts, the largest and the
smallest angle between the set and the line through both count. For more, the set lies in a cap of
radius r about its middle: a cone narrower by r lies in the cone of each of its normals, and a cone
wider by r contains them all.

*Locations.* A contact is anywhere within its location error d of the perceived point, where the
normal turns by up to omega from the set of normals; see `mesh.turns`. For two contacts, the line
between them turns by up to eta = asin((d1 + d2) / opening) in any direction. The worst angle is at
most the larger of the two contacts' angles, each plus its omega, plus eta; the best is at least the
same with omega and eta subtracted. For more, cones are narrower by omega, `angle_brackets` of
`quality.critical_angle` takes the location error as a displacement, and the best angle is 0.

Grasps may have any number of contacts, with normals known to within different angles: the number of
links that touch differs from grasp to grasp, and links may have different sensors.
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.search.antipodal_candidates import pair_angles
from grasp3d.arrays import (
    ArrayLike,
    Bools,
    Bytes,
    Floats,
    Ints,
    angles_between,
    locked,
    shaped,
    short_repr,
)
from grasp3d.contact.contacts import Contacts, per_contact
from grasp3d.errors import ContactError, SettingError
from grasp3d.quality.critical_angle import (
    angle_brackets,
    brackets_of_smooth,
    critical_friction_angle,
    force_closure,
)
from grasp3d.quality.ferrari_canny import epsilon_with
from grasp3d.quality.force_ranges import epsilon_range
from grasp3d.quality.wrenches import EpsilonOptions
from grasp3d.settings import MAX_FINGERS, check_choice, whole_number
from grasp3d.settings.grasp_model import Method
from grasp3d.stability.label import Label, Thresholds, label_angles, unstable_from
from grasp3d.stability.normal_sets import (
    EXTREME_NORMALS,
    MIN_EXTREMES,
    Creases,
    Extremes,
    NormalSets,
    WorstAndBest,
    extremes,
    face_normals,
)

ANY_DIRECTION = np.array([0.0, 0.0, 1.0])


def uncertain_angles(
    points: Floats,
    sets: NormalSets,
    *,
    wider: tuple[Floats, Floats] | None = None,
    location: Floats | None = None,
    turns: Floats | None = None,
    first: tuple[Floats, Floats] | None = None,
    tolerance: float = 1e-4,
) -> WorstAndBest:
    """The worst and the best critical friction angles over all that is uncertain.

    Args:
        points: Perceived contact points, shape (b, n, 3).
        sets: Normals that each contact may have.
        wider: Where cones differ: by how much each exceeds the friction angle, in the worst and in
            the best case [rad], shape (b, n) each.
        location: Location error of each contact, in the unit of the points, shape (b, n).
        turns: How far the surface turns within that error [rad], shape (b, n); None: not at all.
        first: Three contacts and more: thresholds of the worst and of the best angle [rad], shape
            (b,) each. Whether the worst is below the first, and the best at least the second, is
            then exact, whatever the tolerance is.
        tolerance: Three contacts and more: width of the brackets [rad], for the best angle only
            without `first`. The upper end is returned for the worst, the lower end for the best.
            inf: only what `first` needs is computed.

    Returns:
        (worst, best), shape (b,) each. Both are inf for one contact; the worst is inf where two
        contacts may coincide. They are up to pi for two contacts and from 0 to pi/2 for more: pi/2
        where no friction makes the grasp force-closed. For three or more smooth contacts without
        other uncertainty, both are the critical friction angle, except where closure is undecided.
    """
    size, count = points.shape[:2]
    if count == 1:
        return np.full(size, math.inf), np.full(size, math.inf)
    inner, outer = wider or np.zeros((2, size, count))
    if turns is not None:
        inner, outer = inner - turns, outer + turns
    if count == 2:
        return _of_pairs(points, sets, inner, outer, location)
    middles, radii = sets.middles, sets.radii
    middles = np.where((middles == 0.0).all(axis=2, keepdims=True), ANY_DIRECTION, middles)
    if wider is None and location is None and not radii.any():
        low, high = brackets_of_smooth(points, middles, tolerance)
        return high, np.where(high - low > 2.0 * tolerance, low, high)
    moved = None if location is None else np.append(location.max(axis=1), np.zeros(size))
    low, high = angle_brackets(
        np.concatenate([points, points]),
        np.concatenate([middles, middles]),
        np.concatenate([inner - radii, outer + radii]),
        first=None if first is None else np.concatenate(first),
        displacement=moved,
        tolerance=np.repeat([tolerance, tolerance if first is None else math.inf], size),
    )
    worst, best = high[:size], low[size:]
    return worst, best if location is None else np.where(location.any(axis=1), 0.0, best)


def _of_pairs(
    points: Floats, sets: NormalSets, inner: Floats, outer: Floats, location: Floats | None
) -> WorstAndBest:
    """Closed form of two contacts: squeezing or expanding."""
    largest, smallest = np.empty((2, len(points), 2))
    # Copied, as kernels would be compiled again for read-only arrays.
    arrays = (np.array(one) for one in (points, sets.start[:-1], sets.counts, sets.normals))
    pair_angles(*arrays, largest, smallest)
    worst = np.minimum((largest - inner).max(1), (math.pi - smallest - inner).max(1))
    best = np.minimum((smallest - outer).max(1), (math.pi - largest - outer).max(1))
    if location is not None:
        turn = line_turns(points, location.sum(axis=1))
        worst, best = np.minimum(worst + turn, math.pi), best - turn
    # Contacts at one point push along any line that lies in both cones.
    together = np.isinf(largest[:, 0])
    one, other = sets.middles[together].swapaxes(0, 1)
    between, spread = angles_between(one, -other), sets.radii[together].sum(axis=1)
    worst[together] = 0.5 * (between + spread - inner[together].sum(axis=1))
    best[together] = 0.5 * (between - spread - outer[together].sum(axis=1))
    if location is not None:  # any line may be the true one
        worst[together & location.any(axis=1)] = math.inf
    return worst, np.maximum(best, 0.0)


def line_turns(points: Floats, location: Floats | float) -> Floats:
    """Largest angles by which the lines between two contacts turn [rad], shape (b,).

    Args:
        points: Their perceived positions, shape (b, 2, 3).
        location: Sum of both location errors, shape (b,) or one for all.
    """
    openings = np.linalg.norm(points[:, 1] - points[:, 0], axis=1)
    sines = np.ones(len(openings))
    np.divide(location, openings, out=sines, where=openings > location)
    return np.where(np.asarray(location) > 0.0, np.arcsin(sines), 0.0)


class Uncertain(NamedTuple):
    """Grasps to be classified, in a flat batch, and what is known of them; see `classify`."""

    contacts: Contacts
    tilt: Floats
    """Largest angle between true and perceived normals, alpha / 2 [rad], shape (b, n)."""
    low: Contacts
    """The same contacts with the smallest friction they may have."""
    high: Contacts
    """The same contacts with the largest friction they may have."""
    location: Floats
    """Largest distance between true and perceived contact points, shape (b, n)."""
    creases: Creases = {}  # noqa: RUF012, never written
    method: Method = "exact"
    extreme_normals: int = EXTREME_NORMALS
    options: EpsilonOptions = EpsilonOptions()

    @property
    def thresholds(self) -> Thresholds:
        """Thresholds of the critical angles, from the narrowest and widest cones, (b,) each."""
        inner, outer = self._cones
        widest = outer.max(axis=1)
        return Thresholds(inner.min(axis=1), unstable_from(widest, 0.0, self.contacts.count))

    @property
    def _cones(self) -> tuple[Floats, Floats]:
        """Friction angles at the worst and at the best tilts [rad], shape (b, n) each."""
        return self.low.friction_angle - self.tilt, self.high.friction_angle + self.tilt

    def angles(self, tolerance: float) -> WorstAndBest:
        """The worst and the best critical angle [rad], (b,) each; exact at the thresholds."""
        inner, outer = self._cones
        ends = inner.min(axis=1), outer.max(axis=1)
        return uncertain_angles(
            self.contacts.points,
            NormalSets.of_contacts(self.contacts, self.creases),
            wider=(inner - ends[0][:, None], outer - ends[1][:, None]),
            location=self.location if self.location.any() else None,
            first=ends,
            tolerance=tolerance,
        )

    def labels(self) -> Bytes:
        """`Label` codes, shape (b,)."""
        if self.method == "exact":
            return label_angles(*self.angles(math.inf), self.thresholds)
        low, high = self.enumerated(None)
        unless_stable = np.where(high.unstable, Label.U, Label.M)
        return np.where(low.stable, Label.S, unless_stable).astype(np.uint8)

    def margin(self) -> Floats:
        """Angle by which the grasps are S [rad], shape (b,)."""
        worst, _ = self.angles(1e-4)
        return self.thresholds.sure_angle - worst

    def enumerated(self, options: EpsilonOptions | None) -> tuple[Extremes, Extremes]:
        """Results over all combinations of extreme normals, at smallest and largest friction."""
        count, creases = self.extreme_normals, self.creases
        each = [
            extremes(contacts, self.tilt, count=count, creases=creases, options=options)
            for contacts in dict.fromkeys((self.low, self.high))
        ]
        return each[0], each[-1]

    def epsilons(self) -> WorstAndBest:
        """The smallest epsilon over the tilts, and an upper bound of the largest, (b,) each."""
        if self.method == "extremes":
            low, high = self.enumerated(self.options)
            return low.minimum, high.maximum
        ends = dict.fromkeys((self.low, self.high))
        each = [epsilon_range(contacts, self.tilt, self.options) for contacts in ends]
        return each[0].minimum, each[-1].maximum


@dataclass(frozen=True, eq=False)
class Stability:
    """Reliability of grasps whose normals are perceived with a limited sensor resolution.

    Labels are those of hard fingers in either method; torsion affects epsilon only. Everything but
    the label is computed when it is first read. On creases the label and the margin (with method
    extremes, also the extremes of epsilon) cover all normals there; everything else is for the
    perceived normals.
    """

    label: Bytes
    """`Label` codes, shape (...): 0 U, 1 M, 2 S."""
    batch: tuple[int, ...]
    """Shape of the batch (...)."""
    _grasps: Uncertain

    __repr__ = short_repr

    @cached_property
    def critical_friction_angle(self) -> Floats:
        """beta* at the perceived normals [rad], shape (...)."""
        return shaped(critical_friction_angle(self._grasps.contacts), self.batch)

    @cached_property
    def margin(self) -> Floats:
        """Margin [rad]: beta - alpha/2 - beta*, less all other uncertainties, shape (...).

        With method exact a grasp is S iff it is above 0. beta - alpha/2 is the least of all
        fingers, at the smallest friction; -inf for one contact, and for two that may coincide.
        """
        return shaped(self._grasps.margin(), self.batch)

    @cached_property
    def epsilon(self) -> Floats:
        """Epsilon at the perceived normals, certified from below, shape (...)."""
        values = epsilon_with(self._grasps.contacts, self._grasps.options).lower
        return shaped(values, self.batch)

    @property
    def epsilon_min(self) -> Floats:
        """Smallest epsilon over the tilts, shape (...).

        Method exact: over all tilts, see `quality.epsilon_range`; 0, which is only a bound, where
        tilts exceed friction at some contact. Method extremes: over the combinations of extreme
        normals.
        """
        return shaped(self._epsilons[0], self.batch)

    @property
    def epsilon_max(self) -> Floats:
        """Largest epsilon over the tilts, shape (...).

        Method exact: an upper bound over all tilts. Method extremes: attained at one of the
        combinations of extreme normals.
        """
        return shaped(self._epsilons[1], self.batch)

    @cached_property
    def _epsilons(self) -> WorstAndBest:
        return self._grasps.epsilons()


def classify(
    contacts: Contacts,
    sensor_resolution: ArrayLike,
    *,
    method: Method = "exact",
    friction_interval: tuple[ArrayLike, ArrayLike] | None = None,
    location_error: ArrayLike = 0.0,
    creases: Mapping[int, ArrayLike] | None = None,
    extreme_normals: int = EXTREME_NORMALS,
    options: EpsilonOptions | None = None,
) -> Stability:
    """Classify grasps as surely stable (S), ambiguous (M) or surely unstable (U).

    The method 'exact' considers every normal within the resolution: a grasp is S if it is
    force-closed with cones of half-angle beta - alpha/2, and U if it is not with cones of
    beta + alpha/2; for two fingers this is a closed form, for more two closure tests. No grasp is S
    where tilts exceed friction at some contact. From beta + alpha/2 = 90 degrees on, grasps of
    three or more fingers are never U: such cones are not convex, so nothing is proved.

    The method 'extremes' is that of Wan & Howe 2018, Sec. III: all combinations of the perceived
    and of extreme normals, `extreme_normals` on a rim alpha/2 away (on several, at most 2 beta
    apart, where alpha exceeds 4 beta), with circular cones. It is sampled: an M may be labelled S
    or U, if the decisive tilt is not among the samples.

    Args:
        contacts: The contacts, with their perceived normals.
        sensor_resolution: Resolution alpha [rad], from 0 to below pi: one value, or shape
            (..., n).
        method: 'exact' or 'extremes'.
        friction_interval: Smallest and largest friction coefficient, where friction is uncertain:
            each above 0, one number or of shape (..., n), with the contacts' friction between them;
            None: the contacts' friction alone. S is decided by the smallest, U by the largest.
        location_error: Largest distance between true and perceived contacts, in the unit of the
            points, at least 0: one value, or shape (..., n). How far the surface turns within it
            is stated as a larger `sensor_resolution`, by twice that angle. Method exact only. Two
            contacts: S is exact, every U is correct; more: every S is correct, and nothing is U.
        creases: For contacts on creases and corners, by number: inward normals of the faces that
            meet there, shape (k, 3) or (..., k, 3). The contact may have any normal between them,
            tilted by up to alpha/2. They affect labels, and with method extremes epsilon. Method
            exact: exact for two fingers; for more every S and U is correct.
        extreme_normals: Method extremes: number of normals on a rim, at least 3.
        options: Cones, actuation, torque scale and accuracy of epsilon; labels always come from
            circular cones. None: the defaults.

    Raises:
        SettingError: A setting outside its range, friction 0, or too many combinations.
        ContactError: Creases that do not match the contacts, or contacts in groups.

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
    whole_number("extreme normals", extreme_normals, MIN_EXTREMES)
    if contacts.groups is not None:
        raise ContactError(
            "labels are those of single points: give the middle of what each finger touches, "
            "without groups"
        )
    if not isinstance(options, EpsilonOptions | None):
        raise SettingError(f"options must be EpsilonOptions; got {options!r}")
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
    grasps = Uncertain(
        contacts=flat,
        tilt=alpha.reshape(-1, contacts.count) / 2.0,
        low=flat if low is contacts else low.reshape((-1,)),
        high=flat if high is contacts else high.reshape((-1,)),
        creases=face_normals(creases or {}, contacts),
        location=location.reshape(-1, contacts.count),
        method=method,
        extreme_normals=extreme_normals,
        options=options or EpsilonOptions(),
    )
    return Stability(shaped(grasps.labels(), contacts.batch), contacts.batch, grasps)


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


@dataclass(frozen=True, eq=False, kw_only=True)
class ContactSets:
    """Contacts of k grasps with any number of contacts each, in the order of the grasps."""

    size: int
    """Number of grasps k."""
    row: Ints
    """Grasp of each contact, shape (c,)."""
    points: Floats
    """Relative to the centre of mass [m], shape (c, 3)."""
    normals: Floats
    """Perceived unit normals into the object, shape (c, 3)."""
    location_error: float = 0.0
    """Largest distance between true and perceived points [m]."""
    turns: Floats | None = None
    """How far the surface turns within the location error of each contact [rad], shape (c,); None:
    locations are exact."""

    __repr__ = short_repr

    @cached_property
    def counts(self) -> Ints:
        """Number of contacts of each grasp, shape (k,)."""
        return np.bincount(self.row, minlength=self.size)

    @property
    def evaluated(self) -> Bools:
        """Whether a grasp has 2 to `MAX_FINGERS` contacts, shape (k,)."""
        return np.asarray((self.counts >= 2) & (self.counts <= MAX_FINGERS))

    def groups(self) -> Iterator[tuple[Ints, Ints]]:
        """Yield the evaluated grasps, grouped by their number of contacts.

        Yields:
            The numbers of the grasps, shape (b,), and of their contacts, shape (b, n).
        """
        start = np.cumsum(self.counts) - self.counts
        for count in np.unique(self.counts[self.evaluated]):
            grasps = np.flatnonzero(self.counts == count)
            yield grasps, start[grasps, None] + np.arange(count)

    def contacts(self, index: Ints, friction: float = 0.5, torsion_radius: float = 0.0) -> Contacts:
        """Make contacts of grasps that have equally many.

        Args:
            index: Numbers of their contacts, shape (b, n).
            friction: Coulomb coefficient.
            torsion_radius: Torsion radius [m].
        """
        return Contacts(self.points[index], self.normals[index], friction, torsion_radius)

    @cached_property
    def critical_angles(self) -> WorstAndBest:
        """Critical friction angles at the worst and the best locations [rad], shape (k,) each.

        nan where a grasp is not evaluated.
        """
        worst, best = np.full((2, self.size), math.nan)
        for grasps, index in self.groups():
            contacts, turns = self.contacts(index), self.turns
            worst[grasps], best[grasps] = uncertain_angles(
                contacts.points,
                NormalSets.of_contacts(contacts, {}),
                location=None if turns is None else np.full(index.shape, self.location_error),
                turns=None if turns is None else turns[index],
            )
        return locked(worst), locked(best)

    def tilts(self, tilt: Floats) -> Floats:
        """Largest angles between true and perceived normals at the true locations [rad], (c,).

        Args:
            tilt: The same angles at the perceived locations, shape (c,).
        """
        return tilt if self.turns is None else tilt + self.turns

    @cached_property
    def rank(self) -> Ints:
        """Dimension of the span of the wrenches, shape (k,); 0 where a grasp is not evaluated."""
        ranks = np.zeros(self.size, dtype=np.int64)
        for grasps, index in self.groups():
            ranks[grasps] = force_closure(self.contacts(index)).rank
        return locked(ranks)

    def epsilon(
        self, options: EpsilonOptions, *, friction: float, torsion_radius: float = 0.0
    ) -> Floats:
        """Epsilon at the perceived normals, certified from below, shape (k,); nan as above.

        Args:
            options: Cones, actuation, torque scale and accuracy.
            friction: As in `contacts`.
            torsion_radius: As in `contacts`.
        """
        values = np.full(self.size, math.nan)
        for grasps, index in self.groups():
            contacts = self.contacts(index, friction, torsion_radius)
            values[grasps] = epsilon_with(contacts, options).lower
        return locked(values)


class SetLabels(NamedTuple):
    """Labels of `ContactSets`, and how sure they are."""

    label: Bytes
    """`Label` codes, shape (k,). U where there are fewer than two contacts, M where there are more
    than `MAX_FINGERS`, for which nothing is computed."""
    margin: Floats
    """Angle by which the grasp is S [rad], shape (k,): S where it is above 0; nan: fewer than two
    contacts or too many."""


def label_sets(sets: ContactSets, tilt: Floats, friction_angles: tuple[float, float]) -> SetLabels:
    """Label grasps whose links have different sensors, as `classify` does.

    Args:
        sets: The contacts.
        tilt: Largest angle between the true and the perceived normal, at one location [rad],
            shape (c,).
        friction_angles: At the smallest and at the largest friction [rad].

    Example:
        Three fingers around a disc; all normals are known within 1 degree, or one of them only
        within 40 degrees:

        >>> import numpy as np
        >>> from grasp3d.stability.classification import ContactSets, label_sets
        >>> angle = np.radians([0.0, 120.0, 240.0])
        >>> points = np.stack([np.cos(angle), np.sin(angle), np.zeros(3)], axis=1)
        >>> sets = ContactSets(size=1, row=np.zeros(3, int), points=points, normals=-points)
        >>> beta = np.arctan(0.8)
        >>> label_sets(sets, np.array([0.02, 0.02, 0.02]), (beta, beta)).label.tolist()
        [2]
        >>> label_sets(sets, np.array([0.02, 0.02, 0.7]), (beta, beta)).label.tolist()
        [1]
    """
    least, largest = map(math.tan, friction_angles)
    label = np.where(sets.counts < 2, Label.U, Label.M).astype(np.uint8)
    margin = np.full(sets.size, math.nan)
    for grasps, index in sets.groups():
        low = sets.contacts(index, least)
        found = Uncertain(
            contacts=low,
            tilt=sets.tilts(tilt)[index],
            low=low,
            high=low.with_friction(largest),
            location=np.full(index.shape, sets.location_error),
        )
        label[grasps], margin[grasps] = found.labels(), found.margin()
    return SetLabels(locked(label), locked(margin))
