"""Where words and colours stand in a picture, in pixels; what room they leave for the object."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from grasp3d.viewer.scene.lettering import middle_cut, shortened, width_of
from grasp3d.viewer.session.painting import RAMP

INK, QUIET, EDGE = "#20262D", "#5B6470", "#C3C9CF"
LEAST, MOST = 10, 20
"""Sizes of letters [pixels at 72 per inch]."""

ACROSS, DOWN = 64, 48
"""Letters that fit across a picture and above one another before they shrink."""

LINE = 1.55
"""Height of a line, in letters."""

BANDS = 64
"""Colours of a ramp that are drawn apart."""

WIDEST = "100.0 %"
GAP = "   "


@dataclass(frozen=True)
class Words:
    """A line of words."""

    text: str
    x: float
    """Left end, from the left of the pane [pixels]."""
    y: float
    """Foot of the line, from below."""
    size: int
    color: str = INK
    bold: bool = False


@dataclass(frozen=True)
class Patch:
    """A rectangle of one colour."""

    x: float
    y: float
    width: float
    height: float
    color: str


Item = Words | Patch


@dataclass(frozen=True)
class Entry:
    """What a colour means."""

    color: str
    letter: str
    words: str
    number: str
    """Its share, or nothing."""

    def text(self, *, full: bool) -> str:
        """All of it, or letter and number alone."""
        parts = (self.letter, self.words, self.number) if full else (self.letter, self.number)
        return " ".join(part for part in parts if part)

    def room(self, size: int, *, full: bool) -> float:
        """Width that it takes, whatever its number is [pixels]."""
        number = WIDEST if self.number else ""
        widest = Entry(self.color, self.letter, self.words, number).text(full=full)
        return 1.5 * size + width_of(widest, size)


@dataclass(frozen=True)
class Paper:
    """A pane to write on."""

    width: float
    """[pixels]"""
    height: float
    size: int
    """Of the letters [pixels]."""

    @property
    def margin(self) -> float:
        """Kept free at the sides [pixels]."""
        return 0.9 * self.size

    @property
    def line(self) -> float:
        """Height of a line [pixels]."""
        return LINE * self.size


def letter_size(width: float, height: float, unit: float) -> int:
    """Size of letters in a picture of so many pixels, where a point is `unit` of them [pixels]."""
    fits = min(width / unit / ACROSS, height / unit / DOWN)
    return round(unit * min(MOST, max(LEAST, fits)))


def heading(paper: Paper, title: str, caption: Sequence[str]) -> list[Item]:
    """Title and caption at the top, either may be empty; the caption's last parts fall away."""
    items: list[Item] = []
    room, big = paper.width - 2.0 * paper.margin, round(1.25 * paper.size)
    top = paper.height - 0.5 * paper.margin
    if title:
        top -= 1.25 * paper.line
        text = middle_cut(title, big, room, bold=True)
        items.append(Words(text, paper.margin, top, big, bold=True))
    if caption:
        items.append(caption_at(paper, caption, top - paper.line))
    return items


def caption_at(paper: Paper, parts: Sequence[str], y: float) -> Words:
    """As many parts of a caption as there is room for."""
    room = paper.width - 2.0 * paper.margin
    count = len(parts)
    while count > 1 and width_of(GAP.join(parts[:count]), paper.size) > room:
        count -= 1
    text = shortened(GAP.join(parts[:count]), paper.size, room)
    return Words(text, paper.margin, y, paper.size, QUIET)


def heading_height(paper: Paper, *, title: bool, caption: bool) -> float:
    """What the heading takes at the top [pixels]."""
    lines = 1.25 * title + 1.0 * caption
    return paper.line * lines + (0.5 * paper.margin if lines else 0.0)


def round_length(most: float) -> float:
    """Largest of 1, 2, 5, 10, ... times a power of ten that is not above a length."""
    power = 10.0 ** math.floor(math.log10(most))
    return next(step * power for step in (5.0, 2.0, 1.0) if step * power <= most * (1.0 + 1e-9))


def scale_bar(paper: Paper, per_pixel: float, unit: str | None) -> list[Item]:
    """A bar of a round length at the lower right, with its length above it.

    Args:
        paper: Where.
        per_pixel: Length of a pixel, in the mesh's unit.
        unit: Its name; None: not known.
    """
    length = round_length(bar_room(paper) * per_pixel)
    wide, thick = length / per_pixel, max(2.0, round(0.15 * paper.size))
    text = f"{length:g} {unit}" if unit else f"{length:g}"
    right, foot = paper.width - paper.margin, 0.8 * paper.margin
    left = right - wide
    tall = 3.0 * thick
    return [
        Patch(left, foot, wide, thick, INK),
        Patch(left, foot, thick / 2.0, tall, INK),
        Patch(right - thick / 2.0, foot, thick / 2.0, tall, INK),
        Words(
            text, right - max(wide / 2.0 + width_of(text, paper.size) / 2.0,
                              width_of(text, paper.size)),
            foot + 0.6 * paper.size, paper.size,
        ),
    ]  # fmt: skip


def bar_room(paper: Paper) -> float:
    """Longest that a scale bar may be [pixels]."""
    return min(7.0 * paper.size, 0.5 * paper.width)


@dataclass(frozen=True)
class Legend:
    """How the entries of a legend are laid out: once for all shares that they may have."""

    full: bool
    lines: tuple[int, ...]
    """How many entries stand in each line, from the top."""
    foot: float
    """Where the last line stands [pixels]."""


def legend_of(paper: Paper, entries: Sequence[Entry]) -> Legend:
    """Lay out entries beside the scale bar in at most two lines, or above it."""
    beside = paper.width - 2.5 * paper.margin - bar_room(paper)
    whole = paper.width - 2.0 * paper.margin
    for full in (True, False):
        lines = _flowed(paper, entries, beside, full=full)
        if len(lines) <= 2:
            return Legend(full, lines, 0.6 * paper.margin)
    lines = _flowed(paper, entries, whole, full=False)
    return Legend(full=False, lines=lines, foot=0.8 * paper.margin + 2.0 * paper.size)


def legend_height(paper: Paper, legend: Legend) -> float:
    """What a legend takes at the foot, or the scale bar if that is more [pixels]."""
    lines = max(2, len(legend.lines))
    return legend.foot + lines * paper.line


def bar_height(paper: Paper) -> float:
    """What a scale bar alone takes at the foot [pixels]."""
    return 0.8 * paper.margin + 1.9 * paper.size


def legend(paper: Paper, laid: Legend, entries: Sequence[Entry]) -> list[Item]:
    """Squares of colour with their meanings."""
    items: list[Item] = []
    left = iter(entries)
    for row, count in enumerate(laid.lines):
        y = laid.foot + (len(laid.lines) - 1 - row) * paper.line
        x = paper.margin
        for _ in range(count):
            entry = next(left, None)
            if entry is None:
                break
            items += _square(paper, entry.color, x, y)
            text = entry.text(full=laid.full)
            items.append(Words(text, x + 1.3 * paper.size, y, paper.size))
            x += entry.room(paper.size, full=laid.full) + 0.9 * paper.size
    return items


def ramp_bar(
    paper: Paper, laid: Legend, words: str, ends: tuple[str, str], grey: Entry | None
) -> list[Item]:
    """A ramp of colours with its words above, and grey beside it where that occurs."""
    begin, end = ends
    size, room = paper.size, paper.width - 2.0 * paper.margin
    if laid.foot < paper.line:
        room -= bar_room(paper) + paper.margin
    start, y = paper.margin, laid.foot
    first, last = width_of(begin, size), width_of(end, size)
    wide = min(12.0 * size, room - first - last - size)
    left = start + first + 0.5 * size
    items: list[Item] = [
        Words(shortened(_brief(words, size, room), size, room), start, y + paper.line, size),
        Words(begin, start, y, size, QUIET),
        *_bands(left, y + 0.15 * size, wide, 0.8 * size),
        Words(end, left + wide + 0.5 * size, y, size, QUIET),
    ]
    x = left + wide + last + 1.8 * size
    if grey is not None and x + grey.room(size, full=True) <= start + room:
        items += _square(paper, grey.color, x, y)
        items.append(Words(grey.text(full=True), x + 1.3 * size, y, size))
    return items


def _brief(words: str, size: int, room: float) -> str:
    """Words, or what stands before their colon where there is no room for more."""
    return words if width_of(words, size) <= room else words.split(":", maxsplit=1)[0]


def _bands(x: float, y: float, width: float, height: float) -> list[Item]:
    step = width / BANDS
    picked = RAMP[[(2 * band + 1) * len(RAMP) // (2 * BANDS) for band in range(BANDS)]]
    return [
        Patch(x + band * step, y, step, height, "#{:02X}{:02X}{:02X}".format(*color))
        for band, color in enumerate(picked)
    ]


def _square(paper: Paper, color: str, x: float, y: float) -> list[Item]:
    side = 0.9 * paper.size
    return [Patch(x, y + 0.12 * paper.size, side, side, color)]


def _flowed(paper: Paper, entries: Sequence[Entry], room: float, *, full: bool) -> tuple[int, ...]:
    """How many entries fit into each line, one after the other."""
    lines, x = [0], 0.0
    for entry in entries:
        wide = entry.room(paper.size, full=full)
        if lines[-1] and x + wide > room:
            lines.append(0)
            x = 0.0
        lines[-1] += 1
        x += wide + 0.9 * paper.size
        if wide > room:
            return (*lines, 0, 0)  # does not fit
    return tuple(lines)
