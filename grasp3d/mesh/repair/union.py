"""Union of bodies that overlap or touch, so that no face lies inside the object, and its seams."""

from dataclasses import dataclass
from itertools import chain

import manifold3d
import numpy as np
from scipy.spatial import cKDTree

from grasp3d.arrays import Floats, Ints, first_at_position, unit_rows
from grasp3d.mesh.measures import face_areas, has_area, paired_edges
from grasp3d.mesh.repair.cleaning import WELDS, clusters, first_alike, from_least_corner, is_face
from grasp3d.mesh.repair.solids import Solid

NEAR = 4.0
"""Distance within which vertices are merged after faces were offset, in units of the offset."""

SNAPS = (16.0, 64.0, 256.0, 1024.0)
"""The same for vertices on the lines where bodies meet, which an offset moves farther where they
meet at a small angle; the first that leaves no face without an area is used."""

REAL = 1e-6
"""Fraction of the area that must vanish in a union; bodies that touch in a line are not united."""

FAR = np.array([3.0, 2.0, 1.0])
"""Direction in which a ray leaves a surface of size about 1."""

MOST_FLIPS = 100
"""Most rounds in which faces without an area are removed."""


@dataclass(frozen=True, eq=False)
class United:
    """A surface whose bodies do not overlap."""

    points: Floats
    """Positions (V', 3): the given ones, then those on the lines where bodies meet."""
    faces: Ints
    """Shape (F', 3)."""
    canonical: Ints
    """Canonical vertex of each vertex, shape (V',)."""
    joined: int
    """Number of solids that lost faces to others."""
    within: int
    """Number of solids that lost all faces."""


def union_of(solids: list[Solid]) -> manifold3d.Manifold | None:
    """Unite solids; None if the volume is not between the largest part's and the sum of all parts'.

    Args:
        solids: The solids, faces offset outward by less than the precision of their positions, so
            that faces in contact surely overlap, and coplanar faces stay coplanar.
    """
    whole = manifold3d.Manifold.batch_boolean(
        [solid.manifold for solid in solids], manifold3d.OpType.Add
    )
    volumes = [solid.manifold.volume() for solid in solids]
    sound = (
        whole.status() == manifold3d.Error.NoError
        and min(volumes) > 0.0
        and (1.0 - REAL) * max(volumes) < whole.volume() < (1.0 + REAL) * sum(volumes)
    )
    return whole if sound else None


def is_inside(whole: manifold3d.Manifold, point: Floats) -> bool:
    """Return whether a point (3,) of a surface of size about 1 lies in a solid."""
    hits = whole.ray_cast(point.tolist(), (point + FAR).tolist())
    return bool(hits) and float(np.dot(hits[0].normal, FAR)) > 0.0


def united(
    points: Floats, others: Ints, whole: manifold3d.Manifold, solids: list[Solid], touch: float
) -> United | None:
    """Express a union over the given vertices; None if no solids overlap, or touch over an area.

    The given positions are restored; a given vertex that lies on the united surface is made a
    corner of it even if the union removed it.

    Args:
        points: Positions (V, 3) of a surface of size about 1.
        others: Faces that are part of no solid, shape (F, 3).
        whole: The union.
        solids: Its parts.
        touch: Offset of their faces.
    """
    mesh = whole.to_mesh64()
    crossings, cut = np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts).astype(int)
    runs = np.searchsorted([solid.mark for solid in solids], mesh.run_original_id)
    part = np.repeat(runs, np.diff(mesh.run_index) // 3)
    left = np.bincount(part, face_areas(crossings, cut), minlength=len(solids))
    areas = np.array([solid.manifold.surface_area() for solid in solids])
    real = 1.0 - max(REAL, 100.0 * touch)
    if left.sum() >= real * areas.sum():
        return None
    given = np.concatenate([solid.corners for solid in solids])
    displaced = np.concatenate([solid.points for solid in solids])
    same = first_at_position(np.concatenate([displaced, crossings]))[len(displaced) :]
    new = same >= len(displaced)
    number = len(points) + np.cumsum(new) - 1
    number[~new] = given[same[~new]]
    own = np.concatenate([points, crossings[new]])
    among = np.append(np.unique(given), np.arange(len(points), len(own)))
    canonical, faces = _snapped(own, number[cut], among, len(points), touch)
    loose = among[(canonical[among] == among) & (among < len(points))]
    faces = put_on_surface(own, faces, np.setdiff1d(loose, faces), NEAR * touch)
    faces = np.concatenate([others, faces])
    lost = left < real * areas
    return United(own, faces, canonical, int(lost.sum()), int((left == 0.0).sum()))


def _snapped(points: Floats, cut: Ints, among: Ints, count: int, touch: float) -> tuple[Ints, Ints]:
    """Merge the vertices of a union that differ only by the offset of the faces.

    Args:
        points: Positions (V, 3) of its vertices and those of its parts.
        cut: Faces of the union (F, 3).
        among: Vertices of the union and of its parts, shape (k,).
        count: Number of given vertices, which come first.
        touch: Offset of the faces.

    Returns:
        Canonical vertex of each vertex (V,); the faces, with an area as far as possible.
    """
    canonical = np.arange(len(points))
    for snap in SNAPS:
        reach = min(snap * touch, WELDS[-1])
        near = clusters(points[among], NEAR * touch, loose=among >= count, reach=reach)
        canonical[among] = among[near]
        faces = without_slivers(points, without_slits(canonical[cut]), touch)
        if has_area(points, faces, touch).all():
            break
    return canonical, faces


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
    near = tree.query_ball_point(middles, reach, return_sorted=True)
    face = np.repeat(np.arange(len(faces)), counts)
    vertex = loose[np.fromiter(chain.from_iterable(near), np.int64, int(counts.sum()))]
    across = unit_rows(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    off = np.einsum("ij,ij->i", points[vertex] - corners[face, 0], across[face])
    on = np.abs(off) <= distance
    pieces: dict[int, list[tuple[int, ...]]] = {}
    for number, point in zip(face[on].tolist(), vertex[on].tolist(), strict=True):
        own = pieces.setdefault(number, [tuple(faces[number].tolist())])
        pieces[number] = _divided(points, own, point, across[number], distance)
    whole = np.ones(len(faces), dtype=bool)
    whole[list(pieces)] = False
    added = np.array(list(chain.from_iterable(pieces.values())), dtype=np.int64).reshape(-1, 3)
    return np.concatenate([faces[whole], added])


def _divided(
    points: Floats, pieces: list[tuple[int, ...]], point: int, across: Floats, distance: float
) -> list[tuple[int, ...]]:
    """Divide the pieces of a face that a point lies in, or on an edge of."""
    result: list[tuple[int, ...]] = []
    for piece in pieces:
        edges = list(zip(piece, piece[1:] + piece[:1], strict=True))
        start, end = points[list(piece)], points[list(piece[1:] + piece[:1])]
        depth = np.cross(across, unit_rows(end - start)) * (points[point] - start)
        away = [edge for edge, far in zip(edges, depth.sum(axis=1) > distance, strict=True) if far]
        if len(away) > 1 and depth.sum(axis=1).min() > -distance:
            result += [(*edge, point) for edge in away]
        else:
            result.append(piece)
    return result


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
        one, two = paired_edges(faces)
        twins = np.full(faces.size, -1)  # where an edge does not have exactly two faces
        twins[one], twins[two] = two, one
        half_edges = 3 * flat + (longest + 2) % 3
        _flip_edges(faces, half_edges, twins[half_edges])
        faces = faces[is_face(faces)]
    return faces


def _flip_edges(faces: Ints, half_edges: Ints, twins: Ints) -> None:
    """Flip edges in place, at most one of each face."""
    touched = set()
    for here, there in zip(half_edges.tolist(), twins.tolist(), strict=True):
        face, other = here // 3, there // 3
        if there < 0 or face in touched or other in touched:
            continue
        touched |= {face, other}
        top, start, end = (int(faces[face, (here + k) % 3]) for k in range(3))
        bottom = int(faces[other, there % 3])
        faces[face], faces[other] = (top, start, bottom), (top, bottom, end)
