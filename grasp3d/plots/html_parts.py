"""Parts of web pages that need no other file: tables, lists, figures, pictures."""

import base64
import io
import math
from collections.abc import Iterable, Sequence
from html import escape

from matplotlib.figure import Figure
from PIL import Image

from grasp3d.arrays import Bytes
from grasp3d.plots.formats import as_svg
from grasp3d.system.names import as_unicode, printable

QUALITY = 85
"""Quality of the pictures' compression, from 0 to 100."""

STYLE = """
body { font: 15px/1.5 system-ui, sans-serif; color: #1d232b; background: #fff;
  max-width: 62rem; margin: 0 auto; padding: 1.5rem; }
h1 { font-size: 1.6rem; } h2 { font-size: 1.2rem; margin-top: 2.2rem; }
h3 { font-size: 1rem; }
table { border-collapse: collapse; margin: .8rem 0; font-variant-numeric: tabular-nums; }
th, td { padding: .2rem .7rem; border-bottom: 1px solid #d9dde3; text-align: right; }
th:first-child, td:first-child, td.text, th.text { text-align: left; }
td { white-space: nowrap; }
td.text { white-space: normal; overflow-wrap: anywhere; min-width: 5rem; }
thead th { border-bottom: 2px solid #9aa3ae; }
img.figure { display: block; max-width: 100%; height: auto; }
.scroll { overflow-x: auto; }
.quiet { color: #596472; }
.warning { border-left: 4px solid #d55e00; padding: .2rem .8rem; background: #fdf1e8; }
.cards { display: grid; grid-template-columns: repeat(auto-fill, minmax(17rem, 1fr)); gap: 1rem; }
.card { border: 1px solid #d9dde3; border-radius: .4rem; padding: .7rem;
  overflow-wrap: anywhere; }
.card img { width: 100%; height: auto; }
.card p { margin: .3rem 0; }
ul { padding-left: 1.2rem; }
"""


def page(title: str, parts: Iterable[str]) -> str:
    """A whole page.

    Args:
        title: Its title.
        parts: Content of its body, HTML.
    """
    head = (
        '<!doctype html>\n<html lang="en"><head><meta charset="utf-8">'
        '<meta name="viewport" content="width=device-width, initial-scale=1">'
        '<meta name="generator" content="grasp3d"><link rel="icon" href="data:,">'
        f"<title>{text(title)}</title><style>{STYLE}</style></head>\n<body>\n"
    )
    return head + "\n".join(parts) + "\n</body></html>\n"


def table(heads: Sequence[str], rows: Iterable[Sequence[str]], texts: Sequence[int] = ()) -> str:
    """A table; cells are HTML, those of the columns `texts` are aligned to the left."""
    kinds = ['class="text"' if number in texts else "" for number in range(len(heads))]
    head = "".join(f"<th {kind}>{cell}</th>" for kind, cell in zip(kinds, heads, strict=True))
    body = "\n".join(
        "<tr>" + "".join(f"<td {kind}>{cell}</td>" for kind, cell in zip(kinds, row, strict=True))
        + "</tr>"
        for row in rows
    )  # fmt: skip
    return (
        f'<div class="scroll"><table><thead><tr>{head}</tr></thead>\n<tbody>{body}</tbody></table>'
        "</div>"
    )


def bullets(lines: Iterable[str]) -> str:
    """A list of lines, which are text."""
    return "<ul>" + "".join(f"<li>{text(line)}</li>" for line in lines) + "</ul>"


def text(line: str) -> str:
    """Text as HTML, one line."""
    return escape(printable(as_unicode(line)))


def number(value: float) -> str:
    """A number with three digits after the point."""
    return "undefined" if math.isnan(value) else f"{value:.3f}"


def interval(ends: tuple[float, float]) -> str:
    """Both ends of an interval; empty: it is not known."""
    return "" if math.isnan(ends[0]) else f"[{ends[0]:.3f}, {ends[1]:.3f}]"


def figure_tag(figure: Figure, title: str) -> str:
    """A figure as an image that is part of the page."""
    data = base64.b64encode(as_svg(figure)).decode("ascii")
    return f'<img class="figure" alt="{title}" src="data:image/svg+xml;base64,{data}">'


def jpeg_url(image: Bytes) -> str:
    """A picture (height, width, 3) as an address that contains it."""
    stream = io.BytesIO()
    Image.fromarray(image).save(stream, "JPEG", quality=QUALITY)
    return f"data:image/jpeg;base64,{base64.b64encode(stream.getvalue()).decode('ascii')}"
