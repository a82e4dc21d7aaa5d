"""Result of classifying grasps: labels, epsilon, certificates, worst and best normals."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from grasp3d.arrays import ArrayLike, Bytes, Floats, Ints, shaped, short_repr
from grasp3d.contact.friction_cones import turned
from grasp3d.errors import SettingError
from grasp3d.quality.closure import ForceClosure, force_closure
from grasp3d.quality.critical_angle import critical_friction_angle
from grasp3d.quality.ferrari_canny import Epsilon, epsilon_with
from grasp3d.quality.tilting import EpsilonRange, epsilon_range
from grasp3d.settings import Method
from grasp3d.stability.enumeration import Extremes, extremes
from grasp3d.stability.exact import StabilityProblem, closing_normals, located_angles
from grasp3d.stability.extreme_normals import Tested

AT_REST = 1e-12
"""Velocity of a contact, relative to that of its turning about the centre of mass, which is 0."""


@dataclass(frozen=True, eq=False)
class Stability:
    """Reliability of grasps whose normals are perceived with a limited sensor resolution.

    Labels are those of hard fingers in either method; torsion affects epsilon only. Epsilon and
    everything derived from it is computed when it is first read. For contacts on creases the label,
    and with method extremes the extremes of epsilon, consider all normals there; everything else is
    that of the perceived normals. Of contacts with patches the labels are those of the best line
    between the patches, and `worst`, `best` and `best_normals` are refused.
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
        return self._shaped(critical_friction_angle(problem.contacts, threads=problem.threads))

    @cached_property
    def margin(self) -> Floats:
        """Margin [rad]: beta - alpha/2 - beta*, less all other uncertainties, shape (...).

        With method exact a grasp is S iff it is above 0; where the tilt of one of three contacts or
        more exceeds its friction, an S that the others hold alone may have a negative one. Of the
        finger with the least; beta at the smallest friction. -inf for two contacts at one point;
        nan for three contacts and more with one on a crease.
        """
        problem = self._problem
        worst, _ = located_angles(problem)
        return self._shaped(problem.narrowest_angle.min(axis=1) - worst)

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
        self._refuse_patches("the best normals")
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
        self._refuse_patches("force closure at the worst and best tilts")
        contacts = self._problem.hard.reshape(self.batch)
        shape = contacts.friction.shape
        return force_closure(
            contacts, cone_offset=cone_offset.reshape(shape), threads=self._problem.threads
        )

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
        torque_scale = problem.options.torque_scale
        turning = np.cross(u[..., 3:], contacts.points) / torque_scale
        velocities = u[..., :3] + turning
        # A contact about which the object turns does not move, whatever rounding leaves.
        length = np.linalg.norm(turning, axis=-1, keepdims=True)
        velocities[(np.abs(velocities) <= AT_REST * length).all(axis=-1)] = 0.0
        if contacts.rolling_arms is None:
            return turned(contacts.normals, -velocities, problem.tilt), closing_normals(problem)
        # Where the pressure resists most it adds R n to the velocity.
        arms = contacts.rolling_arms / torque_scale
        rolling = np.linalg.norm((arms * u[..., None, 3:]).sum(axis=-1), axis=-1)
        velocities = velocities + rolling[..., None] * contacts.normals
        missing = np.full_like(velocities, math.nan)
        return turned(contacts.normals, -velocities, problem.tilt), missing

    def _refuse_patches(self, what: str) -> None:
        if self._problem.contacts.patch is not None:
            raise SettingError(
                f"{what} are known of point contacts only; classify contacts.without_patches()"
            )

    def _shaped(self, values: ArrayLike) -> Floats:
        in_batch: Floats = shaped(np.asarray(values), self.batch)
        return in_batch
