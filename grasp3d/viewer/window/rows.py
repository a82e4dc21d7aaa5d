"""What a panel is made of: rows that know how high they are, how they look, and what they answer.

A row is a value: where the rows are the same as before, nothing has to be drawn.
"""

from dataclasses import dataclass
from typing import Protocol

from grasp3d.viewer.session.painting import GREY, RAMP
from grasp3d.viewer.window.canvas import (
    ACCENT,
    HOVER,
    INK,
    LINE,
    QUIET,
    SIZE,
    WHITE,
    Box,
    Canvas,
    line_height,
    middle_cut,
    shortened,
    width_of,
    wrapped,
)

GREY_BOX = "#{:02X}{:02X}{:02X}".format(*GREY)
CAPTIONS = 66
"""Width of what stands before choices."""
TRACK = 6
"""Height of a slider's track."""
THUMB = 7.5
"""Radius of its thumb."""
BUTTON = 24
LOW = 24
"""Up to which height what goes on is told in little room."""
COLUMN = 62
"""Width of a column of shares."""


@dataclass(frozen=True)
class Spot:
    """A place of the panel that answers to the mouse."""

    name: str
    """Of what it does."""
    box: Box
    track: tuple[float, float] | None = None
    """Sliders: from where to where the thumb goes; None: a button."""


class Row(Protocol):
    """A strip of the panel."""

    @property
    def height(self) -> float:
        """How much room it takes [pixels]."""

    @property
    def weight(self) -> int:
        """Where there is no room for all, the lightest fall away first."""

    def draw(self, canvas: Canvas, box: Box, over: str | None) -> None:
        """Draw it; `over` names the spot under the mouse."""

    def spots(self, box: Box) -> tuple[Spot, ...]:
        """What of it answers to the mouse."""


@dataclass(frozen=True)
class Still:
    """What a row is that answers nothing."""

    weight: int

    def spots(self, box: Box) -> tuple[Spot, ...]:  # noqa: ARG002
        """Nothing of it answers to the mouse."""
        return ()


@dataclass(frozen=True)
class Gap(Still):
    """Empty room, or a thin line in it."""

    height: float = 8
    ruled: bool = False

    def draw(self, canvas: Canvas, box: Box, over: str | None) -> None:  # noqa: ARG002
        """Draw the line."""
        if self.ruled:
            middle = 0.5 * (box[1] + box[3])
            canvas.box((box[0], middle, box[2], middle + 1), LINE)


@dataclass(frozen=True)
class Words(Still):
    """Text, broken into lines."""

    text: str
    width: float
    size: float = SIZE
    bold: bool = False
    color: str = INK
    most: int = 99
    """How many lines."""
    dot: str | None = None
    """Colour of a dot before it."""

    @property
    def _indent(self) -> float:
        return 0.0 if self.dot is None else 18.0

    @property
    def _lines(self) -> tuple[str, ...]:
        if self.bold:
            return (middle_cut(self.text, self.width - self._indent, self.size, bold=True),)
        return wrapped(self.text, self.width - self._indent, self.size, self.most)

    @property
    def height(self) -> float:
        """As many lines as it takes."""
        return float(len(self._lines) * line_height(self.size))

    def draw(self, canvas: Canvas, box: Box, over: str | None) -> None:  # noqa: ARG002
        """Write it."""
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
class Pair(Still):
    """A name and its value."""

    name: str
    value: str
    height: float = 17

    def draw(self, canvas: Canvas, box: Box, over: str | None) -> None:  # noqa: ARG002
        """Write them, the value to the right."""
        middle, whole = 0.5 * (box[1] + box[3]), box[2] - box[0]
        value = shortened(self.value, whole - min(width_of(self.name), 0.5 * whole) - 10)
        name = shortened(self.name, whole - width_of(value) - 10)
        canvas.text(box[0], middle, name, color=QUIET)
        canvas.text(box[2], middle, value, anchor="r")


@dataclass(frozen=True)
class ShareBar(Still):
    """Shares of the surface, side by side."""

    parts: tuple[tuple[str, float], ...]
    """Colour and share."""
    caption: str = ""
    height: float = 18

    def draw(self, canvas: Canvas, box: Box, over: str | None) -> None:  # noqa: ARG002
        """Draw it."""
        canvas.text(box[0], 0.5 * (box[1] + box[3]), self.caption, color=QUIET)
        left = box[0] + (CAPTIONS if self.caption else 0)
        whole = box[2] - left
        for color, share in self.parts:
            right = left + share * whole
            canvas.box((left, box[1] + 2, right, box[3] - 3), color)
            left = right


@dataclass(frozen=True)
class ShareHead(Still):
    """What stands above columns of shares."""

    columns: tuple[str, ...]
    height: float = 18

    def draw(self, canvas: Canvas, box: Box, over: str | None) -> None:  # noqa: ARG002
        """Write it."""
        for number, words in enumerate(reversed(self.columns)):
            right = box[2] - number * COLUMN
            canvas.text(right, 0.5 * (box[1] + box[3]), words, color=QUIET, anchor="r")


@dataclass(frozen=True)
class ShareLine(Still):
    """A label, what it means, and its shares."""

    color: str
    letter: str
    words: str
    shares: tuple[str, ...]
    height: float = 19

    def draw(self, canvas: Canvas, box: Box, over: str | None) -> None:  # noqa: ARG002
        """Write it; shares stand in columns at the right."""
        middle, right = 0.5 * (box[1] + box[3]), box[2]
        for share in reversed(self.shares):
            canvas.text(right, middle, share, anchor="r")
            right -= COLUMN
        canvas.box((box[0], middle - 6, box[0] + 12, middle + 6), self.color, radius=3)
        canvas.text(box[0] + 19, middle, self.letter, bold=True)
        words = shortened(self.words, right - box[0] - 42)
        canvas.text(box[0] + 37, middle, words, color=QUIET)


@dataclass(frozen=True)
class RampStrip(Still):
    """What colours of a number mean."""

    words: str
    low: str
    high: str
    grey: str = ""
    """What grey means; nothing: it does not occur."""
    height: float = 52

    def draw(self, canvas: Canvas, box: Box, over: str | None) -> None:  # noqa: ARG002
        """Draw it: words, strip, ends."""
        left, top, right, _ = box
        canvas.text(left, top + 9, shortened(self.words, right - left))
        canvas.strip((left, top + 20, right, top + 32), RAMP)
        canvas.text(left, top + 43, self.low, color=QUIET)
        canvas.text(right, top + 43, self.high, color=QUIET, anchor="r")
        if self.grey:
            start = 0.5 * (left + right - 16 - width_of(self.grey))
            canvas.box((start, top + 38, start + 11, top + 49), GREY_BOX, radius=3)
            canvas.text(start + 16, top + 43, self.grey, color=QUIET)


@dataclass(frozen=True)
class WorkBar(Still):
    """What goes on in the background."""

    words: str
    percent: int
    height: float = 30

    def draw(self, canvas: Canvas, box: Box, over: str | None) -> None:  # noqa: ARG002
        """Draw words and bar."""
        left, top, right, bottom = box
        foot, thick = (bottom - 5, 5) if self.height > LOW else (bottom, 3)
        middle = top + (9 if self.height > LOW else 0.4 * self.height)
        number = f"{self.percent} %"
        words = shortened(self.words, right - left - width_of(number) - 10)
        canvas.text(left, middle, words)
        canvas.text(right, middle, number, color=QUIET, anchor="r")
        canvas.box((left, foot - thick, right, foot), LINE, radius=2)
        done = left + self.percent / 100.0 * (right - left)
        canvas.box((left, foot - thick, done, foot), ACCENT, radius=2)


@dataclass(frozen=True)
class Track:
    """A slider with its name and value."""

    weight: int
    name: str
    words: str
    value: str
    share: float
    """Where its thumb stands, from 0 to 1."""
    height: float = 36

    def draw(self, canvas: Canvas, box: Box, over: str | None) -> None:
        """Draw words, track and thumb."""
        left, top, right, _ = box
        value = shortened(self.value, 0.5 * (right - left), bold=True)
        room = right - left - width_of(value, bold=True) - 10
        canvas.text(left, top + 9, shortened(self.words, room))
        canvas.text(right, top + 9, value, bold=True, anchor="r")
        start, end = self._ends(box)
        middle, thumb = box[3] - 0.3 * self.height, start + self.share * (end - start)
        rail = (left, middle - 0.5 * TRACK, right, middle + 0.5 * TRACK)
        canvas.box(rail, LINE, radius=0.5 * TRACK)
        canvas.box((left, rail[1], thumb, rail[3]), ACCENT, radius=0.5 * TRACK)
        radius = THUMB + (1.0 if over == self.name else 0.0)
        canvas.box(
            (thumb - radius, middle - radius, thumb + radius, middle + radius), WHITE,
            radius=radius, border=ACCENT,
        )  # fmt: skip

    def spots(self, box: Box) -> tuple[Spot, ...]:
        """The track, somewhat higher than it looks."""
        left, _, right, bottom = box
        high = bottom - 0.6 * self.height
        return (Spot(self.name, (left - THUMB, high, right + THUMB, bottom), self._ends(box)),)

    @staticmethod
    def _ends(box: Box) -> tuple[float, float]:
        return box[0] + THUMB, box[2] - THUMB


@dataclass(frozen=True)
class Button:
    """Something to click."""

    name: str
    words: str
    active: bool = False


@dataclass(frozen=True)
class Choices:
    """Buttons side by side, after a caption if there is one."""

    weight: int
    caption: str
    buttons: tuple[Button, ...]
    height: float = BUTTON + 6

    def draw(self, canvas: Canvas, box: Box, over: str | None) -> None:
        """Draw them; what is active is dark."""
        if self.caption:
            canvas.text(box[0], 0.5 * (box[1] + box[3]), self.caption, color=QUIET)
        for button, spot in zip(self.buttons, self.spots(box), strict=True):
            left, top, right, bottom = spot.box
            paper = HOVER if over == button.name else WHITE
            paper, ink = (ACCENT, WHITE) if button.active else (paper, INK)
            canvas.box(spot.box, paper, radius=5, border=ACCENT if button.active else "#B9C2CC")
            words = shortened(button.words, right - left - 6)
            canvas.text(0.5 * (left + right), 0.5 * (top + bottom), words, color=ink, anchor="m")

    def spots(self, box: Box) -> tuple[Spot, ...]:
        """The buttons; those with more words are wider."""
        left = box[0] + (CAPTIONS if self.caption else 0)
        gap, top = 5.0, 0.5 * (box[1] + box[3] - BUTTON)
        wants = [width_of(button.words) + 14 for button in self.buttons]
        spare = (box[2] - left - gap * (len(wants) - 1) - sum(wants)) / len(wants)
        found = []
        for button, want in zip(self.buttons, wants, strict=True):
            right = left + want + spare
            found.append(Spot(button.name, (round(left), top, round(right), top + BUTTON)))
            left = right + gap
        return tuple(found)
