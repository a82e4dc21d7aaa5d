"""Texts and rectangles in front of a picture."""

from collections.abc import Sequence

import numpy as np
import pyvista
from vtkmodules.vtkCommonCore import VTK_FONT_FILE
from vtkmodules.vtkRenderingCore import vtkActor2D, vtkPolyDataMapper2D, vtkTextActor

from grasp3d.viewer.scene.framing import pixel_ratio
from grasp3d.viewer.scene.layout import OverlayItem, Rectangle, TextLine
from grasp3d.viewer.scene.text_layout import BOLD, PLAIN


class Overlay:
    """Texts and rectangles in front of one renderer; actors are reused."""

    def __init__(self, renderer: pyvista.Renderer) -> None:
        self._renderer = renderer
        self._text_actors: list[vtkTextActor] = []
        self._shown: tuple[list[Rectangle], list[TextLine]] = [], []
        self._mapper = vtkPolyDataMapper2D()
        self._mapper.SetColorModeToDirectScalars()
        self._rectangles = vtkActor2D()
        self._rectangles.SetMapper(self._mapper)
        self._rectangles.VisibilityOff()
        renderer.AddViewProp(self._rectangles)

    def show(self, items: Sequence[OverlayItem]) -> None:
        """Replace all texts and rectangles."""
        rectangles = [item for item in items if isinstance(item, Rectangle)]
        texts = [item for item in items if isinstance(item, TextLine)]
        if rectangles != self._shown[0]:
            self._show_rectangles(rectangles)
        if texts != self._shown[1]:
            self._show_texts(texts)
        self._shown = rectangles, texts

    def _show_texts(self, texts: Sequence[TextLine]) -> None:
        while len(self._text_actors) < len(texts):
            actor = vtkTextActor()
            actor.GetPositionCoordinate().SetCoordinateSystemToViewport()
            self._renderer.AddViewProp(actor)
            self._text_actors.append(actor)
        for number, actor in enumerate(self._text_actors):
            actor.SetVisibility(number < len(texts))
        ratio = pixel_ratio(self._renderer)
        for actor, item in zip(self._text_actors, texts, strict=False):
            _set_text(actor, item, round(item.size / ratio))
            actor.SetPosition(round(item.x), round(item.y))

    def _show_rectangles(self, rectangles: Sequence[Rectangle]) -> None:
        self._rectangles.SetVisibility(bool(rectangles))
        if not rectangles:
            return
        corners = np.empty((len(rectangles), 4, 3))
        corners[..., 2] = 0.0
        for row, one in zip(corners, rectangles, strict=True):
            row[[0, 3], 0], row[[1, 2], 0] = one.x, one.x + one.width
            row[[0, 1], 1], row[[2, 3], 1] = one.y, one.y + one.height
        count = len(rectangles)
        data = pyvista.PolyData.from_regular_faces(
            np.rint(corners).reshape(-1, 3), np.arange(4 * count).reshape(count, 4).astype(int)
        )
        colors = [pyvista.Color(one.color).int_rgb for one in rectangles]
        data.cell_data["rgb"] = np.array(colors, dtype=np.uint8)
        data.cell_data.active_scalars_name = "rgb"
        self._mapper.SetInputData(data)


def _set_text(actor: vtkTextActor, item: TextLine, size: int) -> None:
    """Set text and font of an actor; its position is the lower left corner of the letters."""
    actor.SetInput(item.text)
    look = actor.GetTextProperty()
    look.SetFontFamily(VTK_FONT_FILE)
    look.SetFontFile(str(BOLD if item.bold else PLAIN))
    look.SetFontSize(size)
    look.SetColor(*pyvista.Color(item.color).float_rgb)
    look.SetVerticalJustificationToBottom()
    look.UseTightBoundingBoxOff()
