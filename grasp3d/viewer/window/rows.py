"""The rows of a panel: heights, drawing and hit areas.

Rows are values: the panel is redrawn only if its rows differ from those before.
"""

from dataclasses import dataclass
from typing import Protocol

from grasp3d.viewer.scene.text_layout import (
    SIZE,
    line_height,
    middle_cut,
    shortened,
    text_width,
    wrapped,
)
from grasp3d.viewer.session.painting import BOTH_SIDES, GREY, RAMP
from grasp3d.viewer.window.canvas import (
    ACCENT,
    HOVER,
    INK,
    LINE,
    MUTED,
    QUIET,
    WHITE,
    Box,
    Canvas,
)

GREY_BOX = "#{:02X}{:02X}{:02X}".format(*GREY)
CAPTION_WIDTH = 66
"""Width of the caption before buttons [pixels]."""
TRACK_HEIGHT = 6
"""Height of a slider's track [pixels]."""
THUMB_RADIUS = 7.5
"""Radius of a slider's thumb [pixels]."""
BUTTON_HEIGHT = 24
COMPACT = 24
"""Largest height of a progress row with a thin bar [pixels]."""
COLUMN = 62
"""Width of a column of percentages [pixels]."""


@dataclass(frozen=True)
class HitArea:
    """An area of the panel that reacts to the mouse."""

    name: str
    """Name of its action or slider."""
    box: Box
    track: tuple[float, float] | None = None
    """Slider: range of its thumb; None: a button."""


class Row(Protocol):
    """One row of the panel."""

    @property
    def height(self) -> float:
        """Height of the row [pixels]."""

    def draw(self, canvas: Canvas, box: Box, hovered: str | None) -> None:
        """Draw the row; `hovered` names the hit area under the mouse."""

    def hit_areas(self, box: Box) -> tuple[HitArea, ...]:
        """Areas of the row that react to the mouse."""


@dataclass(frozen=True)
class StaticRow:
    """A row that does not react to the mouse."""

    def hit_areas(self, box: Box) -> tuple[HitArea, ...]:  # noqa: ARG002
        """There are none."""
        return ()


@dataclass(frozen=True)
class Gap(StaticRow):
    """Vertical space, optionally with a thin line."""

    height: float = 8
    ruled: bool = False

    def draw(self, canvas: Canvas, box: Box, hovered: str | None) -> None:  # noqa: ARG002
        """Draw the line."""
        if self.ruled:
            middle = 0.5 * (box[1] + box[3])
            canvas.box((box[0], middle, box[2], middle + 1), LINE)


@dataclass(frozen=True)
class TextRow(StaticRow):
    """A text, broken into lines."""

    text: str
    width: float
    size: float = SIZE
    bold: bool = False
    color: str = INK
    max_lines: int = 99
    """Largest number of lines."""
    dot: str | None = None
    """Colour of a dot before the text."""
    widest: str = ""
    """A text for whose lines there is space, so that rows below stay in place."""

    @property
    def _indent(self) -> float:
        return 0.0 if self.dot is None else 18.0

    @property
    def _lines(self) -> tuple[str, ...]:
        if self.bold:
            return (middle_cut(self.text, self.width - self._indent, self.size, bold=True),)
        return wrapped(self.text, self.width - self._indent, self.size, self.max_lines)

    @property
    def height(self) -> float:
        """Height of all lines [pixels]."""
        space = self._indent
        reserved = wrapped(self.widest, self.width - space, self.size) if self.widest else ()
        return float(max(len(self._lines), len(reserved)) * line_height(self.size))

    def draw(self, canvas: Canvas, box: Box, hovered: str | None) -> None:  # noqa: ARG002
        """Draw dot and text."""
        step = line_height(self.size)
        if self.dot is not None:
            middle = box[1] + 0.5 * step
            canvas.box((box[0], middle - 6, box[0] + 12, middle + 6), self.dot, radius=6)
        for number, line in enumerate(self._lines):
            middle = box[1] + (number + 0.5) * step
            canvas.text(
                box[0] + self._indent, middle, line, size=self.size, bold=self.bold,
                color=self.color,
            )  # fmt: skip


@dataclass(frozen=True)
class ValueRow(StaticRow):
    """A name and its value."""

    name: str
    value: str
    height: float = 17

    def draw(self, canvas: Canvas, box: Box, hovered: str | None) -> None:  # noqa: ARG002
        """Draw the name at the left and the value at the right."""
        middle, width = 0.5 * (box[1] + box[3]), box[2] - box[0]
        value = shortened(self.value, width - min(text_width(self.name), 0.5 * width) - 10)
        name = shortened(self.name, width - text_width(value) - 10)
        canvas.text(box[0], middle, name, color=QUIET)
        canvas.text(box[2], middle, value, anchor="r")


@dataclass(frozen=True)
class FractionBar(StaticRow):
    """Area fractions as a divided bar."""

    parts: tuple[tuple[str, float], ...]
    """Colour and fraction of each part."""
    caption: str = ""
    height: float = 18

    def draw(self, canvas: Canvas, box: Box, hovered: str | None) -> None:  # noqa: ARG002
        """Draw caption and bar."""
        canvas.text(box[0], 0.5 * (box[1] + box[3]), self.caption, color=QUIET)
        left = box[0] + (CAPTION_WIDTH if self.caption else 0)
        width = box[2] - left
        for color, fraction in self.parts:
            right = left + fraction * width
            canvas.box((left, box[1] + 2, right, box[3] - 3), color)
            left = right


@dataclass(frozen=True)
class FractionHeader(StaticRow):
    """Headers of the columns of percentages."""

    columns: tuple[str, ...]
    height: float = 18

    def draw(self, canvas: Canvas, box: Box, hovered: str | None) -> None:  # noqa: ARG002
        """Draw the headers."""
        for number, text in enumerate(reversed(self.columns)):
            right = box[2] - number * COLUMN
            canvas.text(right, 0.5 * (box[1] + box[3]), text, color=QUIET, anchor="r")


@dataclass(frozen=True)
class FractionRow(StaticRow):
    """A label, its meaning, and its area fractions."""

    color: str
    letter: str
    text: str
    percents: tuple[str, ...]
    height: float = 19

    def draw(self, canvas: Canvas, box: Box, hovered: str | None) -> None:  # noqa: ARG002
        """Draw the label, with the percentages in columns at the right."""
        middle, right = 0.5 * (box[1] + box[3]), box[2]
        for percent in reversed(self.percents):
            canvas.text(right, middle, percent, anchor="r")
            right -= COLUMN
        canvas.box((box[0], middle - 6, box[0] + 12, middle + 6), self.color, radius=3)
        canvas.text(box[0] + 19, middle, self.letter, bold=True)
        text = shortened(self.text, right - box[0] - 42)
        canvas.text(box[0] + 37, middle, text, color=QUIET)


@dataclass(frozen=True)
class ReservedRow(StaticRow):
    """Space of a `FractionRow` that may appear, so that rows below stay in place."""

    height: float = 19

    def draw(self, canvas: Canvas, box: Box, hovered: str | None) -> None:
        """Draw nothing."""


@dataclass(frozen=True)
class RampRow(StaticRow):
    """Legend of a continuous quantity."""

    text: str
    low: str
    high: str
    grey: str = ""
    """Meaning of grey; empty: grey does not occur."""
    two_sided: bool = False
    """Whether there are values below 0, which have colours of their own."""
    height: float = 52

    def draw(self, canvas: Canvas, box: Box, hovered: str | None) -> None:  # noqa: ARG002
        """Draw name, ramp and end values."""
        left, top, right, _ = box
        canvas.text(left, top + 9, shortened(self.text, right - left))
        canvas.strip((left, top + 20, right, top + 32), BOTH_SIDES if self.two_sided else RAMP)
        canvas.text(left, top + 43, self.low, color=QUIET)
        canvas.text(right, top + 43, self.high, color=QUIET, anchor="r")
        if self.grey:
            start = 0.5 * (left + right - 16 - text_width(self.grey))
            canvas.box((start, top + 38, start + 11, top + 49), GREY_BOX, radius=3)
            canvas.text(start + 16, top + 43, self.grey, color=QUIET)


@dataclass(frozen=True)
class ProgressRow(StaticRow):
    """Progress of the background job."""

    text: str
    percent: int
    height: float = 30

    def draw(self, canvas: Canvas, box: Box, hovered: str | None) -> None:  # noqa: ARG002
        """Draw description and progress bar."""
        left, top, right, bottom = box
        bar, thickness = (bottom - 5, 5) if self.height > COMPACT else (bottom, 3)
        middle = top + (9 if self.height > COMPACT else 0.4 * self.height)
        number = f"{self.percent} %"
        text = shortened(self.text, right - left - text_width(number) - 10)
        canvas.text(left, middle, text)
        canvas.text(right, middle, number, color=QUIET, anchor="r")
        canvas.box((left, bar - thickness, right, bar), LINE, radius=2)
        done = left + self.percent / 100.0 * (right - left)
        canvas.box((left, bar - thickness, done, bar), ACCENT, radius=2)


@dataclass(frozen=True)
class SliderRow:
    """A slider with its name and value."""

    name: str
    text: str
    value: str
    position: float
    """Position of its thumb, from 0 to 1."""
    height: float = 36

    def draw(self, canvas: Canvas, box: Box, hovered: str | None) -> None:
        """Draw name, value, track and thumb."""
        left, top, right, _ = box
        value = shortened(self.value, 0.5 * (right - left), bold=True)
        space = right - left - text_width(value, bold=True) - 10
        canvas.text(left, top + 9, shortened(self.text, space))
        canvas.text(right, top + 9, value, bold=True, anchor="r")
        start, end = self._ends(box)
        middle, thumb = box[3] - 0.3 * self.height, start + self.position * (end - start)
        half = 0.5 * TRACK_HEIGHT
        canvas.box((left, middle - half, right, middle + half), LINE, radius=half)
        canvas.box((left, middle - half, thumb, middle + half), ACCENT, radius=half)
        radius = THUMB_RADIUS + (1.0 if hovered == self.name else 0.0)
        canvas.box(
            (thumb - radius, middle - radius, thumb + radius, middle + radius), WHITE,
            radius=radius, border=ACCENT,
        )  # fmt: skip

    def hit_areas(self, box: Box) -> tuple[HitArea, ...]:
        """The track, with some space above and below."""
        left, _, right, bottom = box
        top = bottom - 0.6 * self.height
        area = (left - THUMB_RADIUS, top, right + THUMB_RADIUS, bottom)
        return (HitArea(self.name, area, self._ends(box)),)

    @staticmethod
    def _ends(box: Box) -> tuple[float, float]:
        return box[0] + THUMB_RADIUS, box[2] - THUMB_RADIUS


@dataclass(frozen=True)
class Button:
    """One button of a row."""

    name: str
    text: str
    active: bool = False
    muted: bool = False
    """Whether it only explains why its action is not possible now."""


@dataclass(frozen=True)
class ButtonRow:
    """Buttons side by side, after an optional caption."""

    caption: str
    buttons: tuple[Button, ...]
    height: float = BUTTON_HEIGHT + 6

    def draw(self, canvas: Canvas, box: Box, hovered: str | None) -> None:
        """Draw the buttons; active ones are dark."""
        if self.caption:
            canvas.text(box[0], 0.5 * (box[1] + box[3]), self.caption, color=QUIET)
        for button, area in zip(self.buttons, self.hit_areas(box), strict=True):
            left, top, right, bottom = area.box
            color = HOVER if hovered == button.name else WHITE
            color, ink = (ACCENT, WHITE) if button.active else (color, INK)
            ink = MUTED if button.muted else ink
            canvas.box(area.box, color, radius=5, border=ACCENT if button.active else "#B9C2CC")
            text = shortened(button.text, right - left - 6)
            canvas.text(0.5 * (left + right), 0.5 * (top + bottom), text, color=ink, anchor="m")

    def hit_areas(self, box: Box) -> tuple[HitArea, ...]:
        """The buttons; those with longer texts are wider."""
        left = box[0] + (CAPTION_WIDTH if self.caption else 0)
        gap, top = 5.0, 0.5 * (box[1] + box[3] - BUTTON_HEIGHT)
        widths = [text_width(button.text) + 14 for button in self.buttons]
        spare = (box[2] - left - gap * (len(widths) - 1) - sum(widths)) / len(widths)
        found = []
        for button, width in zip(self.buttons, widths, strict=True):
            right = left + width + spare
            area = (round(left), top, round(right), top + BUTTON_HEIGHT)
            found.append(HitArea(button.name, area))
            left = right + gap
        return tuple(found)
