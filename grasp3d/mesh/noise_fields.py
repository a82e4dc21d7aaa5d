"""Random fields on a surface: errors of a scan's vertices, independent or correlated."""

import math

import numpy as np

from grasp3d.arrays import Floats

WAVES = 256
"""Waves of a correlated field; each field draws others, so that no pattern recurs."""

SIDES = 0.7
"""Difference of two normals, as the length of their difference, over which errors lose their
correlation as over one correlation length: of opposite sides of a wall (length 2) 2 % remain."""

STREAM = 0x6E6F697365
"""Part of every seed, so that errors which a program made with the same seed do not recur."""

CHUNK = 1 << 14
"""Points at which the waves are evaluated at once."""


def noise_stream(seed: int, *numbers: int) -> np.random.Generator:
    """Make a stream of random numbers for noise.

    Args:
        seed: The user's seed.
        numbers: What distinguishes the stream from others of that seed.
    """
    return np.random.default_rng((STREAM, seed, *numbers))


def random_field(
    points: Floats, normals: Floats, correlation: float, random: np.random.Generator
) -> Floats:
    """Draw a Gaussian random field at points of a surface: one number each.

    The correlation of two points at distance d, whose unit normals differ by a vector of length n,
    is exp(-d^2 / (2 correlation^2) - n^2 / (2 SIDES^2)): errors of neighbours are alike, those of
    the two sides of a wall are not. A sum of random waves (Rahimi and Recht, 'Random features for
    large-scale kernel machines', 2007): Gaussian with this correlation over all fields.

    Args:
        points: Positions, shape (n, 3).
        normals: Unit normals there, shape (n, 3).
        correlation: Correlation length, in the unit of the points, at least 0; 0: white noise, an
            independent error at every point.
        random: Where the numbers are drawn from.

    Returns:
        Values of mean 0 and standard deviation 1, shape (n,).

    Example:
        >>> import numpy as np
        >>> from grasp3d.mesh.noise_fields import random_field
        >>> points = np.array([[0.0, 0.0, 0.0], [0.1, 0.0, 0.0], [9.0, 0.0, 0.0]])
        >>> up = np.tile([0.0, 0.0, 1.0], (3, 1))
        >>> errors = random_field(points, up, 1.0, np.random.default_rng(0))
        >>> errors.shape, bool(abs(errors[0] - errors[1]) < 0.5)
        ((3,), True)
    """
    if correlation == 0.0:
        return random.normal(size=len(points))
    scaled = np.hstack([points / correlation, normals / SIDES])  # (n, 6)
    waves = random.normal(size=(scaled.shape[1], WAVES))
    sines, cosines = random.normal(size=(2, WAVES)) / math.sqrt(WAVES)
    field = np.empty(len(points))
    for start in range(0, len(points), CHUNK):
        part = slice(start, start + CHUNK)
        phases = scaled[part] @ waves  # (chunk, WAVES)
        field[part] = np.sin(phases) @ sines + np.cos(phases) @ cosines
    return field
