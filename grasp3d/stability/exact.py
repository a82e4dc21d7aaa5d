"""Decides S, M and U of grasps by a closed form, closure tests, sampled sets or enumeration."""

import math
from typing import NamedTuple

import numpy as np

from grasp3d.arrays import RIGHT_ANGLE, Bools, Floats, Ints, angles_between
from grasp3d.contact.contacts import Contacts
from grasp3d.contact.friction_cones import turned
from grasp3d.errors import ContactError
from grasp3d.quality.closure import Status, force_closure
from grasp3d.quality.critical_angle import critical_friction_angle
from grasp3d.quality.wrenches import EpsilonOptions
from grasp3d.settings.grasp_model import Method
from grasp3d.stability.enumeration import Tested, check_combinations, closure_at, extreme_normals
from grasp3d.stability.locations import (
    angles_to_line,
    line_turns,
    spare_of_pairs,
    surely_closed_from,
)
from grasp3d.stability.normal_sets import STEP, Creases, sampled_set

MIN_FORM_CLOSURE = 7
"""Fewest contacts of a grasp that is force-closed without friction."""

TOO_MANY_SAMPLES = (
    "too many contacts are on creases and corners, or these are too wide; use method='extremes', "
    "which tests fewer normals there"
)


class StabilityProblem(NamedTuple):
    """Grasps to be classified, in a flat batch; see `classification.classify`."""

    contacts: Contacts
    tilt: Floats
    """Largest angle between true and perceived normals, alpha / 2 [rad], shape (b, n)."""
    low: Contacts
    """The same contacts with the smallest friction they may have."""
    high: Contacts
    """The same contacts with the largest friction they may have."""
    creases: Creases
    extreme_normals: int
    """Number of extreme normals on a rim, for method extremes."""
    rings: int | None
    options: EpsilonOptions
    location: Floats
    """Largest distance between true and perceived contact points, shape (b, n)."""

    @property
    def hard(self) -> Contacts:
        """The contacts as hard fingers, for which labels are decided."""
        return Contacts(self.contacts.points, self.contacts.normals, self.contacts.friction)

    @property
    def sure_angle(self) -> Floats:
        """Friction angle at the worst tilt and the smallest friction, beta - a [rad], (b, n)."""
        return self.low.friction_angle - self.tilt

    @property
    def possible_angle(self) -> Floats:
        """Friction angle at the best tilt and the largest friction, beta + a [rad], (b, n)."""
        return self.high.friction_angle + self.tilt

    @property
    def inner_offset(self) -> Floats:
        """The narrowest angle minus the nominal friction angle [rad], shape (b, n)."""
        return self.low.friction_angle - self.contacts.friction_angle - self.tilt

    @property
    def outer_offset(self) -> Floats:
        """The widest angle minus the nominal friction angle [rad], shape (b, n)."""
        return self.high.friction_angle - self.contacts.friction_angle + self.tilt

    @property
    def tested(self) -> Tested:
        """Normals that the enumeration tests at each contact."""
        return extreme_normals(
            self.low, self.tilt, count=self.extreme_normals, rings=self.rings, creases=self.creases
        )


def decide(problem: StabilityProblem, method: Method) -> tuple[Bools, Bools, Ints]:
    """Decide which grasps are surely stable and which surely unstable.

    Returns:
        (stable, unstable, number of hulls grown), shape (b,) each.
    """
    if method == "extremes":
        return _by_extremes(problem)
    if problem.contacts.count == 1:
        none = np.zeros(len(problem.tilt), dtype=np.bool_)  # a single force has no equilibrium
        return none, ~none, np.zeros(len(none), dtype=np.int64)
    if problem.contacts.count == 2:
        return _of_pairs(problem)
    if problem.location.any():
        stable = margins(problem) > 0.0
        return stable, np.zeros_like(stable), np.zeros(len(stable), dtype=np.int64)
    return _by_sampled_sets(problem) if problem.creases else _by_closure(problem)


def _by_extremes(problem: StabilityProblem) -> tuple[Bools, Bools, Ints]:
    tested = problem.tested
    low = closure_at(problem.low, tested, problem.options)
    if problem.low is problem.high:
        return ~low.failing, ~low.closing, low.hulls
    high = closure_at(problem.high, tested, problem.options)
    return ~low.failing, ~high.closing, low.hulls + high.hulls


def margins(problem: StabilityProblem) -> Floats:
    """Angle by which grasps (b,) are S, method exact: what the narrowest cone has to spare [rad].

    -inf where two contacts are at one point; nan for three contacts and more with one on a crease.
    """
    narrowest = problem.sure_angle.min(axis=1)
    contacts = problem.hard
    if contacts.count == 2:
        return _spare_of_pairs(problem)[0]
    if problem.creases:
        return np.full(len(narrowest), math.nan)
    wider = problem.sure_angle - narrowest[:, None]
    critical = critical_friction_angle(contacts)
    return np.asarray(narrowest - surely_closed_from(contacts, critical, wider, problem.location))


def _spare_of_pairs(problem: StabilityProblem) -> tuple[Floats, Floats]:
    """What the narrowest and the widest cones of two contacts have to spare, shape (b,) each."""
    largest, smallest = angles_to_line(problem.hard, problem.creases)
    turn = line_turns(problem.contacts.points, problem.location.sum(axis=1))
    return (
        spare_of_pairs(largest, smallest, problem.sure_angle, turn),
        spare_of_pairs(smallest, largest, problem.possible_angle, -turn),
    )


def _of_pairs(problem: StabilityProblem) -> tuple[Bools, Bools, Ints]:
    """Two contacts: the line between them lies in both cones, or in neither sense."""
    narrowest, widest = problem.sure_angle, problem.possible_angle
    worst, best = _spare_of_pairs(problem)
    stable, unstable = worst > 0.0, best <= 0.0
    together = np.flatnonzero(np.isneginf(worst))
    uncertain = problem.location[together].any(axis=1)
    if problem.creases and not uncertain.all():
        raise ContactError(
            f"grasp {together[~uncertain][0]} of the batch has both contacts at one point, and one "
            "on a crease; classify it without creases"
        )
    # Contacts at one point push along any line that lies in both cones; where their locations are
    # uncertain, any line may be the true one, and normals of a crease may be nearer.
    normals = problem.contacts.normals[together]
    between = angles_between(normals[:, 0], -normals[:, 1])
    stable[together] = (between < narrowest[together].sum(axis=1)) & ~uncertain
    unstable[together] = between >= widest[together].sum(axis=1)
    if problem.creases:
        unstable[together] = False
    return stable, unstable, np.zeros(len(stable), dtype=np.int64)


def _by_closure(problem: StabilityProblem) -> tuple[Bools, Bools, Ints]:
    """Three contacts and more: closure tests with the narrowest and with the widest cones."""
    contacts = problem.hard
    worst = force_closure(contacts, cone_offset=problem.inner_offset)
    stable = np.array(worst.closed)
    best = force_closure(contacts, cone_offset=problem.outer_offset)
    unstable = ~best.closed & (best.status != Status.UNDECIDED)
    unstable &= (problem.possible_angle < RIGHT_ANGLE).all(axis=1)
    narrowest = problem.sure_angle
    exceeding = np.flatnonzero((narrowest < 0.0).any(axis=1))  # tilts exceed friction
    if exceeding.size:
        reliable = narrowest[exceeding] >= 0.0
        rank = worst.rank[exceeding]
        stable[exceeding] = _reliable_contacts_closed(problem, exceeding, reliable, rank)
    if contacts.count >= MIN_FORM_CLOSURE and exceeding.size:
        subset = Contacts(contacts.points[exceeding], contacts.normals[exceeding])
        critical = critical_friction_angle(subset)
        stable[exceeding] |= critical < narrowest[exceeding].min(axis=1)
    tests = np.full(len(stable), 2)
    tests[exceeding] += 1
    return stable, unstable, tests


def _reliable_contacts_closed(
    problem: StabilityProblem, grasps: Ints, reliable: Bools, rank: Ints
) -> Bools:
    """Whether the contacts where tilts do not exceed friction are alone force-closed, (g,).

    Args:
        problem: The grasps to be classified.
        grasps: Grasps where tilts exceed friction at some contact, shape (g,).
        reliable: The contacts where they do not, shape (g, n).
        rank: Dimension of the span of all contacts' wrenches, shape (g,).
    """
    contacts, rows = problem.hard, grasps[:, None]
    # Every other contact is replaced by a copy of a reliable one, which changes nothing.
    which = np.where(reliable, np.arange(contacts.count), reliable.argmax(axis=1)[:, None])
    subset = Contacts(*(
        values[rows, which] for values in (contacts.points, contacts.normals, contacts.friction)
    ))  # fmt: skip
    closure = force_closure(subset, cone_offset=problem.inner_offset[rows, which])
    return np.asarray(closure.closed & reliable.any(axis=1) & (closure.rank == rank))


def _by_sampled_sets(problem: StabilityProblem) -> tuple[Bools, Bools, Ints]:
    """Three contacts and more, some on creases: samples of their normals, with a margin."""
    contacts, creases, shrink = problem.contacts, problem.creases, math.cos(STEP / 2.0)
    tested = tuple(
        sampled_set(creases[i]) if i in creases else contacts.normals[:, i, None]
        for i in range(contacts.count)
    )
    check_combinations([normals.shape[1] for normals in tested], remedy=TOO_MANY_SAMPLES)
    on_crease = np.isin(np.arange(contacts.count), list(creases))
    narrowest, widest = problem.sure_angle, problem.possible_angle
    inner = np.arcsin(np.clip(np.sin(narrowest) * shrink, 0.0, 1.0))
    outer = np.arccos(np.clip(np.cos(widest) * shrink, -1.0, 1.0))
    narrow, wide = np.where(on_crease, inner, narrowest), np.where(on_crease, outer, widest)
    beta = contacts.friction_angle
    circular = EpsilonOptions()
    worst = closure_at(contacts, tested, circular, cone_offset=np.maximum(narrow, 0.0) - beta)
    best = closure_at(contacts, tested, circular, cone_offset=wide - beta)
    stable = ~worst.failing & (narrowest > 0.0).all(axis=1)
    unstable = ~best.closing & (widest < RIGHT_ANGLE).all(axis=1)
    return stable, unstable, worst.hulls + best.hulls


def closing_normals(problem: StabilityProblem) -> Floats:
    """Normals within the tilts at which grasps are force-closed at the largest friction, (b, n, 3).

    Two normals are turned toward the line between the contacts, more toward forces in equilibrium
    in the widest cones. nan where the grasp is force-closed neither at these normals nor at the
    perceived ones.
    """
    contacts = problem.hard
    if contacts.count == 2:
        goals = _line_goals(problem)
    else:
        closure = force_closure(contacts, cone_offset=problem.outer_offset)
        goals = closure.certificate.equilibrium[..., :3]
    toward = turned(contacts.normals, goals, problem.tilt)
    toward = np.where(np.isnan(toward).any(axis=(1, 2), keepdims=True), contacts.normals, toward)
    result = np.full(toward.shape, math.nan)
    for normals in (contacts.normals, toward):
        turned_contacts = Contacts(contacts.points, normals, problem.high.friction)
        closed = force_closure(turned_contacts).closed
        result[closed] = normals[closed]
    return result


def _line_goals(problem: StabilityProblem) -> Floats:
    """Directions along the line of two contacts (b, 2, 3), squeezing or expanding as is nearer.

    nan where both are at the same point.
    """
    contacts = problem.hard
    line = contacts.points[:, 1] - contacts.points[:, 0]
    goals = np.stack([line, -line], axis=1)
    widest = problem.possible_angle
    excess = [
        (angles_between(contacts.normals, sign * goals) - widest).max(axis=1)
        for sign in (1.0, -1.0)
    ]
    nearer = np.where((excess[0] <= excess[1])[:, None, None], goals, -goals)
    return np.where((line == 0.0).all(axis=1)[:, None, None], math.nan, nearer)
