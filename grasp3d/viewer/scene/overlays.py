"""Texts and rectangles in front of a picture: fonts, widths, line breaks, and their actors."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache
from pathlib import Path

import numpy as np
import pyvista
from matplotlib import get_data_path
from PIL import ImageFont
from vtkmodules.vtkCommonCore import VTK_FONT_FILE
from vtkmodules.vtkRenderingCore import vtkActor2D, vtkPolyDataMapper2D, vtkTextActor

from grasp3d.arrays import Floats
from grasp3d.viewer.scene.framing import pixel_ratio

FONTS = Path(get_data_path(), "fonts", "ttf")
PLAIN, BOLD = FONTS / "DejaVuSans.ttf", FONTS / "DejaVuSans-Bold.ttf"
"""Fonts with Greek letters."""

INK, QUIET, WHITE = "#20262D", "#5B6470", "#FFFFFF"
MIN_SIZE, MAX_SIZE = 10, 20
"""Limits of the text size [pixels at 72 per inch]."""

ACROSS, DOWN = 64, 48
"""Width and height of a picture, in text sizes, below which the text becomes smaller."""

LINE, PARAGRAPH_LINE = 1.55, 1.42
"""Heights of a single line, and of one of a paragraph, relative to the text size."""

ELLIPSIS = "…"

NUMBER_DISTANCE = 1.15
"""Distance of a contact's number from its marker, relative to the text size."""

Box = tuple[float, float, float, float]
"""Left, bottom, right, top [pixels]."""


@dataclass(frozen=True)
class TextLine:
    """A line of text."""

    text: str
    x: float
    """Left end, from the left of the pane [pixels]."""
    y: float
    """Bottom of the line, from the bottom of the pane [pixels]."""
    size: int
    color: str = INK
    bold: bool = False


@dataclass(frozen=True)
class Rectangle:
    """A rectangle of one colour."""

    x: float
    y: float
    width: float
    height: float
    color: str


OverlayItem = TextLine | Rectangle


@dataclass(frozen=True)
class TextArea:
    """Size of a pane and of its text."""

    width: float
    """[pixels]"""
    height: float
    """[pixels]"""
    size: int
    """Text size [pixels]."""

    @property
    def margin(self) -> float:
        """Margin at the sides [pixels]."""
        return 0.9 * self.size

    @property
    def line(self) -> float:
        """Height of a line [pixels]."""
        return LINE * self.size


def text_size(width: float, height: float, unit: float) -> int:
    """Text size in a picture of a width and height, with `unit` pixels per point [pixels]."""
    fits = min(width / unit / ACROSS, height / unit / DOWN)
    return round(unit * min(MAX_SIZE, max(MIN_SIZE, fits)))


@cache
def font_of(size: float, *, bold: bool = False) -> ImageFont.FreeTypeFont:
    """The font at a size [pixels]."""
    return ImageFont.truetype(str(BOLD if bold else PLAIN), size)


@lru_cache(maxsize=8192)
def text_width(text: str, size: float, *, bold: bool = False) -> float:
    """Width of a line of text [pixels].

    Args:
        text: One line.
        size: Text size [pixels].
        bold: Use the bold font.
    """
    return float(font_of(size, bold=bold).getlength(text))


def shortened(
    text: str, width: float, size: float, *, bold: bool = False, end: float = 0.0
) -> str:  # fmt: skip
    """Replace a part of a line that is wider than a width [pixels] by an ellipsis.

    Args:
        text: The line.
        width: The width.
        size: Text size [pixels].
        bold: Whether the font is bold.
        end: Part of what is left that is the end of the line, from 0 to 1.
    """
    count, short = len(text), text
    while count > 0 and text_width(short, size, bold=bold) > width:
        count -= 1
        last = int(count * end)
        short = text[: count - last].rstrip() + ELLIPSIS + text[len(text) - last :].lstrip()
    return short if text_width(short, size, bold=bold) <= width else ""


@lru_cache(maxsize=512)
def wrapped(text: str, width: float, size: float) -> tuple[str, ...]:
    """Break a text into lines; words that are too long are broken as well.

    Args:
        text: The text.
        width: Largest width of a line [pixels].
        size: Text size [pixels].
    """
    lines, line = [], ""
    for word in text.split():
        longer = f"{line} {word}" if line else word
        if text_width(longer, size) <= width:
            line = longer
            continue
        if line:
            lines.append(line)
        *full, line = _pieces(word, width, size)
        lines.extend(full)
    lines.append(line)
    return tuple(lines)


def _pieces(word: str, width: float, size: float) -> list[str]:
    """Break a word into pieces of a largest width [pixels]."""
    pieces = [""]
    for letter in word:
        if pieces[-1] and text_width(pieces[-1] + letter, size) > width:
            pieces.append("")
        pieces[-1] += letter
    return pieces


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


def display_positions(renderer: pyvista.Renderer, points: Floats) -> Floats:
    """Positions of points (n, 3) in a renderer's part of the window, shape (n, 2) [pixels]."""
    left, bottom = renderer.GetOrigin()
    positions = []
    for point in points:
        renderer.SetWorldPoint(*point, 1.0)
        renderer.WorldToDisplay()
        x, y, _ = renderer.GetDisplayPoint()
        positions.append((x - left, y - bottom))
    return np.array(positions).reshape(-1, 2)


def contact_numbers(
    area: TextArea, contacts: Floats, tips: Floats, radius: float
) -> list[OverlayItem]:
    """Number contacts from 1, each beside its contact where nothing of the grasp is drawn.

    Args:
        area: Size of the pane.
        contacts: Displayed positions of the contacts, shape (n, 2) [pixels].
        tips: Displayed positions of points further along their normals, (n, 2).
        radius: Radius of the contact markers [pixels].
    """
    items: list[OverlayItem] = []
    boxes: list[Box] = []
    for number, (contact, tip) in enumerate(zip(contacts, tips, strict=True), start=1):
        box = _box(area, f"{number}", contact, tip - contact, radius, boxes)
        boxes.append(box)
        items += _badge(area, f"{number}", box)
    return items


def _box(
    area: TextArea, text: str, contact: Floats, normal: Floats, radius: float, others: Sequence[Box]
) -> Box:
    """Box of a number: beside the normal if there is space, else on another side."""
    length = float(np.linalg.norm(normal))
    ahead = normal / length if length > 0.5 * radius else np.array([1.0, 0.0])
    side = np.array([-ahead[1], ahead[0]])
    side = side if side[1] >= 0.0 else -side
    height = 1.35 * area.size
    width = max(height, text_width(text, area.size, bold=True) + 0.7 * area.size)
    distance = radius + NUMBER_DISTANCE * area.size
    boxes = []
    for offset in (side, -side, side + ahead, side - ahead, ahead - side, -side - ahead):
        x, y = contact + distance * offset
        boxes.append((x - 0.5 * width, y - 0.5 * height, x + 0.5 * width, y + 0.5 * height))
    return next((box for box in boxes if _free(area, box, others)), boxes[0])


def _free(area: TextArea, box: Box, others: Sequence[Box]) -> bool:
    left, bottom, right, top = box
    if left < 0.0 or bottom < 0.0 or right > area.width or top > area.height:
        return False
    return all(right < one[0] or one[2] < left or top < one[1] or one[3] < bottom for one in others)


def _badge(area: TextArea, text: str, box: Box) -> list[OverlayItem]:
    """A number on a white background with a dark border, readable on every colour."""
    left, bottom, right, top = (round(side) for side in box)
    edge = max(1, round(area.size / 12.0))
    width, height = right - left, top - bottom
    x = 0.5 * (left + right - text_width(text, area.size, bold=True))
    y = bottom + 0.08 * area.size
    return [
        Rectangle(left - edge, bottom - edge, width + 2 * edge, height + 2 * edge, INK),
        Rectangle(left, bottom, width, height, WHITE),
        TextLine(text, x, y, area.size, bold=True),
    ]
