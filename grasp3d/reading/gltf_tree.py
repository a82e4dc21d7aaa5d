"""Reduction of the JSON tree of a glTF, and checks for content that trimesh would misread."""

from typing import Any

from grasp3d.errors import MeshError
from grasp3d.reading.sources import Source

Tree = dict[str, Any]

LISTS = ("scenes", "nodes", "meshes", "accessors", "bufferViews", "buffers")
_NODE_KEYS = ("children", "matrix", "translation", "rotation", "scale", "mesh")
_VIEW_NUMBERS = ("buffer", "byteOffset", "byteLength", "byteStride")
_ACCESSOR_NUMBERS = ("bufferView", "byteOffset", "count", "componentType")

_SUPPORTED_EXTENSIONS = (
    "KHR_mesh_quantization", "KHR_materials_", "KHR_texture_", "KHR_lights_", "EXT_texture_",
    "EXT_lights_", "MSFT_texture_", "KHR_xmp",
)  # fmt: skip
"""Prefixes of extensions that do not change positions, or only their encoding."""

_WHOLE_NUMBERS = (5121, 5123, 5125)
_POSITIONS = (5120, 5121, 5122, 5123, 5126)
_LINES = (0, 1, 2, 3)
_TRIANGLES = (4, 5)


def stripped_tree(source: Source, tree: Tree, size: int) -> Tree:
    """Return the tree without images, materials, animations and cameras.

    Args:
        source: The file.
        tree: Its JSON.
        size: Size of all its buffers [bytes].

    Raises:
        MeshError: It needs an unsupported feature, or its numbers are inconsistent.
    """
    for key in LISTS:
        found = tree.get(key, [])
        if not isinstance(found, list) or not all(isinstance(entry, dict) for entry in found):
            raise MeshError(f"{source.where}: its {key} are not a list of objects; {source.hint}")
    _check_extensions(source, tree)
    for number, view in enumerate(tree.get("bufferViews", [])):
        _check_integers(source, f"bufferView {number}", view, _VIEW_NUMBERS)
    nodes = [_node(source, number, node) for number, node in enumerate(tree.get("nodes", []))]
    _check_nodes(source, nodes, tree)
    kept: dict[int, int] = {}
    meshes = [
        {"primitives": _primitives(source, f"mesh {number}", tree, mesh, kept)}
        for number, mesh in enumerate(tree.get("meshes", []))
    ]
    accessors = [_accessor(source, tree, number, size) for number in kept]
    names = ("asset", "scene", "scenes", "bufferViews", "buffers")
    read = {"nodes": nodes, "meshes": meshes, "accessors": accessors}
    return {name: tree[name] for name in names if name in tree} | read


def _check_extensions(source: Source, tree: Tree) -> None:
    needed = tree.get("extensionsRequired", [])
    for name in needed if isinstance(needed, list) else []:
        if not str(name).startswith(_SUPPORTED_EXTENSIONS):
            raise MeshError(
                f"{source.where}: needs the extension {ascii(name)[:60]}, which is not supported; "
                "export the mesh without it"
            )


def _check_integers(source: Source, what: str, entry: Tree, names: tuple[str, ...]) -> None:
    for name in names:
        value = entry.get(name, 0)
        if type(value) is not int or value < 0:
            raise MeshError(
                f"{source.where}: {name} of {what} is not a whole number; export the mesh again"
            )


def _node(source: Source, number: int, node: Tree) -> Tree:
    """Return a node with its transform, children and mesh only."""
    _check_integers(source, f"node {number}", node, ("mesh",))
    posed = "skin" in node or _is_posed(node)
    instanced = "EXT_mesh_gpu_instancing" in (node.get("extensions") or {})
    if "mesh" in node and (posed or instanced):
        raise MeshError(
            f"{source.where}: node {number} is {'posed by a skeleton' if posed else 'instanced'}, "
            "which is not supported; export the mesh in its pose, without"
        )
    return {name: node[name] for name in _NODE_KEYS if name in node}


def _is_posed(entry: Tree) -> bool:
    """Return whether morph targets move the vertices."""
    return any(entry.get("weights") or [])


def _check_nodes(source: Source, nodes: list[Tree], tree: Tree) -> None:
    """Reject cycles and nodes with two parents; the format requires trees."""
    roots = dict.fromkeys(range(len(nodes)))
    for node in nodes:
        for child in node.get("children", []):
            if type(child) is not int or child not in roots:
                name = child if type(child) is int else "of a child"
                raise MeshError(
                    f"{source.where}: node {name} does not exist or has two parents; export the "
                    "mesh again"
                )
            del roots[child]
    for scene in tree.get("scenes", []):
        found = scene.get("nodes", [])
        if len(set(found)) < len(found) or not set(found) <= roots.keys():
            raise MeshError(
                f"{source.where}: a scene has a node that does not exist or has a parent; export "
                "the mesh again"
            )
    queue, reached = list(roots), 0
    while queue:
        reached += 1
        queue += nodes[queue.pop()].get("children", [])
    if reached < len(nodes):
        raise MeshError(f"{source.where}: its nodes form a cycle; export the mesh again")


def _primitives(
    source: Source, where: str, tree: Tree, mesh: Tree, kept: dict[int, int]
) -> list[Tree]:
    """Return the triangles of a mesh, with accessors renumbered in the order of their use."""
    if _is_posed(mesh):
        raise MeshError(
            f"{source.where}: {where} is moved by morph targets, which is not supported; export "
            "the mesh in its pose, without"
        )
    parts = []
    for part in mesh.get("primitives", []):
        mode = part.get("mode", _TRIANGLES[0])
        if mode in _LINES:
            continue
        if mode not in _TRIANGLES:
            raise MeshError(f"{source.where}: {where} has triangle fans; export it as triangles")
        uses = {"POSITION": part.get("attributes", {}).get("POSITION"), "indices": None}
        if "indices" in part:
            uses["indices"] = part["indices"]
        for name, number in uses.items():
            if number is not None or name == "POSITION":
                _check_use(source, where, tree, name, number)
        row = {name: kept.setdefault(n, len(kept)) for name, n in uses.items() if n is not None}
        new = {"attributes": {"POSITION": row.pop("POSITION")}, "mode": mode}
        parts.append(new | row)
    return parts


def _check_use(source: Source, where: str, tree: Tree, name: str, number: object) -> None:
    """Reject positions and indices that trimesh would misread."""
    accessors = tree.get("accessors", [])
    if type(number) is not int or not 0 <= number < len(accessors):
        raise MeshError(f"{source.where}: {where} has no valid {name}; {source.hint}")
    accessor = accessors[number]
    positions = name == "POSITION"
    kinds = _POSITIONS if positions else _WHOLE_NUMBERS
    if accessor.get("type") != ("VEC3" if positions else "SCALAR") or (
        accessor.get("componentType") not in kinds
    ):
        raise MeshError(f"{source.where}: {name} of {where} have a wrong type; {source.hint}")
    packed = [key for key in ("sparse", "normalized") if accessor.get(key)]
    if packed or "bufferView" not in accessor:
        encoding = packed[0] if packed else "compressed"
        raise MeshError(
            f"{source.where}: {name} of {where} are {encoding}, which is not supported; export "
            "the mesh without"
        )


def _accessor(source: Source, tree: Tree, number: int, size: int) -> Tree:
    accessor: Tree = tree["accessors"][number]
    _check_integers(source, f"accessor {number}", accessor, _ACCESSOR_NUMBERS)
    if accessor.get("count", 0) > size:
        raise MeshError(
            f"{source.where}: accessor {number} declares {accessor['count']:,} entries, but the "
            f"buffers have {size:,} bytes; is the file complete?"
        )
    return accessor
