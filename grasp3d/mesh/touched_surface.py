"""The surface of an object as the kernels of hands take it: nearest points, signs and normals."""

import numpy as np

from grasp3d._kernels.hands.touched_surface import TouchedSurface, fill_grid
from grasp3d._kernels.surface.box_tree import RADIUS, THICKNESS, box_tree
from grasp3d.arrays import Floats, Ints, locked, unit_rows
from grasp3d.mesh.measures import Triangles
from grasp3d.mesh.normals import CornerNormals

STEPS = 48
"""Nodes of the grid of distances along the longest side."""

MARGIN = 0.006
"""How far the grid reaches beyond the surface [m]."""


def touched_surface(
    vertices: Floats, faces: Ints, normals: CornerNormals, *, closed: bool
) -> TouchedSurface:
    """Prepare a surface; 20,480 faces took 0.5 s of CPU time.

    Args:
        vertices: Positions [m], shape (V, 3).
        faces: Shape (F, 3), counter-clockwise from outside.
        normals: Inward unit normals at the corners of the faces.
        closed: Whether the surface bounds a volume; if not, distances have no sign.
    """
    surface = Triangles(vertices, faces)
    tree = box_tree(locked(vertices), locked(faces))
    outward = np.empty((len(faces), 7, 3))
    outward[:, 0] = -surface.normals
    one, two = surface.pairs
    across = np.full(3 * len(faces), -1, dtype=np.int64)
    across[one], across[two] = two // 3, one // 3
    beyond = np.where(across < 0, np.arange(3 * len(faces)) // 3, across)
    outward[:, 1:4] = (outward[:, :1] + outward[beyond.reshape(-1, 3), 0]).reshape(-1, 3, 3)
    sums = np.zeros((len(vertices), 3))
    np.add.at(sums, faces, surface.angles[:, :, None] * outward[:, :1])
    outward[:, 4:] = unit_rows(sums)[faces]
    place = np.empty(len(faces), dtype=np.int64)
    place[tree.order] = np.arange(len(faces))
    low, high = vertices[surface.used].min(axis=0), vertices[surface.used].max(axis=0)
    origin, extent = low - MARGIN, high - low + 2.0 * MARGIN
    step = float(extent.max()) / (STEPS - 1)
    nodes = np.ceil(extent / step - 1e-9).astype(int) + 1
    boxes = tree.boxes.copy()  # which in single precision must contain those of the tree
    boxes[:, [3, 4, 5, RADIUS, THICKNESS]] += 1e-6 * np.abs(boxes).max()
    touched = TouchedSurface(
        tree=tree,
        boxes=boxes.astype(np.float32),
        closed=closed,
        corners=np.ascontiguousarray(faces[tree.order]),
        across=np.where(across < 0, -1, place[across]).reshape(-1, 3)[tree.order],
        outward=outward[tree.order].reshape(-1, 21),
        inward=normals.normals[normals.corners[tree.order]].reshape(-1, 9),
        box=np.concatenate([0.5 * (low + high), 0.5 * (high - low)]),
        origin=origin,
        step=step,
        values=np.empty(tuple(nodes), dtype=np.float32),
        slots=np.zeros(tuple(nodes), dtype=np.int32),
    )
    fill_grid(touched)
    return touched
