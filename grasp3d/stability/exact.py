"""What settles S, M and U of given grasps: closed form, closure tests, samples, or enumeration."""

import math
from typing import Any, NamedTuple

import numpy as np

from grasp3d.arrays import Bools, Floats, Ints, unit_rows
from grasp3d.contact.contacts import Contacts
from grasp3d.contact.friction_cones import turned
from grasp3d.errors import ContactError
from grasp3d.quality.closure import force_closure
from grasp3d.quality.critical_angle import RIGHT, angles_between, critical_friction_angle
from grasp3d.settings import Actuation, Method
from grasp3d.stability.enumeration import see
from grasp3d.stability.extreme_normals import Tested, check_combinations, extreme_normals
from grasp3d.stability.normal_sets import STEP, Creases, angles_to_set, sampled_set

FORM_CLOSURE = 7
"""Contacts from which a grasp can close without friction."""


TOO_MANY_SAMPLES = (
    "too many contacts are on creases and corners, or these are too wide; use method='extremes', "
    "which tries fewer normals there"
)


class Question(NamedTuple):
    """What `classification.classify` was asked, in a flat batch; see there."""

    contacts: Contacts
    tilt: Floats
    """Shape (b, n)."""
    low: Contacts
    """The same contacts with the smallest friction they may have."""
    high: Contacts
    """And with the largest."""
    creases: Creases
    edges: int | None
    actuation: Actuation
    around: int
    """Extreme normals on a rim."""
    rings: int | None
    torque_scale: float
    rtol: float
    threads: int | None

    @property
    def hard(self) -> Contacts:
        """The contacts without their torsion, which labels do not count on."""
        return Contacts(self.contacts.points, self.contacts.normals, self.contacts.friction)

    @property
    def inner_offset(self) -> Floats:
        """What the worst tilt leaves of the smallest friction angle, beyond the nominal one."""
        return self.low.friction_angle - self.contacts.friction_angle - self.tilt

    @property
    def outer_offset(self) -> Floats:
        """What the best tilt adds to the largest friction angle, beyond the nominal one."""
        return self.high.friction_angle - self.contacts.friction_angle + self.tilt

    @property
    def tested(self) -> Tested:
        """Normals that the enumeration tries at each contact."""
        return extreme_normals(
            self.low, self.tilt, count=self.around, rings=self.rings, creases=self.creases
        )

    @property
    def measures(self) -> dict[str, Any]:
        """The settings of epsilon."""
        return {
            "edges": self.edges,
            "actuation": self.actuation,
            "torque_scale": self.torque_scale,
            "rtol": self.rtol,
            "threads": self.threads,
        }


def settle(question: Question, method: Method) -> tuple[Bools, Bools, Ints]:
    """Decide which grasps are surely stable and which surely unstable.

    Returns:
        (stable, unstable, hulls grown), shape (b,) each.
    """
    if method == "extremes":
        return _by_extremes(question)
    if question.contacts.count == 1:
        none = np.zeros(len(question.tilt), dtype=np.bool_)  # nothing balances a single push
        return none, ~none, np.zeros(len(none), dtype=np.int64)
    if question.contacts.count == 2:
        return _of_pairs(question)
    if question.creases:
        return _by_sampled_sets(question)
    return _by_closure(question)


def _by_extremes(question: Question) -> tuple[Bools, Bools, Ints]:
    tested = question.tested
    seen = see(question.low, tested, edges=question.edges, threads=question.threads)
    if question.low is question.high:
        return ~seen.failing, ~seen.closing, seen.hulls
    more = see(question.high, tested, edges=question.edges, threads=question.threads)
    return ~seen.failing, ~more.closing, seen.hulls + more.hulls


def _of_pairs(question: Question) -> tuple[Bools, Bools, Ints]:
    """Two contacts: the better of squeezing and expanding, at the normals that hurt or help."""
    points = question.contacts.points
    line = points[:, 1] - points[:, 0]
    together = (line == 0.0).all(axis=1)
    if together.any() and question.creases:
        which = int(together.argmax())
        raise ContactError(
            f"grasp {which} of the batch has both contacts at one place, and one on a crease; "
            "classify it without creases"
        )
    safe = question.low.friction_angle - question.tilt
    reach = question.high.friction_angle + question.tilt
    stable, unstable = np.zeros(len(points), np.bool_), np.ones(len(points), np.bool_)
    for sign in (1.0, -1.0):
        angles = [_angles(question, i, side * line) for i, side in enumerate((sign, -sign))]
        least, most = (np.stack([pair[k] for pair in angles], axis=1) for k in (0, 1))  # (b, 2)
        stable |= (most < safe).all(axis=1)
        unstable &= (least >= reach).any(axis=1)
    # Contacts at one place push along any line that lies in both cones.
    normals = question.contacts.normals[together]
    apart = angles_between(normals[:, 0], -normals[:, 1])
    stable[together] = apart < safe[together].sum(axis=1)
    unstable[together] = apart >= reach[together].sum(axis=1)
    return stable, unstable, np.zeros(len(points), dtype=np.int64)


def _angles(question: Question, contact: int, directions: Floats) -> tuple[Floats, Floats]:
    """Smallest and largest angle of a contact's normals to directions (b, 3)."""
    if contact in question.creases:
        return angles_to_set(question.creases[contact], unit_rows(directions))
    angle = angles_between(question.contacts.normals[:, contact], directions)
    return angle, angle


def _by_closure(question: Question) -> tuple[Bools, Bools, Ints]:
    """Three contacts and more: a closure test of what tilts leave, and one of what they reach."""
    contacts, threads = question.hard, question.threads
    worst = force_closure(contacts, cone_offset=question.inner_offset, threads=threads)
    stable = np.array(worst.closed)
    unstable = ~force_closure(contacts, cone_offset=question.outer_offset, threads=threads).closed
    unstable &= (question.high.friction_angle + question.tilt < RIGHT).all(axis=1)
    safe = question.low.friction_angle - question.tilt
    beyond = np.flatnonzero((safe < 0.0).any(axis=1))
    if beyond.size:
        stable[beyond] = _sure_ones_close(question, beyond, safe[beyond] >= 0.0, worst.rank[beyond])
    if contacts.count >= FORM_CLOSURE and beyond.size:
        few = Contacts(contacts.points[beyond], contacts.normals[beyond])
        stable[beyond] |= critical_friction_angle(few, threads=threads) < safe[beyond].min(axis=1)
    tests = np.full(len(stable), 2)
    tests[beyond] += 1
    return stable, unstable, tests


def _sure_ones_close(question: Question, grasps: Ints, sure: Bools, rank: Ints) -> Bools:
    """Whether contacts whose friction exceeds their tilts close without the others, shape (g,).

    Args:
        question: The question.
        grasps: Grasps where tilts exceed friction at some contact, shape (g,).
        sure: The contacts where they do not, shape (g, n).
        rank: Dimensions that all contacts' wrenches span, shape (g,).
    """
    contacts, rows = question.hard, grasps[:, None]
    # In the place of another one a sure one stands twice, which adds nothing.
    which = np.where(sure, np.arange(contacts.count), sure.argmax(axis=1)[:, None])
    few = Contacts(*(
        values[rows, which] for values in (contacts.points, contacts.normals, contacts.friction)
    ))  # fmt: skip
    closure = force_closure(
        few, cone_offset=question.inner_offset[rows, which], threads=question.threads
    )
    return np.asarray(closure.closed & sure.any(axis=1) & (closure.rank == rank))


def _by_sampled_sets(question: Question) -> tuple[Bools, Bools, Ints]:
    """Three contacts and more, some on creases: samples of their normals, with angles made safe."""
    contacts, creases, shrink = question.contacts, question.creases, math.cos(STEP / 2.0)
    tested = tuple(
        sampled_set(creases[i]) if i in creases else contacts.normals[:, i, None]
        for i in range(contacts.count)
    )
    check_combinations([normals.shape[1] for normals in tested], cure=TOO_MANY_SAMPLES)
    on_crease = np.isin(np.arange(contacts.count), list(creases))
    safe = question.low.friction_angle - question.tilt
    reach = question.high.friction_angle + question.tilt
    narrow = np.where(on_crease, np.arcsin(np.clip(np.sin(safe) * shrink, 0.0, 1.0)), safe)
    wide = np.where(on_crease, np.arccos(np.clip(np.cos(reach) * shrink, -1.0, 1.0)), reach)
    beta = contacts.friction_angle
    worst = see(
        contacts, tested, cone_offset=np.maximum(narrow, 0.0) - beta, threads=question.threads
    )
    best = see(contacts, tested, cone_offset=wide - beta, threads=question.threads)
    stable = ~worst.failing & (safe > 0.0).all(axis=1)
    unstable = ~best.closing & (reach < RIGHT).all(axis=1)
    return stable, unstable, worst.hulls + best.hulls


def helping_normals(question: Question) -> Floats:
    """Normals within the tilts at which grasps close at the largest friction, shape (b, n, 3).

    Two are turned toward the line between them, more toward forces that balance in the widest
    cones. nan where neither these nor the perceived normals are known to close.
    """
    contacts = question.hard
    if contacts.count == 2:
        goals = _line_goals(question)
    else:
        widest = force_closure(
            contacts, cone_offset=question.outer_offset, threads=question.threads
        )
        goals = widest.certificate.equilibrium[..., :3]
    toward = turned(contacts.normals, goals, question.tilt)
    toward = np.where(np.isnan(toward).any(axis=(1, 2), keepdims=True), contacts.normals, toward)
    found = np.full(toward.shape, math.nan)
    for normals in (contacts.normals, toward):
        helped = Contacts(contacts.points, normals, question.high.friction)
        closed = force_closure(helped, threads=question.threads).closed
        found[closed] = normals[closed]
    return found


def _line_goals(question: Question) -> Floats:
    """Directions along the line of two contacts (b, 2, 3), squeezing or expanding as is nearer.

    nan where both are at one place.
    """
    contacts = question.hard
    line = contacts.points[:, 1] - contacts.points[:, 0]
    goals = np.stack([line, -line], axis=1)
    reach = question.high.friction_angle + question.tilt
    missing = [
        (angles_between(contacts.normals, sign * goals) - reach).max(axis=1) for sign in (1.0, -1.0)
    ]
    nearer = np.where((missing[0] <= missing[1])[:, None, None], goals, -goals)
    return np.where((line == 0.0).all(axis=1)[:, None, None], math.nan, nearer)
