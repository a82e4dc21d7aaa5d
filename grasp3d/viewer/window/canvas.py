"""A canvas for text and simple shapes, and its image in a renderer, pixel by pixel."""

from functools import lru_cache
from typing import Any

import numpy as np
import pyvista
from PIL import Image, ImageDraw
from vtkmodules.vtkRenderingCore import vtkActor2D, vtkImageMapper

from grasp3d.arrays import Bytes
from grasp3d.viewer.scene.text_layout import SIZE, font_of

INK, QUIET, LINE = "#1F2328", "#626C77", "#D3D9E0"
MUTED, THUMB = "#9AA3AD", "#AAB3BC"
BACKGROUND, WHITE, HOVER = "#F6F7F9", "#FFFFFF", "#E3EAF2"
ACCENT, WARNING = "#1F5FA8", "#9A4A00"

OVERSAMPLING = 4
"""Factor by which rounded shapes are drawn larger and then reduced, for smooth edges."""

Box = tuple[float, float, float, float]
"""Left, top, right, bottom [pixels], downward from the upper left corner."""


class Canvas:
    """An image to draw on; all lengths are in canvas pixels, each of `scale` screen pixels."""

    def __init__(
        self, width: float, height: float, *, scale: float = 1.0, color: str = BACKGROUND
    ) -> None:
        """Make an empty canvas.

        Args:
            width: Width of the canvas.
            height: Height of the canvas.
            scale: Screen pixels per canvas pixel.
            color: Background colour.
        """
        self.scale = scale
        self._image = Image.new("RGB", (round(width * scale), round(height * scale)), color)
        self._draw = ImageDraw.Draw(self._image)

    @property
    def pixels(self) -> Bytes:
        """RGB colours, shape (height, width, 3)."""
        return np.asarray(self._image, dtype=np.uint8)

    def text(
        self, x: float, middle: float, text: str, *,
        size: float = SIZE, bold: bool = False, color: str = INK, anchor: str = "l",
    ) -> None:  # fmt: skip
        """Draw one line of text.

        Args:
            x: Horizontal position.
            middle: Vertical position of the middle of lower-case letters.
            text: The text.
            size: Text size.
            bold: Use the bold font.
            color: As #RRGGBB.
            anchor: What is at x: l: left end, m: middle, r: right end.
        """
        position = (round(x * self.scale), round((middle + 0.36 * size) * self.scale))
        font = font_of(size * self.scale, bold=bold)
        self._draw.text(position, text, fill=color, font=font, anchor=f"{anchor}s")

    def box(self, box: Box, color: str, *, radius: float = 0.0, border: str | None = None) -> None:
        """Fill a box with rounded corners, optionally with a thin border."""
        left, top, right, bottom = (round(side * self.scale) for side in box)
        if border is not None:
            self.box(box, border, radius=radius)
            border_width = round(self.scale)
            left, top = left + border_width, top + border_width
            right, bottom = right - border_width, bottom - border_width
            radius = max(0.0, radius - 1.0)
        if right <= left or bottom <= top:
            return
        mask = _rounded(right - left, bottom - top, round(radius * self.scale))
        self._image.paste(color, (left, top, right, bottom), mask)

    def strip(self, box: Box, colors: Bytes) -> None:
        """Fill a box with colours (n, 3) from left to right."""
        left, top, right, bottom = (round(side * self.scale) for side in box)
        row = Image.fromarray(colors[None])
        self._image.paste(row.resize((right - left, bottom - top)), (left, top))


@lru_cache(maxsize=512)
def _rounded(width: int, height: int, radius: int) -> Image.Image:
    """Mask of a box with rounded corners and smooth edges."""
    large = Image.new("L", (OVERSAMPLING * width, OVERSAMPLING * height), 0)
    corner = (OVERSAMPLING * width - 1, OVERSAMPLING * height - 1)
    ImageDraw.Draw(large).rounded_rectangle(((0, 0), corner), OVERSAMPLING * radius, fill=255)
    return large.reduce(OVERSAMPLING)


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
