"""Formats of labelled surfaces: PLY and NPZ, which are read again, and GLB, VTP and Parquet."""

import base64
import io
from collections.abc import Iterable
from pathlib import Path
from typing import IO, Any

import numpy as np

from grasp3d.arrays import ARCHIVE_ERRORS, text_of
from grasp3d.formats.surfaces.stored import FIELDS, Stored, damaged, fingers_of
from grasp3d.mesh.reading.polygon_files import open_ply, read_elements
from grasp3d.mesh.reading.sources import Source
from grasp3d.surface.fields import DECIDED, EPSILONS, FLOAT, XYZ, Field, present
from grasp3d.surface.label_settings import SETTING
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_fields import SURFACE, VERTICES, label_colors
from grasp3d.system.files import atomic_write
from grasp3d.system.names import reason_of
from grasp3d.system.ply_files import settings_of_header, write_ply_columns


def write_npz(path: str | Path, labels: SurfaceLabels) -> None:
    """Write every array as compressed NumPy, with the settings as strings. Raises OutputError.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> ball = grasp3d.load_mesh(trimesh.creation.icosphere(2), unit="cm", max_edge="9cm")
        >>> labels = grasp3d.label_surface(ball)
        >>> grasp3d.write_npz("ball.npz", labels)
        >>> import numpy as np
        >>> stored = np.load("ball.npz")
        >>> stored["partners"].shape, str(stored["setting_unit"])
        ((162, 1, 3), 'cm')
    """
    arrays = _arrays((*SURFACE, *(field for field in VERTICES if field.array)), labels)
    for key, value in labels.complete_settings().items():
        arrays[f"{SETTING}{key}"] = str(value)
    with atomic_write(Path(path)) as part, part.open("wb") as stream:
        np.savez_compressed(stream, **arrays)


def _arrays(fields: Iterable[Field], labels: SurfaceLabels) -> dict[str, Any]:
    """Fields of labels, and of their mesh, by name."""
    return {
        field.name: values
        for field in fields
        for _, values in present([field], labels.mesh if field in SURFACE else labels)
    }


def read_npz(source: Source) -> Stored | None:
    """Read an NPZ of labels; None: it has none of grasp3d. Raises MeshError."""
    with source.path.open("rb") as stream:
        stored = _read(source, stream)
    return stored if stored.settings else None


def _read(source: Source, stream: IO[bytes]) -> Stored:
    """The arrays that are fields, and the settings; nothing is unpickled. Raises MeshError."""
    try:
        with np.load(stream, allow_pickle=False) as archive:
            values = {name: np.asarray(archive[name]) for name in archive.files if name in FIELDS}
            settings = {
                name.removeprefix(SETTING): text_of(archive[name])
                for name in archive.files
                if name.startswith(SETTING)
            }
    except ARCHIVE_ERRORS as error:
        reason = reason_of(error)
        raise source.error(f"its arrays cannot be read ({reason}); label the mesh again") from error
    return Stored(source, settings, values)


def write_ply(path: str | Path, labels: SurfaceLabels) -> None:
    """Write a labelled PLY: the mesh with one label, colour and set of numbers per vertex.

    Per vertex: x y z, outward nx ny nz, red green blue, `label` (uchar: 0 U, 1 M, 2 S),
    `critical_angle`, `critical_angle_best`, `max_resolution` and `margin` (radians; inf, 0 and -inf
    where there is no grasp), `epsilon`, `epsilon_min` and `epsilon_max` (nan where there is no
    grasp), the opposing contacts `partner_2_x` ... of its grasp; with a location error, a gripper
    (the pose) or a load further fields, see the page on file formats. The settings are in comments
    that begin with `grasp3d`, and what else `read_labels` needs.

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
        >>> grasp3d.write_ply("ball.ply", labels)
        >>> trimesh.load_mesh("ball.ply").vertices.shape
        (162, 3)
    """
    fields = (field for field in VERTICES if field.ply)
    columns = {
        name: column.astype(field.ply)
        for field, values in present(fields, labels)
        for name, column in field.as_columns(values).items()
    }
    stream = io.BytesIO()
    np.savez_compressed(stream, **_arrays((*HIDDEN, *SURFACE[1:]), labels))
    packed = base64.b64encode(stream.getvalue()).decode("ascii")
    settings = {**labels.complete_settings(), PACKED: packed}
    write_ply_columns(Path(path), columns, labels.mesh.faces, settings)


PACKED = "packed"
"""Name of the comment with what is not shown of the grasps and the surface, an NPZ in base64."""

HIDDEN = tuple(f for f in VERTICES if f.array and not f.ply and f.name != "partner_normals")
"""What a PLY has of the vertices in that comment; the normals there follow from the contacts."""


LABELLED = tuple(field.name for field in (*DECIDED, *EPSILONS))
"""Vertex properties that only a labelled file has. A file that has any of them must have all, with
the types, values and comments that `write_ply` writes; otherwise it is refused, as its numbers
could mean anything. Other properties (colours, confidence, texture coordinates) are allowed."""


def read_ply(source: Source) -> Stored | None:
    """Read a labelled PLY; None: it has no labels. Raises MeshError."""
    file = open_ply(source)
    settings, elements = settings_of_header(file.header), file.elements
    names = elements["vertex"].properties if "vertex" in elements else {}
    missing = [name for name in LABELLED if name not in names]
    if len(missing) == len(LABELLED):
        return None
    if missing:
        raise damaged(source, ValueError(f"its vertices have no property {missing[0]!r}"))
    try:
        fingers, read = fingers_of(settings), read_elements(file)
        columns = {name: np.array(one) for name, one in read["vertex"].items()}
        faces = np.array(read["face"]["vertex_indices"], np.int64).reshape(-1, 3)
        packed = io.BytesIO(base64.b64decode(settings.pop(PACKED), validate=True))
        values = {**_read(source, packed).values, "faces": faces}
        if file.order != "<":
            raise ValueError("it is not binary")  # noqa: TRY301
    except (OSError, MemoryError, ValueError, OverflowError, LookupError) as error:
        raise damaged(source, error) from error
    for field in VERTICES:
        if field.ply not in {"", FLOAT} and {*field.column_names(fingers)} <= columns.keys():
            values[field.name] = field.from_columns(columns, fingers)
    return Stored(source, settings, values)


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

    content = trimesh.exchange.gltf.export_glb(
        mesh.scene(),
        include_normals=True,
        tree_postprocessor=lambda tree: tree["asset"].update(extras={"grasp3d": settings}),
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
