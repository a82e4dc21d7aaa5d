"""Export of labelled surfaces: PLY, GLB for viewing, and all arrays in NPZ, VTP and Parquet.

Heavy writers are imported when they are used.
"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh

from grasp3d.conversions import (
    SETTING,
    force_arrays,
    label_colors,
    labels_to_polydata,
    labels_to_table,
    located_arrays,
    reach_arrays,
    settings_of,
    vertex_arrays,
)
from grasp3d.errors import OutputError
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.system.files import atomic_write
from grasp3d.system.names import unsupported
from grasp3d.tables.ply_files import write_ply_columns


def write_ply(path: str | Path, labels: SurfaceLabels, *, binary: bool = True) -> None:
    """Write a labelled PLY: the mesh with one label, colour and set of numbers per vertex.

    Per vertex: x y z (double), outward nx ny nz, red green blue, `label` (uchar: 0 U, 1 M, 2 S),
    `critical_angle`, `critical_angle_best`, `max_resolution` and `margin` (float, radians; inf, 0
    and -inf where there is no grasp), `epsilon`, `epsilon_min` and `epsilon_max` (float; nan where
    there is no grasp). The settings are in comments that begin with `grasp3d`; of these
    `epsilon_min` and `epsilon_max` name how the two are computed.

    With a location error or values per finger also `located_angle` and `located_angle_best` (float,
    radians), which decide the labels.

    With a gripper also the approach direction `approach_x` `approach_y` `approach_z` and
    `approach_margin` (float, radians; nan where no grasp is reached).

    With a load also `grip_force`, `grip_force_least`, `grip_force_largest` (float, newtons; inf
    where no force suffices, nan where there is no grasp), `payload` (float, kg) if a force is at
    hand, and `label_with_force` (uchar) if the mass is known, too.

    Args:
        path: File to make or replace.
        labels: The labels.
        binary: Little-endian binary; otherwise text.

    Raises:
        OutputError: The file cannot be written.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> ball = grasp3d.load_mesh(trimesh.creation.icosphere(2), unit="cm", max_edge=9.0)
        >>> labels = grasp3d.label_surface(ball)
        >>> grasp3d.write_ply("ball.ply", labels)
        >>> trimesh.load_mesh("ball.ply").vertices.shape
        (162, 3)
    """
    mesh = labels.mesh
    outward = -mesh.normals
    colors = label_colors(labels)
    columns = {
        **{name: mesh.vertices[:, k].astype("<f8") for k, name in enumerate(("x", "y", "z"))},
        **{name: outward[:, k].astype("<f4") for k, name in enumerate(("nx", "ny", "nz"))},
        **{name: colors[:, k] for k, name in enumerate(("red", "green", "blue"))},
        "label": labels.label,
        "critical_angle": labels.critical_angle.astype("<f4"),
        "critical_angle_best": labels.critical_angle_best.astype("<f4"),
        "max_resolution": labels.max_resolution.astype("<f4"),
        "margin": labels.margin.astype("<f4"),
        "epsilon": labels.epsilon.astype("<f4"),
        "epsilon_min": labels.epsilon_min.astype("<f4"),
        "epsilon_max": labels.epsilon_max.astype("<f4"),
        **{name: values.astype("<f4") for name, values in located_arrays(labels).items()},
        **_reach_columns(labels),
        **_force_columns(labels),
    }
    write_ply_columns(Path(path), columns, mesh.faces, settings_of(labels), binary=binary)


def _reach_columns(labels: SurfaceLabels) -> dict[str, npt.NDArray[Any]]:
    """Columns of a labelled PLY that a gripper adds."""
    arrays = reach_arrays(labels)
    if not arrays:
        return {}
    approach = {f"approach_{axis}": arrays["approach"][:, k] for k, axis in enumerate("xyz")}
    columns = {**approach, "approach_margin": arrays["approach_margin"]}
    return {name: values.astype("<f4") for name, values in columns.items()}


def _force_columns(labels: SurfaceLabels) -> dict[str, npt.NDArray[Any]]:
    """Columns of a labelled PLY that a load adds."""
    return {
        name: values.astype("<f4") if values.dtype.kind == "f" else values
        for name, values in force_arrays(labels).items()
    }


def write_glb(path: str | Path, labels: SurfaceLabels) -> None:
    """Write a GLB coloured by label, for any 3-D viewer. Raises OutputError.

    The settings are in the extras of its asset, as text under `grasp3d`.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> ball = grasp3d.load_mesh(trimesh.creation.icosphere(2), unit="cm", max_edge=9.0)
        >>> labels = grasp3d.label_surface(ball)
        >>> grasp3d.write_glb("ball.glb", labels)
        >>> trimesh.load_scene("ball.glb").to_mesh().visual.vertex_colors.shape
        (162, 4)
    """
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
    settings = {key: str(value) for key, value in settings_of(labels).items()}

    def add_settings(tree: dict[str, Any]) -> None:
        tree["asset"]["extras"] = {"grasp3d": settings}

    content = trimesh.exchange.gltf.export_glb(
        mesh.scene(), include_normals=True, tree_postprocessor=add_settings
    )
    with atomic_write(Path(path)) as part:
        part.write_bytes(content)


def write_npz(path: str | Path, labels: SurfaceLabels) -> None:
    """Write every array as compressed NumPy, with the settings as strings. Raises OutputError.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> ball = grasp3d.load_mesh(trimesh.creation.icosphere(2), unit="cm", max_edge=9.0)
        >>> labels = grasp3d.label_surface(ball)
        >>> grasp3d.write_npz("ball.npz", labels)
        >>> import numpy as np
        >>> stored = np.load("ball.npz")
        >>> stored["partners"].shape, str(stored["setting_unit"])
        ((162, 1, 3), 'cm')
    """
    settings = {f"{SETTING}{key}": str(value) for key, value in settings_of(labels).items()}
    with atomic_write(Path(path)) as part, part.open("wb") as stream:
        arrays: dict[str, Any] = {
            "vertices": labels.mesh.vertices,
            "faces": labels.mesh.faces,
            **vertex_arrays(labels),
            **settings,
        }
        np.savez_compressed(stream, **arrays)


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

    data = labels_to_polydata(labels)
    # VTK writes to memory: on a full disk its own file output ends the process.
    writer = vtkXMLPolyDataWriter()
    writer.SetInputData(data)
    writer.SetDataModeToBinary()
    writer.WriteToOutputStringOn()
    writer.Write()
    with atomic_write(Path(path)) as part:
        part.write_text(writer.GetOutputString(), encoding="ascii")


def write_fields(path: str | Path, labels: SurfaceLabels) -> None:
    """Write a Parquet table with a row for each vertex, for pandas, Polars and DuckDB.

    Columns: x y z (double, in the mesh's unit), outward nx ny nz, `area` around the vertex, `label`
    (text: S, M, U), `critical_angle`, `critical_angle_best`, `max_resolution` and `margin`
    (radians; inf, 0 and -inf where there is no grasp), `epsilon`, `epsilon_min`, `epsilon_max` and
    `opening` (nan where there is none), `grip`, `reason` (text, as in `Reason`), and of each other
    finger `partner_2_x` ... (double) and outward `partner_2_nx` ... (nan where there is none).
    Numbers are floats; nan and inf are kept and nothing is null. With a location error or values
    per finger also `located_angle` and `located_angle_best` (radians). With a gripper also the axes
    and the origin of each pose, `approach_x` ..., `closing_x` ... and `tcp_x` ... (double),
    `approach_margin` (radians), `depth` and `pregrasp_opening`. With a load also `grip_force`,
    `grip_force_least`, `grip_force_largest` (newtons), `payload` (kg) if a force is at hand, and
    `label_with_force` (text) if the mass is known, too. The settings are in the schema's metadata
    under `grasp3d` as JSON.

    Args:
        path: File to make or replace.
        labels: The labels.

    Raises:
        OutputError: The file cannot be written.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> ball = grasp3d.load_mesh(trimesh.creation.icosphere(2), unit="cm", max_edge=9.0)
        >>> labels = grasp3d.label_surface(ball)
        >>> grasp3d.write_fields("ball.parquet", labels)
        >>> import pyarrow.parquet
        >>> table = pyarrow.parquet.read_table("ball.parquet", columns=["label", "opening"])
        >>> table.num_rows, table["label"].unique().to_pylist()
        (162, ['S'])
    """
    from grasp3d.tables import write_arrow

    write_arrow(Path(path), labels_to_table(labels))


WRITERS: dict[str, Callable[[Path, SurfaceLabels], None]] = {
    ".ply": write_ply,
    ".glb": write_glb,
    ".npz": write_npz,
    ".vtp": write_vtp,
    ".parquet": write_fields,
}


def writer_for(path: Path) -> Callable[[Path, SurfaceLabels], None]:
    """Choose the writer by the file's suffix.

    Raises:
        OutputError: No writer has that suffix.
    """
    writer = WRITERS.get(path.suffix.lower())
    if writer is None:
        raise OutputError(unsupported(path, WRITERS))
    return writer
