"""Slow, simple reference implementations of the package's computations."""

import itertools
import math

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import linprog, minimize_scalar
from scipy.spatial import ConvexHull

from grasp3d import Contacts

Floats = NDArray[np.float64]


def angle(a: Floats, b: Floats) -> float:
    (x, y, z), (u, v, w) = a.tolist(), b.tolist()  # `np.cross` takes ten times as long
    across = math.hypot(y * w - z * v, z * u - x * w, x * v - y * u)
    return math.atan2(across, x * u + y * v + z * w)


def angles_between(a: Floats, b: Floats) -> Floats:
    """Angles between vectors (..., 3)."""
    x, y, z, u, v, w = (c[..., k] for c in (a, b) for k in range(3))
    across = (y * w - z * v, z * u - x * w, x * v - y * u)
    return np.asarray(
        np.arctan2(np.sqrt(sum(part * part for part in across)), x * u + y * v + z * w)
    )


def critical_angle(p1: Floats, n1: Floats, p2: Floats, n2: Floats, *signs: int) -> float:
    """Critical angle of two fingers, by the definition; `signs` +1: external, -1: internal."""
    d = (p2 - p1) / np.linalg.norm(p2 - p1)
    return min(max(angle(n1, s * d), angle(n2, -s * d)) for s in signs or (1, -1))


def force_closed(p1: Floats, n1: Floats, p2: Floats, n2: Floats, beta: float) -> bool:
    """Force closure of two hard fingers by a linear program over 64-sided friction cones.

    Force-closed exactly if nonzero forces, each strictly inside its cone, are in equilibrium.
    Strictly inside means here that every edge of the cone has a weight of at least 1e-6.
    """
    wrenches = []
    for p, n in ((p1, n1), (p2, n2)):
        edges = cone_edges(n, beta, 64)
        wrenches.append(np.hstack([edges, np.cross(p, edges)]))
    columns = np.vstack(wrenches).T
    count = columns.shape[1]
    result = linprog(np.zeros(count), A_eq=columns, b_eq=np.zeros(6), bounds=[(1e-6, None)] * count)
    return bool(result.status == 0)


def cone_edges(normal: Floats, beta: float, count: int) -> Floats:
    axis = np.eye(3)[np.argmin(np.abs(normal))]
    e1 = np.cross(axis, normal)
    e1 /= np.linalg.norm(e1)
    e2 = np.cross(normal, e1)
    angles = np.arange(count) * 2.0 * math.pi / count
    tangents = np.outer(np.cos(angles), e1) + np.outer(np.sin(angles), e2)
    return np.asarray(math.cos(beta) * normal + math.sin(beta) * tangents)


def tilted(normal: Floats, largest: float, rng: np.random.Generator) -> Floats:
    """Random unit vector within the angle `largest` of `normal`, half of the time on the rim."""
    tilt = largest if rng.random() < 0.5 else largest * math.sqrt(rng.random())
    return cone_edges(normal, tilt, 360)[rng.integers(360)]


def crossings(
    origin: Floats, direction: Floats, vertices: Floats, faces: NDArray[np.int64]
) -> list[tuple[int, float]]:
    """Every (face, distance) at which a ray crosses a triangle, in double precision."""
    a, b, c = (vertices[faces[:, k]] for k in range(3))
    matrix = np.stack([b - a, c - a, np.broadcast_to(-direction, a.shape)], axis=2)
    regular = np.abs(np.linalg.det(matrix)) > 1e-14
    u, v, t = np.linalg.solve(matrix[regular], (origin - a[regular])[:, :, None])[:, :, 0].T
    inside = (u >= 0.0) & (v >= 0.0) & (u + v <= 1.0) & (t > 1e-6)
    hits = zip(np.flatnonzero(regular)[inside], t[inside], strict=True)
    return sorted(((int(f), float(d)) for f, d in hits), key=lambda hit: hit[1])


def smallest_angle(normals: Floats, direction: Floats) -> float:
    """Angle to the convex cone of the normals, by sampling its corners, edges and interior."""
    best = min(angle(n, direction) for n in normals)
    fractions = np.linspace(0.0, 1.0, 2001)[:, None]
    for a, b in itertools.combinations(normals, 2):
        between = (1.0 - fractions) * a + fractions * b
        across = np.linalg.norm(np.cross(between, direction), axis=1)
        best = min(best, float(np.arctan2(across, between @ direction).min()))
    for triple in itertools.combinations(normals, 3):
        matrix = np.stack(triple, axis=1)
        if abs(np.linalg.det(matrix)) > 1e-9 and (np.linalg.solve(matrix, direction) >= 0.0).all():
            return 0.0
    return best


def turned(normal: Floats, goal: Floats, tilt: float) -> Floats:
    """Turn a unit vector by `tilt` toward a goal, but not past it; away from it if negative."""
    gap = angle(normal, goal)
    across = goal - np.dot(goal, normal) * normal
    if np.linalg.norm(across) <= 1e-12 * np.linalg.norm(goal):  # parallel, or no goal
        across = cone_edges(normal, math.pi / 2.0, 3)[0]
    across = across / np.linalg.norm(across)
    turn = max(min(tilt, gap), gap - math.pi)
    return np.asarray(math.cos(turn) * normal + math.sin(turn) * across)


def velocities(contacts: Contacts, u: Floats, torque_scale: float = 1.0) -> Floats:
    """Velocities of the contact points in a motion u of the object: u_f + (u_tau x p) / rho."""
    return np.asarray(u[:3] + np.cross(u[3:], contacts.points) / torque_scale)


def support(
    contacts: Contacts,
    u: Floats,
    *,
    cone_offset: float = 0.0,
    actuation: str = "total",
    torque_scale: float = 1.0,
) -> float:
    """Support function of the grasp wrench space of circular cones, from angles to the normals.

    For a soft finger with an elliptic limit surface it follows by duality: it is the distance of g
    from the velocities with which, at its twist, no force of the finger does work.
    """
    supports = []
    for i, g in enumerate(velocities(contacts, u, torque_scale)):
        beta = max(float(contacts.friction_angle[i]) + cone_offset, 0.0)
        outside = max(0.0, angle(g, contacts.normals[i]) - beta)
        value = float(np.linalg.norm(g)) * math.cos(outside)
        twist = abs(np.dot(u[3:], contacts.normals[i])) * contacts.torsion_radius[i] / torque_scale
        if twist > 0.0:
            value = _distance_from_idle(g, contacts.normals[i], math.tan(beta), twist)
        supports.append(max(value, 0.0))
    return max(supports) if actuation == "total" else sum(supports)


def _distance_from_idle(g: Floats, normal: Floats, friction: float, twist: float) -> float:
    """Smallest |g - x| over all x with x_n + sqrt(mu^2 |x_t|^2 + twist^2) <= 0."""
    along = float(np.dot(g, normal))
    across = float(np.linalg.norm(g - along * normal))

    def distance(x: float) -> float:
        return math.hypot(across - x, max(along + math.hypot(friction * x, twist), 0.0))

    bounds, options = (0.0, across), {"xatol": 1e-12}
    found = minimize_scalar(
        lambda x: distance(x) ** 2, bounds=bounds, method="bounded", options=options
    )
    return min(map(distance, (float(found.x), *bounds)))


def epsilon_of_hull(rows: Floats) -> float:
    """Distance from the origin to the nearest facet of the convex hull, by Qhull.

    Negative if the origin is outside. Raises scipy.spatial.QhullError if Qhull fails.
    """
    _, sizes, basis = np.linalg.svd(rows)
    rank = int((sizes > 1e-7 * sizes[0]).sum())
    return float(-ConvexHull(rows @ basis[:rank].T).equations[:, -1].max())


def smallest_angles_to_normals(points: Floats, normals: Floats, directions: Floats) -> Floats:
    """Smallest angle between a contact's velocity and its normal, for each direction."""
    velocity = directions[:, None, :3] + np.cross(directions[:, None, 3:], points)  # (k, n, 3)
    across = np.linalg.norm(np.cross(velocity, normals), axis=-1)
    return np.asarray(np.arctan2(across, (velocity * normals).sum(axis=-1)).min(axis=-1))


def distance_to_triangles(point: Floats, triangles: Floats) -> Floats:
    """Distances of a point to triangles (F, 3, 3), by feet of perpendiculars and by edges."""
    ends = [(triangles[:, i], triangles[:, (i + 1) % 3]) for i in range(3)]
    distances = []
    for p, q in ends:
        along = ((point - p) * (q - p)).sum(axis=1) / ((q - p) ** 2).sum(axis=1)
        feet = p + np.clip(along, 0.0, 1.0)[:, None] * (q - p)
        distances.append(np.linalg.norm(feet - point, axis=1))
    across = np.cross(ends[0][1] - ends[0][0], ends[1][1] - ends[1][0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    height = ((point - triangles[:, 0]) * across).sum(axis=1)
    foot = point - height[:, None] * across
    inside = [(np.cross(q - p, foot - p) * across).sum(axis=1) >= 0.0 for p, q in ends]
    distances.append(np.where(np.all(inside, axis=0), np.abs(height), math.inf))
    return np.asarray(np.min(distances, axis=0))
