"""VTP files and PyVista data of meshes and labels."""

import math
from pathlib import Path

from grasp3d.export.stored import Stored, damaged, fingers_of, settings_in
from grasp3d.export.vtp_arrays import vtp_arrays
from grasp3d.mesh.reading.sources import Source
from grasp3d.surface.fields import Array, Arrays
from grasp3d.surface.label_settings import INFINITE
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_fields import CORNER_NORMALS, CORNERS, VERTICES
from grasp3d.system.files import atomic_write
from grasp3d.system.names import reason_of


def write_vtp(path: str | Path, labels: SurfaceLabels) -> None:
    """Write a VTP for ParaView with every array; nan where there is no grasp. Raises OutputError.

    Each of the other fingers has its own arrays: `partner_2`, `partner_2_normal`, and so on.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> ball = grasp3d.load_mesh(trimesh.creation.icosphere(2), unit="cm", max_edge="9cm")
        >>> labels = grasp3d.label_surface(ball)
        >>> grasp3d.write_vtp("ball.vtp", labels)
        >>> import pyvista
        >>> pyvista.read("ball.vtp").point_data["partner_2"].shape
        (162, 3)
    """
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    # VTK writes to memory: on a full disk its own file output ends the process.
    writer = vtkXMLPolyDataWriter()
    data = labels.to_polydata()
    data.points = labels.mesh.file_points.copy()
    writer.SetInputData(data)
    writer.SetDataModeToBinary()
    writer.WriteToOutputStringOn()
    writer.Write()
    with atomic_write(Path(path)) as part:
        part.write_text(writer.GetOutputString(), encoding="ascii")


def read_vtp(source: Source) -> Stored | None:
    """Read a VTP of labels; None: it has none of grasp3d. Raises MeshError."""
    if b"VTKFile" not in source.path.read_bytes():
        raise source.unexpected("is no VTP")
    try:
        arrays = vtp_arrays(source.path)
        if not arrays:
            raise source.unexpected("is no surface of triangles, or incomplete")
        points, fields = dict(arrays["points"]), arrays["fields"]
        settings = settings_in(fields)
        if not settings:
            return None
        for name, values in points.items():
            if f"{INFINITE}{name}" in fields:
                points[name] = _with_infinite(values, fields[f"{INFINITE}{name}"])
        stored = arrays["surface"] | _values(points, fingers_of(settings))
        stored |= {
            field.name: part[field.name]
            for field, part in ((CORNERS, arrays["cells"]), (CORNER_NORMALS, fields))
        }
    except (KeyError, IndexError, ValueError, TypeError, OSError, MemoryError) as error:
        raise damaged(source, f"its arrays cannot be read ({reason_of(error)})") from error
    return Stored(source, settings, stored)


def _values(points: Arrays, fingers: int) -> Arrays:
    return {
        field.name: field.from_points(points, fingers)
        for field in VERTICES[1:]
        if field.array and set(field.point_names(fingers)) <= points.keys()
    }


def _with_infinite(values: Array, rows: Array) -> Array:
    """Infinite values again where `_signed_rows` says so."""
    result, above = values.copy(), rows >= 0
    result[rows[above]], result[~rows[~above]] = math.inf, -math.inf
    return result
