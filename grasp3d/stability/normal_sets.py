"""Contacts on creases and corners, which may have any normal between those of the faces there."""

import math
from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from grasp3d._kernels.normal_angles import largest_angle, smallest_angle
from grasp3d._kernels.normal_sets import order_normal_sets
from grasp3d.arrays import Floats, Ints, unit_rows
from grasp3d.contact.contacts import Contacts
from grasp3d.contact.friction_cones import on_arcs
from grasp3d.errors import ContactError
from grasp3d.quality.critical_angle import angles_between

STEP = math.radians(5.0)
"""Normals of a set are sampled so that none is further than half of this from their cap."""

ONE_NORMAL = 1e-9
"""Width of a set below which it counts as a single normal [rad]."""

Creases = dict[int, Floats]
"""For some contacts, by number, the unit normals of the faces that meet there, (b, k, 3)."""


def face_normals(creases: Mapping[int, npt.ArrayLike], contacts: Contacts) -> Creases:
    """Check the normals of faces that meet at contacts, and lay them out in a flat batch.

    Args:
        creases: For some contacts, by number, inward normals of shape (..., k, 3), or (k, 3) for
            every grasp of the batch; k is 2 on a crease and more at a corner.
        contacts: The contacts.

    Returns:
        Corners of convex sets, in order around each; where they are fewer than k the last repeats.

    Raises:
        ContactError: A contact that does not exist, shapes that do not fit, normals without a
            direction or not within a hemisphere.
    """
    if not isinstance(creases, Mapping):
        raise ContactError(
            "creases must map numbers of contacts to normals, as {0: [[1, 0, 0], [0, 1, 0]]}; "
            f"got {type(creases).__name__}"
        )
    return {i: _checked(i, given, contacts) for i, given in creases.items()}


def _checked(contact: int, given: npt.ArrayLike, contacts: Contacts) -> Floats:
    if contact not in range(contacts.count):
        raise ContactError(
            f"creases name contact {contact}, but a grasp has contacts 0 to {contacts.count - 1}"
        )
    try:
        normals = np.asarray(given, dtype=np.float64)
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
            f"got {np.shape(given)}"
        )
    lengths = np.linalg.norm(normals, axis=2)
    if not (np.isfinite(normals).all() and (lengths > 0.0).all()):
        raise ContactError(f"contact {contact}: a normal at the crease has no direction")
    size, most = normals.shape[:2]
    rows = unit_rows(normals).reshape(-1, 3)
    counts = np.zeros(size, dtype=np.int64)
    start = np.arange(size + 1) * most
    order_normal_sets(start, rows, counts, np.zeros((size, 3)), np.zeros(size))
    if (counts == 0).any():
        raise ContactError(
            f"contact {contact}: the crease's normals do not lie within a hemisphere"
        )
    last = np.minimum(np.arange(most), counts[:, None] - 1)  # (b, k)
    return np.take_along_axis(rows.reshape(normals.shape), last[..., None], axis=1)


def angles_to_set(normals: Floats, directions: Floats) -> tuple[Floats, Floats]:
    """(smallest, largest) angle between directions (b, 3) and convex sets (b, k, 3) [rad]."""
    found = np.empty((2, len(normals)))
    counts = (normals == normals[:, -1:]).all(axis=2).argmax(axis=1) + 1  # the last may repeat
    for g, (rows, count, direction) in enumerate(zip(normals, counts, directions, strict=True)):
        found[0, g] = smallest_angle(rows, 0, count, *direction)
        found[1, g] = largest_angle(rows, 0, count, *direction)
    return found[0], found[1]


def sampled_set(normals: Floats, step: float = STEP) -> Floats:
    """Normals all over convex sets (b, k, 3), so dense that caps of step / 2 hold them in groups.

    Any normal of a set is then a combination, with weights of sum at most 1 / cos(step / 2), of
    samples in one such cap: what holds at all samples, with cones that much narrower or wider,
    holds everywhere.

    Args:
        normals: Corners of the sets, in order around each.
        step: Width of the caps [rad], below pi.

    Returns:
        Shape (b, m, 3).
    """
    corners = normals.shape[1]
    if corners == 2:
        widest = float(angles_between(normals[:, 0], normals[:, 1]).max(initial=0.0))
        shares = np.linspace(0.0, 1.0, max(1, math.ceil(widest / step)) + 1)
        return on_arcs(normals[:, 0], normals[:, 1], shares)
    middle = unit_rows(normals.sum(axis=1))
    triangles = [
        np.stack([middle, normals[:, i], normals[:, (i + 1) % corners]], axis=1)
        for i in range(corners)
    ]
    rows = _weights(max(_steps(triangle, step) for triangle in triangles))
    own = rows[rows[:, 1] > 0.0]  # the side without its corner i is also the next one's
    found = [_at(triangle, own) for triangle in triangles]
    return np.concatenate([middle[:, None], *found], axis=1)


def sampled_sets(start: Ints, normals: Floats, step: float) -> tuple[list[Floats], Floats]:
    """Sample many convex sets of normals, each with corners of its own number.

    Args:
        start: First row of each set in `normals`, shape (b + 1,).
        normals: Corners of the sets, in order around each; one where it is a single normal.
        step: As in `sampled_set`.

    Returns:
        The samples of each set, (m, 3), and the step that would have given so many: the cap that
        holds them in groups is half as wide, shape (b,); 0 for a single normal.
    """
    first, corners = start[:-1], np.diff(start)
    apart = np.zeros(len(first))
    found = [normals[k : k + 1] for k in first]
    arcs = np.flatnonzero(corners == 2)
    one, two = normals[first[arcs]], normals[first[arcs] + 1]
    widths = angles_between(one, two)
    parts = np.where(widths > ONE_NORMAL, np.ceil(widths / step), 0.0).astype(np.int64)
    for part in np.unique(parts[parts > 0]):
        some = np.flatnonzero(parts == part)
        apart[arcs[some]] = widths[some] / part
        along = on_arcs(one[some], two[some], np.linspace(0.0, 1.0, part + 1))
        for number, samples in zip(arcs[some], along, strict=True):
            found[number] = samples
    for number in np.flatnonzero(corners > 2):
        corner = normals[None, start[number] : start[number + 1]]
        found[number], apart[number] = sampled_set(corner, step)[0], step
    return found, apart


def _steps(triangle: Floats, step: float) -> int:
    """Parts of the sides of triangles (b, 3, 3) that make every small one fit its cap."""
    # Jung's theorem on the sphere: sides so long make a circle about them no wider than the cap.
    longest = 2.0 * math.asin(math.sqrt(3.0) / 2.0 * math.sin(step / 2.0))
    sides = angles_between(triangle, np.roll(triangle, 1, axis=1))
    steps = max(1, math.ceil(float(sides.max(initial=0.0)) / longest))
    while (widest := _widest(triangle, steps)) > longest:
        steps = max(steps + 1, math.floor(steps * widest / longest))
    return steps


def _widest(triangle: Floats, steps: int) -> float:
    """Largest angle between neighbours on the grids of triangles (b, 3, 3)."""
    rows = _weights(steps)
    found = 0.0
    for i in range(3):
        shift = (np.eye(3)[i] - np.eye(3)[i - 1]) / steps
        near = rows[rows[:, i - 1] > 0.5 / steps]
        gaps = angles_between(_at(triangle, near), _at(triangle, near + shift))
        found = max(found, float(gaps.max(initial=0.0)))
    return found


def _weights(steps: int) -> Floats:
    """Shares of three corners at the places of an even grid, shape (m, 3)."""
    one, two = np.indices((steps + 1, steps + 1)).reshape(2, -1)
    rows = np.stack([one, two, steps - one - two], axis=1)
    return rows[rows[:, 2] >= 0] / steps


def _at(corners: Floats, shares: Floats) -> Floats:
    return unit_rows(np.einsum("mk,bkc->bmc", shares, corners))
