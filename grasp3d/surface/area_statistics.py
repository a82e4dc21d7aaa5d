"""Weights of vertices by area; fractions and quantiles over a surface."""

from typing import Literal

import numpy as np

from grasp3d.arrays import ArrayLike, Bytes, Floats
from grasp3d.errors import SettingError
from grasp3d.mesh import ObjectMesh
from grasp3d.settings import check_choice
from grasp3d.stability.label import Label

Weights = Literal["area", "vertex"]
"""area: each vertex is weighted by the area around it; vertex: all on the surface equally. Those
where no contact may be have no weight."""


def vertex_weights(mesh: ObjectMesh, weights: Weights) -> Floats:
    """Weights of the vertices, shape (V,); their sum is 1.

    Raises:
        SettingError: Unknown `weights`.
    """
    check_choice("weights", weights, Weights)
    values = mesh.vertex_areas if weights == "area" else mesh.allowed.astype(np.float64)
    return np.asarray(values / values.sum())


def quantiles(values: Floats, levels: ArrayLike, weights: Floats) -> Floats:
    """Quantiles of weighted values.

    Args:
        values: Shape (V,).
        levels: From 0 to 1, shape (k,).
        weights: As `vertex_weights` returns them, shape (V,).

    Returns:
        Shape (k,).

    Raises:
        SettingError: A level is outside its range.
    """
    fractions = np.asarray(levels, dtype=np.float64)
    if not ((fractions >= 0.0) & (fractions <= 1.0)).all():
        raise SettingError(f"quantile levels must be from 0 to 1; got {levels!r}")
    order = np.argsort(values, kind="stable")
    cumulative = np.cumsum(weights[order])
    index = np.searchsorted(cumulative, fractions * cumulative[-1])
    return np.asarray(values[order][np.minimum(index, len(order) - 1)])


def label_fractions(codes: Bytes, weights: Floats) -> dict[str, float]:
    """Fractions S, M and U of weighted vertices.

    Args:
        codes: `Label` codes, shape (V,).
        weights: As `vertex_weights` returns them, shape (V,).
    """
    return {
        label.name: float(weights[codes == label].sum()) for label in sorted(Label, reverse=True)
    }
