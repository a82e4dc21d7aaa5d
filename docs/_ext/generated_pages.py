"""Pages, and parts of pages, that are made from what the program declares."""

import re
from collections.abc import Callable, Mapping
from pathlib import Path

from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment


def write_pages(folder: Path, pages: Mapping[str, str]) -> None:
    """Make the pages of a folder, which has no others, these; one that stays keeps its date.

    Args:
        folder: Made if it is missing.
        pages: Text by the name of the file.
    """
    folder.mkdir(exist_ok=True)
    for path in folder.iterdir():
        if path.name not in pages:
            path.unlink()
    for name, text in pages.items():
        path = folder / name
        if not path.exists() or path.read_text(encoding="utf-8") != text:
            path.write_text(text, encoding="utf-8")


def with_markers(text: str, parts: Mapping[str, Callable[[str], str]]) -> str:
    """The text of a page with what its markers stand for.

    Args:
        text: Markdown.
        parts: By pattern of a marker, what makes its text; it is given the first group, if any.
    """
    for pattern, make in parts.items():
        text = re.sub(pattern, lambda found, make=make: make("".join(found.groups())), text)  # type: ignore[misc]
    return text


def replace_markers(app: Sphinx, page: str, parts: Mapping[str, Callable[[str], str]]) -> None:
    """Replace the markers of a page whenever it is built, as the program has no date of change."""

    def write(_app: Sphinx, name: str, source: list[str]) -> None:
        if name == page:
            source[0] = with_markers(source[0], parts)

    def outdated(_app: Sphinx, env: BuildEnvironment, *_names: set[str]) -> list[str]:
        return [page] if page in env.all_docs else []

    app.connect("source-read", write)
    app.connect("env-get-outdated", outdated)
