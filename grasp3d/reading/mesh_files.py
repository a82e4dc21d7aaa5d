"""Reading of mesh files: checks of the declared sizes, then of the content."""

from pathlib import Path

from grasp3d.errors import MeshError
from grasp3d.reading.archives import check_archive, check_declarations
from grasp3d.reading.declared_sizes import check_declared_size
from grasp3d.reading.isolation import read_in_child
from grasp3d.reading.sources import DIRECT_FORMATS, RawMesh, Source, find_source
from grasp3d.settings import MeshOptions

_ARCHIVES = ("3mf", "3dxml")


def read_mesh(path: Path, *, max_memory: float = MeshOptions.max_memory) -> RawMesh:
    """Read a mesh file; a scene becomes one mesh, with the transforms of its parts applied.

    STL, PLY, OBJ and OFF are read in this process, since the file size limits the memory and time
    that they need. Other formats are read in a child process with limits on memory and time.

    Args:
        path: The file.
        max_memory: Largest memory for reading it [GB].

    Raises:
        MeshError: There is no such file, its format is unknown, it is damaged, it exceeds a limit,
            it refers to files outside its folder, or it has no triangles.
    """
    source = find_source(path, max_memory)
    try:
        check_declared_size(source)
        return _read(source)
    except MemoryError as error:
        raise MeshError(
            f"{source.where}: reading it needs more memory than is available; simplify the mesh"
        ) from error


def _read(source: Source) -> RawMesh:
    if source.kind in _ARCHIVES:
        return read_in_child(source, check_archive(source))
    if source.kind == "xaml":
        with source.path.open("rb") as stream:
            check_declarations(source, stream)
    if source.kind not in DIRECT_FORMATS:
        return read_in_child(source, source.size)
    from grasp3d.reading.parsing import parse

    return parse(source)
