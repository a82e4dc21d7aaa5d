"""glTF and GLB, read by trimesh, and what it leaves out of them without a word."""

import json
import struct
from pathlib import Path
from typing import TYPE_CHECKING, Any
from urllib.parse import unquote

import numpy as np

from grasp3d.arrays import Floats, Ints
from grasp3d.reading.scenes import flattened, load_scene
from grasp3d.reading.sources import Source

if TYPE_CHECKING:
    import trimesh

Tree = dict[str, Any]

_HARMLESS = (
    "KHR_mesh_quantization", "KHR_materials_", "KHR_texture_", "KHR_lights_", "EXT_texture_",
    "EXT_lights_", "MSFT_texture_", "KHR_xmp",
)  # fmt: skip
"""Prefixes of extensions that do not change positions, or only their encoding."""

_HEAD = struct.Struct("<4sIII4s")
"""Of a GLB: its name, version and size, and size and name of the JSON."""

_TRIANGLES, _STRIP, _FAN = 4, 5, 6
_READ = (0, 1, _TRIANGLES, _STRIP)
"""Modes of parts that become geometry of trimesh; the first two are points and lines."""


def read_gltf(source: Source) -> tuple[Floats, Ints]:
    """Read the vertices (V, 3) and faces (F, 3) of a glTF with its side files. Raises MeshError."""
    from trimesh.resolvers import FilePathResolver

    class Resolver(FilePathResolver):
        """Files in the folder of the glTF or below, also by names with %20 and the like."""

        def get(self, name: str) -> bytes:
            try:
                return bytes(super().get(name))
            except FileNotFoundError:
                return bytes(super().get(unquote(name)))
            except ValueError as error:
                raise source.error(
                    f"names the file {ascii(name)[:60]}, which is not in its folder; put it there"
                ) from error

    tree, rest = _parts(source.path)
    text = json.dumps(_reduced(tree)).encode()
    if source.kind == "glb":
        text += b" " * (-len(text) % 4)
        size = _HEAD.size + len(text) + len(rest)
        text = _HEAD.pack(b"glTF", 2, size, len(text), b"JSON") + text + rest
    scene = load_scene(source, text, resolver=Resolver(str(source.path)))
    _check(source, tree, scene)
    vertices, faces = flattened(scene, source.where)
    return vertices + 0.0, faces  # there is no -0.0


def _parts(path: Path) -> tuple[Tree, bytes]:
    """The JSON of a .gltf or .glb file, and what follows it. Raises ValueError, OSError."""
    data = path.read_bytes()
    if path.suffix.lower() != ".glb":
        return json.loads(data), b""
    magic, version, _, size, kind = _HEAD.unpack_from(data.ljust(_HEAD.size))
    if (magic, version, kind) != (b"glTF", 2, b"JSON"):
        raise ValueError("it does not begin as glTF 2.0")
    end = _HEAD.size + size
    return json.loads(data[_HEAD.size : end]), data[end:]


def _reduced(tree: Tree) -> Tree:
    """What positions and faces depend on: trimesh may fail at the rest."""
    keys = ("scene", "scenes", "nodes", "meshes", "accessors", "bufferViews", "buffers")
    kept = {key: tree[key] for key in keys if key in tree}
    kept["nodes"] = [
        {key: value for key, value in node.items() if key not in {"camera", "extensions", "extras"}}
        for node in tree.get("nodes", [])
    ]
    kept["meshes"] = [
        {"primitives": [
            {key: part[key] for key in ("indices", "mode") if key in part}
            | {"attributes": {"POSITION": part["attributes"]["POSITION"]}}
            for part in mesh["primitives"]
        ]}
        for mesh in tree.get("meshes", [])
    ]  # fmt: skip
    return kept


def side_names(path: Path) -> list[str]:
    """Return the names of the files with the buffers of a glTF, if it can be read.

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
        addresses = [str(one.get("uri", "data:")) for one in _parts(path)[0].get("buffers", [])]
    except (ValueError, TypeError, AttributeError, RecursionError):  # which reading it will say
        return []
    return list(dict.fromkeys(unquote(uri) for uri in addresses if not uri.startswith("data:")))


def _check(source: Source, tree: Tree, scene: "trimesh.Scene") -> None:
    """Compare a scene with the file that trimesh read it from, and scale normalized positions.

    Raises:
        MeshError: Something is left out, or not supported.
    """
    for name in tree.get("extensionsRequired", []):
        if not str(name).startswith(_HARMLESS):
            raise source.error(
                f"needs the extension {ascii(name)[:60]}, which is not supported; export the mesh "
                "without it"
            )
    parts = [part for mesh in tree.get("meshes", []) for part in mesh["primitives"]]
    if any(part.get("mode", _TRIANGLES) == _FAN for part in parts):
        raise source.error("has triangle fans; export it as triangles")
    read = [part for part in parts if part.get("mode", _TRIANGLES) in _READ]
    for part, geometry in zip(read, scene.geometry.values(), strict=True):
        if part.get("mode", _TRIANGLES) >= _TRIANGLES:
            _check_part(source, tree, part, geometry)
    shown = _shown(source, tree)
    posed = [node for node in shown if "mesh" in node and _is_posed(tree, node)]
    if posed:
        raise source.error(
            "has a mesh that is posed by a skeleton, by morph targets or by instancing, which is "
            "not supported; export it in its pose, without"
        )
    count = sum(
        part.get("mode", _TRIANGLES) in _READ
        for node in shown
        if "mesh" in node
        for part in tree["meshes"][node["mesh"]]["primitives"]
    )
    if count != len(scene.graph.nodes_geometry):
        raise source.damaged(
            f"shows {count} parts, of which {len(scene.graph.nodes_geometry)} can be read"
        )


def _check_part(source: Source, tree: Tree, part: Tree, geometry: Any) -> None:
    accessors = tree["accessors"]
    positions = accessors[part["attributes"]["POSITION"]]
    corners = positions if part.get("indices") is None else accessors[part["indices"]]
    for one in (positions, corners):
        if "sparse" in one or "bufferView" not in one:
            raise source.error(
                "has sparse or compressed numbers, which is not supported; export it without"
            )
    is_whole = part.get("mode") == _STRIP or corners["count"] == 3 * len(geometry.faces)
    if geometry.vertices.shape != (positions["count"], 3) or not is_whole:
        raise source.damaged("has a part that cannot be read as its numbers say")
    if positions.get("normalized"):
        largest = float(np.iinfo({5120: "i1", 5121: "u1", 5122: "i2"}.get(
            positions["componentType"], "u2")).max)  # fmt: skip
        geometry.vertices = np.maximum(geometry.vertices / largest, -1.0)


def _shown(source: Source, tree: Tree) -> list[Tree]:
    """The nodes of the scene that is shown. Raises MeshError."""
    scenes, nodes = tree.get("scenes", [{}]), tree.get("nodes", [])
    queue, found = list(scenes[tree.get("scene", 0)].get("nodes", [])), dict[int, Tree]()
    while queue:
        number = queue.pop()
        if number in found:
            raise source.damaged(f"its nodes form a cycle, or node {number} has two parents")
        found[number] = nodes[number]
        queue += nodes[number].get("children", [])
    return list(found.values())


def _is_posed(tree: Tree, node: Tree) -> bool:
    """Whether a mesh is moved by more than the transforms of nodes."""
    weights = (node.get("weights"), tree["meshes"][node["mesh"]].get("weights"))
    is_instanced = "EXT_mesh_gpu_instancing" in node.get("extensions", {})
    return "skin" in node or is_instanced or any(any(one) for one in weights if one)
