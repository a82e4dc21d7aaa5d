"""The shapes of a hand's links as the kernels take them, with points on their surfaces."""

import math
from collections.abc import Iterable, Sequence

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
"""About how far apart the points on the surface of a link are [m]."""

THINNED, ALIKE = 0.7 * SPACING, math.cos(math.radians(50.0))
"""Of two points of a hull that are nearer than this [m], with normals whose cosine is larger, one
is dropped."""

KINDS = {"box": BOX, "cylinder": CYLINDER, "capsule": CAPSULE, "sphere": SPHERE, "mesh": HULL}

Hull = tuple[Floats, list[Ints], Floats, Floats]
"""Corners, neighbours of each, planes, triangles."""

COVERED = 1e-4
"""Depth in another shape of its link beyond which a point cannot touch anything [m]."""


def link_bodies(shapes: Sequence[Sequence[LinkShape]]) -> LinkShapes:
    """Prepare the shapes of all links.

    Args:
        shapes: Those of each link.
    """
    bodies = [(link, shape) for link, some in enumerate(shapes) for shape in some]
    hulls = [_hull(shape) for _, shape in bodies]
    samples = [
        _uncovered(_samples(shape, hull), number, bodies, hulls)
        for number, ((_, shape), hull) in enumerate(zip(bodies, hulls, strict=True))
    ]
    first_vertex = _starts([len(hull[0]) for hull in hulls])
    neighbours = [
        start + other for hull, start in zip(hulls, first_vertex, strict=False) for other in hull[1]
    ]
    return LinkShapes(
        kinds=np.array([KINDS[shape.kind] for _, shape in bodies], dtype=np.int64),
        links=np.array([link for link, _ in bodies], dtype=np.int64),
        poses=np.array([shape.pose[:3] for _, shape in bodies]).reshape(-1, 3, 4),
        sizes=np.array([(*shape.size, 0.0, 0.0, 0.0)[:3] for _, shape in bodies]).reshape(-1, 3),
        boxes=np.array(
            [_box(shape, hull[0]) for (_, shape), hull in zip(bodies, hulls, strict=True)]
        ).reshape(-1, 7),
        hull=Hulls(
            vertices=np.concatenate([np.zeros((0, 3)), *(hull[0] for hull in hulls)]),
            first=_starts([len(other) for other in neighbours]),
            neighbours=np.concatenate([np.zeros(0, np.int64), *neighbours]),
            at=first_vertex[:-1],
        ),
        first_plane=_starts([len(hull[2]) for hull in hulls]),
        planes=np.concatenate([np.zeros((0, 4)), *(hull[2] for hull in hulls)]),
        first_sample=_starts([len(rows) for rows in samples]),
        samples=np.concatenate([np.zeros((0, 6)), *samples]),
    )


def reach_along(bodies: LinkShapes, body: int, directions: Floats) -> Floats:
    """How far a shape reaches along directions (k, 3) in its frame, shape (k,)."""
    kind, size = bodies.kinds[body], bodies.sizes[body]
    if kind == HULL:
        vertices = bodies.hull.vertices[bodies.hull.at[body] :]
        if body + 1 < len(bodies.kinds):
            vertices = vertices[: bodies.hull.at[body + 1] - bodies.hull.at[body]]
        return np.asarray((directions @ vertices.T).max(axis=1))
    if kind == BOX:
        return np.asarray(np.abs(directions) @ size)
    around = np.ones(len(directions)) if kind != CYLINDER else np.hypot(*directions.T[:2])
    along = size[1] if kind != SPHERE else 0.0
    return np.asarray(size[0] * around + along * np.abs(directions[:, 2]))


def half_widths(bodies: LinkShapes) -> Floats:
    """Half the smallest width of each shape [m]; of hulls that across a face."""
    widths = bodies.boxes[:, 3:6].min(axis=1)
    for body in np.flatnonzero(bodies.kinds == HULL).tolist():
        planes: Floats = bodies.planes[bodies.first_plane[body] : bodies.first_plane[body + 1]]
        across = planes[:, 3] + reach_along(bodies, body, -planes[:, :3])
        widths[body] = 0.5 * across.min()
    return np.asarray(widths)


def _starts(sizes: Iterable[int]) -> Ints:
    return np.concatenate([[0], np.cumsum(np.array(sizes, dtype=np.int64))]).astype(np.int64)


def _box(shape: LinkShape, vertices: Floats) -> Floats:
    """Box around a shape in its frame, and radius of the ball around the box's centre."""
    if shape.kind == "mesh":
        low, high = vertices.min(axis=0), vertices.max(axis=0)
        centre, half = 0.5 * (low + high), 0.5 * (high - low)
        radius = float(np.linalg.norm(vertices - centre, axis=1).max())
        return np.array([*centre, *half, radius])
    size = shape.size
    if shape.kind == "box":
        half, radius = np.array(size), math.hypot(*size)
    elif shape.kind == "sphere":
        half, radius = np.full(3, size[0]), size[0]
    else:
        capsule = shape.kind == "capsule"
        half = np.array([size[0], size[0], size[1] + capsule * size[0]])
        radius = half[2] if capsule else math.hypot(*size)
    return np.array([0.0, 0.0, 0.0, *half, radius])


def _hull(shape: LinkShape) -> Hull:
    """Corners of a mesh's hull, their neighbours, its planes, and its triangles; else none."""
    if shape.kind != "mesh":
        return np.zeros((0, 3)), [], np.zeros((0, 4)), np.zeros((0, 3, 3))
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
    if len(outward) > COARSE:  # the largest faces', and those that support it in other directions
        area = np.linalg.norm(normal[first], axis=1)
        large = outward[np.argsort(-area)[: COARSE // 4]]
        outward = np.concatenate([large, _directions(COARSE - len(large)), outward])
    heights = (outward @ vertices.T).max(axis=1)
    return vertices, neighbours, np.column_stack([outward, heights]), triangles


def _directions(count: int) -> Floats:
    """Unit vectors spread evenly (Fibonacci's spiral), shape (count, 3)."""
    z = 1.0 - (2.0 * np.arange(count) + 1.0) / count
    turn = math.pi * (3.0 - math.sqrt(5.0)) * np.arange(count)
    across = np.sqrt(1.0 - z * z)
    return np.stack([across * np.cos(turn), across * np.sin(turn), z], axis=1)


def _line(half: float) -> Floats:
    return np.linspace(-half, half, math.ceil(2.0 * half / SPACING) + 1)


def _disc(radius: float) -> Floats:
    """Points of a disc, its rim among them, shape (n, 2)."""
    rings = math.ceil(radius / SPACING)
    radii = radius * np.arange(1, rings + 1) / rings
    return np.concatenate([np.zeros((1, 2)), *(one * _circle(one) for one in radii)])


def _circle(radius: float) -> Floats:
    """Unit vectors around a circle, shape (n, 2)."""
    turn = 2.0 * math.pi * np.arange(n := max(8, math.ceil(2.0 * math.pi * radius / SPACING))) / n
    return np.stack([np.cos(turn), np.sin(turn)], axis=1)


def _samples(shape: LinkShape, hull: Hull) -> Floats:
    """Points on the surface of a shape in its frame, and outward unit normals, shape (s, 6)."""
    size = shape.size
    if shape.kind == "mesh":
        return _hull_samples(hull[3])
    if shape.kind == "box":
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
    radius = size[0]
    if shape.kind == "sphere":
        around = _directions(max(24, math.ceil(4.0 * math.pi * (radius / SPACING) ** 2)))
        return np.hstack([radius * around, around])
    around, heights = _circle(radius), _line(size[1])
    side = np.zeros((len(heights), len(around), 6))
    side[..., :2], side[..., 2], side[..., 3:5] = radius * around, heights[:, None], around
    if shape.kind == "cylinder":
        disc = _disc(radius)
        ends = np.zeros((2, len(disc), 6))
        ends[..., :2], ends[..., 2], ends[..., 5] = disc, [[-size[1]], [size[1]]], [[-1.0], [1.0]]
    else:
        ball = _directions(max(24, math.ceil(4.0 * math.pi * (radius / SPACING) ** 2)))
        ends = np.hstack([radius * ball, ball])
        ends[:, 2] += np.sign(ball[:, 2]) * size[1]
    return np.concatenate([side.reshape(-1, 6), ends.reshape(-1, 6)])


def _hull_samples(triangles: Floats) -> Floats:
    """Points on triangles, one in each cube of the spacing, shape (s, 6)."""
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
    # Faces of a sharp edge have points of their own.
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
    samples: Floats,
    number: int,
    bodies: Sequence[tuple[int, LinkShape]],
    hulls: Sequence[Hull],
) -> Floats:
    """Points of a shape that are not inside other shapes of its link: nothing touches these."""
    link, shape = bodies[number]
    points = samples[:, :3] @ shape.pose[:3, :3].T + shape.pose[:3, 3]
    covered = np.zeros(len(points), dtype=bool)
    for other, ((its_link, body), hull) in enumerate(zip(bodies, hulls, strict=True)):
        if its_link == link and other != number:
            local = (points - body.pose[:3, 3]) @ body.pose[:3, :3]
            covered |= _depth(local, body, hull[2]) < -COVERED
    return samples[~covered]


def _depth(points: Floats, shape: LinkShape, planes: Floats) -> Floats:
    """Signed distance of points from a shape's surface, inside exact, in its frame."""
    size = shape.size
    if shape.kind == "box":
        return np.asarray((np.abs(points) - np.array(size)).max(axis=1))
    if shape.kind == "mesh":
        return np.asarray((points @ planes[:, :3].T - planes[:, 3]).max(axis=1))
    if shape.kind == "sphere":
        return np.asarray(np.linalg.norm(points, axis=1) - size[0])
    beyond = np.abs(points[:, 2]) - size[1]
    across = np.linalg.norm(points[:, :2], axis=1)
    if shape.kind == "capsule":
        return np.asarray(np.hypot(across, np.maximum(beyond, 0.0)) - size[0])
    return np.asarray(np.maximum(across - size[0], beyond))
