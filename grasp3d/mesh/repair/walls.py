"""Removal of walls inside an object, between bodies that share vertices."""

from collections import Counter

import numpy as np

from grasp3d.arrays import Bools, Floats, Ints
from grasp3d.mesh.measures import edges_of, face_areas, part_volumes, parts_of
from grasp3d.mesh.repair.bodies import NO_VOLUME
from grasp3d.mesh.repair.cleaning import PAIR, sheets_of
from grasp3d.mesh.work_bounds import INNER_WALLS, MATCHED_WALLS

HALF = 0.5
"""Threshold between the winding numbers outside, 0, and inside, 1."""


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
    kept = np.ones(len(faces), dtype=bool)
    if not (edges_of(faces).faces > PAIR).any():
        return kept
    wall = _back_to_back(points, faces, rounding)
    if wall.all():
        return kept
    corners, rows = points[faces[~wall]], np.flatnonzero(wall)
    part = parts_of(faces[rows])
    INNER_WALLS.check((int(part.max(initial=-1)) + 1) * len(corners))
    for number in range(int(part.max(initial=-1)) + 1):
        own = rows[part == number]
        middle = points[faces[own[np.argmax(face_areas(points, faces[own]))]]].mean(axis=0)
        if _winding_number(corners - middle) > HALF:
            kept[own] = False
    return kept


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
    MATCHED_WALLS.check(_alike(borders))
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


def _alike(borders: dict[int, tuple[int, ...]]) -> int:
    """Number of pairs of sheets whose borders are the same in opposite directions."""
    times = Counter(borders.values())
    return (
        sum(
            count * times.get(tuple(-edge for edge in border), 0) for border, count in times.items()
        )
        // 2
    )


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
    found, first = np.unique(sheet_of_edge[order], return_index=True)
    groups = np.split(number[order], first[1:])
    return {
        int(key): tuple(group.tolist())
        for key, group in zip(found, groups, strict=bool(len(found)))
    }
