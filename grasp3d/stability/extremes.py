"""The paper's method: wrench hulls at every combination of extreme normals.

Wan & Howe 2018, Sec. III: the normals that a fingertip of resolution alpha cannot distinguish from
the perceived one are represented by extreme ones, alpha/2 away. A grasp is S if all hulls contain
the origin, U if none does, M otherwise. The method samples: epsilon at a tilt between those tested
may be larger or smaller (see `thresholds` for the exact method).
"""

import math
from collections.abc import Iterator, Sequence
from typing import NamedTuple

import numpy as np

from grasp3d.arrays import ArrayLike, Bools, Floats, Ints, angles_between, unit_rows
from grasp3d.contact.contacts import Contacts
from grasp3d.contact.friction_cones import on_arcs, tilted_normals
from grasp3d.errors import SettingError
from grasp3d.quality.closure import Status, force_closure
from grasp3d.quality.ferrari_canny import Epsilon, epsilon_with
from grasp3d.quality.wrenches import EpsilonOptions
from grasp3d.stability.normal_sets import Creases

MAX_HULLS = 65_536
"""Hulls in memory at once."""

FIRST_BLOCK = 8
"""Combinations that are tested first of every grasp; later blocks are larger, and leave out grasps
that are decided."""

MIN_EXTREMES = 3
"""Fewest normals on a rim."""

EXTREME_NORMALS = 8
"""Normals on a rim, unless another number is given."""

MAX_COMBINATIONS = 2_000_000
"""Most combinations, and so hulls, of one grasp that are enumerated."""


class Extremes(NamedTuple):
    """What the combinations of tested normals say of grasps (b,)."""

    stable: Bools
    """Whether the grasp is force-closed at every combination."""
    unstable: Bools
    """Whether it is force-closed at none, and decided at all of them."""
    minimum: Floats
    """Smallest epsilon, certified from below; inf where only closure was asked for."""
    maximum: Floats
    """Largest of the lower bounds of epsilon; -inf likewise."""


def extremes(
    contacts: Contacts,
    tilt: Floats,
    *,
    count: int = EXTREME_NORMALS,
    creases: Creases | None = None,
    options: EpsilonOptions | None = None,
) -> Extremes:
    """Evaluate grasps at every combination of the perceived and the extreme normals.

    At a contact these are the given normal and `count` on a rim about it, on several rims where the
    tilt exceeds two friction angles. At a crease the normals of the faces replace the given one,
    each with its own rims, and the bisecting normal of each neighbouring pair is added.

    Args:
        contacts: A flat batch of b grasps of n contacts.
        tilt: Largest angle between true and given normals [rad], shape (b, n).
        count: Number of normals on a rim, at least 3.
        creases: For some of the contacts, by number, the normals of the faces that meet there, in
            order around the contact, shape (b, k, 3).
        options: Cones, actuation, torque scale and accuracy of epsilon; None: closure alone, of
            circular cones, until the label is decided.

    Raises:
        SettingError: Too many combinations.
    """
    tested = normals_to_test(contacts, tilt, count=count, creases=creases)
    sizes = [normals.shape[1] for normals in tested]
    hard = Contacts(contacts.points, contacts.normals, contacts.friction)
    evaluated = contacts if options else hard  # labels are those of hard fingers
    stable, unstable = np.ones((2, len(tilt)), dtype=np.bool_)
    minimum, maximum = np.full(len(tilt), math.inf), np.full(len(tilt), -math.inf)
    for numbers in _blocks(math.prod(sizes)):
        choices = np.unravel_index(numbers, sizes)
        left = np.arange(len(tilt)) if options else np.flatnonzero(stable | unstable)
        step = max(1, MAX_HULLS // len(numbers))
        for start in range(0, len(left), step):
            rows = left[start : start + step]
            normals = np.stack(
                [at[rows][:, k] for at, k in zip(tested, choices, strict=True)], axis=2
            )  # (g, c, n, 3)
            same = evaluated.take(rows.repeat(len(numbers))).reshape(normals.shape[:2])
            at_normals = Contacts(same.points, normals, same.friction, same.torsion_radius)
            found = epsilon_with(at_normals, options) if options else force_closure(at_normals)
            if isinstance(found, Epsilon):
                minimum[rows] = np.minimum(minimum[rows], found.lower.min(axis=1))
                maximum[rows] = np.maximum(maximum[rows], found.lower.max(axis=1))
            is_open = ~found.closed & (found.status == Status.CONVERGED)
            stable[rows] &= found.closed.all(axis=1)
            unstable[rows] &= is_open.all(axis=1)
    return Extremes(stable, unstable, minimum, maximum)


def _blocks(total: int) -> Iterator[Ints]:
    """The numbers of all combinations, in blocks that are each spread over all."""
    numbers, start, size = np.random.default_rng(0).permutation(total), 0, FIRST_BLOCK
    while start < total:
        yield numbers[start : start + size]
        start, size = start + size, min(8 * size, MAX_HULLS)


def normals_to_test(
    contacts: Contacts, tilt: Floats, *, count: int, creases: Creases | None
) -> list[Floats]:
    """Normals to test at each contact, shape (b, k_i, 3); see `extremes`."""
    beta = contacts.friction_angle
    rings = rings_needed(tilt, beta)
    per_normal = 1 + rings * count
    faces_of = [(creases or {}).get(i, contacts.normals[:, i, None]) for i in range(contacts.count)]
    check_combinations([per_normal * faces.shape[1] for faces in faces_of])
    tested = []
    for i, faces in enumerate(faces_of):
        tilted = tilted_normals(faces, tilt[:, i, None], count=count, rings=rings)
        normals = [tilted.reshape(len(faces), -1, 3)]
        if faces.shape[1] > 1:
            normals.append(_between(faces, float(beta[:, i].min(initial=math.pi))))
        tested.append(np.concatenate(normals, axis=1))
    check_combinations([normals.shape[1] for normals in tested])
    return tested


def rings_needed(tilt: ArrayLike, friction_angle: ArrayLike) -> int:
    """Number of rims of normals about the perceived one that are at most 2 beta apart.

    One is enough up to alpha = 4 beta; from there on some normals between rim and centre have
    friction cones with directions that are in no friction cone of a tested normal.

    Args:
        tilt: Half the resolution of each contact [rad], any shape.
        friction_angle: Half-angles of the friction cones [rad], above 0 where normals may tilt,
            same shape.
    """
    tilts, beta = np.broadcast_arrays(np.asarray(tilt, np.float64), friction_angle)
    steps = np.divide(tilts, 2.0 * beta, out=np.zeros(tilts.shape), where=tilts > 0.0)
    largest = float(steps.max(initial=1.0))
    return math.ceil(largest - 1e-9) if math.isfinite(largest) else MAX_COMBINATIONS


def check_combinations(sizes: Sequence[int]) -> None:
    """Raise SettingError if there are too many combinations of tested normals.

    Args:
        sizes: Number of tested normals of each contact.

    Raises:
        SettingError: There are too many combinations.
    """
    total = math.prod(sizes)
    if total > MAX_COMBINATIONS:
        raise SettingError(
            f"{' x '.join(str(size) for size in sizes)} normals make {total:.3g} combinations, "
            f"more than {MAX_COMBINATIONS:,}: the friction cone is narrow against the sensor's "
            "resolution, or the normals or fingers are too many; use method='exact', which needs "
            "none of them"
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
