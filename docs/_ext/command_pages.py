"""The pages of the commands are written from their help when the site is built, so they stay true.

What a command prints is shown as the guide shows it, whose examples are run by the tests.
"""

import re
import textwrap
from collections.abc import Iterator
from pathlib import Path

from docstring_parser import parse_from_object
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment

from grasp3d.cli import KINDS
from grasp3d.cli.options import Option
from grasp3d.cli.usage import GROUPS, examples_of, groups_of, invocation, usage_of

PAGE, FOLDER, MARKER = "commands", "commands", "<!-- commands -->"
MOST_EXAMPLES = 2
"""Most pages of the guide whose first block is shown on the page of a command."""

_OPTION = re.compile(r"(?<![\w`-])--[a-z][a-z0-9-]*")
_MARKUP = re.compile(r"[\\`*_{}\[\]<>#|$~]")
_RUN = re.compile(
    r"^```sh\n(?P<lines>(?:(?!```).*\n)+)```\n(?:\s*\n[^\n`#|<>]{1,80}\n)?\s*\n"
    r"```text\n(?P<printed>(?:(?!```).*\n)+)```$",
    re.MULTILINE,
)
_TITLE = re.compile(r"^# (.+)$", re.MULTILINE)


def table_of_commands() -> str:
    """A list of the commands, as Markdown, and the tree of their pages."""
    rows = (
        f"* [grasp3d {name}]({FOLDER}/{name}.md): "
        f"{_prose(parse_from_object(kind).short_description or '')}"
        for name, kind in KINDS.items()
    )
    tree = "\n".join(f"{FOLDER}/{name}" for name in KINDS)
    return "\n".join([*rows, "", "```{toctree}", ":hidden:", "", tree, "```"])


def page_of(name: str, docs: Path) -> str:
    """The page of a command, as Markdown."""
    kind = KINDS[name]
    doc = parse_from_object(kind)
    return "\n\n".join(
        [
            f"# grasp3d {name}",
            _prose(doc.short_description or ""),
            _prose(doc.long_description or ""),
            _code("text", usage_of(kind).removeprefix("usage: ")),
            "## Examples",
            _code("sh", textwrap.dedent(examples_of(kind))),
            *_shown_in_the_guide(name, docs),
            f"```{{program}} grasp3d {name}\n```",
            *(_group(name, group, options) for group, options in groups_of(kind).items()),
            "",
        ]
    )


def _shown_in_the_guide(name: str, docs: Path) -> Iterator[str]:
    """What the command prints, where a page of the guide shows it."""
    begins = re.compile(rf"^(?:[^#\n]*\| *)?grasp3d {name}\b", re.MULTILINE)
    shown = 0
    for path in [docs / "quickstart.md", *sorted((docs / "guide").glob("*.md"))]:
        text = path.read_text(encoding="utf-8")
        block = next((one for one in _RUN.finditer(text) if begins.search(one["lines"])), None)
        if block is None or shown == MOST_EXAMPLES:
            continue
        shown += 1
        title = _TITLE.search(text)
        name = title[1] if title else path.stem
        yield f"From [{name}](/{path.relative_to(docs).as_posix()}):"
        yield _code("sh", block["lines"].rstrip())
        yield _code("text", block["printed"].rstrip())


def _group(command: str, name: str, options: list[Option]) -> str:
    entries = (f"```{{option}} {invocation(one)}\n{_prose(one.text)}\n```" for one in options)
    target = f"(command-{command}-{name})="
    return "\n\n".join([target, f"## {name.capitalize()}", _prose(GROUPS[name]), *entries])


def _code(language: str, lines: str) -> str:
    return f"```{{code-block}} {language}\n{lines}\n```"


def _prose(text: str) -> str:
    """Text as Markdown that shows every character as it is, with options as code."""
    return _OPTION.sub(r"`\g<0>`", _MARKUP.sub(r"\\\g<0>", text))


def write_pages(folder: Path, pages: dict[str, str]) -> None:
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


def _write_pages(app: Sphinx) -> None:
    docs = Path(app.srcdir)
    write_pages(docs / FOLDER, {f"{name}.md": page_of(name, docs) for name in KINDS})


def _write_table(_app: Sphinx, name: str, source: list[str]) -> None:
    if name == PAGE:
        source[0] = source[0].replace(MARKER, table_of_commands())


def _outdated(_app: Sphinx, env: BuildEnvironment, *_names: set[str]) -> list[str]:
    """The list depends on the program, which has no date of change."""
    return [PAGE] if PAGE in env.all_docs else []


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the pages before they are read."""
    app.connect("builder-inited", _write_pages)
    app.connect("source-read", _write_table)
    app.connect("env-get-outdated", _outdated)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
