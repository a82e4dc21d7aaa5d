"""Words and patches of colour that lie flat before a picture."""

from collections.abc import Sequence

import numpy as np
import pyvista
from vtkmodules.vtkRenderingCore import vtkActor2D, vtkPolyDataMapper2D, vtkTextActor

from grasp3d.viewer.scene.framing import dots
from grasp3d.viewer.scene.layout import Item, Patch, Words
from grasp3d.viewer.scene.lettering import lettered


class Overlay:
    """What lies before one renderer; actors are used again."""

    def __init__(self, renderer: pyvista.Renderer) -> None:
        self._renderer = renderer
        self._lines: list[vtkTextActor] = []
        self._shown: tuple[list[Patch], list[Words]] = [], []
        self._mapper = vtkPolyDataMapper2D()
        self._mapper.SetColorModeToDirectScalars()
        self._patches = vtkActor2D()
        self._patches.SetMapper(self._mapper)
        self._patches.VisibilityOff()
        renderer.AddViewProp(self._patches)

    def show(self, items: Sequence[Item]) -> None:
        """Show these in place of what was there."""
        patches = [item for item in items if isinstance(item, Patch)]
        words = [item for item in items if isinstance(item, Words)]
        if patches != self._shown[0]:
            self._show_patches(patches)
        if words != self._shown[1]:
            self._show_words(words)
        self._shown = patches, words

    def _show_words(self, words: Sequence[Words]) -> None:
        while len(self._lines) < len(words):
            actor = vtkTextActor()
            actor.GetPositionCoordinate().SetCoordinateSystemToViewport()
            self._renderer.AddViewProp(actor)
            self._lines.append(actor)
        for number, actor in enumerate(self._lines):
            actor.SetVisibility(number < len(words))
        unit = dots(self._renderer)
        for actor, item in zip(self._lines, words, strict=False):
            color = pyvista.Color(item.color).float_rgb
            lettered(actor, item.text, round(item.size / unit), color, bold=item.bold)
            actor.SetPosition(round(item.x), round(item.y))

    def _show_patches(self, patches: Sequence[Patch]) -> None:
        self._patches.SetVisibility(bool(patches))
        if not patches:
            return
        corners = np.empty((len(patches), 4, 3))
        corners[..., 2] = 0.0
        for row, patch in zip(corners, patches, strict=True):
            row[[0, 3], 0], row[[1, 2], 0] = patch.x, patch.x + patch.width
            row[[0, 1], 1], row[[2, 3], 1] = patch.y, patch.y + patch.height
        count = len(patches)
        data = pyvista.PolyData.from_regular_faces(
            np.rint(corners).reshape(-1, 3), np.arange(4 * count).reshape(count, 4).astype(int)
        )
        colors = [pyvista.Color(patch.color).int_rgb for patch in patches]
        data.cell_data["rgb"] = np.array(colors, dtype=np.uint8)
        data.cell_data.active_scalars_name = "rgb"
        self._mapper.SetInputData(data)
