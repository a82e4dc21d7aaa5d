"""Reduction of the JSON tree of a glTF, and checks for content that trimesh would misread.

Accessors, buffer views and buffers are checked before their numbers are read.
"""

from typing import Any

from grasp3d.reading.gltf_transforms import check_transforms
from grasp3d.reading.sources import Source

Tree = dict[str, Any]

LISTS = ("scenes", "nodes", "meshes", "accessors", "bufferViews", "buffers")
_NODE_KEYS = ("children", "matrix", "translation", "rotation", "scale", "mesh")

_SUPPORTED_EXTENSIONS = (
    "KHR_mesh_quantization", "KHR_materials_", "KHR_texture_", "KHR_lights_", "EXT_texture_",
    "EXT_lights_", "MSFT_texture_", "KHR_xmp",
)  # fmt: skip
"""Prefixes of extensions that do not change positions, or only their encoding."""

_WHOLE_NUMBERS = (5121, 5123, 5125)
_POSITIONS = (5120, 5121, 5122, 5123, 5126)
_LINES = (0, 1, 2, 3)
_TRIANGLES = (4, 5)

BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
"""Size of a number by the componentType of an accessor."""

COLUMNS = {"SCALAR": 1, "VEC3": 3}
"""Numbers of an entry by the type of an accessor."""

_VIEW = ("byteOffset", "byteStride")
_ACCESSOR = ("byteOffset",)


def stripped_tree(source: Source, tree: Tree, sizes: list[int | None]) -> Tree:
    """Return the tree without images, materials, animations and cameras.

    Args:
        source: The file.
        tree: Its JSON.
        sizes: Size of each of its buffers [bytes]; None: its data are missing.

    Raises:
        MeshError: It needs an unsupported feature, or its numbers are inconsistent.
    """
    for key in LISTS:
        found = tree.get(key, [])
        if not isinstance(found, list) or not all(isinstance(entry, dict) for entry in found):
            raise source.error(f"its {key} are not a list of objects; {source.hint}")
    _check_version(source, tree)
    _check_extensions(source, tree)
    nodes = [_node(source, number, node) for number, node in enumerate(tree.get("nodes", []))]
    _check_nodes(source, nodes, tree)
    kept: dict[int, int] = {}
    meshes = [
        {"primitives": _primitives(source, f"mesh {number}", tree, mesh, kept)}
        for number, mesh in enumerate(tree.get("meshes", []))
    ]
    _check_meshes(source, nodes, meshes)
    used = [checked_accessor(source, tree, number, sizes) for number in kept]
    accessors = [accessor | {"bufferView": row} for row, (accessor, _) in enumerate(used)]
    _check_corners(source, meshes, accessors)
    names = ("scene", "scenes", "buffers")
    read = {
        "asset": {"version": "2.0"},
        "nodes": nodes,
        "meshes": meshes,
        "accessors": accessors,
        "bufferViews": [view for _, view in used],
    }
    return {name: tree[name] for name in names if name in tree} | read


def _check_version(source: Source, tree: Tree) -> None:
    asset = tree.get("asset", {})
    version = asset.get("version", "2.0") if isinstance(asset, dict) else asset
    if not str(version).startswith("2"):
        raise source.error(
            f"is glTF of version {ascii(version)[:20]}, and only version 2 is "
            "read; export it as glTF 2.0"
        )


def _check_extensions(source: Source, tree: Tree) -> None:
    needed = tree.get("extensionsRequired", [])
    for name in needed if isinstance(needed, list) else []:
        if not str(name).startswith(_SUPPORTED_EXTENSIONS):
            raise source.error(
                f"needs the extension {ascii(name)[:60]}, which is not supported; "
                "export the mesh without it"
            )


def _node(source: Source, number: int, node: Tree) -> Tree:
    """Return a node with its transform, children and mesh only."""
    check_whole(source, f"node {number}", node, ("mesh",))
    extensions = node.get("extensions")
    posed = "skin" in node or _is_posed(node)
    instanced = isinstance(extensions, dict) and "EXT_mesh_gpu_instancing" in extensions
    if "mesh" in node and (posed or instanced):
        raise source.error(
            f"node {number} is {'posed by a skeleton' if posed else 'instanced'}, "
            "which is not supported; export the mesh in its pose, without"
        )
    return {name: node[name] for name in _NODE_KEYS if name in node}


def _is_posed(entry: Tree) -> bool:
    """Return whether morph targets move the vertices."""
    weights = entry.get("weights")
    return any(weights) if isinstance(weights, list) else bool(weights)


def _check_nodes(source: Source, nodes: list[Tree], tree: Tree) -> None:
    """Reject cycles and nodes with two parents; the format requires trees."""
    roots = dict.fromkeys(range(len(nodes)))
    for node in nodes:
        children = node.get("children", [])
        for child in children if isinstance(children, list) else [None]:
            if type(child) is not int or child not in roots:
                name = child if type(child) is int else "of a child"
                raise source.error(
                    f"node {name} does not exist or has two parents; export the mesh again"
                )
            del roots[child]
    top = list(roots)
    for number, scene in enumerate(tree.get("scenes", [])):
        found = scene.get("nodes", [])
        if not isinstance(found, list) or not all(type(node) is int for node in found):
            raise source.error(
                f"the nodes of scene {number} are not a list of whole numbers; "
                "export the mesh again"
            )
        if len(set(found)) < len(found) or not set(found) <= roots.keys():
            raise source.error(
                "a scene has a node that does not exist or has a parent; export the mesh again"
            )
    queue, reached = list(roots), 0
    while queue:
        reached += 1
        queue += nodes[queue.pop()].get("children", [])
    if reached < len(nodes):
        raise source.error("its nodes form a cycle; export the mesh again")
    check_whole(source, "the file", tree, ("scene",))
    if "scene" in tree and tree["scene"] >= len(tree.get("scenes", [])):
        raise source.error(
            f"there is no scene {tree['scene']}, which it names as the one to "
            "show; export the mesh again"
        )
    check_transforms(source, nodes, top)


def _check_meshes(source: Source, nodes: list[Tree], meshes: list[Tree]) -> None:
    """Refuse nodes with a mesh that does not exist."""
    for number, node in enumerate(nodes):
        if node.get("mesh", -1) >= len(meshes):
            raise source.error(
                f"node {number} uses mesh {node['mesh']}, but there are "
                f"{len(meshes)}; export the mesh again"
            )


def _check_corners(source: Source, meshes: list[Tree], accessors: list[Tree]) -> None:
    """Refuse triangles whose corners are not a multiple of three."""
    for number, mesh in enumerate(meshes):
        for part in mesh["primitives"]:
            corners = part.get("indices", part["attributes"]["POSITION"])
            count = accessors[corners]["count"]
            if part["mode"] == _TRIANGLES[0] and count % 3:
                raise source.error(
                    f"mesh {number} has triangles with {count:,} corners, which is "
                    "no multiple of three; is the file complete?"
                )


def _primitives(
    source: Source, where: str, tree: Tree, mesh: Tree, kept: dict[int, int]
) -> list[Tree]:
    """Return the triangles of a mesh, with accessors renumbered in the order of their use."""
    if _is_posed(mesh):
        raise source.error(
            f"{where} is moved by morph targets, which is not supported; export "
            "the mesh in its pose, without"
        )
    found = mesh.get("primitives", [])
    if not isinstance(found, list) or not all(isinstance(part, dict) for part in found):
        raise source.error(f"the primitives of {where} are not a list of objects; {source.hint}")
    parts = []
    for part in found:
        mode = part.get("mode", _TRIANGLES[0])
        if mode in _LINES:
            continue
        if mode not in _TRIANGLES:
            raise source.error(f"{where} has triangle fans; export it as triangles")
        attributes = part.get("attributes")
        position = attributes.get("POSITION") if isinstance(attributes, dict) else None
        uses = {"POSITION": position, "indices": None}
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
        raise source.error(f"{where} has no valid {name}; {source.hint}")
    accessor = accessors[number]
    positions = name == "POSITION"
    kinds = _POSITIONS if positions else _WHOLE_NUMBERS
    if accessor.get("type") != ("VEC3" if positions else "SCALAR") or (
        accessor.get("componentType") not in kinds
    ):
        raise source.error(f"{name} of {where} have a wrong type; {source.hint}")
    packed = [key for key in ("sparse", "normalized") if accessor.get(key)]
    if packed or "bufferView" not in accessor:
        encoding = packed[0] if packed else "compressed"
        raise source.error(
            f"{name} of {where} are {encoding}, which is not supported; export the mesh without"
        )


def checked_accessor(
    source: Source, tree: Tree, number: int, sizes: list[int | None]
) -> tuple[Tree, Tree]:
    """Return an accessor and its buffer view, after checking that its entries are there.

    Args:
        source: The file.
        tree: Its JSON.
        number: The accessor, whose type and componentType are known.
        sizes: Size of each buffer [bytes]; None: its data are missing.

    Raises:
        MeshError: Its numbers are not whole, or it ends beyond its view, or that beyond its buffer.
    """
    what = f"accessor {number}"
    accessor: Tree = tree["accessors"][number]
    check_whole(source, what, accessor, _ACCESSOR, required=("bufferView", "count"))
    if accessor["count"] == 0:
        raise source.error(f"{what} has no entries; export the mesh again")
    view = _checked_view(source, tree, what, accessor["bufferView"], sizes)
    entry = BYTES[accessor["componentType"]] * COLUMNS[accessor["type"]]
    stride = view.get("byteStride", entry)
    if stride == 0:
        raise source.error(
            f"the bufferView of {what} states a byteStride of 0; export the mesh again"
        )
    start = accessor.get("byteOffset", 0)
    end = start + (accessor["count"] - 1) * stride + entry
    if end > view["byteLength"]:
        raise source.error(
            f"{what} declares {accessor['count']:,} entries up to byte {end:,} of "
            f"bufferView {accessor['bufferView']}, which has {view['byteLength']:,}; "
            "is the file complete?"
        )
    return accessor, view


def check_whole(
    source: Source, what: str, entry: Tree, names: tuple[str, ...], required: tuple[str, ...] = ()
) -> None:
    """Refuse numbers that are not whole or negative.

    Args:
        source: The file.
        what: Name of the entry, for errors.
        entry: The entry of the JSON.
        names: Names of numbers that may be left out.
        required: Names of numbers that must be there.
    """
    for name in (*required, *names):
        if name in required and name not in entry:
            raise source.error(f"{what} states no {name}; export the mesh again")
        value = entry.get(name, 0)
        if type(value) is not int or value < 0:
            raise source.error(f"{name} of {what} is not a whole number; export the mesh again")


def _checked_view(
    source: Source, tree: Tree, accessor: str, number: int, sizes: list[int | None]
) -> Tree:
    views = tree.get("bufferViews", [])
    if number >= len(views):
        raise source.error(
            f"{accessor} uses bufferView {number}, but there are {len(views)}; "
            "export the mesh again"
        )
    view: Tree = views[number]
    what = f"bufferView {number}"
    check_whole(source, what, view, _VIEW, required=("buffer", "byteLength"))
    if view["buffer"] >= len(sizes):
        raise source.error(
            f"{what} uses buffer {view['buffer']}, but there are {len(sizes)}; "
            "export the mesh again"
        )
    size = sizes[view["buffer"]]
    if size is None:
        raise source.error(f"buffer {view['buffer']} has no data; is the file complete?")
    end = view.get("byteOffset", 0) + view["byteLength"]
    if end > size:
        raise source.error(
            f"{what} ends at byte {end:,} of buffer {view['buffer']}, which has "
            f"{size:,}; is the file complete?"
        )
    return view
