"""A small picture of text and plain shapes, such as the panel beside the scene.

Text is measured as it is drawn, so that nothing runs over its neighbour or out of the picture.
"""

from functools import cache, lru_cache
from pathlib import Path

import matplotlib as mpl
import numpy as np
from PIL import Image, ImageDraw, ImageFont

from grasp3d.arrays import Bytes

INK, QUIET, LINE = "#1F2328", "#626C77", "#D3D9E0"
PAPER, WHITE, HOVER = "#F6F7F9", "#FFFFFF", "#E3EAF2"
ACCENT, WARNING = "#1F5FA8", "#9A4A00"

SIZE = 12
"""Of usual text [pixels]."""
LEADING = 1.42
"""From one line to the next, as a share of the size."""
SMOOTH = 4
"""How much larger round shapes are drawn before they are made small."""
MORE = "…"

Box = tuple[float, float, float, float]
"""Left, top, right, bottom [pixels]; downward as pictures are."""


@cache
def font_of(size: float, *, bold: bool = False) -> ImageFont.FreeTypeFont:
    """A font with Greek letters, of some size [pixels]."""
    name = "DejaVuSans-Bold.ttf" if bold else "DejaVuSans.ttf"
    return ImageFont.truetype(str(Path(mpl.get_data_path(), "fonts", "ttf", name)), size)


@lru_cache(maxsize=4096)
def width_of(text: str, size: float = SIZE, *, bold: bool = False) -> float:
    """How wide a line of text is [pixels]."""
    return font_of(size, bold=bold).getlength(text)


def line_height(size: float = SIZE) -> int:
    """From one line to the next [pixels]."""
    return round(LEADING * size)


def shortened(text: str, width: float, size: float = SIZE, *, bold: bool = False) -> str:
    """Cut a line so that it fits, and say so by dots."""
    if width_of(text, size, bold=bold) <= width:
        return text
    while text and width_of(text.rstrip() + MORE, size, bold=bold) > width:
        text = text[:-1]
    return text.rstrip() + MORE


def middle_cut(text: str, width: float, size: float = SIZE, *, bold: bool = False) -> str:
    """Leave out the middle of a line that does not fit; its end tells as much as its beginning."""
    kept = len(text)
    short = text
    while kept > 0 and width_of(short, size, bold=bold) > width:
        kept -= 1
        short = text[: (kept + 1) // 2].rstrip() + MORE + text[len(text) - kept // 2 :].lstrip()
    return short


@lru_cache(maxsize=512)
def wrapped(text: str, width: float, size: float = SIZE, most: int = 99) -> tuple[str, ...]:
    """Break text into lines that fit; words that are too long are broken as well.

    Args:
        text: Any.
        width: Of the longest line [pixels].
        size: Of the letters [pixels].
        most: How many lines there may be; the last one ends in dots where there were more.
    """
    lines, line = [], ""
    for word in text.split():
        longer = f"{line} {word}" if line else word
        if width_of(longer, size) <= width:
            line = longer
            continue
        if line:
            lines.append(line)
        *full, line = _pieces(word, width, size)
        lines.extend(full)
    lines.append(line)
    if len(lines) > most:
        lines = [*lines[: most - 1], shortened(" ".join(lines[most - 1 :]), width, size)]
    return tuple(lines)


def _pieces(word: str, width: float, size: float) -> list[str]:
    pieces = [""]
    for letter in word:
        if pieces[-1] and width_of(pieces[-1] + letter, size) > width:
            pieces.append("")
        pieces[-1] += letter
    return pieces


class Canvas:
    """Something to draw on; all lengths are in its own pixels, which a fine screen has more of."""

    def __init__(
        self, width: float, height: float, *, scale: float = 1.0, paper: str = PAPER
    ) -> None:
        """Begin with an empty sheet.

        Args:
            width: Its width.
            height: Its height.
            scale: Pixels of the screen for one of its own.
            paper: Its colour.
        """
        self.scale = scale
        self._image = Image.new("RGB", (round(width * scale), round(height * scale)), paper)
        self._draw = ImageDraw.Draw(self._image)

    @property
    def pixels(self) -> Bytes:
        """Red, green, blue, shape (height, width, 3)."""
        return np.asarray(self._image, dtype=np.uint8)

    def text(
        self, x: float, middle: float, text: str, *,
        size: float = SIZE, bold: bool = False, color: str = INK, anchor: str = "l",
    ) -> None:  # fmt: skip
        """Write one line.

        Args:
            x: Where it begins, has its middle or ends.
            middle: Height of the middle of its small letters.
            text: What.
            size: Of the letters.
            bold: Heavier.
            color: As #RRGGBB.
            anchor: What of it is at x: l left, m middle, r right.
        """
        place = (round(x * self.scale), round((middle + 0.36 * size) * self.scale))
        font = font_of(size * self.scale, bold=bold)
        self._draw.text(place, text, fill=color, font=font, anchor=f"{anchor}s")

    def box(self, box: Box, color: str, *, radius: float = 0.0, border: str | None = None) -> None:
        """Fill a box with round corners, if wanted with a thin line about it."""
        left, top, right, bottom = (round(side * self.scale) for side in box)
        if border is not None:
            self.box(box, border, radius=radius)
            thin = round(self.scale)
            left, top, right, bottom = left + thin, top + thin, right - thin, bottom - thin
            radius = max(0.0, radius - 1.0)
        if right <= left or bottom <= top:
            return
        mask = _rounded(right - left, bottom - top, round(radius * self.scale))
        self._image.paste(color, (left, top, right, bottom), mask)

    def strip(self, box: Box, colors: Bytes) -> None:
        """Fill a box with colours from left to right, shape (n, 3)."""
        left, top, right, bottom = (round(side * self.scale) for side in box)
        row = Image.fromarray(colors[None])
        self._image.paste(row.resize((right - left, bottom - top)), (left, top))


@lru_cache(maxsize=512)
def _rounded(width: int, height: int, radius: int) -> Image.Image:
    """Mask of a box with round corners whose rim is smooth."""
    large = Image.new("L", (SMOOTH * width, SMOOTH * height), 0)
    corner = (SMOOTH * width - 1, SMOOTH * height - 1)
    ImageDraw.Draw(large).rounded_rectangle(((0, 0), corner), SMOOTH * radius, fill=255)
    return large.reduce(SMOOTH)
