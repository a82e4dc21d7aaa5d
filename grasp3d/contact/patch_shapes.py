"""Patches of contacts: ellipses in the tangent plane, and the torsion that even pressure resists.

A fingertip touches an object on a patch. An ellipse stands for it, by its two semi-axes as vectors
in the tangent plane of the contact, shape (2, 3).
"""

import math

import numpy as np
from scipy.special import ellipe

from grasp3d.arrays import ArrayLike, Floats
from grasp3d.contact.friction_cones import tangents
from grasp3d.errors import ContactError


def disc(normals: ArrayLike, radius: ArrayLike) -> Floats:
    """Semi-axes of round patches, as `Contacts` takes them.

    Args:
        normals: Normals of the contacts, shape (..., 3).
        radius: [mesh unit], at least 0: one value, or shape (...).

    Returns:
        Shape (..., 2, 3).

    Raises:
        ContactError: A radius below 0 or that is not finite.

    Example:
        >>> import grasp3d
        >>> from grasp3d.contact import disc
        >>> points, normals = [[-1, 0, 0], [1, 0, 0]], [[1, 0, 0], [-1, 0, 0]]
        >>> contacts = grasp3d.Contacts(points, normals, patch=disc(normals, 0.2))
        >>> contacts.patch.shape
        (2, 2, 3)
    """
    n, r = np.asarray(normals, dtype=np.float64), np.asarray(radius, dtype=np.float64)
    if not ((r >= 0.0) & np.isfinite(r)).all():
        raise ContactError(f"the radius of a patch must be finite and at least 0; got {r}")
    lengths = np.linalg.norm(n, axis=-1, keepdims=True)
    axes = np.stack(tangents(n / np.where(lengths > 0.0, lengths, 1.0)), axis=-2)
    return np.asarray(axes * r[..., None, None])


def in_tangent_plane(axes: Floats, normals: Floats) -> Floats:
    """Vectors (..., 2, 3) without their components along unit normals (..., 3)."""
    # Twice: one subtraction leaves rounding errors of vectors nearly along the normal.
    for _ in range(2):
        along = (axes * normals[..., None, :]).sum(axis=-1, keepdims=True)
        axes = axes - along * normals[..., None, :]
    return axes


def evenly_pressed_radius(half_extents: Floats, area: Floats) -> Floats:
    """Mean distance of a patch's points from its centre: the torsion radius per friction.

    An evenly pressed patch resists, about the normal through its centre, friction times normal
    force times that distance. On an ellipse with semi-axes a and b it is its perimeter / (3 pi), on
    a disc 2/3 r. The patch is taken as the ellipse that has its area and the proportions of its
    extents: exact for ellipses, 2 to 4 % too little for rectangles, and never less than for a disc
    of that area, of all shapes the one that resists least.

    Args:
        half_extents: Half of the patch's extents along two orthogonal directions, at least 0, shape
            (..., 2).
        area: Shape (...).

    Returns:
        Lengths, shape (...); 0 where the area or both extents are.

    Example:
        A square with sides of 2: on average its points are 0.765 from the centre.

        >>> import numpy as np
        >>> from grasp3d.contact.patch_shapes import evenly_pressed_radius
        >>> print(f"{evenly_pressed_radius(np.ones(2), np.array(4.0)):.3f}")
        0.752
    """
    long, short = half_extents.max(axis=-1), half_extents.min(axis=-1)
    enclosed = math.pi * long * short
    # A patch that is thinner than rounding is a line of length 2 a: on average a/2 from its middle.
    thin = enclosed <= 1e-12 * long * long
    safe = np.where(long > 0.0, long, 1.0)
    perimeter = 4.0 * long * ellipe(1.0 - (short / safe) ** 2)
    with np.errstate(divide="ignore", invalid="ignore"):
        scaled = np.sqrt(area / enclosed) * perimeter / (3.0 * math.pi)
    return np.asarray(np.where(area > 0.0, np.where(thin, 0.5 * long, scaled), 0.0))[()]
