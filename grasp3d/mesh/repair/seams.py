"""Repair of seams: loose vertices become corners, and faces without an area are removed."""

from itertools import chain

import numpy as np
from scipy.spatial import cKDTree

from grasp3d.arrays import Floats, Ints, unit_rows
from grasp3d.mesh.measures import has_area, paired_edges
from grasp3d.mesh.repair.cleaning import first_alike, from_least_corner, is_face
from grasp3d.mesh.work_bounds import NEAR_FACES, POINTS_ON_FACES

MOST_FLIPS = 100
"""Most rounds in which faces without an area are removed."""


def put_on_surface(points: Floats, faces: Ints, loose: Ints, distance: float) -> Ints:
    """Divide the faces on which loose vertices lie, so that the vertices become corners.

    Args:
        points: Positions (V, 3).
        faces: Faces (F, 3).
        loose: Vertices that no face uses, shape (k,), none within the distance of a corner.
        distance: Largest distance of a vertex from the face that it lies on.

    Returns:
        The faces, the divided ones replaced. Vertices that lie on no face change nothing.
    """
    if len(loose) == 0 or len(faces) == 0:
        return faces
    corners = points[faces]
    middles = corners.mean(axis=1)
    radii = np.linalg.norm(corners - middles[:, None], axis=2).max(axis=1)
    tree, reach = cKDTree(points[loose]), radii + distance
    counts = tree.query_ball_point(middles, reach, return_length=True)
    NEAR_FACES.check(int(counts.sum()))
    near = tree.query_ball_point(middles, reach, return_sorted=True)
    face = np.repeat(np.arange(len(faces)), counts)
    vertex = loose[np.fromiter(chain.from_iterable(near), np.int64, int(counts.sum()))]
    across = unit_rows(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    off = np.einsum("ij,ij->i", points[vertex] - corners[face, 0], across[face])
    on = np.abs(off) <= distance
    POINTS_ON_FACES.check(int((np.bincount(face[on], minlength=1) ** 2).sum()))
    pieces: dict[int, list[tuple[int, ...]]] = {}
    for number, point in zip(face[on].tolist(), vertex[on].tolist(), strict=True):
        own = pieces.setdefault(number, [tuple(faces[number].tolist())])
        pieces[number] = _divided(points, own, point, across[number], distance)
    whole = np.ones(len(faces), dtype=bool)
    whole[list(pieces)] = False
    added = np.array(list(chain.from_iterable(pieces.values())), dtype=np.int64).reshape(-1, 3)
    return np.concatenate([faces[whole], added])


def _divided(
    points: Floats,
    pieces: list[tuple[int, ...]],
    point: int,
    across: Floats,
    distance: float,
) -> list[tuple[int, ...]]:
    """Divide the pieces of a face that a point lies in, or on an edge of."""
    result: list[tuple[int, ...]] = []
    for piece in pieces:
        edges = [(piece[k], piece[(k + 1) % 3]) for k in range(3)]
        away = [edge for edge in edges if not _lies_on(points, point, edge, distance)]
        inside = all(
            np.dot(np.cross(points[end] - points[start], points[point] - points[start]), across) > 0
            for start, end in edges
        )
        if inside or len(away) < len(edges):
            result += [(start, end, point) for start, end in away]
        else:
            result.append(piece)
    return result


def _lies_on(points: Floats, point: int, ends: tuple[int, ...], distance: float) -> bool:
    """Return whether a point lies on an edge, identically for the faces on its two sides."""
    start, end = points[min(ends)], points[max(ends)]
    along, to = end - start, points[point] - start
    fraction = float(to @ along) / float(along @ along)
    return 0.0 < fraction < 1.0 and float(np.linalg.norm(to - fraction * along)) <= distance


def without_slits(faces: Ints) -> Ints:
    """Remove collapsed faces, and pairs of faces on the same vertices with opposite winding."""
    faces = faces[is_face(faces)]
    _, same = first_alike(np.sort(faces, axis=1))
    _, after, last = from_least_corner(faces).T
    side = 2 * same + (after < last)
    counts = np.bincount(side, minlength=2 * len(faces))
    order = np.argsort(side, kind="stable")
    rank = np.empty(len(faces), dtype=np.int64)
    rank[order] = np.arange(len(faces)) - (np.cumsum(counts) - counts)[side[order]]
    return np.asarray(faces[rank >= counts[side ^ 1]])


def without_slivers(points: Floats, faces: Ints, rounding: float) -> Ints:
    """Remove faces without an area by flipping their longest edge, which leaves no gap.

    A flip replaces the two faces at an edge by two others on the same four corners.

    Args:
        points: Positions (V, 3).
        faces: Faces (F, 3).
        rounding: Largest error of a coordinate.

    Returns:
        The faces; those whose longest edge does not have exactly two faces are kept.
    """
    faces, fewest = faces.copy(), len(faces) + 1
    for _ in range(MOST_FLIPS):
        flat = np.flatnonzero(~has_area(points, faces, rounding))
        if not 0 < len(flat) < fewest:
            return faces
        fewest = len(flat)
        sides = np.roll(points[faces[flat]], -1, axis=1) - points[faces[flat]]
        longest = np.argmax(np.linalg.norm(sides, axis=2), axis=1)
        twins = _twins(faces)[3 * flat + (longest + 2) % 3]
        _flip_edges(faces, 3 * flat + (longest + 2) % 3, twins)
        faces = faces[is_face(faces)]
    return faces


def _twins(faces: Ints) -> Ints:
    """Twin of each half-edge, shape (3 F,); -1 if its edge does not have exactly two faces."""
    twins = np.full(faces.size, -1, dtype=np.int64)
    one, two = paired_edges(faces)
    twins[one], twins[two] = two, one
    return twins


def _flip_edges(faces: Ints, half_edges: Ints, twins: Ints) -> None:
    """Flip edges in place, at most one of each face."""
    done = set()
    for here, there in zip(half_edges.tolist(), twins.tolist(), strict=True):
        face, other = here // 3, there // 3
        if there < 0 or face in done or other in done:
            continue
        done |= {face, other}
        top, start, end = (int(faces[face, (here + k) % 3]) for k in range(3))
        bottom = int(faces[other, there % 3])
        faces[face], faces[other] = (top, start, bottom), (top, bottom, end)
