"""The shapes of a hand's links as the kernels take them, with points on their surfaces."""

import math
from collections.abc import Sequence, Sized
from typing import NamedTuple

import numpy as np
from scipy.spatial import ConvexHull

from grasp3d._kernels.hands.link_shapes import (
    BOX,
    CAPSULE,
    COARSE,
    CYLINDER,
    HULL,
    SPHERE,
    Hulls,
    LinkShapes,
)
from grasp3d.arrays import Floats, Ints, unit_rows
from grasp3d.hand.link_tree import LinkShape

SPACING = 0.005
"""Approximate distance between the points on the surface of a link [m]."""

THINNED, ALIKE = 0.7 * SPACING, math.cos(math.radians(50.0))
"""Distance [m] below which, and cosine between normals above which, one of two hull points is
dropped."""

KINDS = {"box": BOX, "cylinder": CYLINDER, "capsule": CAPSULE, "sphere": SPHERE, "mesh": HULL}


class Hull(NamedTuple):
    """The convex hull of a mesh; shapes of other kinds have an empty one."""

    vertices: Floats = np.zeros((0, 3))
    neighbours: Sequence[Ints] = ()
    """Neighbours of each vertex."""
    planes: Floats = np.zeros((0, 4))
    triangles: Floats = np.zeros((0, 3, 3))


COVERED = 1e-4
"""Depth inside another shape of the same link beyond which a point cannot touch anything [m]."""


def link_bodies(shapes: Sequence[Sequence[LinkShape]]) -> LinkShapes:
    """Prepare the shapes of all links for the kernels.

    Args:
        shapes: Shapes of each link.
    """
    links = np.repeat(np.arange(len(shapes)), list(map(len, shapes)))
    every = [shape for some in shapes for shape in some]
    hulls = [_hull(shape) for shape in every]
    samples = []
    for number, (link, shape, hull) in enumerate(zip(links, every, hulls, strict=True)):
        same = np.flatnonzero(links == link)
        others = [(every[other], hulls[other].planes) for other in same if other != number]
        samples.append(_uncovered(_samples(shape, hull.triangles), shape, others))
    first_vertex = _starts([hull.vertices for hull in hulls])
    neighbours = [
        start + other
        for hull, start in zip(hulls, first_vertex, strict=False)
        for other in hull.neighbours
    ]
    return LinkShapes(
        kinds=np.array([KINDS[shape.kind] for shape in every], dtype=np.int64),
        links=links,
        poses=np.array([shape.pose[:3] for shape in every]).reshape(-1, 3, 4),
        sizes=np.array([(*shape.size, 0.0, 0.0, 0.0)[:3] for shape in every]).reshape(-1, 3),
        boxes=np.array([_box(shape) for shape in every]).reshape(-1, 7),
        hull=Hulls(
            vertices=np.concatenate([np.zeros((0, 3)), *(hull.vertices for hull in hulls)]),
            first=_starts(neighbours),
            neighbours=np.concatenate([np.zeros(0, np.int64), *neighbours]),
            at=first_vertex[:-1],
        ),
        first_plane=_starts([hull.planes for hull in hulls]),
        planes=np.concatenate([np.zeros((0, 4)), *(hull.planes for hull in hulls)]),
        first_sample=_starts(samples),
        samples=np.concatenate([np.zeros((0, 6)), *samples]),
    )  # fmt: skip


def reach_along(shape: LinkShape, directions: Floats) -> Floats:
    """How far a shape reaches along directions (k, 3) in its frame, shape (k,)."""
    if shape.kind == "mesh":
        return np.asarray((directions @ shape.vertices.T).max(axis=1))
    if shape.kind == "box":
        return np.asarray(np.abs(directions) @ np.array(shape.size))
    radius, *half = shape.size
    around = np.hypot(*directions.T[:2]) if shape.kind == "cylinder" else 1.0
    return np.asarray(radius * around + sum(half) * np.abs(directions[:, 2]))


def half_widths(bodies: LinkShapes, shapes: Sequence[LinkShape]) -> Floats:
    """Half the smallest width of each shape [m]; hulls are measured across their faces."""
    widths = bodies.boxes[:, 3:6].min(axis=1)
    for body, shape in enumerate(shapes):
        if shape.kind == "mesh":
            planes: Floats = bodies.planes[bodies.first_plane[body] : bodies.first_plane[body + 1]]
            across = planes[:, 3] + reach_along(shape, -planes[:, :3])
            widths[body] = 0.5 * across.min()
    return np.asarray(widths)


def _starts(parts: Sequence[Sized]) -> Ints:
    return np.cumsum([0, *map(len, parts)])


def _box(shape: LinkShape) -> Floats:
    """Bounding box of a shape in its frame, and radius of its ball about the box's centre."""
    high, low = reach_along(shape, np.eye(3)), -reach_along(shape, -np.eye(3))
    centre, half = 0.5 * (low + high), 0.5 * (high - low)
    if shape.kind == "mesh":
        radius = float(np.linalg.norm(shape.vertices - centre, axis=1).max())
    else:
        radius = half[2] if shape.kind in {"sphere", "capsule"} else math.hypot(*shape.size)
    return np.array([*centre, *half, radius])


def _hull(shape: LinkShape) -> Hull:
    """The convex hull of a mesh: corners, neighbours, planes and triangles; else an empty one."""
    if shape.kind != "mesh":
        return Hull()
    hull = ConvexHull(shape.vertices)
    used, faces = np.unique(hull.simplices, return_inverse=True)
    vertices, faces = shape.vertices[used], faces.reshape(-1, 3)
    edges = np.concatenate([faces[:, [i, j]] for i in range(3) for j in range(3) if i != j])
    edges = np.unique(edges, axis=0)
    neighbours = np.split(edges[:, 1], np.flatnonzero(np.diff(edges[:, 0])) + 1)
    outward = hull.equations[:, :3]
    triangles = vertices[faces]
    normal = np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    turned = np.einsum("ij,ij->i", normal, outward) < 0.0
    triangles[turned] = triangles[turned][:, ::-1]
    outward, first = np.unique(outward.round(12), axis=0, return_index=True)
    if len(outward) > COARSE:  # first the largest faces, and planes in other directions
        area = np.linalg.norm(normal[first], axis=1)
        large = outward[np.argsort(-area)[: COARSE // 4]]
        outward = np.concatenate([large, _directions(COARSE - len(large)), outward])
    heights = (outward @ vertices.T).max(axis=1)
    return Hull(vertices, neighbours, np.column_stack([outward, heights]), triangles)


def _directions(count: int) -> Floats:
    """Unit vectors spread evenly (Fibonacci's spiral), shape (count, 3)."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = math.pi * (3.0 - math.sqrt(5.0)) * np.arange(count)
    across = np.sqrt(1.0 - z * z)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)


def _line(half: float) -> Floats:
    return np.linspace(-half, half, math.ceil(2.0 * half / SPACING) + 1)


def _circle(radius: float) -> Floats:
    """Unit vectors around a circle, shape (n, 2)."""
    turn = 2.0 * math.pi * np.arange(n := max(8, math.ceil(2.0 * math.pi * radius / SPACING))) / n
    return np.stack([np.cos(turn), np.sin(turn)], axis=1)


def _samples(shape: LinkShape, hull: Floats) -> Floats:
    """Points on the surface of a shape in its frame, and outward unit normals, shape (s, 6).

    For a mesh they are on the triangles of its hull.
    """
    if shape.kind == "mesh":
        return _hull_samples(hull)
    if shape.kind == "box":
        return _box_samples(shape.size)
    radius, *half = shape.size
    ball = _directions(max(24, math.ceil(4.0 * math.pi * (radius / SPACING) ** 2)))
    ends = np.hstack([radius * ball, ball])
    if not half:
        return ends
    around, heights = _circle(radius), _line(half[0])
    side = np.zeros((len(heights), len(around), 6))
    side[..., :2], side[..., 2], side[..., 3:5] = radius * around, heights[:, None], around
    ends[:, 2] += np.sign(ball[:, 2]) * half[0]
    if shape.kind == "cylinder":
        radii = radius * np.arange(1, (rings := math.ceil(radius / SPACING)) + 1) / rings
        disc = np.concatenate([np.zeros((1, 2)), *(one * _circle(one) for one in radii)])
        ends = np.zeros((2, len(disc), 6))
        ends[..., :2], ends[..., 2], ends[..., 5] = disc, [[-half[0]], half], [[-1.0], [1.0]]
    return np.concatenate([side.reshape(-1, 6), ends.reshape(-1, 6)])


def _box_samples(size: Sequence[float]) -> Floats:
    parts = []
    for axis in range(3):
        i, j = (axis + 1) % 3, (axis + 2) % 3
        a, b = (grid.ravel() for grid in np.meshgrid(_line(size[i]), _line(size[j])))
        for sign in (-1.0, 1.0):
            rows = np.zeros((len(a), 6))
            rows[:, i], rows[:, j] = a, b
            rows[:, axis], rows[:, 3 + axis] = sign * size[axis], sign
            parts.append(rows)
    return np.concatenate(parts)


def _hull_samples(triangles: Floats) -> Floats:
    """Points on triangles, thinned to about the spacing, with normals, shape (s, 6)."""
    normals = unit_rows(
        np.cross(triangles[:, 1] - triangles[:, 0], triangles[:, 2] - triangles[:, 0])
    )
    edges = np.linalg.norm(triangles - np.roll(triangles, 1, axis=1), axis=2)
    divisions = np.maximum(np.ceil(edges.max(axis=1) / SPACING), 1.0).astype(int)
    rows = []
    for steps in np.unique(divisions):
        some = divisions == steps
        i, j = np.array([(i, j) for i in range(steps + 1) for j in range(steps + 1 - i)]).T / steps
        points = np.stack([1.0 - i - j, i, j], axis=1) @ triangles[some]  # (t, n, 3)
        around = np.broadcast_to(normals[some, None], points.shape)
        rows.append(np.concatenate([points, around], axis=2).reshape(-1, 6))
    samples = np.concatenate(rows)
    # The faces at a sharp edge keep separate points.
    cells = np.hstack([np.floor(samples[:, :3] / SPACING), np.round(samples[:, 3:])])
    _, first = np.unique(cells, axis=0, return_index=True)
    samples, number = samples[np.sort(first)], 0
    while number < len(samples):
        away = np.linalg.norm(samples[:, :3] - samples[number, :3], axis=1)
        like = (away < THINNED) & (samples[:, 3:] @ samples[number, 3:] > ALIKE)
        like[: number + 1] = False
        samples, number = samples[~like], number + 1
    return samples


def _uncovered(
    samples: Floats, shape: LinkShape, others: Sequence[tuple[LinkShape, Floats]]
) -> Floats:
    """Points of a shape outside the other shapes of its link; those inside can touch nothing."""
    points = samples[:, :3] @ shape.pose[:3, :3].T + shape.pose[:3, 3]
    covered = np.zeros(len(points), dtype=bool)
    for other, planes in others:
        local = (points - other.pose[:3, 3]) @ other.pose[:3, :3]
        covered |= _depth(local, other, planes) < -COVERED
    return samples[~covered]


def _depth(points: Floats, shape: LinkShape, planes: Floats) -> Floats:
    """Signed distance of points, in a shape's frame, from its surface; exact inside the shape."""
    if shape.kind == "box":
        return np.asarray((np.abs(points) - np.array(shape.size)).max(axis=1))
    if shape.kind == "mesh":
        return np.asarray((points @ planes[:, :3].T - planes[:, 3]).max(axis=1))
    radius, *half = shape.size
    beyond = np.abs(points[:, 2]) - sum(half)
    across = np.linalg.norm(points[:, :2], axis=1)
    if shape.kind == "cylinder":
        return np.asarray(np.maximum(across - radius, beyond))
    return np.asarray(np.hypot(across, np.maximum(beyond, 0.0)) - radius)
