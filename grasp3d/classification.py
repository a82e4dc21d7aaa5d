"""S, M or U of given grasps: exactly, or by the paper's enumeration of extreme normals."""

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import get_args

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Bytes, Floats, Ints, shaped
from grasp3d.cones import turned
from grasp3d.contacts import Contacts, per_contact
from grasp3d.creases import face_normals
from grasp3d.critical import critical_friction_angle
from grasp3d.enumeration import Extremes, extremes
from grasp3d.errors import SettingError
from grasp3d.extremes import Tested
from grasp3d.quality import Closure, Epsilon, epsilon, force_closure
from grasp3d.settings import MIN_EXTREMES, Actuation, Method, whole
from grasp3d.stability import Label
from grasp3d.tilting import EpsilonRange, epsilon_range
from grasp3d.verdicts import Question, helping_normals, settle

NO_GRASPS = Contacts(np.zeros((0, 1, 3)), np.zeros((0, 1, 3)))


@dataclass(frozen=True, eq=False)
class Stability:
    """How reliable grasps are, for fingertips that know their normals only to a resolution.

    Labels come from hard fingers in either method; torsion counts in epsilon. Epsilon and all that
    belongs to it is computed when it is first asked for. At creases all but the label, and but the
    extremes of epsilon of the method extremes, is that of the perceived normals.
    """

    label: Bytes
    """`Label` codes, shape (...): 0 U, 1 M, 2 S."""
    method: Method
    """How the label was made."""
    hulls: Ints
    """Wrench hulls grown for it, one for each closure test, shape (...); 0: a closed form. Searches
    for critical angles are not counted."""
    batch: tuple[int, ...]
    """Shape of the batch (...)."""
    _question: Question

    @cached_property
    def critical_friction_angle(self) -> Floats:
        """beta* at the perceived normals [rad], shape (...)."""
        question = self._question
        return self._shaped(critical_friction_angle(question.contacts, threads=question.threads))

    @cached_property
    def worst(self) -> Closure:
        """Closure of the cones that the worst tilts leave, half-angle beta - alpha/2.

        Proves an S: its equilibrium lies within every cone that a tilt can make. Where it is not
        closed its direction separates the grasp with all normals turned away from it, so that
        it is no S; except where tilts exceed friction at some contact and its status is UNDECIDED:
        then it says nothing.
        """
        question = self._question
        return self._closure(question.narrowed)

    @cached_property
    def best(self) -> Closure:
        """Closure of the cones that the best tilts reach, half-angle beta + alpha/2.

        Proves a U, while these stay below 90 degrees: its direction separates the grasp whatever
        the tilts. Where it is closed, the forces of its equilibrium say which tilts close.
        """
        question = self._question
        return self._closure(question.widened)

    @property
    def epsilon(self) -> Floats:
        """Epsilon at the perceived normals, certified from below, shape (...)."""
        return self._shaped(self._nominal.lower)

    @property
    def epsilon_min(self) -> Floats:
        """Smallest epsilon over the tilts, shape (...).

        Method exact: over all tilts, as `tilting.epsilon_range` tells; 0, which then is only a
        bound, where tilts exceed friction at some contact. Method extremes: over the combinations
        of extreme normals.
        """
        return self._shaped(self._range.minimum)

    @property
    def epsilon_max(self) -> Floats:
        """Largest epsilon over the tilts, shape (...).

        Method exact: a bound that no tilt exceeds; extremes: over the combinations, attained.
        """
        return self._shaped(self._range.maximum)

    @cached_property
    def epsilon_effective(self) -> Floats:
        """Epsilon at the effective friction tan(beta - alpha/2), shape (...).

        Wan & Howe 2018, Sec. III. For hard fingers with circular cones it is the smallest over all
        tilts, while none of them exceeds friction; else it is 0.
        """
        return self._shaped(self._effective.lower)

    @property
    def worst_normals(self) -> Floats:
        """Inward normals within the resolution that attain `epsilon_min`, shape (..., n, 3).

        Method exact: every normal turned away from the disturbance that is hardest to resist;
        epsilon there is `epsilon_min` for hard fingers with circular cones, while no tilt exceeds
        friction.
        """
        return self._shaped(self._witnesses[0])

    @property
    def best_normals(self) -> Floats:
        """Inward normals within the resolution that help, shape (..., n, 3).

        Method extremes: those of `epsilon_max`. Method exact: normals at which the grasp closes, at
        the largest friction; nan where none is known, as in every U.
        """
        return self._shaped(self._witnesses[1])

    @property
    def combinations(self) -> int:
        """Combinations of extreme normals of each grasp; for the method exact 0."""
        if self.method == "exact":
            return 0
        return math.prod(normals.shape[1] for normals in self._tested)

    @cached_property
    def _tested(self) -> Tested:
        return self._question.tested

    @cached_property
    def _nominal(self) -> Epsilon:
        return epsilon(self._question.contacts, **self._question.measures)

    def _closure(self, widen: Floats) -> Closure:
        contacts = self._question.hard.reshape(self.batch)
        shape = contacts.friction.shape
        return force_closure(contacts, widen=widen.reshape(shape), threads=self._question.threads)

    @cached_property
    def _effective(self) -> Epsilon:
        question = self._question
        return epsilon(question.contacts, widen=question.narrowed, **question.measures)

    @cached_property
    def _range(self) -> EpsilonRange:
        question, nominal = self._question, self._nominal.lower
        if self.method == "extremes":
            least, most = self._enumerated
            return EpsilonRange(nominal, least.minimum, most.maximum)
        low = epsilon_range(question.low, question.tilt, **question.measures)
        if question.low is question.high:
            return low
        high = epsilon_range(question.high, question.tilt, **question.measures)
        return EpsilonRange(nominal, low.minimum, high.maximum)

    @cached_property
    def _enumerated(self) -> tuple[Extremes, Extremes]:
        question, tested = self._question, self._tested
        least = extremes(question.low, tested, **question.measures)
        if question.low is question.high:
            return least, least
        return least, extremes(question.high, tested, **question.measures)

    @cached_property
    def _witnesses(self) -> tuple[Floats, Floats]:
        if self.method == "extremes":
            least, most = self._enumerated
            return least.worst_normals, most.best_normals
        question = self._question
        contacts = question.contacts
        u = self._effective.certificate.direction[:, None]
        work = u[..., :3] + np.cross(u[..., 3:], contacts.points) / question.torque_scale
        return turned(contacts.normals, -work, question.tilt), helping_normals(question)

    def _shaped(self, values: npt.ArrayLike) -> Floats:
        in_batch: Floats = shaped(np.asarray(values), self.batch)
        return in_batch


def classify(
    contacts: Contacts,
    sensor_resolution: npt.ArrayLike,
    *,
    method: Method = "exact",
    friction_interval: tuple[npt.ArrayLike, npt.ArrayLike] | None = None,
    creases: Mapping[int, npt.ArrayLike] | None = None,
    extreme_normals: int = 8,
    rings: int | None = None,
    edges: int | None = None,
    actuation: Actuation = "total",
    torque_scale: float = 1.0,
    rtol: float = 1e-3,
    threads: int | None = 1,
) -> Stability:
    """Tell whether grasps are surely stable, surely unstable, or the sensor cannot tell.

    The method 'exact' answers for every normal within the resolution: a grasp is S where cones of
    half-angle beta - alpha/2 close, and U where those of beta + alpha/2 do not. For two fingers
    this is a closed form, for more a closure test each. From beta + alpha/2 = 90 degrees on three
    fingers and more are never called U: such cones are not convex, and nothing is proved.
    Three fingers and more whose tilts exceed friction are S where, without creases, those that know
    better close without them; seven and more also where their critical friction angle is below the
    smallest beta - alpha/2. Where friction or resolution differ among them this is safe, not exact.

    The method 'extremes' is that of Wan & Howe 2018, Sec. III: all combinations of the perceived
    and of extreme normals, `extreme_normals` on a rim alpha/2 away. It is sampled. It can take an M
    for an S or a U, because the tilt that tells was not tried; with polygonal cones, which lie
    inside the circular ones, also an S for M or U, and an M for U.

    Args:
        contacts: The contacts, with their perceived normals.
        sensor_resolution: Resolution alpha [rad], from 0 to below pi: one, or shape (..., n).
        method: 'exact' or 'extremes'.
        friction_interval: Smallest and largest friction coefficient, above 0, each one number or of
            shape (..., n), where friction is known only so far, about that of the contacts; None:
            that alone. An S is one for the smallest, a U for the largest.
        creases: Contacts on creases and corners, by number: inward normals of the faces that meet
            there, shape (k, 3) or (..., k, 3). The contact may have any normal between them, tilted
            by up to alpha/2. They count in labels, and in epsilon of the method extremes. Method
            exact: exact for two fingers; for more the sets are sampled in steps of 5 degrees,
            safely: what is called S or U is.
        extreme_normals: Method extremes: normals on a rim, at least 3.
        rings: Method extremes: rims at even steps up to alpha/2; None: one, and more where
            alpha > 4 beta, at most 2 beta apart.
        edges: Edges of polygonal friction cones, of epsilon and of the method extremes; None:
            circular ones. Exact labels come from circular ones.
        actuation: As in `quality.epsilon`.
        torque_scale: As in `quality.epsilon` [mesh unit].
        rtol: As in `quality.epsilon`.
        threads: Threads for a batch; None: one per processor.

    Raises:
        SettingError: A setting outside its range, friction 0, or too many combinations.
        ContactError: Creases that do not fit the contacts.
    """
    if method not in get_args(Method):
        known = ", ".join(get_args(Method))
        raise SettingError(f"no method is called {method!r}; known: {known}")
    if rings is not None:
        whole("rings", rings, 1)
    whole("extreme normals", extreme_normals, MIN_EXTREMES)
    tilt = _resolutions(contacts, sensor_resolution) / 2.0
    low, high = _friction_range(contacts, friction_interval)
    flat = contacts.reshape((-1,))
    question = Question(
        contacts=flat,
        tilt=tilt.reshape(-1, contacts.count),
        low=flat if low is contacts else low.reshape((-1,)),
        high=flat if high is contacts else high.reshape((-1,)),
        creases=face_normals(creases or {}, contacts),
        edges=edges,
        actuation=actuation,
        around=extreme_normals,
        rings=rings,
        torque_scale=torque_scale,
        rtol=rtol,
        threads=threads,
    )
    epsilon(NO_GRASPS, **question.measures)  # refuses settings that are needed only later
    stable, unstable, hulls = settle(question, method)
    label = np.full(len(stable), Label.M, dtype=np.uint8)
    label[unstable] = Label.U
    label[stable] = Label.S
    return Stability(
        label=shaped(label, contacts.batch),
        method=method,
        hulls=shaped(hulls, contacts.batch),
        batch=contacts.batch,
        _question=question,
    )


def _resolutions(contacts: Contacts, sensor_resolution: npt.ArrayLike) -> Floats:
    """Check resolutions and spread them over the contacts, shape (..., n)."""
    alpha = per_contact("sensor resolution", sensor_resolution, contacts)
    if not ((alpha >= 0.0) & (alpha < math.pi)).all():
        raise SettingError(
            "sensor resolution must be at least 0 and below pi radians; "
            f"got {sensor_resolution!r} (radians)"
        )
    return alpha


def _friction_range(
    contacts: Contacts, interval: tuple[npt.ArrayLike, npt.ArrayLike] | None
) -> tuple[Contacts, Contacts]:
    """The contacts with their smallest and with their largest friction."""
    if not (contacts.friction > 0.0).all():
        raise SettingError(f"friction must be above 0; got {contacts.friction.min():g}")
    if interval is None:
        return contacts, contacts
    if not (isinstance(interval, Sequence) and len(interval) == 2):  # noqa: PLR2004
        raise SettingError(f"friction_interval must be (smallest, largest); got {interval!r}")
    low, high = (
        per_contact(f"{end} friction", value, contacts)
        for end, value in zip(("smallest", "largest"), interval, strict=True)
    )
    if not ((low > 0.0) & (low <= contacts.friction) & (contacts.friction <= high)).all():
        raise SettingError(
            "friction_interval must be (smallest, largest), above 0, about the contacts' friction"
        )
    return contacts.with_friction(low), contacts.with_friction(high)
