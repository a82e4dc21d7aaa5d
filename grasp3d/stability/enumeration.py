"""The paper's method: wrench hulls at every combination of extreme normals.

Wan & Howe 2018, Sec. III: a grasp is S if all hulls contain the origin, U if none does, M
otherwise. The method samples: epsilon at a tilt between those tested may be larger or smaller (see
`thresholds` for the exact method).
"""

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.wrench_problem import SIGN
from grasp3d.arrays import ArrayLike, Bools, Floats, Ints, locked, short_repr
from grasp3d.contact.contacts import Contacts, centred, per_contact
from grasp3d.quality.certificates import Status
from grasp3d.quality.epsilon_options import EpsilonOptions
from grasp3d.quality.ferrari_canny import certified
from grasp3d.quality.wrench_problem import WrenchProblem
from grasp3d.quality.wrenches import wrench_axes
from grasp3d.stability.extreme_normals import Tested

MAX_HULLS = 65_536
"""Hulls in memory at once."""

MAX_AXES = 250_000
"""Contacts at tested normals whose axes are in memory at once, 192 bytes each."""

FIRST_BLOCK = 4
"""Combinations that are tested first of every grasp; later blocks are larger, and leave out grasps
that are decided."""

GOLDEN_RATIO = 0.6180339887498949
"""Inverse of the golden ratio: multiples of it, modulo 1, are spread evenly from 0 to 1."""


@dataclass(frozen=True, eq=False)
class ClosureAtNormals:
    """Force closure at tested normals, evaluated until the label of each grasp is decided."""

    closing: Bools
    """Whether the grasp is force-closed at some combination, or that is undecided, shape (b,)."""
    failing: Bools
    """Whether it is not force-closed at some combination, or that is undecided, shape (b,)."""
    hulls: Ints
    """Number of combinations tested, shape (b,)."""

    __repr__ = short_repr


@dataclass(frozen=True, eq=False)
class Extremes:
    """Smallest and largest epsilon over the combinations of tested normals."""

    minimum: Floats
    """Certified lower bound, shape (b,)."""
    maximum: Floats
    """Certified lower bound, shape (b,)."""
    worst_normals: Floats
    """The combination that attains the minimum, inward unit normals, shape (b, n, 3)."""
    best_normals: Floats
    """The combination that attains the maximum, shape (b, n, 3)."""
    hulls: int
    """Number of combinations tested of each grasp."""

    __repr__ = short_repr


class Enumeration(NamedTuple):
    """The wrench spaces of grasps at every combination of tested normals."""

    problem: WrenchProblem
    """The grasps at their nominal normals."""
    axes: Floats
    """Axes of each contact at each tested normal, shape (b, n, k, 4, 6)."""
    sizes: tuple[int, ...]
    """Number of tested normals of each contact."""
    options: EpsilonOptions

    @classmethod
    def of(
        cls,
        contacts: Contacts,
        tested: Tested,
        options: EpsilonOptions,
        *,
        cone_offset: ArrayLike = 0.0,
    ) -> "Enumeration":
        """The enumeration for a flat batch of grasps."""
        sizes = tuple(normals.shape[1] for normals in tested)
        shape = (*contacts.points.shape[:2], max(sizes), 3)
        normals = np.empty(shape)
        for i, at_contact in enumerate(tested):
            normals[:, i, : sizes[i]] = at_contact
            normals[:, i, sizes[i] :] = at_contact[:, :1]  # padding
        points = np.broadcast_to(contacts.points[:, :, None], shape)
        torsion = np.broadcast_to(contacts.torsion_radius[:, :, None], shape[:-1])
        problem = WrenchProblem.of_contacts(contacts, options, cone_offset=cone_offset)
        axes = wrench_axes(points, normals, torsion, options.torque_scale)
        return cls(problem, axes, sizes, options)

    @property
    def combinations(self) -> int:
        """Number of combinations of tested normals of each grasp."""
        return math.prod(self.sizes)

    def at(self, grasps: Ints, numbers: Ints) -> WrenchProblem:
        """Wrench problem of chosen grasps (g,), each at chosen combinations (c,): g x c in all."""
        chosen = np.stack(np.unravel_index(numbers, self.sizes), axis=-1)  # (c, n)
        each = np.arange(len(self.sizes))

        def wrenches_of(chunk: slice | Ints) -> Floats:
            row, column = np.divmod(np.arange(len(repeated))[chunk], len(numbers))
            return self.axes[grasps[row][:, None], each, chosen[column]]

        whole, repeated = self.problem, np.repeat(grasps, len(numbers))
        return replace(
            whole,
            size=len(repeated),
            wrenches_of=wrenches_of,
            tangential=whole.tangential[repeated],
            cones=whole.cones[repeated],
            tilts_exceed_friction=whole.tilts_exceed_friction[repeated],
            points=None if whole.points is None else whole.points[repeated],
        )

    def closed_at(self, grasps: Ints, numbers: Ints) -> tuple[Bools, Bools]:
        """Force closure of chosen grasps at chosen combinations.

        Returns:
            (surely force-closed, surely not force-closed), shape (g, c) each.
        """
        results = self.at(grasps, numbers).solve(
            SIGN, with_forces=False, threads=self.options.threads
        )
        shape = len(grasps), len(numbers)
        closed = results.closed.reshape(shape)
        return closed, ~closed & (results.status != Status.UNDECIDED).reshape(shape)


def closure_at(
    contacts: Contacts,
    tested: Tested,
    options: EpsilonOptions | None = None,
    *,
    cone_offset: ArrayLike = 0.0,
) -> ClosureAtNormals:
    """Test combinations until a grasp is force-closed at one and not at another, or all are tested.

    Args:
        contacts: A flat batch of grasps; torsion is ignored.
        tested: Normals of each contact, as `extreme_normals` returns them.
        options: Edges of the cones and threads; None: circular cones, one thread. The other
            options do not affect closure.
        cone_offset: Angle added to the cones' half-angles [rad], one value or shape (b, n).
    """
    options = options or EpsilonOptions()
    used = EpsilonOptions(edges=options.edges, threads=options.threads)
    points, _, _ = centred(contacts.points)
    hard = Contacts(points, contacts.normals, contacts.friction)
    offset = per_contact("cone_offset", cone_offset, contacts)
    found = []
    for chunk in _chunks(contacts, tested):
        normals = tuple(at_contact[chunk] for at_contact in tested)
        enumeration = Enumeration.of(hard.take(chunk), normals, used, cone_offset=offset[chunk])
        found.append(_tested_closure(enumeration))
    return ClosureAtNormals(
        *(locked(np.concatenate(values)) for values in zip(*found, strict=True))
    )


def _tested_closure(enumeration: Enumeration) -> tuple[Bools, Bools, Ints]:
    """Fields (closing, failing, hulls) of `ClosureAtNormals`, shape (b,) each."""
    closing, failing = np.zeros((2, enumeration.problem.size), dtype=np.bool_)
    hulls = np.zeros(enumeration.problem.size, dtype=np.int64)
    undecided = np.arange(enumeration.problem.size)
    for numbers in _blocks(enumeration.combinations):
        if undecided.size == 0:
            break
        for grasps in _groups(undecided, len(numbers)):
            closed, failed = enumeration.closed_at(grasps, numbers)
            closing[grasps] |= ~failed.all(axis=1)
            failing[grasps] |= ~closed.all(axis=1)
            hulls[grasps] += len(numbers)
        undecided = undecided[~(closing[undecided] & failing[undecided])]
    return closing, failing, hulls


def extremes(
    contacts: Contacts,
    tested: Tested,
    options: EpsilonOptions | None = None,
) -> Extremes:
    """Epsilon at every combination of tested normals.

    Args:
        contacts: A flat batch of grasps.
        tested: Normals of each contact, as `extreme_normals` returns them.
        options: Cones, actuation, torque scale, accuracy and threads; None: the defaults.
    """
    used = options or EpsilonOptions()
    found = []
    for chunk in _chunks(contacts, tested):
        normals = tuple(at_contact[chunk] for at_contact in tested)
        found.append(_extremes(Enumeration.of(contacts.take(chunk), normals, used)))
    minimum, maximum, worst, best = (np.concatenate(values) for values in zip(*found, strict=True))
    return Extremes(
        minimum=locked(minimum),
        maximum=locked(maximum),
        worst_normals=locked(_normals(tested, worst)),
        best_normals=locked(_normals(tested, best)),
        hulls=math.prod(at_contact.shape[1] for at_contact in tested),
    )


def _extremes(enumeration: Enumeration) -> tuple[Floats, Floats, Ints, Ints]:
    """(smallest, largest, combination of the smallest, of the largest), shape (b,) each."""
    size, options = enumeration.problem.size, enumeration.options
    minimum, maximum = np.full(size, math.inf), np.full(size, -math.inf)
    worst, best = np.zeros((2, size), dtype=np.int64)
    for numbers in _blocks_in_order(enumeration.combinations):
        for grasps in _groups(np.arange(size), len(numbers)):
            results = enumeration.at(grasps, numbers).solve(
                options.goal, with_forces=False, threads=options.threads
            )
            lower = certified(results, polygonal=options.polygonal)
            values = np.where(results.closed, lower, 0.0).reshape(len(grasps), -1)
            rows = np.arange(len(grasps))
            low, high = values.argmin(axis=1), values.argmax(axis=1)
            smaller = values[rows, low] < minimum[grasps]
            larger = values[rows, high] > maximum[grasps]
            worst[grasps[smaller]], best[grasps[larger]] = (
                numbers[low[smaller]],
                numbers[high[larger]],
            )
            minimum[grasps] = np.minimum(minimum[grasps], values[rows, low])
            maximum[grasps] = np.maximum(maximum[grasps], values[rows, high])
    return minimum, maximum, worst, best


def _normals(tested: Tested, numbers: Ints) -> Floats:
    """The normals of one combination for each grasp, shape (b, n, 3)."""
    chosen = np.unravel_index(numbers, [at_contact.shape[1] for at_contact in tested])
    rows = np.arange(len(numbers))
    return np.stack(
        [at_contact[rows, k] for at_contact, k in zip(tested, chosen, strict=True)], axis=1
    )


def _blocks(total: int) -> Iterator[Ints]:
    """All combinations, the given normals first, in an order that spreads each block evenly."""
    stride = next(
        s for s in itertools.count(max(1, round(GOLDEN_RATIO * total))) if math.gcd(s, total) == 1
    )
    start, size = 0, FIRST_BLOCK
    while start < total:
        yield (np.arange(start, min(start + size, total)) * stride) % total
        start, size = start + size, min(4 * size, MAX_HULLS)


def _blocks_in_order(total: int) -> Iterator[Ints]:
    """All combinations in order."""
    for start in range(0, total, MAX_HULLS):
        yield np.arange(start, min(start + MAX_HULLS, total))


def _groups(grasps: Ints, each: int) -> Iterator[Ints]:
    """Grasps in groups whose hulls at `each` combinations fit into memory."""
    step = max(1, MAX_HULLS // each)
    for start in range(0, len(grasps), step):
        yield grasps[start : start + step]


def _chunks(contacts: Contacts, tested: Tested) -> Iterator[slice]:
    """Chunks of grasps whose axes fit into memory; at least one chunk."""
    step = max(1, MAX_AXES // (contacts.count * max(normals.shape[1] for normals in tested)))
    for start in range(0, max(len(contacts.points), 1), step):
        yield slice(start, start + step)
