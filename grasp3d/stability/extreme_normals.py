"""Extreme normals: those that stand for all that a sensor cannot tell from the perceived one.

Wan & Howe 2018, Sec. III: the normals that a fingertip of resolution alpha cannot tell from the
perceived one are stood for by extreme ones, alpha/2 away.
"""

import math
from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Floats, unit_rows
from grasp3d.contact.contacts import Contacts
from grasp3d.contact.friction_cones import on_arcs, tilted_normals
from grasp3d.errors import SettingError
from grasp3d.quality.critical_angle import angles_between

MOST_COMBINATIONS = 2_000_000
"""Hulls of one grasp beyond which the enumeration is refused."""

CURE = (
    "the friction cone is narrow against the sensor's resolution, or the normals or fingers are "
    "too many; use method='exact', which needs none of them"
)

Tested = tuple[Floats, ...]
"""For each contact the normals that are tried there, unit vectors of shape (b, k_i, 3)."""


def rings_needed(tilt: npt.ArrayLike, friction_angle: npt.ArrayLike) -> int:
    """Rings of normals about the perceived one, at most 2 beta apart.

    One, the rim, is enough up to alpha = 4 beta; beyond it rim and centre leave normals between
    them whose friction cones hold directions that no tested one does.

    Args:
        tilt: Half the resolution of each contact [rad], any shape.
        friction_angle: Half-angles of the friction cones [rad], above 0 where normals may tilt,
            same shape.
    """
    turns, beta = np.broadcast_arrays(np.asarray(tilt, np.float64), friction_angle)
    apart = np.divide(turns, 2.0 * beta, out=np.zeros(turns.shape), where=turns > 0.0)
    most = float(apart.max(initial=1.0))
    return math.ceil(most - 1e-9) if math.isfinite(most) else MOST_COMBINATIONS


def extreme_normals(
    contacts: Contacts,
    tilt: Floats,
    *,
    count: int,
    rings: int | None = None,
    creases: dict[int, Floats] | None = None,
) -> Tested:
    """Normals to try at each contact: the given one and `count` on every ring about it.

    At a crease those of the faces take its place, each with rings of its own, and between
    neighbouring ones the bisecting normal is added (more of them, where those would be more than
    2 beta apart).

    Args:
        contacts: A flat batch of b grasps of n contacts.
        tilt: How far each normal may turn [rad], shape (b, n).
        count: Normals on a ring, at least 3.
        rings: Rings at even steps up to the tilt; None: `rings_needed`.
        creases: For some of the contacts, by number, the normals of the faces that meet there, in
            order around the place, shape (b, k, 3).

    Raises:
        SettingError: More combinations than can be tried.
    """
    beta = contacts.friction_angle
    rings = rings_needed(tilt, beta) if rings is None else rings
    around = 1 + rings * count
    sizes = [around] * contacts.count
    for i, faces in (creases or {}).items():
        sizes[i] *= faces.shape[1]
    check_combinations(sizes)
    tested = []
    for i in range(contacts.count):
        faces = (creases or {}).get(i, contacts.normals[:, i, None])  # (b, k, 3)
        turned = tilted_normals(faces, tilt[:, i, None], count=count, rings=rings)
        normals = [turned.reshape(len(faces), faces.shape[1] * around, 3)]
        if faces.shape[1] > 1:
            normals.append(_between(faces, float(beta[:, i].min(initial=math.pi))))
        tested.append(np.concatenate(normals, axis=1))
    check_combinations([t.shape[1] for t in tested])
    return tuple(tested)


def check_combinations(sizes: Sequence[int], *, cure: str = CURE) -> None:
    """Refuse too many combinations of tested normals.

    Args:
        sizes: Normals of each contact.
        cure: What the error says of why and of what to do.

    Raises:
        SettingError: They are too many.
    """
    total = math.prod(sizes)
    if total > MOST_COMBINATIONS:
        raise SettingError(
            f"{' x '.join(str(size) for size in sizes)} normals make {total:.3g} combinations, "
            f"more than {MOST_COMBINATIONS:,}: {cure}"
        )


def _between(faces: Floats, friction_angle: float) -> Floats:
    """Normals between the faces' (b, k, 3): on the arc of each neighbouring pair, and the middle.

    One bisects the arc; more stand there where steps would exceed 2 beta.
    """
    pairs = [(0, 1)] if faces.shape[1] == 2 else _around(faces.shape[1])
    one, two = (faces[:, [pair[end] for pair in pairs]] for end in (0, 1))
    widest = float(angles_between(one, two).max(initial=0.0))
    steps = 2 * math.ceil(rings_needed(widest, friction_angle) / 2)  # even: the bisector is one
    check_combinations([steps])
    arcs = on_arcs(one, two, np.arange(1, steps) / steps)  # (b, pairs, steps - 1, 3)
    found = arcs.reshape(len(faces), len(pairs) * (steps - 1), 3)
    if len(pairs) > 1:
        found = np.concatenate([found, unit_rows(faces.sum(axis=1, keepdims=True))], axis=1)
    # Normals that cancel out have no middle.
    return np.where((found == 0.0).all(axis=-1, keepdims=True), faces[:, :1], found)


def _around(count: int) -> list[tuple[int, int]]:
    return [(i, (i + 1) % count) for i in range(count)]
