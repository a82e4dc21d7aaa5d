"""Files of labelled surfaces for other programs, which are not read again."""

from pathlib import Path
from typing import Any

import numpy as np

from grasp3d.surface.fields import XYZ
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_fields import label_colors
from grasp3d.system.files import atomic_write


def write_glb(path: str | Path, labels: SurfaceLabels) -> None:
    """Write a GLB coloured by label, for any 3-D viewer. Raises OutputError.

    The settings are in the extras of its asset, as text under `grasp3d`.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> ball = grasp3d.load_mesh(trimesh.creation.icosphere(2), unit="cm", max_edge="9cm")
        >>> labels = grasp3d.label_surface(ball)
        >>> grasp3d.write_glb("ball.glb", labels)
        >>> trimesh.load_scene("ball.glb").to_mesh().visual.vertex_colors.shape
        (162, 4)
    """
    import trimesh

    srgb = label_colors(labels) / 255.0
    # glTF's vertex colours are linear, the colours of the legend are sRGB.
    linear = np.where(srgb <= 0.04045, srgb / 12.92, ((srgb + 0.055) / 1.055) ** 2.4)
    mesh = trimesh.Trimesh(
        labels.mesh.vertices,
        labels.mesh.faces,
        vertex_normals=-labels.mesh.normals,
        vertex_colors=np.round(255.0 * linear).astype(np.uint8),
        process=False,
    )
    settings = {key: str(value) for key, value in labels.settings().items()}

    def add_settings(tree: dict[str, Any]) -> None:
        tree["asset"]["extras"] = {"grasp3d": settings}

    content = trimesh.exchange.gltf.export_glb(
        mesh.scene(), include_normals=True, tree_postprocessor=add_settings
    )
    with atomic_write(Path(path)) as part:
        part.write_bytes(content)


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


def write_fields(path: str | Path, labels: SurfaceLabels) -> None:
    """Write a Parquet table with a row for each vertex, for pandas, Polars and DuckDB.

    Columns: x y z (in the coordinates of the mesh's own file), outward nx ny nz, `area` around the
    vertex, `label` (text: S, M, U), `critical_angle`, `critical_angle_best`, `max_resolution` and
    `margin` (radians; inf, 0 and -inf where there is no grasp), `epsilon`, `epsilon_min`,
    `epsilon_max` and `opening` (nan where there is none), `grip`, `reason` (text, as in `Reason`),
    of each other finger `partner_2_x` ... and outward `partner_2_nx` ... (nan where there is none),
    and more, see the page on file formats. nan and inf are kept and nothing is null. The settings
    are in the schema's metadata under `grasp3d` as JSON; the faces are not in it.

    Args:
        path: File to make or replace.
        labels: The labels.

    Raises:
        OutputError: The file cannot be written.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> ball = grasp3d.load_mesh(trimesh.creation.icosphere(2), unit="cm", max_edge="9cm")
        >>> labels = grasp3d.label_surface(ball)
        >>> grasp3d.write_fields("ball.parquet", labels)
        >>> import pyarrow.parquet
        >>> table = pyarrow.parquet.read_table("ball.parquet", columns=["label", "opening"])
        >>> table.num_rows, table["label"].unique().to_pylist()
        (162, ['S'])
    """
    from grasp3d.system.tables import write_arrow

    table = labels.to_table()
    for name, column in zip(XYZ, labels.mesh.file_points.T, strict=True):
        table = table.set_column(table.column_names.index(name), name, [column])
    write_arrow(Path(path), table)
