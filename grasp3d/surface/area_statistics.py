"""Weights of vertices by area; fractions and quantiles over a surface, also of what it holds."""

import math
from typing import Literal

import numpy as np

from grasp3d.arrays import ArrayLike, Bytes, Floats
from grasp3d.errors import SettingError
from grasp3d.mesh import ObjectMesh
from grasp3d.settings import check_choice
from grasp3d.stability.label import Label
from grasp3d.surface.load_result import LoadResult
from grasp3d.surface.vertex_grasps import VertexGrasps

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


def held_fractions(labels: VertexGrasps) -> dict[str, float] | None:
    """Area fractions S, M and U of a labelled surface by the labels with force.

    Returns:
        None: the mass or the force at hand is not known.

    Raises:
        SettingError: There is no load.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> from grasp3d.surface.area_statistics import held_fractions
        >>> box = trimesh.creation.box([0.08, 0.05, 0.03])
        >>> mesh = grasp3d.load_mesh(box, unit="m", max_edge=0.02)
        >>> model = grasp3d.GraspModel(torsion_radius="3mm")
        >>> load = grasp3d.Load(mass=0.5, grip_force=40.0)
        >>> labels = grasp3d.label_surface(mesh, model, load=load)
        >>> {name: round(part, 1) for name, part in held_fractions(labels).items()}
        {'S': 0.5, 'M': 0.5, 'U': 0.0}
    """
    codes = _load_result(labels).label
    if codes is None:
        return None
    return label_fractions(codes, vertex_weights(labels.mesh, "area"))


def payload_quantiles(labels: VertexGrasps, levels: ArrayLike) -> Floats | None:
    """Quantiles over the surface of the payload [kg]; it is 0 where no grasp was found.

    Args:
        labels: The labelled surface, with a load.
        levels: From 0 to 1, shape (k,).

    Returns:
        None: no force is at hand, or the task does not depend on the mass.

    Raises:
        SettingError: There is no load, or a level is outside its range.
    """
    load_result = _load_result(labels)
    if not load_result.has_payload:
        return None
    payloads = np.nan_to_num(load_result.payload, nan=0.0, posinf=math.inf)
    return quantiles(payloads, levels, vertex_weights(labels.mesh, "area"))


def _load_result(labels: VertexGrasps) -> LoadResult:
    if labels.load_result is None:
        raise SettingError("the labels have no load; label the surface with load=Load(...)")
    return labels.load_result
