"""Sets of normals of contacts on creases and corners: all between those of the faces there."""

import math
from collections.abc import Mapping

import numpy as np

from grasp3d._kernels.surface.normal_angles import largest_angle, smallest_angle
from grasp3d._kernels.surface.normal_sets import order_normal_sets
from grasp3d.arrays import ArrayLike, Floats, Ints, angles_between, unit_rows
from grasp3d.contact.contacts import Contacts
from grasp3d.contact.friction_cones import on_arcs
from grasp3d.errors import ContactError

STEP = math.radians(5.0)
"""Width of the caps that contain groups of sampled normals [rad]; see `sampled_set`."""

MIN_WIDTH = 1e-9
"""Width of a set below which it is sampled by a single normal [rad]."""

Creases = dict[int, Floats]
"""For contacts on creases, by number, the unit normals of the faces that meet there, (b, k, 3)."""


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
    return {i: _checked(i, given, contacts) for i, given in creases.items()}


def _checked(contact: int, given: ArrayLike, contacts: Contacts) -> Floats:
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


def angles_to_set(normals: Floats, directions: Floats) -> tuple[Floats, Floats]:
    """(smallest, largest) angle between directions (b, 3) and convex sets (b, k, 3) [rad]."""
    found = np.empty((2, len(normals)))
    counts = (normals == normals[:, -1:]).all(axis=2).argmax(axis=1) + 1  # the last may be repeated
    for g, (rows, count, direction) in enumerate(zip(normals, counts, directions, strict=True)):
        found[0, g] = smallest_angle(rows, 0, count, *direction)
        found[1, g] = largest_angle(rows, 0, count, *direction)
    return found[0], found[1]


def sampled_set(normals: Floats, step: float = STEP) -> Floats:
    """Samples of convex sets of normals (b, k, 3), in groups that caps of width `step` contain.

    Any normal of a set is then a combination, with weights of sum at most 1 / cos(step / 2), of
    samples in one such cap: what holds at all samples, with cones narrower or wider by that factor,
    holds for all normals of the set.

    Args:
        normals: Corners of the sets, in order around each.
        step: Width of the caps [rad], below pi.

    Returns:
        Shape (b, m, 3).
    """
    corners = normals.shape[1]
    if corners == 2:
        widest = float(angles_between(normals[:, 0], normals[:, 1]).max(initial=0.0))
        fractions = np.linspace(0.0, 1.0, max(1, math.ceil(widest / step)) + 1)
        return on_arcs(normals[:, 0], normals[:, 1], fractions)
    middle = unit_rows(normals.sum(axis=1))
    triangles = [
        np.stack([middle, normals[:, i], normals[:, (i + 1) % corners]], axis=1)
        for i in range(corners)
    ]
    weights = _grid_weights(max(_grid_steps(triangle, step) for triangle in triangles))
    own = weights[weights[:, 1] > 0.0]  # the side opposite to corner i belongs to the next triangle
    samples = [_at(triangle, own) for triangle in triangles]
    return np.concatenate([middle[:, None], *samples], axis=1)


def sampled_sets(start: Ints, normals: Floats, step: float) -> tuple[list[Floats], Floats]:
    """Sample many convex sets of normals with different numbers of corners.

    Args:
        start: First row of each set in `normals`, shape (b + 1,).
        normals: Corners of the sets, in order around each; one where it is a single normal.
        step: As in `sampled_set`.

    Returns:
        The samples of each set, (m, 3), and the widths of the caps that contain groups of them,
        at most `step`, shape (b,); 0 for a single normal.
    """
    first, corners = start[:-1], np.diff(start)
    steps = np.zeros(len(first))
    samples = [normals[k : k + 1] for k in first]
    arcs = np.flatnonzero(corners == 2)
    begin, end = normals[first[arcs]], normals[first[arcs] + 1]
    widths = angles_between(begin, end)
    divisions = np.where(widths > MIN_WIDTH, np.ceil(widths / step), 0.0).astype(np.int64)
    for division in np.unique(divisions[divisions > 0]):
        chosen = np.flatnonzero(divisions == division)
        steps[arcs[chosen]] = widths[chosen] / division
        fractions = np.linspace(0.0, 1.0, division + 1)
        on_chosen = on_arcs(begin[chosen], end[chosen], fractions)
        for k, rows in zip(arcs[chosen], on_chosen, strict=True):
            samples[k] = rows
    for k in np.flatnonzero(corners > 2):
        samples[k] = sampled_set(normals[None, start[k] : start[k + 1]], step)[0]
        steps[k] = step
    return samples, steps


def _grid_steps(triangle: Floats, step: float) -> int:
    """Divisions of the sides of triangles (b, 3, 3) so that each grid triangle fits into a cap."""
    # Jung's theorem on the sphere: triangles with shorter sides fit into a cap of that width.
    longest = 2.0 * math.asin(math.sqrt(3.0) / 2.0 * math.sin(step / 2.0))
    sides = angles_between(triangle, np.roll(triangle, 1, axis=1))
    steps = max(1, math.ceil(float(sides.max(initial=0.0)) / longest))
    while (widest := _longest_grid_side(triangle, steps)) > longest:
        steps = max(steps + 1, math.floor(steps * widest / longest))
    return steps


def _longest_grid_side(triangle: Floats, steps: int) -> float:
    """Largest angle between neighbours on the grids of triangles (b, 3, 3)."""
    weights = _grid_weights(steps)
    largest = 0.0
    for i in range(3):
        shift = (np.eye(3)[i] - np.eye(3)[i - 1]) / steps
        ends = weights[weights[:, i - 1] > 0.5 / steps]
        sides = angles_between(_at(triangle, ends), _at(triangle, ends + shift))
        largest = max(largest, float(sides.max(initial=0.0)))
    return largest


def _grid_weights(steps: int) -> Floats:
    """Weights of three corners at the points of an even grid, shape (m, 3)."""
    first, second = np.indices((steps + 1, steps + 1)).reshape(2, -1)
    rows = np.stack([first, second, steps - first - second], axis=1)
    return rows[rows[:, 2] >= 0] / steps


def _at(corners: Floats, weights: Floats) -> Floats:
    return unit_rows(np.einsum("mk,bkc->bmc", weights, corners))
