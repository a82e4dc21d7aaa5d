"""Bodies as solids of the library Manifold: offset faces, boxes, nesting, validity."""

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property

import manifold3d
import numpy as np

from grasp3d.arrays import Bools, Floats, Ints
from grasp3d.mesh.measures import Triangles, first_connected
from grasp3d.mesh.work_bounds import BODY_BOXES, NESTED_BODIES

FARTHEST = 4.0
"""Largest displacement of a corner, in units of the offset of its faces."""

AT_ONCE = 1 << 22
"""Pairs that are compared at once, to bound memory."""

SAMPLED = 1 << 23
"""Pairs of boxes that are compared to estimate the number of overlaps."""

FEWEST_SAMPLES = 32
"""Least number of boxes that are compared with all others."""


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


def nested(
    points: Floats, faces: Ints, body: Ints, volumes: Floats, margin: float
) -> tuple[Ints, Ints]:
    """Find the bodies that lie wholly within others, their surfaces apart by a margin.

    Such a body minus the other body is empty, both taken as wound outward, the inner body offset
    outward and the outer body inward by the margin. A body that crosses the other, or touches it
    from inside, is not within it.

    Args:
        points: Positions (V, 3).
        faces: Faces (F, 3) of closed bodies.
        body: Body of each face, shape (F,).
        volumes: Volume of each body, negative if wound inward, not 0, shape (B,).
        margin: Distance by which surfaces are offset.

    Returns:
        The inner and the outer body of each pair, shape (k,) each.
    """
    lower, upper = boxes_of(points, faces, body, len(volumes))
    inner, outer = enclosed(lower, upper)
    if not len(inner):
        return inner, outer
    sizes = np.bincount(body)
    NESTED_BODIES.check(int((sizes[inner] + sizes[outer]).sum()))
    turned = np.where((volumes < 0.0)[body][:, None], faces[:, ::-1], faces)
    grown = _solids(points, turned, body, np.unique(inner), margin)
    shrunk = _solids(points, turned, body, np.unique(outer), -margin)
    order = np.argsort(outer, kind="stable")
    inner, outer = inner[order], outer[order]
    outers, first = np.unique(outer, return_index=True)
    within = [
        _within([grown[one] for one in ones.tolist()], shrunk[other])
        for other, ones in zip(outers.tolist(), np.split(inner, first[1:]), strict=True)
    ]
    rows = np.concatenate(within)
    return inner[rows], outer[rows]


def boxes_of(points: Floats, faces: Ints, body: Ints, count: int) -> tuple[Floats, Floats]:
    """Lower and upper corner of each body's box, shape (B, 3) each; inf and -inf without a face."""
    lower, upper = np.full((count, 3), np.inf), np.full((count, 3), -np.inf)
    corners = points[faces]
    np.minimum.at(lower, body, corners.min(axis=1))
    np.maximum.at(upper, body, corners.max(axis=1))
    return lower, upper


def _solids(
    points: Floats, faces: Ints, body: Ints, chosen: Ints, shift: float
) -> dict[int, Solid]:
    """Offset solids of some bodies, by body number."""
    own = np.isin(body, chosen)
    solids = solids_of(points, faces[own], np.searchsorted(chosen, body[own]), shift)
    return dict(zip(chosen.tolist(), solids, strict=True))


def _within(inner: list[Solid], outer: Solid) -> Bools:
    """Mask of the solids of which no face is left when another solid is subtracted, shape (k,)."""
    together, marks = marked(inner)
    difference = together - outer.manifold
    if difference.status() != manifold3d.Error.NoError:
        return np.zeros(len(inner), dtype=bool)
    mesh = difference.to_mesh64()
    left = np.asarray(mesh.run_original_id)[np.diff(np.asarray(mesh.run_index)) > 0]
    return np.asarray(~np.isin(marks, left))


def manifold_status(points: Floats, faces: Ints) -> str:
    """Name of Manifold's status for a surface: NoError, NotManifold, NonFiniteVertex, ...

    Args:
        points: Positions (V, 3).
        faces: Faces (F, 3).
    """
    used, rows = np.unique(faces, return_inverse=True)
    mesh = manifold3d.Mesh64(
        np.ascontiguousarray(points[used]), rows.reshape(-1, 3).astype(np.uint64)
    )
    return str(manifold3d.Manifold(mesh).status().name)


def overlapping(lower: Floats, upper: Floats) -> Iterator[tuple[Ints, Ints]]:
    """Find the pairs of boxes that overlap or touch.

    The boxes are sorted along the axis with the fewest overlaps; each is compared with those that
    begin before it ends.

    Args:
        lower: Lower corner of each box (n, 3).
        upper: Upper corner of each box (n, 3).

    Yields:
        Some of the pairs, each pair once: the first and the second box, shape (k,) each.

    Raises:
        WorkBoundError: There are too many boxes to compare.
    """
    count = len(lower)
    orders = np.argsort(lower, axis=0, kind="stable")
    ends = [
        np.searchsorted(lower[orders[:, k], k], upper[orders[:, k], k], side="right")
        for k in range(3)
    ]
    axis = int(np.argmin([end.sum() for end in ends]))
    order, later = orders[:, axis], ends[axis] - np.arange(1, count + 1)
    BODY_BOXES.check(int(later.sum()))
    total = np.cumsum(later)
    begin = 0
    while begin < count:
        before = total[begin] - later[begin]
        end = max(begin + 1, int(np.searchsorted(total, before + AT_ONCE, side="right")))
        size = later[begin:end]
        one = np.repeat(np.arange(begin, end), size)
        two = one + 1 + np.arange(len(one)) - np.repeat(np.cumsum(size) - size, size)
        one, two = order[one], order[two]
        meet = ((lower[one] <= upper[two]) & (lower[two] <= upper[one])).all(axis=1)
        yield one[meet], two[meet]
        begin = end


def enclosed(lower: Floats, upper: Floats) -> tuple[Ints, Ints]:
    """Find the boxes that lie wholly inside others: the inner and the outer of each pair, (k,)."""
    pairs = [(np.empty(0, dtype=np.int64),) * 2]
    for one, two in overlapping(lower, upper):
        for inner, outer in ((one, two), (two, one)):
            inside = ((lower[outer] < lower[inner]) & (upper[inner] < upper[outer])).all(axis=1)
            pairs.append((inner[inside], outer[inside]))
    inner, outer = (np.concatenate(part) for part in zip(*pairs, strict=True))
    return inner, outer


def overlap_groups(lower: Floats, upper: Floats) -> list[Ints]:
    """Groups of two and more boxes that are connected by overlaps."""
    count = len(lower)
    first = np.arange(count)  # first box of each box's group so far
    for one, two in overlapping(lower, upper):
        first = first_connected(
            count, np.concatenate([one, np.arange(count)]), np.concatenate([two, first])
        )
    order = np.argsort(first, kind="stable")
    groups = np.split(order, np.flatnonzero(np.diff(first[order])) + 1)
    return [members for members in groups if len(members) > 1]


def estimated_overlaps(lower: Floats, upper: Floats, group: Ints) -> float:
    """Estimate the number of pairs of boxes of different groups that overlap.

    Evenly chosen boxes are compared with all others: all of them if there are few.

    Args:
        lower: Lower corner of each box (n, 3).
        upper: Upper corner of each box (n, 3).
        group: Group of each box (n,).
    """
    count = len(lower)
    samples = min(count, max(FEWEST_SAMPLES, SAMPLED // count))
    sample = np.linspace(0, count - 1, samples).astype(np.int64)
    meeting = 0
    for box in sample.tolist():
        meet = ((lower <= upper[box]) & (lower[box] <= upper)).all(axis=1)
        meeting += int((meet & (group != group[box])).sum())
    return meeting / samples * count / 2.0
