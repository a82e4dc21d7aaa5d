"""Positions of texts and rectangles in a picture, in pixels, and the heights that they need."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from grasp3d.arrays import Bytes
from grasp3d.viewer.scene.text_layout import middle_cut, shortened, text_width
from grasp3d.viewer.session.painting import RAMP

INK, QUIET, EDGE = "#20262D", "#5B6470", "#C3C9CF"
MIN_SIZE, MAX_SIZE = 10, 20
"""Limits of the text size [pixels at 72 per inch]."""

ACROSS, DOWN = 64, 48
"""Width and height of a picture, in text sizes, below which the text becomes smaller."""

LINE = 1.55
"""Height of a line, relative to the text size."""

BANDS = 64
"""Rectangles that draw a ramp."""

WIDEST = "100.0 %"
GAP = "   "


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
class LegendEntry:
    """Meaning of a colour."""

    color: str
    letter: str
    meaning: str
    number: str
    """Its area fraction, or empty."""

    def text(self, *, full: bool) -> str:
        """The whole entry, or only its letter and number."""
        parts = (self.letter, self.meaning, self.number) if full else (self.letter, self.number)
        return " ".join(part for part in parts if part)

    def width(self, size: int, *, full: bool) -> float:
        """Width of the entry, for the widest number [pixels]."""
        number = WIDEST if self.number else ""
        widest = LegendEntry(self.color, self.letter, self.meaning, number).text(full=full)
        return 1.5 * size + text_width(widest, size)


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


def heading(area: TextArea, title: str, caption: Sequence[str]) -> list[OverlayItem]:
    """Title and caption at the top; either may be empty, the caption is shortened to fit."""
    items: list[OverlayItem] = []
    width, large = area.width - 2.0 * area.margin, round(1.25 * area.size)
    top = area.height - 0.5 * area.margin
    if title:
        top -= 1.25 * area.line
        text = middle_cut(title, width, large, bold=True)
        items.append(TextLine(text, area.margin, top, large, bold=True))
    if caption:
        items.append(caption_at(area, caption, top - area.line))
    return items


def caption_at(area: TextArea, parts: Sequence[str], y: float) -> TextLine:
    """A caption of as many parts as fit."""
    width = area.width - 2.0 * area.margin
    count = len(parts)
    while count > 1 and text_width(GAP.join(parts[:count]), area.size) > width:
        count -= 1
    text = shortened(GAP.join(parts[:count]), width, area.size)
    return TextLine(text, area.margin, y, area.size, QUIET)


def heading_height(area: TextArea, *, title: bool, caption: bool) -> float:
    """Height of the heading [pixels]."""
    lines = 1.25 * title + 1.0 * caption
    return area.line * lines + (0.5 * area.margin if lines else 0.0)


def round_length(limit: float) -> float:
    """Largest of 1, 2 and 5 times powers of ten that does not exceed a length."""
    power = 10.0 ** math.floor(math.log10(limit))
    return next(step * power for step in (5.0, 2.0, 1.0) if step * power <= limit * (1.0 + 1e-9))


def scale_bar(area: TextArea, per_pixel: float, unit: str | None) -> list[OverlayItem]:
    """A bar of a round length at the lower right, with its length above it.

    Args:
        area: Size of the pane.
        per_pixel: Length of a pixel, in the mesh's unit.
        unit: Name of the unit; None: unknown.
    """
    length = round_length(max_bar_width(area) * per_pixel)
    width, thickness = length / per_pixel, max(2.0, round(0.15 * area.size))
    text = f"{length:g} {unit}" if unit else f"{length:g}"
    right, bottom = area.width - area.margin, 0.8 * area.margin
    left = right - width
    height = 3.0 * thickness
    return [
        Rectangle(left, bottom, width, thickness, INK),
        Rectangle(left, bottom, thickness / 2.0, height, INK),
        Rectangle(right - thickness / 2.0, bottom, thickness / 2.0, height, INK),
        TextLine(
            text, right - max(width / 2.0 + text_width(text, area.size) / 2.0,
                              text_width(text, area.size)),
            bottom + 0.6 * area.size, area.size,
        ),
    ]  # fmt: skip


def max_bar_width(area: TextArea) -> float:
    """Largest width of a scale bar [pixels]."""
    return min(7.0 * area.size, 0.5 * area.width)


@dataclass(frozen=True)
class LegendLayout:
    """Layout of a legend, which does not change with the numbers in it."""

    full: bool
    """Whether meanings are written out."""
    lines: tuple[int, ...]
    """Number of entries in each line, from the top."""
    bottom: float
    """Position of the last line [pixels]."""


def layout_legend(area: TextArea, entries: Sequence[LegendEntry]) -> LegendLayout:
    """Lay out entries beside the scale bar in at most two lines, or above it."""
    beside = area.width - 2.5 * area.margin - max_bar_width(area)
    whole = area.width - 2.0 * area.margin
    for full in (True, False):
        lines = _flowed(area, entries, beside, full=full)
        if len(lines) <= 2:
            return LegendLayout(full, lines, 0.6 * area.margin)
    lines = _flowed(area, entries, whole, full=False)
    return LegendLayout(full=False, lines=lines, bottom=0.8 * area.margin + 2.0 * area.size)


def legend_height(area: TextArea, layout: LegendLayout) -> float:
    """Height of a legend or of the scale bar, whichever is higher [pixels]."""
    lines = max(2, len(layout.lines))
    return layout.bottom + lines * area.line


def bar_height(area: TextArea) -> float:
    """Height of a scale bar [pixels]."""
    return 0.8 * area.margin + 1.9 * area.size


def legend_items(
    area: TextArea, layout: LegendLayout, entries: Sequence[LegendEntry]
) -> list[OverlayItem]:
    """Coloured squares with their meanings."""
    items: list[OverlayItem] = []
    remaining = iter(entries)
    for row, count in enumerate(layout.lines):
        y = layout.bottom + (len(layout.lines) - 1 - row) * area.line
        x = area.margin
        for _ in range(count):
            entry = next(remaining, None)
            if entry is None:
                break
            items += _square(area, entry.color, x, y)
            text = entry.text(full=layout.full)
            items.append(TextLine(text, x + 1.3 * area.size, y, area.size))
            x += entry.width(area.size, full=layout.full) + 0.9 * area.size
    return items


def ramp_items(
    area: TextArea,
    layout: LegendLayout,
    text: str,
    ends: tuple[str, str],
    grey: LegendEntry | None,
    colors: Bytes = RAMP,
) -> list[OverlayItem]:
    """A colour ramp with its name above, and the meaning of grey beside it if grey occurs."""
    begin, end = ends
    size, space = area.size, area.width - 2.0 * area.margin
    if layout.bottom < area.line:
        space -= max_bar_width(area) + area.margin
    start, y = area.margin, layout.bottom
    first, last = text_width(begin, size), text_width(end, size)
    width = min(12.0 * size, space - first - last - size)
    left = start + first + 0.5 * size
    name = shortened(_brief(text, size, space), space, size)
    items: list[OverlayItem] = [
        TextLine(name, start, y + area.line, size),
        TextLine(begin, start, y, size, QUIET),
        *_bands(left, y + 0.15 * size, width, 0.8 * size, colors),
        TextLine(end, left + width + 0.5 * size, y, size, QUIET),
    ]
    x = left + width + last + 1.8 * size
    if grey is not None and x + grey.width(size, full=True) <= start + space:
        items += _square(area, grey.color, x, y)
        items.append(TextLine(grey.text(full=True), x + 1.3 * size, y, size))
    return items


def _brief(text: str, size: int, space: float) -> str:
    """A text, or its part before the colon if there is no space for all of it."""
    return text if text_width(text, size) <= space else text.split(":", maxsplit=1)[0]


def _bands(x: float, y: float, width: float, height: float, ramp: Bytes) -> list[OverlayItem]:
    step = width / BANDS
    colors = ramp[[(2 * band + 1) * len(ramp) // (2 * BANDS) for band in range(BANDS)]]
    return [
        Rectangle(x + band * step, y, step, height, "#{:02X}{:02X}{:02X}".format(*color))
        for band, color in enumerate(colors)
    ]


def _square(area: TextArea, color: str, x: float, y: float) -> list[OverlayItem]:
    side = 0.9 * area.size
    return [Rectangle(x, y + 0.12 * area.size, side, side, color)]


def _flowed(
    area: TextArea, entries: Sequence[LegendEntry], space: float, *, full: bool
) -> tuple[int, ...]:
    """Number of entries that fit into each line, one after the other."""
    lines, x = [0], 0.0
    for entry in entries:
        width = entry.width(area.size, full=full)
        if lines[-1] and x + width > space:
            lines.append(0)
            x = 0.0
        lines[-1] += 1
        x += width + 0.9 * area.size
        if width > space:
            return (*lines, 0, 0)  # does not fit
    return tuple(lines)
