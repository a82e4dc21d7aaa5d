"""The page on commands is written from their help when the site is built, so it stays true."""

import re
import textwrap

from command_help import Box, Help, commands, help_of
from sphinx.application import Sphinx
from sphinx.environment import BuildEnvironment

PAGE, MARKER = "commands", "<!-- commands -->"
_OPTION = re.compile(r"(?<![\w`-])--[a-z][a-z0-9-]*")
_MARKUP = re.compile(r"[\\`*_{}\[\]<>#|$~]")


def page() -> str:
    """A list of the commands, then a section for each, as Markdown."""
    helps = {name: help_of(name) for name in commands()}
    rows = (f"* [{name}](#command-{name}): {_first(text)}" for name, text in helps.items())
    return "\n\n".join(["\n".join(rows), *(_section(name, text) for name, text in helps.items())])


def _first(command: Help) -> str:
    """The first paragraph of a description."""
    return _prose(" ".join(command.description.partition("\n\n")[0].split()))


def _section(name: str, command: Help) -> str:
    parts = [
        f"(command-{name})=",
        f"## grasp3d {name}",
        _prose(command.description),
        _code("text", command.usage),
        f"```{{program}} grasp3d {name}\n```",
        *(_group(name, box) for box in command.boxes),
    ]
    if command.after:
        heading, _, lines = command.after.partition("\n")
        parts += [f"### {heading.strip(' :').capitalize()}", _code("sh", textwrap.dedent(lines))]
    return "\n\n".join(parts)


def _group(name: str, box: Box) -> str:
    target = f"(command-{name}-{box.title.lower().replace(' ', '-')})="
    options = (f"```{{option}} {one.name}\n{_prose(one.text)}\n```" for one in box.entries)
    return "\n\n".join([target, f"### {box.title.capitalize()}", _prose(box.text), *options])


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
