"""The pages of the commands are written from their help when the site is built."""

import re
import textwrap
from pathlib import Path

from docstring_parser import parse_from_object
from generated_pages import replace_markers, write_pages
from sphinx.application import Sphinx

from grasp3d.cli import KINDS
from grasp3d.cli.options import Option
from grasp3d.cli.usage import GROUPS, examples_of, groups_of, invocation, usage_of

PAGE, FOLDER, MARKER = "reference/commands", "commands", "<!-- commands -->"

_OPTION = re.compile(r"(?<![\w`-])--[a-z][a-z0-9-]*")
_MARKUP = re.compile(r"[\\`*_{}\[\]<>#|$~]")


def table_of_commands(_page: str = "") -> str:
    """A list of the commands, as Markdown, and the tree of their pages."""
    rows = (
        f"* [grasp3d {name}]({FOLDER}/{name}.md): "
        f"{_prose(parse_from_object(kind).short_description or '')}"
        for name, kind in KINDS.items()
    )
    tree = "\n".join(f"{FOLDER}/{name}" for name in KINDS)
    return "\n".join([*rows, "", "```{toctree}", ":hidden:", "", tree, "```"])


def page_of(name: str) -> str:
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
            f"```{{program}} grasp3d {name}\n```",
            *(_group(name, group, options) for group, options in groups_of(kind).items()),
            "",
        ]
    )


def _group(command: str, name: str, options: list[Option]) -> str:
    title, _, text = GROUPS[name].partition(": ")
    entries = (f"```{{option}} {invocation(one)}\n{_prose(one.text)}\n```" for one in options)
    target = f"(command-{command}-{name})="
    return "\n\n".join([target, f"## {title.capitalize()}", _prose(text), *entries])


def _code(language: str, lines: str) -> str:
    return f"```{{code-block}} {language}\n{lines}\n```"


def _prose(text: str) -> str:
    """Text as Markdown that shows every character as it is, with options as code."""
    return _OPTION.sub(r"`\g<0>`", _MARKUP.sub(r"\\\g<0>", text))


def _write_pages(app: Sphinx) -> None:
    pages = {f"{name}.md": page_of(name) for name in KINDS}
    write_pages(Path(app.srcdir) / "reference" / FOLDER, pages)


def setup(app: Sphinx) -> dict[str, bool]:
    """Write the pages before they are read."""
    app.connect("builder-inited", _write_pages)
    replace_markers(app, PAGE, {MARKER: table_of_commands})
    return {"parallel_read_safe": True, "parallel_write_safe": True}
