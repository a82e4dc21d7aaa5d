"""Reduction of the JSON tree of a glTF, and checks for content that trimesh would misread.

Accessors, buffer views and buffers are checked before their numbers are read.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.reading.sources import Source, flattens

Tree = dict[str, Any]

LISTS = ("scenes", "nodes", "meshes", "accessors", "bufferViews", "buffers")
_NODE_KEYS = ("children", "matrix", "translation", "rotation", "scale", "mesh")

_SUPPORTED_EXTENSIONS = (
    "KHR_mesh_quantization", "KHR_materials_", "KHR_texture_", "KHR_lights_", "EXT_texture_",
    "EXT_lights_", "MSFT_texture_", "KHR_xmp",
)  # fmt: skip
"""Prefixes of extensions that do not change positions, or only their encoding."""

_USES = {
    "POSITION": ("VEC3", (5120, 5121, 5122, 5123, 5126)),
    "indices": ("SCALAR", (5121, 5123, 5125)),
}
"""Type and possible componentTypes of the accessors that are read."""

_LINES = (0, 1, 2, 3)
_TRIANGLES = (4, 5)

BYTES = {5120: 1, 5121: 1, 5122: 2, 5123: 2, 5125: 4, 5126: 4}
"""Size of a number by the componentType of an accessor."""

COLUMNS = {"SCALAR": 1, "VEC3": 3}
"""Numbers of an entry by the type of an accessor."""

LENGTHS = {"matrix": 16, "translation": 3, "rotation": 4, "scale": 3}
"""Number of values of each kind of transform."""

ROUNDING = 1e-6
"""Largest error of the last row of a matrix."""

LARGEST = 1e60
"""Largest value of a transform, whose powers stay finite."""


@dataclass(frozen=True)
class GltfReduction:
    """The JSON tree of a glTF, to be reduced to its nodes, meshes and buffers."""

    source: Source
    tree: Tree
    sizes: list[int | None]
    """Size of each of its buffers [bytes]; None: its data are missing."""

    def reduced(self) -> Tree:
        """Return the tree without images, materials, animations and cameras.

        Raises:
            MeshError: It needs an unsupported feature, or its numbers are inconsistent.
        """
        source, tree = self.source, self.tree
        for key in LISTS:
            if not _is_list_of(dict, tree.get(key, [])):
                raise source.unexpected(f"its {key} are not a list of objects")
        self._check_features()
        nodes = [self._node(number, node) for number, node in enumerate(tree.get("nodes", []))]
        self._check_nodes(nodes)
        rows: dict[int, int] = {}  # of the accessors that are used, in the order of their use
        meshes = [
            {"primitives": self._primitives(f"mesh {number}", mesh, rows)}
            for number, mesh in enumerate(tree.get("meshes", []))
        ]
        for number, node in enumerate(nodes):
            if node.get("mesh", -1) >= len(meshes):
                raise source.damaged(
                    f"node {number} uses mesh {node['mesh']}, but there are {len(meshes)}"
                )
        used = [self._accessor(number) for number in rows]
        accessors = [accessor | {"bufferView": row} for row, (accessor, _) in enumerate(used)]
        for number, mesh in enumerate(meshes):
            for part in mesh["primitives"]:
                corners = part.get("indices", part["attributes"]["POSITION"])
                count = accessors[corners]["count"]
                if part["mode"] == _TRIANGLES[0] and count % 3:
                    raise source.incomplete(
                        f"mesh {number} has triangles with {count:,} corners, which is no multiple "
                        "of three"
                    )
        parts = {
            "asset": {"version": "2.0"},
            "nodes": nodes,
            "meshes": meshes,
            "accessors": accessors,
            "bufferViews": [view for _, view in used],
        }
        return {name: tree[name] for name in ("scene", "scenes", "buffers") if name in tree} | parts

    def _check_features(self) -> None:
        """Refuse other versions, and extensions that change positions."""
        asset, needed = self.tree.get("asset", {}), self.tree.get("extensionsRequired", [])
        version = asset.get("version", "2.0") if isinstance(asset, dict) else asset
        if not str(version).startswith("2"):
            raise self.source.error(
                f"is glTF of version {ascii(version)[:20]}, and only version 2 is read; export it "
                "as glTF 2.0"
            )
        for name in needed if isinstance(needed, list) else []:
            if not str(name).startswith(_SUPPORTED_EXTENSIONS):
                raise self.source.error(
                    f"needs the extension {ascii(name)[:60]}, which is not supported; export the "
                    "mesh without it"
                )

    def _node(self, number: int, node: Tree) -> Tree:
        """Return a node with its transform, children and mesh only."""
        self._check_whole(f"node {number}", node, ("mesh",))
        extensions = node.get("extensions")
        posed = "skin" in node or _is_posed(node)
        instanced = isinstance(extensions, dict) and "EXT_mesh_gpu_instancing" in extensions
        if "mesh" in node and (posed or instanced):
            raise self.source.error(
                f"node {number} is {'posed by a skeleton' if posed else 'instanced'}, which is not "
                "supported; export the mesh in its pose, without"
            )
        return {name: node[name] for name in _NODE_KEYS if name in node}

    def _check_nodes(self, nodes: list[Tree]) -> None:
        """Reject cycles and nodes with two parents; the format requires trees."""
        source, tree = self.source, self.tree
        roots = dict.fromkeys(range(len(nodes)))
        for node in nodes:
            children = node.get("children", [])
            for child in children if isinstance(children, list) else [None]:
                if type(child) is not int or child not in roots:
                    name = child if type(child) is int else "of a child"
                    raise source.damaged(f"node {name} does not exist or has two parents")
                del roots[child]
        for number, scene in enumerate(tree.get("scenes", [])):
            numbers = scene.get("nodes", [])
            if not _is_list_of(int, numbers):
                raise source.damaged(f"the nodes of scene {number} are not a list of whole numbers")
            if len(set(numbers)) < len(numbers) or not set(numbers) <= roots.keys():
                raise source.damaged("a scene has a node that does not exist or has a parent")
        queue, reached = list(roots), 0
        while queue:
            reached += 1
            queue += nodes[queue.pop()].get("children", [])
        if reached < len(nodes):
            raise source.damaged("its nodes form a cycle")
        self._check_whole("the file", tree, ("scene",))
        if "scene" in tree and tree["scene"] >= len(tree.get("scenes", [])):
            raise source.damaged(
                f"there is no scene {tree['scene']}, which it names as the one to show"
            )
        check_transforms(source, nodes, list(roots))

    def _primitives(self, where: str, mesh: Tree, rows: dict[int, int]) -> list[Tree]:
        """Return the triangles of a mesh, with accessors renumbered in the order of their use."""
        if _is_posed(mesh):
            raise self.source.error(
                f"{where} is moved by morph targets, which is not supported; export the mesh in "
                "its pose, without"
            )
        primitives = mesh.get("primitives", [])
        if not _is_list_of(dict, primitives):
            raise self.source.unexpected(f"the primitives of {where} are not a list of objects")
        parts = []
        for part in primitives:
            mode = part.get("mode", _TRIANGLES[0])
            if mode in _LINES:
                continue
            if mode not in _TRIANGLES:
                raise self.source.error(f"{where} has triangle fans; export it as triangles")
            attributes = part.get("attributes")
            position = attributes.get("POSITION") if isinstance(attributes, dict) else None
            uses = {"POSITION": self._used_accessor(where, "POSITION", position)}
            if part.get("indices") is not None:
                uses["indices"] = self._used_accessor(where, "indices", part["indices"])
            row = {name: rows.setdefault(used, len(rows)) for name, used in uses.items()}
            parts.append({"attributes": {"POSITION": row.pop("POSITION")}, "mode": mode} | row)
        return parts

    def _used_accessor(self, where: str, name: str, number: object) -> int:
        """Number of an accessor; rejects positions and indices that trimesh would misread."""
        accessors = self.tree.get("accessors", [])
        if type(number) is not int or not 0 <= number < len(accessors):
            raise self.source.unexpected(f"{where} has no valid {name}")
        accessor = accessors[number]
        kind, components = _USES[name]
        if accessor.get("type") != kind or accessor.get("componentType") not in components:
            raise self.source.unexpected(f"{name} of {where} have a wrong type")
        packed = [key for key in ("sparse", "normalized") if accessor.get(key)]
        if packed or "bufferView" not in accessor:
            encoding = packed[0] if packed else "compressed"
            raise self.source.error(
                f"{name} of {where} are {encoding}, which is not supported; export the mesh without"
            )
        return number

    def _accessor(self, number: int) -> tuple[Tree, Tree]:
        """Return an accessor of known type and its buffer view, whose entries are all there."""
        what = f"accessor {number}"
        accessor: Tree = self.tree["accessors"][number]
        self._check_whole(what, accessor, ("byteOffset",), required=("bufferView", "count"))
        if accessor["count"] == 0:
            raise self.source.damaged(f"{what} has no entries")
        view = self._view(what, accessor["bufferView"])
        entry = BYTES[accessor["componentType"]] * COLUMNS[accessor["type"]]
        stride = view.get("byteStride", entry)
        if stride == 0:
            raise self.source.damaged(f"the bufferView of {what} states a byteStride of 0")
        end = accessor.get("byteOffset", 0) + (accessor["count"] - 1) * stride + entry
        if end > view["byteLength"]:
            raise self.source.incomplete(
                f"{what} declares {accessor['count']:,} entries up to byte {end:,} of bufferView "
                f"{accessor['bufferView']}, which has {view['byteLength']:,}"
            )
        return accessor, view

    def _view(self, accessor: str, number: int) -> Tree:
        """Return a buffer view that lies within its buffer."""
        source, views = self.source, self.tree.get("bufferViews", [])
        if number >= len(views):
            raise source.damaged(f"{accessor} uses bufferView {number}, but there are {len(views)}")
        view: Tree = views[number]
        what = f"bufferView {number}"
        needed = ("buffer", "byteLength")
        self._check_whole(what, view, ("byteOffset", "byteStride"), required=needed)
        buffer, count = view["buffer"], len(self.sizes)
        if buffer >= count:
            raise source.damaged(f"{what} uses buffer {buffer}, but there are {count}")
        size = self.sizes[buffer]
        if size is None:
            raise source.incomplete(f"buffer {buffer} has no data")
        end = view.get("byteOffset", 0) + view["byteLength"]
        if end > size:
            raise source.incomplete(
                f"{what} ends at byte {end:,} of buffer {buffer}, which has {size:,}"
            )
        return view

    def _check_whole(
        self, what: str, entry: Tree, names: tuple[str, ...], required: tuple[str, ...] = ()
    ) -> None:
        """Refuse numbers of an entry that are not whole or negative, or missing though required."""
        for name in (*required, *names):
            if name in required and name not in entry:
                raise self.source.damaged(f"{what} states no {name}")
            value = entry.get(name, 0)
            if type(value) is not int or value < 0:
                raise self.source.damaged(f"{name} of {what} is not a whole number")


def _is_list_of(kind: type, value: object) -> bool:
    return isinstance(value, list) and all(type(entry) is kind for entry in value)


def _is_posed(entry: Tree) -> bool:
    """Return whether morph targets move the vertices."""
    weights = entry.get("weights")
    return any(weights) if isinstance(weights, list) else bool(weights)


def check_transforms(source: Source, nodes: list[Tree], roots: list[int]) -> None:
    """Refuse transforms that are no numbers, or that flatten a mesh.

    A scale of 0 in all directions is how some programs hide a part, and is accepted.

    Args:
        source: The file.
        nodes: Its nodes, which form trees.
        roots: Nodes without a parent.

    Raises:
        MeshError: There is such a transform.
    """
    for number, node in enumerate(nodes):
        for name, length in LENGTHS.items():
            if name in node:
                _check_values(source, number, name, node[name], length)
    queue = [(root, np.eye(4)) for root in roots]
    while queue:
        number, parent = queue.pop()
        node = nodes[number]
        with np.errstate(over="ignore", invalid="ignore"):  # checked below
            world = parent @ _matrix(node) if LENGTHS.keys() & node.keys() else parent
        if not np.abs(world).max() <= LARGEST:
            raise source.damaged(
                f"node {number} is scaled or moved by more than can be computed with "
                f"({LARGEST:.0e})"
            )
        if "mesh" in node and world is not parent and flattens(world):
            raise source.error(
                f"node {number} flattens its mesh: its transform, with those of the nodes above "
                "it, is singular (a scale of 0 in some directions); export the mesh again, or "
                "without this part"
            )
        queue += [(child, world) for child in node.get("children", [])]


def _check_values(source: Source, number: int, name: str, values: object, length: int) -> None:
    """Refuse a transform that does not have the right number of finite numbers."""
    numbers = values if isinstance(values, list) else []
    if len(numbers) != length or not all(
        type(value) in {int, float} and abs(value) <= LARGEST for value in numbers
    ):
        raise source.damaged(f"{name} of node {number} is not a list of {length} finite numbers")
    if name == "rotation" and not any(numbers):
        raise source.damaged(f"rotation of node {number} is 0, which is no rotation")
    if name == "matrix" and np.abs(np.subtract(numbers[3::4], (0, 0, 0, 1))).max() > ROUNDING:
        raise source.damaged(
            f"matrix of node {number} is a projection: its last row must be 0 0 0 1"
        )


def _matrix(node: Tree) -> Floats:
    """Transform of a node relative to its parent, shape (4, 4)."""
    from trimesh.transformations import quaternion_matrix

    if "matrix" in node:
        return np.array(node["matrix"], dtype=np.float64).reshape(4, 4).T
    matrix = np.eye(4)
    if "rotation" in node:
        x, y, z, w = node["rotation"]
        matrix = quaternion_matrix([w, x, y, z])
    if "scale" in node:
        matrix[:3, :3] *= np.array(node["scale"], dtype=np.float64)
    if "translation" in node:
        matrix[:3, 3] = node["translation"]
    return matrix
