"""Classification of grasps as S, M or U, exactly or by enumeration of extreme normals."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np

from grasp3d.arrays import ArrayLike, Bytes, Floats, shaped, short_repr
from grasp3d.contact.contacts import Contacts, per_contact
from grasp3d.errors import ContactError, SettingError
from grasp3d.quality.critical_angle import critical_friction_angle
from grasp3d.quality.ferrari_canny import epsilon_with
from grasp3d.quality.tilting import epsilon_range
from grasp3d.quality.wrenches import EpsilonOptions
from grasp3d.settings import check_choice, whole_number
from grasp3d.settings.grasp_model import Method
from grasp3d.stability.extremes import EXTREME_NORMALS, MIN_EXTREMES, Extremes, extremes
from grasp3d.stability.label import Label
from grasp3d.stability.normal_sets import Creases, NormalSets, WorstAndBest, face_normals
from grasp3d.stability.thresholds import Thresholds, label_angles, unstable_from
from grasp3d.stability.uncertain_angles import uncertain_angles


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
        """Those of the critical angles, of the contacts with least and most friction, (b,) each."""
        inner, outer = self._cones
        widest = outer.max(axis=1)
        return Thresholds(inner.min(axis=1), unstable_from(widest, 0.0, self.contacts.count))

    @property
    def _cones(self) -> tuple[Floats, Floats]:
        """Friction angles at the worst and at the best tilts [rad], shape (b, n) each."""
        return self.low.friction_angle - self.tilt, self.high.friction_angle + self.tilt

    def angles(self, tolerance: float) -> WorstAndBest:
        """The worst and the best critical angle; exact beside the thresholds [rad], (b,) each."""
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
        """The combinations of extreme normals, with the smallest and the largest friction."""
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
    the label is computed when it is first read. For contacts on creases the label, the margin, and
    with method extremes the extremes of epsilon, consider all normals there; everything else is
    that of the perceived normals.
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

        With method exact a grasp is S iff it is above 0. Of the finger with the least; beta at the
        smallest friction. -inf for one contact, and for two that may be at one point.
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

        Method exact: over all tilts, see `quality.epsilon_range`; 0, which then is only a bound,
        where tilts exceed friction at some contact. Method extremes: over the combinations of
        extreme normals.
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
    beta + alpha/2; for two fingers this is a closed form, for more two closure tests. There is no S
    where tilts exceed friction at some contact. From beta + alpha/2 = 90 degrees on, grasps of
    three fingers and more are never U: such cones are not convex, and nothing is proved.

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
