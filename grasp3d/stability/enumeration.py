"""The paper's method: wrench hulls at every combination of extreme normals.

Wan & Howe 2018, Sec. III: a grasp is S where all of them hold the origin, U where none does, M
otherwise. It is sampled: a tilt between those tried may do better or worse (see `stability` for
the exact thresholds).
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.wrench_problem import SIGN
from grasp3d.arrays import Bools, Floats, Ints, locked
from grasp3d.contact.contacts import Contacts, centred, per_contact
from grasp3d.quality.ferrari_canny import certified, goal_of
from grasp3d.quality.wrench_problem import Goal, WrenchProblem
from grasp3d.quality.wrenches import wrench_axes
from grasp3d.settings import Actuation
from grasp3d.stability.extreme_normals import Tested

PART = 65_536
"""Hulls in memory at once."""

LAID_OUT = 250_000
"""Contacts at tested normals whose axes are in memory at once, 192 bytes each."""

FIRST_BLOCK = 4
"""Combinations tried of every grasp before those that are settled drop out; then ever more."""

GOLDEN = 0.6180339887498949


@dataclass(frozen=True, eq=False)
class Seen:
    """What an enumeration saw of each grasp before its label was settled."""

    closing: Bools
    """Some combination closes, shape (b,)."""
    failing: Bools
    """Some combination does not, shape (b,)."""
    hulls: Ints
    """Combinations tried, shape (b,)."""


@dataclass(frozen=True, eq=False)
class Extremes:
    """Smallest and largest epsilon over the combinations of tested normals."""

    minimum: Floats
    """Shape (b,); certified from below, like `maximum`."""
    maximum: Floats
    worst_normals: Floats
    """The combination that attains the minimum, inward unit normals, shape (b, n, 3)."""
    best_normals: Floats
    """The combination that attains the maximum, shape (b, n, 3)."""
    hulls: int
    """Combinations tried of every grasp."""


class Enumeration(NamedTuple):
    """The wrench spaces of grasps at every combination of tested normals."""

    problem: WrenchProblem
    """The grasps at their nominal normals."""
    axes: Floats
    """Axes of each contact at each tested normal, shape (b, n, k, 4, 6)."""
    sizes: tuple[int, ...]
    """Tested normals of each contact."""
    threads: int | None

    @classmethod
    def of(
        cls,
        contacts: Contacts,
        tested: Tested,
        *,
        edges: int | None = None,
        actuation: Actuation = "total",
        torque_scale: float = 1.0,
        cone_offset: npt.ArrayLike = 0.0,
        threads: int | None = 1,
    ) -> "Enumeration":
        """Lay out a flat batch of grasps; the settings are those of `quality.epsilon`."""
        sizes = tuple(normals.shape[1] for normals in tested)
        shape = (*contacts.points.shape[:2], max(sizes), 3)
        normals = np.empty(shape)
        for i, some in enumerate(tested):
            normals[:, i, : sizes[i]], normals[:, i, sizes[i] :] = some, some[:, :1]
        points = np.broadcast_to(contacts.points[:, :, None], shape)
        torsion = np.broadcast_to(contacts.torsion_radius[:, :, None], shape[:-1])
        problem = WrenchProblem.of_contacts(
            contacts, edges, actuation, torque_scale=torque_scale, cone_offset=cone_offset
        )
        return cls(problem, wrench_axes(points, normals, torsion, torque_scale), sizes, threads)

    @property
    def combinations(self) -> int:
        """Of tested normals, for every grasp."""
        return math.prod(self.sizes)

    def at(self, grasps: Ints, numbers: Ints) -> WrenchProblem:
        """Some grasps (g,), each at some combinations (c,): a problem of g x c wrench spaces."""
        chosen = np.stack(np.unravel_index(numbers, self.sizes), axis=-1)  # (c, n)
        each = np.arange(len(self.sizes))

        def lay_out(part: slice) -> Floats:
            row, column = np.divmod(np.arange(part.start, part.stop), len(numbers))
            return self.axes[grasps[row][:, None], each, chosen[column]]

        whole, repeated = self.problem, np.repeat(grasps, len(numbers))
        return replace(
            whole,
            size=len(repeated),
            lay_out=lay_out,
            reach=whole.reach[repeated],
            cones=whole.cones[repeated],
            beyond=whole.beyond[repeated],
        )

    def closes(self, grasps: Ints, numbers: Ints) -> Bools:
        """Force closure of some grasps at some combinations, shape (g, c)."""
        answers = self.at(grasps, numbers).solve(SIGN, prove=False, threads=self.threads)
        return answers.closed.reshape(len(grasps), len(numbers))


def see(
    contacts: Contacts,
    tested: Tested,
    *,
    edges: int | None = None,
    cone_offset: npt.ArrayLike = 0.0,
    threads: int | None = 1,
) -> Seen:
    """Try combinations until a grasp is seen both to close and to fail, or all of them.

    Args:
        contacts: A flat batch of grasps; torsion plays no part.
        tested: As `extreme_normals` gives them.
        edges: Edges of polygonal friction cones; None: circular ones.
        cone_offset: Angle added to the cones' half-angles [rad], one or shape (b, n).
        threads: Threads; None: one per processor.
    """
    points, _, _ = centred(contacts.points)
    hard = Contacts(points, contacts.normals, contacts.friction)
    more = per_contact("cone_offset", cone_offset, contacts)
    seen = []
    for part in _parts(contacts, tested):
        some = tuple(normals[part] for normals in tested)
        question = Enumeration.of(
            hard.take(part), some, edges=edges, cone_offset=more[part], threads=threads
        )
        seen.append(_seen(question))
    return Seen(*(locked(np.concatenate(found)) for found in zip(*seen, strict=True)))


def _seen(question: Enumeration) -> tuple[Bools, Bools, Ints]:
    """See `Seen`."""
    closing, failing = np.zeros((2, question.problem.size), dtype=np.bool_)
    hulls = np.zeros(question.problem.size, dtype=np.int64)
    open_ = np.arange(question.problem.size)
    for numbers in _blocks(question.combinations):
        if open_.size == 0:
            break
        for grasps in _groups(open_, len(numbers)):
            closed = question.closes(grasps, numbers)
            closing[grasps] |= closed.any(axis=1)
            failing[grasps] |= ~closed.all(axis=1)
            hulls[grasps] += len(numbers)
        open_ = open_[~(closing[open_] & failing[open_])]
    return closing, failing, hulls


def extremes(
    contacts: Contacts,
    tested: Tested,
    *,
    edges: int | None = None,
    actuation: Actuation = "total",
    torque_scale: float = 1.0,
    rtol: float = 1e-3,
    threads: int | None = 1,
) -> Extremes:
    """Epsilon at every combination of tested normals.

    Args:
        contacts: A flat batch of grasps.
        tested: As `extreme_normals` gives them.
        edges: As in `quality.epsilon`, like all that follow.
        actuation: As in `quality.epsilon`.
        torque_scale: As in `quality.epsilon`.
        rtol: As in `quality.epsilon`.
        threads: As in `quality.epsilon`.
    """
    goal, polygonal = goal_of(edges, rtol), edges is not None
    found = []
    for part in _parts(contacts, tested):
        question = Enumeration.of(
            contacts.take(part), tuple(normals[part] for normals in tested), edges=edges,
            actuation=actuation, torque_scale=torque_scale, threads=threads,
        )  # fmt: skip
        found.append(_extremes(question, goal, polygonal=polygonal))
    least, most, worst, best = (np.concatenate(values) for values in zip(*found, strict=True))
    return Extremes(
        minimum=locked(least),
        maximum=locked(most),
        worst_normals=locked(_normals(tested, worst)),
        best_normals=locked(_normals(tested, best)),
        hulls=math.prod(normals.shape[1] for normals in tested),
    )


def _extremes(
    question: Enumeration, goal: Goal, *, polygonal: bool
) -> tuple[Floats, Floats, Ints, Ints]:
    """(smallest, largest, combination of the smallest, of the largest), shape (b,) each."""
    size = question.problem.size
    least, most = np.full(size, math.inf), np.full(size, -math.inf)
    worst, best = np.zeros((2, size), dtype=np.int64)
    for numbers in _runs(question.combinations):
        for grasps in _groups(np.arange(size), len(numbers)):
            answers = question.at(grasps, numbers).solve(
                goal, prove=False, threads=question.threads
            )
            values = np.where(answers.closed, certified(answers, polygonal=polygonal), 0.0)
            values = values.reshape(len(grasps), -1)
            rows = np.arange(len(grasps))
            low, high = values.argmin(axis=1), values.argmax(axis=1)
            less, more = values[rows, low] < least[grasps], values[rows, high] > most[grasps]
            worst[grasps[less]], best[grasps[more]] = numbers[low[less]], numbers[high[more]]
            least[grasps] = np.minimum(least[grasps], values[rows, low])
            most[grasps] = np.maximum(most[grasps], values[rows, high])
    return least, most, worst, best


def _normals(tested: Tested, numbers: Ints) -> Floats:
    """The normals of one combination for each grasp, shape (b, n, 3)."""
    chosen = np.unravel_index(numbers, [normals.shape[1] for normals in tested])
    rows = np.arange(len(numbers))
    return np.stack([some[rows, k] for some, k in zip(tested, chosen, strict=True)], axis=1)


def _blocks(total: int) -> Iterator[Ints]:
    """All combinations, the given normals first, spread so that early blocks hold every kind."""
    stride = next(
        s for s in itertools.count(max(1, round(GOLDEN * total))) if math.gcd(s, total) == 1
    )
    start, size = 0, FIRST_BLOCK
    while start < total:
        yield (np.arange(start, min(start + size, total)) * stride) % total
        start, size = start + size, min(4 * size, PART)


def _runs(total: int) -> Iterator[Ints]:
    """All combinations in order."""
    for start in range(0, total, PART):
        yield np.arange(start, min(start + PART, total))


def _groups(grasps: Ints, each: int) -> Iterator[Ints]:
    """Grasps so many at a time that they and their combinations fit."""
    step = max(1, PART // each)
    for start in range(0, len(grasps), step):
        yield grasps[start : start + step]


def _parts(contacts: Contacts, tested: Tested) -> Iterator[slice]:
    """Grasps so many at a time that their axes fit; at least one part."""
    step = max(1, LAID_OUT // (contacts.count * max(normals.shape[1] for normals in tested)))
    for start in range(0, max(len(contacts.points), 1), step):
        yield slice(start, start + step)
