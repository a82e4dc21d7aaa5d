"""Captions of a picture: title, settings, legend of the colours, scale bar."""

import math
from collections.abc import Sequence
from dataclasses import dataclass

from grasp3d.arrays import Bytes
from grasp3d.grasps.explanations import UNSEARCHED, finger_words
from grasp3d.settings.model_text import friction_text, location_texts
from grasp3d.settings.units import small_length
from grasp3d.stability.label import MEANING, Label, Mode
from grasp3d.viewer.scene.overlays import (
    INK,
    QUIET,
    OverlayItem,
    Rectangle,
    TextArea,
    TextLine,
    shortened,
    text_width,
    wrapped,
)
from grasp3d.viewer.session.painting import HEX_PALETTE, Ramp
from grasp3d.viewer.session.panel_text import EVERYTHING, LabelFraction, PanelText, panel_text
from grasp3d.viewer.session.session import Session
from grasp3d.viewer.subjects.subject import Subject

GREY = HEX_PALETTE[UNSEARCHED]

BANDS = 64
"""Rectangles that draw a ramp."""

GAP = "   "


@dataclass(frozen=True)
class LegendLayout:
    """Layout of a legend, which does not change with the numbers in it."""

    full: bool
    """Whether meanings are written out."""
    lines: tuple[int, ...]
    """Number of entries in each line, from the top."""
    bottom: float
    """Position of the last line [pixels]."""


@dataclass(frozen=True, eq=False)
class Captions:
    """Texts of a picture."""

    placeholder: str = ""
    """Sentence in the middle if there is no object; empty if there is one."""
    title: str = ""
    caption: tuple[str, ...] = ()
    """Settings, in parts."""
    text: PanelText | None = None
    """Text for the legend; None: no legend."""
    mode: Mode = "label"
    unit: str | None = None

    @classmethod
    def of(cls, session: Session, *, legend: bool) -> "Captions":
        """Captions for the current state of a session.

        Args:
            session: The session.
            legend: Whether to add title, legend and all settings, as needed without a panel.
        """
        subject = session.subject
        if subject is None:
            return cls(placeholder=_placeholder(session))
        text = panel_text(session) if legend else None
        return cls(
            title=text.title if text else "",
            caption=_caption(session, subject) if legend else (),
            text=text,
            mode=subject.labels.mode,
            unit=subject.mesh.unit,
        )

    def margins(self, area: TextArea) -> tuple[float, float]:
        """Heights of the texts above and below the object [pixels]."""
        above = heading_height(area, title=bool(self.title), caption=bool(self.caption))
        below = bar_height(area)
        if self.text is not None:
            below = max(below, legend_height(area, self._layout(area)))
        return above + 0.3 * area.size, below + 0.7 * area.size

    def items(self, area: TextArea, per_pixel: float) -> list[OverlayItem]:
        """All texts and rectangles.

        Args:
            area: Size of the picture.
            per_pixel: Length of a pixel, for the scale bar.
        """
        if self.placeholder:
            return _centred(area, self.placeholder)
        items = heading(area, self.title, self.caption)
        if 0.0 < per_pixel < math.inf:
            items += scale_bar(area, per_pixel, self.unit)
        if self.text is not None:
            layout, ramp = self._layout(area), self.text.ramp
            items += (
                legend_items(area, layout, self.text.fractions)
                if ramp is None
                else ramp_items(area, layout, ramp)
            )
        return items

    def _layout(self, area: TextArea) -> LegendLayout:
        """Layout of the label legend, which also determines the height of a ramp's legend."""
        meaning = MEANING[self.mode]
        entries = [LabelFraction(label.name, meaning[label], GREY, 0.0) for label in Label]
        if self.text is not None and len(self.text.fractions) > len(entries):
            entries.append(self.text.fractions[-1])
        return layout_legend(area, entries)


def _placeholder(session: Session) -> str:
    """Text in place of an object that is not displayed."""
    working = session.working
    if working is not None:
        return f"{working[0]} …"
    return session.message or f"{session.name} cannot be shown"


def _caption(session: Session, subject: Subject) -> tuple[str, ...]:
    model = session.model
    resolution = f"α {round(math.degrees(model.sensor_resolution), 2):g}°"
    metres = subject.mesh.unit is not None
    limit, scene = session.state.max_opening, session.scene
    locations = location_texts(model, metres=metres)
    parts = [resolution, f"μ {friction_text(model)}", *locations]
    if subject.poses is not None:
        return (*parts, subject.poses.hand.name)
    parts.append(finger_words(model.fingers))
    if subject.labels.mode != "scan" and math.isfinite(limit):  # the search had a limit
        parts.append(f"opening ≤ {subject.mesh.length_text(limit)}")
    return (*parts, *([] if scene is None else [f"gripper {scene.hand.name}"]))


def _centred(area: TextArea, sentence: str) -> list[OverlayItem]:
    """A sentence in the middle, broken into lines."""
    lines = wrapped(sentence, area.width - 2.0 * area.margin, area.size)
    top = 0.5 * (area.height + len(lines) * area.line)
    return [
        TextLine(
            line,
            0.5 * (area.width - text_width(line, area.size)),
            top - (row + 1) * area.line,
            area.size,
            QUIET,
        )
        for row, line in enumerate(lines)
    ]


def heading(area: TextArea, title: str, caption: Sequence[str]) -> list[OverlayItem]:
    """Title and caption at the top; either may be empty, the caption is shortened to fit."""
    items: list[OverlayItem] = []
    width, large = area.width - 2.0 * area.margin, round(1.25 * area.size)
    top = area.height - 0.5 * area.margin
    if title:
        top -= 1.25 * area.line
        text = shortened(title, width, large, bold=True, end=0.5)
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
        per_pixel: Length of a pixel.
        unit: Its unit: m; None: unknown.
    """
    length = round_length(max_bar_width(area) * per_pixel)
    width, thickness = length / per_pixel, max(2.0, round(0.15 * area.size))
    text = small_length(length, metres=unit is not None)
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


def layout_legend(area: TextArea, entries: Sequence[LabelFraction]) -> LegendLayout:
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
    area: TextArea, layout: LegendLayout, entries: Sequence[LabelFraction]
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
            text = _entry_text(entry, entry.percent, full=layout.full)
            items.append(TextLine(text, x + 1.3 * area.size, y, area.size))
            x += _entry_width(entry, area.size, full=layout.full) + 0.9 * area.size
    return items


def ramp_items(area: TextArea, layout: LegendLayout, ramp: Ramp) -> list[OverlayItem]:
    """A colour ramp with its name above, and the meaning of grey beside it if grey occurs."""
    size, space = area.size, area.width - 2.0 * area.margin
    if layout.bottom < area.line:
        space -= max_bar_width(area) + area.margin
    start, y = area.margin, layout.bottom
    first, last = text_width(ramp.start, size), text_width(ramp.end, size)
    width = min(12.0 * size, space - first - last - size)
    left = start + first + 0.5 * size
    name = shortened(_brief(ramp.text, size, space), space, size)
    items: list[OverlayItem] = [
        TextLine(name, start, y + area.line, size),
        TextLine(ramp.start, start, y, size, QUIET),
        *_bands(left, y + 0.15 * size, width, 0.8 * size, ramp.colors),
        TextLine(ramp.end, left + width + 0.5 * size, y, size, QUIET),
    ]
    x = left + width + last + 1.8 * size
    if ramp.grey and x + 1.5 * size + text_width(ramp.grey, size) <= start + space:
        items += _square(area, GREY, x, y)
        items.append(TextLine(ramp.grey, x + 1.3 * size, y, size))
    return items


def _entry_text(entry: LabelFraction, number: str, *, full: bool) -> str:
    """A whole entry of the legend, or only its letter and number."""
    return f"{entry.letter} {entry.text} {number}" if full else f"{entry.letter} {number}"


def _entry_width(entry: LabelFraction, size: int, *, full: bool) -> float:
    """Width of an entry, for the widest number [pixels]."""
    return 1.5 * size + text_width(_entry_text(entry, EVERYTHING, full=full), size)


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
    area: TextArea, entries: Sequence[LabelFraction], space: float, *, full: bool
) -> tuple[int, ...]:
    """Number of entries that fit into each line, one after the other."""
    lines, x = [0], 0.0
    for entry in entries:
        width = _entry_width(entry, area.size, full=full)
        if lines[-1] and x + width > space:
            lines.append(0)
            x = 0.0
        lines[-1] += 1
        x += width + 0.9 * area.size
        if width > space:
            return (*lines, 0, 0)  # does not fit
    return tuple(lines)
