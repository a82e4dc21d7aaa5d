"""How a command line is understood: the help of a command, its words, and errors of usage."""

import re
import shutil
from argparse import SUPPRESS, ArgumentError, ArgumentParser, BooleanOptionalAction
from collections.abc import Iterable, Mapping
from dataclasses import MISSING, fields
from difflib import get_close_matches
from functools import partial
from textwrap import fill, indent
from typing import Any, NoReturn, get_type_hints

from grasp3d.cli.options import Option, is_option, options_of, parted, settings_in
from grasp3d.errors import SettingError
from grasp3d.settings.units import METRES

GROUPS = {
    "arguments": "",
    "object": "The object and its mesh. A LENGTH has a unit: 80mm, 8cm, 0.08m, 3in; without one it "
    "is in metres, or in the mesh's own unit where that is not known.",
    "noise": "The noise of a scan, and the copies that have it.",
    "fingertip": "The fingertip, and its finger. A LENGTH has a unit, such as 10mm.",
    "sensor": "Friction, what the fingertips' sensors resolve, and what else is uncertain.",
    "hand": "The fingers, the hand that must reach each grasp, and what the object stands on.",
    "load": "What each grasp must hold, and the force at hand.",
    "search": "How candidate grasps are searched, labelled and measured.",
    "simulation": "How grasps are drawn and simulated.",
    "statistics": "What is computed from outcomes, and listed.",
    "view": "The initial view of the object.",
    "output": "What is written and printed.",
    "processes": "Which processes do the work, and their limits.",
}
"""Texts on the groups of options, in the order of the help."""

HELP, HELP_ALL = ("-h", "--help"), "--help-all"

MOST_OPTIONS = 15
"""Most options of a command whose help has all of them without being asked for."""

LEAST_LIKENESS = 0.75
"""Least ratio of `difflib` at which an option may have been meant."""

OTHER_WORDS = {
    "--gripper": "--hand",
    "--robot": "--hand",
    "--weight": "--mass",
    "--mu": "--friction",
    "--alpha": "--sensor-resolution",
    "--width": "--max-opening",
    "--stroke": "--max-opening",
}
"""Options that others have for what an option here is called."""

WIDEST, LONG = 100, 20
"""Most columns of the help; most letters of a placeholder in the short help."""


_NEGATIVE = re.compile(r"-([.\d]|([xyz]|inf|nan)$)")
"""Words that are no options: how a negative number begins, such as -1mm, and directions."""


def parse(kind: type, words: list[str]) -> Any:
    """Return a command for the words of a command line.

    Args:
        kind: The dataclass of its options.
        words: What follows its name.

    Raises:
        SettingError: An option is not known, or a value is missing or not right.
    """
    options, prog = list(options_of(kind, helps=False)), prog_of(kind)
    names = sorted((name for option in options for name in option.names), key=len)
    end = words.index("--") if "--" in words else len(words)
    words = [*map(_hyphened, words[:end]), *words[end:]]
    for word in words[:end]:
        name = word.partition("=")[0]
        if name.startswith("--") and name.replace("--no-", "--") not in names:
            raise SettingError(f"{prog} has no option {name}; {_meant(name, names, prog)}")
    parser = _Words(prog=prog, add_help=False, allow_abbrev=False, exit_on_error=False)
    parser._negative_number_matcher = _NEGATIVE  # noqa: SLF001, others are no numbers
    for one in options:
        parser.add_argument(*(one.names or (one.field,)), **_arguments(one))
    try:
        found, extra = parser.parse_known_args(words)
    except ArgumentError as error:
        raise SettingError(_sentence(error, options)) from error
    if extra:
        takes = " ".join(one.metavar for one in options if not one.names) or "options only"
        unit = "; a length has its unit without a space, as in 80mm" if extra[0] in METRES else ""
        raise SettingError(f"{extra[0]!r} is one too many: {prog} takes {takes}{unit}")
    return _made(kind, **{one.field: _value(one, vars(found)) for one in options})


def _hyphened(word: str) -> str:
    """Return a word with the name of its option as it is declared: `--max_edge` is accepted."""
    name, equals, value = word.partition("=")
    return f"{name.replace('_', '-')}{equals}{value}" if name.startswith("--") else word


class _Words(ArgumentParser):
    """A parser of words whose errors are those of settings."""

    def error(self, message: str) -> NoReturn:
        """Name the arguments and options that are missing."""
        names = (part.partition("/")[0] for part in message.rpartition(": ")[2].split(", "))
        raise SettingError(f"{self.prog} needs {', '.join(names)}; see {self.prog} --help")


def _arguments(option: Option) -> dict[str, Any]:
    """Return how argparse takes the words of an option."""
    named: dict[str, Any] = {"dest": option.field, "required": option.is_required}
    shared = {"default": SUPPRESS, **(named if option.names else {"metavar": option.metavar})}
    if not option.metavar:
        return {**shared, "action": BooleanOptionalAction if option.default else "store_true"}
    if option.repeated:
        return {**shared, "action": "append"}
    single = None if option.is_required or option.names else "?"
    return {**shared, "nargs": single if option.count == 1 else option.count}


def _value(option: Option, found: Mapping[str, Any]) -> Any:
    """Return the value of an option, or its default."""
    words = found.get(option.field, option.default)
    if words is MISSING:
        words = []  # any number of arguments, of which none is given
    elif option.field not in found or isinstance(words, bool):
        return words
    return option.parse([words] if isinstance(words, str) else words)


def _meant(name: str, names: list[str], prog: str) -> str:
    """Return which option may have been meant by a name, or how to find it."""
    alike = [one for one in names if one == OTHER_WORDS.get(name)]
    alike += [one for one in names if len(name) > len("--x") and name.lstrip("-") in one]
    alike += get_close_matches(name, names, 1, LEAST_LIKENESS)
    return f"did you mean {alike[0]}?" if alike else f"all options: {prog} {HELP_ALL}"


def _sentence(error: ArgumentError, options: Iterable[Option]) -> str:
    """Return what is wrong with the words of an option."""
    name = (error.argument_name or "").rpartition("/")[2]
    name = name.replace("--no-", "--")
    [option] = [one for one in options if name in one.names]
    if not option.metavar:
        return f"{name} takes no value"
    count = "a value" if option.repeated or option.count == 1 else f"{option.count} values"
    return f"{name} needs {count}: {option.metavar}"


def groups_of(kind: type) -> dict[str, list[Option]]:
    """Return the arguments and options of a command by group, in the order of the help."""
    options = list(options_of(kind))
    groups = {name: [one for one in options if one.group == name] for name in GROUPS}
    return {name: group for name, group in groups.items() if group}


def help_of(kind: type, *, whole: bool) -> str:
    """Return the help of a command.

    Args:
        kind: The dataclass of its options.
        whole: Whether it has all options; otherwise those that matter, if there are many.
    """
    from docstring_parser import parse_from_object

    groups, doc = groups_of(kind), parse_from_object(kind)
    options = [one for group in groups.values() for one in group]
    whole = whole or len(options) <= MOST_OPTIONS
    width = max(len(invocation(one, short=True)) for one in options if one.brief or whole)
    columns = min(shutil.get_terminal_size().columns, WIDEST)
    paragraph = partial(fill, width=columns, initial_indent=" " * 6, subsequent_indent=" " * 6)
    lines, more = [usage_of(kind), ""], (doc.long_description or "") * whole
    for text in filter(None, (doc.short_description, *more.split("\n\n"))):
        lines += [fill(text, columns), ""]
    for name, group in groups.items():
        if whole:
            lines.append(fill(f"{name}: {GROUPS[name]}".strip(), columns))
            lines += [f"  {invocation(one)}\n{paragraph(one.text)}" for one in group]
            lines.append("")
        elif rows := [one for one in group if one.brief]:
            lines.append(f"{name}:")
            lines += [f"  {invocation(one, short=True):{width}}  {one.brief}" for one in rows]
    lines += [*[""] * (not whole), "examples:", examples_of(kind)]
    return "\n".join(lines if whole else [*lines, "", f"all options: {prog_of(kind)} {HELP_ALL}"])


def prog_of(kind: type) -> str:
    """Return the words by which a command is called."""
    return f"grasp3d {kind.__name__.lower()}"


def usage_of(kind: type) -> str:
    """Return how a command is called: its arguments and required options."""
    options = sorted(options_of(kind), key=lambda one: len(one.names))  # arguments first
    required = (one for one in options if one.is_required or not one.names)
    words = (" ".join((*one.names[:1], one.metavar)) for one in required)
    return " ".join(["usage:", prog_of(kind), *words, "[OPTIONS]"])


def invocation(option: Option, *, short: bool = False) -> str:
    """Return how an option is given.

    Args:
        option: The option, or the argument.
        short: Whether other long names and placeholders are left out.
    """
    names, metavar = option.names, option.metavar
    if short:
        names = (*(name for name in names[:-1] if not name.startswith("--")), *names[-1:])
        metavar = metavar.removesuffix("|none")
        metavar = f"{metavar.partition('|')[0]}|..." if len(metavar) > LONG else metavar
    return f"{', '.join(names)} {metavar}".strip()


def examples_of(kind: type) -> str:
    """Return the examples in the docstring of a command's options.

    The folder `meshes` in them is the one that comes with the package, `grasps.csv` a table with
    columns x1 y1 z1 x2 y2 z2, `tried.csv` one of poses with outcomes, `hand.urdf` a robot's hand.
    """
    from docstring_parser import parse_from_object

    [examples] = parse_from_object(kind).examples
    return indent(examples.description or "", "  ")


def _made(kind: Any, /, **values: Any) -> Any:
    """Make a command, or settings, of the values of all options by the name of their field."""
    plain, constants = parted(kind)
    hints = get_type_hints(plain, include_extras=True)
    settings = {name: settings_in(hint) for name, hint in hints.items()}
    names = [one.name for one in fields(plain) if is_option(one, hints[one.name], constants)]
    return kind(
        **{
            name: _made(settings[name], **values) if settings[name] else values[name]
            for name in names
        }
    )
