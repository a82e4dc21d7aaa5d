"""Checks of the transforms of the nodes of a glTF."""

from typing import Any

import numpy as np

from grasp3d.arrays import Floats
from grasp3d.reading.sources import Source

Tree = dict[str, Any]

LENGTHS = {"matrix": 16, "translation": 3, "rotation": 4, "scale": 3}
"""Number of values of each kind of transform."""

FLAT = 1e-9
"""Smallest scale of a transform, as a fraction of its largest, that does not flatten a mesh."""

ROUNDING = 1e-6
"""Largest error of the last row of a matrix."""

LARGEST = 1e60
"""Largest value of a transform, whose powers stay finite."""


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
            raise source.error(
                f"node {number} is scaled or moved by more than can be computed "
                f"with ({LARGEST:.0e}); export the mesh again"
            )
        if "mesh" in node and world is not parent:
            _check_scale(source, number, world)
        queue += [(child, world) for child in node.get("children", [])]


def _check_values(source: Source, number: int, name: str, values: object, length: int) -> None:
    """Refuse a transform that does not have the right number of finite numbers."""
    numbers = values if isinstance(values, list) else []
    if len(numbers) != length or not all(
        type(value) in {int, float} and abs(value) <= LARGEST for value in numbers
    ):
        raise source.error(
            f"{name} of node {number} is not a list of {length} finite numbers; "
            "export the mesh again"
        )
    if name == "rotation" and not any(numbers):
        raise source.error(
            f"rotation of node {number} is 0, which is no rotation; export the mesh again"
        )
    if name == "matrix" and np.abs(np.subtract(numbers[3::4], (0, 0, 0, 1))).max() > ROUNDING:
        raise source.error(
            f"matrix of node {number} is a projection: its last row must be "
            "0 0 0 1; export the mesh again"
        )


def flattens(world: Floats) -> bool:
    """Whether a transform, shape (4, 4), has a scale of 0 in some directions, but not in all."""
    scales = np.linalg.svd(world[:3, :3], compute_uv=False)
    return bool(scales[0] > 0.0 and scales[2] <= FLAT * scales[0])


def _check_scale(source: Source, number: int, world: Floats) -> None:
    if flattens(world):
        raise source.error(
            f"node {number} flattens its mesh: its transform, with those of the "
            "nodes above it, is singular (a scale of 0 in some directions); export the mesh again, "
            "or without this part"
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
