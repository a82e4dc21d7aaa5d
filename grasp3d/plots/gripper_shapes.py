"""Grippers, their free approaches and tables as surfaces of PyVista."""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pyvista

from grasp3d.arrays import ArrayLike
from grasp3d.hand import shapes
from grasp3d.hand.hand import Hand
from grasp3d.hand.triangles import COLORS, Part, Triangles
from grasp3d.settings.lengths import Unit


def gripper_shape(hand: Hand, pose: ArrayLike, opening: float, unit: Unit) -> pyvista.PolyData:
    """A gripper at a pose, in the frame and unit of the mesh.

    Its faces have the arrays `part` (the numbers of `Part`) and `color` (uint8, to be drawn
    with `scalars="color", rgb=True`).

    Args:
        hand: The hand.
        pose: Matrix that takes coordinates of the gripper's frame to the mesh's, shape (4, 4), with
            translations in the mesh's unit.
        opening: Distance between the pads, or between the nearest points of round tips [unit].
        unit: Unit of the mesh.

    Example:
        >>> import numpy as np
        >>> from grasp3d.hand.parallel_gripper import preset
        >>> from grasp3d.plots.gripper_shapes import gripper_shape
        >>> shape = gripper_shape(preset("franka"), np.eye(4), 40.0, "mm")
        >>> sorted(shape.cell_data)
        ['color', 'part']
    """
    triangles = shapes.hand_triangles(hand, opening, pose=pose, unit=unit)
    surface = surface_of(triangles)
    surface.cell_data["part"] = triangles.parts
    colors = np.array([COLORS[part] for part in Part], dtype=np.uint8)
    surface.cell_data["color"] = colors[triangles.parts]
    return surface


def approach_arc(
    pose: ArrayLike, arcs: Sequence[tuple[float, float]], *, radius: float, inner: float = 0.8
) -> pyvista.PolyData:
    """The free approach angles of a grasp as a fan; see `shapes.approach_triangles`.

    Args:
        pose: Matrix of the grasp whose approach is the angle 0, shape (4, 4).
        arcs: Intervals of approach angles (low, high) about the pose's x-axis [rad].
        radius: Outer radius of the fan [mesh unit].
        inner: Its inner radius, as a fraction of the outer one.
    """
    return surface_of(shapes.approach_triangles(pose, arcs, radius=radius, inner=inner))


def surface_of(triangles: Triangles) -> pyvista.PolyData:
    """Triangles as a surface of PyVista; no faces give an empty surface."""
    if not len(triangles.faces):
        return pyvista.PolyData()
    faces: Any = triangles.faces
    surface: pyvista.PolyData = pyvista.PolyData.from_regular_faces(triangles.vertices, faces)
    return surface
