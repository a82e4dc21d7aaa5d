"""Shares of a surface that its vertices stand for, and quantiles over it."""

from typing import Literal

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Floats
from grasp3d.errors import SettingError
from grasp3d.mesh import ObjectMesh

Weights = Literal["area", "vertex"]
"""area: each vertex counts with the area around it; vertex: all on the surface alike."""


def vertex_weights(mesh: ObjectMesh, weights: Weights) -> Floats:
    """Share of the surface that each vertex stands for, shape (V,).

    Raises:
        SettingError: No weights are called so.
    """
    if weights == "area":
        values = mesh.vertex_areas
    elif weights == "vertex":
        values = mesh.on_surface.astype(np.float64)
    else:
        raise SettingError(f"no weights are called {weights!r}; known: area, vertex")
    return np.asarray(values / values.sum())


def quantiles(values: Floats, levels: npt.ArrayLike, weights: Floats) -> Floats:
    """Quantiles of weighted values.

    Args:
        values: Shape (V,).
        levels: From 0 to 1, shape (k,).
        weights: Shares, shape (V,).

    Returns:
        Shape (k,).

    Raises:
        SettingError: A level is outside its range.
    """
    shares = np.asarray(levels, dtype=np.float64)
    if not ((shares >= 0.0) & (shares <= 1.0)).all():
        raise SettingError(f"quantile levels must be from 0 to 1; got {levels!r}")
    order = np.argsort(values, kind="stable")
    reached = np.cumsum(weights[order])
    index = np.searchsorted(reached, shares * reached[-1])
    return np.asarray(values[order][np.minimum(index, len(order) - 1)])
