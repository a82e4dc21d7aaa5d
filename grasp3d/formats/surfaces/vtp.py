"""VTP files of labelled surfaces, for ParaView."""

from pathlib import Path

from grasp3d.surface.labels import SurfaceLabels
from grasp3d.system.files import atomic_write


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
