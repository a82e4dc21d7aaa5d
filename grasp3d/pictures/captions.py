"""Texts of a picture: title, settings, legend of the colours, scale bar, numbers of contacts."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import pyvista
from matplotlib import get_data_path
from vtkmodules.vtkCommonCore import VTK_FONT_FILE
from vtkmodules.vtkRenderingAnnotation import vtkAxisActor2D

from grasp3d.arrays import Floats
from grasp3d.pictures.camera import FreeArea, pixel_ratio
from grasp3d.pictures.colors import HEX_PALETTE, Ramp
from grasp3d.settings.units import small_length
from grasp3d.system.names import printable

FONTS = Path(get_data_path(), "fonts", "ttf")
PLAIN, BOLD = str(FONTS / "DejaVuSans.ttf"), str(FONTS / "DejaVuSans-Bold.ttf")
"""Fonts with Greek letters."""

INK, QUIET = "#20262D", "#5B6470"
MIN_SIZE, MAX_SIZE = 10, 20
"""Limits of the text size [pixels at 72 per inch]."""

ACROSS, DOWN = 64, 48
"""Width and height of a picture, in text sizes, below which its texts become smaller."""

LINE = 1.5
"""Height of a line of text, in text sizes."""

NARROW = 0.62
"""Average width of a letter, in text sizes."""

BAR = 0.4
"""Largest width of the scale bar, as a fraction of the picture's width."""


@dataclass(frozen=True)
class LegendEntry:
    """A colour and its meaning."""

    color: str
    text: str


@dataclass(frozen=True, eq=False)
class Captions:
    """Texts of a picture."""

    title: str = ""
    settings: str = ""
    """Line below the title."""
    legend: Sequence[LegendEntry] = ()
    """Colours and their meanings, one line each."""
    ramp: Ramp | None = None
    """Legend of a quantity; None: the colours have the meanings in `legend`."""
    placeholder: str = ""
    """Sentence in the middle of a picture without an object."""
    metres: bool | None = None
    """Whether lengths are in metres, or in an unknown unit; None: there is no scale bar."""
    contacts: Floats = field(default_factory=lambda: np.empty((0, 3)))
    """Positions of the numbers of contacts, shape (n, 3)."""

    def free_area(self, width: float, height: float, size: float) -> FreeArea:
        """Return the part of a picture that texts of a given size leave free [pixels]."""
        line = LINE * size
        top = 1.3 * line * bool(self.title) + line * bool(self.settings)
        below = max(len(self.legend), 2)
        if self.ramp is not None:
            below = max(below, 4 if self.ramp.grey else 3)
        return FreeArea(width, height, top + 0.5 * size, (below + 0.7) * line, 0.9 * size)


class Texts:
    """The captions of one renderer.

    Args:
        plotter: The plotter of the renderer.
    """

    def __init__(self, plotter: pyvista.Plotter) -> None:
        self._plotter, self._renderer = plotter, plotter.renderers[0]
        self._shown: dict[str, object] = {}
        self._actors: list[Any] = []
        self._scale = vtkAxisActor2D()
        for coordinate in (self._scale.GetPoint1Coordinate(), self._scale.GetPoint2Coordinate()):
            coordinate.SetCoordinateSystemToNormalizedViewport()
        self._scale.LabelVisibilityOff()
        self._scale.SetNumberOfLabels(2)
        self._scale.AdjustLabelsOff()
        self._scale.UseFontSizeFromPropertyOn()
        self._scale.GetProperty().SetColor(pyvista.Color(INK).float_rgb)
        self._renderer.AddViewProp(self._scale)

    @property
    def size(self) -> float:
        """Size of the texts [pixels]."""
        width, height = self._renderer.GetSize()
        unit = pixel_ratio(self._renderer)
        fits = min(width / unit / ACROSS, height / unit / DOWN)
        return float(unit * min(MAX_SIZE, max(MIN_SIZE, fits)))

    def free_area(self, captions: Captions) -> FreeArea:
        """Return the part of the renderer that texts leave free."""
        width, height = self._renderer.GetSize()
        return captions.free_area(width, height, self.size)

    def show(self, captions: Captions, per_pixel: float) -> None:
        """Draw the texts that have changed.

        Args:
            captions: The texts.
            per_pixel: Length of a pixel in the scene, for the scale bar.
        """
        contacts, window = captions.contacts.tobytes(), tuple(self._renderer.GetSize())
        key = vars(captions) | {"contacts": contacts, "window": window}
        if self._shown != key:
            self._shown = key
            self._write(captions)
        self._draw_scale(captions, per_pixel)

    def _write(self, captions: Captions) -> None:
        width, height = self._renderer.GetSize()
        size, line = self.size, LINE * self.size
        for actor in self._actors:
            self._renderer.remove_actor(actor, render=False)
        self._actors.clear()
        left, y = 0.9 * size, height - 0.4 * size
        if captions.title:
            y -= 1.3 * line
            self._text(captions.title, left, y, 1.25 * size, width, font=BOLD)
        if captions.settings:
            self._text(captions.settings, left, y - line, size, width, color=QUIET)
        if captions.placeholder:
            across = 0.5 * (width - NARROW * size * len(captions.placeholder))
            self._text(
                captions.placeholder, max(left, across), 0.5 * height, size, width, color=QUIET
            )
        legend = captions.legend if captions.ramp is None else ()
        y = 0.5 * size + (len(legend) - 1) * line
        for entry in legend:
            self._text("■", left, y, size, width, color=entry.color)
            self._text(entry.text, left + 1.3 * size, y, size, (1.0 - BAR) * width)
            y -= line
        self._show_ramp(captions.ramp, size)
        self._renderer.remove_actor("contact numbers", render=False)
        if len(captions.contacts):
            self._plotter.add_point_labels(
                captions.contacts, [f"{n}" for n in range(1, len(captions.contacts) + 1)],
                font_file=BOLD, font_size=round(size / pixel_ratio(self._renderer)),
                text_color=INK, shape="rounded_rect", shape_color="white", shape_opacity=1.0,
                show_points=False, always_visible=True, reset_camera=False, render=False,
                name="contact numbers",
            )  # fmt: skip

    def _text(
        self, text: str, x: float, y: float, size: float, space: float, *,
        color: str = INK, font: str = PLAIN,
    ) -> None:  # fmt: skip
        """Draw a line of text at a position [pixels], shortened in the middle or at the end."""
        most = int((space - x) / (NARROW * size))
        if len(text) > most > 1:
            last = 0 if color == QUIET else most // 2
            text = f"{text[: most - 1 - last]}…{text[len(text) - last :]}"
        plain = printable(text).replace("$", r"\$")  # VTK would interpret formulas
        actor = pyvista.Text(plain, position=(round(x), round(y)))
        _set_font(actor.prop, color, round(size / pixel_ratio(self._renderer)), font)
        self._plotter.add_actor(actor, reset_camera=False, render=False, pickable=False)
        self._actors.append(actor)

    def _show_ramp(self, ramp: Ramp | None, size: float) -> None:
        self._plotter.scalar_bars.clear()
        if ramp is None:
            return
        width, height = self._renderer.GetSize()
        line = LINE * size
        left, y, space = 0.9 * size, 0.5 * size, (1.0 - BAR) * width
        if ramp.grey:
            self._text("■", left, y, size, width, color=HEX_PALETTE[-1])
            self._text(ramp.grey, left + 1.3 * size, y, size, space)
            y += line
        self._text(f"{ramp.start} to {ramp.end}", left, y, size, space, color=QUIET)
        self._text(ramp.text, left, y + 2.0 * line, size, space)
        mapper = pyvista.DataSetMapper()
        mapper.lookup_table = pyvista.LookupTable(values=np.insert(ramp.colors, 3, 255, axis=1))
        mapper.scalar_range = ramp.minimum, ramp.maximum
        bar = self._plotter.add_scalar_bar(  # type: ignore[call-arg]
            title=" ", mapper=mapper, n_labels=0, vertical=False, render=False,
            position_x=left / width, position_y=(y + line - 0.1 * size) / height,
            width=min(16.0 * size / width, 0.5), height=1.2 * size / height,
        )  # fmt: skip
        self._actors.append(bar)

    def _draw_scale(self, captions: Captions, per_pixel: float) -> None:
        """Draw a bar of a round length at the lower right, with its length above it."""
        known = captions.metres is not None and 0.0 < per_pixel < math.inf
        self._scale.SetVisibility(known)
        if not known:
            return
        width, height = self._renderer.GetSize()
        size = self.size
        length = round_length(min(7.0 * size, 0.5 * BAR * width) * per_pixel)
        right, y = 1.0 - 0.9 * size / width, 2.2 * size / height
        self._scale.GetPoint1Coordinate().SetValue(right, y)
        self._scale.GetPoint2Coordinate().SetValue(right - length / per_pixel / width, y)
        points = round(size / pixel_ratio(self._renderer))
        _set_font(self._scale.GetTitleTextProperty(), INK, points)
        self._scale.GetProperty().SetLineWidth(pixel_ratio(self._renderer))
        self._scale.SetTitle(small_length(length, metres=bool(captions.metres)))


def _set_font(look: Any, color: str, size: int, font: str = PLAIN) -> None:
    """Set the font of a text property of VTK."""
    look.SetFontFamily(VTK_FONT_FILE)
    look.SetFontFile(font)
    look.SetFontSize(size)
    look.SetColor(*pyvista.Color(color).float_rgb)
    look.ShadowOff()
    look.ItalicOff()


def round_length(limit: float) -> float:
    """Largest length up to a limit that is 1, 2 or 5 times a power of ten."""
    power = 10.0 ** math.floor(math.log10(limit))
    return next(step * power for step in (5.0, 2.0, 1.0) if step * power <= limit * (1.0 + 1e-9))
