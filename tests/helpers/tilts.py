"""Tilted normals: random ones, adversarial ones, and all combinations of given ones."""

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from grasp3d import Contacts, epsilon, force_closure
from grasp3d.contact.contacts import turned
from tests.helpers.random_grasps import random_grasps

Floats = NDArray[np.float64]

STARTS = 12
"""Random directions from which the adversarial search starts."""


def angles(a: Floats, b: Floats) -> Floats:
    """Angles between vectors (..., 3) [rad]."""
    across = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.asarray(np.arctan2(across, (a * b).sum(axis=-1)))


def mixed(fingers: int, size: int, seed: int) -> tuple[Contacts, Floats]:
    """Random grasps and resolutions; friction and resolution differ among the contacts."""
    contacts, _ = random_grasps(fingers, size, seed)
    rng = np.random.default_rng(seed)
    friction = rng.uniform(0.3, 1.2, size=(size, fingers))
    fraction = rng.uniform(0.0, 1.2, size=(size, 1)) * rng.uniform(0.5, 1.0, size=(size, fingers))
    return contacts.with_friction(friction), 2.0 * fraction * np.arctan(friction)


def random_tilts(normals: Floats, largest: Any, rng: np.random.Generator) -> Floats:
    """Random unit vectors at up to `largest` (...) [rad] from others (..., 3), half on the rim."""
    fraction = np.sqrt(rng.random(normals.shape[:-1]))
    tilt = largest * np.where(rng.random(fraction.shape) < 0.5, 1.0, fraction)
    tangent = rng.normal(size=normals.shape)
    tangent -= (tangent * normals).sum(axis=-1, keepdims=True) * normals
    tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
    return np.asarray(np.cos(tilt)[..., None] * normals + np.sin(tilt)[..., None] * tangent)


def with_normals(contacts: Contacts, normals: Floats) -> Contacts:
    """The same contacts with other normals, which may have more leading axes."""
    shape = normals.shape[:-1]
    return Contacts(
        np.broadcast_to(contacts.points, normals.shape),
        normals,
        np.broadcast_to(contacts.friction, shape),
        np.broadcast_to(contacts.torsion_radius, shape),
        contacts.groups,
    )


def worst_normals(contacts: Contacts, tilt: Floats) -> Floats:
    """Normals (b, n, 3) turned away from the motion that is hardest to resist."""
    offset = -np.minimum(tilt, contacts.friction_angle)
    u = epsilon(contacts, cone_offset=offset).certificate.direction[:, None]
    velocity = u[..., :3] + np.cross(u[..., 3:], contacts.points)
    return turned(contacts.normals, -velocity, tilt)


def best_normals(contacts: Contacts, tilt: Floats) -> Floats:
    """Normals (b, n, 3) turned toward forces in equilibrium, nan where there are none."""
    if contacts.count == 2:
        line = contacts.points[:, 1] - contacts.points[:, 0]
        goals = np.stack([line, -line], axis=1)
        off = angles(contacts.normals, goals)
        wide = contacts.friction_angle + tilt
        squeezing = (off - wide).max(axis=1) <= (math.pi - off - wide).max(axis=1)
        goals = np.where(squeezing[:, None, None], goals, -goals)
    else:
        goals = force_closure(contacts, cone_offset=tilt).certificate.equilibrium[..., :3]
    return turned(contacts.normals, goals, tilt)


def all_combinations(contacts: Contacts, tested: Sequence[Floats]) -> Contacts:
    """One grasp with every combination of tested normals (k_i, 3), in order, as a batch."""
    return with_normals(contacts, np.array(list(itertools.product(*tested))))


def within_sets(sets: Floats, rng: np.random.Generator) -> Floats:
    """A random unit normal of each convex set (b, k, 3), sometimes one of its corners."""
    weights = rng.exponential(size=sets.shape[:2]) * (rng.random(sets.shape[:2]) < 0.7)
    weights[:, 0] += weights.sum(axis=1) == 0.0
    rows = np.einsum("bk,bkc->bc", weights, sets)
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


def angle_to_set(normals: Floats, direction: Floats) -> float:
    """Angle between a unit direction and the nearest normal of a convex set (k, 3)."""
    if (normals @ direction <= 0.0).all():  # the nearest is a corner
        return float(angles(normals, direction).min())
    weights, _ = nnls(normals.T, direction)
    return float(angles(weights @ normals, direction))


def adversarial_epsilons(
    contacts: Contacts, tilt: Floats, actuation: Any, rng: np.random.Generator, rtol: float = 1e-3
) -> Iterator[tuple[Floats, Floats]]:
    """Bounds on epsilon (b,) at ever worse tilts of a flat batch, by an adversarial search.

    It does not use narrower cones: from many starts it turns each normal away from the velocity of
    its contact in the hardest direction at the current tilts, repeats that, and finally searches
    around the worst tilts found.
    """

    def evaluate(normals: Floats) -> tuple[Floats, Floats, Floats]:
        result = epsilon(with_normals(contacts, normals), actuation=actuation, rtol=rtol)
        u = result.certificate.direction[..., None, :]
        return result.lower, result.upper, u[..., :3] + np.cross(u[..., 3:], contacts.points)

    worst = contacts.normals.copy()
    smallest = np.full(len(worst), math.inf)
    starts = [contacts.normals, *(random_tilts(contacts.normals, tilt, rng) for _ in range(3))]
    for _ in range(STARTS):
        u = rng.normal(size=(len(worst), 1, 6))
        velocity = u[..., :3] + np.cross(u[..., 3:], contacts.points)
        starts.append(_away(contacts.normals, velocity, tilt))
    for size in (None,) * len(starts) + (0.5, 0.3, 0.2, 0.1, 0.05, 0.02) * 3:
        if size is None:
            normals = starts.pop()
        else:
            normals = random_tilts(worst, size * tilt, rng)
            gap = angles(contacts.normals, normals)
            back = _away(contacts.normals, -normals, np.minimum(gap, tilt))
            normals = np.where((gap > tilt)[..., None], back, normals)
        for _ in range(4):
            lower, upper, velocity = evaluate(normals)
            yield lower, upper
            worse = upper < smallest
            worst[worse], smallest[worse] = normals[worse], upper[worse]
            normals = _away(contacts.normals, velocity, tilt)


def _away(normals: Floats, goals: Floats, tilt: Floats) -> Floats:
    """Unit normals turned by `tilt` away from other vectors."""
    away = (goals * normals).sum(axis=-1, keepdims=True) * normals - goals
    lengths = np.linalg.norm(away, axis=-1, keepdims=True)
    away = np.divide(away, lengths, out=np.zeros_like(away), where=lengths > 1e-12)
    rows = np.cos(tilt)[..., None] * normals + np.sin(tilt)[..., None] * away
    return np.asarray(rows / np.linalg.norm(rows, axis=-1, keepdims=True))
