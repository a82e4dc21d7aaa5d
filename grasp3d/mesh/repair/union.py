"""Union of bodies that overlap or touch, so that no face lies inside the object, and its seams."""

import manifold3d
import numpy as np
from scipy.spatial import cKDTree

from grasp3d.arrays import Floats, Ints, first_alike, first_at_position, unit_rows
from grasp3d.mesh.measures import face_areas, has_area, paired_edges
from grasp3d.mesh.repair.bodies import Solid
from grasp3d.mesh.repair.cleaning import WELDS, clusters, from_least_corner, is_face

NEAR = 4.0
"""Distance within which vertices are merged after faces were offset, in units of the offset."""

SNAPS = (16.0, 64.0, 256.0, 1024.0)
"""The same for vertices on the lines where bodies meet, which an offset moves farther where they
meet at a small angle; the first that leaves no face without an area is used."""

REAL = 1e-6
"""Fraction of the area that must vanish in a union; bodies that touch in a line are not united."""

MOST_FLIPS = 100
"""Most rounds in which faces without an area, and folds, are removed."""

FOLD = 1e-10
"""Two faces whose normals have a cosine of at most this much above -1 are one fold, without volume
between them; Manifold leaves a few where many faces are coplanar."""


def union_of(solids: list[Solid]) -> manifold3d.Manifold | None:
    """Unite solids; None if the volume is not between the largest part's and the sum of all parts'.

    Args:
        solids: The solids, faces offset outward by less than the precision of their positions, so
            that faces in contact surely overlap, and coplanar faces stay coplanar.
    """
    parts = [solid.manifold for solid in solids]
    whole = manifold3d.Manifold.batch_boolean(parts, manifold3d.OpType.Add)
    volumes = [part.volume() for part in parts]
    sound = (
        whole.status() == manifold3d.Error.NoError
        and min(volumes) > 0.0
        and (1.0 - REAL) * max(volumes) < whole.volume() < (1.0 + REAL) * sum(volumes)
    )
    return whole if sound else None


def surround(corners: Floats) -> bool:
    """Return whether triangles (F, 3, 3), wound outward, surround the origin: winding number 1.

    Van Oosterom & Strackee 1983.
    """
    lengths = np.linalg.norm(corners, axis=2)
    a, b, c = corners.swapaxes(0, 1)
    dots = np.stack([np.einsum("ij,ij->i", *pair) for pair in ((b, c), (c, a), (a, b))], axis=1)
    below = lengths.prod(axis=1) + (dots * lengths).sum(axis=1)
    angles = np.arctan2(np.einsum("ij,ij->i", a, np.cross(b, c)), below)
    return bool(angles.sum() > np.pi)


def count_united(whole: manifold3d.Manifold, solids: list[Solid], touch: float) -> tuple[int, int]:
    """Number of solids that lost faces in their union, and of those that lie within others.

    Both are 0 if no solids overlap, or touch over an area.
    """
    mesh = whole.to_mesh64()
    runs = np.searchsorted([solid.mark for solid in solids], mesh.run_original_id)
    own = face_areas(np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts))
    part = np.repeat(runs, np.diff(mesh.run_index) // 3)
    left = np.bincount(part, own, minlength=len(solids))
    areas = np.array([solid.manifold.surface_area() for solid in solids])
    areas *= 1.0 - max(REAL, 100.0 * touch)
    if left.sum() >= areas.sum():
        return 0, 0
    gone, volumes = left == 0.0, np.array([solid.manifold.volume() for solid in solids])
    tiled = volumes.sum() - whole.volume() < 0.5 * volumes[gone].sum()  # the others surround them
    return int((left < areas).sum()), 0 if tiled else int(gone.sum())


def united(
    points: Floats, vertex: Ints, whole: manifold3d.Manifold, solids: list[Solid], touch: float
) -> tuple[Floats, Ints, Ints]:
    """Express a union over the given vertices.

    The given positions are restored; a given vertex that lies on the united surface is made a
    corner of it even if the union removed it.

    Args:
        points: Positions (V, 3) of a surface of size about 1.
        vertex: Its vertex for each vertex of the solids.
        whole: The union.
        solids: Its parts.
        touch: Offset of their faces.

    Returns:
        Positions (V', 3): the given ones, then those on the lines where bodies meet; the faces of
        the union (F', 3); canonical vertex of each vertex, shape (V',).
    """
    mesh = whole.to_mesh64()
    crossings, cut = np.asarray(mesh.vert_properties)[:, :3], np.asarray(mesh.tri_verts)
    given = vertex[np.concatenate([solid.corners for solid in solids])]
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
    return own, faces, canonical


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
    if not len(loose):
        return faces
    corners = points[faces]
    middles = corners.mean(axis=1)
    radii = np.linalg.norm(corners - middles[:, None], axis=2).max(axis=1)
    tree = cKDTree(points[loose])
    near = tree.query_ball_point(middles, radii + distance, return_sorted=True)
    across = unit_rows(np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0]))
    divided: list[tuple[int, ...]] = []
    for face, normal, rows in zip(faces.tolist(), across, near, strict=True):
        pieces = [tuple(face)]
        for point in [int(loose[row]) for row in rows]:
            if abs((points[point] - points[face[0]]) @ normal) <= distance:
                pieces = _divided(points, pieces, point, normal, distance)
        divided += pieces
    return np.array(divided, dtype=np.int64)


def _divided(
    points: Floats, pieces: list[tuple[int, ...]], point: int, across: Floats, distance: float
) -> list[tuple[int, ...]]:
    """Divide the pieces of a face that a point lies in, or on an edge of."""
    result: list[tuple[int, ...]] = []
    for piece in pieces:
        edges = np.stack([piece, np.roll(piece, -1)], axis=1)
        start, end = points[np.sort(edges, axis=1)].swapaxes(0, 1)  # as for the face beyond
        along, to = end - start, points[point] - start
        fraction = (to * along).sum(axis=1) / (along * along).sum(axis=1)
        gap = np.linalg.norm(to - fraction[:, None] * along, axis=1)
        away = (gap > distance) | (fraction <= 0.0) | (fraction >= 1.0)
        start, end = points[edges].swapaxes(0, 1)
        inside = np.cross(end - start, points[point] - start) @ across > 0.0
        if inside.all() or not away.all():
            result += [(*edge, point) for edge in edges[away].tolist()]
        else:
            result.append(piece)
    return result


def without_slits(faces: Ints) -> Ints:
    """Remove collapsed faces, and of those on the same vertices all but what faces are ahead."""
    faces = faces[is_face(faces)]
    _, same = first_alike(np.sort(faces, axis=1))
    _, after, last = from_least_corner(faces).T
    side = np.sign(after - last)
    faces = faces[side * np.bincount(same, side)[same] > 0.0]
    first, _ = first_alike(np.sort(faces, axis=1))
    return np.asarray(faces[np.sort(first)])


def without_slivers(points: Floats, faces: Ints, rounding: float) -> Ints:
    """Remove faces without an area by flipping their longest edge, folds by flipping the crease.

    A flip replaces the two faces at an edge by two others on the same four corners, which leaves
    no gap.

    Args:
        points: Positions (V, 3).
        faces: Faces (F, 3).
        rounding: Largest error of a coordinate.

    Returns:
        The faces; those whose longest edge does not have exactly two faces are kept.
    """
    faces, least = faces.copy(), (len(faces) + 1, 0.0)
    for _ in range(MOST_FLIPS):
        sides = np.roll(points[faces], -1, axis=1) - points[faces]
        flat = ~has_area(points, faces, rounding)
        longest = np.argmax(np.linalg.norm(sides[flat], axis=2), axis=1)
        across = np.cross(sides[:, 0], sides[:, 1])
        normals, doubled = unit_rows(across), np.linalg.norm(across, axis=1)
        one, two = paired_edges(faces)
        twins = np.full(faces.size, -1)  # where an edge does not have exactly two faces
        twins[one], twins[two] = two, one
        folded = (normals[one // 3] * normals[two // 3]).sum(axis=1) <= FOLD - 1.0
        folded &= ~(flat[one // 3] | flat[two // 3])
        half_edges = np.append(3 * np.flatnonzero(flat) + (longest + 2) % 3, one[folded])
        left = flat.sum(), (doubled[one // 3] + doubled[two // 3])[folded].sum()
        if not len(half_edges) or left >= least:
            return faces
        least = left
        _flip_edges(faces, half_edges, twins[half_edges])
        faces = without_slits(faces) if folded.any() else faces[is_face(faces)]
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
