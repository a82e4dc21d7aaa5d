"""The bodies of a surface: which faces bound one, their orientation, cavities, flat bodies.

Those that are closed become solids of the library Manifold, their faces offset.
"""

from dataclasses import dataclass

import manifold3d
import numpy as np
from scipy.optimize import linear_sum_assignment

from grasp3d.arrays import Bools, Floats, Ints, unit_rows
from grasp3d.mesh.measures import (
    Triangles,
    connected,
    crowded_edges,
    face_areas,
    paired_edges,
    part_volumes,
)
from grasp3d.mesh.repair.cleaning import ends_of
from grasp3d.mesh.repair.holes import holes_of

CLEAR = 1e-3
"""Volume, in units of the area to the power 3/2, from which an open body has an orientation: 0.002
for a thin bowl, 0.0001 for a flat sheet that is rough."""

NO_VOLUME = 1e-10
"""Volume below which a closed body is flat, in units of its area to the power 3/2."""

APART = 10.0
"""Cost of pairing faces of different sheets at an edge: more than any root of an angle."""

BACK_TO_BACK = 1e-3
"""Angle of a wedge of material [rad] below which its two faces are taken as back to back."""


FARTHEST = 4.0
"""Largest displacement of a corner, in units of the offset of its faces."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed body, with its cavities or without, its faces offset."""

    corners: Ints
    """Its vertices, shape (n,)."""
    points: Floats
    """Their displaced positions, shape (n, 3)."""
    mark: int
    """Identifier that Manifold keeps on its faces; later solids have larger ones."""
    manifold: manifold3d.Manifold

    @classmethod
    def of(cls, points: Floats, faces: Ints, distance: float) -> "Solid":
        """Offset the faces of a body.

        Args:
            points: Positions (V, 3).
            faces: Faces (F, 3), counter-clockwise from outside.
            distance: Outward offset of the faces; negative if inward.
        """
        corners, rows = np.unique(faces, return_inverse=True)
        own, rows = points[corners], rows.reshape(-1, 3)
        own += distance * _unit_shifts(own, rows)
        mark = manifold3d.Manifold.reserve_ids(1)
        mesh = manifold3d.Mesh64(
            own,
            rows.astype(np.uint64),
            run_index=np.array([0, rows.size], dtype=np.uint64),
            run_original_id=np.array([mark], dtype=np.uint32),
        )
        return cls(corners, own, mark, manifold3d.Manifold(mesh))


def _unit_shifts(points: Floats, faces: Ints) -> Floats:
    """Least-squares displacements (V, 3) of the vertices that move all faces outward by 1."""
    surface = Triangles(points, faces)
    outward, weights = -surface.normals, surface.angles
    pull = np.zeros_like(points)
    spread = np.zeros((len(points), 3, 3))
    squares = outward[:, :, None] * outward[:, None, :]
    for k in range(3):
        np.add.at(pull, faces[:, k], weights[:, k, None] * outward)
        np.add.at(spread, faces[:, k], weights[:, k, None, None] * squares)
    inverse = np.linalg.pinv(spread, rcond=1e-3, hermitian=True)
    shift = np.einsum("vij,vj->vi", inverse, pull)
    length = np.linalg.norm(shift, axis=1, keepdims=True)
    return np.asarray(shift / np.maximum(length / FARTHEST, 1.0))


def rows_of(number: Ints) -> list[Ints]:
    """Rows of each number that occurs, in ascending order of the numbers."""
    order = np.argsort(number, kind="stable")
    return np.split(order, np.flatnonzero(np.diff(number[order])) + 1)


def bodies_of(points: Floats, faces: Ints, rounding: float) -> tuple[Ints, Floats, Ints]:
    """Divide a surface into bodies, each bounded by faces that are neighbours across edges.

    A vertex or an edge where a surface touches itself is divided too.

    Args:
        points: Positions (V, 3) of a surface of size about 1.
        faces: Faces (F, 3), neighbours wound alike.
        rounding: Largest error of a coordinate.

    Returns:
        Body of each face, shape (F,). Volume of each body, negative if wound inward, 0 if it is
        flat (a sheet with two sides), nan if it is open, shape (B,). The faces over vertices that
        only neighbours share, counted from 0, shape (F, 3).
    """
    one, two = _neighbours(points, faces)
    body = connected(len(faces), one // 3, two // 3)
    starts, ends = ends_of(np.arange(faces.size).reshape(-1, 3), np.stack([one, two]))
    divided = connected(faces.size, starts, ends[::-1])
    areas = np.bincount(body, face_areas(points, faces))
    volumes = part_volumes(points, faces, body)
    flat = np.abs(volumes) <= np.maximum(NO_VOLUME * areas**1.5, 2.0 * rounding * areas)
    closed = 2 * np.bincount(body[one // 3], minlength=len(areas)) == 3 * np.bincount(body)
    return body, np.where(closed, np.where(flat, 0.0, volumes), np.nan), divided.reshape(-1, 3)


def _neighbours(points: Floats, faces: Ints) -> tuple[Ints, Ints]:
    """Pairs of half-edges that run along one edge in opposite directions, each in one pair.

    Where more than two faces meet, those pairs are neighbours that are connected elsewhere, and
    then those with the thinnest wedges of material between them: bodies that touch are divided
    there, and the two sides of a wall between them become a flat body.
    """
    half_edges = np.stack(paired_edges(faces))
    start, end = ends_of(faces, half_edges)
    half_edges = half_edges[:, start[0] == end[1]]
    sheet = connected(len(faces), *half_edges // 3)
    crowded = crowded_edges(faces)
    start, end = ends_of(faces, crowded)
    low, high = np.minimum(start, end), np.maximum(start, end)
    first = np.flatnonzero((np.diff(low, prepend=-1) != 0) | (np.diff(high, prepend=-1) != 0))
    along = unit_rows(points[high] - points[low])
    tips = points[faces.ravel()[crowded]] - points[low]
    size = np.diff(np.append(first, len(crowded)))
    across = unit_rows(np.cross(along, np.repeat(tips[first], size, axis=0)))
    up, right = (np.einsum("ij,ij->i", axis, tips) for axis in (across, np.cross(across, along)))
    angle, own = np.arctan2(up, right), sheet[crowded // 3]
    pairs = [half_edges]
    for rows in np.split(np.arange(len(crowded)), first[1:]):
        forward = start[rows] == low[rows]
        ahead, back = rows[forward][:, None], rows[~forward]
        wedge = (angle[ahead] - angle[back]) % (2.0 * np.pi)
        wedge[wedge > 2.0 * np.pi - BACK_TO_BACK] = 0.0
        one, two = linear_sum_assignment(np.sqrt(wedge) + APART * (own[ahead] != own[back]))
        pairs.append(crowded[np.stack([ahead[one, 0], back[two]])])
    one, two = np.concatenate(pairs, axis=1)
    return one, two


def orient(
    points: Floats, faces: Ints, vertex: Ints, body: Ints, volumes: Floats, touch: float
) -> tuple[Bools, Ints]:
    """Find the bodies that are inside out, and the cavities of the others.

    Args:
        points: Positions (V, 3).
        faces: Faces (F, 3), divided as in `bodies_of`.
        vertex: The same for all vertices that were one before, shape (V,).
        body: Body of each face, shape (F,).
        volumes: Their volumes, shape (B,).
        touch: Distance within which bodies touch.

    Returns:
        The bodies to flip, shape (B,). The body that each body is part of, shape (B,): itself; for
        a cavity, wound inward, the smallest body around it; -1 if it is open or flat.
    """
    turns = np.where(volumes < 0.0, -1, 1).tolist()
    own = [faces[rows][:, ::turn] for rows, turn in zip(rows_of(body), turns, strict=True)]
    flip = np.zeros(len(own), dtype=bool)
    for number in np.flatnonzero(np.isnan(volumes)).tolist():
        flip[number] = _is_inward(points, own[number])
    if np.nansum(volumes) < 0.0:  # the whole object with its cavities
        flip |= ~np.isnan(volumes)
    signs = np.sign(np.where(flip, -volumes, volumes))
    owner = np.where(np.abs(signs) > 0.0, np.arange(len(flip)), -1)
    outward = np.flatnonzero(signs > 0.0)
    outward = outward[np.argsort(np.abs(volumes[outward]))]
    low = np.array([points[each].min(axis=(0, 1)) for each in own])
    high = np.array([points[each].max(axis=(0, 1)) for each in own])
    around: dict[tuple[int, float], Solid] = {}
    for number in np.flatnonzero(signs < 0.0).tolist():
        larger = (low[outward] <= low[number]) & (high[number] <= high[outward])
        for outer in outward[larger.all(axis=1)].tolist():
            shares = np.isin(vertex[own[number]], vertex[own[outer]]).any()
            gap = -touch if shares else touch  # a cavity touches only a wall that it is part of
            if (outer, gap) not in around:
                around[outer, gap] = Solid.of(points, own[outer], -gap)
            rest = Solid.of(points, own[number], gap).manifold - around[outer, gap].manifold
            if rest.status() == manifold3d.Error.NoError and rest.is_empty():
                owner[number] = outer
                break
        else:
            flip[number] ^= True
    return flip, owner


def _is_inward(points: Floats, faces: Ints) -> bool:
    """Return whether an open body is clearly inside out: closed by fans over its holes."""
    rings = [points[hole] for hole in holes_of(faces)]
    fans = [np.stack([r, np.roll(r, -1, axis=0), 0.0 * r + r.mean(axis=0)], axis=1) for r in rings]
    corners = np.concatenate([points[faces], *fans])
    a, b, c = np.moveaxis(corners - corners[0, 0], 1, 0)
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0
    return bool(volume < -CLEAR * face_areas(points, faces).sum() ** 1.5)
