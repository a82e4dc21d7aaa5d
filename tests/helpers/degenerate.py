"""Grasps whose contacts coincide, nearly coincide or lie on a line, and oracles for them.

The oracles start from the definition: a grasp is force-closed if its wrenches positively span their
own span. So it is not if some motion u moves no contact into its friction cone and at least one
strictly away from it. A contact that the motion leaves at rest has wrenches orthogonal to u, and
counts as neither. So motions are divided by the contacts that they leave at rest: none, all at one
point (rotations about that point), or all on one line (the rotation about it). Within each family
the critical friction angle is the largest, over u, of the smallest angle between a moving contact's
velocity and its normal, less 90 degrees. That is a quasi-concave problem of at most six variables.
The ellipsoid method solves it with a proof, without hulls.
"""

import itertools
import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from grasp3d import Contacts
from grasp3d.quality import ForceClosure
from tests.helpers.oracles import angles_between

Floats = NDArray[np.float64]
Bools = NDArray[np.bool_]

RIGHT = math.pi / 2.0
ACCURACY = 1e-6
"""Gap that the ellipsoid method leaves below the critical angle [rad]."""

STEPS = 6000
"""Largest number of cuts of an ellipsoid."""


def cross_matrix(v: Floats) -> Floats:
    """Matrices of the cross product: `cross_matrix(v) @ w` is v x w, shape (..., 3, 3)."""
    x, y, z = np.moveaxis(np.asarray(v, dtype=np.float64), -1, 0)
    zero = np.zeros_like(x)
    rows = [[zero, -z, y], [z, zero, -x], [-y, x, zero]]
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)


def offsets(points: Floats) -> tuple[Floats, Floats, Floats]:
    """Split points (n, 3) into positions on a line (n,), offsets from it (n, 3), its direction.

    Differences of nearby points are exact, so the offsets of two clusters have no rounding errors
    of the size of the grasp.
    """
    far = int(np.argmax(np.linalg.norm(points - points[0], axis=1)))
    line = points[far] - points[0]
    length = float(np.linalg.norm(line))
    if length == 0.0:
        return np.zeros(len(points)), np.zeros_like(points), np.array([1.0, 0.0, 0.0])
    to_first, to_far = points - points[0], points - points[far]
    near_far = np.linalg.norm(to_far, axis=1) < np.linalg.norm(to_first, axis=1)
    base = np.where(near_far, 1.0, 0.0)
    rest = np.where(near_far[:, None], to_far, to_first) / length
    return base, rest, line / length


def general_maps(points: Floats, *, on_line: bool) -> Floats:
    """Velocities of all motions of one grasp, shape (n, 3, d): d is 3, 5 or 6, the wrenches' rank.

    The coordinates of u are a translation, rotations across the line of `offsets`, and the rotation
    about this line divided by the contacts' distance from it.
    """
    base, rest, line = offsets(points)
    maps = np.zeros((len(points), 3, 6))
    maps[:, :, :3] = np.eye(3)
    if not (base > 0.0).any():
        return maps[:, :, :3]
    axes = np.linalg.svd(line[None])[2][1:]
    for k, axis in enumerate(axes):
        maps[:, :, 3 + k] = np.cross(axis, base[:, None] * line + rest)
    turning = np.cross(line, rest)
    width = float(np.linalg.norm(turning, axis=1).max())
    if on_line or width == 0.0:
        return maps[:, :, :5]
    maps[:, :, 5] = turning / width
    return maps


def rotations(points: Floats, at: int, *, on_line: bool) -> Floats:
    """Velocities in rotations about a contact's point, scaled to the contacts' distances from it.

    Shape (n, 3, 3), or (n, 3, 2) for contacts on a line, without the rotation about this line.
    """
    arms = points - points[at]
    sizes = np.linalg.norm(arms, axis=1)
    far = arms[sizes.argmax()]
    on_line = on_line or not np.cross(arms, far).any()
    arms /= np.where(sizes > 0.0, sizes, 1.0)[:, None]
    maps = -cross_matrix(arms)
    return maps @ np.linalg.svd(far[None])[2][1:].T if on_line else maps


def rotation_about_line(points: Floats, a: int, b: int, *, on_line: bool) -> Floats:
    """Velocities of contacts (n, 3) in the rotation about the line of two of them, 0 on it."""
    axis = points[b] - points[a]
    to_a, to_b = points - points[a], points - points[b]
    nearer = np.linalg.norm(to_b, axis=1) < np.linalg.norm(to_a, axis=1)
    arms = np.where(nearer[:, None], to_b, to_a)
    moved = np.cross(axis / np.linalg.norm(axis), arms)
    sizes = np.linalg.norm(moved, axis=1)
    resting = sizes <= 1e-14 * np.linalg.norm(arms, axis=1)
    return np.zeros_like(moved) if on_line else np.where(resting[:, None], 0.0, moved)


def angles_to(velocities: Floats, normals: Floats) -> Floats:
    """Angles between velocities and normals (...), pi where a contact is at rest."""
    resting = (velocities == 0.0).all(axis=-1)
    return np.where(resting, math.pi, angles_between(velocities, normals))


def largest_separation(maps: Floats, normals: Floats) -> tuple[Floats, Bools]:
    """Largest angle by which motions (r, n, 3, d), d > 1, separate grasps (r, n, 3), by ellipsoids.

    Returns (angle, proven): the largest, over u, of the smallest angle between velocity and normal
    less 90 degrees, at least 0 (r,); and whether no angle is more than `ACCURACY` above it (r,).
    """
    count, _, _, dim = maps.shape
    best = np.zeros(count)
    proven = np.zeros(count, dtype=np.bool_)
    moving = (maps != 0.0).any(axis=(2, 3))
    rows = np.flatnonzero(moving.any(axis=1))
    proven[~moving.any(axis=1)] = True
    g_maps, g_normals, g_moving = maps[rows], normals[rows], moving[rows]
    shape = np.broadcast_to(np.eye(dim), (len(rows), dim, dim)).copy()
    centre = np.zeros((len(rows), dim))
    for step in range(STEPS):
        if not len(rows):
            break
        each = np.arange(len(rows))
        if step == 0:  # every motion that separates moves a moving contact against its normal
            i = g_moving.argmax(axis=1)
            depth = np.zeros(len(rows))
            cut = np.einsum("rkd,rk->rd", g_maps[each, i], g_normals[each, i])
        else:
            velocity = np.einsum("rnkd,rd->rnk", g_maps, centre)
            angle = np.where(g_moving, angles_to(velocity, g_normals), math.inf)
            i = angle.argmin(axis=1)
            best[rows] = np.maximum(best[rows], np.minimum(angle[each, i], math.pi) - RIGHT)
            sine = np.sin(np.minimum(best[rows] + ACCURACY, RIGHT))
            g = velocity[each, i]
            size = np.maximum(np.linalg.norm(g, axis=1), 1e-300)
            cut = np.einsum(
                "rkd,rk->rd", g_maps[each, i], g_normals[each, i] + (sine / size)[:, None] * g
            )
            depth = np.maximum((cut * centre).sum(axis=1), 0.0)
        product = np.einsum("rde,re->rd", shape, cut)
        square = (cut * product).sum(axis=1)
        length = np.sqrt(np.maximum(square, 1e-300))
        depth = depth / length
        done = (depth >= 1.0) | (best[rows] >= RIGHT - ACCURACY) | ~(square > 1e-200)
        proven[rows[done]] = np.isfinite(square[done])
        depth = np.where(done, 0.0, depth)
        step_to = product / length[:, None]
        centre = centre - ((1.0 + dim * depth) / (dim + 1.0))[:, None] * step_to
        factor = dim * dim * (1.0 - depth * depth) / (dim * dim - 1.0)
        weight = 2.0 * (1.0 + dim * depth) / ((dim + 1.0) * (1.0 + depth))
        outer = step_to[:, :, None] * step_to[:, None, :]
        shape = factor[:, None, None] * (shape - weight[:, None, None] * outer)
        shape = 0.5 * (shape + shape.transpose(0, 2, 1))
        if done.any():
            keep = ~done
            rows, shape, centre = rows[keep], shape[keep], centre[keep]
            g_maps, g_normals, g_moving = g_maps[keep], g_normals[keep], g_moving[keep]
    return best, proven


def at_one_point(normals: Floats) -> float:
    """Critical angle of contacts (n, 3) at one point: the farthest direction from all normals.

    This direction is opposite to one normal, halfway between two, or equally far from three. If it
    is less than 90 degrees away, the grasp is force-closed without friction.
    """
    candidates = [-n for n in normals]
    for a, b in itertools.combinations(normals, 2):
        candidates += [a + b, -a - b]
    for a, b, c in itertools.combinations(normals, 3):
        pole = np.cross(a, b) + np.cross(b, c) + np.cross(c, a)
        candidates += [pole, -pole]
    units = [c / np.linalg.norm(c) for c in candidates if np.linalg.norm(c) > 1e-12]
    if len(normals) == 2:  # opposite normals: any direction across them
        units += list(np.linalg.svd(normals)[2][-1:])
    u = np.array(units)[:, None]
    farthest = angles_to(np.broadcast_to(u, (len(u), len(normals), 3)), normals).min(axis=1).max()
    return min(float(farthest) - RIGHT, RIGHT)


def critical_angles(points: Floats, normals: Floats, on_line: Bools) -> tuple[Floats, Bools]:
    """Critical friction angles of grasps (b, n, 3) of 3 to 5 contacts, at most 90 degrees; proven.

    Points are taken as they are, unless the contacts count as being on a line from which rounding
    has moved them.
    """
    angles, proven = np.zeros(len(points)), np.ones(len(points), dtype=np.bool_)
    families: dict[int, tuple[list[int], list[Floats]]] = {}

    def add(grasp: int, maps: Floats) -> None:
        rows, found = families.setdefault(maps.shape[-1], ([], []))
        rows.append(grasp)
        found.append(maps)

    for g, (p, n) in enumerate(zip(points, normals, strict=True)):
        firsts = [i for i in range(len(p)) if not (p[:i] == p[i]).all(axis=1).any()]
        if len(firsts) == 1:
            angles[g] = at_one_point(n)
            continue
        add(g, general_maps(p, on_line=bool(on_line[g])))
        for i in firsts:
            add(g, rotations(p, i, on_line=bool(on_line[g])))
        for a, b in itertools.combinations(firsts, 2):
            velocity = rotation_about_line(p, a, b, on_line=bool(on_line[g]))
            if (velocity == 0.0).all():
                continue
            for sign in (1.0, -1.0):
                least = angles_to(sign * velocity, n).min()
                angles[g] = max(angles[g], least - RIGHT)
    for rows, maps in families.values():
        grasps = np.array(rows)
        found, sure = largest_separation(np.array(maps), normals[grasps])
        np.maximum.at(angles, grasps, found)
        np.logical_and.at(proven, grasps, sure)
    return np.minimum(angles, RIGHT), proven


@dataclass(frozen=True, eq=False)
class Grasps:
    """Degenerate grasps with the same number of contacts."""

    points: Floats
    """Shape (b, n, 3)."""
    normals: Floats
    """Shape (b, n, 3)."""
    on_line: Bools
    """Whether the contacts were placed on a line, up to rounding (b,)."""


def unit(v: Floats) -> Floats:
    """Unit vectors."""
    return np.asarray(v / np.linalg.norm(v, axis=-1, keepdims=True))


KINDS = {
    "pair at one point": [2, 3, 4, 5],
    "three at one point": [3, 4, 5],
    "two pairs": [4, 5],
    "two points": [3, 4, 5],
    "one point": [2, 3, 4, 5],
    "on a line": [3, 4, 5],
    "on a line, pair": [4, 5],
    "in a plane, pair": [4, 5],
    "close pair": [2, 3, 4, 5],
    "close three": [3, 4, 5],
    "two close pairs": [4, 5],
    "two clusters": [3, 4, 5],
}
"""Kinds of degenerate grasps, with their possible numbers of contacts."""


def random_grasps(kind: str, contacts: int, count: int, rng: np.random.Generator) -> Grasps:
    """Random grasps of one kind."""
    points = rng.normal(size=(count, contacts, 3))
    on_line = np.zeros(count, dtype=np.bool_)
    if kind in ("on a line", "on a line, pair"):
        line = unit(rng.normal(size=(count, 1, 3)))
        axis = np.eye(3)[rng.integers(3, size=count)][:, None]
        line = np.where(rng.random((count, 1, 1)) < 0.5, line, axis)  # half of them along an axis
        points = rng.normal(size=(count, contacts, 1)) * line
        on_line[:] = True
    if kind == "in a plane, pair":
        points[..., 2] = 0.0
    groups = {
        "pair at one point": [[0, 1]],
        "three at one point": [[0, 1, 2]],
        "two pairs": [[0, 1], [2, 3]],
        "one point": [list(range(contacts))],
        "on a line": [],
        "on a line, pair": [[0, 1]],
        "in a plane, pair": [[0, 1]],
        "close pair": [[0, 1]],
        "close three": [[0, 1, 2]],
        "two close pairs": [[0, 1], [2, 3]],
    }.get(kind)
    if groups is None:
        groups = [list(range(contacts // 2)), list(range(contacts // 2, contacts))]
        if contacts > 3:
            part = int(rng.integers(1, contacts - 1))
            groups = [list(range(part)), list(range(part, contacts))]
    for group in groups:
        points[:, group] = points[:, group[:1]]
    size = np.linalg.norm(points - points[:, :1], axis=2).max(axis=1)[:, None, None]
    points /= np.where(size > 0.0, size, 1.0)
    if not on_line.any():  # some on a coarse grid, where many sums and differences are exact
        points = np.where(rng.random((count, 1, 1)) < 0.2, np.round(points * 8.0) / 8.0, points)
    if kind in ("close pair", "close three", "two close pairs", "two clusters"):
        gap = 10.0 ** rng.uniform(-11.5, -2.0, size=(count, 1, 1))
        for group in groups:
            points[:, group[1:]] += gap * unit(rng.normal(size=(count, len(group) - 1, 3)))
    # Normals are random, toward the middle, or opposed to an earlier one, so that many close.
    normals = unit(rng.normal(size=points.shape))
    inward = points.mean(axis=1, keepdims=True) - points
    inward = inward / np.maximum(np.linalg.norm(inward, axis=2, keepdims=True), 1e-6)
    leaning = unit(inward + 0.5 * normals)
    for i in range(contacts):
        choice = rng.random((count, 1))
        opposed = unit(-normals[:, i - 1] + 0.4 * normals[:, i]) if i else normals[:, 0]
        normals[:, i] = np.where(
            choice < 0.4, normals[:, i], np.where(choice < 0.75, leaning[:, i], opposed)
        )
    return Grasps(points, unit(normals), on_line)


def unproven_certificates(contacts: Contacts, closure: ForceClosure, on_line: Bools) -> list[int]:
    """Indices of grasps (b,) whose certificate does not prove its claim.

    Forces must be strictly inside their cones, and must balance up to less than their distance from
    the cones' borders. A direction must leave no contact a positive component, up to rounding.
    """
    failed = []
    for g, points in enumerate(contacts.points):
        normals, beta = contacts.normals[g], contacts.friction_angle[g]
        if closure.closed[g]:
            forces = closure.certificate.equilibrium[g, :, :3]
            angles = angles_to(forces, normals)
            margins = np.linalg.norm(forces, axis=1) * np.sin(beta - angles)
            good = (angles < beta).all() and _balanced(
                points, forces, margins, on_line=bool(on_line[g])
            )
        elif closure.status[g] == 0:
            u = closure.certificate.direction[g]
            velocity = u[:3] + np.cross(u[3:], points)
            size = np.linalg.norm(velocity, axis=1)
            reach = 1.0 + np.linalg.norm(points, axis=1).max()
            angles = angles_to(velocity, normals)
            good = bool(((angles >= RIGHT + beta - 1e-6) | (size <= 1e-8 * reach)).all())
        else:
            good = True
        if not good:
            failed.append(g)
    return failed


def _balanced(points: Floats, forces: Floats, margins: Floats, *, on_line: bool) -> bool:
    """Whether corrections smaller than the margins balance the forces exactly."""
    wide = general_maps(points, on_line=on_line).astype(np.longdouble)  # (n, 3, d)
    residual = (wide * forces[..., None].astype(np.longdouble)).sum(axis=(0, 1))
    rows = (wide * margins[:, None, None]).astype(np.float64).reshape(-1, wide.shape[-1])
    # Smallest corrections relative to the margins: rows.T @ x = -residual, |x_i| < 1.
    x = np.linalg.lstsq(rows.T, -residual.astype(np.float64), rcond=None)[0]
    missing = rows.T @ x + residual.astype(np.float64)
    return bool(np.linalg.norm(x) < 0.5 and np.abs(missing).max() <= 1e-3 * margins.min())
