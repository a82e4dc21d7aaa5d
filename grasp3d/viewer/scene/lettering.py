"""Letters in a picture: a font that has Greek ones, and how wide words are in it."""

from functools import cache
from pathlib import Path

from matplotlib import get_data_path
from PIL import ImageFont
from vtkmodules.vtkCommonCore import VTK_FONT_FILE
from vtkmodules.vtkRenderingCore import vtkTextActor

FONTS = Path(get_data_path(), "fonts", "ttf")
PLAIN, BOLD = FONTS / "DejaVuSans.ttf", FONTS / "DejaVuSans-Bold.ttf"


@cache
def width_of(words: str, size: int, *, bold: bool = False) -> float:
    """How wide words are [pixels].

    Args:
        words: One line.
        size: Of the letters [pixels].
        bold: In bold letters.
    """
    return float(_font(size, BOLD if bold else PLAIN).getlength(words))


def shortened(words: str, size: int, room: float, *, bold: bool = False) -> str:
    """Cut words that are wider than there is room [pixels] and end them in dots."""
    if width_of(words, size, bold=bold) <= room:
        return words
    kept = len(words)
    while kept and width_of(words[:kept].rstrip() + "…", size, bold=bold) > room:
        kept -= 1
    return words[:kept].rstrip() + "…" if kept else ""


def middle_cut(words: str, size: int, room: float, *, bold: bool = False) -> str:
    """Leave out the middle of words that are wider than there is room [pixels]."""
    kept = len(words)
    short = words
    while kept > 0 and width_of(short, size, bold=bold) > room:
        kept -= 1
        short = words[: (kept + 1) // 2].rstrip() + "…" + words[len(words) - kept // 2 :].lstrip()
    return short if width_of(short, size, bold=bold) <= room else ""


def lettered(
    actor: vtkTextActor, words: str, size: int, color: tuple[float, float, float], *, bold: bool
) -> None:
    """Have an actor show a line of words, its lower left corner on the letters' foot."""
    actor.SetInput(words)
    look = actor.GetTextProperty()
    look.SetFontFamily(VTK_FONT_FILE)
    look.SetFontFile(str(BOLD if bold else PLAIN))
    look.SetFontSize(size)
    look.SetColor(*color)
    look.SetVerticalJustificationToBottom()
    look.UseTightBoundingBoxOff()


@cache
def _font(size: int, path: Path) -> ImageFont.FreeTypeFont:
    return ImageFont.truetype(str(path), size)
