"""Sets of normals: a contact on a crease or corner may have any between those of the faces."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np

from grasp3d._kernels.surface.surface_contacts import order_normal_sets
from grasp3d.arrays import RIGHT_ANGLE, ArrayLike, Floats, Ints, angles_between, unit_rows
from grasp3d.contact.contacts import Contacts
from grasp3d.errors import ContactError

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
        """The normals of a flat batch of contacts, of which some are on creases."""
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
