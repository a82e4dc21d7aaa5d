"""Union of bodies that overlap or touch, so that no face lies inside the object, and its seams."""

from dataclasses import dataclass
from itertools import chain

import manifold3d
import numpy as np
import numpy.typing as npt
from scipy.spatial import cKDTree

from grasp3d.arrays import Floats, Ints, first_at_position, unit_rows
from grasp3d.mesh.measures import has_area, paired_edges
from grasp3d.mesh.repair.bodies import Bodies
from grasp3d.mesh.repair.cleaning import WELDS, clusters, first_alike, from_least_corner, is_face
from grasp3d.mesh.repair.solids import Solid, estimated_overlaps, overlap_groups, solids_of
from grasp3d.mesh.work_bounds import NEAR_FACES, POINTS_ON_FACES, UNITED_BODIES

NEAR = 4.0
"""Distance within which vertices are merged after faces were offset, in units of the offset."""

SNAPS = (16.0, 64.0, 256.0, 1024.0)
"""The same for vertices on the lines where bodies meet, which an offset moves farther where they
meet at a small angle; the first that leaves no face without an area is used."""

REAL = 1e-6
"""Fraction of the area that must vanish in a union; bodies that touch in a line are not united."""

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
    bodies: int
    """Number of bodies that overlapped or touched others."""
    refused: int
    """Number of bodies with overlapping boxes whose union was not sound."""
    rounding: float
    """Largest distance of a position from the given faces."""


@dataclass(frozen=True, eq=False)
class _Union:
    """The union of some solids, with its own numbering of vertices."""

    given: Ints
    """Vertices of the solids, shape (k,), its first ones."""
    added: Floats
    """Positions of the other vertices, shape (m, 3)."""
    canonical: Ints
    """Canonical vertex of each vertex, shape (k + m,)."""
    faces: Ints
    """Shape (f, 3)."""
    changed: int
    """Number of solids that lost faces."""


def unite(bodies: Bodies) -> United:
    """Unite the closed bodies that overlap, or touch over an area.

    Each body's faces are first offset outward by less than the precision of its positions, so that
    faces in contact surely overlap, and coplanar faces stay coplanar. The given positions are then
    restored; a given vertex that lies on the united surface is made a corner of it even if the
    union removed it.

    Args:
        bodies: Bodies of a surface of size about 1, its faces counter-clockwise from outside.
    """
    points, touch = bodies.points, bodies.touch
    owner = bodies.owners()
    outer = np.flatnonzero(owner == np.arange(bodies.count))
    groups = [
        outer[group]
        for group in overlap_groups(bodies.lower[outer] - touch, bodies.upper[outer] + touch)
    ]
    if not groups:
        return United(points, bodies.faces, np.arange(len(points)), 0, 0, 0.0)
    unions, joined, refused = [], [outer[:0]], 0
    for group, solids in zip(groups, _solids(bodies, owner, groups), strict=True):
        whole = manifold3d.Manifold.batch_boolean(
            [solid.manifold for solid in solids], manifold3d.OpType.Add
        )
        if not _is_sound(whole, solids):
            refused += len(group)
        elif _has_less_area(whole, solids, touch):
            unions.append(_union(points, whole, solids, touch))
            joined.append(group)
    unchanged = ~np.isin(owner, np.concatenate(joined))
    faces = bodies.faces[unchanged[bodies.body]]
    return _put_together(points, faces, unions, refused, touch if unions else 0.0)


def _solids(bodies: Bodies, owner: Ints, groups: list[Ints]) -> list[list[Solid]]:
    """Solids of the bodies of each group, with their cavities.

    Raises:
        WorkBoundError: Too many of their faces may cross; some are compared with all others.
    """
    members = np.concatenate(groups)
    number = np.full(bodies.count + 1, -1)  # owner -1 (none) indexes the last entry
    number[members] = np.arange(len(members))
    of_face = number[owner][bodies.body]
    faces, solid = bodies.faces[of_face >= 0], of_face[of_face >= 0]
    corners = bodies.points[faces]
    UNITED_BODIES.check(estimated_overlaps(corners.min(axis=1), corners.max(axis=1), solid))
    solids = solids_of(bodies.points, faces, solid, bodies.touch)
    ends = np.cumsum([len(group) for group in groups]).tolist()
    return [solids[end - len(group) : end] for group, end in zip(groups, ends, strict=True)]


def _is_sound(whole: manifold3d.Manifold, solids: list[Solid]) -> bool:
    """Return whether a union's volume is between its largest part's and the sum of all parts'."""
    volumes = [solid.manifold.volume() for solid in solids]
    return bool(
        whole.status() == manifold3d.Error.NoError
        and min(volumes) > 0.0
        and (1.0 - REAL) * max(volumes) < whole.volume() < (1.0 + REAL) * sum(volumes)
    )


def _has_less_area(whole: manifold3d.Manifold, solids: list[Solid], touch: float) -> bool:
    """Return whether the parts of a union meet over an area."""
    area = sum(solid.manifold.surface_area() for solid in solids)
    return bool(whole.surface_area() < (1.0 - max(REAL, 100.0 * touch)) * area)


def _union(points: Floats, whole: manifold3d.Manifold, solids: list[Solid], touch: float) -> _Union:
    """Express a union over the given vertices."""
    mesh = whole.to_mesh64()
    ids, corners = np.unique(
        np.concatenate([solid.corners for solid in solids]), return_inverse=True
    )
    displaced = np.concatenate([solid.points for solid in solids])
    crossings = np.asarray(mesh.vert_properties)[:, :3]
    same = first_at_position(np.concatenate([displaced, crossings]))[len(displaced) :]
    new = same >= len(displaced)
    number = len(ids) + np.cumsum(new) - 1
    number[~new] = corners[same[~new]]
    own = np.concatenate([points[ids], crossings[new]])
    cut = number[np.asarray(mesh.tri_verts).astype(np.int64)]
    canonical, faces = _snapped(own, cut, len(ids), touch)
    lost = canonical == np.arange(len(own))
    lost[faces] = False
    faces = put_on_surface(own, faces, np.flatnonzero(lost[: len(ids)]), NEAR * touch)
    parts = np.searchsorted(ids, np.concatenate([solid.corners[solid.faces] for solid in solids]))
    gone = ~np.isin(_keys(parts), _keys(cut))
    solid_of_face = np.repeat(np.arange(len(solids)), [len(solid.faces) for solid in solids])
    return _Union(ids, crossings[new], canonical, faces, len(np.unique(solid_of_face[gone])))


def _put_together(
    points: Floats, unchanged: Ints, unions: list[_Union], refused: int, rounding: float
) -> United:
    """Combine unions with the faces that are not part of any."""
    count = len(points) + sum(len(union.added) for union in unions)
    canonical, faces, end = np.arange(count), [unchanged], len(points)
    for union in unions:
        own = np.concatenate([union.given, np.arange(end, end + len(union.added))])
        canonical[own] = own[union.canonical]
        faces.append(own[union.faces])
        end += len(union.added)
    return United(
        points=np.concatenate([points, *(union.added for union in unions)]),
        faces=np.concatenate(faces),
        canonical=canonical,
        bodies=sum(union.changed for union in unions),
        refused=refused,
        rounding=rounding,
    )


def _snapped(points: Floats, cut: Ints, count: int, touch: float) -> tuple[Ints, Ints]:
    """Merge the vertices of a union that differ only by the offset of the faces.

    Args:
        points: Positions (V, 3) of its vertices and those of its parts.
        cut: Faces of the union (F, 3).
        count: Number of given vertices, which come first.
        touch: Offset of the faces.

    Returns:
        Canonical vertex of each vertex (V,); the faces, with an area as far as possible.
    """
    new = np.arange(len(points)) >= count
    for snap in SNAPS:
        reach = min(snap * touch, WELDS[-1])
        canonical = clusters(points, NEAR * touch, loose=new, reach=reach)
        faces = without_slivers(points, without_slits(canonical[cut]), touch)
        if has_area(points, faces, touch).all():
            break
    return canonical, faces


def _keys(faces: Ints) -> npt.NDArray[np.void]:
    """One value for each face, independent of the corner that it begins at, shape (F,)."""
    rotated = np.ascontiguousarray(from_least_corner(faces))
    return rotated.view(np.dtype((np.void, rotated.dtype.itemsize * 3))).ravel()


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
    points: Floats, pieces: list[tuple[int, ...]], point: int, across: Floats, distance: float
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
