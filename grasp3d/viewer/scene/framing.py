"""Aiming a camera without perspective so that an object fills its part of a picture."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyvista

from grasp3d.arrays import Floats
from grasp3d.rendering import View
from grasp3d.viewer.subjects.subject import Subject

MARGIN = 1.06
"""How much larger the room is than the object that fills it."""


@dataclass(frozen=True)
class Room:
    """The part of a pane that is free for the object [pixels]."""

    width: float
    """Of the pane."""
    height: float
    top: float = 0.0
    """Taken by words above."""
    bottom: float = 0.0
    """Taken by words below."""
    sides: float = 0.0
    """Kept free at the left and the right."""

    @property
    def free(self) -> tuple[float, float]:
        """Width and height that are left, at least a pixel."""
        return (
            max(1.0, self.width - 2.0 * self.sides),
            max(1.0, self.height - self.top - self.bottom),
        )

    @property
    def shift(self) -> float:
        """Middle of the free part above the middle of the pane, in halves of its height."""
        return (self.bottom - self.top) / max(1.0, self.height)


def extents(points: Floats, middle: Floats, axes: Sequence[Floats]) -> tuple[float, float]:
    """How far points reach from their middle to the sides, and up or down.

    Args:
        points: Shape (n, 3).
        middle: What is in the middle of the picture, shape (3,).
        axes: Unit vectors to the right, up and toward the eye, for each view, shape (3, 3).
    """
    reach = np.max([np.abs((points - middle) @ one[:2].T).max(axis=0) for one in axes], axis=0)
    return float(reach[0]), float(reach[1])


def middle_of(points: Floats, axes: Floats) -> Floats:
    """Point that lies in the middle of what is seen of points (n, 3) from one view."""
    seen = points @ axes.T
    return np.asarray(0.5 * (seen.min(axis=0) + seen.max(axis=0)) @ axes)


def parallel_scale(reach: tuple[float, float], room: Room) -> float:
    """Half the height of a pane in the mesh's unit, with what reaches so far filling the room."""
    wide, tall = room.free
    per_pixel = max(2.0 * reach[0] / wide, 2.0 * reach[1] / tall, np.finfo(float).tiny)
    return 0.5 * MARGIN * per_pixel * room.height


def aim(camera: pyvista.Camera, subject: Subject, view: View, middle: Floats) -> None:
    """Look at a point of a surface from a side."""
    axes = view.axes
    camera.parallel_projection = True
    camera.focal_point = tuple(middle)
    camera.position = tuple(middle + 3.0 * subject.size * axes[2])
    camera.up = tuple(axes[1])
    camera.clipping_range = (0.5 * subject.size, 6.0 * subject.size)


def dots(renderer: pyvista.Renderer) -> float:
    """Pixels for each of 72 per inch: how much larger lines and letters are in a fine picture."""
    return float(renderer.GetRenderWindow().GetDPI()) / 72.0


def axes_of(camera: pyvista.Camera) -> Floats:
    """Unit vectors to the right, up and toward the eye, shape (3, 3)."""
    matrix = camera.GetViewTransformMatrix()
    return np.array([[matrix.GetElement(i, j) for j in range(3)] for i in range(3)])
