"""Files of labelled surfaces: PLY and NPZ, which can be read back, and GLB, VTP and Parquet.

A PLY has columns of numbers at its vertices, and settings in comments.
"""

import base64
import io
import math
import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import IO, Any, get_args

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import ARCHIVE_ERRORS, Floats, Ints, locked, text_of
from grasp3d.errors import MeshError
from grasp3d.formats.stored_surfaces import (
    DAMAGE,
    FIELDS,
    FileSettings,
    Stored,
    check_stored,
    damaged,
    fingers_of,
    settings_from,
)  # fmt: skip
from grasp3d.hand.reach import ANGLES, Reach
from grasp3d.mesh import MeshReport, ObjectMesh
from grasp3d.mesh.mesh_files import open_ply, read_elements
from grasp3d.mesh.normals import CornerNormals
from grasp3d.mesh.object_mesh import scale_of
from grasp3d.mesh.repair import RepairStep
from grasp3d.mesh.sources import Source, find_source
from grasp3d.mesh.surface_points import SurfacePoints
from grasp3d.quality.force_ranges import Certainty, EpsilonRange
from grasp3d.settings.units import Unit, with_lengths_scaled
from grasp3d.surface.fields import (
    AREA,
    DECIDED,
    EPSILONS,
    FLOAT,
    LENGTH,
    XYZ,
    Arrays,
    Field,
    present,
)
from grasp3d.surface.labels import SETTING, SurfaceLabels
from grasp3d.surface.load_case import LoadCase, LoadResult
from grasp3d.surface.vertex_fields import SURFACE, VERTICES, Reason, label_colors, unpacked_bits
from grasp3d.system.documents import newer_version, parse_json
from grasp3d.system.files import atomic_write, check_suffix
from grasp3d.system.limited_reading import read_file
from grasp3d.system.names import printable, reason_of

_TYPES = {"<f8": "double", "<f4": "float", "|u1": "uchar", "<i4": "int"}

COMMENT, MORE = "comment grasp3d ", "comment grasp3d+ "
"""Start of a line with a setting, and of the lines that continue its value."""

FACE = np.dtype([("count", "u1"), ("corners", "<i4", 3)])
FACES = "property list uchar int vertex_indices"
"""Record of a triangle, and its line in the header."""

WIDTH = 200
"""Longest part of a value in one line: MeshLab and Open3D cannot read headers with long lines."""


def write_ply_columns(
    path: Path, columns: Mapping[str, npt.NDArray[Any]], faces: Ints, settings: Mapping[str, Any]
) -> None:
    """Write a binary PLY of triangles, with settings in comments that begin with `grasp3d`.

    The file has no elements but vertices and faces, and no property of faces but their corners:
    some programs read no others.

    Args:
        path: File to make or replace.
        columns: Vertex properties by name, x y z among them, (V,) each; of 64 or 32 bits, or bytes.
        faces: Faces (F, 3).
        settings: Values without line breaks, by name.

    Raises:
        OutputError: The file cannot be written.
    """
    count = len(next(iter(columns.values())))
    vertices = np.empty(count, dtype=[(name, column.dtype) for name, column in columns.items()])
    for name, column in columns.items():
        vertices[name] = column
    rows = np.empty(len(faces), FACE)
    rows["count"], rows["corners"] = 3, faces
    header = "\n".join(
        [
            "ply",
            "format binary_little_endian 1.0",
            *(line for key, value in settings.items() for line in _lines(key, str(value))),
            f"element vertex {count}",
            *(f"property {_TYPES[c.dtype.str]} {name}" for name, c in columns.items()),
            f"element face {len(faces)}",
            FACES,
            "end_header\n",
        ]
    )
    with atomic_write(path) as part, part.open("wb") as stream:
        stream.write(header.encode("ascii"))
        vertices.tofile(stream)
        rows.tofile(stream)


def _lines(key: str, value: str) -> Iterator[str]:
    """Split a setting into lines of a header, never at spaces, because programs strip these."""
    first, *rest = re.findall(rf".{{0,{WIDTH - 1}}}\S(?!\s)|.+", value) or [""]
    yield f"{COMMENT}{key} {first}"
    yield from (f"{MORE}{part}" for part in rest)


def settings_of_header(header: bytes) -> dict[str, str]:
    """The settings in the header of a PLY, as text by name."""
    text = header.decode("ascii", "replace").replace("\r\n", "\n").replace(f"\n{MORE}", "")
    lines = (line for line in text.splitlines() if line.startswith(COMMENT))
    parts = (line.removeprefix(COMMENT).partition(" ") for line in lines)
    return {name: value for name, _, value in parts}


def write_npz(path: str | Path, labels: SurfaceLabels) -> None:
    """Write every array to a compressed NPZ, with the settings as strings. Raises OutputError.

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
    """Values of the fields of labels and of their mesh, by name."""
    return {
        field.name: values
        for field in fields
        for _, values in present([field], labels.mesh if field in SURFACE else labels)
    }


def read_npz(source: Source) -> Stored | None:
    """Read an NPZ of labels; None: it has no settings of grasp3d. Raises MeshError."""
    with source.path.open("rb") as stream:
        stored = _read(source, stream)
    return stored if stored.settings else None


def _read(source: Source, stream: IO[bytes]) -> Stored:
    """Read the known fields and the settings of an NPZ, without unpickling. Raises MeshError."""
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
    grasp), the opposing contacts `partner_2_x` ... of its grasp. A gripper (the pose) or a load
    adds further fields; see the page on file formats. Comments that begin with `grasp3d` contain
    the settings, and what else `read_labels` needs.

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
"""Name of the comment with the further arrays of the grasps and the surface, an NPZ in base64."""

HIDDEN = tuple(f for f in VERTICES if f.array and not f.ply and f.name != "partner_normals")
"""Vertex fields in that comment; the normals of opposing contacts follow from the contacts."""


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

    The extras of its asset contain the settings, as text under `grasp3d`.

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
    for each other finger `partner_2_x` ... and outward `partner_2_nx` ... (nan where there is
    none), and more; see the page on file formats. nan and inf are kept and nothing is null. The
    schema's metadata contain the settings as JSON under `grasp3d`; the file has no faces.

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


WRITERS: dict[str, Callable[[Path, SurfaceLabels], None]] = {
    ".ply": write_ply, ".glb": write_glb, ".npz": write_npz,
    ".vtp": write_vtp, ".parquet": write_fields,
}  # fmt: skip
READERS = {".ply": read_ply, ".npz": read_npz}
"""Writers and readers of labelled surfaces, by suffix."""


def writer_for(path: Path) -> Callable[[Path, SurfaceLabels], None]:
    """Choose the writer by the file's suffix.

    Raises:
        OutputError: No writer has that suffix.
    """
    check_suffix(path, WRITERS, "")
    return WRITERS[path.suffix.lower()]


def read_labels(path: str | Path, *, unit: Unit | None = None) -> SurfaceLabels:
    """Read a labelled PLY or NPZ file.

    The labels are those that were written, bit for bit, with their grasps, mesh and settings.

    Args:
        path: A file that `write_ply` or `write_npz` wrote.
        unit: Unit of the mesh, for files that state none.

    Raises:
        MeshError: The file is missing, damaged, or was not written by grasp3d.

    Example:
        >>> import trimesh
        >>> import grasp3d
        >>> ball = grasp3d.load_mesh(trimesh.creation.icosphere(2), unit="cm", max_edge="9cm")
        >>> grasp3d.write_npz("ball.npz", grasp3d.label_surface(ball))
        >>> labels = grasp3d.read_labels("ball.npz")
        >>> labels
        <SurfaceLabels of trimesh.Trimesh: 162 vertices, ...; S 100.0%, M 0.0%, U 0.0%>
        >>> labels.relabel(friction=0.1).fractions()["S"], labels.mesh.file_unit
        (0.0, 'cm')
    """
    labels = labels_in(Path(path), unit=unit)
    if labels is None:
        kind, where = Path(path).suffix[1:].upper(), printable(str(path))
        raise MeshError(f"{where}: is not a {kind} labelled by grasp3d; label it first")
    return labels


def labels_in(path: Path, *, unit: Unit | None = None) -> SurfaceLabels | None:
    """The labels of a file; None: it has none, such as a PLY of a mesh. See `read_labels`."""
    stored = read_file(_stored, path)
    if stored is None:
        return None
    if newer := newer_version(stored.settings.get("version")):
        raise MeshError(f"{stored.source.where}: {newer}")
    try:
        return _labels(stored, unit)
    except DAMAGE as error:
        raise damaged(stored.source, error) from error


def _stored(path: Path) -> Stored | None:
    """Arrays and settings of a file; None: it has no labels."""
    source = find_source(path, READERS)
    return READERS[f".{source.kind}"](source)


def _labels(stored: Stored, unit: Unit | None) -> SurfaceLabels:
    """Check stored values, and make labels of them. Raises one of `DAMAGE`."""
    settings, values = settings_from(stored.settings), stored.values
    check_stored(stored, settings)
    mesh = _mesh(stored, settings)
    if mesh.unit is None and unit is not None:
        mesh = mesh.with_unit(unit)
    if mesh.options.region is not None:
        mesh = replace(mesh, region=locked(values["reason"] != Reason.EXCLUDED))
    if (
        mesh.unit is not None and settings.options.stated_unit is None
    ):  # lengths are in metres from here
        scale = scale_of(mesh.file_unit)
        powers = {LENGTH: scale, AREA: scale**2}
        values = {name: one * powers.get(FIELDS[name].unit, 1) for name, one in values.items()}
        settings = replace(
            settings,
            model=with_lengths_scaled(settings.model, scale),
            sampling=with_lengths_scaled(settings.sampling, scale),
        )

    def floats(*names: str) -> Any:
        return (locked(values[name], np.float64) for name in names)

    partners = SurfacePoints(locked(values["partner_faces"]), locked(values["partner_weights"]))
    labels = SurfaceLabels.of_vertices(
        mesh, settings.model, angles=tuple(floats("critical_angle", "critical_angle_best")),
        partner_points=partners, grip=values["grip"], reason=values["reason"],
        reach=_reach(values, settings), sampling=settings.sampling, mode=settings.mode,
        search=settings.search, scene=settings.scene, load=settings.load,
    )  # fmt: skip
    known: dict[str, Any] = {
        "label": locked(values["label"]),
        "epsilon_range": EpsilonRange(*floats("epsilon", "epsilon_min", "epsilon_max")),
    }
    if settings.load is not None and "force_bounds" in stored.settings:
        known["load_result"] = _load_result(values, settings, mesh, stored.settings["force_bounds"])
    vars(labels).update(known)
    return labels


def _reach(values: Arrays, settings: FileSettings) -> Reach | None:
    """How the gripper reaches the grasps; None: there is no gripper."""
    if settings.scene is None:
        return None
    columns = [values[name] for name in ("closing", "lateral", "approach", "tcp")]
    poses = np.full((len(columns[3]), 4, 4), math.nan)
    poses[:, :3] = np.stack(columns, axis=2)
    poses[np.isfinite(columns[3]).all(axis=1), 3] = 0.0, 0.0, 0.0, 1.0
    bits = values.get("free_angles")
    free = np.zeros((len(poses), 0), bool) if bits is None else unpacked_bits(bits, ANGLES)
    floats = ("approach_margin", "pregrasp_opening", "depth")
    return Reach(
        state=locked(values["reach_state"]),
        poses=locked(poses),
        opening=locked(values["held_opening"], np.float64),
        free=locked(free),
        **{name: locked(values[name], np.float64) for name in floats},
    )


def _load_result(values: Arrays, settings: FileSettings, mesh: ObjectMesh, how: Any) -> LoadResult:
    """Forces and payloads under the load. Raises one of `DAMAGE`."""
    load, scene = settings.load, settings.scene
    if load is None or how not in get_args(Certainty):
        raise ValueError(f"its force_bounds are {how[:20]!r}")
    case = LoadCase.of(load, mesh, settings.model, None if scene is None else scene.hand)
    has_payload = case.available is not None and case.task.mass is not None
    payload = values["payload"] if has_payload else np.full(len(values["label"]), math.nan)
    resistance = values.get("resistance")
    forces = ("grip_force", "grip_force_least", "grip_force_largest")
    return LoadResult(
        case=case,
        payload=locked(payload, np.float64),
        resistance=None if resistance is None else locked(resistance),
        how=how,
        **{name: locked(values[name], np.float64) for name in forces},
    )


def _mesh(stored: Stored, settings: FileSettings) -> ObjectMesh:
    """Restore the mesh that was labelled. Raises one of `DAMAGE`."""
    surface, values = dict(parse_json(stored.settings["surface"])), stored.values
    vertices, faces, canonical = (values[name] for name in ("vertices", "faces", "canonical"))
    if (canonical[canonical] != canonical).any() or (canonical[faces] != faces).any():
        raise ValueError("its faces do not use canonical vertices")
    corners, normals = values["corners"], -values["corner_normals"]
    of_vertices = np.zeros(len(normals), dtype=np.int64)
    of_vertices[corners] = faces
    if (of_vertices[corners] != faces).any():
        raise ValueError("corners of several vertices have one normal")
    center, center_mass = (_finite(surface[name], (3,)) for name in ("center", "center_mass"))
    size = _finite(surface["size"], ())
    if not size > 0.0:
        raise ValueError(f"its size is {size}")
    report = dict(surface["report"])
    report["repairs"] = tuple(RepairStep(**step) for step in report["repairs"])
    report["source"], report["warnings"] = str(report["source"]), tuple(report["warnings"])
    mesh = ObjectMesh(
        vertices=locked(
            vertices * (scale_of(settings.options.stated_unit) * settings.options.scale)
        ),
        file_points=locked(vertices), faces=locked(faces), canonical=locked(canonical),
        file_vertices=settings.file_vertices,
        corner_normals=CornerNormals(locked(corners), locked(normals), locked(of_vertices)),
        center=locked(center), size=float(size), center_mass=locked(center_mass),
        volume=float(surface["volume"]), options=settings.options, report=MeshReport(**report),
    )  # fmt: skip
    if mesh.file_unit != settings.options.stated_unit:
        raise ValueError(f"its unit is {mesh.file_unit} and {settings.options.stated_unit}")
    return mesh


def _finite(values: Any, shape: tuple[int, ...]) -> Floats:
    numbers = np.array(values, dtype=np.float64)
    if numbers.shape != shape or not np.isfinite(numbers).all():
        raise ValueError(f"{str(values)[:60]} are not {math.prod(shape)} finite numbers")
    return numbers
