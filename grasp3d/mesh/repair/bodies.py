"""The bodies of a surface: copies of one another, orientation, nesting, walls between them."""

import math
from collections import Counter
from functools import cached_property

import numpy as np
from scipy.spatial import ConvexHull, QhullError, cKDTree

from grasp3d.arrays import Bools, Floats, Ints, unit_rows
from grasp3d.mesh.measures import edges_of, face_areas, part_volumes, parts_of
from grasp3d.mesh.repair.cleaning import PAIR, sheets_of
from grasp3d.mesh.repair.solids import boxes_of, nested
from grasp3d.mesh.work_bounds import BODY_COPIES, INNER_WALLS, MATCHED_WALLS, pairs_in_cells

CLEAR_VOTE = 0.5
"""An open body is flipped when its hull vote is below minus this; see `_hull_vote`."""

FRAGMENT = 1e-3
"""Fraction of the largest volume of a component from which a closed sheet of it is a body of its
own."""

NO_VOLUME = 1e-10
"""Volume below which a body is a sheet with two sides, in units of its area to the power 3/2."""

MOST_ON_HULL = 4096
"""Vertices of the largest open body of which the whole convex hull is computed."""

DIRECTIONS = 512
"""Directions in which the corners of the hull of a larger body are searched."""

AT_ONCE = 8
"""Directions in which the farthest corners are sought at once: a pass over them serves several, but
the memory grows."""

FLAT = 1e-18
"""Least variance of a body's vertices, as a fraction of the largest, that is not flat."""

TOUCH = 1e-10
"""Distance within which bodies touch, as a fraction of the size, unless rounding is larger."""

HALF = 0.5
"""Threshold between the winding numbers outside, 0, and inside, 1."""


def body_of_face(points: Floats, faces: Ints) -> Ints:
    """Body of each face, shape (F,).

    Faces connected across edges with exactly two faces form a sheet. A closed sheet is a body, even
    if it touches others at vertices or edges; open sheets and small fragments are one body with the
    sheets that they touch.
    """
    sheet = sheets_of(faces)
    count = int(sheet.max()) + 1
    part = parts_of(faces)
    if count == part.max() + 1:
        return part
    size = int(faces.max()) + 1
    apart = faces + sheet[:, None] * size  # separate vertices for each sheet
    edges = edges_of(apart)
    attached = np.zeros(count, dtype=bool)
    attached[edges.ends[edges.balance != 0, 0] // size] = True
    volumes = np.abs(part_volumes(points, faces, sheet))
    part_of_sheet = np.zeros(count, dtype=np.int64)
    part_of_sheet[sheet] = part
    largest = np.zeros(int(part.max()) + 1)
    np.maximum.at(largest, part_of_sheet, volumes)
    attached |= volumes < FRAGMENT * largest[part_of_sheet]
    main = np.zeros(count, dtype=bool)  # fragments are attached to their component's largest sheet
    main[np.lexsort((volumes, part_of_sheet))[np.cumsum(np.bincount(part_of_sheet)) - 1]] = True
    with_fragments = np.zeros(len(largest), dtype=bool)
    with_fragments[part_of_sheet[attached]] = True
    attached |= main & with_fragments[part_of_sheet]
    body = np.where(attached, part_of_sheet, len(largest) + np.arange(count))
    _, numbered = np.unique(body[sheet], return_inverse=True)
    return np.asarray(numbered, dtype=np.int64)


class Bodies:
    """The bodies of a surface: their volumes, bounding boxes and nesting."""

    def __init__(self, points: Floats, faces: Ints, touch: float = TOUCH) -> None:
        self.points, self.faces, self.touch = points, faces, touch
        self.body = body_of_face(points, faces)
        self.count = int(self.body.max()) + 1
        self._rows = np.split(
            np.argsort(self.body, kind="stable"), np.cumsum(np.bincount(self.body))[:-1]
        )
        size = int(faces.max()) + 1
        edges = edges_of(faces + self.body[:, None] * size)
        self.open = np.zeros(self.count, dtype=bool)
        self.open[edges.ends[edges.balance != 0, 0] // size] = True
        areas = np.bincount(self.body, face_areas(points, faces))
        volumes = part_volumes(points, faces, self.body)
        self.volumes = np.where(np.abs(volumes) > NO_VOLUME * areas**1.5, volumes, 0.0)
        self.lower, self.upper = boxes_of(points, faces, self.body, self.count)

    def of(self, body: int) -> Ints:
        """Faces of a body, shape (n, 3)."""
        return self.faces[self._rows[body]]

    @cached_property
    def within(self) -> tuple[Ints, Ints]:
        """Closed bodies wholly within other closed bodies: the inner and outer one of each pair."""
        solid = np.flatnonzero(~self.open & (self.volumes != 0.0))
        own = np.isin(self.body, solid)
        if len(solid) < 2:
            return solid[:0], solid[:0]
        inner, outer = nested(
            self.points,
            self.faces[own],
            np.searchsorted(solid, self.body[own]),
            self.volumes[solid],
            self.touch,
        )
        return solid[inner], solid[outer]

    def inside_out(self) -> Bools:
        """Mask of the bodies to flip; a cavity within another body must be wound inward."""
        flip = np.zeros(self.count, dtype=bool)
        for body in np.flatnonzero(self.open).tolist():
            flip[body] = _hull_vote(self.points, self.of(body)) < -CLEAR_VOTE
        closed = ~self.open
        if self.volumes[closed].sum() < 0.0:  # the whole object with its cavities
            flip[closed] = True
        negative = np.where(flip, -self.volumes, self.volumes) < 0.0
        if (closed & negative).any():
            inner, outer = self.within
            enclosed = np.zeros(self.count, dtype=bool)
            enclosed[inner[~negative[outer]]] = True
            flip ^= closed & negative & ~enclosed
        return flip

    def doubled(self) -> int:
        """Number of closed bodies inside the material of others: their volume would count twice."""
        inner, outer = self.within
        depth = np.bincount(inner, np.sign(self.volumes[outer]), minlength=self.count)
        return int((~self.open & (self.volumes > 0.0) & (depth > 0.0)).sum())

    def owners(self) -> Ints:
        """Solid that each body is part of, shape (B,): itself, or for a cavity the body around it.

        Of several bodies around a cavity the smallest. Open bodies, those without a volume and
        cavities in no body have -1.
        """
        solid = ~self.open & (self.volumes > 0.0)
        owner = np.where(solid, np.arange(self.count), -1)
        inner, outer = self.within
        cavity = (self.volumes[inner] < 0.0) & solid[outer]
        inner, outer = inner[cavity], outer[cavity]
        smallest_last = np.argsort(-self.volumes[outer], kind="stable")
        owner[inner[smallest_last]] = outer[smallest_last]
        return owner

    def copies(self, distance: float) -> dict[int, tuple[Ints, Ints]]:
        """Find copies of earlier bodies, vertex by vertex within a distance, in either winding.

        Returns:
            For each copy its vertices, and the corresponding vertices of the earlier body.
        """
        sizes = np.bincount(self.body)
        matches: dict[int, tuple[Ints, Ints]] = {}
        for size in np.unique(sizes):
            alike = np.flatnonzero(sizes == size)
            rows = np.hstack([self.lower[alike], self.upper[alike], self._middles[alike]])
            for i, j in _near(rows, distance):
                if alike[i] in matches or alike[j] in matches:
                    continue
                matched = self._matched(int(alike[i]), int(alike[j]), distance)
                if matched is not None:
                    matches[int(alike[j])] = matched
        return matches

    @cached_property
    def _middles(self) -> Floats:
        """Mean corner of each body's faces, shape (B, 3)."""
        sums = [np.bincount(self.body, self.points[self.faces, k].sum(axis=1)) for k in range(3)]
        return np.stack(sums, axis=1) / (3.0 * np.bincount(self.body))[:, None]

    def _matched(self, one: int, two: int, distance: float) -> tuple[Ints, Ints] | None:
        """Vertices of the second body and corresponding ones of the first, if it is a copy."""
        old, new = np.unique(self.of(one)), np.unique(self.of(two))
        if len(old) != len(new):
            return None
        gap, near = cKDTree(self.points[old]).query(self.points[new])
        if np.max(gap) > distance or len(np.unique(near)) < len(new):
            return None
        moved = old[near][np.searchsorted(new, self.of(two))]
        here, there = (np.unique(np.sort(faces, axis=1), axis=0) for faces in (self.of(one), moved))
        return (new, old[near]) if np.array_equal(here, there) else None


def _near(rows: Floats, distance: float) -> list[tuple[int, int]]:
    """Pairs of rows that differ by at most a distance in each column, the earlier first."""
    reach = distance * (1.0 + 1e-9)
    if len(rows) ** 2 > BODY_COPIES.most:
        BODY_COPIES.check(pairs_in_cells(rows, reach))
    pairs = cKDTree(rows).query_pairs(reach, p=np.inf, output_type="ndarray")
    return sorted(map(tuple, np.sort(pairs, axis=1).tolist()))


def _hull_vote(points: Floats, faces: Ints) -> float:
    """Mean agreement of faces at the convex hull's corners with its outward normals, -1 to 1.

    An open surface has no volume whose sign gives its orientation, but its faces on the convex hull
    must point outward. 0 if it is flat.
    """
    if len(faces) == 1:
        return 0.0
    ids, corners = np.unique(faces, return_inverse=True)
    own, local = points[ids], corners.reshape(-1, 3)
    outward = _outward_at_hull(own) if len(own) <= MOST_ON_HULL else _outward_at_extremes(own)
    a, b, c = own[local[:, 0]], own[local[:, 1]], own[local[:, 2]]
    doubled = np.cross(b - a, c - a)
    votes = np.einsum("fi,fki->fk", doubled, unit_rows(outward)[local])
    return float(votes.sum() / max(np.abs(votes).sum(), np.finfo(np.float64).tiny))


def _outward_at_hull(points: Floats) -> Floats:
    """Sum of the convex hull's normals at each of its corners, 0 elsewhere, shape (n, 3)."""
    outward = np.zeros_like(points)
    try:
        hull = ConvexHull(points)
    except QhullError:
        return outward
    for k in range(3):
        np.add.at(outward, hull.simplices[:, k], hull.equations[:, :3])
    return outward


def _outward_at_extremes(points: Floats) -> Floats:
    """Like `_outward_at_hull`, at the corners that are the farthest in some of many directions.

    Its time is linear: that of a hull grows with the square for points on a circle or a sphere.
    """
    outward = np.zeros_like(points)
    spread = np.linalg.eigvalsh(np.cov(points.T))
    if spread[0] <= FLAT * spread[2]:
        return outward
    for directions in np.array_split(_directions(), DIRECTIONS // AT_ONCE):
        np.add.at(outward, np.argmax(directions @ points.T, axis=1), directions)
    return outward


def _directions() -> Floats:
    """Directions spread evenly over the sphere, shape (DIRECTIONS, 3)."""
    number = np.arange(DIRECTIONS) + 0.5
    height, turn = 1.0 - 2.0 * number / DIRECTIONS, np.pi * (1.0 + math.sqrt(5.0)) * number
    across = np.sqrt(1.0 - height**2)
    return np.stack([across * np.cos(turn), across * np.sin(turn), height], axis=1)


def without_inner_walls(points: Floats, faces: Ints, rounding: float) -> Bools:
    """Mask that leaves out back-to-back faces with material on both sides.

    Where two bodies share vertices, all edges between their faces and the common wall have more
    than two faces. The wall's two sides are sheets with the same border in opposite directions, and
    no volume between them.

    Args:
        points: Positions (V, 3) of a surface of size about 1.
        faces: Faces (F, 3), counter-clockwise from outside.
        rounding: Largest error of a coordinate.

    Returns:
        The faces to keep, shape (F,).
    """
    mask = np.ones(len(faces), dtype=bool)
    if not (edges_of(faces).faces > PAIR).any():
        return mask
    wall = _back_to_back(points, faces, rounding)
    if wall.all():
        return mask
    corners, rows = points[faces[~wall]], np.flatnonzero(wall)
    part = parts_of(faces[rows])
    INNER_WALLS.check((int(part.max(initial=-1)) + 1) * len(corners))
    for number in range(int(part.max(initial=-1)) + 1):
        own = rows[part == number]
        middle = points[faces[own[np.argmax(face_areas(points, faces[own]))]]].mean(axis=0)
        if _winding_number(corners - middle) > HALF:
            mask[own] = False
    return mask


def _winding_number(corners: Floats) -> float:
    """Winding number of triangles (F, 3, 3) about the origin (van Oosterom & Strackee 1983)."""
    a, b, c = corners[:, 0], corners[:, 1], corners[:, 2]
    la, lb, lc = (np.linalg.norm(side, axis=1) for side in (a, b, c))
    determinant = np.einsum("ij,ij->i", a, np.cross(b, c))
    dots = [np.einsum("ij,ij->i", u, v) * w for u, v, w in ((a, b, lc), (b, c, la), (c, a, lb))]
    angles = 2.0 * np.arctan2(determinant, la * lb * lc + sum(dots))
    return float(angles.sum() / (4.0 * np.pi))


def _back_to_back(points: Floats, faces: Ints, rounding: float) -> Bools:
    """Mask of the faces of sheets that, alone or with another, enclose no volume, shape (F,)."""
    sheet = sheets_of(faces)
    volumes = part_volumes(points, faces, sheet)
    areas = np.bincount(sheet, face_areas(points, faces)).astype(np.float64)
    borders = _borders(faces, sheet)
    flat = np.abs(volumes) <= _volume_rounding(areas, rounding)
    flat[list(borders)] = False
    times = Counter(borders.values())
    opposite = ((count, tuple(-edge for edge in border)) for border, count in times.items())
    MATCHED_WALLS.check(sum(count * times[border] for count, border in opposite) // 2)
    faces_of = np.split(faces[np.argsort(sheet, kind="stable")], np.cumsum(np.bincount(sheet))[:-1])
    unmatched: dict[tuple[int, ...], list[int]] = {}
    for number, border in borders.items():
        others = unmatched.setdefault(tuple(-edge for edge in border), [])
        for other in others:
            both = np.concatenate([faces_of[number], faces_of[other]])
            volume = part_volumes(points, both, np.zeros(len(both), dtype=np.int64))[0]
            if abs(volume) <= _volume_rounding(areas[number] + areas[other], rounding):
                flat[[number, other]] = True
                others.remove(other)
                break
        else:
            unmatched.setdefault(border, []).append(number)
    return np.asarray(flat[sheet])


def _volume_rounding(areas: Floats, rounding: float) -> Floats:
    """Largest volumes due to rounding, for closed surfaces of some areas."""
    return np.maximum(NO_VOLUME * areas**1.5, 2.0 * rounding * areas)


def _borders(faces: Ints, sheet: Ints) -> dict[int, tuple[int, ...]]:
    """Border edges of each sheet, counted from 1, with the sign of their direction."""
    size = int(faces.max()) + 1
    edges = edges_of(faces + sheet[:, None] * size)
    ends = np.flatnonzero(edges.balance)
    sheet_of_edge = edges.ends[ends, 0] // size
    low, high = (edges.ends[ends] % size).T
    number = (low * size + high + 1) * np.sign(edges.balance[ends])
    order = np.lexsort((np.abs(number), sheet_of_edge))
    keys, first = np.unique(sheet_of_edge[order], return_index=True)
    groups = np.split(number[order], first[1:])
    return {
        int(key): tuple(group.tolist()) for key, group in zip(keys, groups, strict=bool(len(keys)))
    }
