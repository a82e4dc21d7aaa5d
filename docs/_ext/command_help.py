"""What `grasp3d COMMAND --help` prints, taken apart into usage, options and examples."""

import io
import os
import re
from contextlib import redirect_stdout, suppress
from dataclasses import dataclass
from unittest import mock

from grasp3d.cli import main

COLUMNS = 80
_TOP, _ROW = re.compile(r"╭─ (.+?) ─*╮"), re.compile(r"│ (.*) │")
_RULE = re.compile(r"─+ *")
_BULLET = re.compile(r" *• (\S+) *(.*)")
_ENTRY = re.compile(r"(\S+(?: \S+)*)(?:  +(.*))?")


@dataclass(frozen=True)
class Entry:
    """An option, an argument or a command, and the text on it."""

    name: str
    text: str


@dataclass(frozen=True)
class Box:
    """A group of options, arguments or commands."""

    title: str
    text: str
    entries: tuple[Entry, ...]


@dataclass(frozen=True)
class Help:
    """The help of the program or of one command."""

    usage: str
    description: str
    boxes: tuple[Box, ...]
    after: str
    """What follows the boxes: examples."""


def printed_help(*command: str) -> str:
    """The help of the program or of one command in 80 columns, without colours."""
    out = io.TextIOWrapper(io.BytesIO(), encoding="utf-8")  # a stream that can print frames
    plain = mock.patch.dict(os.environ, COLUMNS=str(COLUMNS), NO_COLOR="1", TERM="dumb")
    with plain, redirect_stdout(out), suppress(SystemExit):
        main([*command, "--help"])
    out.seek(0)
    return out.read()


def help_of(*command: str) -> Help:
    """The help of the program or of one command, taken apart.

    Raises:
        ValueError: No options were found in what is printed.
    """
    text = printed_help(*command)
    usage, _, rest = text.strip().partition("\n\n")
    before, after, boxes = [], [], []
    for line in rest.splitlines():
        if top := _TOP.fullmatch(line):
            boxes.append((top[1], []))
        elif row := _ROW.fullmatch(line):
            boxes[-1][1].append(row[1].rstrip())
        elif not line.startswith("╰"):
            (after if boxes else before).append(line)
    read = tuple(_box(title, rows) for title, rows in boxes)
    if not any(box.entries for box in read):
        raise ValueError(f"no options in what {command} --help prints:\n{text}")
    usage = "\n".join(line.removeprefix("usage: ").rstrip() for line in usage.splitlines())
    return Help(usage, "\n".join(before).strip(), read, "\n".join(after).strip())


def commands() -> tuple[str, ...]:
    """Names of all commands, in the order in which the program lists them."""
    boxes = help_of().boxes
    return tuple(entry.name for box in boxes if "command" in box.title for entry in box.entries)


def _box(title: str, rows: list[str]) -> Box:
    """Take apart the rows of a box: a text down to a rule, then entries with indented text."""
    rules = [number for number, row in enumerate(rows) if _RULE.fullmatch(row)]
    first = rules[0] + 1 if rules else 0
    bulleted = any(map(_BULLET.fullmatch, rows))
    entries: list[tuple[str, list[str]]] = []
    for row in rows[first:]:
        if started := (_BULLET if bulleted else _ENTRY).fullmatch(row):
            entries.append((started[1], [started[2] or ""]))
        elif entries:
            entries[-1][1].append(row.strip())
    text = " ".join(rows[: rules[0]] if rules else []).strip()
    return Box(title, text, tuple(Entry(name, " ".join(lines).strip()) for name, lines in entries))
