"""Bodies as Manifold solids, their faces offset outward or inward."""

from dataclasses import dataclass
from functools import cached_property

import manifold3d
import numpy as np

from grasp3d.arrays import Floats, Ints
from grasp3d.mesh.measures import corner_angles, inward_normals

FARTHEST = 4.0
"""Largest displacement of a corner, in units of the offset of its faces."""


@dataclass(frozen=True, eq=False)
class Solid:
    """A closed body, with its cavities or without, its faces offset."""

    corners: Ints
    """Its vertices, shape (n,)."""
    points: Floats
    """Their displaced positions, shape (n, 3)."""
    faces: Ints
    """Rows of `corners`, shape (m, 3)."""

    @cached_property
    def manifold(self) -> manifold3d.Manifold:
        """The solid as an object of Manifold."""
        return manifold3d.Manifold(manifold3d.Mesh64(self.points, self.faces.astype(np.uint64)))


def marked(solids: list[Solid]) -> tuple[manifold3d.Manifold, Ints]:
    """Combine solids into one Manifold object without uniting them, even if they overlap.

    Returns:
        The object, and the identifier that Manifold keeps on the faces of each solid, shape (k,).
    """
    first = manifold3d.Manifold.reserve_ids(len(solids))
    marks = np.arange(first, first + len(solids))
    starts = np.cumsum([0, *(len(solid.points) for solid in solids)]).tolist()
    faces = [solid.faces + start for solid, start in zip(solids, starts, strict=False)]
    mesh = manifold3d.Mesh64(
        np.concatenate([solid.points for solid in solids]),
        np.concatenate(faces).astype(np.uint64),
        run_index=np.cumsum([0, *(own.size for own in faces)]).astype(np.uint64),
        run_original_id=marks.astype(np.uint32),
    )
    return manifold3d.Manifold(mesh), marks


def solids_of(points: Floats, faces: Ints, solid: Ints, distance: float) -> list[Solid]:
    """Offset the faces of many bodies at once.

    Args:
        points: Positions (V, 3).
        faces: Faces (F, 3).
        solid: Solid that each face belongs to, counted from 0, none without a face, shape (F,).
        distance: Outward offset of the faces; negative if inward.
    """
    order = np.argsort(solid, kind="stable")
    faces, solid = faces[order], solid[order]
    keys, inverse = np.unique(solid[:, None] * len(points) + faces, return_inverse=True)
    of_corner, corners = np.divmod(keys, len(points))
    local = inverse.reshape(-1, 3).astype(np.int64)
    displaced = points[corners] + distance * _unit_shifts(points[corners], local)
    starts = np.searchsorted(of_corner, np.arange(int(solid[-1]) + 2)).tolist()
    ends = np.cumsum(np.bincount(solid))[:-1]
    return [
        Solid(corners[start:end], displaced[start:end], own - start)
        for start, end, own in zip(starts, starts[1:], np.split(local, ends), strict=False)
    ]


def _unit_shifts(points: Floats, faces: Ints) -> Floats:
    """Least-squares displacements (V, 3) of the vertices that move all faces outward by 1."""
    outward = -inward_normals(points, faces)
    weights = corner_angles(points, faces)
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
