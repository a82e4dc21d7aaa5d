"""Meshes as users have them: files, arrays, and objects of other libraries.

The other libraries are not imported: their objects are recognised by the names of their classes.
"""

import os
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from grasp3d.errors import MeshError
from grasp3d.mesh.object_mesh import ObjectMesh
from grasp3d.mesh.reading.mesh_files import read_mesh
from grasp3d.mesh.reading.scenes import flattened
from grasp3d.mesh.reading.sources import RawMesh, unit_called
from grasp3d.system.names import reason_of

if TYPE_CHECKING:
    MeshSource: TypeAlias = object
else:

    class MeshSource:
        """What is accepted wherever a mesh is expected.

        - a path: a file in a format that is read (STL, OBJ, PLY, OFF, GLB, glTF, 3MF, ...);
        - an `ObjectMesh`;
        - a `trimesh.Trimesh` or `trimesh.Scene`, with the transforms of its parts applied and its
          `units`;
        - a PyVista `PolyData`; faces with more than three corners are divided into triangles;
        - an Open3D `TriangleMesh` of `open3d.geometry`, which `to_legacy()` makes of tensors;
        - a pair `(vertices, faces)` of arrays: positions (V, 3), and for every triangle the
          numbers of its corners (F, 3), counter-clockwise seen from outside.

        All of them pass the same checks and the same repair; their vertices keep their order.
        """


def read_source(source: MeshSource) -> RawMesh:
    """Read a mesh from any source.

    Args:
        source: A path, or an object as in `MeshSource`.

    Raises:
        MeshError: A file cannot be read, or an object is no mesh.
    """
    if isinstance(source, str | os.PathLike):
        return read_mesh(Path(os.fsdecode(source)))
    if isinstance(source, ObjectMesh):
        report, stated = source.report, source.file_unit
        return RawMesh(source.file_points, source.faces, report.format, stated, report.source)
    kinds = type(source).__mro__
    names = [f"{kind.__module__.partition('.')[0]}.{kind.__name__}" for kind in kinds]
    name = next((one for one in names if one in _LIBRARIES), names[0])
    reader = _LIBRARIES.get(name)
    if reader is None:
        raise MeshError(
            f"an object of type {name.removeprefix('builtins.')} is no mesh; give a path, an "
            "ObjectMesh, a trimesh Trimesh or Scene, a PyVista PolyData, an Open3D TriangleMesh, "
            "or a pair (vertices, faces)"
        )
    try:
        vertices, faces, unit = reader(source)
        arrays = np.array(vertices, np.float64), np.array(faces, np.int64)
    except (MeshError, MemoryError):
        raise
    except Exception as error:  # each library raises its own classes of errors
        raise MeshError(f"{name}: its surface cannot be read ({reason_of(error)})") from error
    library = name.partition(".")[0]
    if library == "builtins":
        name = library = "arrays"
    return RawMesh(*arrays, library, unit_called(unit, name), name)


Surface: TypeAlias = tuple[Any, Any, str | None]
"""Vertices, faces and unit of an object, as its library has them."""


def _of_arrays(pair: Any) -> Surface:
    vertices, faces = (np.asarray(one) for one in pair)
    for array, kinds, what in (
        (vertices, "fiu", "vertices must be real numbers of shape (V, 3)"),
        (faces, "iu", "faces must be whole numbers of shape (F, 3), the corners of triangles"),
    ):
        if array.ndim != 2 or array.shape[1] != 3 or array.dtype.kind not in kinds:
            raise MeshError(f"{what}; got {array.dtype} {array.shape}")
    return vertices, faces, None


def _of_scene(source: Any) -> Surface:
    units = sorted({str(part.units or "none") for part in source.geometry.values()})
    stated = None if units == ["none"] else " and ".join(units)
    return *flattened(source, "trimesh.Scene"), stated


def _of_polydata(source: Any) -> Surface:
    surface = source.triangulate()
    return surface.points, np.asarray(surface.faces).reshape(-1, 4)[:, 1:], None


_LIBRARIES: dict[str, Callable[[Any], Surface]] = {
    "builtins.tuple": _of_arrays,
    "builtins.list": _of_arrays,
    "trimesh.Trimesh": lambda one: (one.vertices, one.faces, one.units),
    "trimesh.Scene": _of_scene,
    "pyvista.PolyData": _of_polydata,
    "open3d.TriangleMesh": lambda one: (one.vertices, one.triangles, None),
}
"""Readers of other libraries' objects, by library and class."""
