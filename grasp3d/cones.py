"""Friction cones: their edges, and the normals that a fingertip may mistake for one another."""

import math
from numbers import Real

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Floats, unit_rows
from grasp3d.errors import SettingError

STEEP = 0.9
"""Component along x of a normal from which tangents are laid out from the y-axis instead."""


def tangents(normals: npt.ArrayLike) -> tuple[Floats, Floats]:
    """Two tangents of each normal, from which the edges of a cone are counted.

    The first is normal x x-axis; for normals within 26 degrees of that axis it is normal x y-axis.
    So contacts in the xy-plane have it along z. The second is normal x first.

    Args:
        normals: Unit normals, shape (..., 3).

    Returns:
        (first, second), unit vectors of that shape.
    """
    n = np.asarray(normals, dtype=np.float64)
    axis = np.where(np.abs(n[..., :1]) > STEEP, [0.0, 1.0, 0.0], [1.0, 0.0, 0.0])
    first = unit_rows(np.cross(n, axis))
    return first, np.cross(n, first)


def edge_angles(edges: int, phase: float = 0.0) -> Floats:
    """Angles of a cone's edges about its normal [rad], counted from the first tangent, (edges,).

    Args:
        edges: Edges of the cone, at least 3: fewer span no cone.
        phase: Angle of the first edge [rad].

    Raises:
        SettingError: Too few edges, or a phase that is no number.
    """
    whole = isinstance(edges, Real) and math.isfinite(edges) and edges == int(edges)
    if not whole or edges < 3:  # noqa: PLR2004
        raise SettingError(f"a friction cone needs at least 3 edges, a whole number; got {edges!r}")
    if not math.isfinite(phase):
        raise SettingError(f"the phase of the edges must be finite; got {phase}")
    return np.linspace(phase, phase + 2.0 * math.pi, int(edges), endpoint=False)


def cone_edges(
    normals: npt.ArrayLike,
    friction_angle: npt.ArrayLike,
    *,
    edges: int = 8,
    phase: float = 0.0,
) -> Floats:
    """Unit forces along the edges of friction cones (Wan & Howe 2018, Sec. II).

    Args:
        normals: Inward unit normals, shape (..., 3).
        friction_angle: Half-angles of the cones [rad], shape (...) or one for all.
        edges: Edges of each cone.
        phase: Angle of the first edge about the normal, from the first of `tangents` [rad].

    Returns:
        Shape (..., edges, 3).

    Raises:
        SettingError: Fewer than 3 edges.
    """
    n = np.asarray(normals, dtype=np.float64)
    first, second = tangents(n)
    angles = edge_angles(edges, phase)[:, None]
    around = np.cos(angles) * first[..., None, :] + np.sin(angles) * second[..., None, :]
    beta = np.asarray(friction_angle, dtype=np.float64)[..., None, None]
    forces: Floats = np.cos(beta) * n[..., None, :] + np.sin(beta) * around
    return forces


def tilted_normals(normals: npt.ArrayLike, tilt: float, *, count: int = 8) -> Floats:
    """Extreme normals: those at an angle from the given ones (Wan & Howe 2018, Sec. III).

    Args:
        normals: Unit normals, shape (..., 3).
        tilt: The angle, half the sensor's resolution [rad].
        count: How many, evenly around each.

    Returns:
        Shape (..., count + 1, 3), the given normal first.

    Raises:
        SettingError: Fewer than 3 around.
    """
    n = np.asarray(normals, dtype=np.float64)
    return np.concatenate([n[..., None, :], cone_edges(n, tilt, edges=count)], axis=-2)


def effective_friction(friction: float, sensor_resolution: float) -> float:
    """Friction that no normal within the sensor's resolution can take away.

    Wan & Howe 2018, Sec. III: tan(atan(friction) - sensor_resolution / 2).

    Args:
        friction: Coulomb coefficient, at least 0.
        sensor_resolution: Angle between the two extreme normals [rad], at least 0.

    Returns:
        The coefficient; 0 when no force is safe for every normal.
    """
    return math.tan(max(math.atan(friction) - sensor_resolution / 2.0, 0.0))
