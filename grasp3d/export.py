"""Export of labelled surfaces: PLY, GLB for viewing, and all arrays in NPZ, VTP and Parquet.

Heavy writers are imported when they are used.
"""

import math
from collections.abc import Callable
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import trimesh

from grasp3d.arrays import Bytes, Floats
from grasp3d.errors import OutputError
from grasp3d.stability.label import COLORS, Label
from grasp3d.surface.epsilon import EPSILON_RTOL
from grasp3d.surface.labels import SurfaceLabels
from grasp3d.surface.vertex_grasps import Reason
from grasp3d.system.files import atomic_write
from grasp3d.system.versions import package_version

_FIELDS = ("label", "critical_angle", "critical_angle_best", "max_resolution", "epsilon",
           "epsilon_min", "epsilon_max", "opening", "grip", "reason")  # fmt: skip
_PLY_TYPES = {"<f8": "double", "<f4": "float", "|u1": "uchar", "<i4": "int"}


def label_colors(labels: SurfaceLabels) -> Bytes:
    """Colour of each vertex by its label, red, green, blue, shape (V, 3)."""
    table = np.array([COLORS[label] for label in sorted(COLORS)], dtype=np.uint8)
    return table[labels.label]


def write_ply(path: str | Path, labels: SurfaceLabels, *, binary: bool = True) -> None:
    """Write a labelled PLY: the mesh with one label, colour and set of numbers per vertex.

    Per vertex: x y z (double), outward nx ny nz, red green blue, `label` (uchar: 0 U, 1 M, 2 S),
    `critical_angle`, `critical_angle_best` and `max_resolution` (float, radians; inf and 0 where
    there is no grasp), `epsilon`, `epsilon_min` and `epsilon_max` (float; nan where there is no
    grasp). The settings are in comments that begin with `grasp3d`; of these `epsilon_min` and
    `epsilon_max` name how the two are computed.

    Args:
        path: File to make or replace.
        labels: The labels.
        binary: Little-endian binary; otherwise text.

    Raises:
        OutputError: The file cannot be written.
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
        "epsilon": labels.epsilon.astype("<f4"),
        "epsilon_min": labels.epsilon_min.astype("<f4"),
        "epsilon_max": labels.epsilon_max.astype("<f4"),
    }
    vertices = np.empty(
        len(mesh.vertices), dtype=[(name, column.dtype) for name, column in columns.items()]
    )
    for name, column in columns.items():
        vertices[name] = column
    faces = np.empty(len(mesh.faces), dtype=[("count", "u1"), ("corners", "<i4", 3)])
    faces["count"], faces["corners"] = 3, mesh.faces
    header = "\n".join(
        [
            "ply",
            f"format {'binary_little_endian' if binary else 'ascii'} 1.0",
            *(f"comment grasp3d {key} {value}" for key, value in settings_of(labels).items()),
            f"element vertex {len(vertices)}",
            *(f"property {_PLY_TYPES[c.dtype.str]} {name}" for name, c in columns.items()),
            f"element face {len(faces)}",
            "property list uchar int vertex_indices",
            "end_header\n",
        ]
    )
    with atomic_write(Path(path)) as part, part.open("wb") as stream:
        stream.write(header.encode("ascii"))
        if binary:
            vertices.tofile(stream)
            faces.tofile(stream)
        else:
            for row in vertices:
                stream.write((" ".join(str(value) for value in row) + "\n").encode())
            np.savetxt(stream, np.column_stack([faces["count"], faces["corners"]]), fmt="%d")


def write_glb(path: str | Path, labels: SurfaceLabels) -> None:
    """Write a GLB coloured by label, for any 3-D viewer. Raises OutputError."""
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
    with atomic_write(Path(path)) as part:
        part.write_bytes(trimesh.exchange.gltf.export_glb(mesh.scene(), include_normals=True))


def write_npz(path: str | Path, labels: SurfaceLabels) -> None:
    """Write every array as compressed NumPy, with the settings as strings. Raises OutputError."""
    settings = {f"setting_{key}": str(value) for key, value in settings_of(labels).items()}
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
    """
    import pyvista
    from vtkmodules.vtkIOXML import vtkXMLPolyDataWriter

    data = pyvista.PolyData.from_regular_faces(labels.mesh.vertices, labels.mesh.faces.astype(int))
    for name, values in _by_finger(vertex_arrays(labels)).items():
        # An infinite value would stretch ParaView's colour map; nan has a separate colour.
        data.point_data[name] = (
            np.where(np.isinf(values), math.nan, values) if values.dtype.kind == "f" else values
        )
    for key, value in settings_of(labels).items():
        data.field_data[key] = [str(value)]
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
    (text: S, M, U), `critical_angle`, `critical_angle_best` and `max_resolution` (radians; inf and
    0 where there is no grasp), `epsilon`, `epsilon_min`, `epsilon_max` and `opening` (nan where
    there is none), `grip`, `reason` (text, as in `Reason`), and of each other finger `partner_2_x`
    ... (double) and outward `partner_2_nx` ... (nan where there is none). Numbers are floats; nan
    and inf are kept and nothing is null. The settings are in the schema's metadata under `grasp3d`
    as JSON.

    Args:
        path: File to make or replace.
        labels: The labels.

    Raises:
        OutputError: The file cannot be written.
    """
    from grasp3d.tables import write_arrays

    arrays = vertex_arrays(labels)
    columns = _by_axis("", labels.mesh.vertices, "f8") | _by_axis("n", arrays["normal"], "f4")
    columns["area"] = labels.mesh.vertex_areas.astype("f4")
    for name in _FIELDS:
        values = arrays[name]
        columns[name] = values.astype("f4") if values.dtype.kind == "f" else values
    for finger in range(labels.partners.shape[1]):
        head, normals = f"partner_{finger + 2}_", arrays["partner_normals"][:, finger]
        columns |= _by_axis(head, labels.partners[:, finger], "f8")
        columns |= _by_axis(f"{head}n", normals, "f4")
    texts = {
        "label": [label.name for label in sorted(Label)],
        "reason": [reason.name.lower() for reason in sorted(Reason)],
    }
    write_arrays(Path(path), columns, texts, settings=settings_of(labels))


def _by_axis(head: str, vectors: Floats, kind: str) -> dict[str, npt.NDArray[Any]]:
    """Columns of vectors, shape (V, 3)."""
    return {f"{head}{axis}": vectors[:, k].astype(kind) for k, axis in enumerate("xyz")}


def vertex_arrays(labels: SurfaceLabels) -> dict[str, npt.NDArray[Any]]:
    """Collect all arrays over the vertices by name; normals point outward, as in files.

    `partners` and `partner_normals` have a row for each of the other fingers, (V, n - 1, 3).
    """
    return {
        "normal": -labels.mesh.normals,
        "color": label_colors(labels),
        "label": labels.label,
        "critical_angle": labels.critical_angle,
        "critical_angle_best": labels.critical_angle_best,
        "max_resolution": labels.max_resolution,
        "epsilon": labels.epsilon,
        "epsilon_min": labels.epsilon_min,
        "epsilon_max": labels.epsilon_max,
        "partners": labels.partners,
        "partner_normals": -labels.partner_normals,
        "opening": labels.opening,
        "grip": labels.grip,
        "reason": labels.reason,
    }


def _by_finger(arrays: dict[str, npt.NDArray[Any]]) -> dict[str, npt.NDArray[Any]]:
    """Split arrays over fingers into one per finger, as VTK's point data are at most vectors."""
    split: dict[str, npt.NDArray[Any]] = {}
    for name, values in arrays.items():
        if name == "partners":
            split.update({f"partner_{i}": row for i, row in enumerate(values.swapaxes(0, 1), 2)})
        elif name == "partner_normals":
            normals = enumerate(values.swapaxes(0, 1), 2)
            split.update({f"partner_{i}_normal": row for i, row in normals})
        else:
            split[name] = values
    return split


def settings_of(labels: SurfaceLabels) -> dict[str, str | float | int | None]:
    """Settings and versions that the labels were computed with; angles in radians."""
    mesh, search = labels.mesh, labels.search
    sampling = {} if labels.sampling is None else asdict(labels.sampling)
    u_means = "no_grasp_found" if labels.mode == "label" else "surely_unstable"
    return {
        "version": package_version(),
        # In a header it must be one line of ASCII characters.
        "source": mesh.report.source.encode("unicode_escape", "surrogateescape").decode("ascii"),
        "mode": labels.mode,
        **asdict(labels.model),
        **sampling,
        **asdict(mesh.options),
        "unit": mesh.unit or "unknown",
        "search_angle": search.cone,
        "rays_traced": search.rays,
        "candidates_evaluated": search.evaluated,
        "file_vertices": mesh.file_vertices,
        "torque_scale": mesh.torque_scale,
        "epsilon_rank": labels.model.epsilon_rank,
        "epsilon_rtol": EPSILON_RTOL,
        "epsilon_min": labels.model.tilts,
        "epsilon_max": "sampled_tilts" if labels.model.method == "extremes" else "upper_bound",
        "label_codes": f"{Label.U:d}=U({u_means}) {Label.M:d}=M(cannot_tell) {Label.S:d}=S(stable)",
    }


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
        raise OutputError(
            f"{path}: no format is called {path.suffix!r}; known: {' '.join(WRITERS)}"
        )
    return writer
