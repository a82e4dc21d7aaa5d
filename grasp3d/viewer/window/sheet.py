"""A picture that lies flat in a window, pixel by pixel."""

from typing import Any

import pyvista
from vtkmodules.vtkRenderingCore import vtkActor2D, vtkImageMapper

from grasp3d.arrays import Bytes


class Sheet:
    """A picture in a renderer, in front of what else is there."""

    def __init__(self, renderer: Any) -> None:  # noqa: ANN401
        """Lay nothing yet.

        Args:
            renderer: Of VTK or PyVista.
        """
        self._mapper = vtkImageMapper()
        self._mapper.SetColorWindow(255)
        self._mapper.SetColorLevel(127.5)
        self._actor = vtkActor2D()
        self._actor.SetMapper(self._mapper)
        self._actor.VisibilityOff()
        renderer.AddViewProp(self._actor)

    def show(self, pixels: Bytes, *, left: int = 0, bottom: int = 0) -> None:
        """Lay a picture.

        Args:
            pixels: Red, green, blue, shape (height, width, 3).
            left: Where it begins in the renderer's area [pixels].
            bottom: Likewise, from below.
        """
        height, width = pixels.shape[:2]
        data = pyvista.ImageData(dimensions=(width, height, 1))
        data.point_data["rgb"] = pixels[::-1].reshape(-1, 3)
        data.point_data.active_scalars_name = "rgb"
        self._mapper.SetInputData(data)
        self._actor.SetPosition(left, bottom)
        self._actor.VisibilityOn()

    def hide(self) -> None:
        """Take it away."""
        self._actor.VisibilityOff()
