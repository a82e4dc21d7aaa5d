"""Slow and obvious versions of what the package computes quickly."""

import itertools
import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog

Floats = NDArray[np.float64]


def angle(a: Floats, b: Floats) -> float:
    return float(np.arctan2(np.linalg.norm(np.cross(a, b)), np.dot(a, b)))


def critical_angle(p1: Floats, n1: Floats, p2: Floats, n2: Floats, *signs: int) -> float:
    """Two fingers, straight from the definition; `signs` +1 squeeze, -1 expand."""
    d = (p2 - p1) / np.linalg.norm(p2 - p1)
    return min(max(angle(n1, s * d), angle(n2, -s * d)) for s in signs or (1, -1))


def closes(p1: Floats, n1: Floats, p2: Floats, n2: Floats, beta: float) -> bool:
    """Force closure of two hard fingers by a linear program over 64-sided friction cones.

    Closed iff non-trivial forces, each strictly inside its cone, balance; strictly inside is asked
    for by a margin: every edge of the cone carries at least a little.
    """
    wrenches = []
    for p, n in ((p1, n1), (p2, n2)):
        edges = cone_edges(n, beta, 64)
        wrenches.append(np.hstack([edges, np.cross(p, edges)]))
    columns = np.vstack(wrenches).T
    count = columns.shape[1]
    answer = linprog(np.zeros(count), A_eq=columns, b_eq=np.zeros(6), bounds=[(1e-6, None)] * count)
    return bool(answer.status == 0)


def cone_edges(normal: Floats, beta: float, count: int) -> Floats:
    axis = np.eye(3)[np.argmin(np.abs(normal))]
    e1 = np.cross(axis, normal)
    e1 /= np.linalg.norm(e1)
    e2 = np.cross(normal, e1)
    turn = np.arange(count) * 2.0 * math.pi / count
    around = np.outer(np.cos(turn), e1) + np.outer(np.sin(turn), e2)
    return np.asarray(math.cos(beta) * normal + math.sin(beta) * around)


def tilted(normal: Floats, most: float, rng: np.random.Generator) -> Floats:
    """A unit vector at most `most` away from `normal`, half of the time on the rim."""
    tilt = most if rng.random() < 0.5 else most * math.sqrt(rng.random())
    return cone_edges(normal, tilt, 360)[rng.integers(360)]


def crossings(
    origin: Floats, direction: Floats, vertices: Floats, faces: NDArray[np.int64]
) -> list[tuple[int, float]]:
    """Every (face, distance) that a ray meets, each triangle tested in 64 bits."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    matrix = np.stack([b - a, c - a, np.broadcast_to(-direction, a.shape)], axis=2)
    regular = np.abs(np.linalg.det(matrix)) > 1e-14
    u, v, t = np.linalg.solve(matrix[regular], (origin - a[regular])[:, :, None])[:, :, 0].T
    inside = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t > 1e-6)
    hits = zip(np.flatnonzero(regular)[inside], t[inside], strict=True)
    return sorted(((int(f), float(d)) for f, d in hits), key=lambda hit: hit[1])


def smallest_angle(normals: Floats, direction: Floats) -> float:
    """Angle to the convex cone of the normals: to its corners, edges and inside, all tried."""
    best = min(angle(n, direction) for n in normals)
    for a, b in itertools.combinations(normals, 2):
        for share in np.linspace(0.0, 1.0, 2001):
            best = min(best, angle((1.0 - share) * a + share * b, direction))
    for triple in itertools.combinations(normals, 3):
        matrix = np.stack(triple, axis=1)
        if abs(np.linalg.det(matrix)) > 1e-9 and (np.linalg.solve(matrix, direction) >= 0.0).all():
            return 0.0
    return best
