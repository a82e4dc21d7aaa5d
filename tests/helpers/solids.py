"""Meshes of solids whose labels are known: sphere, box, cylinder."""

import numpy as np
import trimesh

from grasp3d.mesh.object_mesh import ObjectMesh
from grasp3d.mesh.preparing import load_mesh

DEFAULT_EDGE = 1.0 / 64.0
"""Longest edge, as a fraction of the largest extent."""

SECTIONS = 144
"""Number of a cylinder's sides, 2.5 degrees each, so that facets do not affect the labels."""


def sphere_mesh(radius: float = 1.0, *, subdivisions: int = 5) -> ObjectMesh:
    """Make a sphere about the origin from an icosahedron.

    Args:
        radius: Distance of the vertices from the origin.
        subdivisions: How often each triangle is divided into four; 5 gives 10,242 vertices.

    Raises:
        MeshError: The size is not a positive number.
    """
    return load_mesh(trimesh.creation.icosphere(subdivisions, radius), max_edge=4.0 * radius)


def box_mesh(
    extents: tuple[float, float, float] = (2.0, 2.0, 2.0), *, max_edge: float | None = None
) -> ObjectMesh:
    """Make a box about the origin.

    Args:
        extents: Lengths along x, y and z.
        max_edge: Longest edge of its triangles; None: 1/64 of the largest extent.

    Raises:
        MeshError: The size is not a positive number.
    """
    longest = DEFAULT_EDGE * max(extents) if max_edge is None else max_edge
    return load_mesh(trimesh.creation.box(extents), max_edge=longest)


def cylinder_mesh(
    radius: float = 1.0, height: float = 3.0, *, max_edge: float | None = None
) -> ObjectMesh:
    """Make a cylinder about the origin, its axis along x.

    Args:
        radius: Distance of the vertices from the axis.
        height: Length along the axis.
        max_edge: Longest edge of its triangles; None: 1/64 of the largest extent.

    Raises:
        MeshError: The size is not a positive number.
    """
    longest = DEFAULT_EDGE * max(2.0 * radius, height) if max_edge is None else max_edge
    across = np.linspace(0.0, radius, max(2, round(radius / longest)), endpoint=False)
    along = np.linspace(-height / 2.0, height / 2.0, max(2, round(height / longest)))
    profile = np.concatenate(
        [
            np.column_stack([across, np.full(len(across), -height / 2.0)]),
            np.column_stack([np.full(len(along), radius), along]),
            np.column_stack([across[::-1], np.full(len(across), height / 2.0)]),
        ]
    )
    cylinder = trimesh.creation.revolve(profile, sections=SECTIONS)
    cylinder.vertices = cylinder.vertices[:, [2, 0, 1]]
    return load_mesh(cylinder, max_edge=longest)
