"""Edges of friction cones, tilted normals, and the effective friction."""

import math
from numbers import Real

import numpy as np

from grasp3d.arrays import ArrayLike, Floats, unit_rows
from grasp3d.errors import SettingError

NEAR_X_AXIS = 0.9
"""Absolute x-component of a normal above which its tangents come from the y-axis instead."""

PARALLEL = 1e-12
"""Sine of the angle between a normal and its goal below which the goal gives no direction."""


def tangents(normals: ArrayLike) -> tuple[Floats, Floats]:
    """Two orthogonal tangents of each normal; the angles of a cone's edges start at the first.

    The first is normal x x-axis; for normals within 26 degrees of that axis it is normal x y-axis.
    So contacts in the xy-plane have their first tangent along z. The second is normal x first.

    Args:
        normals: Unit normals, shape (..., 3).

    Returns:
        (first, second), unit vectors of that shape.
    """
    n = np.asarray(normals, dtype=np.float64)
    axis = np.where(np.abs(n[..., :1]) > NEAR_X_AXIS, [0.0, 1.0, 0.0], [1.0, 0.0, 0.0])
    first = unit_rows(np.cross(n, axis))
    return first, np.cross(n, first)


def edge_angles(edges: int, phase: float = 0.0) -> Floats:
    """Angles of a cone's edges about its normal [rad], counted from the first tangent, (edges,).

    Args:
        edges: Number of edges of the cone, at least 3: fewer span no cone.
        phase: Angle of the first edge [rad].

    Raises:
        SettingError: Too few edges, or a phase that is not finite.
    """
    whole = isinstance(edges, Real) and math.isfinite(edges) and edges == int(edges)
    if not whole or edges < 3:
        raise SettingError(f"a friction cone needs at least 3 edges, a whole number; got {edges!r}")
    if not math.isfinite(phase):
        raise SettingError(f"the phase of the edges must be finite; got {phase}")
    return np.linspace(phase, phase + 2.0 * math.pi, int(edges), endpoint=False)


def cone_edges(
    normals: ArrayLike, friction_angle: ArrayLike, *, edges: int = 8, phase: float = 0.0
) -> Floats:
    """Unit forces along the edges of friction cones (Wan & Howe 2018, Sec. II).

    Args:
        normals: Inward unit normals, shape (..., 3).
        friction_angle: Half-angles of the cones [rad], shape (...) or one value for all.
        edges: Number of edges of each cone.
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


def tilted_normals(
    normals: ArrayLike, tilt: ArrayLike, *, count: int = 8, rings: int = 1
) -> Floats:
    """Extreme normals: normals at an angle to the given ones (Wan & Howe 2018, Sec. III).

    Args:
        normals: Unit normals, shape (..., 3).
        tilt: The angle, half the sensor's resolution [rad], one value or shape (...).
        count: Number of normals on a ring, evenly around each given one.
        rings: Number of rings, at even steps up to the tilt.

    Returns:
        Shape (..., 1 + rings * count, 3), the given normal first, the innermost ring next.

    Raises:
        SettingError: Fewer than 3 normals on a ring.
    """
    n = np.asarray(normals, dtype=np.float64)
    steps = [np.asarray(tilt) * ring / rings for ring in range(1, rings + 1)]
    around = [cone_edges(n, step, edges=count) for step in steps]
    return np.concatenate([n[..., None, :], *around], axis=-2)


def turned(normals: Floats, goals: Floats, tilt: Floats) -> Floats:
    """Turn unit normals toward goal directions, by at most a tilt and not past the goals.

    Args:
        normals: Shape (..., 3).
        goals: Directions of any length, shape (..., 3); nan gives nan.
        tilt: Largest angle by which each may turn [rad], shape (...).

    Returns:
        Shape (..., 3).
    """
    finite = np.isfinite(goals).all(axis=-1, keepdims=True)
    goals = unit_rows(goals)
    cosine = (normals * goals).sum(axis=-1, keepdims=True)
    across = goals - cosine * normals
    sine = np.linalg.norm(across, axis=-1, keepdims=True)
    # Any tangent leads to a goal opposite to the normal.
    across = unit_rows(np.where(sine < PARALLEL, tangents(normals)[0], across))
    turn = np.minimum(tilt[..., None], np.arctan2(sine, cosine))
    return np.where(finite, np.cos(turn) * normals + np.sin(turn) * across, math.nan)


def on_arcs(first: Floats, second: Floats, fractions: Floats) -> Floats:
    """Unit vectors on the arcs from first unit vectors to second ones.

    Args:
        first: Shape (..., 3).
        second: Shape (..., 3); opposite vectors are joined by any arc.
        fractions: Positions along the arcs, from 0 to 1, shape (m,).

    Returns:
        Shape (..., m, 3).
    """
    across = np.linalg.norm(np.cross(first, second), axis=-1)
    widths = np.arctan2(across, (first * second).sum(axis=-1))
    return turned(first[..., None, :], second[..., None, :], fractions * widths[..., None])


def effective_friction(friction: ArrayLike, sensor_resolution: ArrayLike) -> Floats:
    """Friction that remains at every normal within the sensor's resolution.

    Wan & Howe 2018, Sec. III-A: tan(atan(friction) - sensor_resolution / 2).

    Args:
        friction: Coulomb coefficients, at least 0, any shape.
        sensor_resolution: Angle between the two extreme normals [rad], at least 0.

    Returns:
        The coefficients; 0 where no force is within the friction cones of all normals.

    Raises:
        SettingError: A value is outside its range.
    """
    try:
        mu, alpha = np.asarray(friction, np.float64), np.asarray(sensor_resolution, np.float64)
    except (TypeError, ValueError) as error:
        raise SettingError(f"friction and resolution must be numbers: {error}") from error
    if not ((mu >= 0.0) & np.isfinite(mu)).all():
        raise SettingError(f"friction must be finite and at least 0; got {mu}")
    if not ((alpha >= 0.0) & np.isfinite(alpha)).all():
        raise SettingError(f"sensor resolution must be finite and at least 0; got {alpha}")
    return np.asarray(np.tan(np.maximum(np.arctan(mu) - alpha / 2.0, 0.0)))[()]
