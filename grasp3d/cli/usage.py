"""Parsing of a command line: help of a command, its words, and usage errors.

A completion script for shells is made from the same options.
"""

import re
import shutil
from argparse import SUPPRESS, ArgumentError, ArgumentParser
from collections.abc import Mapping
from dataclasses import MISSING, is_dataclass
from difflib import get_close_matches
from functools import partial
from string import Template
from textwrap import fill, indent, shorten
from typing import Any

from grasp3d.cli.options import Option, left_out, members, options_of
from grasp3d.errors import SettingError
from grasp3d.settings.units import METRES

GROUPS = {
    "arguments": "arguments",
    "options": "options: What is read, written and printed.",
    "MeshOptions": "mesh: A LENGTH has a unit, such as 80mm; else it is in m, or the mesh's unit.",
    "GraspModel": "contacts: Friction, what the sensors resolve, and what else is uncertain.",
    "Sampling": "search: Which grasps are searched.",
    "ReachSettings": "hand: The hand that must reach each grasp, and what the object stands on.",
    "Load": "load: What each grasp must hold, and the available force.",
    "SimulationSettings": "simulation: How grasps are simulated.",
    "ViewSettings": "view: The initial view of the object.",
    "ClusterSettings": "processes: Which processes do the work, and their limits.",
}
"""Titles of the groups of options with their descriptions, in the order of the help."""

MAIN = {
    "unit", "friction", "sensor_resolution", "fingers", "max_opening", "hand", "table", "mass",
    "pose_error", "output", "best", "grasps", "frame", "max_distance", "metrics", "contact_rule",
    "mesh", "meshes", "outcome", "count", "object_mass", "workers", "fraction",
    "paint", "web", "screenshot",
}  # fmt: skip
"""Fields whose options are in the short help, with the first words of their help."""

HELP, HELP_ALL = ("-h", "--help"), "--help-all"

MOST_OPTIONS = 15
"""Largest number of options of a command whose short help lists all of them."""

LEAST_LIKENESS = 0.75
"""Least ratio of `difflib` at which an option is suggested."""

OTHER_WORDS = {
    "--gripper": "--hand",
    "--weight": "--mass",
    "--mu": "--friction",
    "--alpha": "--sensor-resolution",
}
"""Names that other programs use for options, and the names here."""

WIDEST = 100
"""Largest number of columns of the help."""

_NEGATIVE = re.compile(r"-([.\d]|([xyz]|inf|nan)$)")
"""Words that are not options: beginnings of negative numbers, such as -1mm, and directions."""

_END = re.compile(r"[.;:] (?![^(]*\))| \(default|\.$")
"""End of the first words of a help."""

_PAUSE = re.compile(r"[,;:]? \(|[,;:] (?![^(]*\))|$")
"""Earlier possible ends of the first words, outside parentheses."""


def parse(kind: type, words: list[str]) -> Any:
    """Parse the words of a command line into a command.

    Args:
        kind: The dataclass of its options.
        words: The words after its name.

    Raises:
        SettingError: An option is not known, or a value is missing or invalid.
    """
    options, prog = list(options_of(kind, helps=False)), prog_of(kind)
    named = {name: one for one in options for name in one.names}
    parser = ArgumentParser(add_help=False, allow_abbrev=False, exit_on_error=False)
    parser._negative_number_matcher = _NEGATIVE  # noqa: SLF001, others are no numbers
    parser.add_argument("arguments", nargs="*", default=())
    for one in options:
        taken = {"action": "extend", "nargs": "+"} if one.many else {"nargs": 1}
        how = taken if one.metavar else {"action": "store_true"}
        if one.names:
            parser.add_argument(*one.names, dest=one.field, default=SUPPRESS, **how)
    try:
        known, extra = parser.parse_known_args(words)
    except ArgumentError as error:
        one = named[(error.argument_name or "").rpartition("/")[2]]
        needs = f"needs a value: {one.metavar}" if one.metavar else "takes no value"
        raise SettingError(f"{one.name} {needs}") from error
    found = vars(known)
    rest = [*found.pop("arguments"), *extra]
    if unknown := next((word for word in extra if re.match("--|-[A-Za-z]", word)), ""):
        name = unknown.partition("=")[0]
        raise SettingError(f"{prog} has no option {name}; {_meant(name, [*named], prog)}")
    arguments = [one for one in options if not one.names]
    for one in arguments:
        own, rest = (rest, []) if one.many else (rest[:1], rest[1:])
        found |= {one.field: own} if own else {}
    if rest:
        takes = " ".join(one.metavar for one in arguments) or "options only"
        unit = "; a length has its unit without a space, as in 80mm" if rest[0] in METRES else ""
        raise SettingError(f"{rest[0]!r} is one too many: {prog} takes {takes}{unit}")
    if missing := [one for one in options if one.default is MISSING and one.field not in found]:
        needs = ", ".join(one.name if one.names else f"{one.metavar} first" for one in missing)
        raise SettingError(f"{prog} needs {needs}; see {prog} --help")
    values = {
        one.field: one.parse(found[one.field]) if isinstance(found[one.field], list) else True
        for one in options
        if one.field in found
    }
    return _made(kind, values)


def _made(kind: Any, values: Mapping[str, Any], without: Any = ()) -> Any:
    """Build a command, or settings, from option values by field name."""
    return kind(
        **{
            one.name: _made(base, values, left_out(notes)) if nested else values[one.name]
            for one, base, notes in members(kind, without)
            if (nested := is_dataclass(base)) or one.name in values
        }
    )


def _meant(name: str, names: list[str], prog: str) -> str:
    """Return a hint on the option that may have been meant, or on how to find it."""
    names = sorted(names, key=len)
    alike = [one for one in names if one == OTHER_WORDS.get(name)]
    alike += [one for one in names if len(name) > len("--x") and name.lstrip("-") in one]
    alike += get_close_matches(name, names, 1, LEAST_LIKENESS)
    return f"did you mean {alike[0]}?" if alike else f"all options: {prog} {HELP_ALL}"


def groups_of(kind: type) -> dict[str, list[Option]]:
    """Return the arguments and options of a command by group, in the order of the help."""
    options = list(options_of(kind))
    groups = {name: [one for one in options if one.group == name] for name in GROUPS}
    return {name: group for name, group in groups.items() if group}


def help_of(kind: type, *, whole: bool) -> str:
    """Return the help of a command.

    Args:
        kind: The dataclass of its options.
        whole: Whether all options are shown; otherwise only the main ones, if there are many.
    """
    from docstring_parser import parse_from_object

    doc, groups, more = parse_from_object(kind), groups_of(kind), ""
    columns = min(shutil.get_terminal_size().columns, WIDEST)
    paragraph = partial(fill, width=columns, initial_indent=" " * 6, subsequent_indent=" " * 6)
    lines = []
    if whole or sum(map(len, groups.values())) <= MOST_OPTIONS:
        more = doc.long_description or ""
        for name, group in groups.items():
            lines += [fill(GROUPS[name], columns)]
            lines += [f"  {invocation(one)}\n{paragraph(one.text)}" for one in group] + [""]
    else:
        every = (one for group in groups.values() for one in group)
        shown = {invocation(one): one for one in every if not one.names or one.field in MAIN}
        width = max(map(len, shown))
        rows = ((name, _first_words(one.text, columns - width - 4)) for name, one in shown.items())
        lines += [f"  {name:{width}}  {words}" for name, words in rows]
        lines += ["", f"all options: {prog_of(kind)} {HELP_ALL}", ""]
    texts = filter(None, (doc.short_description, *more.split("\n\n")))
    head = [usage_of(kind), "", *(f"{fill(text, columns)}\n" for text in texts)]
    return "\n".join([*head, *lines, "examples:", examples_of(kind)])


def _first_words(text: str, most: int) -> str:
    """Return the first sentence of a text, cut at a punctuation mark to at most `most` letters."""
    sentence = _END.split(text)[0]
    ends = [pause.start() for pause in _PAUSE.finditer(sentence) if pause.start() <= most]
    return sentence[: ends[-1]] if ends else shorten(sentence, most, placeholder=" ...")


def prog_of(kind: type) -> str:
    """Return the words that call a command."""
    return f"grasp3d {kind.__name__.lower()}"


def usage_of(kind: type) -> str:
    """Return the usage line of a command: its arguments and required options."""
    options = sorted(options_of(kind), key=lambda one: len(one.names))  # arguments first
    required = (one for one in options if one.default is MISSING or not one.names)
    words = (" ".join((*one.names[:1], one.metavar)) for one in required)
    return " ".join(["usage:", prog_of(kind), *words, "[OPTIONS]"])


def invocation(option: Option) -> str:
    """Return an option or argument as it is given on the command line."""
    return f"{', '.join(option.names)} {option.metavar}".strip()


def examples_of(kind: type) -> str:
    """Return the examples from the docstring of a command's options.

    In the examples the folder `meshes` is the one that comes with the package, `grasps.csv` a table
    with columns x1 y1 z1 x2 y2 z2, `tried.csv` poses with outcomes, `hand.urdf` a robot's hand.
    """
    from docstring_parser import parse_from_object

    [examples] = parse_from_object(kind).examples
    return indent(examples.description or "", "  ")


_SCRIPT = Template("""\
if [ -n "$${ZSH_VERSION-}" ]; then
    whence compdef > /dev/null || { autoload -U +X compinit && compinit; }
    autoload -U +X bashcompinit && bashcompinit
fi
_grasp3d() {
    local words="" word="$${COMP_WORDS[COMP_CWORD]}"
    case "$$COMP_CWORD $${COMP_WORDS[1]} $${COMP_WORDS[COMP_CWORD-1]}" in
        "1 "*) words="$commands --help --version --completion" ;;
$values
        *) case "$${COMP_WORDS[1]} $$word" in
$options
        esac ;;
    esac
    COMPREPLY=($$(compgen -W "$$words" -- "$$word"))
}
complete -o bashdefault -o default -F _grasp3d grasp3d
""")


def completion_script(kinds: Mapping[str, type]) -> str:
    """Return the script that `source <(grasp3d --completion)` runs; other words complete to files.

    Args:
        kinds: The options of each command, by its name.
    """
    values, options = [], []
    for command, kind in kinds.items():
        found = [one for one in options_of(kind, helps=False) if one.names]
        names = " ".join(name for one in found for name in one.names if name.startswith("--"))
        options.append(f'            "{command} -"*) words="{names} --help --help-all" ;;')
        for one in found:
            words = one.parser.placeholder.split("|")
            if len(words) > 1 and all(word == word.lower() for word in words):
                ends = f'        *" {command} {one.names[-1]}") words="{" ".join(words)}" ;;'
                values.append(ends)
    return _SCRIPT.substitute(
        commands=" ".join(kinds), values="\n".join(values), options="\n".join(options)
    )
