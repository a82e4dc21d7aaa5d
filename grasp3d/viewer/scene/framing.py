"""Placing a camera with parallel projection so that an object fills its part of a picture."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import pyvista

from grasp3d.arrays import Floats
from grasp3d.rendering import View
from grasp3d.viewer.subjects.subject import Subject

MARGIN = 1.06
"""Size of the free area relative to the object that fills it."""


@dataclass(frozen=True)
class FreeArea:
    """The part of a pane that is free for the object [pixels]."""

    width: float
    """Width of the pane."""
    height: float
    """Height of the pane."""
    top: float = 0.0
    """Height of the texts above."""
    bottom: float = 0.0
    """Height of the texts below."""
    sides: float = 0.0
    """Margin at the left and the right."""

    @property
    def free(self) -> tuple[float, float]:
        """Width and height of the free part, at least one pixel."""
        return (
            max(1.0, self.width - 2.0 * self.sides),
            max(1.0, self.height - self.top - self.bottom),
        )

    @property
    def shift(self) -> float:
        """Height of the free part's centre above the pane's centre, in half heights of the pane."""
        return (self.bottom - self.top) / max(1.0, self.height)


def extents(points: Floats, middle: Floats, axes: Sequence[Floats]) -> tuple[float, float]:
    """Largest horizontal and vertical distance of points from a centre, over several views.

    Args:
        points: Shape (n, 3).
        middle: Centre of the picture, shape (3,).
        axes: For each view the unit vectors to the right, up and toward the camera, (3, 3).
    """
    reach = np.max([np.abs((points - middle) @ one[:2].T).max(axis=0) for one in axes], axis=0)
    return float(reach[0]), float(reach[1])


def middle_of(points: Floats, axes: Floats) -> Floats:
    """Centre of points (n, 3) as seen from one view."""
    seen = points @ axes.T
    return np.asarray(0.5 * (seen.min(axis=0) + seen.max(axis=0)) @ axes)


def parallel_scale(reach: tuple[float, float], area: FreeArea) -> float:
    """Half the pane's height in the mesh's unit, if the given extents fill the free area."""
    width, height = area.free
    per_pixel = max(2.0 * reach[0] / width, 2.0 * reach[1] / height, np.finfo(float).tiny)
    return 0.5 * MARGIN * per_pixel * area.height


def aim(camera: pyvista.Camera, subject: Subject, view: View, middle: Floats) -> None:
    """Point the camera at a point of a surface."""
    axes = view.axes
    camera.parallel_projection = True
    camera.focal_point = tuple(middle)
    camera.position = tuple(middle + 3.0 * subject.size * axes[2])
    camera.up = tuple(axes[1])
    camera.clipping_range = (0.5 * subject.size, 6.0 * subject.size)


def pixel_ratio(renderer: pyvista.Renderer) -> float:
    """Pixels per 1/72 inch, the factor of line widths and text sizes in fine pictures."""
    return float(renderer.GetRenderWindow().GetDPI()) / 72.0


def axes_of(camera: pyvista.Camera) -> Floats:
    """Unit vectors to the right, up and toward the camera, shape (3, 3)."""
    matrix = camera.GetViewTransformMatrix()
    return np.array([[matrix.GetElement(i, j) for j in range(3)] for i in range(3)])
