"""Text layout: the font, widths of texts, shortening and line breaks."""

from functools import cache, lru_cache
from pathlib import Path

from matplotlib import get_data_path
from PIL import ImageFont

FONTS = Path(get_data_path(), "fonts", "ttf")
PLAIN, BOLD = FONTS / "DejaVuSans.ttf", FONTS / "DejaVuSans-Bold.ttf"
"""Fonts with Greek letters."""

SIZE = 12
"""Default text size [pixels]."""
LINE_SPACING = 1.42
"""Distance between lines of a paragraph, relative to the text size."""
ELLIPSIS = "…"


@cache
def font_of(size: float, *, bold: bool = False) -> ImageFont.FreeTypeFont:
    """The font at a size [pixels]."""
    return ImageFont.truetype(str(BOLD if bold else PLAIN), size)


@lru_cache(maxsize=8192)
def text_width(text: str, size: float = SIZE, *, bold: bool = False) -> float:
    """Width of a line of text [pixels].

    Args:
        text: One line.
        size: Text size [pixels].
        bold: Use the bold font.
    """
    return float(font_of(size, bold=bold).getlength(text))


def line_height(size: float = SIZE) -> int:
    """Distance between lines of a paragraph [pixels]."""
    return round(LINE_SPACING * size)


def shortened(text: str, width: float, size: float = SIZE, *, bold: bool = False) -> str:
    """Cut the end of a line that is wider than a width [pixels], and add an ellipsis."""
    if text_width(text, size, bold=bold) <= width:
        return text
    kept = len(text)
    while kept and text_width(text[:kept].rstrip() + ELLIPSIS, size, bold=bold) > width:
        kept -= 1
    return text[:kept].rstrip() + ELLIPSIS if kept else ""


def middle_cut(text: str, width: float, size: float = SIZE, *, bold: bool = False) -> str:
    """Replace the middle of a line that is wider than a width [pixels] by an ellipsis."""
    kept = len(text)
    short = text
    while kept > 0 and text_width(short, size, bold=bold) > width:
        kept -= 1
        end = text[len(text) - kept // 2 :].lstrip()
        short = text[: (kept + 1) // 2].rstrip() + ELLIPSIS + end
    return short if text_width(short, size, bold=bold) <= width else ""


@lru_cache(maxsize=512)
def wrapped(text: str, width: float, size: float = SIZE, max_lines: int = 99) -> tuple[str, ...]:
    """Break a text into lines; words that are too long are broken as well.

    Args:
        text: The text.
        width: Largest width of a line [pixels].
        size: Text size [pixels].
        max_lines: If there are more lines, the last of these ends in an ellipsis.
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
    if len(lines) > max_lines:
        rest = " ".join(lines[max_lines - 1 :])
        lines = [*lines[: max_lines - 1], shortened(rest, width, size)]
    return tuple(lines)


def _pieces(word: str, width: float, size: float) -> list[str]:
    """Break a word into pieces of a largest width [pixels]."""
    pieces = [""]
    for letter in word:
        if pieces[-1] and text_width(pieces[-1] + letter, size) > width:
            pieces.append("")
        pieces[-1] += letter
    return pieces
