"""The JSON tree of a glTF, and the triangles that it describes; all of it is checked.

Accessors, buffer views and buffers are checked before their numbers are read.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from grasp3d.arrays import Floats, Ints
from grasp3d.reading.sources import Source, check_corners, check_finite, flattens

Tree = dict[str, Any]

LISTS = ("scenes", "nodes", "meshes", "accessors", "bufferViews", "buffers")

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

_LINES, _TRIANGLES, _STRIP = (0, 1, 2, 3), 4, 5

KINDS = {5120: "i1", 5121: "u1", 5122: "<i2", 5123: "<u2", 5125: "<u4", 5126: "<f4"}
"""NumPy type of a number by the componentType of an accessor."""

COLUMNS = {"SCALAR": 1, "VEC3": 3}
"""Numbers of an entry by the type of an accessor."""

LENGTHS = {"matrix": 16, "translation": 3, "rotation": 4, "scale": 3}
"""Number of values of each kind of transform."""

ROUNDING = 1e-6
"""Largest error of the last row of a matrix."""

LARGEST = 1e60
"""Largest value of a transform, whose powers stay finite."""


@dataclass(frozen=True)
class GltfScene:
    """The JSON tree of a glTF, with its buffers."""

    source: Source
    tree: Tree
    buffers: list[bytes | None]
    """None: its data are missing."""

    def surface(self) -> tuple[Floats, Ints]:
        """Vertices (V, 3) and faces (F, 3) of the scene, with the transforms of its nodes applied.

        Raises:
            MeshError: It needs an unsupported feature, or its numbers are inconsistent.
        """
        source, tree = self.source, self.tree
        for key in LISTS:
            if not _is_list_of(dict, tree.get(key, [])):
                raise source.unexpected(f"its {key} are not a list of objects")
        self._check_features()
        nodes = tree.get("nodes", [])
        for number, node in enumerate(nodes):
            self._check_node(number, node)
        placed = self._placed(nodes)
        meshes = [
            list(self._parts(f"mesh {number}", mesh))
            for number, mesh in enumerate(tree.get("meshes", []))
        ]
        for number, node in enumerate(nodes):
            if node.get("mesh", -1) >= len(meshes):
                raise source.damaged(
                    f"node {number} uses mesh {node['mesh']}, but there are {len(meshes)}"
                )
        vertices, faces, count = [np.empty((0, 3))], [np.empty((0, 3), dtype=np.int64)], 0
        for mesh, world in placed:
            for points, corners in meshes[mesh]:
                vertices.append(points @ world[:3, :3].T + world[:3, 3])
                mirrored = np.linalg.det(world[:3, :3]) < 0.0
                faces.append(count + (corners[:, ::-1] if mirrored else corners))
                count += len(points)
        return np.concatenate(vertices), np.concatenate(faces)

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

    def _check_node(self, number: int, node: Tree) -> None:
        """Refuse a mesh that is posed otherwise than by transforms."""
        self._check_whole(f"node {number}", node, ("mesh",))
        extensions = node.get("extensions")
        posed = "skin" in node or _is_posed(node)
        instanced = isinstance(extensions, dict) and "EXT_mesh_gpu_instancing" in extensions
        if "mesh" in node and (posed or instanced):
            raise self.source.error(
                f"node {number} is {'posed by a skeleton' if posed else 'instanced'}, which is not "
                "supported; export the mesh in its pose, without"
            )

    def _placed(self, nodes: list[Tree]) -> list[tuple[int, Floats]]:
        """Numbers of the meshes that are shown, and their transforms, shape (4, 4).

        Cycles and nodes with two parents are refused; the format requires trees.
        """
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
        shown = tree.get("scenes", [{}])[tree.get("scene", 0) :][:1]
        numbers = {root for scene in shown for root in scene.get("nodes", [])}
        return placed_meshes(source, nodes, {root: root in numbers for root in roots})

    def _parts(self, where: str, mesh: Tree) -> Iterator[tuple[Floats, Ints]]:
        """Vertices (n, 3) and triangles (m, 3) of each part of a mesh."""
        if _is_posed(mesh):
            raise self.source.error(
                f"{where} is moved by morph targets, which is not supported; export the mesh in "
                "its pose, without"
            )
        primitives = mesh.get("primitives", [])
        if not _is_list_of(dict, primitives):
            raise self.source.unexpected(f"the primitives of {where} are not a list of objects")
        for part in primitives:
            mode = part.get("mode", _TRIANGLES)
            if mode in _LINES:
                continue
            if mode not in (_TRIANGLES, _STRIP):
                raise self.source.error(f"{where} has triangle fans; export it as triangles")
            attributes = part.get("attributes")
            position = attributes.get("POSITION") if isinstance(attributes, dict) else None
            points = self._numbers(where, "POSITION", position).astype(np.float64)
            check_finite(points, self.source.where)
            corners = np.arange(len(points))
            if part.get("indices") is not None:
                corners = self._numbers(where, "indices", part["indices"]).ravel().astype(np.int64)
            if mode == _STRIP:
                faces = corners[np.arange(max(len(corners) - 2, 0))[:, None] + np.arange(3)]
                faces[1::2] = faces[1::2, [1, 0, 2]]
                faces = faces[(faces != np.roll(faces, 1, axis=1)).all(axis=1)]
            elif len(corners) % 3:
                raise self.source.incomplete(
                    f"{where} has triangles with {len(corners):,} corners, which is no multiple of "
                    "three"
                )
            else:
                faces = corners.reshape(-1, 3)
            check_corners(faces, len(points), self.source.where, "; export the mesh again")
            yield points, faces

    def _numbers(self, where: str, name: str, number: object) -> npt.NDArray[Any]:
        """Numbers of an accessor, shape (count, columns); refuses packed ones, and other types."""
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
        return self._entries(f"accessor {number}", accessor)

    def _entries(self, what: str, accessor: Tree) -> npt.NDArray[Any]:
        """Numbers of an accessor of known type, all of which are there."""
        self._check_whole(what, accessor, ("byteOffset",), required=("bufferView", "count"))
        if accessor["count"] == 0:
            raise self.source.damaged(f"{what} has no entries")
        view = self._view(what, accessor["bufferView"])
        kind, columns = np.dtype(KINDS[accessor["componentType"]]), COLUMNS[accessor["type"]]
        entry = kind.itemsize * columns
        stride = view.get("byteStride", entry)
        if stride == 0:
            raise self.source.damaged(f"the bufferView of {what} states a byteStride of 0")
        start = accessor.get("byteOffset", 0)
        end = start + (accessor["count"] - 1) * stride + entry
        if end > view["byteLength"]:
            raise self.source.incomplete(
                f"{what} declares {accessor['count']:,} entries up to byte {end:,} of bufferView "
                f"{accessor['bufferView']}, which has {view['byteLength']:,}"
            )
        data, start = self.buffers[view["buffer"]], start + view.get("byteOffset", 0)
        shape = accessor["count"], columns
        return np.ndarray(shape, kind, data, start, (stride, kind.itemsize))

    def _view(self, accessor: str, number: int) -> Tree:
        """Return a buffer view that lies within its buffer."""
        source, views = self.source, self.tree.get("bufferViews", [])
        if number >= len(views):
            raise source.damaged(f"{accessor} uses bufferView {number}, but there are {len(views)}")
        view: Tree = views[number]
        what = f"bufferView {number}"
        needed = ("buffer", "byteLength")
        self._check_whole(what, view, ("byteOffset", "byteStride"), required=needed)
        buffer, count = view["buffer"], len(self.buffers)
        if buffer >= count:
            raise source.damaged(f"{what} uses buffer {buffer}, but there are {count}")
        data = self.buffers[buffer]
        if data is None:
            raise source.incomplete(f"buffer {buffer} has no data")
        end = view.get("byteOffset", 0) + view["byteLength"]
        if end > len(data):
            raise source.incomplete(
                f"{what} ends at byte {end:,} of buffer {buffer}, which has {len(data):,}"
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


def placed_meshes(
    source: Source, nodes: list[Tree], roots: dict[int, bool]
) -> list[tuple[int, Floats]]:
    """Meshes with their transforms; those that are no numbers, or flatten a mesh, are refused.

    A scale of 0 in all directions is how some programs hide a part, and is accepted.

    Args:
        source: The file.
        nodes: Its nodes, which form trees.
        roots: Nodes without a parent, and whether they are shown.

    Returns:
        Numbers of the meshes of nodes that are shown, and transforms, shape (4, 4).

    Raises:
        MeshError: There is such a transform.
    """
    for number, node in enumerate(nodes):
        for name, length in LENGTHS.items():
            if name in node:
                _check_values(source, number, name, node[name], length)
    placed, queue = [], [(root, np.eye(4), is_shown) for root, is_shown in reversed(roots.items())]
    while queue:
        number, parent, is_shown = queue.pop()
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
        if "mesh" in node and is_shown:
            placed.append((node["mesh"], world))
        queue += [(child, world, is_shown) for child in reversed(node.get("children", []))]
    return placed


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
