"""Sets of normals: on a crease or corner, a contact may have any normal between the faces'.

The paper's method takes wrench hulls at every combination of extreme normals (Wan & Howe 2018, Sec.
III): the normals that a fingertip of resolution alpha cannot distinguish from the perceived one are
represented by extreme ones, alpha/2 away. A grasp is S if all hulls contain the origin, U if none
does, M otherwise. The method samples: epsilon at a tilt between those tested may be larger or
smaller (see `stability.label` for the exact method).
"""

import math
from collections.abc import Iterator, Mapping, Sequence
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.surface.surface_contacts import order_normal_sets
from grasp3d.arrays import RIGHT_ANGLE, ArrayLike, Bools, Floats, Ints, angles_between, unit_rows
from grasp3d.contact.contacts import Contacts, on_arcs, tilted_normals
from grasp3d.errors import ContactError, SettingError
from grasp3d.quality.critical_angle import Status, force_closure
from grasp3d.quality.ferrari_canny import Epsilon, epsilon_with
from grasp3d.quality.wrenches import EpsilonOptions

Creases = dict[int, Floats]
"""For contacts on creases, by number, the unit normals of the faces that meet there, (b, k, 3)."""

WorstAndBest = tuple[Floats, Floats]
"""Critical friction angles over the worst and over the best normals [rad]."""


class NormalSets(NamedTuple):
    """Sets of normals of contacts (b, n), those of contact i of grasp g in row n g + i."""

    start: Ints
    """First row of each set in `normals`, shape (b n + 1,)."""
    counts: Ints
    """Corners of each set: 1 where smooth, 0 where it spans every direction, shape (b n,)."""
    normals: Floats
    """Unit normals, the corners of each set in order around it, shape (K, 3)."""
    middles: Floats
    """Unit normal in the middle of each set, 0 where its normals cancel out, shape (b, n, 3)."""
    radii: Floats
    """Largest angle between the middle and a normal of the set [rad], shape (b, n)."""

    @classmethod
    def about(cls, start: Ints, counts: Ints, normals: Floats, middles: Floats) -> "NormalSets":
        """The sets with given middles, shape (b, n, 3)."""
        each = np.repeat(middles.reshape(-1, 3), np.diff(start), axis=0)
        angles = angles_between(each, normals)
        radii = np.maximum.reduceat(angles, start[:-1]) if len(angles) else np.zeros(0)
        radii = np.where(counts == 1, 0.0, np.where(counts == 0, 2.0 * RIGHT_ANGLE, radii))
        return cls(start, counts, normals, middles, radii.reshape(middles.shape[:2]))

    @classmethod
    def of_contacts(cls, contacts: Contacts, creases: Creases) -> "NormalSets":
        """The sets of a flat batch of contacts, some of which are on creases."""
        if not creases:
            start, none = np.arange(contacts.friction.size + 1), np.zeros(contacts.friction.shape)
            normals = contacts.normals.reshape(-1, 3)
            return cls(start, np.ones_like(start[1:]), normals, contacts.normals, none)
        rows = [creases.get(i, contacts.normals[:, i, None]) for i in range(contacts.count)]
        # The last corner of a set may be repeated.
        counts = [(set_ == set_[:, -1:]).all(axis=2).argmax(axis=1) + 1 for set_ in rows]
        sizes = np.tile([set_.shape[1] for set_ in rows], len(contacts.points))
        middles = np.stack([unit_rows(set_.sum(axis=1)) for set_ in rows], axis=1)
        return cls.about(
            np.concatenate([[0], np.cumsum(sizes)]),
            np.stack(counts, axis=1).ravel(),
            np.concatenate(rows, axis=1).reshape(-1, 3),
            middles,
        )


def face_normals(creases: Mapping[int, ArrayLike], contacts: Contacts) -> Creases:
    """Check the normals of faces that meet at contacts, and broadcast them to a flat batch.

    Args:
        creases: For contacts on creases, by number, inward normals of shape (..., k, 3), or
            (k, 3) for every grasp of the batch; k is 2 on a crease and more at a corner.
        contacts: The contacts.

    Returns:
        Corners of convex sets, in order around each; the last is repeated where there are fewer
        than k.

    Raises:
        ContactError: A contact that does not exist, shapes that do not match, normals of length 0,
            or not within a hemisphere.
    """
    if not isinstance(creases, Mapping):
        raise ContactError(
            "creases must map numbers of contacts to normals, as {0: [[1, 0, 0], [0, 1, 0]]}; "
            f"got {type(creases).__name__}"
        )
    return {i: _checked(i, rows, contacts) for i, rows in creases.items()}


def _checked(contact: int, values: ArrayLike, contacts: Contacts) -> Floats:
    if contact not in range(contacts.count):
        raise ContactError(
            f"creases name contact {contact}, but a grasp has contacts 0 to {contacts.count - 1}"
        )
    try:
        normals = np.asarray(values, dtype=np.float64)
        shape = (*contacts.batch, *normals.shape[-2:])
        normals = np.broadcast_to(normals, shape).reshape(-1, *normals.shape[-2:])
    except (TypeError, ValueError) as error:
        raise ContactError(
            f"normals at the crease of contact {contact} must be numbers of shape (k, 3) or "
            f"{(*contacts.batch, 'k', 3)}"
        ) from error
    if normals.ndim != 3 or normals.shape[2] != 3 or normals.shape[1] < 2:
        raise ContactError(
            f"contact {contact}: a crease needs two normals or more, shape (..., k, 3); "
            f"got {np.shape(values)}"
        )
    lengths = np.linalg.norm(normals, axis=2)
    if not (np.isfinite(normals).all() and (lengths > 0.0).all()):
        raise ContactError(f"contact {contact}: a normal at the crease has no direction")
    size, corners = normals.shape[:2]
    rows = unit_rows(normals).reshape(-1, 3)
    counts = np.zeros(size, dtype=np.int64)
    start = np.arange(size + 1) * corners
    order_normal_sets(start, rows, counts, np.zeros((size, 3)), np.zeros(size))
    if (counts == 0).any():
        raise ContactError(
            f"contact {contact}: the crease's normals do not lie within a hemisphere"
        )
    last = np.minimum(np.arange(corners), counts[:, None] - 1)  # (b, k)
    return np.take_along_axis(rows.reshape(normals.shape), last[..., None], axis=1)


MAX_HULLS = 65_536
"""Hulls in memory at once."""

FIRST_BLOCK = 8
"""Combinations that are tested first for every grasp; later blocks are larger, and omit decided
grasps."""

MIN_EXTREMES = 3
"""Fewest normals on a rim."""

EXTREME_NORMALS = 8
"""Normals on a rim, unless another number is given."""

MAX_COMBINATIONS = 2_000_000
"""Most combinations, and so hulls, of one grasp that are enumerated."""


class Extremes(NamedTuple):
    """Results of grasps over all combinations of tested normals, shape (b,) each."""

    stable: Bools
    """Whether the grasp is force-closed at every combination."""
    unstable: Bools
    """Whether it is force-closed at no combination, and all of them are decided."""
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

    At each contact, the given normal and `count` normals on a rim about it are tested, on several
    rims where the tilt exceeds two friction angles. At a crease the normals of the faces replace
    the given one, each with its own rims, and the bisector of each neighbouring pair is added.

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
    """Yield the numbers of all combinations, in blocks that are each spread over all."""
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
    """Number of rims about the perceived normal that are at most 2 beta apart.

    One is enough up to alpha = 4 beta. Beyond that, some normals between rim and centre have
    friction cones with directions that lie in no friction cone of a tested normal.

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
    """Check that there are not too many combinations of tested normals.

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
