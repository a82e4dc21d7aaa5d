"""Reading a mesh file: what it promises first, then its content, behind limits where needed."""

from pathlib import Path

from grasp3d.errors import MeshError
from grasp3d.reading.archives import check_archive, check_declarations
from grasp3d.reading.isolation import read_behind_limits
from grasp3d.reading.promises import check_promises
from grasp3d.reading.sources import TRUSTED, RawMesh, Source, find_source
from grasp3d.settings import MeshOptions

_ARCHIVES = ("3mf", "3dxml")


def read_mesh(path: Path, *, max_memory: float = MeshOptions.max_memory) -> RawMesh:
    """Read a mesh file; a scene becomes one mesh, each part where its transform puts it.

    STL, PLY, OBJ and OFF are read here, since their size bounds what reading them takes. The other
    formats can unpack to anything and are read by a process with limits on memory and time.

    Args:
        path: The file.
        max_memory: What reading it may take [GB].

    Raises:
        MeshError: There is no such file, its format is not known, it is damaged, it needs more
            than is allowed, it leads out of its folder, or it holds no triangles.
    """
    source = find_source(path, max_memory)
    try:
        check_promises(source)
        return _read(source)
    except MemoryError as error:
        raise MeshError(
            f"{source.where}: reading it needs more memory than there is; simplify the mesh"
        ) from error


def _read(source: Source) -> RawMesh:
    if source.kind in _ARCHIVES:
        return read_behind_limits(source, check_archive(source))
    if source.kind == "xaml":
        with source.path.open("rb") as stream:
            check_declarations(source, stream)
    if source.kind not in TRUSTED:
        return read_behind_limits(source, source.size)
    from grasp3d.reading.parsing import parse

    return parse(source)
