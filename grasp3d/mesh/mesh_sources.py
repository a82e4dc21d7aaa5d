"""Meshes as users have them: files, arrays, and objects of other libraries.

The other libraries are not imported: their objects are recognised by the names of their classes.
"""

import os
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, TypeAlias

import numpy as np

from grasp3d.arrays import Floats, Ints, first_at_position, used_indices
from grasp3d.errors import MeshError
from grasp3d.mesh.object_mesh import ObjectMesh
from grasp3d.reading.mesh_files import read_mesh
from grasp3d.reading.scenes import flattened
from grasp3d.reading.sources import RawMesh, check_corners, check_finite, stated_unit
from grasp3d.settings.costs import check_cost
from grasp3d.system.names import reason_of

LARGEST = 1e60
"""Largest coordinate, and reciprocal of the smallest size, whose powers stay finite."""

APART = 1e-5
"""Distance above which vertices are not joined, as a fraction of the size."""

TINY = float(np.finfo(np.float64).tiny)

if TYPE_CHECKING:
    from grasp3d.arrays import ArrayLike

    class FacedMesh(Protocol):
        """`trimesh.Trimesh` or `pyvista.PolyData`; what Open3D makes has no type."""

        @property
        def faces(self) -> Any:
            """Corners of the faces."""

    class MeshScene(Protocol):
        """`trimesh.Scene`."""

        @property
        def geometry(self) -> Any:
            """Parts of the scene."""

    MeshSource: TypeAlias = (
        str | os.PathLike[str] | ObjectMesh | FacedMesh | MeshScene | tuple[ArrayLike, ArrayLike]
    )
else:

    class MeshSource:
        """What is accepted wherever a mesh is expected.

        - a path: a file in a format that is read (STL, OBJ, PLY, OFF, GLB, glTF, 3MF, ...);
        - an `ObjectMesh`;
        - a `trimesh.Trimesh` or `trimesh.Scene`, with the transforms of its parts applied and its
          `units`;
        - a PyVista `PolyData`; faces with more than three corners are divided into triangles;
        - an Open3D `TriangleMesh`, of `open3d.geometry` or `open3d.t.geometry`;
        - a pair `(vertices, faces)` of arrays: positions (V, 3), and for every triangle the
          numbers of its corners (F, 3), counter-clockwise seen from outside.

        All of them pass the same checks and the same repair; their vertices keep their order.
        """


ACCEPTED = (
    "give a path, an ObjectMesh, a trimesh Trimesh or Scene, a PyVista PolyData, an Open3D "
    "TriangleMesh, or a pair (vertices, faces)"
)
"""The accepted sources, for error messages."""

_HINTS = {
    "pyvista": "extract_surface() makes a PolyData of other PyVista data",
    "vtkmodules": "pyvista.wrap(...) makes a PolyData of a vtkPolyData",
}
"""What to do with other objects of a library, for error messages."""


def check_surface(mesh: RawMesh, max_memory: float) -> None:
    """Refuse what is not a surface, or too large to be labelled.

    Args:
        mesh: The mesh as it was read.
        max_memory: Largest memory for labelling [GB].

    Raises:
        MeshError: There are no faces, or vertices that do not exist; positions are not finite or
            beyond what can be computed with; or labelling would exceed the memory.
    """
    vertices, faces, where = mesh.vertices, mesh.faces, mesh.where
    check_finite(vertices, where)
    if len(faces) == 0:
        raise MeshError(f"{where}: holds no faces")
    check_corners(faces, len(vertices), where)
    _check_magnitude(vertices[faces], where)
    fewest = _fewest_vertices(vertices, used_indices(faces), len(faces))
    check_cost(fewest, max_memory, where, "simplify the mesh")


def _check_magnitude(corners: Floats, where: str) -> None:
    largest = float(np.abs(corners).max())
    with np.errstate(over="ignore"):  # values that overflow are refused below
        spread = float(np.ptp(corners.reshape(-1, 3), axis=0).max())
    if largest > LARGEST or 0.0 < spread < 1.0 / LARGEST:
        raise MeshError(
            f"{where}: coordinates up to {largest:.3g} and a size of {spread:.3g} are beyond what "
            f"can be computed with ({1.0 / LARGEST:.0e} to {LARGEST:.0e}); scale the mesh"
        )


def _fewest_vertices(vertices: Floats, used: Ints, faces: int) -> int:
    """Estimate the least number of vertices after repair: those within rounding count once."""
    fewest = faces // 2
    if len(used) <= 2 * fewest:
        return fewest
    points = vertices[used]
    points = (points - points.min(axis=0)) / max(float(np.ptp(points, axis=0).max()), TINY)
    return max(fewest, len(np.unique(first_at_position(np.floor(points / APART)))))


def read_source(source: MeshSource | RawMesh) -> RawMesh:
    """Read a mesh from any source.

    Args:
        source: A path, or an object as in `MeshSource`; what was read already is returned.

    Raises:
        MeshError: A file cannot be read, or an object is no mesh.
    """
    if isinstance(source, RawMesh):
        return source
    if isinstance(source, str | os.PathLike):
        path = Path(os.fsdecode(source))
        return replace(read_mesh(path), name=path.name, path=path)
    if isinstance(source, ObjectMesh):
        report = source.report
        return RawMesh(
            source.file_points, source.faces, report.format, source.file_unit, name=report.source
        )
    if isinstance(source, tuple | list):
        return _of_arrays(source)
    return _of_object(source)


def _of_arrays(pair: tuple[Any, ...] | list[Any]) -> RawMesh:
    """Check and copy a pair of vertices and faces."""
    if any(isinstance(item, str | os.PathLike) for item in pair):
        raise MeshError(
            f"{_described(pair)} is no mesh: give one path at a time; label_library labels "
            "several files"
        )
    names = ("vertices", "faces") if len(pair) == 2 else ()
    arrays = [_array(name, values) for name, values in zip(names, pair, strict=False)]
    if not (arrays and all(array.ndim for array in arrays)):
        raise MeshError(f"{_described(pair)} is no mesh; {ACCEPTED}")
    vertices, faces = arrays
    if vertices.ndim != 2 or vertices.shape[1] != 3:
        raise MeshError(f"vertices must have shape (V, 3); got {vertices.shape}")
    if vertices.dtype.kind not in "fiu" and vertices.size:
        raise MeshError(f"vertices must be real numbers; got {vertices.dtype}")
    if faces.ndim == 2 and faces.shape[1] == 4:
        raise MeshError(
            f"faces must be triangles, shape (F, 3); got {faces.shape}: divide each quadrilateral "
            "into two triangles"
        )
    if faces.ndim != 2 or faces.shape[1] != 3:
        raise MeshError(f"faces must have shape (F, 3); got {faces.shape}")
    if faces.dtype.kind not in "iu" and faces.size:
        raise MeshError(
            f"faces must be whole numbers, the numbers of their corners; got {faces.dtype}"
        )
    return RawMesh(vertices.astype(np.float64), faces.astype(np.int64), "arrays", None)


def _array(name: str, values: Any) -> np.ndarray[Any, Any]:
    try:
        return np.asarray(values)
    except Exception as error:  # tensors raise errors of their own classes
        raise MeshError(f"{name} must be an array of numbers ({reason_of(error)})") from error


def _of_object(source: Any) -> RawMesh:
    name = _type_name(source)
    readers = (_LIBRARIES.get(_names(kind)) for kind in type(source).__mro__)
    reader = next(filter(None, readers), None)
    if reader is None:
        hint = _HINTS.get(_names(type(source))[0], "")
        raise MeshError(
            f"{_described(source)} is no mesh{f' ({hint})' if hint else ''}; {ACCEPTED}"
        )
    try:
        raw = reader(source)
    except (MeshError, MemoryError):
        raise
    except Exception as error:  # each library raises its own classes of errors
        raise MeshError(f"{name}: its surface cannot be read ({reason_of(error)})") from error
    if not len(raw.faces):
        raise MeshError(
            f"{name}: holds no triangles; a mesh needs faces, points and lines are not enough"
        )
    return replace(raw, name=name)


def _of_trimesh(source: Any) -> RawMesh:
    return _raw(source.vertices, source.faces, "trimesh", source.units)


def _of_scene(source: Any) -> RawMesh:
    units = sorted({str(part.units or "none") for part in source.geometry.values()})
    stated = None if units == ["none"] else " and ".join(units)
    vertices, faces = flattened(source, "trimesh.Scene")
    return _raw(vertices, faces, "trimesh", stated)


def _of_polydata(source: Any) -> RawMesh:
    if source.n_strips or not source.is_all_triangles:
        source = source.triangulate()
    faces = np.asarray(source.faces).reshape(-1, 4)[:, 1:]
    return _raw(source.points, faces, "pyvista", None)


def _of_open3d(source: Any) -> RawMesh:
    if not hasattr(source, "vertex"):
        return _raw(source.vertices, source.triangles, "open3d", None)
    if "positions" not in source.vertex or "indices" not in source.triangle:
        return _raw((), (), "open3d", None)
    tensors = source.vertex.positions, source.triangle.indices
    vertices, faces = (tensor.cpu().numpy() for tensor in tensors)
    return _raw(vertices, faces, "open3d", None)


_LIBRARIES: dict[tuple[str, str], Callable[[Any], RawMesh]] = {
    ("trimesh", "Trimesh"): _of_trimesh,
    ("trimesh", "Scene"): _of_scene,
    ("pyvista", "PolyData"): _of_polydata,
    ("open3d", "TriangleMesh"): _of_open3d,
}
"""Readers of other libraries' objects, by library and class."""


def _raw(vertices: Any, faces: Any, library: str, unit: str | None) -> RawMesh:
    points = np.array(vertices, dtype=np.float64).reshape(-1, 3)
    corners = np.array(faces, dtype=np.int64).reshape(-1, 3)
    return RawMesh(points, corners, library, *stated_unit(unit))


def _names(kind: type) -> tuple[str, str]:
    """Library and name of a class."""
    return kind.__module__.partition(".")[0], kind.__name__


def _type_name(source: object) -> str:
    """Name of an object's type as users write it, such as 'pyvista.PolyData'."""
    kind = type(source)
    library, _, inner = kind.__module__.partition(".")
    parts = [kind.__qualname__]
    if library == "open3d":  # two types have the name TriangleMesh
        parts = [part for part in inner.split(".") if part in {"t", "geometry"}] + parts
    return ".".join(parts if library == "builtins" else [library, *parts])


def _described(source: object) -> str:
    """What was given, as the subject of a sentence."""
    if source is None:
        return "None"
    if isinstance(source, np.ndarray):
        return f"an array of shape {source.shape}"
    if isinstance(source, tuple | list):
        kinds = ", ".join(dict.fromkeys(_type_name(item) for item in source))
        return f"a {type(source).__name__} of {len(source)} items{f' ({kinds})' if kinds else ''}"
    return f"an object of type {_type_name(source)}"
