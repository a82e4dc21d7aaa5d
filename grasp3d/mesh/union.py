"""Union of bodies that overlap or touch, so that no face lies inside the object.

First the faces are divided into bodies, whose orientation, cavities and flatness are found. Closed
bodies then become solids of the library Manifold, with their faces offset.
"""

from dataclasses import dataclass

import manifold3d
import numpy as np
from scipy.optimize import linear_sum_assignment
from scipy.spatial import cKDTree

from grasp3d.arrays import Bools, Floats, Ints, first_alike, first_at_position, unit_rows
from grasp3d.mesh.cleaning import WELDS, clusters, ends_of, from_least_corner, holes_of, is_face
from grasp3d.mesh.measures import (
    Triangles,
    connected,
    crowded_edges,
    face_areas,
    has_area,
    paired_edges,
    part_volumes,
)

CLEAR = 1e-3
"""Volume, in units of the area to the power 3/2, above which an open body has an orientation: a
thin bowl has 0.002, a rough flat sheet 0.0001."""

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
    """A closed body with or without its cavities, whose faces are offset."""

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
        flat (a sheet with two sides), nan if it is open, shape (B,). The faces, over new vertices
        that only neighbours share, numbered from 0, shape (F, 3).
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

    Where more than two faces meet, faces that are connected elsewhere are paired first, then those
    with the thinnest wedges of material between them. Bodies that touch are divided there, and the
    two sides of a wall between them become a flat body.
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
        vertex: Number of each vertex before the division, shape (V,).
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
    if np.nansum(volumes) < 0.0:  # the whole object is inside out, with its cavities
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
    """Return whether an open body, closed by fans over its holes, is clearly inside out."""
    rings = [points[hole] for hole in holes_of(faces)]
    fans = [np.stack([r, np.roll(r, -1, axis=0), 0.0 * r + r.mean(axis=0)], axis=1) for r in rings]
    corners = np.concatenate([points[faces], *fans])
    a, b, c = np.moveaxis(corners - corners[0, 0], 1, 0)
    volume = np.einsum("ij,ij->", a, np.cross(b, c)) / 6.0
    return bool(volume < -CLEAR * face_areas(points, faces).sum() ** 1.5)


NEAR = 4.0
"""Distance within which vertices are merged after faces were offset, in units of the offset."""

SNAPS = (16.0, 64.0, 256.0, 1024.0)
"""The same for vertices on the lines where bodies meet, which an offset moves farther where they
meet at a small angle; the first that leaves no face without an area is used."""

REAL = 1e-6
"""Fraction of the area that must vanish in a union; bodies that touch in a line are not united."""

MOST_FLIPS = 100
"""Largest number of rounds that remove faces without an area, and folds."""

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
    """Number of solids that lost faces in their union, and number of solids within others.

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
        Canonical vertex of each vertex (V,); the faces, all with an area if possible.
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
    """Divide those pieces of a face that contain a point, also on an edge."""
    result: list[tuple[int, ...]] = []
    for piece in pieces:
        edges = np.stack([piece, np.roll(piece, -1)], axis=1)
        start, end = points[np.sort(edges, axis=1)].swapaxes(0, 1)  # same order in the face beyond
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
    """Remove collapsed faces; of faces on the same vertices keep one in the majority's winding."""
    faces = faces[is_face(faces)]
    _, same = first_alike(np.sort(faces, axis=1))
    _, after, last = from_least_corner(faces).T
    side = np.sign(after - last)
    faces = faces[side * np.bincount(same, side)[same] > 0.0]
    first, _ = first_alike(np.sort(faces, axis=1))
    return np.asarray(faces[np.sort(first)])


def without_slivers(points: Floats, faces: Ints, rounding: float) -> Ints:
    """Remove faces without an area by flipping their longest edge, and folds by flipping creases.

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
