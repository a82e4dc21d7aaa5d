"""Extreme normals, which represent all normals within the resolution of a sensor.

Wan & Howe 2018, Sec. III: the normals that a fingertip of resolution alpha cannot distinguish from
the perceived one are represented by extreme ones, alpha/2 away.
"""

import math
from collections.abc import Sequence

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, angles_between, unit_rows
from grasp3d.contact.contacts import Contacts
from grasp3d.contact.friction_cones import on_arcs, tilted_normals
from grasp3d.errors import SettingError

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
    pairs = [(0, 1)] if faces.shape[1] == 2 else _neighbouring_pairs(faces.shape[1])
    first, second = (faces[:, [pair[end] for pair in pairs]] for end in (0, 1))
    widest = float(angles_between(first, second).max(initial=0.0))
    steps = 2 * math.ceil(rings_needed(widest, friction_angle) / 2)  # even, to include the bisector
    check_combinations([steps])
    arcs = on_arcs(first, second, np.arange(1, steps) / steps)  # (b, pairs, steps - 1, 3)
    between = arcs.reshape(len(faces), len(pairs) * (steps - 1), 3)
    if len(pairs) > 1:
        between = np.concatenate([between, unit_rows(faces.sum(axis=1, keepdims=True))], axis=1)
    # Normals that cancel out have no mean direction.
    return np.where((between == 0.0).all(axis=-1, keepdims=True), faces[:, :1], between)


def _neighbouring_pairs(count: int) -> list[tuple[int, int]]:
    return [(i, (i + 1) % count) for i in range(count)]
