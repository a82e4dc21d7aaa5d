"""An image in a renderer, pixel by pixel."""

from typing import Any

import pyvista
from vtkmodules.vtkRenderingCore import vtkActor2D, vtkImageMapper

from grasp3d.arrays import Bytes


class ImageActor:
    """An image in front of everything else in a renderer."""

    def __init__(self, renderer: Any) -> None:
        """Add a hidden actor.

        Args:
            renderer: Renderer of VTK or PyVista.
        """
        self._mapper = vtkImageMapper()
        self._mapper.SetColorWindow(255)
        self._mapper.SetColorLevel(127.5)
        self._actor = vtkActor2D()
        self._actor.SetMapper(self._mapper)
        self._actor.VisibilityOff()
        renderer.AddViewProp(self._actor)

    def show(self, pixels: Bytes, *, left: int = 0, bottom: int = 0) -> None:
        """Show an image.

        Args:
            pixels: RGB colours, shape (height, width, 3).
            left: Left edge in the renderer's area [pixels].
            bottom: Bottom edge, from below [pixels].
        """
        height, width = pixels.shape[:2]
        data = pyvista.ImageData(dimensions=(width, height, 1))
        data.point_data["rgb"] = pixels[::-1].reshape(-1, 3)
        data.point_data.active_scalars_name = "rgb"
        self._mapper.SetInputData(data)
        self._actor.SetPosition(left, bottom)
        self._actor.VisibilityOn()

    def hide(self) -> None:
        """Hide the image."""
        self._actor.VisibilityOff()
