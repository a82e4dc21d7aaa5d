"""How reliable given grasps are: labels and what belongs to them."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Bytes, Floats, Ints, shaped
from grasp3d.contact.friction_cones import turned
from grasp3d.quality.closure import ForceClosure, force_closure
from grasp3d.quality.critical_angle import critical_friction_angle
from grasp3d.quality.ferrari_canny import Epsilon, epsilon
from grasp3d.quality.tilting import EpsilonRange, epsilon_range
from grasp3d.settings import Method
from grasp3d.stability.enumeration import Extremes, extremes
from grasp3d.stability.exact import Question, helping_normals
from grasp3d.stability.extreme_normals import Tested


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
    def worst(self) -> ForceClosure:
        """ForceClosure of the cones that the worst tilts leave, half-angle beta - alpha/2.

        Proves an S: its equilibrium lies within every cone that a tilt can make. Where it is not
        closed its direction separates the grasp with all normals turned away from it, so that
        it is no S; except where tilts exceed friction at some contact and its status is UNDECIDED:
        then it says nothing.
        """
        question = self._question
        return self._closure(question.inner_offset)

    @cached_property
    def best(self) -> ForceClosure:
        """ForceClosure of the cones that the best tilts reach, half-angle beta + alpha/2.

        Proves a U, while these stay below 90 degrees: its direction separates the grasp whatever
        the tilts. Where it is closed, the forces of its equilibrium say which tilts close.
        """
        question = self._question
        return self._closure(question.outer_offset)

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

    def _closure(self, cone_offset: Floats) -> ForceClosure:
        contacts = self._question.hard.reshape(self.batch)
        shape = contacts.friction.shape
        return force_closure(
            contacts, cone_offset=cone_offset.reshape(shape), threads=self._question.threads
        )

    @cached_property
    def _effective(self) -> Epsilon:
        question = self._question
        return epsilon(question.contacts, cone_offset=question.inner_offset, **question.measures)

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
