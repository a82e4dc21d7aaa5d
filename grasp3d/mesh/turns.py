"""Effect of location errors on contacts on a surface: how far the normals turn nearby."""

import math

import numpy as np

from grasp3d._kernels.surface.nearby_normals import largest_turns
from grasp3d._kernels.surface.surface_contacts import ContactNormals, Surface, Turns
from grasp3d.arrays import Floats, Ints, locked, unit_rows
from grasp3d.mesh.object_mesh import ObjectMesh
from grasp3d.mesh.surface_points import nearest_surface_points
from grasp3d.system.context import in_threads

CHUNK = 512
"""Contacts that a thread evaluates at once."""

SPACING = 0.4
"""Distance between the points of a face where a search knows the turn, in location errors."""

EVEN = 0.03
"""Difference of the turns at a small face's corners up to which the corners suffice [rad]."""

MOST_PLACES = 200_000
"""Approximate largest number of these points; on a large surface they are farther apart."""

MOST_PARTS = 64
"""Largest number of parts of a face's edge."""

ROUNDED = 1e6
"""Factor before rounding: points and normals that agree to six digits count as the same."""


def normal_turns(
    mesh: ObjectMesh,
    points: Floats,
    faces: Ints,
    sets: ContactNormals,
    location_error: float,
    *,
    enough: float = math.inf,
) -> Floats:
    """Largest angle by which the surface turns within the location error of each contact [rad].

    The largest of the smallest angles between the contact's set of normals and the normals of the
    surface that is connected with the contact within the location error. 0 where the contact may
    have any normal.

    Args:
        mesh: The surface.
        points: Contacts in the mesh's frame, shape (m, 3).
        faces: A face that each contact lies on, shape (m,); -1: none, and the angle is 0.
        sets: Normals of the contacts, a set for each.
        location_error: Largest distance between true and perceived contacts [m].
        enough: Angle from which on a result need not be the largest angle [rad].

    Returns:
        Shape (m,); never too small. At most 0.001 rad above the angle for a location error larger
        by 0.1 %, unless the angle is obtuse, or the contact is on a crease, where the normals of a
        face are not distinguished.
    """
    turns = np.zeros(len(points))
    # Copies: the kernel would be compiled again for arrays that cannot be written.
    places, first = np.array((points - mesh.center) / mesh.size), np.array(sets.start[:-1])
    own, faces, normals = np.array(sets.counts), np.array(faces), locked(sets.normals)
    radius = location_error / mesh.size

    def work(rows: slice, _: object) -> None:
        largest_turns(
            places[rows], faces[rows], first[rows], own[rows], normals, radius, enough,
            mesh.contact_surface, mesh.contact_normals, mesh.faces_around, turns[rows],
        )  # fmt: skip

    in_threads(work, len(points), CHUNK)
    return turns


def turns_beside(
    mesh: ObjectMesh, points: Floats, normals: Floats, location_error: float
) -> Floats:
    """`normal_turns` of contacts that may be off the surface, at their nearest surface points.

    Args:
        mesh: The surface.
        points: Positions in the mesh's frame, shape (m, 3).
        normals: The normal of each, shape (m, 3).
        location_error: As in `normal_turns`.
    """
    nearest, places, _ = nearest_surface_points(mesh, points)
    return normal_turns(mesh, places, nearest.faces, _single(normals), location_error)


def located_surface(mesh: ObjectMesh, location_error: float, cone: float) -> Surface:
    """The `contact_surface` with the turns of its contacts, as searches take it.

    Args:
        mesh: The surface.
        location_error: Largest distance between true and perceived contacts [m]; 0: locations are
            exact, and nothing is computed.
        cone: Largest critical angle that is searched for [rad]; larger turns are known roughly.
    """
    surface = mesh.contact_surface
    if location_error == 0.0:
        return surface
    corners = mesh.vertices[surface.faces]
    lengths = np.linalg.norm(corners - np.roll(corners, 1, axis=1), axis=2).max(axis=1)
    spacing = max(SPACING * location_error, math.sqrt(mesh.area / MOST_PLACES))
    levels = np.ones(len(lengths), dtype=np.int64)
    at_corners = _on_lattice(mesh, levels, location_error, cone).reshape(-1, 3)
    least = at_corners.min(axis=1)
    uneven = (least < cone) & (at_corners.max(axis=1) - least > EVEN)
    uneven |= lengths > location_error
    levels[uneven] = np.clip(np.ceil(lengths[uneven] / spacing), 1, MOST_PARTS)
    values = _on_lattice(mesh, levels, location_error, cone)
    start = np.cumsum(_sizes(levels)) - _sizes(levels)
    own = np.full(len(mesh.vertices), -1)
    own[mesh.faces] = np.arange(len(mesh.faces))[:, None]
    sets = mesh.contact_normals
    at_vertices = normal_turns(mesh, mesh.vertices, own, sets, location_error, enough=cone)
    turns = Turns(
        error=2.0 * location_error / mesh.size,
        vertices=locked(at_vertices),
        levels=locked(levels),
        start=locked(start),
        values=locked(values),
        least=locked(np.minimum.reduceat(values, start)),
    )
    return surface._replace(turns=turns)


def _sizes(levels: Ints) -> Ints:
    """Number of lattice points on faces whose edges have these numbers of parts."""
    return (levels + 1) * (levels + 2) // 2


def _on_lattice(mesh: ObjectMesh, levels: Ints, location_error: float, cone: float) -> Floats:
    """Turns at the points of each face's lattice, one face after the other, shape (K,)."""
    surface, sizes = mesh.contact_surface, _sizes(levels)
    faces, start = np.repeat(np.arange(len(levels)), sizes), np.cumsum(sizes) - sizes
    weights = np.empty((len(faces), 3))
    for parts in set(levels.tolist()):
        lattice = _lattice(parts)
        rows = start[levels == parts][:, None] + np.arange(len(lattice))
        weights[rows] = lattice
    places = (weights[:, None] @ mesh.normalized[surface.faces[faces]])[:, 0]
    normals = unit_rows((weights[:, None] @ surface.normals[surface.corners[faces]])[:, 0])
    # Points on smooth edges belong to several faces.
    digits = np.rint(np.concatenate([places, normals], axis=1) * ROUNDED).astype(np.int64)
    keys = digits @ np.random.default_rng(0).integers(1 << 62, size=6)
    _, first, same = np.unique(keys, return_index=True, return_inverse=True)
    points, sets = mesh.from_normalized(places[first]), _single(normals[first])
    return normal_turns(mesh, points, faces[first], sets, location_error, enough=cone)[same]


def _single(normals: Floats) -> ContactNormals:
    """Sets of one normal each, shape (m, 3)."""
    start = np.arange(len(normals) + 1)
    return ContactNormals(start, np.ones_like(start[1:]), normals)


def _lattice(parts: int) -> Floats:
    """Barycentric coordinates of the points of a face's lattice, shape (k, 3); see `Turns`."""
    j, i = np.nonzero(np.add.outer(np.arange(parts + 1), np.arange(parts + 1)) <= parts)
    return np.stack([parts - i - j, i, j], axis=1) / parts
