"""VTP files and PyVista data of meshes and labels."""

import math
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from grasp3d.arrays import Floats, Ints
from grasp3d.export.fields import Array, Arrays, present
from grasp3d.export.needed import check_complete
from grasp3d.export.npz import MEMORY
from grasp3d.export.settings import SETTING, complete_settings
from grasp3d.export.stored import Stored, damaged, fingers_of
from grasp3d.export.vertex_fields import CORNER_NORMALS, CORNERS, VERTICES
from grasp3d.export.vtp_arrays import vtp_arrays
from grasp3d.mesh import ObjectMesh
from grasp3d.reading.sources import Source, check_memory
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.system.files import atomic_write
from grasp3d.system.isolation.calls import call
from grasp3d.system.isolation.failures import CallFailedError

if TYPE_CHECKING:
    import pyvista

INFINITE = "infinite_"
"""Start of the names of arrays that hold where values, which are nan here, are infinite."""


def write_vtp(path: str | Path, labels: SurfaceLabels) -> None:
    """Write a VTP for ParaView with every array; nan where there is no grasp. Raises OutputError.

    Each of the other fingers has its own arrays: `partner_2`, `partner_2_normal`, and so on.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> ball = grasp3d.load_mesh(trimesh.creation.icosphere(2), unit="cm", max_edge=9.0)
        >>> labels = grasp3d.label_surface(ball)
        >>> grasp3d.write_vtp("ball.vtp", labels)
        >>> import pyvista
        >>> pyvista.read("ball.vtp").point_data["partner_2"].shape
        (162, 3)
    """
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    check_complete(path, labels, complete=True)
    # VTK writes to memory: on a full disk its own file output ends the process.
    writer = vtkXMLPolyDataWriter()
    writer.SetInputData(labels_to_polydata(labels))
    writer.SetDataModeToBinary()
    writer.WriteToOutputStringOn()
    writer.Write()
    with atomic_write(Path(path)) as part:
        part.write_text(writer.GetOutputString(), encoding="ascii")


def mesh_to_polydata(mesh: ObjectMesh) -> "pyvista.PolyData":
    """The surface as PyVista data, with outward normals as the array `normal`."""
    return _polydata(mesh.vertices, mesh.faces, {"normal": -mesh.normals})


def labels_to_polydata(labels: SurfaceLabels) -> "pyvista.PolyData":
    """The surface as PyVista data, with the arrays of the file that `write_vtp` writes."""
    arrays = point_arrays(labels)
    mesh = labels.mesh
    # An infinite value would stretch the colour map; nan has a separate colour.
    data = _polydata(mesh.vertices, mesh.faces, {name: _finite(a) for name, a in arrays.items()})
    for field, values in present((CORNERS, CORNER_NORMALS), mesh):
        (data.cell_data if field is CORNERS else data.field_data)[field.name] = values
    for name, values in arrays.items():
        if np.isinf(values).any():
            data.field_data[f"{INFINITE}{name}"] = _signed_rows(values)
    for key, value in complete_settings(labels).items():
        data.field_data[f"{SETTING}{key}"] = [str(value)]
    return data


def point_arrays(labels: SurfaceLabels) -> Arrays:
    """The arrays over the vertices beside their positions, those of each finger apart."""
    chosen = (field for field in VERTICES[1:] if field.array)
    return {
        name: part
        for field, values in present(chosen, labels)
        for name, part in field.as_points(values).items()
    }


def _finite(values: Array) -> Array:
    return np.where(np.isinf(values), math.nan, values) if values.dtype.kind == "f" else values


def _signed_rows(values: Array) -> Ints:
    """Rows of infinite values; those of negative ones are -1 - row."""
    rows = np.flatnonzero(np.isinf(values))
    return np.where(values[rows] > 0.0, rows, ~rows)


def _polydata(vertices: Floats, faces: Ints, arrays: Arrays) -> "pyvista.PolyData":
    import pyvista

    data: pyvista.PolyData = pyvista.PolyData.from_regular_faces(vertices, faces.astype(int))
    for name, values in arrays.items():
        data.point_data[name] = values
    return data


SECONDS = 60.0
"""Time limit of reading, with the start of the process [s]."""

BYTES_PER_SECOND = 1e6
"""Speed of reading, with a safety factor [bytes/s]."""


def read_vtp(source: Source) -> Stored | None:
    """Read a VTP of labels; None: it has none of grasp3d. Raises MeshError."""
    check_memory(source, source.size, MEMORY)
    if b"VTKFile" not in source.head():
        raise source.error(f"is no VTP; {source.hint}")
    try:
        found = call(
            vtp_arrays,
            str(source.path.absolute()),
            memory=source.max_memory,
            seconds=SECONDS + source.size / BYTES_PER_SECOND,
        )
        if not found:
            raise source.error(f"is no surface of triangles, or incomplete; {source.hint}")
        points, fields = dict(found["points"]), found["fields"]
        settings = {
            name.removeprefix(SETTING): str(text[0])
            for name, text in fields.items()
            if name.startswith(SETTING)
        }
        if not settings:
            return None
        for name, values in points.items():
            if f"{INFINITE}{name}" in fields:
                points[name] = _with_infinite(values, fields[f"{INFINITE}{name}"])
        stored = found["surface"] | _values(points, fingers_of(settings))
        stored |= {
            field.name: part[field.name]
            for field, part in ((CORNERS, found["cells"]), (CORNER_NORMALS, fields))
        }
    except CallFailedError as failure:
        raise damaged(source, f"the process that reads it {failure}") from failure
    except (KeyError, IndexError, ValueError, TypeError, OSError, MemoryError) as error:
        reason = " ".join(str(error).split())[:200] or type(error).__name__
        raise damaged(source, f"its arrays cannot be read ({reason})") from error
    return Stored(source, settings, stored, complete=True)


def _values(points: Arrays, fingers: int) -> Arrays:
    return {
        field.name: field.from_points(points, fingers)
        for field in VERTICES[1:]
        if field.array and set(field.point_names(fingers)) <= points.keys()
    }


def _with_infinite(values: Array, rows: Array) -> Array:
    """Infinite values again where `_signed_rows` says so."""
    found, above = values.copy(), rows >= 0
    found[rows[above]], found[~rows[~above]] = math.inf, -math.inf
    return found
