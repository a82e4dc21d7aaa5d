"""The paper's method: wrench hulls at every combination of extreme normals.

Wan & Howe 2018, Sec. III: the normals that a fingertip of resolution alpha cannot distinguish from
the perceived one are represented by extreme ones, alpha/2 away. A grasp is S if all hulls contain
the origin, U if none does, M otherwise. The method samples: epsilon at a tilt between those tested
may be larger or smaller (see `thresholds` for the exact method).
"""

import itertools
import math
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.hull.wrench_problem import SIGN
from grasp3d.arrays import (
    ArrayLike,
    Bools,
    Floats,
    Ints,
    angles_between,
    locked,
    short_repr,
    unit_rows,
)
from grasp3d.contact.contacts import Contacts, centred, per_contact
from grasp3d.contact.friction_cones import on_arcs, tilted_normals
from grasp3d.errors import SettingError
from grasp3d.quality.closure import Status
from grasp3d.quality.ferrari_canny import certified
from grasp3d.quality.wrench_problem import WrenchProblem
from grasp3d.quality.wrenches import EpsilonOptions, wrench_axes

MAX_HULLS = 65_536
"""Hulls in memory at once."""

MAX_AXES = 250_000
"""Contacts at tested normals whose axes are in memory at once, 192 bytes each."""

FIRST_BLOCK = 4
"""Combinations that are tested first of every grasp; later blocks are larger, and leave out grasps
that are decided."""

GOLDEN_RATIO = 0.6180339887498949
"""Inverse of the golden ratio: multiples of it, modulo 1, are spread evenly from 0 to 1."""

MAX_COMBINATIONS = 2_000_000
"""Most combinations, and so hulls, of one grasp that are enumerated."""

REMEDY = (
    "the friction cone is narrow against the sensor's resolution, or the normals or fingers are "
    "too many; use method='exact', which needs none of them"
)

Tested = tuple[Floats, ...]
"""For each contact the normals that are tested there, unit vectors of shape (b, k_i, 3)."""


def rings_needed(tilt: ArrayLike, friction_angle: ArrayLike) -> int:
    """Number of rings of normals about the perceived one that are at most 2 beta apart.

    One ring, the rim, is enough up to alpha = 4 beta; from there on some normals between rim and
    centre have friction cones with directions that are in no friction cone of a tested normal.

    Args:
        tilt: Half the resolution of each contact [rad], any shape.
        friction_angle: Half-angles of the friction cones [rad], above 0 where normals may tilt,
            same shape.
    """
    tilts, beta = np.broadcast_arrays(np.asarray(tilt, np.float64), friction_angle)
    steps = np.divide(tilts, 2.0 * beta, out=np.zeros(tilts.shape), where=tilts > 0.0)
    largest = float(steps.max(initial=1.0))
    return math.ceil(largest - 1e-9) if math.isfinite(largest) else MAX_COMBINATIONS


def extreme_normals(
    contacts: Contacts,
    tilt: Floats,
    *,
    count: int,
    rings: int | None = None,
    creases: dict[int, Floats] | None = None,
) -> Tested:
    """Normals to test at each contact: the given one and `count` on every ring about it.

    At a crease the normals of the faces replace the given one, each with its own rings, and the
    bisecting normal of each neighbouring pair is added (more normals between them, where they would
    be more than 2 beta apart).

    Args:
        contacts: A flat batch of b grasps of n contacts.
        tilt: Largest angle between true and given normals [rad], shape (b, n).
        count: Number of normals on a ring, at least 3.
        rings: Number of rings, at even steps up to the tilt; None: `rings_needed`.
        creases: For some of the contacts, by number, the normals of the faces that meet there, in
            order around the contact, shape (b, k, 3).

    Raises:
        SettingError: Too many combinations.
    """
    beta = contacts.friction_angle
    rings = rings_needed(tilt, beta) if rings is None else rings
    per_normal = 1 + rings * count
    sizes = [per_normal] * contacts.count
    for i, faces in (creases or {}).items():
        sizes[i] *= faces.shape[1]
    check_combinations(sizes)
    tested = []
    for i in range(contacts.count):
        faces = (creases or {}).get(i, contacts.normals[:, i, None])  # (b, k, 3)
        tilted = tilted_normals(faces, tilt[:, i, None], count=count, rings=rings)
        normals = [tilted.reshape(len(faces), faces.shape[1] * per_normal, 3)]
        if faces.shape[1] > 1:
            normals.append(_between(faces, float(beta[:, i].min(initial=math.pi))))
        tested.append(np.concatenate(normals, axis=1))
    check_combinations([normals.shape[1] for normals in tested])
    return tuple(tested)


def check_combinations(sizes: Sequence[int], *, remedy: str = REMEDY) -> None:
    """Raise SettingError if there are too many combinations of tested normals.

    Args:
        sizes: Number of tested normals of each contact.
        remedy: Likely cause and remedy, for the error message.

    Raises:
        SettingError: There are too many combinations.
    """
    total = math.prod(sizes)
    if total > MAX_COMBINATIONS:
        raise SettingError(
            f"{' x '.join(str(size) for size in sizes)} normals make {total:.3g} combinations, "
            f"more than {MAX_COMBINATIONS:,}: {remedy}"
        )


def _between(faces: Floats, friction_angle: float) -> Floats:
    """Normals between those of faces (b, k, 3): on the arc of each neighbouring pair, and the mean.

    One bisects each arc; there are more where steps would exceed 2 beta.
    """
    first, second = faces, np.roll(faces, -1, axis=1)
    if faces.shape[1] == 2:
        first, second = first[:, :1], second[:, :1]
    widest = float(angles_between(first, second).max(initial=0.0))
    steps = 2 * math.ceil(rings_needed(widest, friction_angle) / 2)  # even, to include the bisector
    check_combinations([steps])
    arcs = on_arcs(first, second, np.arange(1, steps) / steps)  # (b, pairs, steps - 1, 3)
    between = arcs.reshape(len(faces), first.shape[1] * (steps - 1), 3)
    if first.shape[1] > 1:
        between = np.concatenate([between, unit_rows(faces.sum(axis=1, keepdims=True))], axis=1)
    # Normals that cancel out have no mean direction.
    return np.where((between == 0.0).all(axis=-1, keepdims=True), faces[:, :1], between)


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
        choices = np.stack(np.unravel_index(numbers, self.sizes), axis=-1)  # (c, n)
        each = np.arange(len(self.sizes))

        def wrenches_of(chunk: slice | Ints) -> Floats:
            row, column = np.divmod(np.arange(len(repeated))[chunk], len(numbers))
            return self.axes[grasps[row][:, None], each, choices[column]]

        repeated = np.repeat(grasps, len(numbers))
        return self.problem.with_wrenches(repeated, wrenches_of)

    def closed_at(self, grasps: Ints, numbers: Ints) -> tuple[Bools, Bools]:
        """Force closure of chosen grasps at chosen combinations.

        Returns:
            (surely force-closed, surely not force-closed), shape (g, c) each.
        """
        results = self.at(grasps, numbers).solve(SIGN, with_forces=False)
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
        options: Edges of the cones; None: circular cones. The other
            options do not affect closure.
        cone_offset: Angle added to the cones' half-angles [rad], one value or shape (b, n).
    """
    options = options or EpsilonOptions()
    sampling = EpsilonOptions(edges=options.edges)
    points, _, _ = centred(contacts.points)
    hard = Contacts(points, contacts.normals, contacts.friction)
    offset = per_contact("cone_offset", cone_offset, contacts)
    results = []
    for chunk in _chunks(contacts, tested):
        normals = tuple(at_contact[chunk] for at_contact in tested)
        enumeration = Enumeration.of(hard.take(chunk), normals, sampling, cone_offset=offset[chunk])
        results.append(_tested_closure(enumeration))
    return ClosureAtNormals(
        *(locked(np.concatenate(values)) for values in zip(*results, strict=True))
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


def extremes(contacts: Contacts, tested: Tested, options: EpsilonOptions | None = None) -> Extremes:
    """Epsilon at every combination of tested normals.

    Args:
        contacts: A flat batch of grasps.
        tested: Normals of each contact, as `extreme_normals` returns them.
        options: Cones, actuation, torque scale, and accuracy; None: the defaults.
    """
    settings = options or EpsilonOptions()
    parts = []
    for chunk in _chunks(contacts, tested):
        normals = tuple(at_contact[chunk] for at_contact in tested)
        parts.append(_extremes(Enumeration.of(contacts.take(chunk), normals, settings)))
    minimum, maximum, worst, best = (np.concatenate(values) for values in zip(*parts, strict=True))
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
    for start in range(0, enumeration.combinations, MAX_HULLS):
        numbers = np.arange(start, min(start + MAX_HULLS, enumeration.combinations))
        for grasps in _groups(np.arange(size), len(numbers)):
            results = enumeration.at(grasps, numbers).solve(options.goal, with_forces=False)
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
    choices = np.unravel_index(numbers, [at_contact.shape[1] for at_contact in tested])
    rows = np.arange(len(numbers))
    return np.stack(
        [at_contact[rows, k] for at_contact, k in zip(tested, choices, strict=True)], axis=1
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
