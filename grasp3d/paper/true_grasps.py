"""Random true grasps of the circle: which hold whatever is true, and which never do.

An independent check of the closed form: contacts, normals and frictions are drawn within their
bounds, and each true grasp is decided by the definition alone.
"""

import math

import numpy as np

from grasp3d.arrays import Bools, Floats
from grasp3d.settings import GraspModel

GRASPS = 360
"""Perceived grasps, evenly around the circle."""
TRUE = 400
"""True grasps of each perceived one."""
EXTREME = 0.7
"""Fraction of the errors that are as large as possible."""
SEED = 2018


def sampled_fractions(
    model: GraspModel, *, grasps: int = GRASPS, true: int = TRUE, seed: int = SEED
) -> tuple[float, float]:
    """Fractions of perceived grasps of a circle of radius 1 that hold always, and never.

    Args:
        model: Friction and its error, tilt and location error in radii.
        grasps: Perceived grasps.
        true: True grasps of each.
        seed: Seed of the errors.

    Returns:
        (S, U). Sampling misses some true grasps that fail or hold, so both are a little too large.
    """
    rng = np.random.default_rng(seed)
    turn = (np.arange(grasps) + 0.5) * (2.0 * math.pi / grasps)
    angles = np.stack([np.zeros(grasps), turn], axis=1)
    points = np.stack([np.cos(angles), np.sin(angles)], axis=-1)  # (g, 2, 2)
    held = _held(points, angles + math.pi, model, true, rng)
    return float(held.all(axis=1).mean()), 1.0 - float(held.any(axis=1).mean())


def _held(
    points: Floats, normals: Floats, model: GraspModel, true: int, rng: np.random.Generator
) -> Bools:
    """Force closure of random true grasps, shape (g, true).

    Args:
        points: Perceived contacts, shape (g, 2, 2).
        normals: Polar angles of their normals [rad], shape (g, 2).
        model: What is known about them.
        true: True grasps of each perceived one.
        rng: Random numbers.
    """
    shape = (len(points), true, 2)
    direction = rng.uniform(0.0, 2.0 * math.pi, shape)
    radius = float(model.location_error) * np.abs(_errors(shape, rng))
    shift = radius[..., None] * np.stack([np.cos(direction), np.sin(direction)], axis=-1)
    apart = np.diff(points[:, None] + shift, axis=2)[:, :, 0]  # (g, true, 2)
    line = np.arctan2(apart[..., 1], apart[..., 0])[..., None] + [0.0, math.pi]
    turn = line - normals[:, None] - model.tilt * _errors(shape, rng)
    off = np.abs(np.remainder(turn + math.pi, 2.0 * math.pi) - math.pi)
    cone = np.arctan(model.friction + model.friction_error * _errors(shape, rng))
    return np.asarray((off < cone).all(axis=-1) | (math.pi - off < cone).all(axis=-1))


def _errors(shape: tuple[int, ...], rng: np.random.Generator) -> Floats:
    """Errors from -1 to 1, most of them at the ends."""
    ends = rng.choice([-1.0, 1.0], shape)
    return np.where(rng.random(shape) < EXTREME, ends, rng.uniform(-1.0, 1.0, shape))
