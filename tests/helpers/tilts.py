"""Tilted normals: random ones, adversarial ones, and every combination of some."""

import itertools
import math
from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from grasp3d import Contacts, epsilon

Floats = NDArray[np.float64]

TRIES = 12
"""Random directions from which the adversary starts."""


def angles(a: Floats, b: Floats) -> Floats:
    """Between vectors (..., 3) [rad]."""
    across = np.linalg.norm(np.cross(a, b), axis=-1)
    return np.asarray(np.arctan2(across, (a * b).sum(axis=-1)))


def anywhere(normals: Floats, most: Any, rng: np.random.Generator) -> Floats:
    """Unit vectors within caps of radius `most` (...) about others (..., 3), half on the rim."""
    share = np.sqrt(rng.random(normals.shape[:-1]))
    turn = most * np.where(rng.random(share.shape) < 0.5, 1.0, share)
    away = rng.normal(size=normals.shape)
    away -= (away * normals).sum(axis=-1, keepdims=True) * normals
    away /= np.linalg.norm(away, axis=-1, keepdims=True)
    return np.asarray(np.cos(turn)[..., None] * normals + np.sin(turn)[..., None] * away)


def with_normals(contacts: Contacts, normals: Floats) -> Contacts:
    """The same contacts with other normals, which may have more leading axes."""
    shape = normals.shape[:-1]
    return Contacts(
        np.broadcast_to(contacts.points, normals.shape),
        normals,
        np.broadcast_to(contacts.friction, shape),
        np.broadcast_to(contacts.torsion_radius, shape),
    )


def every(contacts: Contacts, tested: Sequence[Floats]) -> Contacts:
    """One grasp with every combination of tested normals (k_i, 3), in order: a batch."""
    return with_normals(contacts, np.array(list(itertools.product(*tested))))


def within_sets(sets: Floats, rng: np.random.Generator) -> Floats:
    """A unit normal of each convex set (b, k, 3), now and then one of its corners."""
    shares = rng.exponential(size=sets.shape[:2]) * (rng.random(sets.shape[:2]) < 0.7)
    shares[:, 0] += shares.sum(axis=1) == 0.0
    rows = np.einsum("bk,bkc->bc", shares, sets)
    return np.asarray(rows / np.linalg.norm(rows, axis=1, keepdims=True))


def angle_to_set(normals: Floats, direction: Floats) -> float:
    """Angle between a unit direction and the nearest normal of a convex set (k, 3)."""
    if (normals @ direction <= 0.0).all():  # the nearest is a corner
        return float(angles(normals, direction).min())
    shares, _ = nnls(normals.T, direction)
    return float(angles(shares @ normals, direction))


def attacked(
    contacts: Contacts, tilt: Floats, actuation: Any, rng: np.random.Generator, rtol: float = 1e-3
) -> Iterator[tuple[Floats, Floats]]:
    """Bounds on epsilon (b,) at ever worse tilts of a flat batch, by an adversary.

    It knows nothing of narrower cones: from many starts it turns each normal away from the force
    that does work in the direction that is the hardest at the present tilts, tries again there,
    and at last tries around the worst that it has found.
    """

    def measured(normals: Floats) -> tuple[Floats, Floats, Floats]:
        found = epsilon(
            with_normals(contacts, normals), actuation=actuation, rtol=rtol, threads=None
        )
        u = found.certificate.direction[..., None, :]
        return found.lower, found.upper, u[..., :3] + np.cross(u[..., 3:], contacts.points)

    worst = contacts.normals.copy()
    least = np.full(len(worst), math.inf)
    starts = [contacts.normals, *(anywhere(contacts.normals, tilt, rng) for _ in range(3))]
    for _ in range(TRIES):
        u = rng.normal(size=(len(worst), 1, 6))
        work = u[..., :3] + np.cross(u[..., 3:], contacts.points)
        starts.append(_away(contacts.normals, work, tilt))
    for size in (None,) * len(starts) + (0.5, 0.3, 0.2, 0.1, 0.05, 0.02) * 3:
        if size is None:
            normals = starts.pop()
        else:
            normals = anywhere(worst, size * tilt, rng)
            gap = angles(contacts.normals, normals)
            back = _away(contacts.normals, -normals, np.minimum(gap, tilt))
            normals = np.where((gap > tilt)[..., None], back, normals)
        for _ in range(4):
            lower, upper, work = measured(normals)
            yield lower, upper
            better = upper < least
            worst[better], least[better] = normals[better], upper[better]
            normals = _away(contacts.normals, work, tilt)


def _away(normals: Floats, goals: Floats, turn: Floats) -> Floats:
    """Unit normals turned away from other vectors."""
    away = (goals * normals).sum(axis=-1, keepdims=True) * normals - goals
    lengths = np.linalg.norm(away, axis=-1, keepdims=True)
    away = np.divide(away, lengths, out=np.zeros_like(away), where=lengths > 1e-12)
    rows = np.cos(turn)[..., None] * normals + np.sin(turn)[..., None] * away
    return np.asarray(rows / np.linalg.norm(rows, axis=-1, keepdims=True))
