"""Sources of surfaces: files, surfaces as read from them, and scenes of glTF, GLB and 3MF.

trimesh reads the scenes; this module finds what it would leave out of them silently.
"""

import io
import json
import logging
import re
import struct
import warnings
import zipfile
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cache
from itertools import chain
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

import numpy as np

from grasp3d.arrays import Floats, Ints, short_repr
from grasp3d.errors import MeshError
from grasp3d.settings.units import METRES, Unit
from grasp3d.system.documents import is_file, problem_of_file
from grasp3d.system.names import printable, unsupported

if TYPE_CHECKING:
    import trimesh


SUFFIXES = (".3mf", ".glb", ".gltf", ".obj", ".off", ".ply", ".stl")
"""Suffixes of mesh files that can be read."""

LARGEST = 1e60
"""Largest coordinate, and reciprocal of the smallest size, whose powers stay finite."""

_UNIT_NAMES: dict[str, Unit] = {
    "m": "m", "meter": "m", "metre": "m", "cm": "cm", "centimeter": "cm", "mm": "mm",
    "millimeter": "mm", "in": "in", "inch": "in", "inche": "in",
}  # fmt: skip
"""Units by their names without an `s` at the end."""


@dataclass(frozen=True, eq=False)
class RawMesh:
    """The surface as stored in a mesh file, or given as an object of another library.

    Raises:
        MeshError: There are no faces, faces use vertices that do not exist, or coordinates are not
            finite or too large.
    """

    vertices: Floats
    """Positions, shape (V, 3), in the order and unit of the file; of an STL, each position once."""
    faces: Ints
    """Vertex numbers of the triangles, shape (F, 3)."""
    format: str
    """File suffix without its dot, in lower case; else the library, or 'arrays'."""
    unit: Unit | None
    """Unit that the file declares; None: it declares none."""
    name: str = "arrays"
    """Its name in reports: that of the file, the type, or 'arrays'."""
    path: Path | None = None
    """The file; None: it is not from a file."""

    __repr__ = short_repr

    def __post_init__(self) -> None:
        if not len(self.faces):
            raise MeshError(f"{self.where}: holds no triangles; points and lines alone are no mesh")
        check_finite(self.vertices, self.where)
        check_corners(self.faces, len(self.vertices), self.where)
        if 0.0 < self.extent < 1.0 / LARGEST:
            raise MeshError(f"{self.where}: its extent is only {self.extent:.3g}; scale the mesh")

    @property
    def where(self) -> str:
        """Its name in errors."""
        return printable(str(self.path or self.name))

    @property
    def extent(self) -> float:
        """Largest extent of the surface along an axis."""
        return float(np.ptp(self.vertices[self.faces].reshape(-1, 3), axis=0).max())


@dataclass(frozen=True)
class Source:
    """An existing file of a mesh, or of labels."""

    path: Path
    kind: str
    """Format: the file suffix without its dot, in lower case."""
    where: str
    """Printable path, for error messages."""

    def error(self, reason: str) -> MeshError:
        """Make the error that a file cannot be read; the reason begins with a verb."""
        return MeshError(f"{self.where}: {reason}")

    def unexpected(self, reason: str) -> MeshError:
        """Make the error for content that is not what the suffix of the file says."""
        return self.error(f"{reason}; is the file complete, and is its suffix right?")


def check_finite(vertices: Floats, where: str) -> None:
    """Reject positions that are not finite or too large.

    Raises:
        MeshError: A coordinate is nan, or larger than 1e60.
    """
    bad = np.flatnonzero(~(np.abs(vertices) <= LARGEST).all(axis=1))
    if len(bad):
        raise MeshError(
            f"{where}: vertex {bad[0]} has a coordinate that is not a finite number, or above "
            f"{LARGEST:g} ({len(bad)} such vertices); export the mesh again"
        )


def check_corners(faces: Ints, count: int, where: str) -> None:
    """Reject faces with vertices that do not exist.

    Args:
        faces: Vertex numbers of the corners, shape (F, 3).
        count: Number of vertices.
        where: Name of the mesh in errors.

    Raises:
        MeshError: There is such a face.
    """
    outside = (faces < 0) | (faces >= count)
    if outside.any():
        raise MeshError(
            f"{where}: face {np.flatnonzero(outside.any(axis=1))[0]} uses vertex "
            f"{faces[outside][0]}, but there are {count} vertices; export the mesh again"
        )


def find_source(path: Path, suffixes: Iterable[str] = SUFFIXES) -> Source:
    """Return the file at a path, after checking that it exists and has a known suffix.

    Args:
        path: The file.
        suffixes: Suffixes that can be read.

    Raises:
        MeshError: It does not exist, is not a file, is empty, or its suffix is unknown.
    """
    where, suffix = printable(str(path)), path.suffix.lower()
    if problem := problem_of_file(path):
        raise MeshError(f"{where}: {problem}")
    if suffix not in suffixes:
        raise MeshError(unsupported(path, sorted(suffixes)))
    if not path.stat().st_size:
        raise MeshError(f"{where}: the file is empty; export the mesh again")
    return Source(path, suffix.removeprefix("."), where)


def unit_called(name: str | None, where: str) -> Unit | None:
    """Return the unit of a name such as 'millimeters'.

    Args:
        name: As a file or another library states it; None: it states none.
        where: Name of the mesh in errors.

    Raises:
        MeshError: It is none of the supported units.
    """
    unit = _UNIT_NAMES.get((name or "").strip().lower().removesuffix("s"))
    if name and unit is None:
        raise MeshError(
            f"{where}: states the unit {printable(name)!r}, which is none of {', '.join(METRES)}; "
            "scale the mesh to one of these"
        )
    return unit


# Without a handler, Python prints the messages of trimesh's logger to the terminal.
logging.getLogger("trimesh").addHandler(logging.NullHandler())

FLAT = 1e-9
"""Smallest scale of a transform, as a fraction of its largest, that does not flatten a mesh."""


def load_scene(data: bytes, kind: str, **options: Any) -> "trimesh.Scene":
    """Read a scene with trimesh.

    Args:
        data: Content of the file.
        kind: Suffix of the file.
        options: Options of trimesh's reader.
    """
    import trimesh

    with warnings.catch_warnings():
        # These warnings mean damaged files: incomplete or invalid numbers. Others concern trimesh
        # itself.
        warnings.filterwarnings("error", "string or file could not be read", DeprecationWarning)
        warnings.filterwarnings("error", category=RuntimeWarning, module="trimesh")
        return trimesh.load_scene(io.BytesIO(data), kind, process=False, **options)


def flattened(scene: "trimesh.Scene", where: str) -> tuple[Floats, Ints]:
    """Return vertices (V, 3) and faces (F, 3) of a scene, with the transforms of its parts applied.

    Points and lines are left out.

    Args:
        scene: The scene.
        where: Its name in errors.

    Raises:
        MeshError: A face uses a vertex that is not there, or a transform flattens a part.
    """
    for part in scene.geometry.values():  # before they are concatenated
        check_corners(np.asarray(getattr(part, "faces", ())), len(part.vertices), where)
    for node in scene.graph.nodes_geometry:
        scales = np.linalg.svd(scene.graph[node][0][:3, :3], compute_uv=False)
        if 0.0 < scales[0] * FLAT >= scales[2]:
            raise MeshError(
                f"{where}: node {node!r} flattens its mesh: its transform, with those of the nodes "
                "above it, is singular (a scale of 0 in some directions); correct it, or delete "
                "the node"
            )
    mesh = scene.to_mesh()
    return np.asarray(mesh.vertices, dtype=np.float64), np.asarray(mesh.faces, dtype=np.int64)


Tree = dict[str, Any]

_HARMLESS = re.compile(r"KHR_mesh_quantization|[A-Z]+_(materials|texture|lights|xmp)")
"""Prefixes of the names of extensions that do not change positions, or only their encoding."""

_HEAD = struct.Struct("<4sIII4s")
"""Header of a GLB: its name, version and size, and size and name of the JSON."""

_CHUNK = 8
"""Bytes before the data of a GLB: their size and name."""

_READ, _FAN = (0, 1, 4, 5), 6
"""Modes of parts that trimesh reads (points, lines, triangles as the default, triangle strips), and
the mode of triangle fans, which it does not read."""


def read_gltf(source: Source) -> tuple[Floats, Ints, Unit]:
    """Read vertices (V, 3), faces (F, 3) and unit of a glTF with its files. Raises MeshError."""
    tree, data = _parts(source.path)
    for node in tree.get("nodes", []):
        node.pop("camera", None)  # with one, trimesh leaves out what the node holds
    names = [one.setdefault("uri", "") for one in tree.get("buffers", [])]
    beside = [name for name in names if not name.startswith("data:")]
    files = {name: _content(source, name) if name else data for name in beside}
    meshes = [mesh["primitives"] for mesh in tree.get("meshes", [])]
    shown = [node for node in _shown(source, tree) if "mesh" in node]
    for what in _unsupported(tree, chain(*meshes), shown):
        raise source.error(f"has {what}, which is not supported; export it without")
    text = json.dumps(tree).encode()
    scene = load_scene(text, "gltf", resolver=files, skip_materials=True)
    read = [[part for part in mesh if part.get("mode", 4) in _READ] for mesh in meshes]
    for part, geometry in zip(chain(*read), scene.geometry.values(), strict=True):
        positions = tree["accessors"][part["attributes"]["POSITION"]]
        if positions.get("normalized"):
            kind = {5120: "i1", 5121: "u1", 5122: "i2", 5123: "u2"}[positions["componentType"]]
            geometry.vertices = np.maximum(geometry.vertices / float(np.iinfo(kind).max), -1.0)
    count, found = sum(len(read[node["mesh"]]) for node in shown), scene.graph.nodes_geometry
    if count != len(found):
        raise source.unexpected(f"shows {count} parts, of which {len(found)} can be read")
    vertices, faces = flattened(scene, source.where)
    return vertices + 0.0, faces, "m"  # -0.0 becomes 0.0


def _content(source: Source, name: str) -> bytes:
    """Data of a file in the folder of a glTF or below. Raises MeshError."""
    folder = source.path.parent.resolve()
    for file in (folder / name, folder / unquote(name)):
        if file.resolve().is_relative_to(folder) and is_file(file):
            return file.read_bytes()
    raise source.error(
        f"needs the file {ascii(name)[:60]}, which is not in its folder; put it there"
    )


def _parts(path: Path) -> tuple[Tree, bytes]:
    """The JSON of a .gltf or .glb file, and the data after it. Raises ValueError, OSError."""
    data = path.read_bytes()
    if path.suffix.lower() != ".glb":
        return json.loads(data), b""
    magic, version, _, size, kind = _HEAD.unpack_from(data.ljust(_HEAD.size))
    if (magic, version, kind) != (b"glTF", 2, b"JSON"):
        raise ValueError("it does not begin as glTF 2.0")
    end = _HEAD.size + size
    return json.loads(data[_HEAD.size : end]), data[end + _CHUNK :]


def side_names(path: Path) -> list[str]:
    """Return the names of the buffer files of a glTF, if it can be read.

    Args:
        path: Any mesh file; only .gltf and .glb have side files.

    Returns:
        Paths relative to its folder with `/`, without duplicates; the files need not exist.

    Raises:
        OSError: The file cannot be read.
    """
    if path.suffix.lower() not in {".gltf", ".glb"}:
        return []
    try:
        names = [str(one.get("uri", "data:")) for one in _parts(path)[0].get("buffers", [])]
    except (ValueError, TypeError, AttributeError, RecursionError):  # reported when it is read
        return []
    return list(dict.fromkeys(unquote(name) for name in names if not name.startswith("data:")))


def _shown(source: Source, tree: Tree) -> list[Tree]:
    """The nodes of the scene that is shown. Raises MeshError."""
    scenes, nodes = tree.get("scenes", [{}]), tree.get("nodes", [])
    queue, found = list(scenes[tree.get("scene", 0)].get("nodes", [])), dict[int, Tree]()
    while queue:
        number = queue.pop()
        if number in found:
            raise source.error(f"its nodes form a cycle, or node {number} has two parents")
        found[number] = nodes[number]
        queue += nodes[number].get("children", [])
    return list(found.values())


def _unsupported(tree: Tree, parts: Iterable[Tree], shown: list[Tree]) -> Iterator[str]:
    """Name what trimesh would leave out of the parts of meshes and the nodes that show them."""
    for name in tree.get("extensionsRequired", []):
        if not _HARMLESS.match(name):
            yield f"the extension {name!a:.60}"
    for part in parts:
        if part.get("mode") == _FAN:
            yield "triangle fans"
        position = part["attributes"]["POSITION"]
        data = [tree["accessors"][one] for one in (position, part.get("indices", position))]
        if any("sparse" in one or "bufferView" not in one for one in data):
            yield "sparse or compressed numbers"
    for node in shown:
        posed = [*node.get("weights", []), *tree["meshes"][node["mesh"]].get("weights", [])]
        if "skin" in node or any(posed) or "EXT_mesh_gpu_instancing" in node.get("extensions", {}):
            yield "a mesh that is posed by a skeleton, by morph targets or by instancing"


_Id = tuple[str, str]
"""Identifier of an object: its file in the archive, and its number in this file."""


def read_3mf(source: Source) -> tuple[Floats, Ints, Unit | None]:
    """Read the vertices (V, 3), faces (F, 3) and the unit of a 3MF. Raises MeshError."""
    declared = _triangles(source.path)
    scene = load_scene(source.path.read_bytes(), "3mf", postprocess=False)
    vertices, faces = flattened(scene, source.where)
    if len(faces) != declared:
        raise source.error(
            f"declares {declared:,} triangles, of which {len(faces):,} can be read; export it as "
            "one model without nested parts, or as STL"
        )
    return vertices, faces, unit_called(scene.units, source.where)


def _triangles(path: Path) -> int:
    """Number of triangles that a 3MF builds, in all copies of its parts.

    Raises:
        KeyError: It uses an object that it does not have.
        RecursionError: An object contains itself.
        Exception: It is no such archive, or its XML is damaged.
    """
    from lxml import etree

    own, inner, built = dict[_Id, int](), dict[_Id, list[_Id]](), list[_Id]()

    def parts(model: str, uses: list[Any]) -> list[_Id]:
        paths = ([v.strip("/") for k, v in one.items() if k.endswith("path")] for one in uses)
        ids = (one.get("objectid") for one in uses)
        return [([*path, model][0], one) for path, one in zip(paths, ids, strict=True)]

    @cache
    def total(part: _Id) -> int:
        return own[part] + sum(map(total, inner[part]))

    with zipfile.ZipFile(path) as archive:
        for model in archive.namelist():
            if model.lower().endswith(".model"):
                root = etree.fromstring(archive.read(model))
                for one in root.iter("{*}object"):
                    own[model, one.get("id")] = sum(1 for _ in one.iter("{*}triangle"))
                    inner[model, one.get("id")] = parts(model, [*one.iter("{*}component")])
                built += parts(model, [*root.iter("{*}item")])
    return sum(map(total, built))
