"""Noise of a scan: correlated random fields, and its length from its own roughness."""

import math

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.errors import MeshError
from grasp3d.mesh.measures import Triangles
from grasp3d.mesh.noise import noise_below_creases, normal_noise_and_crease
from grasp3d.mesh.noisy_copies import MovableSurface

FIRST = 0.05
"""Standard deviation from which the estimate starts, in mean edges."""

MEASURING = 1
"""Number of the stream of random numbers."""

STEPS = 6
"""Most steps of the estimate; each multiplies it by a factor of at most `LARGEST`."""

LARGEST = 4.0
"""Largest factor of a step, as an estimate far off says little about the next."""

CLOSE = 0.02
"""Change of a step, as a fraction, at which the estimate ends; that of the noise is far larger."""

SMOOTH = math.radians(0.05)
"""Noise of normals below which a surface has none that can be measured [rad]."""


WAVES = 256
"""Waves of a correlated field; each field draws others, so that no pattern recurs."""

SIDES = 0.7
"""Difference of two normals, as the length of their difference, over which errors lose their
correlation as over one correlation length: of opposite sides of a wall (length 2) 2 % remain."""

STREAM = 0x6E6F697365
"""Part of every seed, so that errors which a program made with the same seed do not recur."""

CHUNK = 1 << 14
"""Points at which the waves are evaluated at once."""


def noise_length(surface: MovableSurface, correlation: float = 0.0, *, seed: int = 0) -> float:
    """Estimate how far the vertices of a scan are off, along their normals.

    It is the noise that must be added to the surface so that its roughness (`normal_noise`) grows
    by a factor of sqrt(2), as independent errors add up by their squares. What of the noise the
    roughness does not contain, since neighbours have the same error, cancels out.

    Args:
        surface: The scan.
        correlation: Correlation length of the errors, in the mesh's unit; see `random_field`. Of
            errors that are correlated over several edges the surface shows too little: give 0, or a
            few edges at most.
        seed: Seed of the noise that is added.

    Returns:
        Standard deviation of the errors along the normals, in the mesh's unit.

    Raises:
        MeshError: The surface is so smooth that it has no noise that can be measured.

    Example:
        >>> import numpy as np
        >>> import trimesh
        >>> from grasp3d.mesh.noise_lengths import noise_length
        >>> from grasp3d.mesh.noisy_copies import movable_surface
        >>> ball = trimesh.creation.icosphere(4)
        >>> errors = np.random.default_rng(1).normal(0.0, 0.005, len(ball.vertices))
        >>> scan = movable_surface((ball.vertices * (1.0 + errors)[:, None], ball.faces))
        >>> 0.0045 < noise_length(scan) < 0.0055
        True
    """
    points = (surface.points - surface.mesh.center) / surface.mesh.size
    faces = np.searchsorted(np.unique(surface.repaired.faces), surface.repaired.faces)
    own, crease = normal_noise_and_crease(Triangles(points, faces))
    if own < SMOOTH:
        raise MeshError(
            f"{surface.mesh.report.source}: the surface has no noise that can be measured; state "
            "that of the scanner (--noise, in Python noise=...)"
        )
    reach = correlation / surface.mesh.size
    field = random_field(points, surface.normals, reach, noise_stream(seed, MEASURING))
    errors = field[:, None] * surface.normals
    sigma = FIRST * surface.mean_edge / surface.mesh.size
    for _ in range(STEPS):
        factor = _factor(Triangles(points + sigma * errors, faces), own, crease)
        sigma *= factor
        if abs(factor - 1.0) < CLOSE:
            break
    return sigma * surface.mesh.size


def _factor(rough: Triangles, own: float, crease: float) -> float:
    """How many times the noise was too small that made a surface of some noise this rough."""
    total = noise_below_creases(rough, crease)
    added = math.sqrt(max(total**2 - own**2, 0.0))
    return min(max(own / added if added else LARGEST, 1.0 / LARGEST), LARGEST)


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
        >>> from grasp3d.mesh.noise_lengths import random_field
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
