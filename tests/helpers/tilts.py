"""Tilted normals: random and adversarial ones, and all combinations of given ones."""

import itertools
import math
from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import nnls

from grasp3d import Contacts, epsilon, force_closure
from grasp3d.contact.contacts import turned
from tests.helpers.random_grasps import random_grasps

Floats = NDArray[np.float64]


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
    """Random unit vectors within `largest` (...) [rad] of others (..., 3), half on the rim."""
    fraction = np.sqrt(rng.random(normals.shape[:-1]))
    tilt = largest * np.where(rng.random(fraction.shape) < 0.5, 1.0, fraction)
    tangent = rng.normal(size=normals.shape)
    tangent -= (tangent * normals).sum(axis=-1, keepdims=True) * normals
    tangent /= np.linalg.norm(tangent, axis=-1, keepdims=True)
    return np.asarray(np.cos(tilt)[..., None] * normals + np.sin(tilt)[..., None] * tangent)


def with_normals(contacts: Contacts, normals: Floats) -> Contacts:
    """Return the same contacts with other normals, which may have more leading axes."""
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
    return turned_away(contacts, epsilon(contacts, cone_offset=offset).certificate.direction, tilt)


def turned_away(contacts: Contacts, motion: Floats, tilt: Any) -> Floats:
    """Normals (b, n, 3) turned away from the contacts' velocities in motions (b, 6)."""
    u = motion[:, None]
    velocity = u[..., :3] + np.cross(u[..., 3:], contacts.points)
    return turned(contacts.normals, -velocity, np.broadcast_to(tilt, velocity.shape[:-1]))


def best_normals(contacts: Contacts, tilt: Floats) -> Floats:
    """Normals (b, n, 3) turned toward forces in equilibrium; nan where there are none."""
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
    """One grasp with every combination of tested normals (k_i, 3) in order, as a batch."""
    return with_normals(contacts, np.array(list(itertools.product(*tested))))


def within_sets(sets: Floats, rng: np.random.Generator) -> Floats:
    """Draw a unit normal from each convex set (b, k, 3), sometimes one of its corners."""
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
