"""Labelled surfaces as tables, and as objects of trimesh and PyVista."""

import math
from typing import TYPE_CHECKING, Any

import numpy as np

from grasp3d.arrays import Ints
from grasp3d.surface.fields import XYZ, Array, Arrays, present
from grasp3d.surface.label_settings import SETTING, complete_settings, settings_of
from grasp3d.surface.vertex_fields import CORNER_NORMALS, CORNERS, VERTICES
from grasp3d.surface.vertex_grasps import VertexGrasps

if TYPE_CHECKING:
    import pyvista
    import trimesh

INFINITE = "infinite_"
"""Start of the names of arrays that hold where values, which are nan here, are infinite."""


def labels_to_table(labels: VertexGrasps) -> Any:
    """Arrow table with a row for each vertex, as in the file that `write_fields` writes.

    Unlike there, x y z are positions of the mesh, in metres as all else.
    """
    from grasp3d.system.tables import table_of_arrays

    pairs = [(field, values) for field, values in present(VERTICES, labels) if field.table]
    columns = {
        name: column for field, values in pairs for name, column in field.as_columns(values).items()
    }
    columns |= dict(zip(XYZ, labels.mesh.vertices.T, strict=True))
    texts = {field.name: field.texts for field, _ in pairs if field.texts}
    return table_of_arrays(columns, texts, settings=complete_settings(labels))


def labels_to_trimesh(labels: VertexGrasps) -> "trimesh.Trimesh":
    """The surface as a trimesh, coloured by label, with every array as a vertex attribute."""
    from trimesh.visual import ColorVisuals

    surface = labels.mesh.to_trimesh()
    arrays = point_arrays(labels)
    surface.visual = ColorVisuals(surface, vertex_colors=arrays.pop("color"))
    surface.vertex_attributes.update(arrays)
    surface.metadata["grasp3d"] = settings_of(labels)
    return surface


def labels_to_polydata(labels: VertexGrasps) -> "pyvista.PolyData":
    """The surface as PyVista data, with the arrays of the file that `write_vtp` writes."""
    arrays = point_arrays(labels)
    mesh = labels.mesh
    data = mesh.to_polydata()
    for name, values in arrays.items():
        # An infinite value would stretch the colour map; nan has a separate colour.
        data.point_data[name] = _finite(values)
    for field, values in present((CORNERS, CORNER_NORMALS), mesh):
        (data.cell_data if field is CORNERS else data.field_data)[field.name] = values
    for name, values in arrays.items():
        if np.isinf(values).any():
            data.field_data[f"{INFINITE}{name}"] = _signed_rows(values)
    for key, value in complete_settings(labels).items():
        data.field_data[f"{SETTING}{key}"] = [str(value)]
    return data


def point_arrays(labels: VertexGrasps) -> Arrays:
    """The arrays over the vertices beside their positions, those of each finger apart."""
    fields = (field for field in VERTICES[1:] if field.array)
    return {
        name: part
        for field, values in present(fields, labels)
        for name, part in field.as_points(values).items()
    }


def _finite(values: Array) -> Array:
    return np.where(np.isinf(values), math.nan, values) if values.dtype.kind == "f" else values


def _signed_rows(values: Array) -> Ints:
    """Rows of infinite values; those of negative ones are -1 - row."""
    rows = np.flatnonzero(np.isinf(values))
    return np.where(values[rows] > 0.0, rows, ~rows)
