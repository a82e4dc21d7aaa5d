"""The page on commands is written from their help when the site is built, so it stays true."""

import re
import textwrap

from docstring_parser import parse_from_object
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment

from grasp3d.cli import KINDS
from grasp3d.cli.options import Option
from grasp3d.cli.usage import GROUPS, examples_of, groups_of, invocation, usage_of

PAGE, MARKER = "commands", "<!-- commands -->"
_OPTION = re.compile(r"(?<![\w`-])--[a-z][a-z0-9-]*")
_MARKUP = re.compile(r"[\\`*_{}\[\]<>#|$~]")


def page() -> str:
    """A list of the commands, then a section for each, as Markdown."""
    rows = (
        f"* [{name}](#command-{name}): {_prose(parse_from_object(kind).short_description or '')}"
        for name, kind in KINDS.items()
    )
    return "\n\n".join(["\n".join(rows), *map(_section, KINDS.values())])


def _section(kind: type) -> str:
    name, doc = kind.__name__.lower(), parse_from_object(kind)
    return "\n\n".join(
        [
            f"(command-{name})=",
            f"## grasp3d {name}",
            _prose(doc.short_description or ""),
            _prose(doc.long_description or ""),
            _code("text", usage_of(kind).removeprefix("usage: ")),
            f"```{{program}} grasp3d {name}\n```",
            *(_group(name, group, options) for group, options in groups_of(kind).items()),
            "### Examples",
            _code("sh", textwrap.dedent(examples_of(kind))),
        ]
    )


def _group(command: str, name: str, options: list[Option]) -> str:
    entries = (f"```{{option}} {invocation(one)}\n{_prose(one.text)}\n```" for one in options)
    target = f"(command-{command}-{name})="
    return "\n\n".join([target, f"### {name.capitalize()}", _prose(GROUPS[name]), *entries])


def _code(language: str, lines: str) -> str:
    return f"```{{code-block}} {language}\n{lines}\n```"


def _prose(text: str) -> str:
    """Text as Markdown that shows every character as it is, with options as code."""
    return _OPTION.sub(r"`\g<0>`", _MARKUP.sub(r"\\\g<0>", text))


def _write(_app: Sphinx, name: str, source: list[str]) -> None:
    if name == PAGE:
        source[0] = source[0].replace(MARKER, page())


def _outdated(_app: Sphinx, env: BuildEnvironment, *_names: set[str]) -> list[str]:
    """The page depends on the program, which has no date of change."""
    return [PAGE] if PAGE in env.all_docs else []


def setup(app: Sphinx) -> dict[str, bool]:
    """Fill the page when it is read."""
    app.connect("source-read", _write)
    app.connect("env-get-outdated", _outdated)
    return {"parallel_read_safe": True, "parallel_write_safe": True}
